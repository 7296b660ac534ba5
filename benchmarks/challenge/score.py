"""Score of an answer: the name, its values, the held-out error and the confidence.

The scorer needs no part of hydro.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from benchmarks.challenge.layout import VELOCITY, Given
from hydro.core.interval import NORMAL_95

SURE = 0.9
"""Minimum confidence of a statement.  An effect without a confidence counts as one."""
FURTHEST = 100.0
"""Greatest error that counts [m/s, rad/s]; a missing or diverged prediction has it."""


@dataclass(frozen=True)
class Score:
    """Score of one answer.

    Attributes:
        case: Name of the case.
        simulator: Simulator of the case.
        changed: Whether an effect is hidden.
        first: Whether the first name is right; None if nothing is hidden, or if the name is an alias.
        alarm: Whether an effect is named although none is hidden; None if one is hidden.
        brier: Squared difference of the first confidence and the outcome; None without a name.
        within: Whether each affected value of a right first name is within its 95 % interval.
        error: Held-out error [m/s].
        seconds: Processor time [s].
    """

    case: str
    simulator: str
    changed: bool
    first: bool | None
    alarm: bool | None
    brier: float | None
    within: tuple[bool, ...]
    error: float
    seconds: float


def scored(truth: Mapping[str, Any], motion: pl.DataFrame, given: Given) -> Score:
    """Return the score of an answer.

    Args:
        truth: Truth of the case.
        motion: Sealed motion of the case.
        given: The answer.
    """
    changed = bool(truth["called"])
    named = [one for one in given.effects if one.get("name")]
    best = named[0] if named else {}
    right = best.get("name") in truth["called"]
    neither = not right and best.get("name") in truth["alias"]
    confidence = float(best.get("confidence", 1.0))
    sure = any(float(one.get("confidence", 1.0)) >= SURE for one in named)
    return Score(
        truth["case"],
        truth["simulator"],
        changed,
        None if not changed or neither else right,
        None if changed else sure,
        None if not named or neither else (confidence - right) ** 2,
        tuple(within(truth, best)) if right else (),
        error(truth, motion, given.prediction),
        given.seconds,
    )


def within(truth: Mapping[str, Any], named: Mapping[str, Any]) -> list[bool]:
    """Return whether each affected value of a named effect is within its interval.

    Values without a standard error, and effects without true values, are left out.
    """
    effect = named["name"]
    true, before = truth["values"].get(effect, {}), truth["given"].get(effect, {})
    values, errors = named.get("parameters") or {}, named.get("standard_errors") or {}
    found = []
    for key, real in true.items():
        if key not in values or key not in errors or isinstance(real, str):
            continue
        parts = [np.ravel(np.asarray(one, float)) for one in (real, values[key], errors[key])]
        if len({part.size for part in parts}) > 1:
            continue
        old = np.ravel(np.asarray(before.get(key, np.zeros(parts[0].size)), float))
        affected = parts[0] != (old if old.size == parts[0].size else 0.0)
        for i in np.flatnonzero(affected & (parts[2] > 0.0)):
            found.append(bool(abs(parts[1][i] - parts[0][i]) <= NORMAL_95 * parts[2][i]))
    return found


def error(truth: Mapping[str, Any], motion: pl.DataFrame, prediction: pl.DataFrame) -> float:
    """Return the root mean square error of predicted velocities [m/s].

    Errors of rates count with the vehicle's radii of gyration.
    """
    keys = ["session", pl.col("t").round(3).alias("t")]
    wanted = motion.select(*keys, *VELOCITY)
    there = prediction.select(*keys, *(pl.col(name).alias(f"{name}_p") for name in VELOCITY))
    both = wanted.join(there, on=["session", "t"], how="left")
    real = both.select(VELOCITY).to_numpy().astype(float)
    told = both.select([f"{name}_p" for name in VELOCITY]).to_numpy().astype(float)
    off = np.clip(np.nan_to_num(told - real, nan=FURTHEST), -FURTHEST, FURTHEST)
    weight = np.concatenate([np.ones(3), np.asarray(truth["gyradius"], float)])
    return float(np.sqrt(((off * weight) ** 2).sum(axis=1).mean()))


def shares(scores: Sequence[Score]) -> dict[str, list[bool]]:
    """Return the outcomes of all answers, by measure, of which the leaderboard shows shares."""
    return {
        "named first": [one.first for one in scores if one.first is not None],
        "false alarms": [one.alarm for one in scores if one.alarm is not None],
        "values within 95 %": [fact for one in scores for fact in one.within],
    }
