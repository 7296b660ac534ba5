"""Diagnosis where no model reaches the noise: one change is named, with its confidence.

No formula of the catalogue describes a hull exactly, and a flexible formula can absorb the hull's error.  So
one change at a time is named, by the error that it removes from held-out data: over two seconds
(`diagnosis.transfer`) and over five (`diagnosis.held_out`).  The rest is the hull-force error of the file,
until a recording from before the change separates the two.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from hydro.core.diagnosis.baseline import Baseline, Outcome
from hydro.core.diagnosis.confidence import by_evidence_confidence, by_transfer_confidence, explained_share
from hydro.core.diagnosis.doubts import limited_confidence, unconfirmed, with_implausible
from hydro.core.diagnosis.findings import (
    STATED,
    Diagnosis,
    Finding,
    extended,
)
from hydro.core.diagnosis.free_hull_force import is_present, refined
from hydro.core.diagnosis.held_out import HeldOut
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Diverges, Model, fit_model, unfitted
from hydro.core.diagnosis.sensor_errors import sensor_finding, unstated
from hydro.core.diagnosis.settings import (
    ALMOST_ALL,
    CLOSEST,
    CONTENDERS,
    DOUBTFUL,
    FAR_FROM_NOISE,
    FAR_FROM_PRIOR,
    LEAST_EVIDENCE,
    MATERIAL,
    NEARLY_EQUAL,
    QUICK_STEPS,
    SHOTS,
    SIMILAR,
    SURE,
)
from hydro.core.diagnosis.transfer import (
    Known,
    Rival,
    Survey,
    one_change,
    ranked,
    resolved,
    survey,
    tempered,
)
from hydro.core.diagnosis.unexplained import contradicted, unexplained
from hydro.core.effects.catalogue import implausible
from hydro.core.effects.hull_laws import has_drag
from hydro.core.effects.record import Table
from hydro.core.experiment import advice
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.outcome import Fit, with_response_error
from hydro.core.identification.prior import change_of
from hydro.core.prediction.normal_equations import block_length
from hydro.core.prediction.output_error import OutputError
from hydro.core.progress import Progress, part
from hydro.core.residual.allowance import Allowance


@dataclass(frozen=True)
class Named:
    """Result of naming one change where no model reaches the noise.

    Attributes:
        findings: The named effect and those nearly as good; empty if none is named.
        model: Vehicle with the named effect and the existing effects, fitted within their priors.
        fit: Values and standard errors of `model`; None without a fit.
        refitted: Vehicle with the existing effects alone, fitted within their priors; the file unchanged
            where they are held.
        rivals: Every effect of the survey, the best first.
        sensor_errors: Errors of the velocity sensor that kinematics shows.
    """

    findings: tuple[Finding, ...]
    model: Model
    fit: Fit | None
    refitted: Model
    rivals: tuple[Rival, ...] = ()
    sensor_errors: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class ByEvidence:
    """Regime of a diagnosis where no model reaches the noise, with a library of hull forces.

    The library stands for the force that no effect describes, see `diagnosis.pipeline`.

    Attributes:
        baseline: Vehicle file and shots.
        outcome: Outcome of the search by likelihood, which did not reach the noise.
    """

    baseline: Baseline
    outcome: Outcome

    @property
    def log(self) -> Preprocessed:
        """Recording."""
        return self.baseline.log

    def select(self, progress: Progress) -> Named:
        """Return the one change that is named, after the velocity sensor errors that kinematics shows."""
        baseline, errors = self.baseline, list(_sensor_errors(self.baseline))
        read = extended(baseline.vehicle, [one.table for one in errors])
        rest = tuple(name for name in baseline.effects if name not in {one.effect for one in errors})
        there = replace(baseline, vehicle=read, effects=rest)
        joined = (one for one in self.outcome.found if not read.effects(one.effect))
        near = {one.effect: one.model.vehicle.effects(one.effect)[0] for one in joined}
        return replace(by_transfer(there, part(progress, 0.4, 0.9), near), sensor_errors=tuple(errors))

    def findings(self, named: Named) -> list[Finding]:
        """Return all findings, in the order of the diagnosis.

        The order is: sensor errors, known values of the file that the recording contradicts, the named effect
        with those nearly as good, and the error that remains.
        """
        baseline = self.baseline
        last = replace(self.outcome, model=named.model, found=(), fit=named.fit)
        found = [*named.sensor_errors, *contradicted(baseline, self.outcome), *named.findings]
        explains = any(one.share >= ALMOST_ALL for one in named.findings)
        stated = explains or any(one.verdict in STATED for one in found)
        found += unexplained(baseline, last, stated=stated)
        if baseline.warnings and found:
            words = "; ".join(baseline.warnings)
            found[0] = replace(found[0], advice=f"{found[0].advice}; {words}")
        return [with_implausible(finding, baseline.vehicle) for finding in found]

    def diagnosis(self, named: Named, findings: Sequence[Finding]) -> Diagnosis:
        """Return the diagnosis with the fit of the named change, without questions for a next experiment."""
        models, fit = (self.baseline.given, named.refitted, named.model), named.fit
        given, refitted, found = (model.normal.chi2 for model in models)
        vehicle = fit.vehicle if fit else named.model.vehicle
        estimates = fit.estimates() if fit else None
        return Diagnosis(tuple(findings), vehicle, (given, refitted, found), estimates)


def _sensor_errors(baseline: Baseline) -> Iterator[Finding]:
    """Yield errors of the velocity sensor that kinematics shows, with values.

    They hold whatever forces act, so the search by likelihood, which did not reach the noise, has no say.
    """
    for test in unstated(baseline.sensors, baseline.vehicle):
        read = extended(baseline.refitted.vehicle, [test.table])
        own = [name for name in baseline.effects if name != test.effect]
        try:
            share = baseline.explained(
                fit_model(read, own, baseline.problem, baseline.log.track, QUICK_STEPS)
            )
        except Diverges:
            share = 0.0
        yield sensor_finding(test, share, baseline.log.record.dt, baseline.vehicle)


def by_transfer(baseline: Baseline, progress: Progress, near: Mapping[str, Table]) -> Named:
    """Name the one change that the recording shows best; without one, the result has no findings.

    `near` has tables of fitted effects, from which their fits start.

    Candidates are ranked by evidence with the hull force free if the file has drag and the best evidence is
    at least LEAST_EVIDENCE.  Otherwise they are ranked by their score, the share of the held-out error that
    they remove beyond what they absorb (`Rival.score`).

    Only those are considered that also predict longer held-out stretches best (`leading`).  A candidate whose
    score is below MATERIAL is passed over.  So is one with values outside their plausible range, because it
    stands for another effect.  The next best is then named if it has at least NEARLY_EQUAL of the evidence or
    score, whichever ranks them, of the one passed over.  If all that qualify have implausible values, the
    first of them is named.
    """
    fine = baseline.problem
    baseline = replace(one_change(baseline), problem=resolved(fine))
    if baseline.refitted.normal.chi2 > FAR_FROM_NOISE:
        baseline = replace(baseline, problem=baseline.problem.coarsened(baseline.refitted.vehicle))
    try:
        scored = survey(baseline, progress, near)
        refitted, known = tempered(baseline, baseline.problem)
        surveyed = leading(ranked_by_evidence(scored, baseline, refitted, known), scored, baseline)
    except Diverges:  # the file's predictions diverge: no fit can start
        return Named((), baseline.refitted, None, baseline.refitted)
    alone = _in_noise(refitted, fine)
    implausible_named, least, passed = Named((), alone, None, alone, surveyed.rivals), MATERIAL, list[str]()
    for rival in surveyed.leading:
        if surveyed.worth(rival) < least:
            break
        if rival.score < MATERIAL:  # an effect with far less evidence does not replace it
            least = max(least, NEARLY_EQUAL * surveyed.worth(rival))
            continue
        if rival.own and not _moved(rival, baseline):
            continue
        try:
            model = _fitted_to_all_shots(rival, baseline, known)
            without = _without(rival, baseline, refitted, known)
        except Diverges:
            continue
        fit = model.estimated() if rival.allowed is None else rival.estimated()
        if not is_present(fit, rival.effect):
            continue
        fit = with_response_error(fit, baseline.vehicle)
        model, without = _in_noise(model, fine), _in_noise(without, fine)
        others = surveyed.alternatives(rival, passed)
        finding = _finding(rival, surveyed, others, model, without, fit, baseline.log.record.dt)
        rest = _nearly_as_good(rival, surveyed, others, finding, baseline)
        named = Named((finding, *rest), model, fit, alone, surveyed.rivals)
        if not implausible(fit.vehicle, [rival.effect]):
            return named
        passed.append(rival.effect)
        if not implausible_named.findings:
            implausible_named, least = named, max(NEARLY_EQUAL * surveyed.worth(rival), least)
    return implausible_named


def ranked_by_evidence(surveyed: Survey, baseline: Baseline, refitted: Model, known: Known) -> Survey:
    """Return a survey ranked by evidence with the hull force free; unchanged below LEAST_EVIDENCE.

    The survey of a file without drag stays ranked by transfer, because the hull force would take over the
    drag.
    """
    if not has_drag(baseline.vehicle):
        return surveyed
    allowance = Allowance.of(baseline.vehicle, baseline.problem.some(SHOTS).shots)
    alone = allowance.held(refitted.unknown, refitted.values, known.alone(refitted.unknown)).evidence
    found, rivals = [], []
    for rival in surveyed.rivals:
        if not rival.beyond:  # it absorbs all that it removes, whatever its evidence
            rivals.append(rival)
            continue
        unknown, prior = rival.model.unknown, known.releasing(rival.effect).alone(rival.model.unknown)
        held = allowance.held(unknown, rival.model.values, prior)
        if np.isfinite(held.evidence):
            found.append((rival, held, prior))
    found.sort(key=lambda one: -one[1].evidence)
    for number, (rival, held, prior) in enumerate(found):
        best = held
        if number < CONTENDERS:
            best = refined(allowance, rival.model.unknown, held, prior)
        rivals.append(replace(rival, evidence=rival.beyond * (best.evidence - alone), allowed=best))
    rivals.sort(key=lambda rival: -rival.evidence)
    if not rivals or not LEAST_EVIDENCE <= rivals[0].evidence < np.inf:
        return surveyed
    return Survey(surveyed.refitted, tuple(rivals), by_evidence=True, leading=tuple(rivals))


def leading(surveyed: Survey, scored: Survey, baseline: Baseline) -> Survey:
    """Return a survey in which only effects that predict held-out stretches best may be named.

    A score is that of two seconds, over which a wrong effect with the right direction may do as well.  So the
    CONTENDERS best effects by rank, and those by score, each added to the file alone, predict longer
    stretches.  None may be clearly behind the best with plausible values (`HeldOut.behind`), and each must
    remove a share MATERIAL of that error (`HeldOut.removed`).  Where the recording is too short for that,
    `surveyed` is returned.

    Args:
        surveyed: Survey, perhaps ranked by evidence.
        scored: The same survey ranked by score.  Its ranks and values apply where the best of the remaining
            effects has less than LEAST_EVIDENCE.
        baseline: Vehicle file and shots.
    """
    check = HeldOut.of(baseline.vehicle, baseline.log)
    if check is None:
        return surveyed
    may = [one for one in surveyed.rivals if one.score >= MATERIAL and (not one.own or _moved(one, baseline))]
    best = {one.effect for order in (may, ranked(may)) for one in order[:CONTENDERS]}
    may = [one for one in may if one.effect in best]
    fits = [one.estimated() for one in may]
    tables = [{"name": one.effect, **fit.table(one.effect)[0]} for one, fit in zip(may, fits, strict=True)]
    tried = [(table, check.squares([table])) for table in tables]
    fair = [not implausible(fit.vehicle, [one.effect]) for one, fit in zip(may, fits, strict=True)]
    removed, late = [check.removed(*one) for one in tried], check.behind(tried, fair)
    may = [one for i, one in enumerate(may) if removed[i] >= MATERIAL and not late[i]]
    if surveyed.by_evidence and may and may[0].evidence >= LEAST_EVIDENCE:
        return replace(surveyed, leading=tuple(may))
    names = {one.effect for one in may}
    return replace(scored, leading=tuple(one for one in scored.rivals if one.effect in names))


def _in_noise(model: Model, fine: OutputError) -> Model:
    """Return a model with its residuals in units of the noise of other shots."""
    problem = cast(OutputError, model.problem).weighed(fine.shots.sigma)
    names = model.unknown.effects
    if not names:
        return unfitted(model.vehicle, problem)
    return fit_model(model.vehicle, names, problem, np.zeros((1, 3)), 0)


def _moved(rival: Rival, baseline: Baseline) -> bool:
    """Return whether a fit moves an existing effect FAR_FROM_PRIOR standard deviations from the file."""
    change = change_of(rival.effect, baseline.vehicle, rival.model.unknown, rival.values)
    return change.deviations >= FAR_FROM_PRIOR


def _fitted_to_all_shots(rival: Rival, baseline: Baseline, known: Known) -> Model:
    """Fit an effect with the existing effects to all shots, from the values of the survey.

    Values that were fitted with the hull force free stay: a plain fit would absorb the hull's error.
    """
    own, reach = rival.model.unknown, baseline.log.track
    if rival.allowed is not None:
        names = own.effects
        return fit_model(own.at(rival.values), names, baseline.problem, reach, 0)
    table = next(iter(rival.model.vehicle.effects(rival.effect)))
    others = [name for name in baseline.effects if name != rival.effect]
    vehicle, released = rival.model.vehicle, known.releasing(rival.effect)
    return fit_model(vehicle, [*others, table], baseline.problem, reach, ITERATIONS, known=released)


def _without(rival: Rival, baseline: Baseline, refitted: Model, known: Known) -> Model:
    """Return the model without an effect of the survey, or with the file's values of it."""
    if not rival.own:
        return refitted
    others = [name for name in baseline.effects if name != rival.effect]
    return fit_model(baseline.vehicle, others, baseline.problem, baseline.log.track, ITERATIONS, known=known)


def _finding(
    rival: Rival,
    surveyed: Survey,
    others: Sequence[Rival],
    model: Model,
    without: Model,
    fit: Fit,
    dt: float,
) -> Finding:
    """Return the finding of the named effect, with its share of the error beyond the noise.

    `others` may be named instead; the share is of the error of `without`, the model without the effect.  A
    law of the hull's forces may stand for the error of the file's drag, so it is not confirmed.
    """
    values = fit.table(rival.effect)[0]
    if surveyed.by_evidence:
        sure = by_evidence_confidence(rival.lead, [one.evidence for one in others])
    else:
        sure = by_transfer_confidence(rival.score, [one.score for one in others])
    of_hull = rival.of_hull and has_drag(without.vehicle)
    if rival.own or of_hull or surveyed.leading[0] is not rival:
        sure = min(sure, DOUBTFUL)
    sure = limited_confidence(sure, fit.vehicle, rival.effect)
    words = advice.retuning(rival.effect) if rival.own else advice.adding(rival.effect, values, dt)
    least = max(NEARLY_EQUAL * surveyed.worth(rival), MATERIAL)
    near = [one.effect for one in others if surveyed.worth(one) >= least]
    words += _evidence_in_words(rival, model, near)
    return _named(rival, model, without, fit, words, sure)


def _nearly_as_good(
    rival: Rival, surveyed: Survey, others: Sequence[Rival], finding: Finding, baseline: Baseline
) -> Iterator[Finding]:
    """Yield effects with at least half the score of the named effect as unconfirmed findings.

    These divide the remaining probability in proportion to their scores; one more part stands for any other
    effect.  None has more confidence than the named effect.
    """
    worth = surveyed.worth
    near = [one for one in others if worth(one) >= max(SIMILAR * worth(rival), MATERIAL)]
    near = [one for one in near if not one.own][:CLOSEST]
    whole = 1.0 + sum(worth(one) for one in near)
    by = "with any hull force allowed" if surveyed.by_evidence else "on held-out data"
    for one in near:
        fit = one.estimated()
        if not is_present(fit, one.effect) or implausible(fit.vehicle, [one.effect]):
            continue
        fit = with_response_error(fit, baseline.vehicle)
        adding = advice.adding(one.effect, fit.table(one.effect)[0], baseline.log.record.dt)
        words = f"{adding}; {worth(one) / worth(rival):.0%} as good as {rival.effect} {by}"
        confidence = min((1.0 - finding.confidence) * worth(one) / whole, finding.confidence)
        yield _named(one, one.model, surveyed.refitted, fit, words, confidence)


def _named(rival: Rival, model: Model, without: Model, fit: Fit, words: str, confidence: float) -> Finding:
    """Return an effect as a finding with its values; it is unconfirmed if the confidence is below SURE.

    The share is of the error of `without`, the model without the effect, beyond the noise.  An effect that
    removes none of it has a confidence of at most DOUBTFUL: the hull forces alone profit from it.
    """
    pieces, table = block_length(model.normal.score), fit.table(rival.effect)
    share = explained_share(without.costs - model.costs, without.excesses, pieces)
    sure = confidence if share[0] > 0.0 else min(confidence, DOUBTFUL)
    told = {"confidence": sure, "advice": words, "support": rival.score}
    found = Finding.of("missing", rival.effect, table, share, **told)
    return found if sure >= SURE else unconfirmed(found)


def _evidence_in_words(rival: Rival, model: Model, near: Sequence[str]) -> str:
    """Return the evidence for a named effect, in words.

    `near` are the effects that are nearly as good.
    """
    evidence = f", and its log evidence with any hull force allowed is {rival.evidence:.0f}"
    words = (
        f"; it removes {rival.score:.0%} of the error of held-out sessions and regimes"
        f"{evidence * (rival.allowed is not None)}. "
        f"The residual is still {model.normal.chi2:.3g} times the noise variance, from the hull or from "
        "other changes: a recording from before the change (`--before`) separates the two"
    )
    return f"{words}; nearly as good: {', '.join(near)}" if near else words
