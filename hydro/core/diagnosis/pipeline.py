"""Diagnosis of the effect that a vehicle file lacks: one pipeline, whose steps are listed in `diagnose_log`.

Regimes differ only in the model of the force that no effect describes (the discrepancy).  A `Regime` selects
effects and turns them into findings; `reported` is the same for all of them.

| regime | discrepancy | candidates are ranked by |
|---|---|---|
| `by_likelihood` | none: the best model reaches the noise, or explains almost all | penalised likelihood |
| `by_evidence` | library of hull forces, integrated out | evidence and held-out data |
| `by_change` | learnt from a recording before the change | held-out cost with a penalty |
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

import polars as pl

from hydro.core.cleaning.readiness import require_ready
from hydro.core.diagnosis.baseline import Baseline, allowing_for_waves, refit, stable_shots, stable_start
from hydro.core.diagnosis.by_change import ByChange
from hydro.core.diagnosis.by_evidence import ByEvidence
from hydro.core.diagnosis.by_likelihood import ByLikelihood, selected, wave_finding
from hydro.core.diagnosis.completing import completed
from hydro.core.diagnosis.doubts import doubted_gain
from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.core.diagnosis.free_hull_force import hull_laws_alone
from hydro.core.diagnosis.held_out import predicted
from hydro.core.diagnosis.log_faults import Preprocessed, preprocess
from hydro.core.diagnosis.model import unfitted
from hydro.core.diagnosis.mounting import with_mounting
from hydro.core.diagnosis.provisional import Told
from hydro.core.diagnosis.settings import FAR_FROM_NOISE, MOST_SHOTS
from hydro.core.diagnosis.status import Reference, status, with_sentences
from hydro.core.preprocessing.sensor_tests import shown as shown_by_kinematics
from hydro.core.progress import Progress, part, silent
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import SHOT_SECONDS
from hydro.core.recording.spread_sessions import spread_sessions
from hydro.core.residual.hull import Hull, Law, known_by, learnt
from hydro.core.residual.limits import FIT
from hydro.core.sea.sea_state import shown
from hydro.core.vehicle.description import Vehicle

CORRECT_FIRST = "Correct this first, or add --correct-thrusters"
NAMED = 0.9
"""Share of the time before the check on held-out data that passes before a search beyond the catalogue."""
CHECKED = 0.85
"""Share of the time of a diagnosis that passes before its findings are checked on held-out data: 0.77 to 0.93
in three measured runs."""
LONGEST_EARLIER = 3 * MOST_SHOTS * SHOT_SECONDS
"""Maximum length of an earlier recording that is used [s], an hour: the hull force is learnt from MOST_SHOTS
shots, a third of it.  Of 4.8 hours of Stonefish, one gives the same first names in three quarters of the
time."""
Beyond = Callable[[Vehicle, Preprocessed, Diagnosis, Progress], Diagnosis]
"""Function that extends the diagnosis of a vehicle and a recording beyond the catalogue."""
Selection = TypeVar("Selection")
"""Effects that a regime selected, with the fits behind them."""


class Regime(Protocol[Selection]):
    """Way to select effects under one model of the force that no effect describes."""

    @property
    def log(self) -> Preprocessed:
        """Recording."""

    def select(self, progress: Progress) -> Selection:
        """Screen, fit and score candidates; return the selected effects, fitted together."""

    def findings(self, selection: Selection) -> list[Finding]:
        """Return the findings with their calibrated confidence, and what the recording cannot show."""

    def diagnosis(self, selection: Selection, findings: Sequence[Finding]) -> Diagnosis:
        """Return a diagnosis: the findings, the fitted vehicle, and open questions."""


def diagnose(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    before: pl.DataFrame | None = None,
    corrected: bool = False,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find what is missing in a vehicle file, or what has changed since an earlier recording.

    Args:
        vehicle: Vehicle file.
        raw: Raw table of the measured motion and commands.
        before: Raw table of the same vehicle before a change.  The hull-force error of the file is learnt
            from that table and held fixed, so that only changes since then are found.
        corrected: Continue where the thrusters contradict the file, with the command columns assigned and
            signed as the audit of the log found them.
        progress: Called with a short text and the share of the work done.

    Returns:
        Findings, the largest share first, unless another one alone removes almost all of the held-out error.
        Shares are of the baseline fit's error beyond the noise; those of `retune` are of the error of the
        file as given.  With `before` they are of the squared residual of the file with the hull-force model.

    Raises:
        DataError: A recording or the vehicle is at fault, or a recording is too short.
    """
    hull = None
    if before is not None:
        (progress or silent)("earlier recording", 0.0)
        hull = hull_of(vehicle, before)
    log = preprocess(vehicle, raw, hull)
    return diagnose_log(vehicle, log.as_audited() if corrected else log, hull=hull, progress=progress)


def hull_of(vehicle: Vehicle, before: pl.DataFrame, law: Law | None = None) -> Hull:
    """Return a model of the hull-force error of a file, learnt from a recording of the unchanged vehicle.

    Of a recording longer than LONGEST_EARLIER, sessions spread evenly over it are used.

    Args:
        vehicle: Vehicle file.
        before: Raw table of the recording.
        law: Hull force if it is known, for instance as a network; by default the built-in regression.

    Raises:
        DataError: The recording does not fit the vehicle, or is too short.
    """
    recording(vehicle, before)  # refuses faults of the table, also in rows that are not used
    log = preprocess(vehicle, spread_sessions(before, LONGEST_EARLIER))
    require_ready(log.observed)
    problem = stable_shots(vehicle, log)
    if law is not None:
        return replace(known_by(vehicle, problem, law), sensors=log.sensors)
    hull = learnt(vehicle, problem)
    return replace(hull if hull.left <= FIT else completed(vehicle, log, hull), sensors=log.sensors)


def diagnose_log(
    vehicle: Vehicle,
    log: Preprocessed,
    *,
    hull: Hull | None = None,
    further: bool = False,
    file: Vehicle | None = None,
    in_vain: bool = False,
    beyond: Beyond | None = None,
    progress: Progress | None = None,
    provisional: Told | None = None,
) -> Diagnosis:
    """Diagnose a cleaned recording; return the findings, the largest share first.

    Where the thruster audit contradicts the file, that is the only finding and no effect is named.  The
    search continues in two cases: with a log `as_audited`, and with a hull-force model, whose recording had
    the thrusters in order.

    Args:
        vehicle: Vehicle file.
        log: Cleaned recording, with the tests of its sensors.
        hull: Hull-force model from a recording before a change.
        further: Whether the vehicle has changes since the hull's recording already, so that the next must be
            larger.
        file: Vehicle whose values are prior knowledge, where `vehicle` was fitted to this very recording.
            The diagnosis then has no `prediction`.
        in_vain: Whether a search with a part of the vehicle's effects stayed far from the noise.  Where the
            residual is still above FAR_FROM_NOISE, candidates are then ranked by transfer at once.
        beyond: Function that extends a diagnosis without a finding before its status is written.
        progress: Called with a short text and the share of the work done.
        provisional: Called once, with the best candidate after the first fits.
    """
    progress = progress or silent
    end = CHECKED if file is None else 1.0
    search_end = NAMED * end if beyond else end
    search = part(progress, 0.0, search_end)
    require_ready(log.observed)
    if log.misdirected and hull is None:
        found = misdirected(vehicle, log)
    elif hull is not None:
        vehicle = hull.completed(vehicle)
        found = reported(ByChange.of(vehicle, log, hull, further, provisional), search)
    else:
        search("shots", 0.0)
        start, shots = stable_start(vehicle, log)
        shown_errors = filter(shown_by_kinematics, log.sensors.values())
        if (back := with_mounting(vehicle, log, shown_errors, _misfit)) is not log:
            log, (start, shots) = back, stable_start(vehicle, back)
        if in_vain and unfitted(start, shots).normal.chi2 > FAR_FROM_NOISE:
            shots = shots.coarsened(start)
        search("baseline fit", 0.05)
        calm = refit(vehicle, log, shots, start, file)
        found = without_discrepancy(calm, search, in_vain, provisional)
    if beyond is not None and not log.misdirected:
        found = beyond(vehicle, log, found, part(progress, search_end, end))
    if file is None and hull is None and not log.misdirected:
        found = predicted(found, vehicle, log, part(progress, end, 1.0))
    progress("done", 1.0)
    reference = Reference.of(vehicle, log.record.dt, hull)
    found = with_sentences(found, reference)
    left = None if hull is None else found.chi2[-1]
    return replace(found, status=status(found.findings, reference, left, found.prediction))


def _misfit(vehicle: Vehicle, log: Preprocessed) -> float:
    """Return the mean squared residual of a vehicle with its effects refitted, in units of the noise."""
    start, shots = stable_start(vehicle, log)
    return refit(vehicle, log, shots, start).refitted.normal.chi2


def misdirected(vehicle: Vehicle, log: Preprocessed) -> Diagnosis:
    """Return the diagnosis of a log that contradicts the file's thrusters: its faults only.

    Residuals are those of the file with the command columns as the audit corrected them.
    """
    chi2 = unfitted(vehicle, stable_start(vehicle, log)[1]).normal.chi2
    thrusters, *others = log.faults
    told = replace(thrusters, advice=f"{thrusters.advice}. {CORRECT_FIRST}")
    return Diagnosis((told, *others), vehicle, (chi2, chi2, chi2))


def without_discrepancy(
    calm: Baseline, progress: Progress, in_vain: bool, provisional: Told | None
) -> Diagnosis:
    """Return the diagnosis of one recording; waves that the recording shows count as noise and are a finding.

    The search is repeated without waves where the findings explain the same motion: a vehicle whose buoyancy
    turns it over swings with a period of some seconds, as in waves.

    `calm` does not allow for waves.
    """
    baseline = allowing_for_waves(calm)
    found = chosen_and_reported(baseline, progress, in_vain, provisional)
    if baseline.sea is not None:
        log = baseline.log
        if found.vehicle != baseline.vehicle and shown(found.vehicle, log.record, log.motion) is None:
            found = chosen_and_reported(calm, progress, in_vain)
        else:
            others = [one for one in found.findings if one.verdict != "nothing_missing"]
            faults = [one for one in others if one.verdict == "log_fault"]
            rest = others[len(faults) :]
            waves = wave_finding(baseline, baseline.sea, alone=not rest)
            found = replace(found, findings=(*faults, waves, *rest))
    return replace(found, findings=tuple(doubted_gain(one, calm.log.record) for one in found.findings))


def chosen_and_reported(
    baseline: Baseline, progress: Progress, in_vain: bool, provisional: Told | None = None
) -> Diagnosis:
    """Return a diagnosis by likelihood if a model reaches the noise or explains almost all, else by evidence.

    Hull laws alone that explain almost all, but do not reach the noise, are judged by evidence, too.
    """
    search, outcome = selected(baseline, progress, in_vain, provisional)
    if search.wrong(outcome):
        return reported(ByEvidence(search.baseline, outcome), part(progress, 0.4, 1.0))
    outcome = search.settle(outcome, part(progress, 0.45, 0.8))
    if hull_laws_alone(search.baseline, outcome):
        return reported(ByEvidence(search.baseline, outcome), part(progress, 0.8, 1.0))
    return reported(ByLikelihood(search, outcome), progress)


def reported(regime: Regime[Selection], progress: Progress) -> Diagnosis:
    """Return the diagnosis of a recording in a regime, with the log's faults before the other findings.

    A regime is a way to select effects: by likelihood, by evidence, or by change (see the table of this
    module).  Its three steps are called in order: select effects, turn them into findings, and build the
    diagnosis from both.
    """
    selection = regime.select(progress)
    progress("verdicts", 0.9)
    findings = regime.findings(selection)
    progress("design of the next run", 0.95)
    found = regime.diagnosis(selection, [*regime.log.faults, *findings])
    progress("done", 1.0)
    return replace(found, trace=(regime, selection))
