"""Trials of the candidates for a step: the best prediction of held-out stretches wins.

Unconfirmed effects of a diagnosis are tried together with those of the catalogue that promise most
(`explanation.screening`).  Each is fitted together with all existing effects.  It then predicts stretches
that its fit does not use, over the horizon of the ladder.  With a hull-force model from an earlier recording,
a change is fitted with the changes of earlier steps only.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl

from hydro.core.cleaning.readiness import require_ready
from hydro.core.diagnosis.baseline import stable_part, stable_start, weighed_fit
from hydro.core.diagnosis.by_change import fit_changes
from hydro.core.diagnosis.by_likelihood import settled
from hydro.core.diagnosis.confidence import folds
from hydro.core.diagnosis.findings import extended
from hydro.core.diagnosis.log_faults import Preprocessed, preprocess, preprocess_alike
from hydro.core.diagnosis.model import Diverges, Wanted, fit_model, names_of, unfitted
from hydro.core.diagnosis.sensor_errors import by_kinematics
from hydro.core.diagnosis.settings import (
    CLOSEST,
    CONTENDERS,
    FAR_FROM_NOISE,
    FIT,
    LEAST_SHOTS,
    NEGLIGIBLE,
    QUICK_STEPS,
    SHOTS,
)
from hydro.core.diagnosis.transfer import left_out_squares, resolved
from hydro.core.effects.catalogue import CATALOGUE, implausible, own_effects, with_role
from hydro.core.effects.record import BOOKKEEPING, Role
from hydro.core.errors import DataError
from hydro.core.evaluation.compare import compare
from hydro.core.evaluation.velocity_errors import Squares, squares_ahead, squares_at_rest
from hydro.core.evaluation.yardsticks import Yardstick
from hydro.core.explanation.axes import worse_axes
from hydro.core.explanation.ladder import HORIZON, Step
from hydro.core.explanation.options import Table, finding_option, is_open, options, states
from hydro.core.explanation.screening import promising
from hydro.core.explanation.with_hull import with_hull
from hydro.core.identification.fit import by_equation_error
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.outcome import Fit
from hydro.core.identification.suspects import plainer, with_one_value
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import free
from hydro.core.prediction.weak_form import Windows
from hydro.core.progress import Progress, part
from hydro.core.recording.shots import room
from hydro.core.residual.hull import Hull
from hydro.core.simulation.estimates import Estimates
from hydro.core.threads import shared
from hydro.core.vehicle.description import Vehicle

STEADY = with_role(Role.STEADY_LOAD)
"""Steady loads, tried with each effect that changes the thrust which balances them."""


@dataclass(frozen=True)
class Recordings:
    """Recordings of a study, preprocessed once, with what makes the errors of its steps comparable.

    Attributes:
        log: Recording of all fits.
        holdout: Held-out recording; None without one.
        yardstick: Weights of the axes and simple predictors for the file as given and all steps.
        hull: Hull-force model from a recording before a change; None without one.
    """

    log: Preprocessed
    holdout: Preprocessed | None
    yardstick: Yardstick
    hull: Hull | None

    @classmethod
    def of(
        cls, vehicle: Vehicle, raw: pl.DataFrame, holdout: pl.DataFrame | None, hull: Hull | None
    ) -> Recordings:
        """Return both recordings preprocessed; the held-out one gets the other one's order of commands."""
        log = preprocess(vehicle, raw, hull)
        require_ready(log.observed)
        other = None if holdout is None else preprocess_alike(vehicle, holdout, log.wiring)
        return cls(log, other, Yardstick.crossed(vehicle, log.record), hull)

    @cached_property
    def problem(self) -> OutputError:
        """At most SHOTS short predictions of the fitted recording, with each channel weighted by its noise.

        The effects of the catalogue are linearised on these shots.
        """
        return resolved(stable_start(self.yardstick.vehicle, self.log)[1]).some(SHOTS)

    @cached_property
    def windows(self) -> Windows:
        """At most SHOTS windows of the fitted recording, for fits by equation error."""
        return Windows.of(self.log.record, self.log.noise, SHOTS)

    def ahead(self, vehicle: Vehicle, most: int) -> OutputError | None:
        """Return shots of length HORIZON for a fit; None if too few of the vehicle's predictions are finite.

        Each channel is weighted by the vehicle's residual, because sensor noise is not the relevant scale far
        from the noise.  Logged initial states keep the noise of the log: an error of the model does not make
        the sensors worse, and free initial states would absorb part of it.
        """
        enough = room(self.log.record, HORIZON) >= LEAST_SHOTS
        stable = stable_part(self.log.shots(HORIZON), vehicle) if enough else None
        if stable is None or len(stable.shots.starts) < LEAST_SHOTS:
            return None
        problem = stable.some(most).anchored()
        normal = unfitted(vehicle, problem).normal
        weighted = problem.reweighted(normal)[0]
        return weighted.coarsened(vehicle) if normal.chi2 > FAR_FROM_NOISE else weighted

    def is_far(self, vehicle: Vehicle) -> bool:
        """Return whether the mean squared residual of a vehicle exceeds FAR_FROM_NOISE, in units of noise."""
        problem = OutputError.of(self.problem.shots, vehicle).weighed(self.log.noise)
        return unfitted(vehicle, problem).normal.chi2 > FAR_FROM_NOISE

    def judged(self, vehicle: Vehicle) -> OutputError:
        """Return the shots to which candidates are fitted, and on which they are compared.

        They are of length HORIZON (`ahead`), or those of `problem` if there are too few.
        """
        return self.ahead(vehicle, SHOTS // 2) or OutputError.of(self.problem.shots, vehicle)

    def compared(self, vehicle: Vehicle, log: Preprocessed, progress: Progress) -> pl.DataFrame:
        """Return the comparison table of a vehicle and one of the two recordings.

        With a hull-force model the table has rows of the level `hull` too.

        `log` is one of the two recordings of this object.
        """
        yardstick = self.yardstick if log is self.log else self.yardstick.of_others
        found = compare(vehicle, log.raw, record=log.observed, yardstick=yardstick, progress=progress)
        return found if self.hull is None else with_hull(found, vehicle, log, self.hull)

    def error_ahead(self, vehicle: Vehicle) -> float:
        """Return the error of the vehicle's velocities over the recording, HORIZON ahead [m/s]."""
        return self.error(squares_ahead(vehicle, self.log.shots(HORIZON)))

    def left_out(
        self, vehicle: Vehicle, fitted: Sequence[str], problem: OutputError | None = None
    ) -> Squares:
        """Return the squared errors of held-out stretches, HORIZON ahead; each fit leaves some stretches out.

        By default the fits use the shots of `judged`.
        """
        begun = (problem or self.judged(vehicle)).at_measured_states(vehicle)
        return left_out_squares(vehicle, fitted, begun, self.log.shots(HORIZON))

    def error(self, squares: Squares) -> float:
        """Return the root mean square error of all axes together [m/s]."""
        return squares.error(self.yardstick.weights.velocity)

    def worsened_axes(self, before: Squares, after: Squares) -> tuple[str, ...]:
        """Return the axes that are predicted significantly worse than before.

        An axis counts only if zero velocity would be significantly worse than before, or better than after.
        Otherwise its prediction was worthless before.
        """
        rest = squares_at_rest(self.log.shots(HORIZON))
        lost = {*worse_axes(before, rest), *worse_axes(rest, after)}
        return tuple(axis for axis in worse_axes(before, after) if axis in lost)

    def started(self, vehicle: Vehicle, effects: Sequence[str]) -> Vehicle:
        """Return the vehicle from which fits start: as given, or with values of effects by equation error.

        The one that predicts the recording better is chosen.  Equation error integrates nothing, so values
        far from the truth do not lead it into a poor local minimum.
        """
        unknown = free(vehicle, effects, reach=self.log.track) if effects else None
        if unknown is None or not unknown.entries:
            return vehicle
        there = unknown.at(by_equation_error(unknown, self.windows, self.log.track)[0])
        return min(vehicle, there, key=self.error_ahead)

    def promising(self, vehicle: Vehicle, own: Sequence[str]) -> list[dict[str, Any]]:
        """Return starting tables of effects that lower the held-out error, the largest gain first.

        Predictions of a vehicle that is far from the noise may leave the measured motion, where effects would
        act otherwise.  Then effects are ranked by equation error, along that motion.
        """
        if not self.is_far(vehicle):
            problem = OutputError.of(self.problem.shots, vehicle)
            return promising(vehicle, own, problem, folds(problem.shots.session), self.log.track)
        windows, _ = self.windows.reweighted(unfitted(vehicle, self.windows).normal)
        return promising(vehicle, own, windows, folds(windows.session), self.log.track)

    def tried(
        self, vehicle: Vehicle, wanted: Wanted, problem: OutputError, iterations: int = QUICK_STEPS
    ) -> Vehicle:
        """Return the vehicle with effects fitted to some shots.

        Raises:
            Diverges: The predicted motion diverges.
        """
        begun = free(vehicle, wanted, reach=self.log.track)
        problem = problem.at_measured_states(begun.at(begun.starts[0]))
        return fit_model(vehicle, wanted, problem, self.log.track, iterations).vehicle

    def fit_from(self, vehicle: Vehicle, names: Sequence[str], problem: OutputError) -> Fit | None:
        """Return the fit of effects to some shots from a vehicle's values; None if it diverges."""
        try:
            begun = problem.at_measured_states(vehicle)
            return fit_model(vehicle, names, begun, self.log.track, ITERATIONS).estimated()
        except Diverges:
            return None


@dataclass(frozen=True)
class Trial:
    """Candidate for a step, fitted together with all existing effects.

    Attributes:
        added: Effects that the candidate adds, or refits if it adds none.
        tables: `[[effect]]` tables of all effects that were fitted together, with standard errors.
        vehicle: Vehicle file of step 0 with these effects.
        estimates: Values of `tables` with their covariance; None if no value was fitted.
    """

    added: tuple[str, ...]
    tables: tuple[dict[str, Any], ...]
    vehicle: Vehicle
    estimates: Estimates | None = None


def best_trial(last: Step, file: Vehicle, recordings: Recordings, progress: Progress) -> Trial | None:
    """Return the candidate with the best prediction of held-out stretches, fitted to convergence.

    Only the candidates whose quick fits predict the recording best are tested.  Values that physics excludes
    show that an effect stands for another.  Among quick fits such a candidate counts only if no other has
    plausible values; in the final fit the next best comes first.  The result is None where no
    unconfirmed candidate predicts these stretches better than the last step, or than the refitted file.  Far
    from the noise, pairs of the best candidates are tried where none alone is better: one may be needed for
    the values of the other, as added mass and the cross terms of damping.
    """
    every, undecided = options(last), is_open(last)
    if not undecided and len(every) == 1:
        progress("all together", 0.0)
        return _trial(last, every[0], file, recordings)
    if undecided:
        progress("all effects against the residual", 0.0)
        every += _beside(last, every, recordings)
    every = [one for found in every for one in (found, *_with_loads(last, found))]
    begun = last
    if undecided and not last.tables:  # the file as given may be far from any good fit
        begun = replace(last, vehicle=recordings.started(last.vehicle, _fitted_there(last)))
    tests = QuickFits(begun, file, recordings, recordings.judged(begun.vehicle))
    quick = tests.of(every, progress)
    progress("the best of them on held-out stretches", 0.5)
    order, first = tests.best_of(quick), None
    if not order and undecided and recordings.is_far(begun.vehicle):
        order = tests.best_of(tests.of(_pairs(quick), part(progress, 0.6, 0.8)))
    progress("joint fit", 0.8)
    for one in order:
        trial = _trial(last, one.found, file, recordings, one.vehicle)
        if not implausible(trial.vehicle, trial.added):
            return trial
        first = first or trial
    stated = next((one for one in every if states(last, next(iter(one)))), None)
    return first if stated is None or first else _trial(last, stated, file, recordings)


def chosen_trial(last: Step, effect: str, file: Vehicle, recordings: Recordings) -> Trial:
    """Return the trial of one finding of the last diagnosis, fitted together with all existing effects.

    Raises:
        DataError: The diagnosis has no values for the effect, or the fit diverges.
    """
    return _trial(last, finding_option(last, effect), file, recordings)


def _beside(
    last: Step, every: Sequence[Mapping[str, Table]], recordings: Recordings
) -> list[dict[str, Table]]:
    """Return further candidates of the catalogue that are no choices yet, the most promising first."""
    found = recordings.promising(last.vehicle, _fitted_there(last))
    tried = {next(iter(one)) for one in every}
    others: list[dict[str, Table]] = [{table["name"]: table} for table in found if table["name"] not in tried]
    return others[: max(2 * CONTENDERS - len(every), 0)]


def _pairs(quick: Sequence[Quick]) -> list[dict[str, Table]]:
    """Return the pairs of the CLOSEST candidates by the error of their quick fits."""
    best = dict[str, Mapping[str, Table]]()
    for one in sorted(quick, key=lambda one: one.error):
        best.setdefault(one.effect, one.found)
    return [{**one, **other} for one, other in itertools.combinations([*best.values()][:CLOSEST], 2)]


def _with_loads(last: Step, found: Mapping[str, Table]) -> list[dict[str, Table]]:
    """Return a candidate of the thrusters extended by the steady loads that the vehicle lacks.

    Mean thrust balances steady loads.  A change of the thrusters alone would move the vehicle off its
    balance.  The result is empty for other candidates, and if the vehicle has these loads.
    """
    loads = {name: {"name": name} for name in STEADY if not (name in found or last.vehicle.effects(name))}
    changes_thrust = CATALOGUE[next(iter(found))].kind == "actuator"
    return [{**found, **loads}] if changes_thrust and loads else []


@dataclass(frozen=True)
class Quick:
    """Fit of a candidate with few iterations, together with all existing effects.

    Attributes:
        found: Tables of the candidate by effect; the new effect is first.
        wanted: Names or starting tables of all effects that were fitted together.
        vehicle: Vehicle with the fitted effects.
        is_implausible: Whether physics excludes the candidate's values.
        error: Error of predictions HORIZON ahead over the fitted recording [m/s].
    """

    found: Mapping[str, Table]
    wanted: Wanted
    vehicle: Vehicle
    is_implausible: bool
    error: float

    @property
    def effect(self) -> str:
        """Name of the new effect."""
        return next(iter(self.found))

    def ended(self, recordings: Recordings) -> Quick:
        """Return a copy with the fit continued to convergence; this fit itself if that diverges.

        The fit continues on shots whose channels are weighted by the residual of the quick fit.
        """
        try:
            problem = recordings.judged(self.vehicle)
            vehicle = recordings.tried(self.vehicle, names_of(self.wanted), problem, ITERATIONS)
        except DataError:
            return self
        return replace(self, vehicle=vehicle)

    @property
    def entries(self) -> int:
        """Number of parameters that were fitted together."""
        return len(free(self.vehicle, names_of(self.wanted)).entries)


@dataclass(frozen=True)
class QuickFits:
    """Quick fits of the candidates for one step, and their errors on held-out stretches.

    Attributes:
        last: Last step, with the vehicle from which the fits start.
        file: Vehicle file of step 0.
        recordings: Both recordings.
        problem: Shots of the fits.
    """

    last: Step
    file: Vehicle
    recordings: Recordings
    problem: OutputError

    def of(self, every: Sequence[Mapping[str, Table]], progress: Progress) -> list[Quick]:
        """Return the fits of candidates and of their simpler special cases that converge, the best first."""
        quick = list[Quick]()
        for number, (found, fits) in enumerate(zip(every, shared(self._tried, every), strict=True)):
            progress(f"{next(iter(found))} tried with all existing effects", 0.5 * number / len(every))
            quick += fits
        return sorted(quick, key=lambda one: (one.is_implausible, one.error))

    def _tried(self, found: Mapping[str, Table]) -> list[Quick]:
        """Return the fit of a candidate, and those of the simpler special cases of its first effect."""
        effect, quick = next(iter(found)), self._fit(found)
        rest = {name: table for name, table in found.items() if name != effect}
        given = self.last.vehicle
        plain = [table for one in quick for table in plainer(one.vehicle, effect, given)]
        common = [with_one_value(one.vehicle, effect, given) for one in quick]
        plain += [table for table in common if table is not None]
        return [*quick, *(one for table in plain for one in self._fit({table["name"]: table, **rest}))]

    def _fit(self, found: Mapping[str, Table]) -> list[Quick]:
        """Return the quick fit of a candidate; empty if it diverges."""
        recordings, begun = self.recordings, self.last.vehicle
        wanted: Wanted = _wanted(self.last, found)
        try:
            if recordings.is_far(begun):
                unknown, names = free(begun, wanted, reach=recordings.log.track), names_of(wanted)
                begun, wanted = recordings.started(unknown.at(unknown.starts[0]), names), names
            vehicle = recordings.tried(begun, wanted, self.problem)
            is_implausible = bool(implausible(vehicle, list(found)))
            return [Quick(found, wanted, vehicle, is_implausible, recordings.error_ahead(vehicle))]
        except DataError:
            return []

    def best_of(self, quick: Sequence[Quick]) -> list[Quick]:
        """Return converged fits that predict held-out stretches better and no axis significantly worse.

        The best is first.  Of fits whose errors are equal to within NEGLIGIBLE, that is the one with the
        fewest parameters; steady loads that do not improve its prediction are removed.  A confirmed effect
        need not predict better.
        """
        last, recordings = self.last, self.recordings
        before = recordings.left_out(last.vehicle, _fitted_there(last), self.problem)
        if not last.tables:  # the file as given was fitted to nothing here
            before = min(before, recordings.left_out(self.file, []), key=recordings.error)
        here = recordings.error(before) if last.left_out is None or not last.tables else last.left_out

        def predicted(one: Quick) -> tuple[float, Quick]:
            """Return the error of held-out stretches, infinite if an axis is worse, and the converged fit."""
            one = one.ended(recordings)
            after = recordings.left_out(one.vehicle, names_of(one.wanted))
            return np.inf if recordings.worsened_axes(before, after) else recordings.error(after), one

        def joins(error: float, one: Quick) -> bool:
            """Return whether the fit may be added."""
            return (1.0 + NEGLIGIBLE) * error < here or (states(last, one.effect) and np.isfinite(error))

        errors = list[tuple[float, Quick]]()
        listed = list(dict.fromkeys(one.effect for one in quick))[:CONTENDERS]
        most = FIT**0.5 * quick[0].error if quick and recordings.is_far(last.vehicle) else np.inf
        for one in (one for one in quick if one.effect in listed and one.error <= most):
            if errors and one.is_implausible > errors[0][1].is_implausible:
                break
            found = predicted(one)
            errors += [found] if np.isfinite(found[0]) else []
        better = [found for found in errors if joins(*found)]
        if not better:
            return []
        alike = (1.0 + NEGLIGIBLE) * min(error for error, _ in better)
        first = min((found for found in better if found[0] <= alike), key=lambda found: found[1].entries)[1]
        for load in [name for name in STEADY if name in first.found and name != first.effect]:
            rest = {name: table for name, table in first.found.items() if name != load}
            for error, one in map(predicted, self._fit(rest)):
                better += [(error, one)] if joins(error, one) else []
                first = one if error <= alike else first
        better.sort(key=lambda found: found[0])
        return [first, *(one for _, one in better if one is not first)]


def _trial(
    last: Step,
    found: Mapping[str, Table],
    file: Vehicle,
    recordings: Recordings,
    tried: Vehicle | None = None,
) -> Trial:
    """Fit all effects of the last step and a candidate together.

    With a hull-force model, velocity sensor errors keep the values that kinematics shows, because the error
    of the hull model would bias them.  Further fits may start at `tried`, the vehicle of a quick fit.

    Raises:
        DataError: The fit diverges.
    """
    added = tuple(name for name in found if not last.vehicle.effects(name)) or tuple(found)
    every = (*last.tables, *found.values())
    chance = [dict(one) for one in every if CATALOGUE[one["name"]].is_random]
    fit: Fit | None
    held = list[dict[str, Any]]()
    if recordings.hull is None:
        there = extended(last.vehicle, [bare(one) for one in chance])
        fit = _fit_together(there, recordings, _wanted(last, found), file, tried)
    else:
        own = {one["name"] for one in every if by_kinematics(one, recordings.log.sensors)}
        held = [dict(one) for one in every if one["name"] in own]
        rest = [bare(one) for one in every if one["name"] not in own]
        there = extended(file, [bare(one) for one in held])
        fit = fit_changes(there, recordings.log, recordings.hull, rest) if rest else None
    fitted = (*held, *(fit.tables() if fit else ()), *chance)
    return Trial(added, fitted, extended(file, fitted), fit.estimates() if fit else None)


def _fit_together(
    vehicle: Vehicle, recordings: Recordings, wanted: Wanted, file: Vehicle, tried: Vehicle | None = None
) -> Fit | None:
    """Fit effects together, from the values of the last diagnosis, with standard errors.

    Values that the recording does not determine stay as in the file of step 0.  Far from the noise, sensor
    noise is the wrong weight: the most accurate channel would decide alone.  Then two more fits are made, to
    shots weighted by their residuals: one from the values of a quick fit or of equation error, and one over
    the horizon of the ladder from the better of both.  Their values are not shrunk to the file, because the
    problem is not linear over such a distance.  The fit with the best prediction is returned.  From a quick
    fit that is above FAR_FROM_NOISE, only the last of these fits is made.
    """
    if not wanted:
        return None
    ahead = recordings.ahead(tried, SHOTS) if tried is not None and recordings.is_far(tried) else None
    if tried is not None and ahead is not None:
        far = recordings.fit_from(tried, names_of(wanted), ahead)
        if far is not None:
            return far
    log = recordings.log
    unknown = free(vehicle, wanted, reach=log.track)
    begun = unknown.at(unknown.starts[0])
    start, problem = stable_start(begun, log)
    if start is not begun:
        vehicle, wanted = start, [name for name in names_of(wanted) if start.effects(name)]
    model, problem, _ = weighed_fit(vehicle, wanted, problem, log, share=0.0)
    fit = settled(model, file)[1]
    if fit is None or model.normal.chi2 <= FIT:
        return fit
    names = model.unknown.effects

    def better(fit: Fit, there: Vehicle, problem: OutputError) -> Fit:
        """Return the better of the fit and one to other shots from the values of a vehicle."""
        other = recordings.fit_from(there, names, problem)
        return fit if other is None else min(fit, other, key=lambda one: recordings.error_ahead(one.vehicle))

    fit = better(fit, recordings.started(start, names) if tried is None else tried, resolved(problem))
    ahead = recordings.ahead(fit.vehicle, SHOTS)
    return fit if ahead is None else better(fit, fit.vehicle, ahead)


def _wanted(last: Step, found: Mapping[str, Table]) -> list[str | Table]:
    """Return the effects that are fitted together: existing, added and new ones, with starting values.

    Random effects, such as waves, are estimated by the diagnosis and not by a fit.
    """
    new = [
        bare(table) if len(table) > 1 else name
        for name, table in found.items()
        if not CATALOGUE[name].is_random
    ]
    return [*(name for name in _fitted_there(last) if name not in found), *new]


def _fitted_there(last: Step) -> list[str]:
    """Return the effects of a step's vehicle without the random ones, which no fit estimates."""
    there = dict.fromkeys([*own_effects(last.vehicle), *(table["name"] for table in last.tables)])
    return [name for name in there if not CATALOGUE[name].is_random]


def bare(table: Table) -> dict[str, Any]:
    """Return an `[[effect]]` table without what a fit wrote: only its name and its parameters."""
    return {key: value for key, value in table.items() if key not in BOOKKEEPING or key == "name"}
