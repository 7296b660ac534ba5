"""What has changed between two recordings of one vehicle, whose hull no file describes exactly?

What the hull does beside its file is learnt from the recording before and held fixed in the one after
(`core.residual`), so that a change stands alone.  The file's effects keep their values, and are suspects like
all others.  Residuals are measured against what the model of the hull leaves of stretches of the recording
before that it was not fitted to: below that floor there is nothing.

Every suspect is scored by the share of the squared residual that it removes from sessions or stretches left
out, at first by one Gauss-Newton step from the file, then, of those that score most, about its own fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hydro.core.columns import Array, Progress, Rows
from hydro.core.diagnosis.confidence import Fitted, folds, left_out_costs, stated
from hydro.core.diagnosis.findings import SURE, Diagnosis, Finding
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Diverges, Model, as_it_is, fit_model
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.evaluation.block_resampling import weights
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.experiment import advice
from hydro.core.identification.candidate import candidate
from hydro.core.identification.fit import with_uncertainty
from hydro.core.identification.normal_equations import Normal
from hydro.core.identification.output_error import OutputError
from hydro.core.identification.prior import greatest_change
from hydro.core.identification.suspects import Suspect, shapes, suspects
from hydro.core.preprocessing.sensor_tests import vetoed
from hydro.core.residual.asked_anew import AskedAnew
from hydro.core.residual.hull import Hull
from hydro.core.residual.regression import robust
from hydro.core.residual.response import Transitions
from hydro.core.vehicle.description import Vehicle

NAMED = 0.10
"""Share of the residual left out that a change must remove to be named,"""
LEAST = 0.06
"""Share of the floor that it must remove besides,"""
FURTHER = 0.20
"""and a further one of what the first leaves, or of the floor where that is greater; below this share
confidence falls with it, since the hull's own error imitates small changes."""
PLAIN = 0.6
"""Part of the floor that a change must take to be plain beside what the hull's model leaves."""
WORSE = 0.5
"""Of the confidence in a change with which the file predicts worse a few seconds ahead."""
CONTENDERS = 5
QUICK = 6  # iterations of a contender's fit
SCALES = 2.0
"""Prior standard deviation of a suspect's parameters in their natural scales."""
FINE = 0.004
"""Share of the residual that each further parameter must remove for a larger effect to be preferred."""
ASKED = ("flow", "sensor")
"""Kinds of effects that change the motion through the water which the hull's wrench is asked about."""
RESAMPLES = 2000
MOST_CHANGES = 3
TIED = 0.02
"""Part of the resamples that a rival must win to be told beside the best."""


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

    def fined(self, whole: float) -> float:
        """Squared residual left out with a fine for every parameter."""
        return float(self.costs.sum()) + FINE * whole * len(self.model.values)


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

    def left_out(self, normal: Normal) -> Array:
        """Weighed squared residual of each shot, predicted by a step to all other folds, (S,)."""
        weighed = replace(normal, gram=normal.gram * self.weight[:, None, None])
        return left_out_costs(Fitted(weighed, np.zeros(len(normal.gram[0]) - 1)), self.fold)

    def chi2(self, model: Model) -> float:
        """Mean squared residual in units of what the model of the hull leaves of the recording before."""
        return float(self.weight @ model.costs / (self.weight @ model.normal.freedoms))

    def corrected(self, vehicle: Vehicle) -> OutputError:
        """The shots without the hull's share, asked for where this vehicle's current and log put it."""
        shots = self.problem.shots
        transitions = Transitions.of(candidate(vehicle), shots)
        wrench = self.hull.law.wrench(vehicle, shots)
        return OutputError(transitions.corrected(wrench)).at_measured_states(vehicle)


def diagnose_change(
    vehicle: Vehicle,
    log: Preprocessed,
    problem: OutputError,
    hull: Hull,
    progress: Progress,
    further: bool = False,
) -> Diagnosis:
    """Find what has changed.

    Args:
        vehicle: The file.
        log: The recording after.
        problem: Its shots.
        hull: What the recording before has taught.
        progress: Called with a few words and the share of the work done.
        further: Whether the vehicle has changes already, so that more is asked of the next one.
    """
    compared, first = Compared.of(log, problem, hull, vehicle)
    last, changes = first, list[Change]()
    while len(changes) < MOST_CHANGES and not ((further or changes) and compared.chi2(last) <= 1.0):
        progress(f"{len(changes)} changes found, looking for more", 0.3 + 0.2 * len(changes))
        rivals = contend(compared, last, [one.best.effect for one in changes])
        change = Change.of(compared, last, rivals)
        if change is None or not change.seen(further=further or bool(changes)):
            break
        changes = reconsidered(compared, first, [*changes, change])
        last = changes[-1].best.model
    return told(compared, first, changes, further)


def reconsidered(compared: Compared, first: Model, changes: list[Change]) -> list[Change]:
    """The changes; the second alone where, fitted without the first, it is the better of the two.

    An effect that only its own fit shows, as a threshold does, may come to light beside a poorer one first.
    """
    if len(changes) != 2:
        return changes
    before, name = changes[0], changes[1].best.effect
    (table,) = changes[1].best.model.vehicle.effects(name)
    try:
        alone = fitted(compared, first, table)
    except (Diverges, np.linalg.LinAlgError):
        return changes
    whole = float(before.whole.sum())
    if alone.fined(whole) >= before.best.fined(whole):
        return changes
    return [replace(before, best=alone, rivals={**before.rivals, name: alone})]


@dataclass(frozen=True)
class Change:
    """A change that was found.

    Attributes:
        best: The effect that is it.
        rivals: All that were fitted, by effect.
        whole: Squared residual of each shot without it, (S,).
        floor: What the model of the hull leaves of all of them.
    """

    best: Contender
    rivals: Mapping[str, Contender]
    whole: Array
    floor: float

    @classmethod
    def of(cls, compared: Compared, last: Model, rivals: Mapping[str, Contender]) -> Change | None:
        """The best of the rivals; None of none."""
        whole = compared.left_out(last.normal.of([]))
        if not rivals:
            return None
        best = min(rivals.values(), key=lambda one: one.fined(float(whole.sum())))
        return cls(best, rivals, whole, float(compared.weight @ last.normal.freedoms))

    @property
    def score(self) -> float:
        """Share of the squared residual left out that the best removes."""
        return float(1.0 - self.best.costs.sum() / self.whole.sum())

    @property
    def plain(self) -> float:
        """What it removes, as a share of what there is or of the floor where that is greater."""
        whole = float(self.whole.sum())
        return self.score * whole / max(whole, self.floor)

    def seen(self, further: bool) -> bool:
        """Whether it is large enough to be named, as the first or a further one."""
        if further:
            return self.plain >= FURTHER
        return self.score >= NAMED and self.score * float(self.whole.sum()) >= LEAST * self.floor

    def interval(self, seed: int = 1) -> tuple[float, float]:
        """95 % interval of the score."""
        both = np.column_stack([self.whole - self.best.costs, self.whole])
        drawn = weights(len(both), RESAMPLES, seed) @ both
        low, high = np.quantile(drawn[:, 0] / drawn[:, 1], [0.025, 0.975])
        return float(min(low, self.score)), float(max(high, self.score))

    def wins(self, seed: int = 0) -> dict[str, float]:
        """Part of the resampled recordings in which each rival is the best, the most frequent first."""
        names, each = list(self.rivals), float(self.whole.mean())
        fine = np.array([FINE * each * len(self.rivals[name].model.values) for name in names])
        costs = np.stack([self.rivals[name].costs for name in names], axis=1) + fine
        drawn = weights(len(costs), RESAMPLES, seed) @ costs
        part = np.bincount(drawn.argmin(axis=1), minlength=len(names)) / RESAMPLES
        order = np.argsort(-part, kind="stable")
        return {names[i]: float(part[i]) for i in order}


def contend(compared: Compared, last: Model, chosen: Sequence[str]) -> dict[str, Contender]:
    """Fit the suspects that score most by one Gauss-Newton step, and all that move the water.

    Args:
        compared: The recordings.
        last: The vehicle so far.
        chosen: Effects that are in it as changes already.
    """
    vehicle, log = last.vehicle, compared.log
    tried = suspects(vehicle, without=chosen, reach=log.positions)
    ranked = stepped(compared, last, tried)
    flows = [name for name in ranked if CATALOGUE[name].kind == "flow"]
    fits: dict[str, Contender] = {}
    for name in dict.fromkeys([*list(ranked)[:CONTENDERS], *flows]):
        fine = shapes(vehicle, name, reach=log.positions)
        table = (stepped(compared, last, fine) if fine else ranked)[name][1]
        try:
            fit = fitted(compared, last, table)
        except (Diverges, np.linalg.LinAlgError):
            continue
        test = log.sensors.get(name)
        if test is None or not any(vetoed(test, one) for one in fit.model.vehicle.effects(name)):
            fits[name] = fit
    return fits


def stepped(
    compared: Compared, last: Model, tried: Sequence[Suspect]
) -> dict[str, tuple[float, dict[str, object]]]:
    """Score of each effect by one Gauss-Newton step, and the table of its best shape, the best first."""
    changed = [vehicle for suspect in tried for vehicle in suspect.changed]
    steps = [step for suspect in tried for step in suspect.steps]
    normal = last.problem.linearise(last.vehicle, changed, steps)
    whole, best, at = (
        float(compared.left_out(normal.of([])).sum()),
        dict[str, tuple[float, dict[str, object]]](),
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


def fitted(compared: Compared, last: Model, table: Mapping[str, object]) -> Contender:
    """An effect fitted from the values of a table; what moves the water asks the hull's law anew."""
    model = fitted_together(compared, last, [table])
    return Contender(str(table["name"]), model, compared.left_out(model.normal))


def fitted_together(compared: Compared, last: Model, tables: Sequence[Mapping[str, object]]) -> Model:
    """Effects fitted together to what a vehicle leaves, from the values of their tables."""
    reach = compared.log.positions
    if not any(CATALOGUE[str(table["name"])].kind in ASKED for table in tables):
        return fit_model(last.vehicle, tables, last.problem, reach, QUICK)
    shots = compared.problem.shots
    anew = AskedAnew.of(compared.hull.law, Transitions.of(candidate(last.vehicle), shots))
    model = fit_model(last.vehicle, tables, anew, reach, QUICK)
    return replace(model, problem=compared.corrected(model.vehicle))


def told(compared: Compared, first: Model, changes: Sequence[Change], further: bool = False) -> Diagnosis:
    """The findings; chi2 are in units of what the model of the hull leaves."""
    given = compared.chi2(first)
    if not changes:
        words = (
            f"nothing {'more ' * further}has changed beyond what the model of the hull leaves: mean squared "
            f"residual {given:.3g} of that"
        )
        nothing = Finding("nothing_missing", advice=words)
        return Diagnosis((*compared.log.faults, nothing), first.vehicle, (given, given, given))
    left = [given, *(compared.chi2(change.best.model) for change in changes)]
    vehicles = [first.vehicle, *(change.best.model.vehicle for change in changes)]
    rises = np.diff(ahead(compared.log, vehicles)) > 0.0
    findings = [
        _finding(change, first.vehicle, compared.log.record.dt, removed, worse)
        for change, removed, worse in zip(changes, -np.diff(left), rises, strict=True)
    ]
    return Diagnosis((*compared.log.faults, *findings), vehicles[-1], (given, given, left[-1]))


def ahead(log: Preprocessed, vehicles: Sequence[Vehicle]) -> Array:
    """Errors of vehicles 5 s ahead [m/s], (V,), weighed as of the first; NaN where no session is as long."""
    try:
        errors = Ahead(log.raw, vehicles[0])
        return np.array([errors.first, *(errors.of(vehicle) for vehicle in vehicles[1:])])
    except DataError:
        return np.full(len(vehicles), np.nan)


def _finding(change: Change, file: Vehicle, dt: float, removed: float, worse: bool) -> Finding:
    """A change as a finding.

    Args:
        change: The change.
        file: The file.
        dt: Sample time of the recording after [s].
        removed: What it takes of the residual, in units of the floor.
        worse: Whether the vehicle predicts the motion 5 s ahead worse with it.
    """
    name, wins, model = change.best.effect, change.wins(), change.best.model
    fit = with_uncertainty(model.unknown, model.values, model.normal, model.normal.chi2, "output")
    parameters, errors = fit.table(name)
    words = f"it removes {change.score:.0%} of the residual of stretches that it was not fitted to"
    rivals = [f"{other} ({part:.0%})" for other, part in wins.items() if other != name and part >= TIED]
    if rivals:
        words += f"; some of the recording would rather have {', '.join(rivals)}"
    if worse:
        words += "; the file predicts the motion 5 s ahead worse with it, which speaks against it"
    # What a model of the hull leaves, formulas of drag and lift take up first.
    absorbs = CATALOGUE[name].identification.absorbs
    known = bool(file.effects(name))
    if known:
        entries = [entry for entry in model.unknown.entries if entry.effect == name]
        words = f"{advice.retuning(name, greatest_change(file, entries, model.values))}; {words}"
    else:
        words = f"{advice.adding(name, parameters, dt)}; {words}"
    found = Finding(
        "retune" if known else "missing",
        name,
        (name,),
        change.score,
        *change.interval(),
        confidence=wins[name]
        * min(1.0, change.plain / FURTHER)
        * min(1.0, max(removed, 0.0) / PLAIN)
        * (1.0 - absorbs)
        * (WORSE if worse else 1.0),
        parameters=parameters,
        standard_errors=errors,
        advice=words,
        support=wins[name],
    )
    if known and found.confidence < SURE:
        return replace(found, verdict="suspect", advice=advice.suspecting(name, found.advice))
    return stated(found)
