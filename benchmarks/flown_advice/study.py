"""Study of one advised flight: an ambiguous recording, the flight that its diagnosis advises, and both."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from benchmarks.flown_advice import cases
from benchmarks.hidden_effects import vehicles
from benchmarks.imperfect_logs.study import clean
from hydro.core.diagnosis.findings import Diagnosis
from hydro.core.diagnosis.pipeline import diagnose
from hydro.core.diagnosis.settings import SURE
from hydro.core.experiment.flight import Limits, advise

LIMITS = Limits(depth=(5.0, 25.0), space=30.0, thrust=1.0, seconds=120.0)
"""Limits of the advised flight; a random flight may exceed depth and space."""
WORDS = ("missing", "suspect", "cannot_tell_apart", "retune")
TOLD: dict[str, Any] = {"outcome": pl.String, "confidence": pl.Float64, "findings": pl.String}
SCHEMA: dict[str, Any] = {
    "seed": pl.Int64,
    "seconds": pl.Float64,
    "family": pl.String,
    "preset": pl.String,
    "effect": pl.String,
    "truth": pl.String,
    **{f"first_{key}": kind for key, kind in TOLD.items()},
    "open": pl.String,
    "rivals": pl.List(pl.String),
    "sessions": pl.List(pl.String),
    "expected": pl.Float64,
    "inside": pl.Boolean,
    **{f"advised_{key}": kind for key, kind in TOLD.items()},
    **{f"random_{key}": kind for key, kind in TOLD.items()},
    "cpu": pl.Float64,
    "failure": pl.String,
}
"""Columns of a results file.

An outcome is `named` (the truth first, alone), `tied` (the truth among those of the first finding), `wrong:
NAME` or `nothing`.  `open` is `rivals` if the first diagnosis has the truth among the rivals of an open
question, `unseen` if it states that the recording does not show it, else empty.  `expected` is the smallest
expected distance between rivals.  `inside` states whether the vehicle with its hidden effect kept to the
limits.
"""


def outcome(found: Diagnosis, effect: str, misjudged: Sequence[str] = ()) -> dict[str, Any]:
    """Compare a diagnosis with the truth.

    Args:
        found: The diagnosis.
        effect: Name of the hidden effect.
        misjudged: Effects whose values are wrong in the file by design; their re-estimates are ignored.

    Returns:
        `outcome`: `named`, `tied`, `wrong: EFFECT` or `nothing`; `confidence` of the first finding; and
        `findings` in words.
    """
    named = (one for one in found.findings if one.verdict in WORDS and math.isfinite(one.confidence))
    told = [one for one in named if not (one.verdict == "retune" and one.effect in misjudged)]
    said = [f"{one.verdict} {'/'.join(one.members)} {one.confidence:.2f}" for one in told]
    words, sure = "nothing", None
    if told:
        first, sure = told[0], told[0].confidence
        if first.effect == effect and first.verdict != "cannot_tell_apart":
            words = "named"
        elif effect in first.members:
            words = "tied"
        else:
            words = f"wrong: {first.effect}"
    return {"outcome": words, "confidence": sure, "findings": "; ".join(said)}


def run(seed: int, seconds: float) -> dict[str, Any]:
    """Return the row of one study; errors are in `failure`."""
    row: dict[str, Any] = dict.fromkeys(SCHEMA) | {"seed": seed, "seconds": seconds, "failure": ""}
    began = time.process_time()
    try:
        _study(row)
    except Exception as error:  # a failed study is a result; the others continue
        row["failure"] = f"{type(error).__name__}: {error}"
    row["cpu"] = time.process_time() - began
    return row


def _stated(row: dict[str, Any]) -> bool:
    """Return whether the first diagnosis confirms the true effect."""
    return bool(row["first_outcome"] == "named" and row["first_confidence"] >= SURE)


def _study(row: dict[str, Any]) -> None:
    """Run one study; complete its row up to the last step that is possible."""
    seed = row["seed"]
    case, family = cases.draw(seed)
    effect = case.called[0]
    row |= {"family": family, "preset": case.preset, "effect": effect}
    actual = vehicles.preset(case.preset)
    given = vehicles.misjudged(actual, np.random.default_rng([seed, 11]))
    case, _ = clean(case, row["seconds"])
    sea, first = cases.first_recording(case, given, actual, family, row["seconds"])
    row["truth"] = json.dumps(sea.case.hidden)
    found, misjudged = diagnose(given, first), vehicles.damping_of(actual)
    row |= {f"first_{key}": value for key, value in outcome(found, effect, misjudged).items()}
    row["open"] = ""
    if found.question is None:  # no model fits, so a flight has nothing to separate
        return
    ties = [[one.name for one in tie] for tie in found.question.ties]
    row["rivals"] = ["/".join(tie) for tie in ties]
    if any(effect in tie for tie in ties) and not _stated(row):
        row["open"] = "rivals"
    elif not ties and effect in found.question.hidden:
        row["open"] = "unseen"
    if not row["open"]:
        return
    flight = advise(found.question, LIMITS)
    row["sessions"] = [one.name for one in flight.sessions]
    row["expected"] = min(flight.distances.values(), default=None)
    flown = sea.fly("advised", [one.commands for one in flight.sessions], flight.start)
    away = np.hypot(flown["x"] - flight.start[0], flown["y"] - flight.start[1])
    kept = flown["z"].is_between(*LIMITS.depth).all() and float(away.max()) <= LIMITS.space
    row["inside"] = bool(kept)
    both = outcome(diagnose(given, pl.concat([first, flown])), effect, misjudged)
    row |= {f"advised_{key}": value for key, value in both.items()}
    length = sum(one.seconds for one in flight.sessions)
    walks = sea.fly("random", cases.randomly(given, length, seed), flight.start)
    both = outcome(diagnose(given, pl.concat([first, walks])), effect, misjudged)
    row |= {f"random_{key}": value for key, value in both.items()}
