"""Diagnosis of the effect that a vehicle file lacks, with a confidence.

The file's existing effects are refitted first, so that a drag coefficient that is a quarter wrong is not
mistaken for a missing effect.  Then `diagnosis.search` tests the whole catalogue against the residual.  Each
finding states its share of the error, the effects that explain it equally well (`diagnosis.confidence`) and
the next step.  The result also lists existing effects with other values, effects that the recording does not
show, and error that no effect explains.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import polars as pl
from scipy.special import fdtrc

from hydro.core.cleaning.readiness import require_ready
from hydro.core.diagnosis.baseline import (
    Baseline,
    Found,
    Outcome,
    allowing_for_waves,
    refit,
    stable_shots,
    stable_start,
)
from hydro.core.diagnosis.before import diagnose_change
from hydro.core.diagnosis.closed_loop import under_feedback
from hydro.core.diagnosis.confidence import (
    by_likelihood_confidence,
    change_frequency,
    discounted_by_largest,
    discounted_by_unexplained,
    explained_share,
    selection_frequency,
    shared,
    stated,
    unconfirmed,
)
from hydro.core.diagnosis.findings import Diagnosis, Finding, limited_confidence, with_implausible
from hydro.core.diagnosis.held_out import predicted
from hydro.core.diagnosis.identifiability import left_open, unseen
from hydro.core.diagnosis.imperfect import named_by_transfer
from hydro.core.diagnosis.log_faults import Preprocessed, preprocess
from hydro.core.diagnosis.model import Diverges, Model, continue_fit, unfitted
from hydro.core.diagnosis.provisional import ReportingSearch, Told
from hydro.core.diagnosis.relative_thrust import doubted_gain
from hydro.core.diagnosis.search import Search, candidates
from hydro.core.diagnosis.settings import ALPHA, FAR_FROM_NOISE, MATERIAL, RIGHT, VISIBLE
from hydro.core.diagnosis.status import status, with_sentences
from hydro.core.diagnosis.unexplained import contradicted, unexplained
from hydro.core.effects.waves import WAVES
from hydro.core.errors import DataError
from hydro.core.experiment import advice
from hydro.core.experiment.manoeuvres import best
from hydro.core.identification.levenberg_marquardt import ITERATIONS, PRIOR
from hydro.core.identification.outcome import Fit
from hydro.core.identification.prior import ABSURD, Change, greatest_change, in_file, shrunk_to_prior
from hydro.core.prediction.normal_equations import block_length, covariance
from hydro.core.progress import Progress, part, silent
from hydro.core.residual.hull import Hull, Law, known_by, learnt
from hydro.core.sea.sea_state import shown
from hydro.core.vehicle.description import Vehicle

CORRECT_FIRST = "Correct this first, or add --correct-thrusters"
ANSWERED = 0.85
"""Share of the time of a diagnosis that passes before its findings are checked on held-out data: 0.77 to 0.93
in three measured runs."""
Beyond = Callable[[Vehicle, Preprocessed, Diagnosis, Progress], Diagnosis]
"""Function that extends the diagnosis of a vehicle and a recording beyond the catalogue."""
DIVERGED_TOGETHER = "the final joint fit diverged: values are of the fit before it"


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
            from it and held fixed, see `diagnosis.before`.
        corrected: Continue where the thrusters contradict the file, with the columns as the audit states
            them.
        progress: Called with a short text and the share of the work done.

    Returns:
        Findings, the largest share first.  Shares are of the baseline fit's error beyond the noise; those of
        `retune` are of the error of the file as given.  With `before` they are of the squared residual of the
        file with the hull-force model.

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
    """Learn the hull-force model from the raw table of an unchanged vehicle.

    Args:
        vehicle: Vehicle file.
        before: Raw table.
        law: Hull force if it is known, for instance as a network; by default the built-in regression.

    Raises:
        DataError: The recording does not fit the vehicle, or is too short.
    """
    log = preprocess(vehicle, before)
    require_ready(log.observed)
    problem = stable_shots(vehicle, log)
    return learnt(vehicle, problem) if law is None else known_by(vehicle, problem, law)


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
    """Diagnose a preprocessed recording.

    Where the thruster audit contradicts the file, that is the only finding and no effect is named.  The
    search continues with a log `as_audited`, and with a hull, which was learnt from a recording in order.

    Args:
        vehicle: Vehicle file.
        log: Preprocessed recording.
        hull: Hull-force model from a recording before a change.
        further: Whether the vehicle has changes since the hull's recording already, so that the next must be
            larger.
        file: Vehicle whose values are prior knowledge, where `vehicle` was fitted to this very recording.
        in_vain: Whether a search with a part of the vehicle's effects stayed far from the noise.  Where the
            residual is still above FAR_FROM_NOISE, candidates are then ranked by transfer at once.
        beyond: Function that extends a diagnosis without a finding before it is answered; not with `file`.
        progress: Called with a short text and the share of the work done.
        provisional: Called with the best candidate after the first fits, see `diagnosis.provisional`.
    """
    progress = progress or silent
    if file is not None:
        return _found_in(vehicle, log, hull, further, file, in_vain, progress, provisional)
    search, rest = part(progress, 0.0, ANSWERED), part(progress, ANSWERED, 1.0)
    found = _found_in(vehicle, log, hull, further, file, in_vain, search, provisional)
    if beyond is not None and not log.misdirected:
        found = beyond(vehicle, log, found, search)
    return answered(found, vehicle, log, hull=hull, progress=rest)


def answered(
    diagnosis: Diagnosis,
    vehicle: Vehicle,
    log: Preprocessed,
    *,
    hull: Hull | None,
    progress: Progress = silent,
) -> Diagnosis:
    """Return a diagnosis with its status, and with the held-out errors before and after stated findings.

    Args:
        diagnosis: Diagnosis.
        vehicle: Vehicle file.
        log: Recording.
        hull: Hull-force model from a recording before a change; None without one.
        progress: Called with a short text and the share of the work done.
    """
    if hull is None and not log.misdirected:
        diagnosis = predicted(diagnosis, vehicle, log, progress)
    progress("done", 1.0)
    diagnosis = with_sentences(diagnosis, vehicle, log.record.dt)
    left = None if hull is None else diagnosis.chi2[-1]
    told = status(diagnosis.findings, vehicle, log.record.dt, left, diagnosis.prediction)
    return replace(diagnosis, status=told)


def _found_in(
    vehicle: Vehicle,
    log: Preprocessed,
    hull: Hull | None,
    further: bool,
    file: Vehicle | None,
    in_vain: bool,
    progress: Progress,
    provisional: Told | None,
) -> Diagnosis:
    """Return the findings; see `diagnose_log`."""
    require_ready(log.observed)
    if log.misdirected and hull is None:
        return _misdirected(vehicle, log)
    progress("shots", 0.0)
    if hull is not None:
        return diagnose_change(vehicle, log, stable_shots(vehicle, log), hull, progress, further, provisional)
    start, problem = stable_start(vehicle, log)
    progress("baseline fit", 0.05)
    calm = replace(refit(vehicle, log, problem, start), file=file)
    baseline = allowing_for_waves(calm)
    found = _searched_for(baseline, progress, in_vain, provisional)
    if _waves_explained(baseline, found):
        found = _searched_for(calm, progress, in_vain)
    else:
        found = with_waves(found, baseline)
    return replace(found, findings=tuple(doubted_gain(one, log.record) for one in found.findings))


def _misdirected(vehicle: Vehicle, log: Preprocessed) -> Diagnosis:
    """Return the diagnosis of a log that contradicts the file's thrusters: its faults only.

    Residuals are those of the file with the columns as the audit states them.
    """
    chi2 = unfitted(vehicle, stable_start(vehicle, log)[1]).normal.chi2
    thrusters, *others = log.faults
    told = replace(thrusters, advice=f"{thrusters.advice}. {CORRECT_FIRST}")
    return Diagnosis((told, *others), vehicle, (chi2, chi2, chi2))


def _waves_explained(baseline: Baseline, found: Diagnosis) -> bool:
    """Return whether the findings explain the motion that was attributed to waves.

    A vehicle whose buoyancy turns it over swings with a period of some seconds, as in waves.
    """
    if baseline.sea is None or found.vehicle == baseline.vehicle:
        return False
    return shown(found.vehicle, baseline.log.record) is None


def _searched_for(
    baseline: Baseline, progress: Progress, in_vain: bool, provisional: Told | None = None
) -> Diagnosis:
    """Search from a baseline and return the diagnosis; see `diagnose_log` for `in_vain`."""
    vehicle, log, some = baseline.vehicle, baseline.log, baseline.thinned()
    if in_vain and baseline.refitted.normal.chi2 > FAR_FROM_NOISE:
        last = Search(some).screen(some.refitted, ())
        return named_by_transfer(some, Outcome(some.refitted, (), last), progress)
    search, outcome = searched(some, progress, provisional)
    if search.baseline is not baseline and outcome.model.normal.chi2 <= FAR_FROM_NOISE:
        search, outcome = searched(baseline, progress)
    if not (outcome.found or search.wrong(outcome)):
        search, outcome = simplest(search, outcome, part(progress, 0.4, 0.45))
    baseline = search.baseline
    if search.wrong(outcome):
        return named_by_transfer(baseline, outcome, part(progress, 0.4, 1.0))
    outcome = search.settle(outcome, part(progress, 0.45, 0.8))
    progress("joint fit", 0.8)
    outcome = refine(baseline, outcome)
    progress("verdicts", 0.88)
    findings = verdicts(baseline, outcome)
    progress("design of the next run", 0.95)
    models = (baseline.given, baseline.refitted, outcome.model)
    given, refitted, found = (model.normal.chi2 for model in models)
    fitted = outcome.fit.vehicle if outcome.fit else vehicle
    findings = [with_implausible(finding, vehicle) for finding in findings]
    estimates = outcome.fit.estimates() if outcome.fit else None
    question = left_open(baseline, outcome, findings)
    progress("done", 1.0)
    tried = tuple(candidates(baseline.refitted, outcome.found, vehicle))
    return Diagnosis((*log.faults, *findings), fitted, (given, refitted, found), estimates, question, tried)


def with_waves(diagnosis: Diagnosis, baseline: Baseline) -> Diagnosis:
    """Return the diagnosis with the recording's waves as its first finding, unless the file has them."""
    sea = baseline.sea
    if sea is None:
        return diagnosis
    others = [one for one in diagnosis.findings if one.verdict != "nothing_missing"]
    faults = [one for one in others if one.verdict == "log_fault"]
    waves = Finding(
        "missing",
        WAVES.name,
        (WAVES.name,),
        baseline.calmed,
        confidence=1.0,
        p_value=sea.p_value,
        parameters=sea.parameters,
        standard_errors=sea.errors,
        advice=advice.in_waves(sea.parameters, sea.speed, len(others) == len(faults)),
        support=1.0,
    )
    rest = others[len(faults) :]
    return replace(diagnosis, findings=(*faults, waves, *rest))


def searched(
    baseline: Baseline, progress: Progress, provisional: Told | None = None
) -> tuple[Search, Outcome]:
    """Search from the refitted values, then from the file's if no model fits, and return search and outcome.

    Without the missing effect, refitted values may run away and no step leads back from them.  So where the
    first effect that joins leaves a residual above FAR_FROM_NOISE, the file's values are tried before a
    second joins.  The second search is returned only if it fits.
    """
    first = ReportingSearch(baseline, told=provisional)
    again = replace(first, from_file=True)
    found = first.grow(part(progress, 0.0, 0.4), far=FAR_FROM_NOISE)
    if found.model.normal.chi2 <= RIGHT:
        return first, found
    other = again.grow(part(progress, 0.2, 0.45), other=found)
    if other.model.normal.chi2 <= RIGHT:
        return again, other
    if first.waits(found.model, found.found, FAR_FROM_NOISE):
        found = first.grow(part(progress, 0.3, 0.45), found)
    return first, found


def simplest(search: Search, outcome: Outcome, progress: Progress) -> tuple[Search, Outcome]:
    """Return the search, or a simpler one that changes effects singly, where refitted values are absurd.

    All existing effects of the file are refitted before a search.  Together they can absorb an effect that
    the file lacks.  Then a second search holds them at the file's values, and refits one of them only if that
    explains most.  By the penalty for parameters, the simpler explanation is returned.

    Args:
        search: Search that found nothing.
        outcome: Its outcome.
        progress: Called with a short text and the share of the work done.
    """
    baseline, refitted = search.baseline, search.baseline.refitted
    if not refitted.unknown.entries or not np.isfinite(baseline.given.normal.cost):
        return search, outcome
    if greatest_change(baseline.beforehand, refitted.unknown.entries, refitted.values).deviations <= ABSURD:
        return search, outcome
    held = Search(replace(baseline, effects=(), refitted=baseline.given))
    other = held.grow(progress)
    if not other.found or held.wrong(other) or other.model.penalised.sum() > refitted.penalised.sum():
        return search, outcome
    return held, other


def refine(baseline: Baseline, outcome: Outcome) -> Outcome:
    """Fit everything found and the existing effects together to convergence, shrunk to the prior."""
    model, warnings = outcome.model, baseline.warnings
    try:
        model = continue_fit(model, ITERATIONS, share=0.0)
    except Diverges:
        warnings = (*warnings, DIVERGED_TOGETHER)
    model, fit = settled(model, baseline.vehicle)
    return replace(outcome, model=model, fit=fit, warnings=warnings)


def settled(model: Model, file: Vehicle) -> tuple[Model, Fit | None]:
    """Return a joint fit shrunk to the file's values, and its values with standard errors."""
    if not model.unknown.entries:
        return model, None
    model = replace(model, values=shrunk_to_prior(model.unknown, model.values, model.normal, file))
    return model, model.estimated()


def verdicts(baseline: Baseline, outcome: Outcome) -> list[Finding]:
    """Return the findings by share, then changed values of existing effects, then effects not shown."""
    model = outcome.model
    remaining = unexplained(baseline, outcome)
    together = float(np.clip(baseline.explained(model), 0.0, 1.0))
    named = shared([_named(found, baseline, outcome) for found in outcome.found], together)
    if baseline.sea is None:
        named = discounted_by_largest(named, model.normal.chi2)
    findings = [stated(discounted_by_unexplained(finding, remaining)) for finding in named] + remaining
    findings.sort(key=lambda finding: -finding.share)
    if not findings:
        findings.append(_nothing(baseline, outcome))
    findings += _started(baseline, outcome)
    findings += sorted(_retuned(baseline, outcome), key=lambda finding: -finding.share)
    findings += contradicted(baseline, outcome)
    if outcome.warnings:
        words = "; ".join(outcome.warnings)
        findings[0] = replace(findings[0], advice=f"{findings[0].advice}; {words}")
    findings = under_feedback(baseline, outcome, findings)
    members = {name for finding in findings for name in finding.members}
    return findings + [finding for finding in unseen(baseline, outcome) if finding.effect not in members]


def _named(found: Found, baseline: Baseline, outcome: Outcome) -> Finding:
    """Return the finding of one effect that joined the model."""
    log, model, effect = baseline.log, outcome.model, found.effect
    without = outcome.without[effect]
    pieces = max(block_length(model.normal.score), 1)
    share, low, high = explained_share(without.costs - model.costs, baseline.refitted.excesses, pieces)
    tied = selection_frequency(found.rivals, effect)
    fit = _joint(outcome)
    parameters, errors = fit.table(effect)
    several, known = len(tied) > 1, bool(baseline.vehicle.effects(effect))
    if several:
        rivals = [found.rivals[name].vehicle for name in tied]
        try:
            flight = best(rivals, log.noise, start=log.middle)
        except DataError:  # no manoeuvre stays finite with such values: use the general advice
            flight = None
        words = advice.separating(list(tied), flight)
    elif known:
        words = advice.retuning(effect, _change(effect, baseline, model))
    else:
        words = advice.adding(effect, parameters, log.record.dt)
    words += unconfirmed(effect, without, model, baseline.problem.shots.session)
    sure = by_likelihood_confidence(tied[effect], model.normal.chi2)
    return Finding(
        "cannot_tell_apart" if several else "retune" if known else "missing",
        effect,
        tuple(tied),
        share,
        low,
        high,
        limited_confidence(sure, fit.vehicle, effect, errors),
        found.p_value,
        parameters,
        errors,
        advice=words,
        support=tied[effect],
    )


def _change(effect: str, baseline: Baseline, model: Model) -> Change:
    """Return the entry of an existing effect that a model moves farthest, relative to its prior."""
    own = [i for i, entry in enumerate(model.unknown.entries) if entry.effect == effect]
    return greatest_change(baseline.vehicle, [model.unknown.entries[i] for i in own], model.values[own])


def _joint(outcome: Outcome) -> Fit:
    """Return the joint fit of an outcome that has free values."""
    assert outcome.fit is not None
    return outcome.fit


def _nothing(baseline: Baseline, outcome: Outcome) -> Finding:
    """Return the finding that the refitted file explains the recording."""
    chi2 = baseline.refitted.normal.chi2
    return Finding(
        "nothing_missing",
        p_value=outcome.last.p_value,
        advice=f"mean squared residual {chi2:.3g} times the noise variance (1: noise alone)",
    )


def _started(baseline: Baseline, outcome: Outcome) -> Iterator[Finding]:
    """Yield the damping that was added because the file's predictions diverge without it."""
    for name in baseline.effects:
        if not baseline.vehicle.effects(name):
            values, errors = _joint(outcome).table(name)
            words = advice.suspecting(name, "without it the predicted motion diverges")
            yield Finding("suspect", name, (name,), parameters=values, standard_errors=errors, advice=words)


def _retuned(baseline: Baseline, outcome: Outcome) -> Iterator[Finding]:
    """Yield existing effects whose values in the file cost much and differ significantly from the fit.

    The limit is a share of the squared error of the final model.  A share of a poor file's large error would
    hide changes that bias the added effects.  Where nothing joined, the limit is a share of the
    file's excess error, which is small next to the noise in a good file.  Absurd values are reported whatever
    they cost: a free refit may have absorbed a missing effect with them.
    """
    model = outcome.model
    much = MATERIAL * model.normal.cost
    if not outcome.found and np.isfinite(baseline.given.excess):
        much = min(much, max(MATERIAL * baseline.given.excess, VISIBLE * model.normal.residuals))
    spread = covariance(model.normal, np.full(len(model.values), PRIOR**-2))
    matrix = model.normal.matrix.sum(axis=0)
    blocks = len(model.normal.gram) // block_length(model.normal.score)
    for name in filter(baseline.vehicle.effects, baseline.effects):
        entries = [i for i, entry in enumerate(model.unknown.entries) if entry.effect == name]
        before = in_file(baseline.vehicle, [model.unknown.entries[i] for i in entries])
        change = (model.values[entries] - before) / model.unknown.scales[entries]
        cost = float(change @ matrix[np.ix_(entries, entries)] @ change)
        farthest = _change(name, baseline, model)
        absurd = farthest.deviations > ABSURD
        if cost < much and not absurd:
            continue
        wald = float(change @ np.linalg.solve(spread[np.ix_(entries, entries)], change)) / len(entries)
        p = float(fdtrc(len(entries), max(blocks - len(entries), 1), wald))
        if p <= ALPHA or absurd:
            values, errors = _joint(outcome).table(name)
            frequency = change_frequency(model.normal, entries, change)
            sure = by_likelihood_confidence(frequency, model.normal.chi2)
            there = baseline.given.excess
            share = float(np.clip(cost / max(there, 1e-9), 0.0, 1.0)) if np.isfinite(there) else 1.0
            yield Finding(
                "retune",
                name,
                (name,),
                share,
                confidence=limited_confidence(sure, _joint(outcome).vehicle, name, errors),
                p_value=p,
                parameters=values,
                standard_errors=errors,
                advice=advice.retuning(name, farthest),
            )
