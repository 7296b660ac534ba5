"""Blocks of arrays that the compiled kernels of a fleet take; N vehicles, P pillars, n thrusters.

The arrays are shared, not copied.  The fleet and its plant write them, and the kernels read and write the
same memory.
"""

from __future__ import annotations

from typing import NamedTuple

from hydro.core.columns import Array, Array32, Mask

RETURN, AGE, ENERGY, OVERSPEED, ERROR, TOTALS = range(6)
"""Columns of the totals of an episode: sum of rewards; steps; time of full thrust [s]; steps above the
plausible speed; sum of the squared distances from the goal since settling [m^2]."""
ARRIVED, TOUCHED, DIVERGED, FAST, TERMINATED, TRUNCATED, FLAGS = range(7)
"""Rows of the flags of a step: success, collision, divergence, overspeed, and the two ends of an episode."""
STEPS, RADIUS, TILT, SPEED, TURNING, SETTLING = range(6)
"""Columns of the numbers of `tasks.task.Ends`."""
LIMIT, PERIOD = range(2)
"""Entries of `Rules.limits`."""


class Senses(NamedTuple):
    """Sensors of all vehicles.

    Attributes:
        limits: Least and greatest values of each observation (2, 36).
        fan: Origin [m] and unit direction of each of the sonar's beams, in body axes FRD (15, 6).
        reach: Greatest range of the sonar [m].
        tank: Sizes of the tank (4,) [m]; see `rl.environment.geometry.tank`.
        gravity: Gravity [m/s^2].
        sigma: Standard deviation of each observation's noise (36,).
    """

    limits: Array32
    fan: Array
    reach: float
    tank: Array
    gravity: float
    sigma: Array


class Rules(NamedTuple):
    """Constants for all tasks, by which collisions, excess speed and energy of a control step are determined.

    Attributes:
        hull: Centre and semi-axes of the hull's ellipsoid (6,) [m]; see
            `rl.environment.geometry.hull_numbers`.
        tank: Sizes of the tank (4,) [m]; see `rl.environment.geometry.tank`.
        table: Table of `core.vehicle.thrusters`, one row per thruster (n, columns).
        limits: Implausible speed [m/s], control step [s].
    """

    hull: Array
    tank: Array
    table: Array
    limits: Array


class Motion(NamedTuple):
    """Motion of N vehicles: the arrays of a `sim.plant.Plant`, and the rotation matrices of its poses.

    Attributes:
        pose: x y z of CO, NED [m], and the quaternion (w, x, y, z) from FRD to NED, (N, 7).
        velocity: u v w p q r over ground, FRD, (N, 6) [m/s, rad/s].
        specific_force: Specific force at CO (reading of an accelerometer), FRD, (N, 3) [m/s^2].
        thrust: Thrust of each of n thrusters, (N, n) [N].
        diverged: Mask of the vehicles whose simulation diverged, (N,).
        rotation: Body to NED, row by row (N, 9); written by `sense_kernel`.
    """

    pose: Array
    velocity: Array
    specific_force: Array
    thrust: Array
    diverged: Mask
    rotation: Array


class Scenes(NamedTuple):
    """Tasks of N vehicles.

    Attributes:
        weights: Weights of the terms of the reward (N, WEIGHTS); see `rl.environment.reward`.
        ends: Conditions that end an episode (N, 6); see `tasks.task.Ends`.
        goals: Goal of each vehicle (N, 3), NED [m].
        targets: Points that the observations show as targets (N, 3), NED [m].
        pillars: North and east of the axes of P pillars (N, P, 2) [m], NaN in unused rows, which come last.
        path_cost: Weighted cost of the cross-track error (N,).
    """

    weights: Array
    ends: Array
    goals: Array
    targets: Array
    pillars: Array
    path_cost: Array


class Episodes(NamedTuple):
    """State of N running episodes that one control step passes to the next.

    Attributes:
        nearest: Shortest range of the sonar without noise (N,) [m]; written by `sense_kernel`.
        action: Action of the previous step (N, 6); this and the following are written by `step_kernel`.
        distance: Distance to the goal (N,) [m].
        totals: Totals of the episode, such as its age (N, TOTALS).
    """

    nearest: Array
    action: Array
    distance: Array
    totals: Array


class Outcome(NamedTuple):
    """Rewards and flags of a control step, written by `step_kernel`.

    Attributes:
        reward: Reward of each vehicle, (N,).
        flags: Flags of each vehicle, such as collided, (FLAGS, N).
        terms: Terms of the reward, costs negative (N, TERMS); see `rl.environment.reward`.
    """

    reward: Array32
    flags: Mask
    terms: Array
