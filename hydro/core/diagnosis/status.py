"""The answer of a diagnosis in one headline, from which no finding may differ."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro.core.diagnosis.findings import STATED, Finding, Status
from hydro.core.effects.sentences import sentence
from hydro.core.vehicle.description import Vehicle

UNEXPLAINED = ("none_of_the_known", "far_from_noise")
CERTAIN, LIKELY = 0.9, 0.6
"""Confidence from which a name is called certain, and likely; below it is possible."""


def status(findings: Sequence[Finding], vehicle: Vehicle, dt: float, *, changed: bool = False) -> Status:
    """Return the answer that findings amount to.

    Args:
        findings: Of one diagnosis, the most telling first.
        vehicle: The file that was diagnosed.
        dt: Sample time of the recording [s].
        changed: Whether they are changes since a recording before.
    """
    stated = [one for one in findings if one.verdict in STATED]
    suspected = [one for one in findings if one.verdict == "suspect"]
    remains = any(one.verdict in UNEXPLAINED for one in findings)
    if stated:
        told = [_sentence(one, vehicle, dt) for one in stated]
        rest = ["An error remains that no effect explains."] if remains else []
        return Status("stated", _counted(stated, changed), (*told, *rest))
    if suspected:
        best = max(suspected, key=lambda one: np.nan_to_num(one.confidence))
        told = [f"{_sentence(best, vehicle, dt)} ({in_words(best.confidence)})"]
        rest = ["No effect explains all of the error."] if remains else []
        return Status("uncertain", "Not certain", (*told, *rest))
    if remains:
        return Status("unexplained", "The model does not predict this log, and no effect explains why")
    faults = [one for one in findings if one.verdict == "log_fault"]
    if faults and not any(one.verdict == "nothing_missing" for one in findings):
        return Status("fault", "The log has a fault", (f"{faults[0].advice}.",))
    nothing = "Nothing has changed" if changed else "Nothing is missing"
    return Status("nothing", nothing, ("The model predicts this log to within its noise.",))


def in_words(confidence: float) -> str:
    """Return a confidence in words and percent."""
    if np.isnan(confidence):
        return "possible"
    word = "certain" if confidence >= CERTAIN else "likely" if confidence >= LIKELY else "possible"
    return f"{word}, {confidence:.0%}"


def _sentence(one: Finding, vehicle: Vehicle, dt: float) -> str:
    """Return a finding's sentence; its name where it has no values."""
    if not one.parameters:
        return f"{one.effect} has other values than the file."
    told = sentence(vehicle, one.effect, one.parameters, one.standard_errors, dt)
    others = [name for name in one.members if name != one.effect]
    return f"{told} By this log it may as well be {' or '.join(others)}." if others else told


def _counted(stated: Sequence[Finding], changed: bool) -> str:
    """Return how many effects are missing, and how many have other values."""
    other = sum(one.verdict == "retune" for one in stated)
    missing = len(stated) - other
    if changed:
        return f"{len(stated)} {'effect has' if len(stated) == 1 else 'effects have'} changed"
    parts = [f"{missing} {'effect is' if missing == 1 else 'effects are'} missing"] if missing else []
    if other:
        unit = ("effect" if other == 1 else "effects") if not missing else ""
        parts.append(
            " ".join(filter(None, [str(other), unit, "has" if other == 1 else "have", "other values"]))
        )
    return " and ".join(parts)
