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
        pillars: Most pillars of a scene; each stands from the floor to the surface.
        pillar_radius: [m].
    """

    length: float = 24.0
    width: float = 12.0
    depth: float = 8.0
    pillars: int = 8
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


@dataclass(frozen=True)
class Task:
    """Where episodes start, where they lead and when they end.

    Attributes:
        steps: Control steps of an episode at most.
        radius: Distance to the goal that is a success [m].
        least: Least distance from start to goal [m].
        most: Greatest distance in open water [m].
        margin: Distance that start and goal keep from floor, surface and walls [m].
        spacing: Least distance between pillars along a slalom [m]; its course is as long as they ask for.
        run_up: Distance from the start to the first pillar, and from the last to the goal [m].
        sway: Least and greatest distance of a pillar from the course [m]; they stand on alternating sides.
        slant: Greatest angle between course and first heading of a slalom [rad].
    """

    steps: int = 500
    radius: float = 0.5
    least: float = 3.0
    most: float = 8.0
    margin: float = 1.2
    spacing: float = 2.0
    run_up: float = 2.5
    sway: tuple[float, float] = (0.45, 1.05)
    slant: float = math.pi / 4


@dataclass(frozen=True)
class Settings:
    """All choices of the environment.

    Attributes:
        world: The tank.
        sonar: The sonar.
        noise: Noise of the sensors.
        reward: Weights.
        task: Episodes.
        physics: Physics step and integrator; the paper's 500 Hz by default.
        period: Control step [s].
        overspeed: Speed beyond which steps are counted [m/s]; it ends nothing.
    """

    world: World = field(default_factory=World)
    sonar: Sonar = field(default_factory=Sonar)
    noise: Noise = field(default_factory=Noise)
    reward: Reward = field(default_factory=Reward)
    task: Task = field(default_factory=Task)
    physics: Physics = field(default_factory=Physics)
    period: float = 0.04
    overspeed: float = 5.0

    def __post_init__(self) -> None:
        """Refuse choices that contradict each other.

        Raises:
            UsageError: Loitering pays better than arriving, a slalom does not fit into the tank, or the
                control step is no multiple of the physics step.
        """
        loitering = self.task.steps * (self.reward.heading + self.reward.upright)
        if self.reward.success <= loitering:
            raise UsageError(
                f"reward.success is {self.reward.success:g}, but {self.task.steps} steps of heading and "
                f"upright earn {loitering:g} without arriving; give more"
            )
        room = self.world.length - 2.0 * self.task.margin
        slalom = course(self.task, self.world.pillars)
        if max(self.task.most, slalom) > room:
            raise UsageError(
                f"a slalom of {self.world.pillars} pillars is {slalom:g} m long, open water up to "
                f"{self.task.most:g} m, and the tank leaves {room:g} m; lengthen world.length"
            )
        self.physics.steps(self.period, "the control step")


def course(task: Task, pillars: int) -> float:
    """Least length [m] of a slalom of so many pillars; 0 without any."""
    return 2.0 * task.run_up + (pillars - 1) * task.spacing if pillars else 0.0
