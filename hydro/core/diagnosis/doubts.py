"""Doubts about findings: rules that lower a confidence, take back a confirmed verdict or add a warning.

| doubt | where | effect |
|---|---|---|
| values that physics excludes | every regime | confidence at most DOUBTFUL; warning |
| a hull law beside an unknown hull force | evidence; likelihood, above RIGHT | at most DOUBTFUL |
| absent with the hull force free | likelihood, above RIGHT | at most DOUBTFUL; see `free_hull_force` |
| one session alone supports it | likelihood | warning |
| formulas may absorb the hull's error | likelihood, above RIGHT | confidence times share over largest share |
| as much error remains unexplained | likelihood | less confidence; warning |
| feedback: a disturbance is possible | likelihood | less confidence; see `closed_loop` |
| a change begins within the recording | earlier recording | confidence at most DOUBTFUL; see `onset` |
| rates alone show thrust | one recording | confidence at most DOUBTFUL; not confirmed |
| another finding alone explains almost all | one recording | at most its confidence; see `held_out` |
| confidence below SURE | every regime | not confirmed (`stated`) |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import msgspec
from numpy.typing import ArrayLike

from hydro.core.diagnosis.confidence import left_out_share
from hydro.core.diagnosis.findings import LACKING, Finding
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.settings import DOUBTFUL, FAR_FROM_PRIOR, RIGHT, SIMILAR, SURE
from hydro.core.effects.actuator import THRUSTER_GAIN
from hydro.core.effects.catalogue import implausible
from hydro.core.experiment.advice import suspecting
from hydro.core.identification.prior import in_file
from hydro.core.recording.arrays import HORIZONTAL, Recording
from hydro.core.vehicle.description import Vehicle

BY_RATES_ALONE = (
    "rates alone show thrust only relative to the inertia in the file, which may be too small: record a "
    "velocity or a position, or measure the inertia"
)


def unconfirmed(finding: Finding) -> Finding:
    """Return a finding with the verdict `suspect`, and with advice to confirm the effect before adding it."""
    return replace(finding, verdict="suspect", advice=suspecting(finding.effect, finding.advice))


def stated(finding: Finding) -> Finding:
    """Return a finding, with the verdict `suspect` if it is confirmed with a confidence below SURE.

    Of effects that the recording cannot separate, the confidence of the whole group counts.
    """
    group = finding.support if finding.verdict == "cannot_tell_apart" else 1.0
    if finding.verdict not in LACKING or finding.confidence >= SURE * group:
        return finding
    return unconfirmed(finding)


def limited_confidence(
    confidence: float, vehicle: Vehicle, effect: str, errors: Mapping[str, Any] | None = None
) -> float:
    """Return the confidence in a name, at most DOUBTFUL where physics excludes the fitted values.

    Args:
        confidence: Confidence in the name.
        vehicle: Vehicle with the values.
        effect: Name of the effect.
        errors: Standard errors of the values, given where a model fits.  Then values count as excluded only
            if they lie FAR_FROM_PRIOR half widths from the middle of the plausible range.
    """
    beyond = implausible(vehicle, [effect], errors, 1.0 if errors is None else FAR_FROM_PRIOR)
    return min(confidence, DOUBTFUL) if beyond else confidence


def with_implausible(finding: Finding, vehicle: Vehicle) -> Finding:
    """Return a finding with a warning in its advice about each value outside its physical range."""
    if not finding.parameters:
        return finding
    beyond = implausible(msgspec.structs.replace(vehicle, effect=(finding.table,)))
    return replace(finding, advice="; ".join([finding.advice, *beyond]))


def session_warning(effect: str, without: Model, model: Model, session: ArrayLike) -> str:
    """Return a warning where held-out sessions do not confirm an effect; empty where they do.

    Only the effect's components are refitted, because one session alone may determine those of the others.
    """
    own, unknown = model.unknown.places(effect), model.unknown
    change = model.values[own] - in_file(without.vehicle, [unknown.entries[i] for i in own])
    amounts = change / unknown.scales[own]
    elsewhere = left_out_share(without.normal.of([]), model.normal.of(own), amounts, session)
    here = (without.normal.cost - model.normal.cost) / max(without.excess, 1e-9)
    if elsewhere >= SIMILAR * min(here, 1.0):
        return ""
    return (
        f"; one session alone supports it: fitted to the others it removes {elsewhere:.0%} of the error "
        f"instead of {here:.0%}"
    )


def discounted_by_largest(findings: Sequence[Finding], left: float) -> list[Finding]:
    """Return findings with the confidence of each multiplied by its share over the largest share.

    This applies above RIGHT times the noise, where formulas also absorb the hull's error: of 45 further names
    next to a right one none was right (`benchmarks.imperfect_base`, seeds 99000 to 99059).
    """
    most = max((finding.share for finding in findings), default=0.0)
    if left <= RIGHT or most <= 0.0:
        return list(findings)
    parts = [max(finding.share, 0.0) / most for finding in findings]
    return [replace(one, confidence=one.confidence * part) for one, part in zip(findings, parts, strict=True)]


def discounted_by_unexplained(finding: Finding, rest: float) -> Finding:
    """Return a finding with less confidence and a warning where the unexplained error is of similar size.

    Where a pilot or a controller reacts to a disturbance such as waves, disturbance and reaction are
    correlated, and estimates of inertia or damping are biased.  A small effect may also absorb an error of
    the hull that no effect describes.

    `rest` is the share of the error that no effect explains.
    """
    if rest < SIMILAR * finding.share:
        return finding
    share = f"{rest:.0%}" if rest >= 0.01 else f"{rest:.1%}"
    warning = (
        f"; no effect explains {share} of the error, and this estimate may absorb a part of it: if the "
        "commands react to waves or other disturbances, record without feedback before you trust its values"
    )
    sure = finding.confidence * finding.share / (finding.share + rest)
    return replace(finding, confidence=sure, advice=finding.advice + warning)


def doubted_gain(finding: Finding, record: Recording) -> Finding:
    """Return a finding, as unconfirmed if it is thruster gains and a wrong inertia predicts the same motion.

    A moment N and an inertia I act on a rate of turn through N / I alone.  Without a sensor of surge or sway,
    weak thrusters and too small an inertia in the file predict the same motion.  The confidence is then at
    most DOUBTFUL.
    """
    doubted = finding.verdict in (*LACKING, "suspect") and finding.effect == THRUSTER_GAIN.name
    if not doubted or record.shows(HORIZONTAL):
        return finding
    sure, words = min(finding.confidence, DOUBTFUL), f"{BY_RATES_ALONE}; {finding.advice}"
    return replace(finding, verdict="suspect", confidence=sure, advice=words)
