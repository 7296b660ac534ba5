"""Candidate changes of a vehicle, fitted with the hull-force model held fixed and scored on held-out data.

The score is the share of the squared residual that a candidate removes from held-out sessions or stretches.
All candidates are scored first: by one Gauss-Newton step on whole shots, or after a large change by fits to
the first part of each shot.  The best are then fitted, and components that remove less than their penalty
are dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.baseline import SHOT_LENGTHS, stable_shots
from hydro.core.diagnosis.confidence import folds, left_out_costs
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Diverges, Model, continue_fit, fit_model, held_at, passive, unfitted
from hydro.core.diagnosis.sensor_errors import refuted
from hydro.core.diagnosis.settings import (
    ABSORBED,
    ALMOST_ALL,
    CONTENDERS,
    DISTINCT,
    FIT,
    FURTHER,
    NEARLY_EQUAL,
    NEGLIGIBLE,
    QUICK_STEPS,
    RIGHT,
    SHOTS,
    SUSPECT_SPREAD,
    VISIBLE,
)
from hydro.core.effects import CATALOGUE
from hydro.core.effects.catalogue import implausible, wholly_known
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.prior import in_file
from hydro.core.identification.suspects import (
    Suspect,
    is_curved,
    of_entries,
    plainer,
    shapes,
    suspects,
    with_one_value,
)
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.output_error import OutputError
from hydro.core.progress import Progress
from hydro.core.residual.hull import Hull
from hydro.core.residual.recomputed import Recomputed
from hydro.core.residual.regression import robust
from hydro.core.residual.response import Transitions
from hydro.core.vehicle.description import Vehicle

CHANGE_FLOW = ("flow", "sensor")
"""Kinds of effects that change the motion through the water on which the hull force depends."""
Table = Mapping[str, Any]
Scored = tuple[float, Table]
"""Score by one step, and the table of values that the step gives."""


@dataclass(frozen=True)
class Contender:
    """Candidate change: one effect fitted to the recording after the change.

    Attributes:
        effect: Name of the effect.
        model: Vehicle with the effect, over S shots corrected for the hull force.
        costs: Held-out squared residual of each shot, predicted by the fit to all other folds, (S,).
    """

    effect: str
    model: Model
    costs: Array

    @property
    def table(self) -> Table:
        """Fitted `[[effect]]` table of the effect."""
        return self.model.vehicle.effects(self.effect)[0]

    @property
    def left(self) -> float:
        """Held-out squared residual, summed over all shots."""
        return float(self.costs.sum())

    def penalty(self, rivals: Iterable[Contender], whole: float, floor: float) -> float:
        """Return the penalty of this effect, in units of squared residual.

        Each parameter costs a share of the error that it could absorb: the error that the best rival leaves,
        but at least FIT floors, because that error is uncertain.  The rest of the residual is due to the
        change, whichever name it has.  An effect that absorbs hull-force error costs more.

        Args:
            rivals: All fitted candidates.
            whole: Held-out squared residual without a change.
            floor: Squared residual of the hull model on held-out data.
        """
        absorbs = CATALOGUE[self.effect].identification.absorbs
        least = min(one.left for one in rivals)
        at_stake = min(whole, max(least, FIT * floor))
        return NEGLIGIBLE * at_stake * len(self.model.values) + ABSORBED * absorbs * floor


def leading(
    candidates: Sequence[Contender], whole: float, floor: float, rivals: Sequence[Contender] | None = None
) -> Contender:
    """Return the candidate with the least penalised held-out cost.

    The other arguments are those of `penalty`; `rivals` are by default the candidates alone.
    """
    against = candidates if rivals is None else rivals
    return min(candidates, key=lambda one: one.left + one.penalty(against, whole, floor))


def relative_gain(score: float, whole: float, floor: float) -> float:
    """Return a removed squared residual as a share of the present one, or of that at the floor.

    The greater of both is the divisor.

    Args:
        score: Share of the held-out squared residual that is removed.
        whole: Held-out squared residual without a further change.
        floor: Squared residual of all shots at the floor.
    """
    return score * whole / max(whole, floor)


def is_further(effect: str, gain: float) -> bool:
    """Return whether a relative gain is large enough for a further change by an effect.

    A drag law that absorbs the error of an unchanged hull is not a further change.
    """
    return gain >= max(FURTHER, CATALOGUE[effect].identification.absorbs)


@dataclass(frozen=True)
class Compared:
    """Recording after a change, to be corrected for the hull force that the file lacks.

    Attributes:
        log: Recording.
        hull: Hull-force model learnt from the earlier recording.
        problem: S shots as measured, with residuals in units of the floor of the hull model.
        fold: Number of the held-out part that each shot belongs to, (S,).
        weight: Weight of each shot, smaller for outliers, (S,).
    """

    log: Preprocessed
    hull: Hull
    problem: OutputError
    fold: Rows
    weight: Array = field(default_factory=lambda: np.ones(1))

    @classmethod
    def of(cls, vehicle: Vehicle, log: Preprocessed, hull: Hull) -> tuple[Compared, Model]:
        """Cut a recording after a change into shots, and prepare them for the fits of candidate changes.

        The shots are corrected for the hull force learnt before the change, so that what remains is due to
        the change.  Their residuals are in units of the floor: the root mean square residual that the hull
        model leaves on held-out stretches of the earlier recording.  Shots that the file predicts badly even
        so get smaller weights (`robust`).

        Args:
            vehicle: Vehicle file.
            log: Recording after the change.
            hull: Hull-force model learnt from the earlier recording.

        Returns:
            The recording with its weights, whose `problem` has the shots as measured, and the vehicle file
            as a model without free components, on the corrected shots.

        Raises:
            DataError: The recording is too short, or the vehicle's predictions diverge.
        """
        sigma = np.maximum(log.noise, hull.sigma) * hull.floor
        problem = stable_shots(vehicle, log).some(2 * SHOTS).weighed(sigma)
        compared = cls(log, hull, problem, folds(problem.shots.session))
        return compared._with_weights(vehicle)

    def over_first_part(self, vehicle: Vehicle) -> tuple[Compared, Model]:
        """Return the comparison of a vehicle over the first part of each shot, of the shortest shot length.

        The vehicle is returned as a model without free components, as by `of`.
        """
        return replace(self, problem=self.problem.first_part(SHOT_LENGTHS[-1]))._with_weights(vehicle)

    def _with_weights(self, vehicle: Vehicle) -> tuple[Compared, Model]:
        """Return a copy whose weights are those of a vehicle's residuals, and the model of that vehicle."""
        first = unfitted(vehicle, self.corrected(vehicle))
        return replace(self, weight=robust(first.costs)), first

    @property
    def unchanged(self) -> OutputError:
        """Shots of the earlier recording, corrected for the hull force, with the units of `problem`."""
        return self.hull.unchanged.weighed(self.problem.shots.sigma)

    def left_out(self, normal: Normal) -> Array:
        """Return the weighted held-out cost of each of S shots, by one linear step per fold, (S,).

        The step leads to the fit of all other folds.
        """
        weighed = replace(normal, gram=normal.gram * self.weight[:, None, None])
        return left_out_costs(weighed, self.fold)

    def elsewhere(self, model: Model) -> Array:
        """Return the held-out cost of each of S shots about a fit, (S,); in total at least its own cost.

        A linear step may pass a parameter's bounds and promise a cost below that of the fit.  Where the steps
        lead so far that the linear problem is unreliable, each fold is predicted by a new fit to the others.
        Otherwise one shot that tumbles would decide alone.
        """
        left, here = self.left_out(model.normal), self.weight * model.costs
        if left.sum() > RIGHT * here.sum():
            again = self.refitted(model)
            return again if again.sum() < left.sum() else left
        return left if left.sum() >= here.sum() else here

    def cost(self, normal: Normal) -> float:
        """Return the weighted held-out cost of all shots together, by one linear step per fold."""
        return float(self.left_out(normal).sum())

    def settled(self, model: Model) -> bool:
        """Return whether held-out costs by linear steps from a fit can be trusted.

        They can if they are at most RIGHT times the costs of the fit itself.
        """
        return bool(self.cost(model.normal) <= RIGHT * (self.weight * model.costs).sum())

    def refitted(self, model: Model) -> Array:
        """Return the held-out cost of each shot by fits to all other folds, (S,); infinite on divergence."""
        problem, found = cast(OutputError, model.problem), np.full(len(self.fold), np.inf)
        for number in np.unique(self.fold):
            out = self.fold == number
            try:
                there = continue_fit(model.over(~out), QUICK_STEPS).vehicle
            except Diverges:
                continue
            found[out] = unfitted(there, problem.over(out)).costs
        return np.asarray(self.weight * found)

    def floor(self, model: Model) -> float:
        """Return the sum of the weighted squared residuals if all shots were at the floor of the hull model.

        The floor is the residual of the hull model on held-out data; residuals are in its unit.
        """
        return float(self.weight @ model.normal.freedoms)

    def chi2(self, model: Model) -> float:
        """Return a model's weighted mean squared residual, in units of the floor of the hull model."""
        return float(self.weight @ model.costs) / self.floor(model)

    def corrected(self, vehicle: Vehicle) -> OutputError:
        """Return the shots, from the measured states, corrected by a vehicle's response to the hull force."""
        shots = self.problem.shots
        transitions = Transitions.of(candidate(vehicle), shots)
        return self.hull.acting(vehicle, transitions).at_measured_states(vehicle)

    def recomputed(self, vehicle: Vehicle) -> Recomputed:
        """Return the shots with the hull force recomputed for every candidate; `vehicle` responds to it."""
        return Recomputed.of(self.hull, Transitions.of(candidate(vehicle), self.problem.shots))


@dataclass(frozen=True)
class Contest:
    """One round of candidate changes of a vehicle.

    Attributes:
        compared: Recording after the change.
        last: Vehicle with the changes so far, over the shots corrected for the hull force.
    """

    compared: Compared
    last: Model

    @cached_property
    def recomputed(self) -> Recomputed:
        """Shots with the hull force recomputed for every candidate; the last vehicle responds to it."""
        return self.compared.recomputed(self.last.vehicle)

    def fits(
        self,
        chosen: Sequence[str],
        progress: Progress,
        first_fits: Callable[[Mapping[str, Contender]], None] | None = None,
    ) -> dict[str, Contender]:
        """Fit the candidates that are best on whole shots, on the first part of each shot, or on both.

        Where the error is at most FIT floors, candidates are chosen on whole shots, otherwise on the first
        parts.  If none of them is right, those chosen in the other way are fitted too.  Only fits that
        have not converged are repeated, from another start or with more steps.

        Args:
            chosen: Effects that the vehicle has from earlier rounds.
            progress: Called with a short text and the share of the work done.
            first_fits: Called once, with the fits of the first choice.

        Returns:
            Fitted candidates, by effect.
        """
        vehicle, reach = self.last.vehicle, self.compared.log.track
        tried = [*suspects(vehicle, without=chosen, reach=reach), *_of_file(vehicle, chosen, reach)]
        floor, fits = self.compared.floor(self.last), dict[str, Contender]()
        choices = [self._best_of_whole_shots, self._best_of_first_parts]
        for number, choice in enumerate(choices if self.compared.chi2(self.last) <= FIT else choices[::-1]):
            progress("choice of candidates", number / 2)
            for at, table in enumerate(tables := choice(tried)):
                name = str(table["name"])
                progress(f"{name} on held-out stretches", (number + at / len(tables)) / 2)
                if name not in fits or not _has_converged(fits[name].model):
                    self._join(fits, table)
            if first_fits is not None and number == 0:
                first_fits(fits)
            if _least(fits) <= RIGHT * floor:
                break
        if _least(fits) > FIT * floor:
            for fit in sorted(fits.values(), key=lambda one: one.left):
                if not _has_converged(fit.model) and fit.left <= FIT * _least(fits):
                    self._join(fits, fit.table, ITERATIONS)
        return self.with_plainer(self.with_one_value(fits))

    def with_one_value(self, fits: Mapping[str, Contender]) -> dict[str, Contender]:
        """Return fits, by effect, with one value for all thrusters where its penalised held-out cost is less.

        A lower supply voltage, for instance, weakens all thrusters alike.
        """
        found, floor = dict(fits), self.compared.floor(self.last)
        whole = self.compared.cost(self.last.normal.of([]))
        for name, one in fits.items():
            table = with_one_value(one.model.vehicle, name, self.last.vehicle)
            if table is None:
                continue
            with suppress(Diverges, np.linalg.LinAlgError):
                common = self.fitted(table, least=_least(fits))
                found[name] = leading((one, common), whole, floor, [*fits.values(), common])
        return found

    def with_plainer(self, fits: Mapping[str, Contender]) -> dict[str, Contender]:
        """Return fits, by effect, with those of simpler special cases of the best, and without needless ones.

        The best has the least penalised held-out cost.  A general effect is needless if the cost of a special
        case is at most its own.  The best is needless in two further cases:

        - The cost of a special case is within DISTINCT standard errors of the difference between shots.  A
          far anchor below the vehicle is then no evidence against a payload.
        - Physics allows the values of a special case and not those of the best, and the special case removes
          a share NEARLY_EQUAL of the error that the best removes.  A weight metres beyond the hull absorbs
          errors of the hull force.
        """
        if not fits:
            return {}
        floor, whole = self.compared.floor(self.last), self.compared.cost(self.last.normal.of([]))
        fits, best = dict(fits), leading([*fits.values()], whole, floor)
        for table in self._plainer(best):
            self._join(fits, table)

        def is_needless(fit: Contender) -> bool:
            special = [fits[table["name"]] for table in self._plainer(fit) if table["name"] in fits]
            if fit is best:
                return any(_replaces(one, best, whole) for one in special)
            return any(one.left <= fit.left for one in special)

        return {name: one for name, one in fits.items() if not is_needless(one)}

    def _plainer(self, fit: Contender) -> Sequence[Table]:
        """Return the tables of simpler effects with nearly the forces of a fit."""
        return plainer(fit.model.vehicle, fit.effect, self.last.vehicle)

    def scored_by_one_step(self, tried: Sequence[Suspect]) -> dict[str, Scored]:
        """Return the score of each effect about the last vehicle, see `scored`."""
        return self.scored(tried, self.linearised(tried))

    def linearised(self, tried: Sequence[Suspect]) -> Normal:
        """Return the problem linearised about the last vehicle, with the columns of all candidates."""
        changed = [vehicle for suspect in tried for vehicle in suspect.changed]
        steps = [step for suspect in tried for step in suspect.steps]
        return self.last.problem.linearise(self.last.vehicle, changed, steps)

    def scored(self, tried: Sequence[Suspect], normal: Normal) -> dict[str, Scored]:
        """Return each effect's score by one Gauss-Newton step and the table of that step, the best first.

        The score is the share of the held-out squared residual that the step removes, less a small penalty.
        Of several candidates for one effect, the best counts.

        Args:
            tried: Candidates.
            normal: Problem with their columns, as of `linearised`.
        """
        whole, best, at = self.compared.cost(normal.of([])), dict[str, Scored](), 0
        for suspect in tried:
            columns = list(range(at, at + len(suspect.steps)))
            at += len(columns)
            in_part = is_curved(suspect.effect) and bool(self.last.vehicle.effects(suspect.effect))
            kept = self._needed(normal, columns) if in_part else columns
            own = normal.of(kept)
            score = 1.0 - self.compared.cost(own) / whole - VISIBLE * len(kept)
            if suspect.effect not in best or score > best[suspect.effect][0]:
                known, step = own.matrix.sum(axis=0) + np.eye(len(kept)) * SUSPECT_SPREAD**-2, np.zeros(at)
                step[kept] = np.linalg.solve(known, own.score.sum(axis=0))
                best[suspect.effect] = (score, suspect.begin(step[columns]))
        return dict(sorted(best.items(), key=lambda one: -one[1][0]))

    def fitted(self, table: Table, iterations: int = QUICK_STEPS, least: float = np.inf) -> Contender:
        """Return an effect as a contender, fitted with the hull forces that act on the fitted vehicle.

        A first fit with more than FIT times the cost `least` is not refined, because it cannot become the
        best.

        Args:
            table: `[[effect]]` table with starting values.
            iterations: Maximum number of iterations.
            least: Least held-out cost of the other candidates.

        Raises:
            Diverges: The predicted motion diverges.
        """
        model, name = self.fitted_together([table], iterations), str(table["name"])
        here = self.compared.weight * model.costs
        if not here.sum() <= FIT * least:
            return Contender(name, model, here)
        model = self.with_hull_response(model)
        if not self.compared.settled(model):  # with the hull forces held too: they change with the motion
            with suppress(Diverges):
                again = continue_fit(model, QUICK_STEPS)
                model = again if again.normal.cost < model.normal.cost else model
        model = passive(model)
        return self.without_needless_entries(Contender(name, model, self.compared.elsewhere(model)))

    def fitted_together(
        self, tables: Sequence[Table], iterations: int = QUICK_STEPS, about: Vehicle | None = None
    ) -> Model:
        """Return a model of the last vehicle with several candidate effects fitted together.

        The response to the hull force is that of `about`, by default of `last`.
        """
        compared, last, reach = self.compared, self.last, self.compared.log.track
        if not any(CATALOGUE[str(table["name"])].kind in CHANGE_FLOW for table in tables):
            problem = compared.corrected(about) if about is not None else last.problem
            return fit_model(last.vehicle, tables, problem, reach, iterations)
        shots = self.recomputed if about is None else compared.recomputed(about)
        model = fit_model(last.vehicle, tables, shots, reach, iterations)
        return replace(model, problem=compared.corrected(model.vehicle))

    def with_hull_response(self, model: Model) -> Model:
        """Return a model refitted to shots that are corrected with the fitted vehicle's response.

        The model was fitted to shots corrected with the response of `last`.  But a vehicle of different mass
        or drag responds differently to the same hull force.  After a large change, this leaves residuals of
        several times the floor (`Compared.of`), which another effect would absorb.

        So correction and fit are repeated, at most QUICK_STEPS // 2 times, until a round lowers the cost to
        no less than a share ALMOST_ALL.  A fit that diverges ends the rounds, too.  The result is the model
        of the least cost, also without convergence.
        """
        names = model.unknown.effects
        for _ in range(QUICK_STEPS // 2):
            tables = [model.vehicle.effects(name)[0] for name in names]
            try:
                again = self.fitted_together(tables, QUICK_STEPS, about=model.vehicle)
            except Diverges:
                return model
            left, model = model.normal.cost, min(again, model, key=lambda one: one.normal.cost)
            if not model.normal.cost < ALMOST_ALL * left:
                break
        return model

    def without_needless_entries(self, whole: Contender) -> Contender:
        """Return a contender without components whose held-out gain is below their penalty; others refitted.

        Usually one thruster fails, not all of them, and free components follow the hull's error.  The problem
        linearised about the fit shows which components are needed.  So this applies to effects that are
        linear in their components, and to effects of the file, whose components return to the file's values.
        """
        model, count, given = whole.model, len(whole.model.values), self.last.vehicle
        curved = is_curved(whole.effect) and not given.effects(whole.effect)
        if count < 2 or curved or CATALOGUE[whole.effect].kind in CHANGE_FLOW:
            return whole
        begun = in_file(given, model.unknown.entries)
        normal = model.normal.after((begun - model.values) / model.unknown.scales)
        nothing = self.compared.cost(normal.of([]))
        kept, left = list(range(count)), self.compared.cost(normal)
        while len(kept) > 1:
            fewer = [[one for one in kept if one != out] for out in kept]
            costs = [self.compared.cost(normal.of(columns)) for columns in fewer]
            best = int(np.argmin(costs))
            if costs[best] > left + VISIBLE * nothing:
                break
            kept, left = fewer[best], costs[best]
        if len(kept) == count:
            return whole
        held = ~np.isin(np.arange(count), kept)
        try:
            model = passive(held_at(model, np.where(held, begun, model.values), held, QUICK_STEPS))
        except Diverges:
            return whole
        leaner = Contender(whole.effect, model, self.compared.elsewhere(model))
        return leaner if leaner.left < whole.left + VISIBLE * nothing * (count - len(kept)) else whole

    def _join(self, fits: dict[str, Contender], table: Table, iterations: int = QUICK_STEPS) -> None:
        """Fit an effect from a starting table; add the fit to `fits` if it is the best of this effect.

        A fit that diverges or that kinematics refutes is dropped.
        """
        try:
            fit = self.fitted(table, iterations, _least(fits))
        except (Diverges, np.linalg.LinAlgError):
            return
        if fit.effect in fits and fits[fit.effect].left <= fit.left:
            return
        if not refuted(self.compared.log.sensors, fit.effect, fit.model.vehicle):
            fits[fit.effect] = fit

    def _best_of_whole_shots(self, tried: Sequence[Suspect]) -> list[Table]:
        """Return starting tables of the CONTENDERS best candidates by one step on whole shots."""
        ranked = self.scored_by_one_step(tried)
        return [self._at_finest(name, ranked) for name in list(ranked)[:CONTENDERS]]

    def _at_finest(self, name: str, ranked: Mapping[str, Scored]) -> Table:
        """Return the starting table of an effect by one step, of the finer grid of shapes if it has one.

        A shape fixes a nonlinear parameter, such as a threshold or an anchor, see `identification.suspects`.
        An effect that the vehicle has already needs no grid.
        """
        vehicle, reach = self.last.vehicle, self.compared.log.track
        finer = [] if vehicle.effects(name) else shapes(vehicle, name, reach=reach)
        return (self.scored_by_one_step(finer) if finer else ranked)[name][1]

    def _best_of_first_parts(self, tried: Sequence[Suspect]) -> list[Table]:
        """Return tables of the best of CONTENDERS candidates, fitted to the first part of each shot.

        The best leave at most FIT times the least error.

        After a large change, the prediction of a whole shot is far from linear in the change, and fits from
        the file end in local minima: a body that rolls at half its frequency is out of phase within a second.
        The first quarter of a second is nearly linear, so a fit to it is a start near the change.
        """
        compared, last = self.compared.over_first_part(self.last.vehicle)
        contest, begun, fits = Contest(compared, last), dict[str, Model](), dict[str, Contender]()
        for name, (_, table) in contest.scored_by_one_step(tried).items():
            with suppress(Diverges, np.linalg.LinAlgError):
                begun[name] = contest.fitted_together([table], 1)
        for name in sorted(begun, key=lambda one: compared.chi2(begun[one])):
            if len(fits) < CONTENDERS:
                contest._join(fits, begun[name].vehicle.effects(name)[0])
        best = [one for one in fits.values() if one.left <= FIT * _least(fits)]
        return [one.table for one in sorted(best, key=lambda one: one.left)]

    def _needed(self, normal: Normal, columns: Sequence[int]) -> list[int]:
        """Return the columns that lower the held-out cost by one step, added one by one, at least one.

        Two components of a curved effect may act alike: a fin's area, its offset and its deflection at full
        command all scale one force while the command is constant.  A step along all of them leads far away.
        """
        kept: list[int] = []
        least = whole = self.compared.cost(normal.of([]))
        while rest := [one for one in columns if one not in kept]:
            costs = [self.compared.cost(normal.of(sorted([*kept, one]))) for one in rest]
            best = int(np.argmin(costs))
            if kept and costs[best] > least - VISIBLE * whole:
                break
            kept, least = sorted([*kept, rest[best]]), costs[best]
        return kept


def _least(fits: Mapping[str, Contender]) -> float:
    """Return the least held-out cost of some fits; infinite without any."""
    return min((fit.left for fit in fits.values()), default=np.inf)


def _distinct(costs: Array, least: Array) -> bool:
    """Return whether costs of S shots exceed others by more than DISTINCT standard errors, (S,) each."""
    more = costs - least
    return bool(more.sum() > DISTINCT * np.sqrt(len(more)) * np.std(more))


def _replaces(special: Contender, best: Contender, whole: float) -> bool:
    """Return whether a special case replaces the best, general effect, see `Contest.with_plainer`.

    `whole` is the held-out squared residual without either.
    """
    if not _distinct(special.costs, best.costs):
        return True
    nearly = whole - special.left >= NEARLY_EQUAL * (whole - best.left)
    return nearly and not _is_possible(best) and _is_possible(special)


def _is_possible(fit: Contender) -> bool:
    """Return whether physics allows the fitted values of an effect."""
    return not implausible(fit.model.vehicle, [fit.effect])


def _has_converged(model: Model) -> bool:
    """Return whether one more step would lower the cost of a fit by a share of NEGLIGIBLE at most.

    A fit of an effect with thresholds or delays has local minima, and never counts as converged.
    """
    return not model.unknown.has_thresholds and model.promised <= NEGLIGIBLE * model.normal.cost


def _of_file(vehicle: Vehicle, without: Sequence[str], reach: Array) -> list[Suspect]:
    """Return the nonlinear effects of the file as candidates, because each may have changed."""
    there = dict.fromkeys(str(table["name"]) for table in vehicle.effect)
    curved = [name for name in there if name not in without and is_curved(name)]
    return [of_entries(vehicle, name, reach=reach) for name in curved if not wholly_known(vehicle, name)]
