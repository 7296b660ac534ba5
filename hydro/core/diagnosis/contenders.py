"""Candidate changes of a vehicle, fitted with the hull-force model held fixed and scored on held-out data.

The score is the share of the squared residual that a candidate removes from held-out sessions or stretches.
All candidates are scored first by one Gauss-Newton step from the file.  The best are then fitted, and
components that remove less than their penalty are dropped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any, cast

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.confidence import Fitted, folds, left_out_costs
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Diverges, Model, continue_fit, fit_model, held_at, passive, unfitted
from hydro.core.diagnosis.sensor_errors import refuted
from hydro.core.diagnosis.settings import (
    ABSORBED,
    ALMOST_ALL,
    CLOSEST,
    CONTENDERS,
    FIT,
    NEGLIGIBLE,
    QUICK_STEPS,
    RIGHT,
    SUSPECT_SPREAD,
    VISIBLE,
)
from hydro.core.effects import CATALOGUE
from hydro.core.effects.catalogue import wholly_known
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.prior import in_file
from hydro.core.identification.suspects import Suspect, is_curved, of_entries, shapes, suspects
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

        The floor is the squared residual that the hull-force model leaves on held-out data.
        If a rival reaches the floor, each parameter costs a share of at most FIT floors, because the rest of
        the residual was due to the change.  Otherwise no candidate is right, and a parameter costs a share of
        the whole residual.  An effect that absorbs hull-force error costs more.

        Args:
            rivals: All fitted candidates.
            whole: Held-out squared residual without a change.
            floor: Squared residual of the hull model on held-out data.
        """
        absorbs = CATALOGUE[self.effect].identification.absorbs
        right = min(one.left for one in rivals) <= RIGHT * floor
        at_stake = min(whole, FIT * floor) if right else whole
        return NEGLIGIBLE * at_stake * len(self.model.values) + ABSORBED * absorbs * floor


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
    def of(
        cls, log: Preprocessed, problem: OutputError, hull: Hull, vehicle: Vehicle
    ) -> tuple[Compared, Model]:
        """Prepare the shots after a change for the fits of candidate changes.

        The shots are corrected for the hull force learnt before the change, so that what remains is due to
        the change.  Their residuals are in units of the floor: the root mean square residual that the hull
        model leaves on held-out stretches of the earlier recording.  Shots that the file predicts badly even
        so get smaller weights (`robust`).

        Args:
            log: Recording after the change.
            problem: Its shots.
            hull: Hull-force model learnt from the earlier recording.
            vehicle: Vehicle file.

        Returns:
            The recording with its weights, whose `problem` has the shots as measured, and the vehicle file
            as a model without free components, on the corrected shots.
        """
        problem = problem.weighed(np.maximum(log.noise, hull.sigma) * hull.floor)
        compared = cls(log, hull, problem, folds(problem.shots.session))
        first = unfitted(vehicle, compared.corrected(vehicle))
        return replace(compared, weight=robust(first.costs)), first

    @property
    def unchanged(self) -> OutputError:
        """Shots of the earlier recording, corrected for the hull force, with the units of `problem`."""
        return self.hull.unchanged.weighed(self.problem.shots.sigma)

    def left_out(self, normal: Normal) -> Array:
        """Return the weighted held-out cost of each of S shots, by one linear step per fold, (S,).

        The step leads to the fit of all other folds.
        """
        weighed = replace(normal, gram=normal.gram * self.weight[:, None, None])
        return left_out_costs(Fitted(weighed, np.zeros(len(normal.gram[0]) - 1)), self.fold)

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

    def settled(self, model: Model) -> bool:
        """Return whether held-out costs by linear steps from a fit can be trusted.

        They can if they are at most RIGHT times the costs of the fit itself.
        """
        return bool(self.left_out(model.normal).sum() <= RIGHT * (self.weight * model.costs).sum())

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


def contend(
    compared: Compared,
    last: Model,
    chosen: Sequence[str],
    progress: Progress,
    first_fits: Callable[[Mapping[str, Contender]], None] | None = None,
) -> dict[str, Contender]:
    """Fit the candidates that score best after one Gauss-Newton step, and all effects of the current.

    Args:
        compared: Recording after the change.
        last: Vehicle with the changes so far.
        chosen: Effects that were added as changes already.
        progress: Called with a short text and the share of the work done.
        first_fits: Called once, with the fits of the first candidates.

    Returns:
        Fitted candidates, by effect.
    """
    vehicle, reach = last.vehicle, compared.log.track
    tried = [*suspects(vehicle, without=chosen, reach=reach), *_of_file(vehicle, chosen, reach)]
    ranked = scored_by_one_step(compared, last, tried)
    flows = [name for name in ranked if CATALOGUE[name].kind == "flow"]
    always = dict.fromkeys([*list(ranked)[:CONTENDERS], *flows])
    floor = compared.floor(last)
    right = RIGHT * floor
    fits: dict[str, Contender] = {}
    for number, name in enumerate(always):
        progress(f"{name} on held-out stretches", number / (2 * CONTENDERS))
        fine = _shapes(compared, last, name)
        table = (scored_by_one_step(compared, last, fine) if fine else ranked)[name][1]
        _join(fits, compared, last, table)
    if first_fits is not None:
        first_fits(fits)
    if _least(fits) > right:
        others = {name: scored for name, scored in ranked.items() if name not in always}
        for number, table in enumerate(_at_finer_places(compared, last, others), len(always)):
            if _least(fits) <= (FIT * floor if chosen and number >= 2 * CONTENDERS else right):
                break
            progress(f"{table['name']} on held-out stretches", min(number / (2 * CONTENDERS), 1.0))
            _join(fits, compared, last, table)
    if _least(fits) > FIT * floor:
        for table in _from_all_sides(vehicle, fits):
            _join(fits, compared, last, table)
        closest = sorted(fits, key=lambda name: fits[name].left)[:CLOSEST]
        for name in dict.fromkeys([*closest, *_stepwise(fits), *_far(fits)]):
            _join(fits, compared, last, fits[name].table, ITERATIONS)
    return fits


def _least(fits: Mapping[str, Contender]) -> float:
    """Return the least held-out cost of some fits; infinite without any."""
    return min((fit.left for fit in fits.values()), default=np.inf)


def _at_finer_places(compared: Compared, last: Model, coarse: Mapping[str, Scored]) -> list[Table]:
    """Return tables of effects at their best shapes, of the coarse or the finer grid, the best score first.

    Args:
        compared: Recording after the change.
        last: Vehicle with the changes so far.
        coarse: Score and table of each effect, from the coarse grid of shapes (`identification.suspects`).
    """
    tried = [one for name in coarse for one in _shapes(compared, last, name)]
    finer = scored_by_one_step(compared, last, tried)
    best = [max(scored, finer.get(name, scored), key=itemgetter(0)) for name, scored in coarse.items()]
    return [table for _, table in sorted(best, key=lambda scored: -scored[0])]


def _from_all_sides(vehicle: Vehicle, fits: Mapping[str, Contender]) -> list[Table]:
    """Return several starting tables for each effect that a fit from zero does not find."""
    return [
        {"name": name} | table
        for name in _far(fits)
        if not vehicle.effects(name)
        for table in CATALOGUE[name].identification.far
    ]


def _far(fits: Mapping[str, Contender]) -> list[str]:
    """Return the effects that a fit from zero does not find, so that they need several starts."""
    return [name for name in fits if CATALOGUE[name].identification.far]


def _stepwise(fits: Mapping[str, Contender]) -> list[str]:
    """Return the effects with thresholds and delays, whose local minima only a full fit escapes."""
    return [name for name, fit in fits.items() if any(one.resolution for one in fit.model.unknown.entries)]


def _shapes(compared: Compared, last: Model, name: str) -> list[Suspect]:
    """Return the finer grid of shapes of an effect that the vehicle lacks; empty for an existing one.

    A shape fixes a nonlinear parameter, such as a threshold or an anchor, see `identification.suspects`.
    """
    there = last.vehicle.effects(name)
    return [] if there else shapes(last.vehicle, name, reach=compared.log.track)


def _join(
    fits: dict[str, Contender],
    compared: Compared,
    last: Model,
    table: Table,
    iterations: int = QUICK_STEPS,
) -> None:
    """Fit an effect from a table, and keep the fit if it has the least held-out cost of this effect.

    A fit that diverges or that kinematics refutes is dropped.

    Args:
        fits: Fits by effect, to which the new one is added.
        compared: Recording after the change.
        last: Vehicle with the changes so far.
        table: `[[effect]]` table with starting values.
        iterations: Maximum number of iterations.
    """
    try:
        fit = fitted(compared, last, table, iterations, _least(fits))
    except (Diverges, np.linalg.LinAlgError):
        return
    if fit.effect in fits and fits[fit.effect].left <= fit.left:
        return
    if not refuted(compared.log.sensors, fit.effect, fit.model.vehicle):
        fits[fit.effect] = fit


def _of_file(vehicle: Vehicle, without: Sequence[str], reach: Array) -> list[Suspect]:
    """Return the nonlinear effects of the file as candidates, because each may have changed.

    Args:
        vehicle: Vehicle.
        without: Effects to leave out.
        reach: Positions [m] and times [s] of the recording, (N, 4).
    """
    there = dict.fromkeys(str(table["name"]) for table in vehicle.effect)
    curved = [name for name in there if name not in without and is_curved(name)]
    return [of_entries(vehicle, name, reach=reach) for name in curved if not wholly_known(vehicle, name)]


def scored_by_one_step(compared: Compared, last: Model, tried: Sequence[Suspect]) -> dict[str, Scored]:
    """Return each effect's score by one Gauss-Newton step and the table of that step, the best effect first.

    The score is the share of the held-out squared residual that the step removes, less a small penalty.

    Args:
        compared: Recording after the change.
        last: Vehicle with the changes so far.
        tried: Candidates; of several for one effect, the best counts.

    Returns:
        Pairs of score and `[[effect]]` table, by effect.
    """
    changed = [vehicle for suspect in tried for vehicle in suspect.changed]
    steps = [step for suspect in tried for step in suspect.steps]
    normal = last.problem.linearise(last.vehicle, changed, steps)
    whole, best, at = (
        float(compared.left_out(normal.of([])).sum()),
        dict[str, Scored](),
        0,
    )
    for suspect in tried:
        columns = list(range(at, at + len(suspect.steps)))
        at += len(columns)
        in_part = is_curved(suspect.effect) and bool(last.vehicle.effects(suspect.effect))
        kept = _needed(compared, normal, columns) if in_part else columns
        own = normal.of(kept)
        left = compared.left_out(own)
        score = 1.0 - float(left.sum()) / whole - VISIBLE * len(kept)
        if suspect.effect not in best or score > best[suspect.effect][0]:
            known, step = own.matrix.sum(axis=0) + np.eye(len(kept)) * SUSPECT_SPREAD**-2, np.zeros(at)
            step[kept] = np.linalg.solve(known, own.score.sum(axis=0))
            best[suspect.effect] = (score, suspect.begin(step[columns]))
    return dict(sorted(best.items(), key=lambda one: -one[1][0]))


def _needed(compared: Compared, normal: Normal, columns: Sequence[int]) -> list[int]:
    """Return the columns that lower the held-out cost by one step, added one by one, at least one of them.

    Two components of a curved effect may act alike: a fin's area, its offset and its deflection at full
    command all scale one force while the command is constant.  A step along all of them leads far away.
    """
    kept: list[int] = []
    least = whole = float(compared.left_out(normal.of([])).sum())
    while rest := [one for one in columns if one not in kept]:
        costs = [float(compared.left_out(normal.of(sorted([*kept, one]))).sum()) for one in rest]
        best = int(np.argmin(costs))
        if kept and costs[best] > least - VISIBLE * whole:
            break
        kept, least = sorted([*kept, rest[best]]), costs[best]
    return kept


def fitted(
    compared: Compared, last: Model, table: Table, iterations: int = QUICK_STEPS, least: float = np.inf
) -> Contender:
    """Return an effect as a contender, fitted with the hull forces that act on the fitted vehicle.

    A first fit with more than FIT times the cost `least` is not refined, because it cannot become the best.

    Args:
        compared: Recording after the change.
        last: Vehicle with the changes so far.
        table: `[[effect]]` table with starting values.
        iterations: Maximum number of iterations.
        least: Least held-out cost of the other candidates.

    Raises:
        Diverges: The predicted motion diverges.
    """
    model, name = fitted_together(compared, last, [table], iterations), str(table["name"])
    here = compared.weight * model.costs
    if not here.sum() <= FIT * least:
        return Contender(name, model, here)
    model = with_hull_response(compared, last, model)
    if not compared.settled(model):  # continue with the hull forces held too: they change with the motion
        with suppress(Diverges):
            again = continue_fit(model, QUICK_STEPS)
            model = again if again.normal.cost < model.normal.cost else model
    model = passive(model)
    return without_needless_entries(compared, last, Contender(name, model, compared.elsewhere(model)))


def with_hull_response(compared: Compared, last: Model, model: Model) -> Model:
    """Return a model refitted to shots that are corrected with the fitted vehicle's response to hull forces.

    The model was fitted to shots corrected with the response of `last`.  But a vehicle of different mass or
    drag responds differently to the same hull force.  After a large change, this leaves residuals of several
    times the floor (`Compared.of`), which another effect would absorb.

    So correction and fit are repeated, at most QUICK_STEPS // 2 times, until a round lowers the cost to
    no less than a share ALMOST_ALL.  A fit that diverges ends the rounds, too.  The result is the model of
    the least cost, also without convergence.

    Args:
        compared: Recording after the change.
        last: Vehicle with the changes so far.
        model: `last` with the fitted candidate effects.
    """
    names = model.unknown.effects
    for _ in range(QUICK_STEPS // 2):
        tables = [model.vehicle.effects(name)[0] for name in names]
        try:
            again = fitted_together(compared, last, tables, QUICK_STEPS, about=model.vehicle)
        except Diverges:
            return model
        left, model = model.normal.cost, min(again, model, key=lambda one: one.normal.cost)
        if not model.normal.cost < ALMOST_ALL * left:
            break
    return model


def without_needless_entries(compared: Compared, last: Model, whole: Contender) -> Contender:
    """Return a contender without components whose held-out gain is below their penalty; others are refitted.

    Usually one thruster fails, not all of them, and free components follow the hull's error.  The problem
    linearised about the fit shows which components are needed.  So this applies to effects that are linear in
    their components, and to effects of the file, whose components return to the file's values.

    Args:
        compared: Recording after the change.
        last: Vehicle with the changes so far.
        whole: Contender with all components.
    """
    model, count = whole.model, len(whole.model.values)
    curved = is_curved(whole.effect) and not last.vehicle.effects(whole.effect)
    if count < 2 or curved or CATALOGUE[whole.effect].kind in CHANGE_FLOW:
        return whole
    begun = in_file(last.vehicle, model.unknown.entries)
    normal = model.normal.after((begun - model.values) / model.unknown.scales)
    nothing = float(compared.left_out(normal.of([])).sum())
    kept, left = list(range(count)), float(compared.left_out(normal).sum())
    while len(kept) > 1:
        fewer = [[one for one in kept if one != out] for out in kept]
        costs = [float(compared.left_out(normal.of(columns)).sum()) for columns in fewer]
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
    leaner = Contender(whole.effect, model, compared.elsewhere(model))
    return leaner if leaner.left < whole.left + VISIBLE * nothing * (count - len(kept)) else whole


def fitted_together(
    compared: Compared,
    last: Model,
    tables: Sequence[Table],
    iterations: int = QUICK_STEPS,
    about: Vehicle | None = None,
) -> Model:
    """Return a model of the last vehicle with several candidate effects fitted together.

    Args:
        compared: Recording after the change.
        last: Vehicle with the changes so far.
        tables: `[[effect]]` tables of the candidates, with the initial values.
        iterations: Maximum number of steps.
        about: Vehicle whose response to the hull force is used; by default that of `last`.
    """
    reach = compared.log.track
    if not any(CATALOGUE[str(table["name"])].kind in CHANGE_FLOW for table in tables):
        problem = compared.corrected(about) if about is not None else last.problem
        return fit_model(last.vehicle, tables, problem, reach, iterations)
    shots = compared.problem.shots
    problem = Recomputed.of(compared.hull, Transitions.of(candidate(about or last.vehicle), shots))
    model = fit_model(last.vehicle, tables, problem, reach, iterations)
    return replace(model, problem=compared.corrected(model.vehicle))
