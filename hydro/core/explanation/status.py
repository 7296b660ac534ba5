"""Headline of a study: the effects that its steps added, and which of them are confirmed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from hydro.core.diagnosis.findings import STATED, UNEXPLAINED, Finding, Status
from hydro.core.diagnosis.status import Reference, status
from hydro.core.explanation.ladder import Step
from hydro.core.explanation.options import of_change, states
from hydro.core.residual.hull import Hull

UNCONFIRMED = "unconfirmed"
"""Word for a step whose effect has a confidence below SURE."""


def added(steps: Sequence[Step]) -> dict[str, bool]:
    """Return, for each added effect by name, whether the diagnosis before its step confirmed the effect."""
    return {name: states(last, name) for last, step in pairwise(steps) for name in step.added}


def retuned(first: Step) -> list[str]:
    """Return effects of the file with confirmed new values in the first diagnosis, the best first.

    Each step adds these values together with its own effect, and refits them.  Empty where the study looks
    for changes since an earlier recording, because the file's values are then held fixed.
    """
    if of_change(first):
        return []
    return [one.effect for one in first.findings if one.verdict == "retune" and one.is_confirmed]


def study_status(steps: Sequence[Step], chosen: Step, dt: float, hull: Hull | None = None) -> Status:
    """Return the overall result of a study: kind, title and sentences.

    Args:
        steps: All steps.
        chosen: Step to use.
        dt: Sample time of the recording [s].
        hull: Hull-force model from a recording before a change; None without one.
    """
    file, tables = steps[0].vehicle, {table["name"]: table for table in chosen.tables}
    reference = Reference.of(file, dt, hull)
    left = chosen.chi2[-1] if of_change(chosen) else None
    rest = [one for one in chosen.findings if one.verdict in (*UNEXPLAINED, "log_fault")]
    if not tables:
        unproven = [_unproven(one) for one in chosen.findings] if len(steps) > 1 else None
        return status(unproven or chosen.findings, reference, left)
    names = _corrected(steps, chosen)
    confirmed = [_finding(tables[name], bool(file.effects(name))) for name, sure in names.items() if sure]
    told = [
        f"{reference.sentence(name, *_values(tables[name]), brief=True).rstrip('.')} ({UNCONFIRMED})."
        for name, sure in names.items()
        if not sure
    ]
    if not confirmed:
        remains = ["No effect explains all of the error."] if any(one.effect == "" for one in rest) else []
        return Status("uncertain", "Not certain", (*told, *remains))
    found = status([*confirmed, *rest], reference, left)
    return replace(
        found, sentences=(*found.sentences[: len(confirmed)], *told, *found.sentences[len(confirmed) :])
    )


def corrections(steps: Sequence[Step], chosen: Step, dt: float, hull: Hull | None = None) -> list[str]:
    """Return a sentence with values and standard errors for each correction of a study, confirmed ones first.

    The arguments are those of `study_status`.
    """
    reference, tables = Reference.of(steps[0].vehicle, dt, hull), {one["name"]: one for one in chosen.tables}
    told = []
    for name, sure in _corrected(steps, chosen).items():
        text = reference.sentence(name, *_values(tables[name]))
        told.append(text if sure else f"{text.rstrip('.')} ({UNCONFIRMED}).")
    return told


def _corrected(steps: Sequence[Step], chosen: Step) -> dict[str, bool]:
    """Return every corrected effect of the chosen step, and whether it is confirmed; confirmed ones first."""
    there = {table["name"] for table in chosen.tables}
    known = {name: sure for name, sure in added(steps[: chosen.number + 1]).items() if name in there}
    new = {name: True for name in retuned(steps[0]) if name in there and name not in known}
    return dict(sorted((known | new).items(), key=lambda one: not one[1]))


def _unproven(one: Finding) -> Finding:
    """Return a finding whose step did not lower the error: a confirmed one becomes unconfirmed."""
    return replace(one, verdict="suspect") if one.verdict in STATED else one


def _finding(table: dict[str, Any], known: bool) -> Finding:
    """Return the finding that corresponds to an effect that a study added."""
    return Finding.of("retune" if known else "missing", table["name"], _values(table))


def _values(table: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the parameters of an `[[effect]]` table, and their standard errors."""
    values = {key: value for key, value in table.items() if key not in ("name", "standard_error", "fit")}
    return values, dict(table.get("standard_error", {}))
