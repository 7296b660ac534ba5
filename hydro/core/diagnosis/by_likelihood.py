"""Findings where a model reaches the noise or explains almost all: effects are selected by likelihood.

The file's existing effects are refitted first, so that a drag coefficient that is a quarter wrong is not
mistaken for a missing effect.  Then `diagnosis.search` tests the whole catalogue against the residual.  Each
finding states its share of the error, the effects that explain it equally well (`diagnosis.confidence`) and
the next step.  The findings also list existing effects with other values, effects that the recording does not
show, and error that no effect explains.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from hydro.core.diagnosis.baseline import Baseline, Found, Outcome
from hydro.core.diagnosis.closed_loop import under_feedback
from hydro.core.diagnosis.confidence import (
    by_likelihood_confidence,
    change_frequency,
    explained_share,
    selection_frequency,
    shared,
)
from hydro.core.diagnosis.doubts import (
    discounted_by_largest,
    discounted_by_unexplained,
    limited_confidence,
    session_warning,
    stated,
    with_implausible,
)
from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.core.diagnosis.free_hull_force import limited_for_hull, with_free_hull_force
from hydro.core.diagnosis.identifiability import left_open, unseen
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Diverges, Model, continue_fit
from hydro.core.diagnosis.provisional import Told
from hydro.core.diagnosis.search import Search
from hydro.core.diagnosis.sensor_errors import sure_by_kinematics
from hydro.core.diagnosis.settings import ALPHA, FAR_FROM_NOISE, FURTHER, MATERIAL, RIGHT, VISIBLE
from hydro.core.diagnosis.unexplained import contradicted, unexplained
from hydro.core.effects.waves import WAVES
from hydro.core.errors import DataError
from hydro.core.experiment import advice
from hydro.core.experiment.manoeuvres import best
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.outcome import Fit
from hydro.core.identification.prior import ABSURD, change_of, greatest_change, in_file, shrunk_to_prior
from hydro.core.prediction.normal_equations import block_length
from hydro.core.progress import Progress, part
from hydro.core.sea.sea_state import SeaState
from hydro.core.vehicle.description import Vehicle

DIVERGED_TOGETHER = "the final joint fit diverged: values are of the fit before it"


@dataclass(frozen=True)
class ByLikelihood:
    """Regime where the best model reaches the noise, or explains almost all (`diagnosis.pipeline`).

    Attributes:
        search: Search, with its baseline.
        outcome: Outcome of the search, with its effects reconsidered (`Search.settle`).
    """

    search: Search
    outcome: Outcome

    @property
    def log(self) -> Preprocessed:
        """Recording."""
        return self.search.baseline.log

    def select(self, progress: Progress) -> Outcome:
        """Return the outcome with the effects found fitted together to convergence."""
        progress("joint fit", 0.8)
        return refine(self.search.baseline, self.outcome)

    def findings(self, outcome: Outcome) -> list[Finding]:
        """Return all findings in their order, with warnings about values that physics excludes."""
        baseline = self.search.baseline
        return [with_implausible(one, baseline.vehicle) for one in verdicts(baseline, outcome)]

    def diagnosis(self, outcome: Outcome, findings: Sequence[Finding]) -> Diagnosis:
        """Return the diagnosis with the joint fit, and the rivals of uncertain findings as open questions."""
        baseline, fit = self.search.baseline, outcome.fit
        models = (baseline.given, baseline.refitted, outcome.model)
        given, refitted, found = (model.normal.chi2 for model in models)
        return Diagnosis(
            tuple(findings),
            fit.vehicle if fit else baseline.vehicle,
            (given, refitted, found),
            fit.estimates() if fit else None,
            left_open(baseline, outcome, findings),
        )


def wave_finding(baseline: Baseline, sea: SeaState, *, alone: bool) -> Finding:
    """Return the recording's waves as a finding."""
    words, values = advice.in_waves(sea.parameters, sea.speed, alone), (sea.parameters, sea.errors)
    sure = {"confidence": 1.0, "support": 1.0, "p_value": sea.p_value}
    return Finding.of("missing", WAVES.name, values, baseline.calmed, advice=words, **sure)


def selected(
    baseline: Baseline, progress: Progress, in_vain: bool, provisional: Told | None
) -> tuple[Search, Outcome]:
    """Return a search by likelihood and its outcome, also where no model reaches the noise.

    Where an earlier search was in vain, above FAR_FROM_NOISE, effects are screened and none is added.
    """
    some = baseline.thinned()
    if in_vain and baseline.refitted.normal.chi2 > FAR_FROM_NOISE:
        search = Search(some)
        return search, Outcome(some.refitted, (), search.screen(some.refitted, ()))
    search, outcome = searched(some, progress, provisional)
    if search.baseline is not baseline and outcome.model.normal.chi2 <= FAR_FROM_NOISE:
        search, outcome = searched(baseline, progress)
    if not (outcome.found or search.wrong(outcome)):
        search, outcome = simplest(search, outcome, part(progress, 0.4, 0.45))
    return search, outcome


def searched(
    baseline: Baseline, progress: Progress, provisional: Told | None = None
) -> tuple[Search, Outcome]:
    """Search for missing effects from the refitted values, then from the file's values if no model fits.

    Without the missing effect, refitted values may run away and no step leads back from them.  A model fits
    if its mean squared residual is at most RIGHT times the noise variance.

    1. The first search starts from the refitted values.  If it fits with values near those of the file, or
       reaches the noise, it is returned.  It pauses if its first effect leaves more than FAR_FROM_NOISE times
       the noise variance.
    2. Otherwise a second search starts from the file's values.  It is returned only if it fits, and better.
    3. Otherwise the first search is returned, continued if it had paused.

    Returns:
        The search by these rules, and its outcome.
    """
    first = Search(baseline, told=provisional)
    again = replace(first, from_file=True)
    found = first.grow(part(progress, 0.0, 0.4), far=FAR_FROM_NOISE)
    if found.model.normal.chi2 <= (1.0 + MATERIAL if is_absurd(baseline, found.model) else RIGHT):
        return first, found
    other = again.grow(part(progress, 0.2, 0.45), other=found)
    if other.model.normal.chi2 <= RIGHT and other.model.penalised.sum() < found.model.penalised.sum():
        return again, other
    if first.waits(found.model, found.found, FAR_FROM_NOISE):
        found = first.grow(part(progress, 0.3, 0.45), found)
    return first, found


def is_absurd(baseline: Baseline, model: Model) -> bool:
    """Return whether any fitted value of an effect of the file is far from the file's value."""
    own = [i for i, entry in enumerate(model.unknown.entries) if baseline.beforehand.effects(entry.effect)]
    entries = [model.unknown.entries[i] for i in own]
    return bool(own) and greatest_change(baseline.beforehand, entries, model.values[own]).deviations > ABSURD


def simplest(search: Search, outcome: Outcome, progress: Progress) -> tuple[Search, Outcome]:
    """Return a search, or one that changes effects singly, where refitted values are absurd.

    All existing effects of the file are refitted before a search.  Together they can absorb an effect that
    the file lacks.  Then a second search holds them at the file's values, and refits one of them only if that
    explains most.  The search with the lower penalised cost is returned.  A second search that ends with all
    of these effects refitted has the same model, so the first one is returned.

    Args:
        search: Search that found nothing.
        outcome: Outcome of that search.
        progress: Called with a short text and the share of the work done.
    """
    baseline, refitted = search.baseline, search.baseline.refitted
    if not np.isfinite(baseline.given.normal.cost) or not is_absurd(baseline, refitted):
        return search, outcome
    held = Search(replace(baseline, effects=(), refitted=baseline.given))
    other = held.grow(progress)
    if not other.found or held.wrong(other) or set(other.effects) == set(baseline.effects):
        return search, outcome
    if other.model.penalised.sum() > refitted.penalised.sum():
        return search, outcome
    return held, other


def refine(baseline: Baseline, outcome: Outcome) -> Outcome:
    """Return an outcome with everything found and the existing effects fitted together.

    Values are shrunk to those of the file.  If the joint fit diverges, values stay and a warning is added.
    Above RIGHT times the noise, values are then fitted with the hull force free.
    """
    model, warnings = outcome.model, baseline.warnings
    try:
        model = continue_fit(model, ITERATIONS, share=0.0)
    except Diverges:
        warnings = (*warnings, DIVERGED_TOGETHER)
    model, fit = settled(model, baseline.vehicle)
    fit = with_free_hull_force(baseline, model, outcome.effects) or fit
    return replace(outcome, model=model, fit=fit, warnings=warnings)


def settled(model: Model, file: Vehicle) -> tuple[Model, Fit | None]:
    """Return a model with its values shrunk to the file's, and the fit with standard errors.

    Returns:
        Model and fit; the fit is None if no component is free.
    """
    if not model.unknown.entries:
        return model, None
    model = replace(model, values=shrunk_to_prior(model.unknown, model.values, model.normal, file))
    return model, model.estimated()


def verdicts(baseline: Baseline, outcome: Outcome) -> list[Finding]:
    """Return all findings of a search by likelihood.

    The order is: missing effects and unexplained error, the largest share first; new values of the file's
    effects; effects that the recording cannot show.
    """
    model = outcome.model
    remaining = unexplained(baseline, outcome)
    together = float(np.clip(baseline.explained(model), 0.0, 1.0))
    named = shared([_named(found, baseline, outcome) for found in outcome.found], together)
    if baseline.sea is None:
        named = discounted_by_largest(named, model.normal.chi2)
    rest = max(sum(one.share for one in remaining), excess_share(baseline, model))
    findings = [
        sure_by_kinematics(one, baseline.sensors) or stated(discounted_by_unexplained(one, rest))
        for one in named
    ]
    findings += remaining
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


def may_be_right(outcome: Outcome) -> bool:
    """Return whether the model of an outcome may be right.

    It leaves at most RIGHT times the noise.  Where it leaves a share FURTHER of the noise or more, no further
    effect may be significant either: otherwise one is missing.
    """
    left = outcome.model.normal.chi2
    return bool(left <= 1.0 + FURTHER or (left <= RIGHT and not outcome.last.significant))


def excess_share(baseline: Baseline, model: Model) -> float:
    """Return the share, 0 or more, of the baseline fit's error beyond the noise that a model leaves.

    A share MATERIAL of the noise is not counted, because noise levels are uncertain.  The result may be
    too small to be reported, and yet as large as the share of a small effect.
    """
    beyond = model.excess - MATERIAL * model.normal.residuals
    return float(max(beyond, 0.0) / max(baseline.refitted.excess, 1e-9))


def _named(found: Found, baseline: Baseline, outcome: Outcome) -> Finding:
    """Return the finding of one effect that joined the model."""
    log, model, effect = baseline.log, outcome.model, found.effect
    without = outcome.without[effect]
    pieces = block_length(model.normal.score)
    share = explained_share(without.costs - model.costs, baseline.refitted.excesses, pieces)
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
        words = advice.retuning(effect, change_of(effect, baseline.vehicle, fit.free, fit.values))
    else:
        words = advice.adding(effect, parameters, log.record.dt)
    words += session_warning(effect, without, model, baseline.problem.shots.session)
    sure = by_likelihood_confidence(tied[effect], may_be_right(outcome))
    return Finding.of(
        "cannot_tell_apart" if several else "retune" if known else "missing",
        effect,
        (parameters, errors),
        share,
        members=tuple(tied),
        confidence=_limited(sure, effect, errors, baseline, outcome),
        p_value=found.p_value,
        advice=words,
        support=tied[effect],
    )


def _limited(
    confidence: float, effect: str, errors: Mapping[str, Any], baseline: Baseline, outcome: Outcome
) -> float:
    """Return the confidence in a name, lowered for implausible values and for an unknown hull force.

    The standard errors excuse implausible values only where the model fits.
    """
    fit, model = _joint(outcome), outcome.model
    excused = errors if model.normal.chi2 <= RIGHT else None
    sure = limited_confidence(confidence, fit.vehicle, effect, excused)
    return limited_for_hull(sure, effect, baseline, fit, model)


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
    """Yield a finding for the damping without which the file's predictions diverge, if it was added."""
    for name in baseline.effects:
        if not baseline.vehicle.effects(name):
            words = advice.suspecting(name, f"{advice.ADD}; without it the predicted motion diverges")
            yield Finding.of("suspect", name, _joint(outcome).table(name), advice=words)


def _retuned(baseline: Baseline, outcome: Outcome) -> Iterator[Finding]:
    """Yield existing effects whose values in the file cost much and differ significantly from the fit.

    The cost must exceed a share MATERIAL of the squared error of the final model.  A share of a poor file's
    large error would hide changes that bias the added effects.  If no effect joined the model, a smaller cost
    suffices: a share MATERIAL of the file's error beyond the noise, if it is visible.  Absurd values are
    reported whatever they cost, because a free refit may have absorbed a missing effect with them.
    """
    model = outcome.model
    much = MATERIAL * model.normal.cost
    if not outcome.found and np.isfinite(baseline.given.excess):
        much = min(much, max(MATERIAL * baseline.given.excess, VISIBLE * model.normal.residuals))
    matrix, scales = model.normal.matrix.sum(axis=0), model.unknown.scales
    blocks = len(model.normal.gram) // block_length(model.normal.score)
    for name in filter(baseline.vehicle.effects, baseline.effects):
        fit, entries = _joint(outcome), model.unknown.places(name)
        before = in_file(baseline.vehicle, [model.unknown.entries[i] for i in entries])
        change = (fit.values[entries] - before) / scales[entries]
        cost = float(change @ matrix[np.ix_(entries, entries)] @ change)
        farthest = change_of(name, baseline.vehicle, model.unknown, fit.values)
        absurd = farthest.deviations > ABSURD
        if cost < much and not absurd:
            continue
        spread = (fit.covariance / np.outer(scales, scales))[np.ix_(entries, entries)]
        wald = float(change @ np.linalg.solve(spread, change)) / len(entries)
        p = float(scipy.special.fdtrc(len(entries), max(blocks - len(entries), 1), wald))
        if p <= ALPHA or absurd:
            values, errors = fit.table(name)
            frequency = change_frequency(model.normal, entries, change)
            sure = by_likelihood_confidence(frequency, may_be_right(outcome))
            there = baseline.given.excess
            share = float(np.clip(cost / max(there, 1e-9), 0.0, 1.0)) if np.isfinite(there) else 1.0
            yield Finding.of(
                "retune",
                name,
                (values, errors),
                share,
                confidence=_limited(sure, name, errors, baseline, outcome),
                p_value=p,
                advice=advice.retuning(name, farthest),
            )
