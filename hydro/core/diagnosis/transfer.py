"""Ranking of effects by transfer: the error that an effect removes from held-out data.

Where no model reaches the noise, likelihood compares wrong models, and the most flexible wins.  Physics also
holds on other data: a real effect removes error in sessions and regimes of motion to which it was not fitted.
An effect that merely absorbs the hull's error does not.  Every hull has drag: in a file without drag that
grows faster than speed, drag is named before faults that could imitate it.

Every effect is fitted together with the existing effects, which have priors about the file's values.  Where
the file states a standard error of each existing effect, these values stay fixed and one change at a time is
tested (`one_change`).  If free, they would absorb the missing effect and hide the evidence for it.

An effect that absorbs the hull's error can transfer as well, because the hull is present in all regimes.  So
an effect may have evidence with the hull force free (`residual.allowance`), and the rank may be by that.

The squared residual is tempered: divided by its mean and by the length of its autocorrelation.  Otherwise the
prior would have no weight against ten thousands of correlated residuals.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.baseline import Baseline
from hydro.core.diagnosis.confidence import folds, left_out_costs
from hydro.core.diagnosis.model import Diverges, Model, begun, continue_fit, fit_model, stepped
from hydro.core.diagnosis.search import most_gain
from hydro.core.diagnosis.settings import (
    CORRELATED,
    FAR_FROM_NOISE,
    FOLDS,
    LEAST_EVIDENCE,
    LEAST_INFORMATION,
    MATERIAL,
    NEARLY_EQUAL,
    QUICK_STEPS,
    RESOLUTION,
    SHOTS,
    SUSPECT_SPREAD,
    VISIBLE,
)
from hydro.core.effects import CATALOGUE
from hydro.core.effects.catalogue import wholly_known
from hydro.core.effects.hull_laws import DRAG, has_drag, is_hull_law
from hydro.core.effects.record import Table
from hydro.core.evaluation.replay_error import BEYOND
from hydro.core.evaluation.velocity_errors import Squares, squares_ahead
from hydro.core.identification.levenberg_marquardt import Prior
from hydro.core.identification.outcome import Fit
from hydro.core.identification.prior import deviations, in_file, stated
from hydro.core.identification.suspects import suspects, with_one_value
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import Free, free
from hydro.core.progress import Progress
from hydro.core.recording.shots import Shots
from hydro.core.residual.allowance import Held
from hydro.core.threads import shared
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Rival:
    """Effect of a survey, fitted together with the file's existing effects.

    Attributes:
        effect: Name of the effect.
        own: Whether the file has the effect.
        model: Vehicle with the effect, with refitted values if the file has it.
        sessions: Share of the error of held-out sessions or stretches that the effect removes.
        regimes: Share of the error of held-out regimes of motion that the effect removes.
        absorbs: Share of the held-out error that the effect removes from a hull that no formula describes, if
            nothing else is missing.
        evidence: Log evidence with the hull force free, beyond that of the file alone, times `beyond`; 0
            where it was not computed.
        allowed: Posterior of the model's components, in their order, with the hull force free; None where it
            was not computed.
    """

    effect: str
    own: bool
    model: Model
    sessions: float
    regimes: float
    absorbs: float = 0.0
    evidence: float = 0.0
    allowed: Held | None = None

    @property
    def entries(self) -> int:
        """Number of parameters of the effect."""
        return len(self.model.unknown.places(self.effect))

    @property
    def score(self) -> float:
        """Lesser of the shares `sessions` and `regimes`, beyond the share that the effect absorbs."""
        return (min(self.sessions, self.regimes) - self.absorbs) / (1.0 - self.absorbs)

    @property
    def values(self) -> Array:
        """Values of all fitted components, with the hull force free if that was computed."""
        return self.model.values if self.allowed is None else self.allowed.best

    def estimated(self) -> Fit:
        """Return the values of the model's components and their standard errors."""
        fit = replace(self.model, values=self.values).estimated()
        return fit if self.allowed is None else fit.with_covariance(self.allowed.covariance)

    @property
    def lead(self) -> float:
        """Evidence that counts against other effects: of a hull law, the excess over LEAST_EVIDENCE."""
        return self.evidence - (LEAST_EVIDENCE if self.of_hull else 0.0)

    @property
    def of_hull(self) -> bool:
        """Whether the effect is a law of the hull's forces."""
        return is_hull_law(self.effect)

    @property
    def beyond(self) -> float:
        """Part of the removed error that the effect does not merely absorb; 0 if it removes nothing."""
        return self.score / min(self.sessions, self.regimes) if self.score > 0.0 else 0.0


@dataclass(frozen=True)
class Survey:
    """Fits of all effects of the catalogue to one recording, with their ranks.

    Attributes:
        refitted: Existing effects, fitted within their priors.
        rivals: Every effect that could be fitted, the best first: by score less a penalty for its components,
            or by evidence.
        by_evidence: Whether `leading` is ranked by evidence.
        leading: Effects that may be named, the best first.
    """

    refitted: Model
    rivals: tuple[Rival, ...]
    by_evidence: bool
    leading: tuple[Rival, ...]

    def worth(self, rival: Rival) -> float:
        """Return a rival's score, or with ranks by evidence its evidence as a share of the best one's."""
        return rival.evidence / self.leading[0].evidence if self.by_evidence else rival.score

    def alternatives(self, rival: Rival, passed: Collection[str]) -> list[Rival]:
        """Return the effects that may be named instead of one, without those that were passed over.

        Effects outside `leading` predict longer stretches clearly worse, so that no confidence counts a lead
        over them.
        """
        return [one for one in self.leading if one is not rival and one.effect not in passed]


@dataclass(frozen=True)
class Known:
    """Function from the components of a fit to their priors.

    Attributes:
        file: Vehicle file.
        temper: Mean squared residual of the fit, at least 1, by which the residual is divided.
        released: Effects of the file that may have any plausible values.
    """

    file: Vehicle
    temper: float
    released: frozenset[str] = frozenset()

    def releasing(self, effect: str) -> Known:
        """Return priors in which one effect alone may have any plausible values."""
        return replace(self, released=frozenset({effect}))

    def __call__(self, unknown: Free) -> Prior:
        """Return normal priors about the file's values, and about 0 for new effects, tempered."""
        prior = self.alone(unknown)
        return replace(prior, information=CORRELATED * self.temper * prior.information)

    def alone(self, unknown: Free) -> Prior:
        """Return the priors of the components, in units of their scales, as for a residual of white noise."""
        scales = unknown.scales
        spread = deviations(self.file, unknown.entries) / scales
        names = np.array([entry.effect for entry in unknown.entries])
        new = np.array([not self.file.effects(name) or name in self.released for name in names], bool)
        spread[new] = SUSPECT_SPREAD
        centre = unknown.within(in_file(self.file, unknown.entries)) / scales
        return Prior(centre, spread**-2.0)


def one_change(baseline: Baseline) -> Baseline:
    """Return the baseline with its existing effects fixed, if the file states an uncertainty of each.

    Otherwise return it unchanged.
    """
    file, own = baseline.beforehand, baseline.effects
    known = all(
        file.effects(name) and np.isfinite(stated(file, free(file, [name]).entries)).any() for name in own
    )
    return replace(baseline, effects=()) if known else baseline


def resolved(problem: OutputError) -> OutputError:
    """Return shots with the standard deviation of each channel's noise at least RESOLUTION."""
    return problem.weighed(np.maximum(problem.shots.sigma, RESOLUTION))


def survey(baseline: Baseline, progress: Progress, near: Mapping[str, Table]) -> Survey:
    """Fit each effect of the catalogue together with the existing ones; return all fits, the best first.

    Each is scored by the error that it removes from held-out data.

    The shots of the baseline start at the measured states.  `near` has tables of effects that are already
    fitted to them, which are better starting values than the linearised ones.
    """
    file, own, reach = baseline.vehicle, baseline.effects, baseline.log.track
    problem = baseline.problem.some(SHOTS // 2)
    labels = (folds(problem.shots.session), regimes_of(problem.shots))
    refitted, known = tempered(baseline, problem)

    def without(name: str) -> Rival | None:
        """Return an existing effect compared with its values in the file; None where the fit diverges."""
        try:
            held = fit_model(file, [n for n in own if n != name], problem, reach, QUICK_STEPS, known=known)
        except Diverges:
            return None
        return _rival(name, refitted, held, known, labels, own=True)

    def beside(one: tuple[str, dict[str, Any]]) -> Rival | None:
        """Return an effect fitted from a starting table; None where the fit diverges."""
        name, released = one[0], known.releasing(one[0])
        try:
            model = fit_model(file, [*own, one[1]], problem, reach, QUICK_STEPS, known=released)
        except Diverges:
            return None
        found = _rival(name, model, refitted, released, labels, own=bool(file.effects(name)))
        table = with_one_value(model.vehicle, name, file)
        common = beside((name, table)) if table is not None else None
        return ranked([found] if common is None else [found, common])[0]

    candidates = _beginnings(baseline, refitted, known) | dict(near)
    fits = list(shared(without, own))
    for number, (name, rival) in enumerate(zip(candidates, shared(beside, candidates.items()), strict=True)):
        progress(f"{name} tested on held-out data", number / len(candidates))
        fits.append(rival)
    rivals = [rival for rival in fits if rival is not None]
    found = ranked([weighed(one) for one in rivals]) if has_drag(file) else ranked(rivals, DRAG)
    return Survey(refitted, found, by_evidence=False, leading=found)


def weighed(rival: Rival) -> Rival:
    """Return a copy of a rival whose `absorbs` is the catalogue's, so that this share does not count.

    This is for a file that has drag, and so describes the hull.
    """
    return replace(rival, absorbs=CATALOGUE[rival.effect].identification.absorbs)


def ranked(rivals: Sequence[Rival], first: AbstractSet[str] = frozenset()) -> tuple[Rival, ...]:
    """Return rivals, the best first, by score less a penalty for each component.

    The best effect of `first` comes before all others if it has a share NEARLY_EQUAL of the best score.
    """
    order = sorted(rivals, key=lambda one: VISIBLE * one.entries - one.score)
    best = order[0].score if order else 0.0
    for one in order:
        if one.effect in first and one.score >= NEARLY_EQUAL * best > 0.0:
            order.remove(one)
            order.insert(0, one)
            break
    return tuple(order)


def tempered(baseline: Baseline, problem: OutputError) -> tuple[Model, Known]:
    """Fit the existing effects within their priors, from the file's values.

    The priors are weighted by the mean squared residual of that fit (`Known.temper`), so the fit is made
    twice.

    Returns:
        The fit and the priors with its residual.
    """
    vehicle, own, reach = baseline.vehicle, list(baseline.effects), baseline.log.track
    model = fit_model(vehicle, [], problem, reach, 0)
    for _ in range(2):
        known = Known(baseline.beforehand, max(model.normal.chi2, 1.0))
        model = fit_model(vehicle, own, problem, reach, QUICK_STEPS, known=known)
    return model, Known(baseline.beforehand, max(model.normal.chi2, 1.0))


def regimes_of(shots: Shots) -> Rows:
    """Return the number of the regime of motion of each of S shots, (S,).

    A regime is the axis and the sign of the largest mean velocity, relative to the velocities of all shots.
    """
    nu = shots.measured[..., 7:]
    with np.errstate(invalid="ignore"):
        size = np.sqrt(np.nanmean(nu**2, axis=(0, 1))) + 1e-12
        mean = np.nan_to_num(np.nanmean(nu, axis=1) / size)
    axis = np.abs(mean).argmax(axis=1)
    return np.asarray(2 * axis + (mean[np.arange(len(mean)), axis] > 0.0), np.int64)


def left_out(model: Model, known: Known, fold: Rows, new: Sequence[int] = ()) -> Array:
    """Return the held-out squared residual of each of S shots, with components held to their priors, (S,).

    Each is predicted by one Gauss-Newton step to the fit of all other folds.  It is NaN where those folds
    keep less than a share LEAST_INFORMATION of the information on the components `new`.

    Args:
        model: Fitted model.
        known: Priors of its components.
        fold: Number of the fold that each shot is held out with, (S,).
        new: Components that the other folds must determine.
    """
    prior = known(model.unknown)
    moved = model.values / model.unknown.scales - prior.centre
    return left_out_costs(model.normal, fold, moved, prior.information, new, LEAST_INFORMATION)


def left_out_squares(vehicle: Vehicle, effects: Sequence[str], problem: OutputError, ahead: Shots) -> Squares:
    """Return the squared errors of predicting each stretch with a fit of effects to the other stretches.

    Args:
        vehicle: Vehicle with the fitted values.
        effects: Names of the fitted effects.
        problem: Shots of the fit, starting at the measured states.
        ahead: Shots of the same recording that are predicted, as long as the horizon of the error.

    Returns:
        Sums of squared velocity errors and numbers of samples, per shot of `ahead` and axis.  Where a fit
        diverges, all errors are those of velocities BEYOND all bounds.
    """
    fitted = [name for name in effects if not CATALOGUE[name].is_random]
    if not fitted:
        return squares_ahead(vehicle, ahead)
    fold, shots = _predicted_together(problem.shots), problem.shots
    fold = fold * FOLDS // max(int(fold.max()) + 1, FOLDS)
    within = fold[np.maximum(np.searchsorted(shots.starts, ahead.starts, side="right") - 1, 0)]
    sums, counts = np.zeros((2, len(ahead.starts), 6))
    numbers = np.unique(fold)

    def predicted(number: int) -> Squares:
        """Return the squared errors of the stretches of one fold."""
        return squares_ahead(stepped(whole.over(fold != number)), ahead.of(within == number))

    try:
        whole = continue_fit(begun(vehicle, fitted, problem, np.zeros((1, 3))), QUICK_STEPS // 2)
        for number, found in zip(numbers, shared(predicted, numbers), strict=True):
            sums[within == number], counts[within == number] = found.sums, found.counts
    except Diverges:
        return Squares(np.broadcast_to(BEYOND[6:] ** 2, sums.shape), np.ones(sums.shape))
    return Squares(sums, counts)


def _predicted_together(shots: Shots) -> Rows:
    """Return the number of the part of each of S shots that is predicted by a fit to the others, (S,).

    It is the session, or a stretch where one session has most of the shots.  A disturbance may last for a
    session, so stretches of one session do not show whether a model transfers.
    """
    _, label, count = np.unique(shots.session, return_inverse=True, return_counts=True)
    enough = len(label) - count.max() >= LEAST_INFORMATION * len(label)
    return np.asarray(label, np.int64) if enough else folds(shots.session)


def _rival(
    name: str, model: Model, without: Model, known: Known, labels: tuple[Rows, Rows], *, own: bool
) -> Rival:
    """Score an effect against the model without it.

    Args:
        name: Name of the effect.
        model: Model with the effect.
        without: Model without the effect, or with the file's values of it.
        known: Priors of the components.
        labels: Numbers of the parts to hold out for each of S shots: sessions and regimes, (S,) each.
        own: Whether the file has the effect.
    """
    new = model.unknown.places(name)
    shares = []
    for fold in labels:
        before = left_out(without, known, fold) if without.unknown.entries else without.costs
        after = left_out(model, known, fold, new)
        both = np.isfinite(before) & np.isfinite(after)
        excess = (before - without.normal.freedoms)[both].sum()
        shares.append(float((before - after)[both].sum() / excess) if excess > 0.0 else 0.0)
    return Rival(name, own, model, shares[0], shares[1])


def _beginnings(baseline: Baseline, refitted: Model, known: Known) -> dict[str, dict[str, Any]]:
    """Return the starting table of each effect: its best shape, with values from the linearised problem.

    Far from the noise, effects are left out that cannot remove a MATERIAL share of the error.
    """
    file, own = baseline.vehicle, baseline.effects
    tried = suspects(file, without=own, reach=baseline.log.track)
    screening = baseline.screened(refitted, tried)
    weight, held, tables = CORRELATED * known.temper, known(refitted.unknown).information, {}
    least = MATERIAL * refitted.excess if baseline.refitted.normal.chi2 > FAR_FROM_NOISE else -np.inf
    for name, (_, columns) in screening.ranked.items():
        if most_gain(name, screening.gains[name]) < least:
            continue
        new = np.full(len(columns), weight * SUSPECT_SPREAD**-2)
        tables[name] = screening.beginning(name, np.concatenate([held, new]))
    for table in file.effect:  # effects of the file that have no grid start from their values
        name = str(table["name"])
        if name not in own and not wholly_known(file, name):
            tables.setdefault(name, dict(table))
    return tables
