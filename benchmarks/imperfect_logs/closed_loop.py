"""Flights under feedback: station keeping, and way-points.

The vehicle is the benchmark's own simulator (`hidden_effects.plant`), with its hidden effect.  The controller
uses the file of the diagnosis, and sees pose and velocity with the noise of the log.  So commands depend on
motion, disturbance and noise, as at sea.  The gains are those of a second-order motion on each axis (Fossen
2011, 15.3) with an integrator on position.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from numba import njit

from benchmarks.hidden_effects.build import build
from benchmarks.hidden_effects.flights import DT, angles, holds, logged, scaled, table
from benchmarks.hidden_effects.plant import BODY, Array, Plant, commanded, onward, resting, turned
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

STATION, WAY_POINTS = "station-keeping", "way-points"
POSITION, HEADING, DAMPING = 0.35, 0.8, 0.8
"""Natural frequencies [rad/s] and damping ratio of the position and the heading loop."""
INTEGRAL = 0.1  # of the position's stiffness per second
CRUISE = 0.5
"""Share of the surge authority that the speed between way-points takes."""
REACHED = 1.0  # m from a way-point at which the next one is steered for
BOX = np.array([6.0, 6.0, 1.5])  # m, half the space that way-points lie in
STEPS = np.array([0.7, 0.7, 0.4, 0.5])  # m, m, m, rad by which a station is moved, standard deviation
STAY = (10.0, 25.0)  # s between two moves of a station
CURRENT = (0.2, 0.5)
"""Speed of an unknown current over the speed between way-points."""


def speed(file: Plant, authority: float) -> float:
    """Return the steady surge speed [m/s] at a share of the greatest thrust, by the vehicle file."""
    linear, quadratic = file.linear[0, 0], file.quadratic[0]
    return float(2.0 * authority / (linear + np.sqrt(linear**2 + 4.0 * quadratic * authority) + 1e-9))


def current(given: Vehicle, seed: int) -> dict[str, Any]:
    """Return the `[[effect]]` table of a horizontal current that the vehicle file does not have."""
    rng, file = np.random.default_rng([seed, 23]), build(given)
    size = float(rng.uniform(*CURRENT)) * cruise(file)
    way = float(rng.uniform(-np.pi, np.pi))
    return {"name": "ocean_current", "v_N": size * np.cos(way), "v_E": size * np.sin(way), "v_D": 0.0}


def cruise(file: Plant) -> float:
    """Return the speed between way-points [m/s]."""
    limits = file.limits.min(axis=1)
    ahead = np.linalg.pinv(file.thrusts.T)[:, 0]
    return speed(file, CRUISE * float((limits / np.maximum(np.abs(ahead), 1e-9)).min()))


def sessions(
    given: Vehicle,
    actual: Vehicle,
    hidden: Sequence[Mapping[str, Any]],
    task: str,
    *,
    rows: Sequence[int],
    depth: float,
    noise: float,
    seed: int,
) -> Iterator[pl.DataFrame]:
    """Fly sessions under feedback, each from rest at its own heading.

    Args:
        given: The file that the controller uses.
        actual: The vehicle with its true damping.
        hidden: Additional `[[effect]]` tables.
        task: STATION or WAY_POINTS.
        rows: Rows of each session.
        depth: Depth at which sessions begin [m].
        noise: Factor on the ordinary noise.
        seed: Seed of headings, targets and noise.

    Raises:
        DataError: The motion diverges.
    """
    plant, file = build(actual, hidden), build(given)
    allocation, gains = np.linalg.pinv(file.thrusts.T), holds(file)
    inertia = np.diag(file.rigid + file.added).copy()
    for number, count in enumerate(rows):
        rng = np.random.default_rng([seed, number, 29])
        heading = float(rng.uniform(-np.pi, np.pi))
        first = np.zeros(BODY)
        first[2], first[3], first[6] = depth, np.cos(0.5 * heading), np.sin(0.5 * heading)
        seen = rng.standard_normal((count, 12)) * scaled(noise).deviations
        roaming = task == WAY_POINTS
        aims = way_points(depth, rng) if roaming else stations(count, depth, heading, rng)
        states, commands = fly(
            plant, file, allocation, gains, inertia, aims, cruise(file) if roaming else 0.0, first, seen, DT
        )
        if not np.isfinite(states).all():
            raise DataError(f"the motion of {given.name} grows beyond all bounds")
        motion = np.hstack([states[:, :3], angles(states[:, 3:7]), logged(states, hidden)]) + seen
        yield table(f"s{number}", motion, commands, 0.0, rng)


def way_points(depth: float, rng: np.random.Generator, count: int = 400) -> Array:
    """Return points (count, 4) to reach in turn: x, y, z [m], NED, and a heading that is not held."""
    points = np.zeros((count, 4))
    points[:, :3] = rng.uniform(-BOX, BOX, (count, 3))
    points[:, 2] += depth
    return points


def stations(rows: int, depth: float, heading: float, rng: np.random.Generator) -> Array:
    """Return the station of every row (rows, 4): x, y, z [m], NED, and heading [rad].

    The station moves a little from time to time.
    """
    home = np.array([0.0, 0.0, depth, heading])
    edges = np.cumsum(rng.uniform(*STAY, 1 + int(rows * DT / STAY[0])))
    places = home + rng.normal(size=(edges.size + 1, 4)) * STEPS
    out: Array = places[np.searchsorted(edges, np.arange(rows) * DT)]
    return out


@njit(cache=True)
def wrapped(angle: float) -> float:
    """Return the angle wrapped to half a turn [rad]."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@njit(cache=True)
def fly(
    plant: Plant,
    file: Plant,
    allocation: Array,
    gains: Array,
    inertia: Array,
    aims: Array,
    cruise: float,
    first: Array,
    seen: Array,
    dt: float,
) -> tuple[Array, Array]:
    """Fly one session under feedback.

    Args:
        plant: The simulated vehicle.
        file: The vehicle file of the controller.
        allocation: From a wrench to thrusts, (n, 6).
        gains: Stiffness and damping of heave, roll and pitch, (3, 2); those of the attitude are used.
        inertia: Diagonal of M in the file, (6,).
        aims: Stations of every row (N, 4), or points to be reached in their order (K, 4).
        cruise: Speed between points [m/s]; 0 where aims are stations.
        first: Body state at the start (13,).
        seen: Noise of pose and velocity, (N, 12).
        dt: Sample time [s].

    Returns:
        States at every row (N, 13), NaN after a divergence; and commands (N, n).
    """
    rows, count = seen.shape[0], plant.gains.size
    states, commands = np.full((rows, BODY), np.nan), np.zeros((rows, count))
    y, summed, at = resting(plant, first), np.zeros(3), 0
    for k in range(rows):
        if not np.abs(y).max() < 1e6:
            break
        states[k] = y[:BODY]
        R = turned(y[3:7])
        nu = y[7:BODY] + seen[k, 6:]
        heading = np.arctan2(R[1, 0], R[0, 0]) + seen[k, 5]
        aim = aims[at] if cruise > 0.0 else aims[k]
        away = aim[:3] - (y[:3] + seen[k, :3])
        wrench = np.zeros(6)
        if cruise > 0.0:
            if (away * away).sum() < REACHED**2:
                at = min(at + 1, aims.shape[0] - 1)
            turn = wrapped(np.arctan2(away[1], away[0]) - heading)
            error = np.zeros(3)
            error[2] = away[2]
            wanted = cruise * max(np.cos(turn), 0.0)
            wrench[0] = inertia[0] * POSITION * (wanted - nu[0])
            wrench[0] += file.linear[0, 0] * wanted + file.quadratic[0] * wanted * wanted
        else:
            turn = wrapped(aim[3] - heading)
            error = away
            wrench[0] = -inertia[0] * 2.0 * DAMPING * POSITION * nu[0]
        summed += INTEGRAL * error * dt
        wrench[1] = -inertia[1] * 2.0 * DAMPING * POSITION * nu[1]
        wrench[2] = -inertia[2] * 2.0 * DAMPING * POSITION * nu[2]
        wrench[:3] += inertia[:3] * POSITION**2 * (R.T @ (error + summed))
        wrench[3] = -gains[1, 0] * R[2, 1] - gains[1, 1] * nu[3]
        wrench[4] = gains[2, 0] * R[2, 0] - gains[2, 1] * nu[4]
        wrench[5] = inertia[5] * (HEADING**2 * turn - 2.0 * DAMPING * HEADING * nu[5])
        commands[k] = commanded(file, allocation, wrench)
        y = onward(plant, y, commands, k, dt)
    return states, commands
