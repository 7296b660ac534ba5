"""What may have changed: every suspect, fitted beside the model of the hull and scored on data left out.

A suspect is scored by the share of the squared residual that it removes from sessions or stretches left out,
at first by one Gauss-Newton step from the file, then, of those that score most, about its own fit, with no
more entries than are worth their fine there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import Any, cast

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.confidence import Fitted, folds, left_out_costs
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.misread import refuted
from hydro.core.diagnosis.model import Diverges, Model, as_it_is, fit_model, gone_on, held_at
from hydro.core.effects import CATALOGUE
from hydro.core.effects.catalogue import wholly_known
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.prior import in_file
from hydro.core.identification.suspects import Suspect, is_curved, of_entries, shapes, suspects
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.output_error import OutputError
from hydro.core.progress import Progress
from hydro.core.residual.asked_anew import AskedAnew
from hydro.core.residual.hull import Hull
from hydro.core.residual.regression import robust
from hydro.core.residual.response import Transitions
from hydro.core.vehicle.description import Vehicle

CONTENDERS = 5
RIGHT, MOST_CONTENDERS = 1.5, 10
"""Floors that a model which is right leaves at most; while the best leaves more, others are fitted, of a
further change so many: one step says little of what changes the motion altogether or acts in few places."""
FAR, WILD = 3.0, 10.0
"""Floors from which all are fitted of a further change, too, and some begun from elsewhere; and from which
the closest go on: what makes a vehicle tumble shows in no step from the file."""
NEARLY_ALL = 0.01  # part of all there is that one may leave, up to FAR floors, and none be looked for
CLOSEST, LONG = 3, 24  # how many go on, and by so many iterations
FARTHER = 2.0  # times as far off as its record says an effect is begun besides
QUICK = 6  # iterations of a contender's fit
HOPELESS = 3.0
"""Times what the best leaves that another may leave at first and still come to be it."""
AGAIN, SETTLED = 3, 0.9
"""Times at most that a fit is made anew to what the hull does to the fitted vehicle, and part of what the one
before left that the next leaves where that has settled."""
FAR_OFF = 2.0
"""Times what a fit leaves that linear steps to the other folds may leave of them and still be believed."""
SCALES = 2.0
"""Prior standard deviation of a suspect's parameters in their natural scales."""
FINE = 0.004
"""Share of the residual that an entry of an effect must remove to be kept,"""
PREFERRED = 0.012
"""and that each further parameter must for a larger effect to be preferred: a hull's error is alike on all
stretches, so that data left out do not fine it for what follows that error."""
FOLLOWS = 0.2
"""Part of what an effect absorbs of a hull (`absorbs`) that it takes of the error of the hull's law."""
ASKED = ("flow", "sensor")
"""Kinds of effects that change the motion through the water which the hull's wrench is asked about."""
Table = Mapping[str, Any]
Scored = tuple[float, Table]
"""What a step promises, and where it leads."""


@dataclass(frozen=True)
class Contender:
    """An effect fitted as the change.

    Attributes:
        effect: Its name.
        model: The vehicle with it, over shots with the hull's share taken out.
        costs: Squared residual of each shot, predicted by the fit to all other folds, (S,).
    """

    effect: str
    model: Model
    costs: Array

    @property
    def table(self) -> Table:
        """Its `[[effect]]` table as fitted."""
        return self.model.vehicle.effects(self.effect)[0]

    @property
    def left(self) -> float:
        """Squared residual left out."""
        return float(self.costs.sum())

    def fine(self, rivals: Iterable[Contender], whole: float, floor: float) -> float:
        """What it must remove to be preferred to an effect of no parameters.

        Where one of the rivals leaves no more than the hull's law does, parameters are fined by that: what
        they remove besides was there.  Else by all that there is, since none is right.

        Args:
            rivals: All that were fitted.
            whole: Squared residual without any of them.
            floor: What the hull's law leaves.
        """
        absorbs = CATALOGUE[self.effect].identification.absorbs
        right = min(one.left for one in rivals) <= RIGHT * floor
        at_stake = min(whole, FAR * floor) if right else whole
        return PREFERRED * at_stake * len(self.model.values) + FOLLOWS * absorbs * floor


@dataclass(frozen=True)
class Compared:
    """The recording after, with what the hull does beside its file taken out.

    Attributes:
        log: The recording.
        hull: What the recording before has taught.
        problem: The shots as measured, weighed by the floor.
        fold: What is left out with each, (S,).
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
        """The shots, weighed by the floor and about the errors of a vehicle; and the vehicle as it is."""
        problem = problem.weighed(np.maximum(log.noise, hull.sigma) * hull.floor)
        compared = cls(log, hull, problem, folds(problem.shots.session))
        first = as_it_is(vehicle, compared.corrected(vehicle))
        return replace(compared, weight=robust(first.costs)), first

    @property
    def unchanged(self) -> OutputError:
        """The shots of the recording before without what the hull does beside its file, likewise weighed."""
        return self.hull.unchanged.weighed(self.problem.shots.sigma)

    def left_out(self, normal: Normal) -> Array:
        """Weighed squared residual of each shot, predicted by a step to all other folds, (S,)."""
        weighed = replace(normal, gram=normal.gram * self.weight[:, None, None])
        return left_out_costs(Fitted(weighed, np.zeros(len(normal.gram[0]) - 1)), self.fold)

    def elsewhere(self, model: Model) -> Array:
        """The same about a fit, (S,); its residuals where a step beyond its bounds would promise less.

        Where steps to the other folds lead so far that the linear problem says nothing, folds are left out in
        earnest: a shot that tumbles would decide alone.
        """
        left, here = self.left_out(model.normal), self.weight * model.costs
        if left.sum() > FAR_OFF * here.sum():
            again = self.refitted(model)
            return again if again.sum() < left.sum() else left
        return left if left.sum() >= here.sum() else here

    def settled(self, model: Model) -> bool:
        """Whether steps from a fit to the other folds stay where the problem about it is nearly linear."""
        return bool(self.left_out(model.normal).sum() <= FAR_OFF * (self.weight * model.costs).sum())

    def refitted(self, model: Model) -> Array:
        """The same by fits to all other folds, begun at this one, (S,); infinite where one diverges."""
        shots, found = cast(OutputError, model.problem).shots, np.full(len(self.fold), np.inf)
        for number in np.unique(self.fold):
            out = self.fold == number
            try:
                there = gone_on(model.over(~out), QUICK).vehicle
            except Diverges:
                continue
            found[out] = as_it_is(there, OutputError(shots.of(out))).costs
        return np.asarray(self.weight * found)

    def floor(self, model: Model) -> float:
        """Squared residual of all shots if they left what the model of the hull leaves of those before."""
        return float(self.weight @ model.normal.freedoms)

    def chi2(self, model: Model) -> float:
        """Mean squared residual in units of what the model of the hull leaves of the recording before."""
        return float(self.weight @ model.costs) / self.floor(model)

    def corrected(self, vehicle: Vehicle) -> OutputError:
        """The shots without the hull's share, asked for where this vehicle's current and log put it."""
        shots = self.problem.shots
        transitions = Transitions.of(candidate(vehicle), shots)
        wrench = self.hull.law.wrench(vehicle, shots)
        return OutputError(transitions.corrected(wrench)).at_measured_states(vehicle)


def contend(
    compared: Compared, last: Model, chosen: Sequence[str], progress: Progress
) -> dict[str, Contender]:
    """Fit the suspects that score most by one Gauss-Newton step, and all that move the water.

    Args:
        compared: The recordings.
        last: The vehicle so far.
        chosen: Effects that are in it as changes already.
        progress: Called with a few words and the share of the work done.
    """
    vehicle, reach = last.vehicle, compared.log.track
    tried = [*suspects(vehicle, without=chosen, reach=reach), *_of_file(vehicle, chosen, reach)]
    ranked = stepped(compared, last, tried)
    flows = [name for name in ranked if CATALOGUE[name].kind == "flow"]
    always = dict.fromkeys([*list(ranked)[:CONTENDERS], *flows])
    floor = compared.floor(last)
    whole = float(compared.left_out(last.normal.of([])).sum())
    right = float(np.clip(NEARLY_ALL * whole, RIGHT * floor, FAR * floor))
    fits: dict[str, Contender] = {}
    for number, name in enumerate(always):
        progress(f"{name} on stretches left out", number / MOST_CONTENDERS)
        fine = _shapes(compared, last, name)
        table = (stepped(compared, last, fine) if fine else ranked)[name][1]
        _join(fits, compared, last, table)
    if _least(fits) > right:
        others = {name: scored for name, scored in ranked.items() if name not in always}
        for number, table in enumerate(_at_finer_places(compared, last, others), len(always)):
            if _least(fits) <= (FAR * floor if chosen and number >= MOST_CONTENDERS else right):
                break
            progress(f"{table['name']} on stretches left out", min(number / MOST_CONTENDERS, 1.0))
            _join(fits, compared, last, table)
    if _least(fits) > FAR * floor:
        for table in _from_all_sides(vehicle, fits):
            _join(fits, compared, last, table)
        for name in _stepwise(fits):
            _join(fits, compared, last, fits[name].table, ITERATIONS)
    if _least(fits) > WILD * floor:
        closest = sorted(fits, key=lambda name: fits[name].left)[:CLOSEST]
        for name in dict.fromkeys([*closest, *_far(fits)]):
            _join(fits, compared, last, fits[name].table, LONG)
    return fits


def _least(fits: Mapping[str, Contender]) -> float:
    """What the best of some fits leaves."""
    return min((fit.left for fit in fits.values()), default=np.inf)


def _at_finer_places(compared: Compared, last: Model, coarse: Mapping[str, Scored]) -> list[Table]:
    """Tables of effects at their best places, coarse or finer, the most promising first."""
    tried = [one for name in coarse for one in _shapes(compared, last, name)]
    finer = stepped(compared, last, tried)
    best = [max(scored, finer.get(name, scored), key=itemgetter(0)) for name, scored in coarse.items()]
    return [table for _, table in sorted(best, key=lambda scored: -scored[0])]


def _from_all_sides(vehicle: Vehicle, fits: Mapping[str, Contender]) -> list[Table]:
    """Where to begin where no derivative about an effect's absence leads: on every side, and twice as far."""
    return [
        {"name": name} | {key: times * value for key, value in table.items()}
        for name in _far(fits)
        if not vehicle.effects(name)
        for table in CATALOGUE[name].identification.far
        for times in (1.0, FARTHER)
    ]


def _far(fits: Mapping[str, Contender]) -> list[str]:
    """Effects that are begun from several sides."""
    return [name for name in fits if CATALOGUE[name].identification.far]


def _stepwise(fits: Mapping[str, Contender]) -> list[str]:
    """Effects with thresholds and delays, which a fit to the end looks for beyond corners that hold it."""
    return [name for name, fit in fits.items() if any(one.resolution for one in fit.model.unknown.entries)]


def _shapes(compared: Compared, last: Model, name: str) -> list[Suspect]:
    """The finer grid of an effect that the vehicle has not: kinks and anchors lie between coarse places."""
    there = last.vehicle.effects(name)
    return [] if there else shapes(last.vehicle, name, reach=compared.log.track)


def _join(
    fits: dict[str, Contender],
    compared: Compared,
    last: Model,
    table: Table,
    iterations: int = QUICK,
) -> None:
    """Fit an effect from a table, and put it among the fits where it leaves less than the one that is there.

    Not where it diverges or kinematics refutes it.
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
    """Effects of the file that are not linear, about the values that it has: a change of one is as likely."""
    there = dict.fromkeys(str(table["name"]) for table in vehicle.effect)
    curved = [name for name in there if name not in without and is_curved(name)]
    return [of_entries(vehicle, name, reach=reach) for name in curved if not wholly_known(vehicle, name)]


def stepped(compared: Compared, last: Model, tried: Sequence[Suspect]) -> dict[str, Scored]:
    """Score of each effect by one Gauss-Newton step, and the table of its best shape, the best first."""
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
        own = normal.of(columns)
        left = compared.left_out(own)
        score = 1.0 - float(left.sum()) / whole - FINE * len(columns)
        if suspect.effect not in best or score > best[suspect.effect][0]:
            known = own.matrix.sum(axis=0) + np.eye(len(columns)) * SCALES**-2
            step = np.linalg.solve(known, own.score.sum(axis=0))
            best[suspect.effect] = (score, suspect.begin(step))
    return dict(sorted(best.items(), key=lambda one: -one[1][0]))


def fitted(
    compared: Compared, last: Model, table: Table, iterations: int = QUICK, least: float = np.inf
) -> Contender:
    """An effect fitted from the values of a table, and to what the hull does to a vehicle that has it.

    One that leaves many times what another does, the `least`, stays as it is: it will not be the best.
    """
    model, name = fitted_together(compared, last, [table], iterations), str(table["name"])
    here = compared.weight * model.costs
    if not here.sum() <= HOPELESS * least:
        return Contender(name, model, here)
    model = answering(compared, last, model)
    if not compared.settled(model):  # with what the hull does held, too: it changes with the motion there
        with suppress(Diverges):
            again = gone_on(model, QUICK)
            model = again if again.normal.cost < model.normal.cost else model
    return lean(compared, last, Contender(name, model, compared.elsewhere(model)))


def answering(compared: Compared, last: Model, model: Model) -> Model:
    """A fit of effects to what the hull makes of the motion of a vehicle that has them.

    A vehicle of other mass or drag answers otherwise to what the hull does beside the file: of a great change
    the correction by the last vehicle's answers leaves several floors, and another effect takes them up.
    """
    names = dict.fromkeys(entry.effect for entry in model.unknown.entries)
    for _ in range(AGAIN):
        tables = [model.vehicle.effects(name)[0] for name in names]
        try:
            again = fitted_together(compared, last, tables, QUICK, about=model.vehicle)
        except Diverges:
            return model
        left, model = model.normal.cost, min(again, model, key=lambda one: one.normal.cost)
        if not model.normal.cost < SETTLED * left:
            break
    return model


def lean(compared: Compared, last: Model, whole: Contender) -> Contender:
    """The contender without entries that are not worth their fine on data left out, the others fitted alone.

    One thruster fails, not all of them, and entries that are free follow the hull's own error.  Which are
    needed the problem about the fit says; so it is done where an effect is linear in its entries, or the
    file has values to go back to.
    """
    model, count = whole.model, len(whole.model.values)
    curved = is_curved(whole.effect) and not last.vehicle.effects(whole.effect)
    if count < 2 or curved or CATALOGUE[whole.effect].kind in ASKED:
        return whole
    begun = in_file(last.vehicle, model.unknown.entries)
    normal = model.normal.after((begun - model.values) / model.unknown.scales)
    nothing = float(compared.left_out(normal.of([])).sum())
    kept, left = list(range(count)), float(compared.left_out(normal).sum())
    while len(kept) > 1:
        fewer = [[one for one in kept if one != out] for out in kept]
        costs = [float(compared.left_out(normal.of(columns)).sum()) for columns in fewer]
        best = int(np.argmin(costs))
        if costs[best] > left + FINE * nothing:
            break
        kept, left = fewer[best], costs[best]
    if len(kept) == count:
        return whole
    held = ~np.isin(np.arange(count), kept)
    try:
        model = held_at(model, np.where(held, begun, model.values), held, QUICK)
    except Diverges:
        return whole
    leaner = Contender(whole.effect, model, compared.elsewhere(model))
    return leaner if leaner.left < whole.left + FINE * nothing * (count - len(kept)) else whole


def fitted_together(
    compared: Compared,
    last: Model,
    tables: Sequence[Table],
    iterations: int = QUICK,
    about: Vehicle | None = None,
) -> Model:
    """Effects fitted together to what a vehicle leaves, from the values of their tables.

    Args:
        compared: The recordings.
        last: The vehicle so far.
        tables: The effects.
        iterations: Steps at most.
        about: The vehicle that answers to what the hull does beside the file; by default the last one.
    """
    reach = compared.log.track
    if not any(CATALOGUE[str(table["name"])].kind in ASKED for table in tables):
        problem = compared.corrected(about) if about is not None else last.problem
        return fit_model(last.vehicle, tables, problem, reach, iterations)
    shots = compared.problem.shots
    anew = AskedAnew.of(compared.hull.law, Transitions.of(candidate(about or last.vehicle), shots))
    model = fit_model(last.vehicle, tables, anew, reach, iterations)
    return replace(model, problem=compared.corrected(model.vehicle))
