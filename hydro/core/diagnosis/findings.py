"""Findings of a diagnosis as records and as a table, and the effects that they add to a vehicle."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import msgspec
import numpy as np
import polars as pl
import polars.selectors as cs

from hydro.core import toml_text
from hydro.core.diagnosis.settings import SURE
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
"""Verdict of one finding.

About an effect: `missing` is confirmed, with a confidence of SURE or more; `suspect` has less.  `retune` is
an effect of the file that needs new values.  `cannot_tell_apart` is one of several effects that another
manoeuvre would separate.  `not_separable` equals existing effects in every recording.  `not_excited` is an
effect that this recording does not show.

About the whole, at most one of three, by the final mean squared residual in units of the noise (FIT):
`nothing_missing` if the model fits and its residual has no structure; `none_of_the_known` if the residual has
structure, near the noise or in addition to findings; `far_from_noise` if the residual is many times the noise
and no effect was found, so that the missing effect is unknown.  `closed_loop` is a warning that accompanies
other findings: the commands react to the motion, and an effect may imitate a disturbance.
"""

Table = tuple[Mapping[str, Any], Mapping[str, Any]]
"""Values of an effect by parameter, and their standard errors in the same form."""
LACKING = ("missing", "cannot_tell_apart")
"""Verdicts on confirmed effects that the file lacks."""
STATED = (*LACKING, "retune")
"""Verdicts of findings that may be confirmed, see `Finding.is_confirmed`."""
UNEXPLAINED = ("none_of_the_known", "far_from_noise")
"""Verdicts on error that no effect explains."""
HEADLINE, PREDICTION = "headline", "prediction"
"""Keys of an artefact for the headline, and for the held-out errors before and after."""
WITH_VALUES = (*STATED, "suspect")
"""Verdicts that have values."""


@dataclass(frozen=True)
class Finding:
    """One line of a diagnosis.

    Attributes:
        verdict: Verdict.
        effect: Effect that explains the error best; empty where no effect is meant.
        members: All effects that the finding may stand for; columns for `log_fault`.
        share: Share of the error beyond the noise that the effect explains.
        low: Lower end of the 95 % interval of the share; NaN without one.
        high: Upper end of that interval.
        confidence: Probability that the name is right, calibrated on the benchmarks; NaN if it is
            not known.
        p_value: Probability of such a gain by chance alone; NaN where nothing was tested.
        parameters: Fitted values of the effect's table.
        standard_errors: Standard errors of these values.
        excited: Whether the recording could have shown the effect.
        advice: Next step for the user.
        support: Evidence behind the confidence: the share of resamples in which this effect is the best, or
            the share of held-out error that it removes; NaN if it is not known.
        error_added: Held-out prediction error with this finding alone added to the file [m/s], see
            `Prediction`; NaN where it was not computed.
        sentence: Values and standard errors in plain words, see `diagnosis.status`; empty without values.
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
    sentence: str = ""

    @classmethod
    def of(
        cls,
        verdict: Verdict,
        effect: str,
        table: Table,
        share: float | tuple[float, float, float] = math.nan,
        **more: Any,
    ) -> Finding:
        """Return a finding with the values of one effect.

        Args:
            verdict: Verdict.
            effect: Name of the effect.
            table: Values and standard errors, as of `Fit.table`.
            share: Share of the error, alone or with the ends of its 95 % interval.
            more: Further attributes; `members` is the effect alone by default.
        """
        middle, low, high = share if isinstance(share, tuple) else (share, math.nan, math.nan)
        shares, (values, errors) = {"share": middle, "low": low, "high": high}, table
        given = {"members": (effect,), "parameters": values, "standard_errors": errors, **shares, **more}
        return cls(verdict, effect, **given)

    @property
    def is_confirmed(self) -> bool:
        """Whether the effect is confirmed, so that `hydro add` adds its values by default.

        New values of an effect of the file need a confidence of SURE, if they have one.
        """
        return self.verdict in STATED and not (self.verdict == "retune" and self.confidence < SURE)

    @property
    def table(self) -> dict[str, Any]:
        """The `[[effect]]` table of the fitted values, without standard errors."""
        return {"name": self.effect, **self.parameters}


@dataclass(frozen=True)
class Prediction:
    """Prediction errors of a file's velocities, before and after findings are added to it.

    Attributes:
        horizon: Prediction horizon [s].
        given: Root mean square error of the file as given, over all axes [m/s].
        added: Held-out error with all confirmed findings added, over all axes [m/s].
        spread: Standard error of the difference, from randomly weighted stretches [m/s].
        floor: Error due to noise alone [m/s]; None where velocity was not measured and the error is that of
            the distance covered.
        axes: Errors of each measured axis by its name: as given, with findings added, and the floor
            [m/s, rad/s].
    """

    horizon: float
    given: float
    added: float
    spread: float
    floor: float | None
    axes: Mapping[str, Sequence[float | None]] = field(default_factory=dict)

    @property
    def falls(self) -> bool:
        """Whether the error with findings, `added`, is below `given` by more than `spread`."""
        return self.given - self.added > self.spread

    @property
    def refuted(self) -> bool:
        """Whether confirmed findings exist, and the error does not fall with them by more than `spread`."""
        return self.added != self.given and not self.falls


def prediction_of(parameters: Mapping[str, Any]) -> Prediction | None:
    """Return the prediction errors in the parameters of a diagnosis; None if it has none.

    Raises:
        DataError: They are not those of `Prediction`.
    """
    if (stored := parameters.get(PREDICTION)) is None:
        return None
    try:
        found = msgspec.convert(stored, Prediction)
    except msgspec.ValidationError as error:
        raise DataError(f"the footer's {PREDICTION}: {error}; diagnose again") from None
    if wrong := [axis for axis, errors in found.axes.items() if len(errors) != 3]:
        raise DataError(f"the footer's {PREDICTION}: {wrong[0]} needs three errors; diagnose again")
    return found


Kind = Literal["fault", "stated", "uncertain", "unexplained", "nothing"]
"""Overall result of a diagnosis.

`fault`: the log or the thrusters contradict the file, and nothing else was examined.  `stated`: effects
are confirmed.  `uncertain`: effects are unconfirmed.  `unexplained`: an error remains that no effect
explains. `nothing`: nothing is missing.
"""


@dataclass(frozen=True)
class Status:
    """Overall result of a diagnosis, in words.

    Attributes:
        kind: Kind of result.
        title: Result in a few words.
        sentences: Confirmed effects, one or two short sentences for each, without standard errors.
    """

    kind: Kind
    title: str
    sentences: tuple[str, ...] = ()

    @property
    def headline(self) -> str:
        """Title and sentences in one line."""
        return f"{self.title}: {' '.join(self.sentences)}" if self.sentences else f"{self.title}."


@dataclass(frozen=True)
class Diagnosis:
    """Result of a diagnosis.

    Attributes:
        findings: Findings, the largest share first.
        vehicle: Vehicle with its existing effects and the findings, all fitted together.
        chi2: Mean squared residual in units of the noise: of the file as given, of the baseline fit, and with
            the findings.  It is 1 for noise alone.
        estimates: All values that were fitted together, with their covariance; None without such a fit.
        question: Open questions for the next experiment, for `experiment.flight.advise`.
        trace: Regime and its selection, with every fitted candidate; None for a log with a fault.
        prediction: Held-out errors before and after; None where no session is long enough, with a hull-force
            model, and for a step of `explain`.
        status: Overall result, see `diagnosis.status`; None before it is written.
    """

    findings: tuple[Finding, ...]
    vehicle: Vehicle
    chi2: tuple[float, float, float]
    estimates: Estimates | None = None
    question: Question | None = None
    trace: tuple[object, object] | None = None
    prediction: Prediction | None = None
    status: Status | None = None

    @property
    def headline(self) -> str:
        """Status in one line; empty before it is written."""
        return self.status.headline if self.status else ""

    @property
    def summary(self) -> dict[str, Any]:
        """Metadata of a diagnosis file: `chi2`, and `prediction` and `headline` if there are any."""
        kept: dict[str, Any] = {"chi2": [round(value, 4) for value in self.chi2]}
        if self.prediction is not None:
            kept[PREDICTION] = asdict(self.prediction)
        return kept | ({HEADLINE: self.headline} if self.headline else {})

    def frame(self) -> pl.DataFrame:
        """Return the diagnosis table: one row per finding, with `rank` from 1 and the finding's attributes.

        Columns of shares begin with `share_`; effect tables are inline TOML.
        """
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
            "sentence": [one.sentence for one in found],
        }
        return pl.DataFrame(columns).with_columns(cs.float().fill_nan(None))


def inline(table: Mapping[str, Any]) -> str:
    """Return an effect's table as inline TOML: `{ v_N = 0.2, v_E = -0.15 }`."""
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


def of_table(diagnosis: pl.DataFrame) -> list[Finding]:
    """Return the rows of a diagnosis table as findings, in the order of their rank.

    Shares and p-values are left out.

    Raises:
        DataError: Values are not inline TOML.
    """
    return [
        Finding(
            row["verdict"],
            row["effect"],
            tuple(row["members"]),
            confidence=math.nan if row["confidence"] is None else row["confidence"],
            parameters=_numbers(row, "parameters"),
            standard_errors=_numbers(row, "standard_errors"),
            advice=row["advice"],
        )
        for row in diagnosis.sort("rank").iter_rows(named=True)
    ]


def _numbers(row: Mapping[str, Any], column: str) -> dict[str, Any]:
    """Return the values or standard errors in a row of a diagnosis table; empty without any."""
    try:
        found: dict[str, Any] = toml_text.value(row[column] or "{}")
    except DataError as error:
        raise DataError(
            f"the values of {row['effect']} are not inline TOML ({error}); run `hydro diagnose` again"
        ) from error
    return found


def tables(diagnosis: pl.DataFrame, effects: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Return the `[[effect]]` tables of a diagnosis' findings, the largest share first.

    Args:
        diagnosis: Diagnosis table.
        effects: Names of the requested findings; by default all confirmed ones.

    Returns:
        Tables with values and `standard_error`.

    Raises:
        DataError: The diagnosis has nothing to add, only unconfirmed effects, or not the requested finding.
    """
    found = {one.effect: one for one in of_table(diagnosis) if one.verdict in WITH_VALUES and one.parameters}
    if not found:
        raise DataError("the diagnosis found nothing to add; see its advice with `hydro show`")
    suspected = suspects(diagnosis)
    wanted = list(effects or (name for name in found if name not in suspected))
    if not wanted:
        raise DataError(by_name(suspected))
    for name in wanted:
        if name not in found:
            raise DataError(_refusal(name, found))
    chosen = [found[name] for name in dict.fromkeys(wanted)]
    return [one.table | {"standard_error": one.standard_errors} for one in chosen]


def suspects(diagnosis: pl.DataFrame) -> dict[str, float]:
    """Return the confidence in each unconfirmed effect of a diagnosis table, by name; NaN if not known."""
    named = [one for one in of_table(diagnosis) if one.verdict in WITH_VALUES]
    return {one.effect: one.confidence for one in named if not one.is_confirmed}


def no_better(
    diagnosis: pl.DataFrame, prediction: Prediction | None, names: Sequence[str], *, alone: bool
) -> str:
    """Return the reason why findings should not be added: they do not lower the held-out prediction error.

    Args:
        diagnosis: Diagnosis table.
        prediction: Prediction errors of the diagnosis; None if they are not known, which gives no reason.
        names: Effects that are to be added.
        alone: Whether the user named the effects.  Then one of them has to lower the error by itself.

    Returns:
        The reason in words; empty without one.
    """
    if prediction is None or "error_added" not in diagnosis.columns:
        return ""
    if alone:
        errors = diagnosis.filter(pl.col("effect").is_in(names))["error_added"].drop_nulls().to_list()
        error = min(errors, default=-math.inf)
        lower = error < prediction.given
    else:
        error, lower = prediction.added, not prediction.refuted
    if lower:
        return ""
    return (
        f"adding {', '.join(names)} does not lower the error {prediction.horizon:g} s ahead of data that it "
        f"was not fitted to: {prediction.given:.3g} m/s before, {error:.3g} m/s after"
    )


def by_name(suspected: Mapping[str, float]) -> str:
    """Return the one-line message that unconfirmed effects are not added by default, and how to add one.

    Args:
        suspected: Confidence of each unconfirmed effect by its name, 0 to 1; NaN if none was stated.
    """
    named = [
        name if math.isnan(sure) else f"{name} (confidence {sure:.0%})" for name, sure in suspected.items()
    ]
    return f"only unconfirmed effects: {', '.join(named)}; to add one nevertheless, name it: `--effect NAME`"


def extended(vehicle: Vehicle, effects: Sequence[Mapping[str, Any]]) -> Vehicle:
    """Return a vehicle whose `[[effect]]` tables are updated by tables of the same name, or extended by them.

    Keys that a new table lacks keep their values; keys with the value None are removed.
    """
    changed = {table["name"]: table for table in effects}
    kept = [{**effect, **changed.pop(effect["name"], {})} for effect in vehicle.effect]
    every = [{k: v for k, v in table.items() if v is not None} for table in [*kept, *changed.values()]]
    return msgspec.structs.replace(vehicle, effect=tuple(every))


def _refusal(name: str, found: Mapping[str, Finding]) -> str:
    """Return the reason why an effect that is none of the findings with values cannot be added."""
    for one in found.values():
        if name in one.members:
            return (
                f"{name} is tied with {one.effect}, whose values the diagnosis holds; for its own, use "
                f"`hydro fit --effect {name}`"
            )
    return f"the diagnosis has no finding {name} to add; it has {', '.join(found)}"
