"""Overall result of a diagnosis as one headline, consistent with all findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro.core.diagnosis.findings import STATED, UNEXPLAINED, Diagnosis, Finding, Prediction, Status
from hydro.core.diagnosis.settings import LIKELY, MOST_STATED, RIGHT, SURE
from hydro.core.effects.phrases import UNCLEAR, UNDETERMINED
from hydro.core.effects.sentences import sentence
from hydro.core.residual.hull import Hull
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Reference:
    """Vehicle with whose values the sentences of findings compare the fitted values.

    Attributes:
        vehicle: Vehicle.
        dt: Sample time of the recording [s].
        earlier: Whether the vehicle was fitted to an earlier recording, so that its values are the earlier
            ones; otherwise they are those of the file.
    """

    vehicle: Vehicle
    dt: float
    earlier: bool = False

    @classmethod
    def of(cls, vehicle: Vehicle, dt: float, hull: Hull | None) -> Reference:
        """Return a vehicle file, or the one fitted to the earlier recording if that was far from the file.

        Args:
            vehicle: Vehicle file.
            dt: Sample time of the recording [s].
            hull: Hull-force model from an earlier recording; None without one.
        """
        if hull is None or hull.completion is None:
            return cls(vehicle, dt)
        return cls(hull.completed(vehicle), dt, earlier=True)

    def sentence(
        self, effect: str, values: Mapping[str, Any], errors: Mapping[str, Any], *, brief: bool = False
    ) -> str:
        """Return a sentence with the values of an effect and their standard errors.

        Args:
            effect: Name of the effect.
            values: Fitted values.
            errors: Their standard errors.
            brief: Whether the sentence is for a headline, without standard errors.
        """
        return sentence(self.vehicle, effect, values, errors, self.dt, brief=brief, earlier=self.earlier)


def status(
    findings: Sequence[Finding],
    reference: Reference,
    left: float | None = None,
    prediction: Prediction | None = None,
) -> Status:
    """Return the overall result of the findings of a diagnosis: kind, title and sentences.

    Args:
        findings: Findings of one diagnosis, the largest share first.
        reference: Vehicle with whose values the sentences compare.
        left: Mean squared residual with all changes since an earlier recording, in floors of the hull model;
            None without such a recording.
        prediction: Held-out errors before and after the confirmed findings are added; None if not known.
    """
    changed = left is not None
    named = [one for one in findings if one.verdict in (*STATED, "suspect")]
    suspected = [one for one in named if not one.is_confirmed]
    stated = [one for one in named if one not in suspected]
    faults = [f"The log has a fault: {one.advice}." for one in findings if one.verdict == "log_fault"]
    remains = any(one.verdict in UNEXPLAINED for one in findings) or (left is not None and left > RIGHT)
    told_by_change = [
        f"{one.advice[0].upper()}{one.advice[1:]}."
        for one in findings
        if changed and one.advice and one.verdict in UNEXPLAINED
    ]
    if stated:
        told = [_sentence(one, reference) for one in stated]
        rest = ["An error remains that no effect explains."] if remains else []
        if prediction is not None and prediction.refuted:
            they = "it does" if len(stated) == 1 else "they do"
            rest = [f"Added to the file, {they} not lower the held-out prediction error.", *rest]
            rest += [_suspicion(suspected, reference)] if suspected else []
        return Status("stated", _counted(len(stated), changed), (*told, *rest, *faults))
    if suspected:
        best = max(suspected, key=_likely)
        told = [_suspicion(suspected, reference)]
        formula = np.isnan(best.confidence) and not changed  # a formula explains all that effects explain
        rest = told_by_change or (["No effect explains all of the error."] if remains and not formula else [])
        return Status("uncertain", "Not certain", (*told, *rest, *faults))
    if remains:
        if told_by_change:
            return Status("unexplained", "No change can be named", (*told_by_change, *faults))
        return Status(
            "unexplained", "The model does not predict this log, and no effect explains why", tuple(faults)
        )
    if faults and not any(one.verdict == "nothing_missing" for one in findings):
        return Status("fault", "Nothing else was examined", tuple(faults))
    if changed:
        return Status(
            "nothing",
            "Nothing has changed",
            ("No change stands out from the error of the hull-force model.", *faults),
        )
    noise = "The model predicts this log to within its noise."
    return Status("nothing", "Nothing is missing", (noise, *faults))


def _suspicion(suspected: Sequence[Finding], reference: Reference) -> str:
    """Return the sentence of the likeliest unconfirmed finding, with its confidence."""
    best = max(suspected, key=_likely)
    return f"{_sentence(best, reference).rstrip('.')} ({in_words(best.confidence)})."


def _likely(one: Finding) -> float:
    """Return the confidence of a finding; 1 for a discovered formula, which has no confidence.

    A formula explains all of the error that effects explain, so it comes first.
    """
    return 1.0 if np.isnan(one.confidence) else one.confidence


def in_words(confidence: float) -> str:
    """Return a confidence as text, such as `likely, 75 %`; `possible` for NaN, as of a discovered formula."""
    if np.isnan(confidence):
        return "possible"
    word = "very likely" if confidence >= SURE else "likely" if confidence >= LIKELY else "possible"
    return f"{word}, {percent(confidence)}"


def percent(confidence: float) -> str:
    """Return a confidence as text in percent, such as `75 %`; at most `more than` MOST_STATED."""
    if confidence > MOST_STATED:
        return f"more than {100.0 * MOST_STATED:.0f} %"
    told = f"{100.0 * confidence:.0f} %"
    return "less than 1 %" if told == "0 %" else told


def with_sentences(diagnosis: Diagnosis, reference: Reference) -> Diagnosis:
    """Return a diagnosis whose findings with values have a sentence that states the values."""
    findings = tuple(
        replace(one, sentence=reference.sentence(one.effect, one.parameters, one.standard_errors))
        if one.parameters
        else one
        for one in diagnosis.findings
    )
    return replace(diagnosis, findings=findings)


def _sentence(one: Finding, reference: Reference) -> str:
    """Return a finding's sentence for the headline, with the effects that would fit as well."""
    if not one.parameters:
        return f"The file's {one.effect.replace('_', ' ')} does not fit this log."
    told = reference.sentence(one.effect, one.parameters, one.standard_errors, brief=True)
    unclear = told.endswith(UNDETERMINED) or UNCLEAR in told
    if one.verdict in STATED and unclear and told.count(". ") == 0:
        told = f"{one.effect.replace('_', ' ').capitalize()} explains a part of the error. {told}"
    others = [name.replace("_", " ") for name in one.members if name != one.effect]
    return f"{told} In this log {' or '.join(others)} would fit as well." if others else told


def _counted(count: int, changed: bool) -> str:
    """Return the number of confirmed findings in words."""
    if changed:
        return f"{count} {'effect has' if count == 1 else 'effects have'} changed"
    return f"The model needs {count} correction{'s' * (count > 1)}"
