"""Every choice of the reinforcement-learning task, with its default; a run prints them and keeps them.

The reference paper (III-D) fixes the rates, the sensors, the shape of the reward and the three stages; sizes
and weights that it leaves open are chosen here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from hydro.core.errors import UsageError
from hydro.sim.student import Physics


@dataclass(frozen=True)
class World:
    """A tank of water in NED: north 0 to `length`, east 0 to `width`, the surface at 0, the floor at `depth`.

    Attributes:
        length: [m].
        width: [m].
        depth: [m].
        pillars: Room for so many in a scene; each stands from the floor to the surface.
        pillar_radius: [m].
    """

    length: float = 24.0
    width: float = 12.0
    depth: float = 8.0
    pillars: int = 64
    pillar_radius: float = 0.25


@dataclass(frozen=True)
class Sonar:
    """A fan of beams from the hull's skin, level in the body, from port to starboard.

    They look around the hull: a policy without memory hits with flank and stern what has left its bow's sight
    (docs/adr/0009).

    Attributes:
        fan: Angle between the outermost beams [rad].
        crowding: How much closer beams stand ahead than abaft: their azimuths go with this power of their
            number from the middle; 1 spaces them evenly.
        reach: Greatest range; a beam that meets nothing nearer gives it [m].
    """

    fan: float = math.radians(300.0)
    crowding: float = 1.5
    reach: float = 10.0

    def __post_init__(self) -> None:
        """Refuse what is no fan.

        Raises:
            UsageError: It is wider than a circle, or beams do not go from port to starboard.
        """
        if not 0.0 < self.fan < 2.0 * math.pi:
            raise UsageError(f"sonar.fan is {self.fan:g} rad; give more than 0, less than a full circle")
        if self.crowding <= 0.0:
            raise UsageError(f"sonar.crowding is {self.crowding:g}; give a power above 0, 1 for even spacing")


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of the sensors, 1 sigma (paper III-D).

    Attributes:
        velocity: Of each component of the velocity log [m/s].
        rate: Of each component of the gyroscope [rad/s].
        depth: [m].
        range: Of each beam of the sonar [m].
    """

    velocity: float = 0.05
    rate: float = 0.01
    depth: float = 0.02
    range: float = 0.05


@dataclass(frozen=True)
class Reward:
    """Weights of the reward (paper eq. 8); everything but success and collision is per control step.

    Attributes:
        shaping: phi_s, the potential lost over `distance`.
        distance: d_max [m].
        discount: gamma of the shaping gamma phi_t - phi_{t-1}; 1, as in the paper, lets it sum to its ends.
        heading: w_a, for pointing at the target in the horizontal plane.
        blind: Horizontal distance to the target within which heading has no weight [m].
        upright: w_u.
        success: R_s, more than loitering for a whole episode can earn.
        obstacle: w_d, at the range `near`; falls off by exp(-1.5 (d - near)) up to `far`.
        near: d_c [m].
        far: d_w [m].
        collision: w_col: once where an episode ends in a collision, and a hundredth of it for every step
            spent within `near`.
        energy: Of all thrusters at full thrust.
        action: Of all demands at their limit.
        smoothness: Of all demands changing by their limit.
        path: w_c, of the cross-track cost (eq. 9).
        hold: Of the distance from what is to be held or followed, by the same cost.
        alignment: For standing as the dock does, within `close` of it.
        close: [m].
        haste: Of every m/s faster than the distance to the dock allows.
    """

    shaping: float = 20.0
    distance: float = 8.0
    discount: float = 1.0
    heading: float = 0.01
    blind: float = 0.5
    upright: float = 0.01
    success: float = 15.0
    obstacle: float = 0.02
    near: float = 0.4
    far: float = 4.0
    collision: float = 20.0
    energy: float = 0.01
    action: float = 0.005
    smoothness: float = 0.01
    path: float = 0.02
    hold: float = 0.0
    alignment: float = 0.0
    close: float = 2.0
    haste: float = 0.0


@dataclass(frozen=True)
class Episode:
    """Where episodes start, where they lead and when they end; what a task of its own has is in its own.

    Attributes:
        steps: Control steps of an episode at most; a task may give a multiple of them.
        radius: Distance to the goal that is a success [m].
        least: Least distance from start to goal [m].
        most: Greatest distance in open water [m].
        margin: Distance that start and goal keep from floor, surface and walls [m].
        ahead: How far along a planned way the point lies that a vehicle is shown [m].
        slant: Greatest angle between a course along the tank and the first heading [rad].
    """

    steps: int = 500
    radius: float = 0.5
    least: float = 3.0
    most: float = 8.0
    margin: float = 1.2
    ahead: float = 2.5
    slant: float = math.pi / 4


@dataclass(frozen=True)
class Row:
    """Pillars in a row, on alternating sides of a course along the tank.

    Attributes:
        spacing: Least distance between pillars along it [m]; the course is as long as they ask for.
        run_up: Distance from the start to the first pillar, and from the last to the goal [m].
        sway: Least and greatest distance of a pillar from the course [m].
    """

    spacing: float = 2.0
    run_up: float = 2.5
    sway: tuple[float, float] = (0.45, 1.05)


@dataclass(frozen=True)
class Slalom:
    """Baffles of pillars alternately from both long walls: there is no way but between them.

    Attributes:
        spacing: Least distance between baffles along the tank [m].
        run_up: Least distance from the start to the first, and from the last to the goal [m].
        reach: Least and greatest distance that a baffle reaches from its wall [m].
        gap: Between the axes of a baffle's pillars [m].
    """

    spacing: float = 4.0
    run_up: float = 2.6
    reach: tuple[float, float] = (6.2, 7.2)
    gap: float = 0.6


@dataclass(frozen=True)
class Forest:
    """Pillars at random.

    Attributes:
        spacing: Least distance between their axes [m], which leaves the planner's margin on both sides.
        clear: Least distance of a pillar's axis from start and goal [m].
        blocked: Distance of a pillar's axis from the straight line that stands in its way [m].
    """

    spacing: float = 2.9
    clear: float = 1.7
    blocked: float = 0.6


@dataclass(frozen=True)
class Station:
    """A place to be held in a current.

    Attributes:
        current: Least and greatest speed of the current [m/s]; it flows level, in any direction.
        away: Greatest distance of the start from the place [m].
        settling: Time after which the error counts [s].
        within: Root mean square error that is a success [m].
    """

    current: tuple[float, float] = (0.1, 0.4)
    away: float = 2.0
    settling: float = 8.0
    within: float = 0.3


@dataclass(frozen=True)
class Trajectory:
    """A point that moves along a figure.

    Attributes:
        speed: Least and greatest speed [m/s].
        radius: Least and greatest radius of the circle and of the helix [m].
        half: Least and greatest half length of the lemniscate [m].
        lead: What is shown for a target is where the point will be in so long [s].
        settling: Time after which the error counts [s].
        within: Root mean square error that is a success [m].
    """

    speed: tuple[float, float] = (0.3, 0.7)
    radius: tuple[float, float] = (2.5, 3.5)
    half: tuple[float, float] = (4.0, 6.0)
    lead: float = 1.4
    settling: float = 5.0
    within: float = 0.3


@dataclass(frozen=True)
class Docking:
    """A dock that is entered from the south, bow to the north.

    Attributes:
        within: Distance to the dock that is near enough [m].
        tilt: Greatest angle between the vehicle's attitude and the dock's, level and to the north [rad].
        speed: Greatest speed over ground [m/s].
        turning: Greatest angular velocity [rad/s].
        bearing: Greatest angle between the dock's axis and the way there at the start [rad].
    """

    within: float = 0.25
    tilt: float = math.radians(15.0)
    speed: float = 0.3
    turning: float = math.radians(15.0)
    bearing: float = math.radians(45.0)


@dataclass(frozen=True)
class Randomisation:
    """How the vehicle, the water and the sensors of each episode differ from what the file says.

    Attributes:
        posterior: Draw the file's estimated numbers from their covariance, which lies beside it.
        box: Else draw every number of its effects that is not known within so great a share of itself.
        current: Greatest speed of a level current in any direction [m/s].
        load: Greatest dry mass of a payload on board, as a share of the vehicle's.
        thruster: Greatest share of its thrust that one thruster has lost; 1: it may be dead.
        bias: Standard deviation of the sensors' biases, in multiples of their noise.
        delay: Greatest delay of the sensors [s].
        late: Greatest delay of the commands [s].
        full: Whether all but the vehicle's numbers and the biases are drawn at their greatest alone.
    """

    posterior: bool = False
    box: float = 0.0
    current: float = 0.0
    load: float = 0.0
    thruster: float = 0.0
    bias: float = 0.0
    delay: float = 0.0
    late: float = 0.0
    full: bool = False

    def __post_init__(self) -> None:
        """Refuse what cannot be drawn.

        Raises:
            UsageError: A number is negative, or a share is more than one.
        """
        for name in ("current", "load", "bias", "delay", "late"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise UsageError(f"randomise.{name} is {getattr(self, name):g}; give 0 or more")
        for name in ("box", "thruster"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise UsageError(f"randomise.{name} is {getattr(self, name):g}; give a share within 0 and 1")


@dataclass(frozen=True)
class Settings:
    """All choices of the environment.

    Attributes:
        world: The tank.
        sonar: The sonar.
        noise: Noise of the sensors.
        reward: Weights.
        task: Episodes.
        row: Of the task of that name; likewise what follows.
        slalom: Likewise.
        forest: Likewise.
        station: Of station keeping.
        trajectory: Of circle, helix and lemniscate.
        docking: Likewise.
        randomise: What differs from the vehicle file.
        history: Observations that are seen at once, the newest first.
        physics: Physics step and integrator; the paper's 500 Hz by default.
        period: Control step [s].
        overspeed: Speed beyond which steps are counted [m/s]; it ends nothing.
    """

    world: World = field(default_factory=World)
    sonar: Sonar = field(default_factory=Sonar)
    noise: Noise = field(default_factory=Noise)
    reward: Reward = field(default_factory=Reward)
    task: Episode = field(default_factory=Episode)
    row: Row = field(default_factory=Row)
    slalom: Slalom = field(default_factory=Slalom)
    forest: Forest = field(default_factory=Forest)
    station: Station = field(default_factory=Station)
    trajectory: Trajectory = field(default_factory=Trajectory)
    docking: Docking = field(default_factory=Docking)
    randomise: Randomisation = field(default_factory=Randomisation)
    history: int = 1
    physics: Physics = field(default_factory=Physics)
    period: float = 0.04
    overspeed: float = 5.0

    def __post_init__(self) -> None:
        """Refuse choices that contradict each other.

        Raises:
            UsageError: Loitering pays better than arriving, open water does not fit into the tank, or the
                control step is no multiple of the physics step.
        """
        loitering = self.task.steps * (self.reward.heading + self.reward.upright)
        if self.reward.success <= loitering:
            raise UsageError(
                f"reward.success is {self.reward.success:g}, but {self.task.steps} steps of heading and "
                f"upright earn {loitering:g} without arriving; give more"
            )
        room = self.world.length - 2.0 * self.task.margin
        if self.task.most > room:
            raise UsageError(
                f"open water is up to {self.task.most:g} m, and the tank leaves {room:g} m; lengthen "
                "world.length"
            )
        if self.history < 1:
            raise UsageError(f"settings.history is {self.history}; give 1 or more")
        self.physics.steps(self.period, "the control step")
