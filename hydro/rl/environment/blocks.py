"""The arrays of a fleet in blocks, as its compiled passes take them; N vehicles, P pillars, n thrusters.

Arrays are shared, not copied: what the fleet and its plant write is what the kernels read, and what the
kernels write is what the fleet reads.
"""

from __future__ import annotations

from typing import NamedTuple

from hydro.core.columns import Array, Array32, Mask

RETURN, AGE, ENERGY, OVERSPEED, ERROR, TOTALS = range(6)
"""Totals of an episode: sum of rewards, steps, seconds of full thrust, steps faster than is plausible, sum of
the squared distances from the goal that count [m^2]."""
ARRIVED, TOUCHED, DIVERGED, FAST, TERMINATED, TRUNCATED, FLAGS = range(7)
STEPS, RADIUS, TILT, SPEED, TURNING, SETTLING = range(6)
"""Where the numbers of `tasks.task.Ends` stand."""
LIMIT, PERIOD = range(2)


class Senses(NamedTuple):
    """The sensors, and where they are looked from and at.

    Attributes:
        limits: Least and greatest values of each observation (2, 36).
        fan: Places and directions of the sonar's beams in the body (15, 6) [m].
        reach: Its reach [m].
        tank: Numbers of `rl.environment.geometry`.
        gravity: [m/s^2].
        sigma: Standard deviation of each observation's noise (36,).
    """

    limits: Array32
    fan: Array
    reach: float
    tank: Array
    gravity: float
    sigma: Array


class Rules(NamedTuple):
    """What a step is measured by, whatever the task.

    Attributes:
        hull: Numbers of `rl.environment.geometry`.
        tank: Likewise.
        table: Thruster table (n, columns).
        limits: Implausible speed [m/s], control step [s].
    """

    hull: Array
    tank: Array
    table: Array
    limits: Array


class Motion(NamedTuple):
    """How the vehicles move: the arrays of a `sim.plant.Plant`, and the rotation of its poses.

    Attributes:
        pose: x y z of CO, NED [m], and the quaternion (w, x, y, z) from FRD to NED, (N, 7).
        velocity: u v w p q r over ground, FRD, (N, 6).
        specific_force: FRD, (N, 3) [m/s^2].
        thrust: (N, n) [N].
        diverged: (N,).
        rotation: Body to NED, row by row (N, 9); written by `sense_kernel`.
    """

    pose: Array
    velocity: Array
    specific_force: Array
    thrust: Array
    diverged: Mask
    rotation: Array


class Scenes(NamedTuple):
    """The tasks that the vehicles fly.

    Attributes:
        weights: Of the terms of the reward (N, WEIGHTS), see `rl.environment.reward`.
        ends: When its episode is done (N, 6), see `tasks.task.Ends`.
        goals: (N, 3), NED [m].
        targets: What each is to swim to (N, 3).
        pillars: Axes of its pillars (N, P, 2), NaN where there is none.
        path_cost: Weighted cost of being off the path (N,).
    """

    weights: Array
    ends: Array
    goals: Array
    targets: Array
    pillars: Array
    path_cost: Array


class Episodes(NamedTuple):
    """What an episode keeps from one step to the next.

    Attributes:
        nearest: Nearest echo of the sonar without noise (N,) [m]; written by `sense_kernel`.
        action: Demands of the step before (N, 6); this and the rest are written by `step_kernel`.
        distance: To the goal (N,) [m].
        totals: (N, TOTALS).
    """

    nearest: Array
    action: Array
    distance: Array
    totals: Array


class Outcome(NamedTuple):
    """What a step has come to, written by `step_kernel`.

    Attributes:
        reward: (N,).
        flags: (FLAGS, N).
    """

    reward: Array32
    flags: Mask
