"""Changes between two recordings of one vehicle whose hull no file describes exactly.

The hull-force error of the file is learnt from the earlier recording and held fixed in the later one
(`core.residual`), so that only the change remains.  The file's effects keep their values; a
change of them is a candidate like any other.  The unit of all residuals is the floor: the residual of the
hull model on held-out stretches of the earlier recording.  A smaller effect is not visible.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import msgspec
import numpy as np
import scipy

from hydro.core.columns import Array
from hydro.core.diagnosis.confidence import explained_share, folds, lead_confidence, wins
from hydro.core.diagnosis.contenders import Compared, Contender, Contest, is_further, leading, relative_gain
from hydro.core.diagnosis.doubts import limited_confidence, unconfirmed
from hydro.core.diagnosis.findings import Diagnosis, Finding, extended
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Diverges, Model, held_at, unfitted
from hydro.core.diagnosis.mounting import with_mounting
from hydro.core.diagnosis.onset import Onset, onset
from hydro.core.diagnosis.provisional import Provisional, Told
from hydro.core.diagnosis.selection import Rounds, grow
from hydro.core.diagnosis.sensor_errors import new_sensor_errors, sensor_finding
from hydro.core.diagnosis.settings import (
    ABSORBED,
    CHANGED,
    DOUBTFUL,
    MATERIAL,
    MOST_FINDINGS,
    NEGLIGIBLE,
    QUICK_STEPS,
    RIGHT,
    SURE,
    SUSPECT_SPREAD,
)
from hydro.core.effects import CATALOGUE
from hydro.core.effects.damping import LINEAR_DAMPING
from hydro.core.effects.record import Role
from hydro.core.errors import listed
from hydro.core.experiment import advice
from hydro.core.identification.levenberg_marquardt import Prior, linearised
from hydro.core.identification.outcome import Fit, with_response_error
from hydro.core.identification.prior import change_of, in_file
from hydro.core.identification.suspects import is_curved
from hydro.core.prediction.parameters import Entry, free
from hydro.core.preprocessing.sensor_tests import KinematicTest, kinematic_tests
from hydro.core.progress import Progress, part
from hydro.core.residual.hull import Hull
from hydro.core.residual.imitation import imitations
from hydro.core.residual.joint_posterior import joint_posterior
from hydro.core.residual.regression import robust
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class ByChange:
    """Regime of a diagnosis with an earlier recording, from which the hull-force error is learnt.

    Sensor errors that kinematics shows come first, then changes of the forces.  Squared residuals are counted
    in floors: the squared residual of the hull-force model on held-out stretches of the earlier recording.

    Attributes:
        file: Vehicle file.
        compared: Recording after the change, with residuals in floors of the hull model.
        first: Vehicle file with the new sensor errors, compared with that recording.
        given: Mean squared residual of the file alone, in floors.
        errors: Tests of velocity sensor errors that are new.
        further: Whether the vehicle has changes already, so that the next one must be larger.
        told: Called with the best candidate after the first fits, or with a sensor error found before them.
    """

    file: Vehicle
    compared: Compared
    first: Model
    given: float
    errors: tuple[KinematicTest, ...] = ()
    further: bool = False
    told: Told | None = None

    @classmethod
    def of(
        cls,
        vehicle: Vehicle,
        log: Preprocessed,
        hull: Hull,
        further: bool = False,
        told: Told | None = None,
    ) -> ByChange:
        """Compare a vehicle file with a recording after a change.

        Returns:
            The regime with the compared recording, ready for `select`.
        """
        before = hull.sensors
        if before is None:
            before = kinematic_tests(hull.unchanged.shots.record)
        errors = new_sensor_errors(log.sensors, before, vehicle)
        back = with_mounting(vehicle, log, errors, lambda one, of: _misfit(one, of, hull), hull)
        if back is not log:
            return cls.of(vehicle, back, hull, further, told)
        compared, first = Compared.of(vehicle, log, hull)
        given = compared.chi2(first)
        if errors:
            compared, first = Compared.of(extended(vehicle, [one.table for one in errors]), log, hull)
        return cls(vehicle, compared, first, given, tuple(errors), further, told)

    @property
    def log(self) -> Preprocessed:
        """Recording after the change."""
        return self.compared.log

    def select(self, progress: Progress) -> Changes:
        """Search for changes of the forces; return them with their joint fit, the greatest first."""
        if self.told is not None and self.errors:
            first = self._sensor_findings()[0]
            self.told(Provisional(first.effect, first.confidence, first.share))
        rounds: Rounds[Changes, Change] = self
        found = grow(rounds, Changes(()), progress)
        return self.with_onset(self.shown(replace(found[0], refused=found[1])))

    def with_onset(self, changes: Changes) -> Changes:
        """Return changes with the one within the recording, sought where they leave more than the floor."""
        last = self._last(changes)
        begun = onset(Contest(self.compared, last)) if self.compared.chi2(last) > 1.0 else None
        return replace(changes, onset=begun)

    def shown(self, changes: Changes) -> Changes:
        """Return changes with their joint fit; the last goes while its values are likelier unchanged."""
        while changes.found:
            entries = [entry for one in changes.found for entry in one.best.model.unknown.entries]
            fit = joint_fit(self.compared, self.first.vehicle, self._last(changes).vehicle, entries)
            if weight_of_values(fit, self.first.vehicle, changes.found[-1].best.effect) > 0.5:
                return replace(changes, fit=fit)
            changes = Changes(changes.found[:-1], refused=changes.found[-1])
        return changes

    def is_open(self, changes: Changes) -> bool:
        """Return whether the search for changes continues.

        It does for the first change of an unchanged vehicle.  For a further change, more than the floor of
        the hull model must remain, and fewer than MOST_FINDINGS changes be found.  A doubtful change after
        one that is not doubtful is the last: the error that both leave is that of the hull model.
        """
        found = changes.found
        if not (self.further or found):
            return True
        if len(found) == MOST_FINDINGS or not self.compared.chi2(self._last(changes)) > 1.0:
            return False
        return [one.confidence(self.given) < DOUBTFUL for one in found[-2:]] != [False, True]

    def best(self, changes: Changes, progress: Progress) -> Change | None:
        """Fit candidates for the next change, and return the step with the best of them; None without a fit.

        The best has the least penalised held-out cost.
        """
        count, last = len(changes.found), self._last(changes)
        here = part(progress, 0.3 + 0.1 * count, 0.4 + 0.1 * count)
        here(f"{count} changes found, looking for more", 0.0)
        names = [*(one.effect for one in self.errors), *(one.best.effect for one in changes.found)]
        first_fits = self._tell if self.told is not None and not (count or self.errors) else None
        return Change.of(self.compared, last, Contest(self.compared, last).fits(names, here, first_fits))

    def belongs(self, changes: Changes, change: Change) -> bool:
        """Return whether the best candidate of a step is large enough to be named after `changes`."""
        return change.seen(further=self.further or bool(changes.found))

    def added(self, changes: Changes, change: Change) -> Changes:
        """Return changes with one more, without the first of them if the new one fits better alone."""
        return Changes(tuple(reconsidered(self.compared, self.first, [*changes.found, change])))

    def findings(self, changes: Changes) -> list[Finding]:
        """Return sensor errors and changes as findings, or the finding that nothing has changed.

        If the earlier recording shows the same effects, they are no changes, and one finding says so.
        """
        compared, first = self.compared, self.first
        given, left = compared.chi2(first), compared.chi2(self._last(changes))
        found = self._sensor_findings()
        if self.known_before(changes):
            return [*found, _needed_before(changes.found)]
        if changes.fit is not None:
            fit, dt = changes.fit, self.log.record.dt
            most = 1.0 if compared.hull.describes and changes.onset is None else DOUBTFUL
            found += [_finding(change, first.vehicle, fit, dt, given, left, most) for change in changes.found]
        if changes.onset is not None:
            return [*found, Finding("none_of_the_known", advice=changes.onset.words)]
        words = (
            f"no {'further ' * self.further}change stands out from the error of the hull-force model: the "
            f"error is {np.sqrt(given):.3g} times that before the change, and no effect clearly lowers it"
        )
        return found or [Finding("nothing_missing", advice=words)]

    def known_before(self, changes: Changes) -> bool:
        """Return whether the changes describe the earlier recording too, so that they are no changes."""
        if self.further or not changes.found:
            return False
        changed = self._last(changes).vehicle
        names = [one.effect for one in self.errors]
        plain = msgspec.structs.replace(
            changed, effect=tuple(table for table in changed.effect if table["name"] not in names)
        )
        return were_there_before(self.compared, self.file, plain)

    def diagnosis(self, changes: Changes, findings: Sequence[Finding]) -> Diagnosis:
        """Return the diagnosis: findings, and the vehicle with all changes.

        Mean squared residuals are in units of the floor of the hull model.
        """
        last = self._last(changes)
        tables = [one.table for one in findings if one.parameters]
        chi2 = (self.given, self.given, self.compared.chi2(last))
        return Diagnosis(tuple(findings), extended(last.vehicle, tables), chi2)

    def _sensor_findings(self) -> list[Finding]:
        """Return the errors of the velocity sensor as findings."""
        share, dt = 1.0 - self.compared.chi2(self.first) / self.given, self.log.record.dt
        return [sensor_finding(one, share, dt, self.file) for one in self.errors]

    def _tell(self, fits: Mapping[str, Contender]) -> None:
        """Report the best candidate of the first fits to `told`."""
        best = Change.of(self.compared, self.first, fits)
        if self.told is not None and best is not None:
            share = min(max(best.score, 0.0), 1.0)
            self.told(Provisional(best.best.effect, best.confidence(self.given), share))

    def _last(self, changes: Changes) -> Model:
        """Return the model with all changes, or without changes the first model."""
        return changes.found[-1].best.model if changes.found else self.first


def _misfit(vehicle: Vehicle, log: Preprocessed, hull: Hull) -> float:
    """Return the mean squared residual of a vehicle with the hull-force model, in floors."""
    compared, model = Compared.of(vehicle, log, hull)
    return compared.chi2(model)


def were_there_before(compared: Compared, file: Vehicle, changed: Vehicle) -> bool:
    """Return whether changes describe the earlier recording better than the hull-force model does.

    The vehicle did not have the changes then, so they must fit that recording worse than the hull-force
    model. Otherwise the file is so far from the vehicle that this model could not be learnt, and no change
    can be named.
    """
    sigma = compared.problem.shots.sigma
    then = compared.hull.measured.weighed(sigma).at_measured_states(changed)
    model = unfitted(file, compared.unchanged).costs
    weight = robust(model)
    return bool(weight @ unfitted(changed, then).costs < weight @ model)


def _needed_before(changes: Sequence[Change]) -> Finding:
    """Return the finding that the earlier recording shows the same effects, so that they are no changes."""
    effects = tuple(change.best.effect for change in changes)
    words = (
        f"the earlier recording needs {listed([name.replace('_', ' ') for name in effects])} as well: the "
        f"vehicle file is too far from the vehicle for a comparison. Fit {listed(effects)} to the earlier "
        "recording first, and compare with the fitted file"
    )
    return Finding("none_of_the_known", members=effects, advice=words)


@dataclass(frozen=True)
class Change:
    """One step of the search for changes.

    Attributes:
        best: Best candidate.
        rivals: All fitted candidates, by effect.
        whole: Held-out squared residual of each of S shots without a further change, (S,).
        floor: Squared residual of all shots at the floor of the hull model.
    """

    best: Contender
    rivals: Mapping[str, Contender]
    whole: Array
    floor: float

    @classmethod
    def of(cls, compared: Compared, last: Model, rivals: Mapping[str, Contender]) -> Change | None:
        """Return the step with the best of the fitted candidates; None without candidates."""
        whole = compared.left_out(last.normal.of([]))
        if not rivals:
            return None
        floor = compared.floor(last)
        return cls(leading([*rivals.values()], float(whole.sum()), floor), rivals, whole, floor)

    def penalty(self, rival: Contender) -> float:
        """Return a rival's penalty for its parameters and for the hull-force error that it absorbs.

        It is in units of the squared residual, as the rival's held-out cost.
        """
        return rival.penalty(self.rivals.values(), float(self.whole.sum()), self.floor)

    def penalised(self, rival: Contender) -> float:
        """Return a rival's held-out cost plus its penalty, by which rivals are ranked."""
        return rival.left + self.penalty(rival)

    @property
    def score(self) -> float:
        """Share of the held-out squared residual that the best candidate removes."""
        return float(1.0 - self.best.left / self.whole.sum())

    @property
    def leads(self) -> tuple[float, float]:
        """Two leads of the best candidate in penalised cost: over the next candidate, and over no change.

        Their unit is the floor, the squared residual of the hull-force model on held-out data.
        """
        best, none = self.penalised(self.best), float(self.whole.sum())
        others = [self.penalised(one) for one in self.rivals.values() if one.effect != self.best.effect]
        return (min(others, default=np.inf) - best) / self.floor, (none - best) / self.floor

    @property
    def relative_gain(self) -> float:
        """Squared residual that the best candidate removes, as a share of the present one or of the floor.

        The greater of both is the divisor.
        """
        return relative_gain(self.score, float(self.whole.sum()), self.floor)

    def confidence(self, given: float) -> float:
        """Return the probability that the best candidate is the change.

        It is the share of the resamples that the candidate wins, times the probability that its lead is not
        due to chance (`lead_confidence`).

        `given` is the squared residual of the file as given, in units of `floor`.
        """
        return self.wins[self.best.effect] * lead_confidence(*self.leads, self.lead_by_chance(given))

    def lead_by_chance(self, given: float) -> float:
        """Return the mean lead of a candidate by chance, in floors.

        `given` is the squared residual of the file as given, in units of `floor`.
        """
        beyond = max(self.best.left / self.floor - 1.0, 0.0)
        removed = max(given - float(self.whole.sum()) / self.floor, 0.0)
        return MATERIAL * (1.0 + removed) + ABSORBED * beyond

    def tied(self, given: float) -> tuple[tuple[str, ...], float]:
        """Return the effects of the best one's physics that fit as well, and the probability of this physics.

        Several laws describe the same physics, such as drag, so a recording may show that one of them has
        changed and not which.  Those fit as well that win some resamples, or that the best leads by no more
        than chance gives.  The probability is that of `confidence`, for all laws of this physics together.

        `given` is the squared residual of the file as given, in units of `floor`.
        """
        chance, wins, best = self.lead_by_chance(given), self.wins, self.penalised(self.best)
        behind = {name: (self.penalised(one) - best) / self.floor for name, one in self.rivals.items()}
        alike = [name for name in self.rivals if _physics(name) == _physics(self.best.effect)]
        tied = [name for name in alike if wins[name] >= NEGLIGIBLE or behind[name] <= chance]
        over_next = min((lead for name, lead in behind.items() if name not in alike), default=np.inf)
        together = sum(wins[name] for name in alike)
        sure = together * lead_confidence(over_next, self.leads[1], chance)
        return tuple(sorted(tied, key=behind.__getitem__)), sure

    def seen(self, further: bool) -> bool:
        """Return whether the change is large enough to be named.

        It must be larger where the vehicle has changes already (`further`).
        """
        if further:
            return is_further(self.best.effect, self.relative_gain)
        return self.score >= CHANGED and self.score * float(self.whole.sum()) >= MATERIAL * self.floor

    @cached_property
    def wins(self) -> dict[str, float]:
        """Share of the resamples of the shots in which each rival is the best, the largest first."""
        shots = len(self.whole)
        return wins({name: one.costs + self.penalty(one) / shots for name, one in self.rivals.items()}, 1)


def _physics(name: str) -> str:
    """Return the family of an effect, that of damping for every law of drag."""
    effect = CATALOGUE[name]
    return LINEAR_DAMPING.family if Role.DRAG in effect.roles else effect.family


@dataclass(frozen=True)
class Changes:
    """Result of the search for changes.

    Attributes:
        found: The changes, the greatest first.
        refused: The best candidate of the last step, where it was too small to be named; None otherwise.
        fit: Joint posterior of their values; None without changes, and during the search.
        onset: Change that begins within the recording; None where none stands out.
    """

    found: tuple[Change, ...]
    refused: Change | None = None
    fit: Fit | None = None
    onset: Onset | None = None


def reconsidered(compared: Compared, first: Model, changes: list[Change]) -> list[Change]:
    """Return the changes, or the second alone where it fits better without the first.

    A candidate with a threshold may appear only after a poorer candidate has moved the start of its fit.

    `changes` are in the order of the search; other numbers than two are returned as they are.
    """
    if len(changes) != 2:
        return changes
    before, name = changes[0], changes[1].best.effect
    (table,) = changes[1].best.model.vehicle.effects(name)
    try:
        alone = Contest(compared, first).fitted(table)
    except (Diverges, np.linalg.LinAlgError):
        return changes
    if before.penalised(alone) >= before.penalised(before.best):
        return changes
    return [replace(before, best=alone, rivals={**before.rivals, name: alone})]


def _finding(
    change: Change, file: Vehicle, fit: Fit, dt: float, given: float, left: float, most: float = 1.0
) -> Finding:
    """Return a change as a finding.

    Args:
        change: Step of the search whose best candidate is the change.
        file: Vehicle file.
        fit: Values of all changes.
        dt: Time between rows [s].
        given: Mean squared residual of the file as given, in floors.
        left: Mean squared residual with all changes, in floors.
        most: Greatest confidence, less than 1 if the hull-force model does not describe the vehicle.
    """
    name, frequency = change.best.effect, change.wins
    parameters, errors = with_response_error(fit, file).table(name)
    words = f"it removes {change.score:.0%} of the residual of held-out stretches"
    others = [f"{one} ({part:.0%})" for one, part in frequency.items() if one != name and part >= NEGLIGIBLE]
    if others:
        words += f"; in part of the resamples another effect wins: {', '.join(others)}"
    if left > RIGHT:
        words += f"; the residual is still {left:.3g} times the floor, and no candidate explains it"
    known = bool(file.effects(name))
    if known:
        words = f"{advice.having_changed(name, change_of(name, file, fit.free, fit.values))}; {words}"
    else:
        words = f"{advice.adding(name, parameters, dt)}; {words}"
    weight = weight_of_values(fit, file, name)
    tied, together = change.tied(given)

    def limited(confidence: float) -> float:
        """Return a confidence with the evidence of the values, at most that of the hull-force model."""
        limits = fit.table(name)[1] if left <= RIGHT else None
        return min(limited_confidence(confidence * weight, fit.vehicle, name, limits), most)

    found = Finding.of(
        "retune" if known else "missing",
        name,
        (parameters, errors),
        explained_share(change.whole - change.best.costs, change.whole, 1),
        confidence=limited(change.confidence(given)),
        advice=words,
        support=frequency[name],
    )
    if found.confidence < SURE <= limited(together) and len(tied) > 1:
        words = f"{advice.separating(tied)}; {words}"
        return replace(found, verdict="cannot_tell_apart", members=tied, advice=words)
    return unconfirmed(found) if found.confidence < SURE else found


def weight_of_values(fit: Fit, file: Vehicle, effect: str) -> float:
    """Return the Akaike weight, 0 to 1, of an effect's values against those of the file, or against 0.

    The log likelihood of the file's values is less by half their squared distance in the joint posterior,
    whose covariance includes the hull model's error.  Each value costs one (Burnham and Anderson 2002, sec.
    2.9).  It is 1 for a new effect that is not linear in its values, where the distance from 0 shows nothing
    (Hauck and Donner 1977).
    """
    if is_curved(effect) and not file.effects(effect):
        return 1.0
    own = fit.free.places(effect)
    away = fit.values[own] - in_file(file, [fit.free.entries[i] for i in own])
    squared = away @ np.linalg.solve(fit.covariance[np.ix_(own, own)], away)
    return float(scipy.special.expit(0.5 * squared - len(own)))


def fit_changes(file: Vehicle, log: Preprocessed, hull: Hull, changes: Sequence[Mapping[str, Any]]) -> Fit:
    """Return the joint fit of changes of a file, with the rest of the file and the hull forces held fixed.

    Components that start at the file's values stay there: the diagnosis has found that they are not needed.

    `changes` are `[[effect]]` tables with starting values.

    Raises:
        DataError: The recording is too short, or the predictions diverge.
    """
    file = hull.completed(file)
    compared, first = Compared.of(file, log, hull)
    contest = Contest(compared, first)
    model = contest.with_hull_response(contest.fitted_together(changes))
    entries = model.unknown.entries
    given = in_file(first.vehicle, entries)
    held = in_file(extended(file, changes), entries) == given
    if held.any() and not held.all():
        model = held_at(model, np.where(held, given, model.values), held, QUICK_STEPS)
    fit = joint_fit(compared, file, model.vehicle, model.unknown.entries)
    return with_response_error(fit, file)


def joint_fit(compared: Compared, file: Vehicle, vehicle: Vehicle, entries: Sequence[Entry]) -> Fit:
    """Return the joint posterior of all changes as a fit, with the error of the hull model integrated out.

    All components of the changed effects are free, also those that the search held at the file's values.  A
    held component that has changed a little would bias the others.  Only `entries` get new values.

    These move to the posterior mean if that lowers the error, and otherwise stay as fitted.  Damping and
    added mass stay passive.  The distance of the values from the posterior mean adds to their covariance.
    """
    names = list(dict.fromkeys(entry.effect for entry in entries))
    unknown = free(vehicle, names, reach=compared.log.track)
    values, scales, unchanged = unknown.starts[0], unknown.scales, compared.unchanged
    problem = compared.recomputed(vehicle).with_free_law(vehicle)
    normal = linearised(unknown, values / scales, problem)
    centre = unknown.within(in_file(file, unknown.entries)) / scales
    prior = Prior(centre, np.full(len(values), SUSPECT_SPREAD**-2))
    draws = imitations(unchanged, file, unknown, values, folds(unchanged.shots.session))
    bounds = (unknown.bounds[0] / scales, unknown.bounds[1] / scales)
    needed = {entry.name for entry in entries}
    kept = np.array([entry.name in needed for entry in unknown.entries])
    found = joint_posterior(normal, values / scales, prior, bounds, compared.fold, draws, ~kept)
    mean = unknown.within(found.mean * scales)
    lower = problem.linearise(unknown.at(mean), [], []).cost <= normal.cost
    reached = (mean if lower else values)[kept]
    normal = normal.of(np.flatnonzero(kept).tolist())
    fit = Model(unknown.holding(values, ~kept), reached, problem, normal).estimated()
    moved = fit.values - mean[kept]
    spread = (found.covariance * np.outer(scales, scales))[np.ix_(kept, kept)] + np.outer(moved, moved)
    return fit.with_covariance(spread)
