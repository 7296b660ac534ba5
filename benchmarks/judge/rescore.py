"""Repetition of the decisions of kept diagnoses with other constants, without flights or fits.

The decision functions are those of the diagnosis itself (`core.diagnosis`), called on kept candidates.
Some decisions cannot be repeated: steps after one that would now take another candidate, effects that were
never fitted, comparisons by longer predictions (`diagnosis.held_out`), and the choice of the regime.  Those
are left out.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import polars as pl

from benchmarks.judge.rows import KEY
from benchmarks.judge.scores import Score, score
from hydro.core.diagnosis import by_change, by_evidence, confidence, contenders, doubts, settings, transfer
from hydro.core.diagnosis.by_change import Change
from hydro.core.diagnosis.contenders import Contender
from hydro.core.diagnosis.model import penalty

Row = dict[str, Any]
CONSTANTS = (
    "settings.RIGHT_ABOVE",
    "settings.NEGLIGIBLE",
    "settings.FURTHER",
    "settings.ABSORBED",
    "settings.VISIBLE",
    "settings.RIGHT",
    "settings.FIT",
    "settings.CHANGED",
    "settings.MATERIAL",
    "settings.NEARLY_EQUAL",
    "settings.DOUBTFUL",
    "settings.LEAST_EVIDENCE",
    "settings.SURE",
)
"""Constants that decisions on kept candidates use."""
RIGHT_ABOVE = settings.RIGHT_ABOVE
"""Factor of kept confidences where no model was right; a smaller factor has another cause."""
ROUNDING = 1e-6
"""Difference of confidences that kept digits cause."""
MODULES = (settings, by_change, by_evidence, confidence, contenders, doubts, transfer)
"""Modules that read these constants, each under the same name."""


def parsed(texts: Sequence[str]) -> dict[str, float]:
    """Return `settings.CONSTANT=VALUE` texts as numbers.

    Raises:
        SystemExit: A constant is unknown, or a value is not a number.
    """
    found = dict[str, float]()
    for one in texts:
        name, _, value = one.partition("=")
        if name not in CONSTANTS:
            raise SystemExit(
                f"--rescore {name}: not a constant of a kept decision; those are {', '.join(CONSTANTS)}"
            )
        try:
            found[name] = float(value)
        except ValueError:
            raise SystemExit(f"--rescore {one}: {value!r} is not a number") from None
    return found


def rescored(table: pl.DataFrame, values: Mapping[str, float]) -> list[Score]:
    """Return the scores of kept studies, decided again with the constants `values` changed."""
    with changed(values):
        return [score(decided(part.to_dicts())) for _, part in table.group_by(KEY, maintain_order=True)]


@contextlib.contextmanager
def changed(values: Mapping[str, float]) -> Iterator[None]:
    """Set constants in `settings` and in the modules that import them, and restore them after the block."""
    names = {name.removeprefix("settings."): value for name, value in values.items()}
    kept = [(each, name, vars(each)[name]) for each in MODULES for name in names if name in vars(each)]
    try:
        for each, name, _ in kept:
            setattr(each, name, names[name])
        yield
    finally:
        for each, name, value in kept:
            setattr(each, name, value)


def agreement(stated: Sequence[Score], again: Sequence[Score]) -> str:
    """Return in words how many studies have the same first name from candidates as from the diagnosis."""
    fine = [(a, b) for a, b in zip(stated, again, strict=True) if not a.failed]
    same = sum(_first(a) == _first(b) for a, b in fine)
    both = [(a.named[0], b.named[0]) for a, b in fine if a.named and b.named and _first(a) == _first(b)]
    drift = [abs(one.confidence - other.confidence) for one, other in both] or [0.0]
    return (
        f"By kept candidates and unchanged constants {same} of {len(fine)} studies have the same first name; "
        f"confidences differ by {max(drift):.2f} at most, {np.median(drift):.3f} in the median.\n"
    )


def _first(one: Score) -> frozenset[str] | None:
    """Return the first name of a study."""
    return one.named[0].members if one.named else None


def decided(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of a study with the findings that its candidates give under the present constants."""
    tried = [row for row in rows if row["role"] == "candidate"]
    engine = tried[0]["engine"] if tried else None
    if engine == "likelihood":
        names = _discounted(rows, dict(_by_likelihood(tried)))
    elif engine == "change":
        names = dict(_by_change(tried))
    elif engine == "transfer":
        names = dict(_by_transfer(tried, {row["effect"] for row in rows if row["role"] == "finding"}))
    else:
        return list(rows)
    return [*_renamed(rows, _limited(rows, names)), *tried] or list(rows)


def _discounted(rows: Sequence[Row], names: Mapping[str, float]) -> dict[str, float]:
    """Return the confidences of a search by likelihood, lowered as the diagnosis lowers them.

    Feedback and unexplained error lower a confidence by a factor that candidates do not show.  The factor is
    the ratio of a finding's confidence to the support that it was computed from.

    Args:
        rows: Rows of a study.
        names: Confidence of each name.
    """
    told = [row for row in rows if row["role"] == "finding" and row["support"]]
    part = {
        row["effect"]: row["confidence"] / row["support"] for row in told if row["confidence"] is not None
    }
    lowered = {name: one for name, one in part.items() if one < RIGHT_ABOVE - ROUNDING}
    return {name: sure * lowered.get(name, 1.0) for name, sure in names.items()}


def _limited(rows: Sequence[Row], names: Mapping[str, float]) -> dict[str, float]:
    """Return the confidences, at most DOUBTFUL for names whose values physics excludes.

    A kept candidate tells whether its values lie in their range.  Where a model fits, the diagnosis limits
    the confidence only beyond the range and several standard errors.  So a name that it gave more confidence
    is not limited.

    Args:
        rows: Rows of a study.
        names: Confidence of each name.
    """
    told = {row["effect"]: row["confidence"] or 0.0 for row in rows if row["role"] == "finding"}
    beyond = {row["effect"] for row in rows if row["role"] == "candidate" and not row["plausible"]}
    within = [name for name in names if name not in beyond or told.get(name, 0.0) > settings.DOUBTFUL]
    return {name: sure if name in within else min(sure, settings.DOUBTFUL) for name, sure in names.items()}


def _renamed(rows: Sequence[Row], names: Mapping[str, float]) -> Iterator[Row]:
    """Yield the findings of a study with new names and confidences, in the order of the diagnosis.

    New names take the places of names that are no longer found.
    """
    told = [row for row in rows if row["role"] == "finding"]
    old = {row["effect"]: row for row in told}
    searched = {row["effect"] for row in rows if row["role"] == "candidate"}
    new = [name for name in names if name not in old]
    for row in told:
        if row["effect"] in names:
            yield _with_confidence(row, names[row["effect"]])
        elif row["effect"] not in searched or row["confidence"] is None:
            yield row
        elif new:
            yield _added(rows, new[0], names[new.pop(0)])
    for name in new:
        yield _added(rows, name, names[name])


def _added(rows: Sequence[Row], name: str, sure: float) -> Row:
    """Return a finding's row for a name that the diagnosis did not find, with confidence `sure`."""
    plain = {"role": "finding", "verdict": "missing", "effect": name, "members": [name]}
    return _with_confidence(dict(rows[0]) | plain | {"off": None, "affected": None}, sure)


def _with_confidence(row: Row, sure: float) -> Row:
    """Return a finding's row with confidence `sure`, and confirmed or not accordingly."""
    verdict = row["verdict"]
    if verdict in ("missing", "suspect"):
        verdict = "missing" if sure >= settings.SURE else "suspect"
    return row | {"verdict": verdict, "confidence": sure}


def _steps(tried: Sequence[Row]) -> Iterator[tuple[Row, list[Row]]]:
    """Yield for each step of a search the row of the model alone, and the rows of its candidates."""
    for step in sorted({row["step"] for row in tried}):
        here = [row for row in tried if row["step"] == step]
        yield next(row for row in here if not row["effect"]), [row for row in here if row["effect"]]


def _penalised(row: Row) -> np.ndarray:
    """Return the penalised cost of each kept block, as in `Model.penalised` for each shot."""
    blocks = np.array(row["costs"], float)
    return np.asarray(blocks + penalty(row["shots"], row["entries"], row["chi2"]) / len(blocks))


def _by_likelihood(tried: Sequence[Row]) -> Iterator[tuple[str, float]]:
    """Yield names and confidences of a search by likelihood."""
    steps = list(_steps(tried))
    left = next(row["chi2"] for row, _ in steps[::-1])
    for _, rivals in steps:
        if not rivals:
            return
        costs = {row["effect"]: _penalised(row) for row in rivals}
        best = min(rivals, key=lambda row: costs[row["effect"]].sum())
        frequency = confidence.wins(costs, 1)[best["effect"]]
        sure = confidence.by_likelihood_confidence(frequency, left <= settings.RIGHT)
        yield best["effect"], sure
        if not best["chosen"]:
            return


def _by_change(tried: Sequence[Row]) -> Iterator[tuple[str, float]]:
    """Yield names and confidences of a search for changes with a hull-force model."""
    found: list[Change] = []
    steps = list(_steps(tried))
    given = steps[0][0]["chi2"] if steps else math.nan
    for without, rows in steps:
        rivals = {row["effect"]: _contender(row) for row in rows}
        if not rivals:
            break
        change = Change(
            next(iter(rivals.values())), rivals, np.array(without["costs"], float), without["residuals"]
        )
        best = min(rivals.values(), key=change.penalised)
        change = Change(best, rivals, change.whole, change.floor)
        if not change.seen(further=bool(found)):
            break
        row = next(each for each in rows if each["effect"] == best.effect)
        found.append(change)
        yield change.best.effect, change.confidence(given)
        if not row["chosen"]:
            break


def _contender(row: Row) -> Contender:
    """Return a kept candidate as the engine's record, with the same number of values and costs by block."""
    model = cast(Any, SimpleNamespace(values=np.zeros(row["entries"])))
    return Contender(row["effect"], model, np.array(row["costs"], float))


def _by_transfer(tried: Sequence[Row], named: set[str]) -> Iterator[tuple[str, float]]:
    """Yield the name and confidence of a search by held-out error or by evidence.

    Candidates that the diagnosis passed over for their values are passed over again.
    """
    chosen = next((row for row in tried if row["chosen"]), None)
    if chosen is None:
        return
    leaders = tried[: tried.index(chosen)]
    passed = {row["effect"] for row in leaders if not row["plausible"] and _transfers(row)}
    by_evidence = any(row["evidence"] is not None for row in tried)
    rest = [row for row in tried if row["effect"] not in passed and row is not chosen]
    if not _transfers(chosen):
        return
    if by_evidence:
        gap = {row["effect"]: settings.LEAST_EVIDENCE for row in tried if _hull_law(row)}
        lead = chosen["evidence"] - gap.get(chosen["effect"], 0.0)
        sure = confidence.by_evidence_confidence(lead, [row["evidence"] or 0.0 for row in rest])
    else:
        sure = confidence.by_transfer_confidence(chosen["left_out"], [row["left_out"] or 0.0 for row in rest])
    if leaders or chosen["own"]:
        sure = min(sure, settings.DOUBTFUL)
    yield chosen["effect"], sure


def _transfers(row: Row) -> bool:
    """Return whether an effect removes enough held-out error to be named."""
    return (row["left_out"] or 0.0) >= settings.MATERIAL


def _hull_law(row: Row) -> bool:
    """Return whether a candidate is a law of the hull force itself, whose evidence was discounted."""
    return row["evidence"] is not None and row["lead"] is not None and row["evidence"] != row["lead"]
