"""Evaluation of a policy without exploration: outcome, time, energy and path of episodes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.guidance import Guidance
from hydro.rl.environment.interfaces import Step
from hydro.rl.training.pilots import Actor, WithMap

POLICY = "policy"
"""Label of the policy in the column `flown_by`; pilots have their own names."""

OUTCOMES = ("success", "collision", "diverged", "time")  # values of the column `outcome`
CONFIDENCE = 0.95  # of the intervals of shares
POSITION = ("x", "y", "z")
RARE = ("tracking_error", "alternating")
"""Columns that are null for some flights."""


def fly(actor: Actor, fleet: Fleet, spare: int | None = None, *, paths: bool = True) -> pl.DataFrame:
    """Fly one episode with every vehicle of a fleet, and return the results as a table.

    Args:
        actor: Policy or pilot.
        fleet: One vehicle per episode, with task and level set, that has not flown yet.
        spare: Number of failures allowed; the next failure stops all flights, and unfinished episodes are
            then dropped.  None flies all episodes to their ends.
        paths: Whether to plan the paths of tasks that arrive, for their tracking errors; this takes longer
            than the flights.  The path of a course is the line through its waypoints.  If some episodes are
            unfinished, there are no tracking errors either.

    Returns:
        A table of kind `episodes`, one row per finished episode: `task`, `level`, outcome and totals,
        `tracking_error` [m], `alternating`, and the positions of `start` and `goal`.
    """
    observations = fleet.reset()
    starts, goals, pillars = fleet.starts.copy(), fleet.goals.copy(), fleet.pillars.copy()
    courses = fleet.courses
    places, failed = [fleet.plant.pose[:, :3].copy()], 0
    flying, lengths, errors = (
        np.ones(fleet.count, np.bool_),
        np.zeros(fleet.count, int),
        np.zeros(fleet.count),
    )
    rows: dict[int, dict[str, Any]] = {}
    while flying.any() and (spare is None or failed <= spare):
        step = fleet.step(actor(observations), renew=False, flying=flying)
        observations = step.obs
        places.append(fleet.plant.pose[:, :3].copy())
        for k in map(int, np.flatnonzero(flying & (step.terminated | step.truncated))):
            rows[k] = _episode_row(step, k, fleet.settings.period)
            failed += rows[k]["outcome"] != OUTCOMES[0]
            flying[k], lengths[k], errors[k] = False, step.info.episode_length[k], step.info.episode_error[k]
    ended, flown = sorted(rows), np.array(places)
    if fleet.task.ends(fleet.settings).settling < 0.0:
        errors[:] = np.nan
        if paths and not flying.any():
            chart = Guidance(fleet.settings, fleet.count)
            if courses is None:
                chart.reset(np.ones(fleet.count, np.bool_), starts, goals, pillars)
            else:
                chart.ways = courses
            errors[:] = _path_errors(chart, flown, lengths)
    frame = pl.DataFrame([{"task": fleet.task.name, "level": fleet.level} | rows[k] for k in ended])
    weaved = [alternating(flown[: lengths[k], k], pillars[k]) for k in ended]
    columns: dict[str, Any] = {"tracking_error": errors[ended], "alternating": weaved}
    columns |= {f"start_{axis}": starts[ended, i] for i, axis in enumerate(POSITION)}
    columns |= {f"goal_{axis}": goals[ended, i] for i, axis in enumerate(POSITION)}
    return frame.with_columns(
        pl.Series(name, values, pl.Float64, nan_to_null=True) for name, values in columns.items()
    )


def _path_errors(chart: Guidance, flown: Array, lengths: NDArray[np.int64]) -> Array:
    """Return root mean square distances of flights from their paths (N,) [m].

    Args:
        chart: Paths, from their beginning.
        flown: Positions after every step (K + 1, N, 3), the starts first.
        lengths: Number of steps of every flight (N,); the last step, which ends it, does not count.
    """
    every = np.ones(len(lengths), dtype=np.bool_)
    squares = np.zeros(len(lengths))
    for k in range(1, len(flown)):
        chart.targets(every, flown[k])
        squares += np.where(k < lengths, chart.off, 0.0) ** 2
    return np.sqrt(squares / np.maximum(lengths - 1, 1))


def alternating(way: Array, pillars: Array) -> float | None:
    """Return the fraction of passed obstacles that were passed on the other side than the obstacle before.

    Pillars with the same north coordinate are one obstacle, a baffle.  The nearest of them decides the side.

    Args:
        way: Positions along a flight (K, 3), NED [m].
        pillars: North and east of the pillars' axes (P, 2) [m], NaN in unused rows.

    Returns:
        1 for a flight that weaves through all obstacles, 0 for a flight around them all; None if fewer than
        two are passed.
    """
    standing = pillars[np.isfinite(pillars).all(axis=1)]
    sides = []
    for north in np.unique(standing[:, 0]):
        ahead = way[:, 0] > north
        crossed = np.flatnonzero(ahead[1:] != ahead[:-1])
        if len(crossed):
            here, easts = way[crossed[-1], 1], standing[standing[:, 0] == north, 1]
            sides.append(here > easts[np.argmin(np.abs(easts - here))])
    return float(np.mean(np.diff(sides))) if len(sides) > 1 else None


class Flight(NamedTuple):
    """Recorded flight of one episode.

    Attributes:
        t: Times (K,) [s].
        pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED, (K, 7).
        targets: Targets shown to the actor (K, 3), NED [m].
        goal: (3,), NED [m].
        pillars: Axes of the pillars (P, 2), NED [m].
        way: Corners of the planned path, or the trajectory to follow (W, 3), NED [m]; empty without either.
        outcome: One of `OUTCOMES`.
    """

    t: Array
    pose: Array
    targets: Array
    goal: Array
    pillars: Array
    way: Array
    outcome: str


def trace(actor: Actor, fleet: Fleet) -> Flight:
    """Fly one episode with one vehicle, and return the recorded flight.

    Args:
        actor: Policy or pilot.
        fleet: Fleet of one vehicle that has not flown yet.
    """
    observations = fleet.reset()
    goal, pillars = fleet.goals[0].copy(), fleet.pillars[0]
    standing = pillars[np.isfinite(pillars).all(axis=1)].copy()
    way = np.empty((0, 3))
    if fleet.led or isinstance(actor, WithMap):
        chart = Guidance(fleet.settings, 1)
        chart.reset(np.ones(1, dtype=np.bool_), fleet.starts, fleet.goals, fleet.pillars)
        way = chart.ways[0].copy()
    poses, targets, goals = [fleet.plant.pose[0].copy()], [fleet.targets[0].copy()], [goal]
    while True:
        step = fleet.step(actor(observations))
        observations = step.obs
        if (step.terminated | step.truncated)[0]:
            break
        poses.append(fleet.plant.pose[0].copy())
        targets.append(fleet.targets[0].copy())
        goals.append(fleet.goals[0].copy())
    t: Array = fleet.settings.period * np.arange(len(poses), dtype=np.float64)
    outcome = _episode_row(step, 0, fleet.settings.period)["outcome"]
    if len(way) == 0 and (goals[0] != goals[-1]).any():
        way = np.array(goals)
    return Flight(t, np.array(poses), np.array(targets), goal, standing, way, outcome)


def _episode_row(step: Step, k: int, period: float) -> dict[str, Any]:
    """Return the row of one episode at its last step."""
    info = step.info
    outcome = next((name for name in OUTCOMES[:-1] if getattr(info, name)[k]), OUTCOMES[-1])
    return {
        "episode": k,
        "outcome": outcome,
        "duration": float(info.episode_length[k]) * period,
        "distance": float(info.distance[k]),
        "reward": float(info.episode_return[k]),
        "energy": float(info.episode_energy[k]),
        "overspeed": float(info.episode_overspeed[k]) * period,
    }


def summary(episodes: pl.DataFrame) -> dict[str, Any]:
    """Return the results of the test flights of a policy as a dict.

    Args:
        episodes: Table of `fly`, one row per episode.

    Returns:
        `episodes`, their number; `success`, the share that reached the goal, with the ends `success_low` and
        `success_high` of its 95 % interval (Wilson); shares of `collision` and
        `diverged`; means of `reward`, `energy` and `overspeed`.  `time_to_goal`: median of the successful
        episodes, or None.  `tracking_error`: root mean square over episodes.  `alternating`: mean, or None
        without obstacles.
    """
    count = episodes.height
    arrived = episodes.filter(pl.col("outcome") == "success")
    low, high = interval(arrived.height, count)
    return {
        "episodes": count,
        "success": arrived.height / count,
        "success_low": low,
        "success_high": high,
        **{name: episodes["outcome"].eq(name).mean() for name in ("collision", "diverged")},
        "time_to_goal": arrived["duration"].median(),
        **{name: episodes[name].mean() for name in ("reward", "energy", "overspeed")},
        "tracking_error": episodes.select(pl.col("tracking_error").pow(2).mean().sqrt()).item(),
        "alternating": episodes["alternating"].mean(),
    }


def interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the low and the high end of Wilson's 95 % confidence interval of a probability of success.

    Args:
        successes: Number of successes.
        trials: Number of trials.
    """
    found = scipy.stats.binomtest(successes, trials).proportion_ci(CONFIDENCE, method="wilson")
    return float(found.low), float(found.high)
