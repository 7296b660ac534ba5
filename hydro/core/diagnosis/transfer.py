"""Names by transfer: what an effect removes of the error on data that it was not fitted to.

Where no model reaches the noise, likelihoods compare how well wrong models bend, and the most flexible wins.
Physics holds elsewhere too: an effect that is there removes error in sessions and in regimes of motion that
had no part in its values, and one that merely absorbs the hull's own error does not.  Drag is on every hull:
where a file says nothing of any that grows faster than speed, it comes before faults that could pass for it.

Every effect is fitted together with the file's own, from the values of the file, which hold to what is known
of them.  Where the file states how well it knows all of its own, they were fitted before, to what the hull
does, and stay as they are: one change at a time is held against the file (`one_change`).  Free, they take up
what is missing, and with it what would tell of it.

What bends to the hull's own error may transfer, too: the hull goes through all regimes.  So a rival may have
its evidence beside what a hull may do (`residual.allowance`), and the order may be by that.

The squared residual is tempered: divided by its own mean and by the length for which errors of a model last,
so that what is known weighs something beside ten thousands of numbers that err alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.baseline import Baseline
from hydro.core.diagnosis.confidence import Fitted, folds, left_out_costs
from hydro.core.diagnosis.contenders import FINE
from hydro.core.diagnosis.model import Diverges, Model, begun, fit_model, gone_on
from hydro.core.diagnosis.search import Search
from hydro.core.effects import CATALOGUE
from hydro.core.effects.catalogue import wholly_known, with_role
from hydro.core.effects.record import Role
from hydro.core.evaluation.replay_error import BEYOND
from hydro.core.identification.levenberg_marquardt import Prior
from hydro.core.identification.outcome import Fit
from hydro.core.identification.prior import deviations, in_file, stated
from hydro.core.identification.suspects import suspects
from hydro.core.prediction import multiple_shooting
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import Free, free
from hydro.core.progress import Progress
from hydro.core.recording.arrays import Recording
from hydro.core.recording.shots import Shots
from hydro.core.residual.allowance import Held
from hydro.core.threads import shared
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation_from_quaternion

CORRELATED = 10.0
"""Numbers of a shot that err alike where a model is wrong."""
SUSPECT = 2.0
"""Standard deviation of an effect that may be missing, in scales about its absence."""
SURVEY_SHOTS = 48
"""Shots on which all effects are fitted."""
STEPS = 4
"""Of a fit in the survey."""
RESOLUTION = np.repeat([0.005, 0.001, 0.005, 0.002], 3)
"""Least deviation of position [m], attitude [rad], velocity [m/s] and rates [rad/s]: no sensor is truer, a
filtered log only smoother."""
FOLDS = 6
"""Parts at most of which each is left out of a fit once."""
AGAIN = 3
"""Steps from a fit to all shots to one where some are left out."""
DRAG = frozenset(with_role(Role.DRAG))
BEFORE_OTHERS = 0.7
"""Part of the best score from which drag is named first where the file has none."""
KEPT = 1.0 / 3.0
"""Part of an effect's information that must remain where a regime is left out, and of the shots where a
session is."""
GAPS = 30.0
"""Logarithm of the evidence that a law of the hull may have of an unchanged one that no library holds,"""
HULLS = ("inertia", "damping", "hull", "memory")
"""and families of effects that are such laws."""


@dataclass(frozen=True)
class Rival:
    """An effect, fitted together with the file's own.

    Attributes:
        effect: Its name.
        own: Whether the file has it.
        model: The vehicle with it, or with its own values anew.
        sessions: Share of the error of left-out sessions or stretches that it removes.
        regimes: The same of left-out regimes of motion.
        absorbs: Share that such an effect absorbs of a hull that no formula describes.
        evidence: Its logarithm beside what the hull may do, beyond that of the file alone, by as much of what
            it removes as such an effect does not absorb; 0 where none is asked for.
        allowed: How its values and those fitted with it stand there, in the order of the model's entries.
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
        """How many numbers it has."""
        return sum(entry.effect == self.effect for entry in self.model.unknown.entries)

    @property
    def score(self) -> float:
        """The lesser of both, beyond what such an effect absorbs."""
        return (min(self.sessions, self.regimes) - self.absorbs) / (1.0 - self.absorbs)

    @property
    def values(self) -> Array:
        """Of its entries and those fitted with it, beside what the hull may do where that was asked for."""
        return self.model.values if self.allowed is None else self.allowed.best

    def estimated(self) -> Fit:
        """Its values and their standard errors."""
        fit = replace(self.model, values=self.values).estimated()
        if self.allowed is None:
            return fit
        spread = self.allowed.covariance
        return replace(fit, covariance=spread, standard_errors=np.sqrt(np.diag(spread)))

    @property
    def lead(self) -> float:
        """Evidence that counts for a lead: of a law of the hull itself, beyond GAPS of the library."""
        return self.evidence - (GAPS if CATALOGUE[self.effect].family in HULLS else 0.0)

    @property
    def beyond(self) -> float:
        """Part of what it removes that such an effect does not absorb; 0 where it removes nothing."""
        return self.score / min(self.sessions, self.regimes) if self.score > 0.0 else 0.0


@dataclass(frozen=True)
class Survey:
    """All effects of the catalogue about one file.

    Attributes:
        refitted: The file's own effects, fitted within what is known of them.
        rivals: Every effect that could be fitted, the best first: by its score less a fine for its entries,
            or by its evidence.
        by_evidence: Whether it is by that.
    """

    refitted: Model
    rivals: tuple[Rival, ...]
    by_evidence: bool = False

    def worth(self, rival: Rival) -> float:
        """How good one is: its score, or its evidence as a share of the best."""
        return rival.evidence / self.rivals[0].evidence if self.by_evidence else rival.score


@dataclass(frozen=True)
class Known:
    """What is known of the entries of a fit, for a file and a mean squared residual.

    Attributes:
        file: The vehicle file.
        temper: Mean squared residual per number, at least 1.
        released: Effects of the file that may have any plausible values.
    """

    file: Vehicle
    temper: float
    released: frozenset[str] = frozenset()

    def releasing(self, effect: str) -> Known:
        """The same, but that one effect may have any plausible values."""
        return replace(self, released=frozenset({effect}))

    def __call__(self, unknown: Free) -> Prior:
        """Normal priors about the values of the file, and about the absence of what it has not, tempered."""
        prior = self.alone(unknown)
        return replace(prior, information=CORRELATED * self.temper * prior.information)

    def alone(self, unknown: Free) -> Prior:
        """The same as they are."""
        scales = unknown.scales
        spread = deviations(self.file, unknown.entries) / scales
        names = np.array([entry.effect for entry in unknown.entries])
        new = np.array([not self.file.effects(name) or name in self.released for name in names], bool)
        spread[new] = SUSPECT
        centre = unknown.within(in_file(self.file, unknown.entries)) / scales
        return Prior(centre, spread**-2.0)


def one_change(baseline: Baseline) -> Baseline:
    """The baseline with none of its own effects free, where its file says how well it knows each of them."""
    file, own = baseline.beforehand, baseline.effects
    known = all(
        file.effects(name) and np.isfinite(stated(file, free(file, [name]).entries)).any() for name in own
    )
    return replace(baseline, effects=()) if known else baseline


def resolved(problem: OutputError) -> OutputError:
    """The problem with no channel weighed by less than RESOLUTION."""
    return problem.weighed(np.maximum(problem.shots.sigma, RESOLUTION))


def survey(baseline: Baseline, progress: Progress | None = None) -> Survey:
    """Fit every effect of the catalogue together with the file's own, and score it by what transfers.

    Args:
        baseline: The vehicle file and the shots, begun where the recording saw the vehicle.
        progress: Called with a few words and the share of the work done.
    """
    file, own, reach = baseline.vehicle, baseline.effects, baseline.log.track
    problem = baseline.problem.some(SURVEY_SHOTS)
    labels = (sessions_of(problem.shots), regimes_of(problem.shots))
    refitted, known = tempered(baseline, problem)

    def without(name: str) -> Rival | None:
        """One of the file's own effects against its values there; None where the fit diverges."""
        try:
            held = fit_model(file, [n for n in own if n != name], problem, reach, STEPS, known=known)
        except Diverges:
            return None
        return _rival(name, refitted, held, known, labels, own=True)

    def beside(one: tuple[str, dict[str, Any]]) -> Rival | None:
        """An effect from a table to begin with; None where the fit diverges."""
        name, released = one[0], known.releasing(one[0])
        try:
            model = fit_model(file, [*own, one[1]], problem, reach, STEPS, known=released)
        except Diverges:
            return None
        return _rival(name, model, refitted, released, labels, own=bool(file.effects(name)))

    candidates, found = _beginnings(baseline, refitted, known), list(shared(without, own))
    for number, (name, rival) in enumerate(zip(candidates, shared(beside, candidates.items()), strict=True)):
        if progress is not None:
            progress(f"{name} was held against data that it was not fitted to", number / len(candidates))
        found.append(rival)
    rivals = [rival for rival in found if rival is not None]
    if dragged(file):
        return Survey(refitted, ranked([weighed(one) for one in rivals]))
    return Survey(refitted, ranked(rivals, DRAG))


def dragged(file: Vehicle) -> bool:
    """Whether a file says anything of drag that grows faster than speed."""
    return any(file.effects(name) for name in DRAG)


def weighed(rival: Rival) -> Rival:
    """The rival where the file describes the hull: only what it removes beyond what it absorbs counts."""
    return replace(rival, absorbs=CATALOGUE[rival.effect].identification.absorbs)


def ranked(rivals: Sequence[Rival], first: AbstractSet[str] = frozenset()) -> tuple[Rival, ...]:
    """By score less a fine for each entry; the best of those that are to come `first` does so, before all.

    They come so from BEFORE_OTHERS of the best score on.
    """
    order = sorted(rivals, key=lambda one: FINE * one.entries - one.score)
    best = order[0].score if order else 0.0
    for one in order:
        if one.effect in first and one.score >= BEFORE_OTHERS * best > 0.0:
            order.remove(one)
            order.insert(0, one)
            break
    return tuple(order)


def tempered(baseline: Baseline, problem: OutputError) -> tuple[Model, Known]:
    """The file's own effects fitted within what is known of them, from the values of the file.

    The temper is that of what the fit itself leaves: found twice.
    """
    vehicle, own, reach = baseline.vehicle, list(baseline.effects), baseline.log.track
    model = fit_model(vehicle, [], problem, reach, 0)
    for _ in range(2):
        known = Known(baseline.beforehand, max(model.normal.chi2, 1.0))
        model = fit_model(vehicle, own, problem, reach, STEPS, known=known)
    return model, Known(baseline.beforehand, max(model.normal.chi2, 1.0))


def sessions_of(shots: Shots) -> Rows:
    """What is left out together first: sessions, or stretches where there are few."""
    return folds(shots.session)


def regimes_of(shots: Shots) -> Rows:
    """Regime of motion of each shot: its largest mean velocity, in units of the log's, and its sign, (S,)."""
    nu = shots.measured[..., 7:]
    with np.errstate(invalid="ignore"):
        size = np.sqrt(np.nanmean(nu**2, axis=(0, 1))) + 1e-12
        mean = np.nan_to_num(np.nanmean(nu, axis=1) / size)
    axis = np.abs(mean).argmax(axis=1)
    return np.asarray(2 * axis + (mean[np.arange(len(mean)), axis] > 0.0), np.int64)


def left_out(model: Model, known: Known, fold: Rows, new: Sequence[int] = ()) -> Array:
    """Squared residual of each shot, see `confidence.left_out_costs`, the entries held to what is known.

    NaN where the other folds keep less than KEPT of the information on the entries `new`.
    """
    prior = known(model.unknown)
    moved = model.values / model.unknown.scales - prior.centre
    return left_out_costs(Fitted(model.normal, moved, prior.information), fold, new, KEPT)


@dataclass(frozen=True)
class Squares:
    """Squared prediction errors of the velocities over stretches of a recording.

    Attributes:
        sums: Sum over each stretch, (S, 6) [m^2/s^2, rad^2/s^2].
        counts: Number of samples in each, (S, 6).
    """

    sums: Array
    counts: Array

    @property
    def mean(self) -> Array:
        """Mean squared error on each axis, (6,)."""
        average: Array = self.sums.sum(axis=0) / np.maximum(self.counts.sum(axis=0), 1.0)
        return average

    def error(self, weights: Array) -> float:
        """Root mean square error of all axes together [m/s].

        Args:
            weights: Of the axes, (6,).
        """
        return float(np.sqrt(weights @ self.mean))


def left_out_squares(vehicle: Vehicle, effects: Sequence[str], problem: OutputError, ahead: Shots) -> Squares:
    """Predict each stretch of a recording by a fit of effects to the others.

    Args:
        vehicle: The vehicle with the fitted values.
        effects: Names of what was fitted.
        problem: The shots that are fitted to, begun where the vehicle's log has it.
        ahead: Predictions over the same recording, as far ahead as the error is to tell of.

    Returns:
        The squared errors; those of velocities BEYOND all bounds where a fit diverges.
    """
    fitted = [name for name in effects if not CATALOGUE[name].is_random]
    if not fitted:
        return squares_ahead(vehicle, ahead)
    fold, shots = _predicted_together(problem.shots), problem.shots
    fold = fold * FOLDS // max(int(fold.max()) + 1, FOLDS)
    within = fold[np.maximum(np.searchsorted(shots.starts, ahead.starts, side="right") - 1, 0)]
    whole = begun(vehicle, fitted, problem, np.zeros((1, 3)))

    def predicted(number: int) -> Squares:
        """Squared errors of the stretches of one fold."""
        there = gone_on(whole.over(fold != number), AGAIN).vehicle
        return squares_ahead(there, ahead.of(within == number))

    sums, counts = np.zeros((2, len(ahead.starts), 6))
    numbers = np.unique(fold)
    try:
        for number, found in zip(numbers, shared(predicted, numbers), strict=True):
            sums[within == number], counts[within == number] = found.sums, found.counts
    except Diverges:
        return Squares(np.broadcast_to(BEYOND[6:] ** 2, sums.shape), np.ones(sums.shape))
    return Squares(sums, counts)


def _predicted_together(shots: Shots) -> Rows:
    """Return the session of each shot, (S,), or its stretch where one session has most of the shots.

    A disturbance may last for a session: stretches of one session do not show whether a model transfers.
    """
    _, label, count = np.unique(shots.session, return_inverse=True, return_counts=True)
    enough = len(label) - count.max() >= KEPT * len(label)
    return np.asarray(label, np.int64) if enough else sessions_of(shots)


def squares_ahead(vehicle: Vehicle, ahead: Shots) -> Squares:
    """Return the squared errors of the velocities that a vehicle as it is predicts.

    Args:
        vehicle: The vehicle.
        ahead: What it predicts.
    """
    count = len(ahead.starts)
    if not count:
        return Squares(np.zeros((0, 6)), np.zeros((0, 6)))
    model = candidate(vehicle)
    shots = multiple_shooting.corrected_first(ahead, model)
    return _squares(multiple_shooting.predict(multiple_shooting.prepare(model, shots), shots), shots)


def squares_at_rest(ahead: Shots) -> Squares:
    """Return the squared errors of zero velocity over the same stretches."""
    states = np.repeat(ahead.first[:, None], ahead.measured.shape[1], axis=1)
    states[..., 7:] = 0.0
    return _squares(states, ahead)


def _squares(predicted: Array, shots: Shots) -> Squares:
    """Return the squared errors of predicted states, (S, T, 13), over shots.

    A velocity without samples is judged by the way that is gone, over the time of a stretch, where the
    position on its axis has samples.
    """
    error = predicted[..., 7:] - shots.measured[..., 7:]
    seen = np.ones(error.shape, bool) if shots.seen is None else shots.seen[..., 6:].copy()
    if shots.seen is not None and (axes := by_way(shots.record)).size:
        way = (predicted[..., :3] - shots.measured[..., :3]) * shots.seen[..., :3]
        body = np.einsum("sij,sti->stj", rotation_from_quaternion(shots.first[:, 3:7]), way)
        error[..., axes] = body[..., axes] / (error.shape[1] * shots.record.dt)
        seen[..., axes] = shots.seen[..., axes]
    error, seen = error[:, shots.lead :], seen[:, shots.lead :]
    squares = np.clip(np.nan_to_num(error, nan=np.inf), -BEYOND[6:], BEYOND[6:]) ** 2
    return Squares((squares * seen).sum(axis=1), seen.sum(axis=1).astype(np.float64))


def by_way(record: Recording) -> Rows:
    """Return the linear axes, of 0 to 2, whose position has samples and whose velocity has none."""
    if record.seen is None:
        return np.zeros(0, np.int64)
    shown = np.asarray(record.seen.any(axis=0), bool)
    return np.asarray(np.flatnonzero(shown[:3] & ~shown[6:9]), np.int64)


def _rival(
    name: str, model: Model, without: Model, known: Known, labels: tuple[Rows, Rows], *, own: bool
) -> Rival:
    """An effect scored against the model without it, or with the values that the file has of it."""
    new = [i for i, entry in enumerate(model.unknown.entries) if entry.effect == name]
    shares = []
    for fold in labels:
        before = left_out(without, known, fold) if without.unknown.entries else without.costs
        after = left_out(model, known, fold, new)
        both = np.isfinite(before) & np.isfinite(after)
        excess = (before - without.normal.freedoms)[both].sum()
        shares.append(float((before - after)[both].sum() / excess) if excess > 0.0 else 0.0)
    return Rival(name, own, model, shares[0], shares[1])


def _beginnings(baseline: Baseline, refitted: Model, known: Known) -> dict[str, dict[str, Any]]:
    """The table that a fit of each effect begins from: its best shape, as the linearised problem has it."""
    file, own = baseline.vehicle, baseline.effects
    tried = suspects(file, without=own, reach=baseline.log.track)
    screening = Search(baseline).screened(refitted, tried)
    weight, held, tables = CORRELATED * known.temper, known(refitted.unknown).information, {}
    for name, (_, columns) in screening.ranked.items():
        new = np.full(len(columns), weight * SUSPECT**-2)
        tables[name] = screening.beginning(name, np.concatenate([held, new]))
    for table in file.effect:  # effects of the file of which no grid tells begin from its values
        name = str(table["name"])
        if name not in own and not wholly_known(file, name):
            tables.setdefault(name, dict(table))
    return tables
