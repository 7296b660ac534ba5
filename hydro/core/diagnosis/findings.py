"""What a diagnosis says: its verdicts as records and as a table, and what they add to a vehicle."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import msgspec
import numpy as np
import polars as pl
import polars.selectors as cs

from hydro.core import toml_text
from hydro.core.diagnosis.candidates import Candidate
from hydro.core.effects.catalogue import implausible
from hydro.core.errors import DataError
from hydro.core.experiment.flight import Question
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle

Verdict = Literal[
    "log_fault",
    "missing",
    "suspect",
    "retune",
    "cannot_tell_apart",
    "not_separable",
    "not_excited",
    "none_of_the_known",
    "far_from_noise",
    "closed_loop",
    "nothing_missing",
]
"""What is the matter.

Of an effect: `missing` is stated with a confidence of SURE or more, `suspect` with less; `retune` is one that
the file has with other values; `cannot_tell_apart` one of several that another manoeuvre would part,
`not_separable` one that no recording parts from what the file has, `not_excited` one that this recording
could not show.

Of the whole, one at most of three, by the mean squared residual at the end in units of the noise (FIT):
`nothing_missing` where it is a fit and nothing is structured in what is left; `none_of_the_known` where
something is, near the noise, or beside findings that explain their part; `far_from_noise` where the fit
leaves many times the noise and no effect earns any of it, so that no word on what is missing can be had.
`closed_loop` stands beside others: the commands answer to the motion, and a disturbance may be imitated.
"""

SURE = 0.9
"""Confidence from which a name is stated."""
FANCIFUL = 0.5
"""Confidence at most in a name whose values physics does not leave to it: it stands for something else."""
WELL_BEYOND = 2.0
"""How far from the middle of what physics leaves to them such values are where a model fits, in half widths
of that range: where a range ends is known to about as much as that."""
FIT = 3.0
"""Mean squared residual in units of the noise up to which a fit is one."""
STATED = ("missing", "retune", "cannot_tell_apart")
"""Verdicts that are statements about an effect: `hydro add` adds their values unasked."""
UNEXPLAINED = ("none_of_the_known", "far_from_noise")
"""Verdicts that an error remains which no effect explains."""
HEADLINE, PREDICTION = "headline", "prediction"
"""Names in an artefact of the headline, and of the errors before and after."""
WITH_VALUES = (*STATED, "suspect")
"""Verdicts that come with values."""


@dataclass(frozen=True)
class Finding:
    """One line of a diagnosis.

    Attributes:
        verdict: What is the matter.
        effect: The effect that explains it best; empty where none is meant.
        members: All effects that it may be; of `log_fault`, the columns.
        share: Part of the error beyond the noise that it explains, with
        low: the lower and
        high: the upper end of its 95 % interval; NaN where there is none.
        confidence: Probability that the name is right, as far as right and wrong names of the benchmarks
            tell; NaN where none is stated.
        p_value: That chance alone would show as much; NaN where nothing was tested.
        parameters: Fitted values of the effect's table.
        standard_errors: Theirs.
        excited: Whether the recording could have shown it.
        advice: What to do.
        support: What the confidence was made from: the part of the resampled recordings in which this effect
            is the best, or the share of left-out error that it removes; NaN where none is stated.
        error_added: Error of predictions of left-out stretches with this finding alone added to the file
            [m/s], see `Prediction`; NaN where it was not worked out.
    """

    verdict: Verdict
    effect: str = ""
    members: tuple[str, ...] = ()
    share: float = math.nan
    low: float = math.nan
    high: float = math.nan
    confidence: float = math.nan
    p_value: float = math.nan
    parameters: Mapping[str, Any] = field(default_factory=dict)
    standard_errors: Mapping[str, Any] = field(default_factory=dict)
    excited: bool = True
    advice: str = ""
    support: float = math.nan
    error_added: float = math.nan


@dataclass(frozen=True)
class Prediction:
    """How well a file predicts the velocities of a recording, before and after findings are added to it.

    Attributes:
        horizon: How far ahead [s].
        given: Root mean square error of the file as given, all axes together [m/s].
        added: The same with all stated findings added, of stretches that their values were not fitted to.
        spread: Standard error of the difference, by stretches weighed at random [m/s].
        floor: What noise alone leaves [m/s]; None where a velocity is judged by the way that is gone.
        axes: The errors of each measured axis, given, added and floor, by its name [m/s, rad/s].
    """

    horizon: float
    given: float
    added: float
    spread: float
    floor: float | None
    axes: Mapping[str, Sequence[float | None]] = field(default_factory=dict)

    @property
    def falls(self) -> bool:
        """Whether what is stated lowers the error, by more than the standard error of the difference."""
        return self.given - self.added > self.spread


Kind = Literal["fault", "stated", "uncertain", "unexplained", "nothing"]
"""What a diagnosis comes to.

The log or the thrusters contradict the file, so that nothing else was examined; effects are stated; they are
only suspected; an error remains that no effect explains; nothing is missing.
"""


@dataclass(frozen=True)
class Status:
    """What a diagnosis comes to, in words.

    Attributes:
        kind: In one word.
        title: In a few words.
        sentences: What is stated, a sentence or two for each effect.
    """

    kind: Kind
    title: str
    sentences: tuple[str, ...] = ()

    @property
    def headline(self) -> str:
        """All of it in one line."""
        return f"{self.title}: {' '.join(self.sentences)}" if self.sentences else f"{self.title}."


@dataclass(frozen=True)
class Diagnosis:
    """What is missing in a vehicle file.

    Attributes:
        findings: The most telling first.
        vehicle: The vehicle with its own effects fitted anew and what was found, all fitted together.
        chi2: Mean squared residual in units of the noise of the file as given, with its own effects fitted
            anew, and with what was found; 1 where nothing but noise is left.
        estimates: All values that were fitted together, with their covariance; None where none were.
        question: What is left open, for `experiment.flight.advise`.
        candidates: Scores of every candidate effect that was fitted, step by step.
        prediction: How well the file predicts before and after; None where no session is long enough, or a
            recording before has taught the hull.
        status: What it all comes to, see `diagnosis.status`; None of one step of `explain`.
    """

    findings: tuple[Finding, ...]
    vehicle: Vehicle
    chi2: tuple[float, float, float]
    estimates: Estimates | None = None
    question: Question | None = None
    candidates: tuple[Candidate, ...] = ()
    prediction: Prediction | None = None
    status: Status | None = None

    @property
    def headline(self) -> str:
        """Return the status in one line; empty for one step of `explain`."""
        return self.status.headline if self.status else ""

    @property
    def summary(self) -> dict[str, Any]:
        """Return the numbers and the headline that an artefact keeps with the findings."""
        kept: dict[str, Any] = {"chi2": [round(value, 4) for value in self.chi2]}
        if self.prediction is not None:
            kept[PREDICTION] = asdict(self.prediction)
        return kept | ({HEADLINE: self.headline} if self.headline else {})

    def frame(self) -> pl.DataFrame:
        """The diagnosis table, one row per finding; effect tables as inline TOML."""
        found = self.findings
        columns = {
            "rank": range(1, len(found) + 1),
            "verdict": [one.verdict for one in found],
            "effect": [one.effect for one in found],
            "members": [list(one.members) for one in found],
            "share_of_error_explained": [one.share for one in found],
            "share_low": [one.low for one in found],
            "share_high": [one.high for one in found],
            "confidence": [one.confidence for one in found],
            "p_value": [one.p_value for one in found],
            "parameters": [inline(one.parameters) for one in found],
            "standard_errors": [inline(one.standard_errors) for one in found],
            "excited": [one.excited for one in found],
            "error_added": [one.error_added for one in found],
            "advice": [one.advice for one in found],
        }
        return pl.DataFrame(columns).with_columns(cs.float().fill_nan(None))


def inline(table: Mapping[str, Any]) -> str:
    """An effect's table as inline TOML: `{ v_N = 0.2, v_E = -0.15 }`."""
    if not table:
        return ""
    return "{ " + ", ".join(f"{key} = {_value(value)}" for key, value in table.items()) + " }"


def _value(value: Any) -> str:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(inner) for inner in value)}]"
    return repr(float(value))


def tables(diagnosis: pl.DataFrame, effects: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """The `[[effect]]` tables of a diagnosis' findings, the most telling first.

    Args:
        diagnosis: Diagnosis table.
        effects: Names of the findings that are wanted; by default all but suspects.

    Returns:
        Tables with values and `standard_error`.

    Raises:
        DataError: The diagnosis has nothing to add, or nothing but suspects, or not what is wanted.
    """
    rows = diagnosis.sort("rank").filter(pl.col("verdict").is_in(WITH_VALUES) & (pl.col("parameters") != ""))
    found = {row["effect"]: row for row in rows.iter_rows(named=True)}
    if not found:
        raise DataError("the diagnosis found nothing to add; see its advice with `hydro show`")
    suspected = suspects(diagnosis)
    wanted = list(effects or (name for name in found if name not in suspected))
    if not wanted:
        raise DataError(by_name(suspected))
    for name in wanted:
        if name not in found:
            raise DataError(_refusal(name, rows, list(found)))
    return [_table(found[name]) for name in dict.fromkeys(wanted)]


def suspects(diagnosis: pl.DataFrame) -> dict[str, float]:
    """Confidence in each effect that a diagnosis only suspects, by its name; NaN where none was stated."""
    rows = diagnosis.sort("rank").filter(verdict="suspect")
    pairs = rows.select("effect", pl.col("confidence").fill_null(math.nan)).rows()
    return dict(pairs)


def by_name(suspected: Mapping[str, float]) -> str:
    """That suspects are not added unasked, and how one is, in a line."""
    named = [
        name if math.isnan(sure) else f"{name} (confidence {sure:.0%})" for name, sure in suspected.items()
    ]
    return f"only suspected: {', '.join(named)}; to add one all the same, name it with `--effect NAME`"


def extended(vehicle: Vehicle, effects: Sequence[Mapping[str, Any]]) -> Vehicle:
    """The vehicle with these `[[effect]]` tables in the place of those of the same name, or after them.

    Keys that a table does not have stay as they are; those that are None go.
    """
    changed = {table["name"]: table for table in effects}
    kept = [{**effect, **changed.pop(effect["name"], {})} for effect in vehicle.effect]
    every = [{k: v for k, v in table.items() if v is not None} for table in [*kept, *changed.values()]]
    return msgspec.structs.replace(vehicle, effect=tuple(every))


def _table(row: dict[str, Any]) -> dict[str, Any]:
    """One finding as a table."""
    try:
        values: dict[str, Any] = toml_text.value(row["parameters"])
        errors: dict[str, Any] = toml_text.value(row["standard_errors"] or "{}")
    except DataError as error:
        raise DataError(
            f"the values of {row['effect']} are not inline TOML ({error}); run `hydro diagnose` again"
        ) from error
    return {"name": row["effect"]} | values | {"standard_error": errors}


def _refusal(name: str, rows: pl.DataFrame, found: Sequence[str]) -> str:
    """Why an effect cannot be added."""
    for row in rows.iter_rows(named=True):
        if name in row["members"]:
            return (
                f"{name} is tied with {row['effect']}, whose values the diagnosis holds; for its own, use "
                f"`hydro fit --effect {name}`"
            )
    return f"the diagnosis has no finding {name} to add; it has {', '.join(found)}"


def no_surer(
    confidence: float, vehicle: Vehicle, effect: str, errors: Mapping[str, Any] | None = None
) -> float:
    """Confidence in a name, FANCIFUL at most where physics does not leave its values to it.

    Args:
        confidence: Of the name.
        vehicle: With the values.
        effect: The name.
        errors: Where a model fits, standard errors of the values: then these have to lie WELL_BEYOND.
    """
    beyond = implausible(vehicle, [effect], errors, 1.0 if errors is None else WELL_BEYOND)
    return min(confidence, FANCIFUL) if beyond else confidence


def with_implausible(finding: Finding, vehicle: Vehicle) -> Finding:
    """The finding with a word in its advice on values that lie beyond what physics leaves to them.

    Args:
        finding: It, with or without values.
        vehicle: The vehicle that they are for.
    """
    if not finding.parameters:
        return finding
    table = {"name": finding.effect, **finding.parameters}
    beyond = implausible(msgspec.structs.replace(vehicle, effect=(table,)))
    return replace(finding, advice="; ".join([finding.advice, *beyond]))
