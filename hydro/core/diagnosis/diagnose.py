"""Which physical effect is missing in a vehicle file, and how sure is that?

The file's own effects are first fitted anew, so that a drag coefficient a quarter wrong is not taken for
something missing.  Then `diagnosis.search` holds the whole catalogue against what is left.  What it names
comes with its share of the error, the effects that explain it as well (`diagnosis.confidence`), and what to
do next; so does what the file has with other values, what the recording could not have shown, and what no
effect explains.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import polars as pl
from scipy.stats import f as fisher

from hydro.core.columns import Progress
from hydro.core.diagnosis import advice
from hydro.core.diagnosis.coloured import coloured
from hydro.core.diagnosis.confidence import (
    doubted,
    explained_share,
    selection_frequency,
    shared,
    stated,
    unconfirmed,
)
from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.core.diagnosis.identifiability import undetermined
from hydro.core.diagnosis.log_faults import Preprocessed, preprocess
from hydro.core.diagnosis.manoeuvres import best, plain, showing
from hydro.core.diagnosis.model import Model, fit_model, own_effects
from hydro.core.diagnosis.search import ALPHA, MATERIAL, Baseline, Found, Outcome, Search
from hydro.core.diagnosis.unexplained import unexplained
from hydro.core.effects.damping import LINEAR_DAMPING
from hydro.core.errors import DataError
from hydro.core.identification import multiple_shooting
from hydro.core.identification.candidate import candidate
from hydro.core.identification.fit import UNDETERMINED, Fit, OutputError, with_uncertainty
from hydro.core.identification.levenberg_marquardt import ITERATIONS, PRIOR
from hydro.core.identification.normal_equations import block_length, covariance
from hydro.core.identification.parameters import free
from hydro.core.identification.prior import Change, greatest_change, in_file, shrunk_to_prior
from hydro.core.identification.suspects import CURVED, choice
from hydro.core.vehicle.description import Vehicle

SHOT_LENGTHS = tuple(part * multiple_shooting.SHOT_SECONDS for part in (1.0, 0.5, 0.25))
"""Lengths of a shot that are tried, for vehicles that the model makes unstable [s]."""
STABLE = 0.95
"""Part of the shots that must not diverge."""
LEAST_SHOTS = 16


def diagnose(vehicle: Vehicle, raw: pl.DataFrame, *, progress: Progress | None = None) -> Diagnosis:
    """Find what is missing in a vehicle file.

    Args:
        vehicle: The model.
        raw: Raw table of the measured motion and commands.
        progress: Called with a few words and the share of the work done.

    Returns:
        Findings, the most telling first.  Shares are of the error beyond the noise that is left once the
        file's own effects are fitted anew; of `retune` of those effects, of the error of the file as given.

    Raises:
        DataError: The recording or the vehicle is at fault, or the recording is too short.
    """
    return diagnose_log(vehicle, preprocess(vehicle, raw), progress=progress)


def diagnose_log(vehicle: Vehicle, log: Preprocessed, *, progress: Progress | None = None) -> Diagnosis:
    """The same of a recording that has been preprocessed: from its shots to the findings."""
    progress = progress or (lambda words, share: None)
    progress("shots", 0.0)
    problem = stable_shots(vehicle, log)
    progress("the file's own effects", 0.05)
    baseline = refit(vehicle, log, problem)
    search = Search(baseline)
    outcome = search.grow(progress)
    progress("looking back", 0.8)
    outcome = refine(baseline, search.reconsider(outcome))
    progress("verdicts", 0.9)
    findings = verdicts(baseline, outcome)
    progress("done", 1.0)
    models = (baseline.given, baseline.refitted, outcome.model)
    given, refitted, found = (model.normal.chi2 for model in models)
    fitted = outcome.fit.vehicle if outcome.fit else vehicle
    return Diagnosis((*log.faults, *findings), fitted, (given, refitted, found))


def stable_shots(vehicle: Vehicle, log: Preprocessed) -> OutputError:
    """Shots as long as the vehicle's predictions stay finite and near, those that do not left out.

    Raises:
        DataError: The recording is too short, or the predictions of every length diverge.
    """
    record = log.record
    for seconds in SHOT_LENGTHS:
        shots = log.shots(seconds)
        if len(shots.starts) < LEAST_SHOTS:
            least, gaps = LEAST_SHOTS * seconds, int(record.after_gap.sum())
            remedy = f"record at least {least:g} s, better some minutes"
            if record.rows * record.dt > least and gaps:
                remedy = f"{gaps} gaps cut the log to pieces: `hydro import` bridges those of a few samples"
            raise DataError(
                f"{len(shots.starts) * seconds:g} s without a gap are too short for a diagnosis; {remedy}"
            )
        problem = OutputError.of(shots, vehicle)
        stable = multiple_shooting.bounded(
            multiple_shooting.prepare(candidate(vehicle), problem.shots), problem.shots
        )
        if stable.mean() >= STABLE:
            return OutputError(multiple_shooting.select(problem.shots, stable))
    raise DataError(
        f"the vehicle's predicted motion diverges within {SHOT_LENGTHS[-1]:g} s; check its "
        f"damping, or begin with `hydro fit --effect {LINEAR_DAMPING.name}`"
    )


def refit(vehicle: Vehicle, log: Preprocessed, problem: OutputError) -> Baseline:
    """The file's own effects fitted anew, each channel weighed by its noise, white or not."""
    effects = own_effects(vehicle)
    refitted = fit_model(vehicle, effects, problem, log.positions, ITERATIONS)
    sigma = coloured(log.noise, refitted.normal, log.record, log.sensors)
    if not np.array_equal(sigma, log.noise):
        problem = problem.weighed(sigma)
        refitted = fit_model(refitted.vehicle, effects, problem, log.positions, ITERATIONS)
    given = fit_model(vehicle, [], problem, log.positions, 0)
    return Baseline(vehicle, effects, log, problem, given, refitted, log.sensors)


def refine(baseline: Baseline, outcome: Outcome) -> Outcome:
    """All that was found and the file's own effects fitted together to the end, shrunk to the prior."""
    effects, model = [*baseline.effects, *outcome.effects], outcome.model
    model = fit_model(model.vehicle, effects, model.problem, baseline.log.positions, ITERATIONS, share=0.0)
    values = shrunk_to_prior(model.unknown, model.values, model.normal, baseline.vehicle)
    model, fit = replace(model, values=values), None
    if effects:
        fit = with_uncertainty(model.unknown, values, model.normal, model.normal.chi2, "output")
    return replace(outcome, model=model, fit=fit)


def verdicts(baseline: Baseline, outcome: Outcome) -> list[Finding]:
    """What was found, the most telling first; then other values of the file's, and what did not show."""
    first, model = baseline.refitted, outcome.model
    remaining = unexplained(baseline, outcome)
    together = float(np.clip((first.normal.cost - model.normal.cost) / max(first.excess, 1e-9), 0.0, 1.0))
    named = shared([_named(found, baseline, outcome) for found in outcome.found], together)
    findings = [stated(doubted(finding, remaining)) for finding in named] + remaining
    findings.sort(key=lambda finding: -finding.share)
    if not findings:
        findings.append(_nothing(baseline, outcome))
    findings += sorted(_retuned(baseline, outcome), key=lambda finding: -finding.share)
    members = {name for finding in findings for name in finding.members}
    return findings + [finding for finding in _unseen(baseline, outcome) if finding.effect not in members]


def _named(found: Found, baseline: Baseline, outcome: Outcome) -> Finding:
    """The finding of one effect that joined the model."""
    log, model, effect = baseline.log, outcome.model, found.effect
    without = outcome.without[effect]
    pieces = max(block_length(model.normal.score), 1)
    share, low, high = explained_share(without.costs - model.costs, baseline.refitted.excesses, pieces)
    tied = selection_frequency(found.rivals, effect)
    parameters, errors = _tables(outcome.fit, effect)
    several, known = len(tied) > 1, bool(baseline.vehicle.effects(effect))
    if several:
        rivals = [found.rivals[name].vehicle for name in tied]
        words = advice.separating(list(tied), best(rivals, log.noise, start=log.middle))
    elif known:
        words = advice.retuning(effect, _change(effect, baseline, model))
    else:
        words = advice.adding(effect, parameters, log.record.dt)
    shots = baseline.problem.shots
    words += unconfirmed(effect, without, model, shots.record.session[shots.segment])
    return Finding(
        "cannot_tell_apart" if several else "retune" if known else "missing",
        effect,
        tuple(tied),
        share,
        low,
        high,
        tied[effect],
        found.p_value,
        parameters,
        errors,
        advice=words,
    )


def _change(effect: str, baseline: Baseline, model: Model) -> Change:
    """The entry of an effect of the file that a model takes farthest from what is known of it."""
    own = [i for i, entry in enumerate(model.unknown.entries) if entry.effect == effect]
    return greatest_change(baseline.vehicle, [model.unknown.entries[i] for i in own], model.values[own])


def _tables(fit: Fit | None, effect: str) -> tuple[dict[str, object], dict[str, object]]:
    """Values and standard errors of one fitted effect."""
    for table in fit.tables() if fit else ():
        if table["name"] == effect:
            values = {k: v for k, v in table.items() if k not in ("name", "standard_error") and v is not None}
            return values, dict(table["standard_error"])
    raise KeyError(effect)


def _nothing(baseline: Baseline, outcome: Outcome) -> Finding:
    """That the file, its own effects fitted anew, explains the recording."""
    chi2 = baseline.refitted.normal.chi2
    return Finding(
        "nothing_missing",
        p_value=outcome.last.p_value,
        advice=f"mean squared residual {chi2:.3g} of the noise (1: nothing but noise)",
    )


def _retuned(baseline: Baseline, outcome: Outcome) -> Iterator[Finding]:
    """Effects of the file whose values as given would cost much, and that the recording tells from these.

    Much is measured by the squared error of the model found: so what a share of a poor file's error would
    pass over does not spoil what is added to it.  Values beyond belief are told whatever they cost: a free
    refit may have taken up with them what is missing.
    """
    model = outcome.model
    spread = covariance(model.normal, np.full(len(model.values), PRIOR**-2))
    matrix = model.normal.matrix.sum(axis=0)
    blocks = len(model.normal.gram) // block_length(model.normal.score)
    for name in baseline.effects:
        entries = [i for i, entry in enumerate(model.unknown.entries) if entry.effect == name]
        before = in_file(baseline.vehicle, [model.unknown.entries[i] for i in entries])
        change = (model.values[entries] - before) / model.unknown.scales[entries]
        cost = float(change @ matrix[np.ix_(entries, entries)] @ change)
        farthest = _change(name, baseline, model)
        absurd = farthest.deviations > advice.ABSURD
        if cost < MATERIAL * model.normal.cost and not absurd:
            continue
        wald = float(change @ np.linalg.solve(spread[np.ix_(entries, entries)], change)) / len(entries)
        p = float(fisher.sf(wald, len(entries), max(blocks - len(entries), 1)))
        if p <= ALPHA or absurd:
            values, errors = _tables(outcome.fit, name)
            share = float(np.clip(cost / max(baseline.given.excess, 1e-9), 0.0, 1.0))
            yield Finding(
                "retune",
                name,
                (name,),
                share,
                p_value=p,
                parameters=values,
                standard_errors=errors,
                advice=advice.retuning(name, farthest),
            )


def _unseen(baseline: Baseline, outcome: Outcome) -> Iterator[Finding]:
    """Effects, or entries of them, that the recording could not have shown."""
    log, model, last = baseline.log, outcome.model, outcome.last
    hidden: dict[str, tuple[str, ...]] = {}
    for name, (_, columns) in last.ranked.items():
        spread = last.evidence.covariance(last.own, columns, model.normal.chi2)
        if (np.diag(spread) > UNDETERMINED**2).all():
            hidden[name] = ()
        elif name not in CURVED:
            entries = free(model.vehicle, [choice(model.vehicle, name)]).entries
            hidden |= undetermined(entries, spread)
    if not hidden:
        return
    vehicles = {name: plain(model.vehicle, name) for name in hidden}
    flights = showing(model.vehicle, vehicles, log.noise, start=log.middle)
    for name, entries_open in hidden.items():
        words = advice.exciting(name, entries_open, flights.get(name))
        yield Finding("not_excited", name, (name,), excited=False, advice=words)
