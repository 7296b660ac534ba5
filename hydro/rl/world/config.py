"""Settings of the reinforcement-learning environment with their defaults; a run prints and stores them.

The reference paper (III-D) fixes the rates, the sensors, the shape of the reward and the three stages.  It
leaves sizes and some weights open; the defaults here fill these gaps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from hydro.core.errors import UsageError
from hydro.sim.craft import STEP
from hydro.sim.student import Physics

Engine = Literal["kernels", "mujoco"]


@dataclass(frozen=True)
class World:
    """Water tank of the environment.  In NED: north 0 to `length`, east 0 to `width`, floor at `depth`.

    Attributes:
        length: Extent north [m].
        width: Extent east [m].
        depth: Depth of the water [m].
        pillars: Greatest number of pillars in a scene; each stands from the floor to the surface.
        pillar_radius: Radius of a pillar [m].
    """

    length: float = 24.0
    width: float = 12.0
    depth: float = 8.0
    pillars: int = 64
    pillar_radius: float = 0.25


@dataclass(frozen=True)
class Sonar:
    """Fan of sonar beams from the hull's surface, level in the body, from port to starboard.

    The beams cover the flanks and the stern.  Without them, a policy without memory hits pillars that have
    left the view of its bow (docs/adr/0009).

    Attributes:
        fan: Angle between the outermost beams [rad].
        crowding: Exponent of the beam azimuth as a function of the beam number from the middle.  1 spaces the
            beams evenly; a larger value concentrates them ahead.
        reach: Greatest range, and the reading of a beam without an echo [m].
    """

    fan: float = math.radians(300.0)
    crowding: float = 1.5
    reach: float = 10.0

    def __post_init__(self) -> None:
        """Check the angles.

        Raises:
            UsageError: The fan is wider than a circle, or its beams do not run from port to starboard.
        """
        if not 0.0 < self.fan < 2.0 * math.pi:
            raise UsageError(f"sonar.fan is {self.fan:g} rad; give more than 0, less than a full circle")
        if self.crowding <= 0.0:
            raise UsageError(f"sonar.crowding is {self.crowding:g}; give a power above 0, 1 for even spacing")


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of the sensors, 1 sigma (Wu et al., III-D).

    Attributes:
        velocity: Each component of the DVL [m/s].
        rate: Each component of the gyroscope [rad/s].
        depth: Pressure sensor, as depth [m].
        range: Each beam of the sonar [m].
    """

    velocity: float = 0.05
    rate: float = 0.01
    depth: float = 0.02
    range: float = 0.05


@dataclass(frozen=True)
class Reward:
    """Weights of the reward (Wu et al., eq. 8); all except success and collision apply per control step.

    Attributes:
        shaping: phi_s: the potential phi falls by this much over the distance `distance` from the goal.
        distance: d_max, the distance over which the potential falls by `shaping` [m].
        discount: gamma of the shaping term gamma phi_t - phi_{t-1}.  With 1, as in Wu et al., its sum depends
            only on the first and last state.
        heading: w_a, the reward for pointing at the target in the horizontal plane.
        blind: Horizontal distance to the target below which the heading term is zero [m].
        upright: w_u, the reward for a level attitude.
        success: R_s, given once at the goal; it must exceed the reward of loitering for a whole episode.
        obstacle: w_d, the cost at the range `near`; it decays with exp(-1.5 (d - near)) up to `far`.
        near: d_c, the range of an obstacle at which its cost is greatest [m].
        far: d_w, the range of an obstacle beyond which it costs nothing [m].
        collision: w_col, the cost of a collision, which ends the episode; each step within `near` costs a
            hundredth of it.
        energy: Cost of full thrust of all thrusters.
        action: Cost of an action with all components at their limit.
        smoothness: Cost of a change of all components of the action by their limit.
        path: w_c, the weight of the cost of the distance from the path (eq. 9).
        hold: Weight of the cost of the distance from a goal that is held or followed (function of eq. 9).
        alignment: Reward for the heading of the dock, within the distance `close` of it.
        close: Distance from the dock within which `alignment` counts [m].
        haste: Cost of each m/s above the speed that the distance to the dock allows.
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
    """Start, goal and end of episodes; settings of a single task are in its own class.

    Attributes:
        steps: Greatest number of control steps of an episode; a task may use a multiple.
        radius: Distance to the goal that counts as success [m].
        least: Least distance from start to goal [m].
        most: Greatest distance from start to goal in open water [m].
        margin: Distance of start and goal from floor, surface and walls [m].
        ahead: Arc length along a planned path from the vehicle to the point that is its target [m].
        slant: Greatest angle between the course along the tank and the initial heading [rad].
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
    """Settings of a row of pillars, on alternating sides of a course along the tank.

    Attributes:
        spacing: Least distance between pillars along the course [m]; the course is as long as the pillars
            need.
        run_up: Distance from the start to the first pillar, and from the last pillar to the goal [m].
        sway: Least and greatest distance of a pillar from the course [m].
    """

    spacing: float = 2.0
    run_up: float = 2.5
    sway: tuple[float, float] = (0.45, 1.05)


@dataclass(frozen=True)
class Slalom:
    """Settings of baffles (walls of pillars), alternately from both long walls; a path leads between them.

    Attributes:
        spacing: Least distance between baffles along the tank [m].
        run_up: Least distance from the start to the first baffle, and from the last baffle to the goal [m].
        reach: Least and greatest length of a baffle from its wall [m].
        gap: Distance between the axes of a baffle's pillars [m].
    """

    spacing: float = 4.0
    run_up: float = 2.6
    reach: tuple[float, float] = (6.2, 7.2)
    gap: float = 0.6


@dataclass(frozen=True)
class Forest:
    """Settings of a forest: pillars at random places.

    Attributes:
        spacing: Least distance between the pillars' axes [m]; it leaves the planner's margin on both sides.
        clear: Least distance of a pillar's axis from start and goal [m].
        blocked: Distance of a pillar's axis from the straight line below which it blocks the line [m].
    """

    spacing: float = 2.9
    clear: float = 1.7
    blocked: float = 0.6


@dataclass(frozen=True)
class Station:
    """Settings of station keeping: a position that the vehicle holds in a current.

    Attributes:
        current: Least and greatest speed of the horizontal current [m/s]; its direction is random.
        away: Greatest distance of the start from the station [m].
        settling: Time after which the error counts [s].
        within: Greatest root mean square error of a success [m].
    """

    current: tuple[float, float] = (0.1, 0.4)
    away: float = 2.0
    settling: float = 8.0
    within: float = 0.3


@dataclass(frozen=True)
class Trajectory:
    """Settings of trajectory tracking: a point that moves along a figure.

    Attributes:
        speed: Least and greatest speed [m/s].
        radius: Least and greatest radius of the circle and of the helix [m].
        half: Least and greatest half length of the lemniscate [m].
        lead: Time by which the target in the observation is ahead of the point [s].
        settling: Time after which the error counts [s].
        within: Greatest root mean square error of a success [m].
    """

    speed: tuple[float, float] = (0.3, 0.7)
    radius: tuple[float, float] = (2.5, 3.5)
    half: tuple[float, float] = (4.0, 6.0)
    lead: float = 1.4
    settling: float = 5.0
    within: float = 0.3


@dataclass(frozen=True)
class Docking:
    """Settings of docking from the south, with the bow to the north.

    Attributes:
        within: Greatest distance to the dock [m].
        tilt: Greatest angle between the vehicle's attitude and the dock's: level, bow to the north [rad].
        speed: Greatest speed over ground [m/s].
        turning: Greatest angular velocity [rad/s].
        bearing: Greatest angle between the dock's axis and the line from the start to the dock [rad].
    """

    within: float = 0.25
    tilt: float = math.radians(15.0)
    speed: float = 0.3
    turning: float = math.radians(15.0)
    bearing: float = math.radians(45.0)


@dataclass(frozen=True)
class Waypoints:
    """Course along the tank through waypoints.

    A vehicle with fins has a turning circle of several metres, so it needs a large tank, such as 120 m by 60
    m by 20 m.  In a smaller tank the legs are shorter.

    Attributes:
        count: Number of waypoints.
        leg: Least and greatest distance between waypoints [m]: some turning radii of a REMUS 100.
        turn: Greatest angle between a leg and the tank's long axis [rad].
        slope: Greatest change of depth of a leg, as a share of its length.
        clear: Distance of the course from floor, surface and walls beyond the margin [m]; at most a quarter
            of the tank.
        within: Distance at which a waypoint is passed [m]: about two lengths of a REMUS 100, the usual circle
            of acceptance (Fossen 2011, chapter 10).  It is at most a quarter of a leg.
        pace: Speed along the straight legs that the time limit allows for [m/s].
    """

    count: int = 4
    leg: tuple[float, float] = (12.0, 18.0)
    turn: float = math.radians(40.0)
    slope: float = 0.1
    clear: float = 10.0
    within: float = 3.0
    pace: float = 0.5


@dataclass(frozen=True)
class Randomisation:
    """Random differences of vehicle, water and sensors from the vehicle file, drawn for each episode.

    Attributes:
        posterior: Draw the estimated parameters from the covariance file of the vehicle file.
        box: Otherwise draw every parameter of its effects that is not `known` within this share of its value.
        current: Greatest speed of a horizontal current in a random direction [m/s].
        load: Greatest dry mass of a payload, as a share of the vehicle's mass.
        thruster: Greatest loss of thrust of one thruster, as a share; 1 allows a dead thruster.
        bias: Standard deviation of the sensor biases, in multiples of the sensor noise.
        delay: Greatest delay of the sensors [s].
        late: Greatest delay of the commands [s].
        full: Use the greatest values of all these instead of drawing them; parameters and biases stay random.
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
        """Check the ranges.

        Raises:
            UsageError: A number is negative, or a share is above 1.
        """
        for name in ("current", "load", "bias", "delay", "late"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise UsageError(f"randomise.{name} is {getattr(self, name):g}; give 0 or more")
        for name in ("box", "thruster"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise UsageError(f"randomise.{name} is {getattr(self, name):g}; give a share within 0 and 1")


@dataclass(frozen=True)
class Settings:
    """All settings of the environment.

    Attributes:
        world: Tank.
        sonar: Sonar.
        noise: Noise of the sensors.
        reward: Weights of the reward.
        task: Episodes of all tasks.
        row: Task `pillar_row`.
        slalom: Task `slalom`.
        forest: Task `forest`.
        station: Task `station_keeping`.
        trajectory: Tasks `circle`, `helix` and `lemniscate`.
        docking: Task `docking`.
        waypoints: Task `waypoints`.
        randomise: Random differences from the vehicle file.
        history: Number of stacked observations, the newest first.
        engine: Simulator of the vehicles: `kernels`, this project's own code without MuJoCo, or `mujoco`.
            The physics is the same; only the integration differs.
        step: Greatest integration step of the kernels, which use the classical Runge-Kutta method [s].
        physics: Step and integrator of MuJoCo; by default 500 Hz as in Wu et al..
        period: Control step [s].
        overspeed: Speed above which steps are counted [m/s]; it does not end an episode.
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
    waypoints: Waypoints = field(default_factory=Waypoints)
    randomise: Randomisation = field(default_factory=Randomisation)
    history: int = 1
    engine: Engine = "kernels"
    step: float = STEP
    physics: Physics = field(default_factory=Physics)
    period: float = 0.04
    overspeed: float = 5.0

    def __post_init__(self) -> None:
        """Check that the settings are consistent.

        Raises:
            UsageError: Loitering is rewarded more than success, open water does not fit into the tank, the
                control step is not a multiple of MuJoCo's step, the engine is unknown, or a number is not
                positive.
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
        if self.engine not in get_args(Engine):
            raise UsageError(
                f"settings.engine is {self.engine!r}; choose one of {', '.join(get_args(Engine))}"
            )
        if not 0.0 < self.step < math.inf:
            raise UsageError(f"settings.step is {self.step:g} s; give a number above 0")
        self.physics.steps(self.period, "the control step")
