"""Discovery of sparse force terms that reduce the error of held-out data.

A formula is a sum of terms, such as `X |u|^n sgn(u)`.  Terms join it one at a time where no effect of the
catalogue explains a recording (forward selection; Brunton, Proctor and Kutz 2016 select such terms by
thresholds).  A term is scored by the error that it removes from held-out sessions and from held-out motion
regimes; the lesser of both scores counts.  A term is dropped when later terms make it redundant.  The powers
of a term are fitted together with its coefficient.

Errors are squared residuals of shots: predictions of two seconds from free initial values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.baseline import Baseline, refit, stable_start
from hydro.core.diagnosis.confidence import explained_share, folds, left_out_costs
from hydro.core.diagnosis.doubts import unconfirmed
from hydro.core.diagnosis.findings import UNEXPLAINED, Diagnosis, Finding, extended
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Diverges, Model, fit_model
from hydro.core.diagnosis.selection import Rounds, grow
from hydro.core.diagnosis.settings import (
    CLOSEST,
    CONTENDERS,
    FAR_FROM_PRIOR,
    LEAST_INFORMATION,
    MATERIAL,
    MOST_STEPS,
    NEARLY_EQUAL,
    NEGLIGIBLE,
    QUICK_STEPS,
    RIGHT,
    SHOTS,
    SMALL_STEP,
    VISIBLE,
)
from hydro.core.diagnosis.transfer import Known, left_out, regimes_of, tempered
from hydro.core.discovery.sentences import told
from hydro.core.discovery.terms import Term, library
from hydro.core.effects.catalogue import CATALOGUE
from hydro.core.effects.formula import FORMULA, amounts, joined, one_term
from hydro.core.experiment import advice
from hydro.core.identification.levenberg_marquardt import ITERATIONS, PRIOR, moved
from hydro.core.identification.outcome import Fit
from hydro.core.identification.prior import change_of, deviations, in_file
from hydro.core.prediction.normal_equations import Normal, block_length
from hydro.core.progress import Progress, part, silent
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Choice:
    """Candidate formula during forward selection.

    Attributes:
        model: The vehicle with the formula, fitted together with the effects of the file.
        left: Held-out squared residual of each of S shots beyond that of noise, (2, S).  Row 0 is predicted
            from the other sessions, row 1 from the other motion regimes; NaN where these hold too little
            information.
    """

    model: Model
    left: Array

    @property
    def costs(self) -> Array:
        """Held-out squared residual beyond the noise, summed over shots, (2,): by sessions, by regimes."""
        return np.asarray(np.nansum(self.left, axis=1))


@dataclass(frozen=True)
class Discovery:
    """Data and prior knowledge for the selection of terms.

    Attributes:
        baseline: The vehicle file and the shots of the recording.
        known: Prior of the values in the file.
        folds: Number of the session and of the motion regime of each of S shots, (S,) each.
        first: Fit of the file's effects without a new term; None before that fit.
    """

    baseline: Baseline
    known: Known
    folds: tuple[Rows, Rows]
    first: Choice | None = None

    @property
    def own(self) -> tuple[str, ...]:
        """Effects of the file that are fitted together with the formula."""
        return tuple(name for name in self.baseline.effects if name != FORMULA.name)

    def fitted(self, vehicle: Vehicle, steps: int) -> Choice:
        """Return the formula of a vehicle fitted together with the effects of the file, with held-out costs.

        Raises:
            Diverges: The predicted motion diverges.
        """
        log, problem = self.baseline.log, self.baseline.problem
        effects = [*self.own, *({FORMULA.name} if vehicle.effects(FORMULA.name) else ())]
        model = fit_model(vehicle, effects, problem, log.track, steps, known=self.known)
        return Choice(model, self.transferred(model))

    def transferred(self, model: Model) -> Array:
        """Return the held-out squared residual of a fitted model beyond the noise, by shot, (2, S).

        Row 0 is predicted from the other sessions, row 1 from the other motion regimes.
        """
        freedom = model.normal.freedoms
        return np.stack([left_out(model, self.known, fold) - freedom for fold in self.folds])

    def shortlist(self, choice: Choice) -> list[Term]:
        """Return the terms that would reduce the held-out error of a formula, the best first.

        Only the 2 CONTENDERS terms that explain most of the error are tested on held-out data.
        """
        model, terms = choice.model, library(len(choice.model.vehicle.thruster))
        own, steps = moved(model.unknown, model.values)
        pulls = [SMALL_STEP * size for size in _sizes(model.vehicle)]
        vehicles = [_with(model.vehicle, [term.table(pulls[term.axis])]) for term in terms]
        normal = model.problem.linearise(model.vehicle, [*own, *vehicles], [*steps, *[1.0] * len(vehicles)])
        count, prior = len(own), self.known(model.unknown)
        away = np.append(model.values / model.unknown.scales - prior.centre, 0.0)
        information = np.append(prior.information, self.known.temper * PRIOR**-2)
        first = choice.left + model.normal.freedoms
        scored = []
        for number in _most(normal, count, [term.preferred for term in terms], self.known, model):
            both = normal.of([*range(count), count + number])
            given = away, information, [count], LEAST_INFORMATION
            after = [left_out_costs(both, fold, *given) for fold in self.folds]
            gain = min(float(np.nansum(a - b)) for a, b in zip(first, after, strict=True))
            scored.append((gain * terms[number].preferred, number))
        return [terms[number] for gain, number in sorted(scored, reverse=True) if gain > 0.0]

    def is_open(self, choice: Choice) -> bool:
        """Return whether another term may be added: a formula has at most MOST_STEPS new terms."""
        return self._new_terms(choice) < MOST_STEPS

    def _new_terms(self, choice: Choice) -> int:
        """Return the number of terms in a formula that the vehicle file does not have."""
        return len(_terms(choice.model.vehicle)) - len(_terms(self.baseline.vehicle))

    def added(self, choice: Choice, tried: Choice) -> Choice:
        """Return `tried`, the formula so far with the accepted term; `choice` is the formula before."""
        return tried

    def belongs(self, choice: Choice, tried: Choice) -> bool:
        """Return whether another term clearly reduces the held-out error, by sessions and by regimes."""
        assert self.first is not None
        gained, noise = choice.costs - tried.costs, choice.model.normal.residuals
        least = np.maximum(MATERIAL * choice.costs, np.maximum(VISIBLE * self.first.costs, MATERIAL * noise))
        return bool((gained >= least).all())

    def best(self, choice: Choice, progress: Progress) -> Choice | None:
        """Return the formula with the best additional term; None if no term can be fitted."""
        share = self._new_terms(choice) / MOST_STEPS
        progress = part(progress, share, share + 1.0 / MOST_STEPS)
        progress("terms tested on held-out data", 0.0)
        best: Choice | None = None
        for number, term in enumerate(self.shortlist(choice)[:CLOSEST]):
            progress(f"fit of {term.text} with its power", 0.5 + 0.5 * number / CLOSEST)
            try:
                tried = self.fitted(_with(choice.model.vehicle, [term.table(0.0)]), QUICK_STEPS)
            except (Diverges, np.linalg.LinAlgError):
                continue
            if best is None or tried.costs.max() < best.costs.max():
                best = tried
        return best

    def needed(self, choice: Choice) -> Choice:
        """Return the formula without terms that later terms made redundant; terms given in the file stay."""
        given = {
            text for table in self.baseline.vehicle.effects(FORMULA.name) for text, _, _ in amounts(table)
        }
        while True:
            parts = _terms(choice.model.vehicle)
            new = [k for k, part in enumerate(parts) if amounts(part)[0][0] not in given]
            if len(parts) < 2 or not new:
                return choice
            tries = []
            for number in new:
                rest = joined([one for k, one in enumerate(parts) if k != number])
                try:
                    tries.append(self.fitted(_replaced(choice.model.vehicle, rest), QUICK_STEPS))
                except (Diverges, np.linalg.LinAlgError):
                    continue
            least = min(tries, key=lambda one: float(one.costs.max()), default=None)
            noise, left = choice.model.normal.residuals, float(choice.costs.max())
            if least is None or least.costs.max() - left > max(NEGLIGIBLE * left, 0.5 * MATERIAL * noise):
                return choice
            choice = least


def discovered(
    vehicle: Vehicle, log: Preprocessed, diagnosis: Diagnosis, progress: Progress | None = None
) -> Diagnosis:
    """Return a diagnosis with a discovered formula if the catalogue leaves an unexplained residual.

    Returns:
        A diagnosis; that given if nothing is unexplained or no term reduces held-out error.  If the formula
        has a clearly smaller residual than the named forces, these become unconfirmed: they may imitate the
        law of the formula.
    """
    unnamed = any(one.verdict in UNEXPLAINED for one in diagnosis.findings)
    if not unnamed and not diagnosis.chi2[-1] > RIGHT:
        return diagnosis
    kept = [one for one in diagnosis.findings if one.verdict == "missing" and not _force(one)]
    equipped = extended(vehicle, [one.table for one in kept])
    found = discover(equipped, log, progress or silent)
    if found is None:
        return diagnosis
    formula, fit = found
    findings, left, leaves = diagnosis.findings, fit.chi2, diagnosis.chi2[-1]
    if left - 1.0 < NEARLY_EQUAL * (leaves - 1.0):
        findings = tuple(_doubted(one, left, leaves) for one in findings)
    new = [one for one in formula if one.effect not in {other.effect for other in findings}]
    estimates = fit.estimates().of_effects([one.effect for one in new]).after(diagnosis.estimates)
    whole = replace(diagnosis, findings=(*findings, *new), estimates=estimates)
    if left >= leaves:
        return whole
    return replace(whole, vehicle=fit.vehicle, chi2=(*diagnosis.chi2[:2], left))


def _force(finding: Finding) -> bool:
    """Return whether a finding is a force on the hull, which a formula can replace."""
    return bool(finding.effect) and CATALOGUE[finding.effect].kind == "wrench"


def _doubted(one: Finding, left: float, leaves: float) -> Finding:
    """Return a finding as unconfirmed if it names a force, since a formula has the smaller residual.

    The confidence in a force that was already unconfirmed is lowered only where the formula reaches the noise
    floor.

    `left` and `leaves` are the reduced chi-squares of the formula and of the diagnosis.
    """
    named = one.verdict == "missing" or (one.verdict == "suspect" and left <= RIGHT)
    if not (named and _force(one) and np.isfinite(one.confidence)):
        return one
    amounts_left = f"{left:.3g} instead of {leaves:.3g} times the noise variance"
    words = f"sparse terms without it have a smaller residual, {amounts_left}: see {FORMULA.name}"
    sure = one.confidence * max(left - 1.0, 0.0) / (leaves - 1.0)
    doubted = replace(one, confidence=sure, advice=f"{one.advice}; {words}")
    return unconfirmed(doubted) if one.verdict == "missing" else doubted


def discover(
    vehicle: Vehicle, log: Preprocessed, progress: Progress
) -> tuple[tuple[Finding, ...], Fit] | None:
    """Search a formula of sparse terms for the force that a vehicle file lacks.

    Returns:
        Findings of the formula and of the file's effects whose values changed with it, and their joint fit;
        None if the file explains the recording, or no term reduces the error on held-out sessions and
        regimes.
    """
    data, first = _begun(vehicle, log)
    if not first.model.normal.chi2 > 1.0 + MATERIAL:
        return None
    rounds: Rounds[Choice, Choice] = data
    choice = data.needed(grow(rounds, first, progress)[0])
    if choice is first:
        return None
    # The final fit weights the prior by the present reduced chi-square, not by the initial one.
    known = replace(data.known, temper=max(choice.model.normal.chi2, 1.0))
    choice = replace(data, known=known).fitted(choice.model.vehicle, ITERATIONS)
    fit = choice.model.estimated()
    return (_formula(first, choice, fit), *_retuned(vehicle, fit)), fit


def _begun(vehicle: Vehicle, log: Preprocessed) -> tuple[Discovery, Choice]:
    """Prepare the data, and fit the effects of the file within their prior, without a new term."""
    start, problem = stable_start(vehicle, log)
    baseline = refit(vehicle, log, problem, start)
    baseline = replace(baseline, problem=baseline.problem.some(SHOTS))
    refitted, known = tempered(baseline, baseline.problem)
    shots = baseline.problem.shots
    parts = (folds(shots.session), regimes_of(shots))
    data = Discovery(baseline, known.releasing(FORMULA.name), parts)
    first = Choice(refitted, data.transferred(refitted))
    return replace(data, first=first), first


def _retuned(file: Vehicle, fit: Fit) -> Iterator[Finding]:
    """Yield a finding for each effect whose values the joint fit moved far from those of the file."""
    entries = fit.free.entries
    change = (fit.values - in_file(file, entries)) / deviations(file, entries)
    for name in fit.free.effects:
        own = fit.free.places(name)
        if name == FORMULA.name or not (np.abs(change[own]) > FAR_FROM_PRIOR).any():
            continue
        farthest = change_of(name, file, fit.free, fit.values)
        words = f"belongs to the discovered terms, add both: {advice.retuning(name, farthest)}"
        yield Finding.of("suspect", name, fit.table(name), advice=words)


def _formula(first: Choice, choice: Choice, fit: Fit) -> Finding:
    """Return the formula as a finding.

    Its share is that of the held-out error which it removes, by sessions or by regimes, whichever is less.
    """
    model = choice.model
    table = fit.table(FORMULA.name)
    removed = first.left - choice.left
    which = int(np.argmin([np.nansum(one) for one in removed]))
    pieces = block_length(model.normal.score)
    both = np.isfinite(removed[which])
    share = explained_share(removed[which][both], first.left[which][both], pieces)
    words = (
        f"{told(*table)}; it removes {share[0]:.0%} of the held-out error. Check whether it is "
        f"physically plausible, then `hydro add --effect {FORMULA.name}`"
    )
    return Finding.of("suspect", FORMULA.name, table, share, advice=words)


def _most(normal: Normal, count: int, preferred: Sequence[float], known: Known, model: Model) -> list[int]:
    """Return the numbers of the terms that explain most of the error beyond the model's columns.

    Args:
        normal: Linearisation whose first `count` columns are those of the model, then one for each term.
        count: Number of columns of the model.
        preferred: Factor on the gain of each term.
        known: Prior of the values in the file.
        model: The model.

    Returns:
        At most 2 CONTENDERS numbers from 0, the best term first.
    """
    matrix, score = normal.matrix.sum(axis=0), normal.score.sum(axis=0)
    held = matrix[:count, :count] + np.diag(known(model.unknown).information)
    across = matrix[count:, :count]
    rest = score[count:] - across @ np.linalg.solve(held, score[:count]) if count else score[count:]
    size = np.diag(matrix)[count:]
    free = size - np.einsum("ij,ji->i", across, np.linalg.solve(held, across.T)) if count else size
    gain = np.where(free > 1e-6 * size, rest**2 / np.maximum(free, 1e-300), 0.0) * np.array(preferred)
    return [int(i) for i in np.argsort(-gain)[: 2 * CONTENDERS] if gain[i] > 0.0]


def _sizes(vehicle: Vehicle) -> list[float]:
    """Return the size of a large force by axis: weight [N], weight times length for moments [N m]."""
    weight = vehicle.rigid_body.mass * vehicle.environment.gravity
    return [weight] * 3 + [weight * vehicle.hull.length] * 3


def _with(vehicle: Vehicle, tables: Sequence[dict[str, Any]]) -> Vehicle:
    """Return the vehicle with terms added to its formula."""
    return _replaced(vehicle, joined([*vehicle.effects(FORMULA.name), *tables]))


def _replaced(vehicle: Vehicle, table: dict[str, Any]) -> Vehicle:
    """Return the vehicle with its formula replaced."""
    rest = tuple(effect for effect in vehicle.effect if effect["name"] != FORMULA.name)
    return msgspec.structs.replace(vehicle, effect=(*rest, table))


def _terms(vehicle: Vehicle) -> list[dict[str, Any]]:
    """Return the formula of a vehicle as one table per term."""
    tables = vehicle.effects(FORMULA.name)
    return [one_term(*one) for table in tables for one in amounts(table)]
