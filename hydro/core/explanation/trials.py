"""Which of what a step may add predicts best the stretches of the recording that it was not fitted to.

What a diagnosis only suspects is tried, and beside it what else of the catalogue promises most
(`explanation.screening`): fitted together with all that is there already, and held against stretches that the
fit leaves out, as far ahead as the ladder looks.  With the hull that a recording before has taught, what
changed is fitted with nothing but the changes of earlier steps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl

from hydro.core.cleaning.readiness import require_ready
from hydro.core.diagnosis.baseline import ENOUGH, LEAST_SHOTS, stable_part, stable_start, weighed_fit
from hydro.core.diagnosis.before import fit_changes
from hydro.core.diagnosis.diagnose import settled
from hydro.core.diagnosis.findings import FIT, extended
from hydro.core.diagnosis.log_faults import Preprocessed, preprocess, preprocess_alike
from hydro.core.diagnosis.misread import by_kinematics
from hydro.core.diagnosis.model import Diverges, Wanted, as_it_is, fit_model, names_of
from hydro.core.diagnosis.transfer import (
    Squares,
    left_out_squares,
    resolved,
    squares_ahead,
    squares_at_rest,
)
from hydro.core.effects.catalogue import CATALOGUE, implausible, own_effects, with_role
from hydro.core.effects.record import BOOKKEEPING, Role
from hydro.core.errors import DataError
from hydro.core.evaluation.compare import compare
from hydro.core.evaluation.yardsticks import Yardstick
from hydro.core.explanation.axes import worse_axes
from hydro.core.explanation.ladder import HORIZON, Step
from hydro.core.explanation.options import Table, is_open, options, states
from hydro.core.explanation.screening import promising
from hydro.core.explanation.with_hull import with_hull
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.outcome import Fit
from hydro.core.identification.suspects import plainer
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import free
from hydro.core.progress import Progress
from hydro.core.recording.shots import room
from hydro.core.residual.hull import Hull
from hydro.core.simulation.estimates import Estimates
from hydro.core.threads import shared
from hydro.core.vehicle.description import Vehicle

PART, FEW, QUICK = 96, 48, 6
"""Shots that the catalogue is linearised about; shots, HORIZON long, and steps of the fits that tell apart
what may be added."""
TRIED, SHORTLIST = 8, 4
"""How many effects are fitted so, and how many of these with stretches left out."""
LOWER = 0.98
"""Part of the error of stretches left out that what is not stated may leave of it to be added, and from which
two errors are alike."""

STEADY = with_role(Role.STEADY_LOAD)
"""Steady loads, tried with each effect that changes the thrust which balances them."""


@dataclass(frozen=True)
class Recordings:
    """What all steps are held against, preprocessed once.

    Attributes:
        log: The recording that everything is fitted to.
        holdout: The held-out one; None without one.
        yardstick: What the file as given, and all steps, are measured by.
        hull: What a recording before a change has taught; None without one.
    """

    log: Preprocessed
    holdout: Preprocessed | None
    yardstick: Yardstick
    hull: Hull | None

    @classmethod
    def of(
        cls, vehicle: Vehicle, raw: pl.DataFrame, holdout: pl.DataFrame | None, hull: Hull | None
    ) -> Recordings:
        """Preprocess both, the held-out one with the same order of its commands."""
        log = preprocess(vehicle, raw, hull)
        require_ready(log.observed)
        other = None if holdout is None else preprocess_alike(vehicle, holdout, log.wiring)
        return cls(log, other, Yardstick.crossed(vehicle, log.record), hull)

    @cached_property
    def problem(self) -> OutputError:
        """A part of the shots of a diagnosis: about them the catalogue is linearised."""
        return resolved(stable_start(self.yardstick.vehicle, self.log)[1]).some(PART)

    def ahead(self, vehicle: Vehicle, most: int) -> OutputError | None:
        """At most so many shots as long as the ladder looks ahead; None of few, and where they diverge.

        Each channel is weighed by what the vehicle leaves of it: far from the noise, that of the sensors says
        nothing of what counts.
        """
        enough = room(self.log.record, HORIZON) >= LEAST_SHOTS
        stable = stable_part(self.log.shots(HORIZON), vehicle) if enough else None
        if stable is None or len(stable.shots.starts) < LEAST_SHOTS:
            return None
        problem = stable.some(most)
        return problem.reweighted(as_it_is(vehicle, problem).normal)[0]

    def judged(self, vehicle: Vehicle) -> OutputError:
        """What suspects are fitted to beside a vehicle, and told apart by with some left out."""
        return self.ahead(vehicle, FEW) or OutputError.of(self.problem.shots, vehicle)

    def compared(self, vehicle: Vehicle, log: Preprocessed, progress: Progress) -> pl.DataFrame:
        """A vehicle against one of them, with the hull's rows where there is a hull."""
        yardstick = self.yardstick if log is self.log else self.yardstick.of_others
        found = compare(vehicle, log.raw, record=log.observed, yardstick=yardstick, progress=progress)
        return found if self.hull is None else with_hull(found, vehicle, log, self.hull)

    def error_ahead(self, vehicle: Vehicle) -> float:
        """Error of the vehicle's velocities over the recording, HORIZON ahead [m/s]."""
        return self.error(squares_ahead(vehicle, self.log.shots(HORIZON)))

    def left_out(
        self, vehicle: Vehicle, fitted: Sequence[str], problem: OutputError | None = None
    ) -> Squares:
        """Return the squared errors HORIZON ahead of stretches that fits of some effects leave out.

        The fits are to `problem`, by default what is judged by about the vehicle itself.
        """
        begun = (problem or self.judged(vehicle)).at_measured_states(vehicle)
        return left_out_squares(vehicle, fitted, begun, self.log.shots(HORIZON))

    def error(self, squares: Squares) -> float:
        """Return the root mean square error of all axes together [m/s]."""
        return squares.error(self.yardstick.weights.velocity)

    def spoils(self, before: Squares, after: Squares) -> tuple[str, ...]:
        """Return the axes that are predicted significantly worse than before.

        An axis counts where zero velocity would be significantly worse than before, or better than after:
        elsewhere nothing is lost.
        """
        rest = squares_at_rest(self.log.shots(HORIZON))
        lost = {*worse_axes(before, rest), *worse_axes(rest, after)}
        return tuple(axis for axis in worse_axes(before, after) if axis in lost)

    def promising(self, vehicle: Vehicle, own: Sequence[str]) -> list[dict[str, Any]]:
        """What else of the catalogue promises to explain what a vehicle leaves, see `screening.promising`."""
        return promising(vehicle, own, OutputError.of(self.problem.shots, vehicle), self.log.track)

    def tried(
        self, vehicle: Vehicle, wanted: Wanted, problem: OutputError, iterations: int = QUICK
    ) -> Vehicle:
        """The vehicle with effects fitted to some shots, in so many steps at most.

        Raises:
            Diverges: The predicted motion does.
        """
        begun = free(vehicle, wanted, reach=self.log.track)
        problem = problem.at_measured_states(begun.at(begun.starts[0]))
        return fit_model(vehicle, wanted, problem, self.log.track, iterations).vehicle


@dataclass(frozen=True)
class Trial:
    """What a step may add, fitted together with all that is there.

    Attributes:
        added: Effects that it adds, or gives new values to where it adds none.
        tables: All effects that were fitted together, with their standard errors.
        vehicle: The file of step 0 with them.
        estimates: The values of `tables` with their covariance.
    """

    added: tuple[str, ...]
    tables: tuple[dict[str, Any], ...]
    vehicle: Vehicle
    estimates: Estimates | None = None


def best_trial(last: Step, file: Vehicle, recordings: Recordings, progress: Progress) -> Trial | None:
    """Of what the next step may add, what predicts best the stretches that it was not fitted to.

    Those are asked of the few whose quick fits predict the recording best.  Values that physics does not
    leave to an effect stand for something else: in a quick fit they count only where none has others, in the
    last one the next best comes first.  None where what is not stated predicts these stretches no better than
    the last step does, or than the file's own effects fitted anew.
    """
    every, undecided = options(last), is_open(last)
    if not undecided and len(every) == 1:
        progress("all together", 0.0)
        return _trial(last, every[0], file, recordings)
    if undecided:
        progress("all effects against what is left", 0.0)
        every += _beside(last, every, recordings)
    every = [one for found in every for one in (found, *_with_loads(last, found))]
    problem = recordings.judged(last.vehicle)
    found = quick_fits(last, every, recordings, problem, progress)
    quick = sorted(found, key=lambda one: (one.fanciful, one.error))
    progress("the best of them, stretches left out", 0.5)
    order, first = _best_of(quick, last, recordings, problem), None
    progress("all together", 0.8)
    for one in order:
        trial = _trial(last, one.found, file, recordings, one.vehicle)
        if not implausible(trial.vehicle, trial.added):
            return trial
        first = first or trial
    stated = next((one for one in every if states(last, next(iter(one)))), None)
    return first if stated is None or first else _trial(last, stated, file, recordings)


def _best_of(quick: Sequence[Quick], last: Step, recordings: Recordings, problem: OutputError) -> list[Quick]:
    """Return the quick fits, ended, that predict left-out stretches better and no axis significantly worse.

    The best comes first.  Of those that predict alike, to within LOWER, the one with the fewest numbers does.
    Steady loads without which it predicts alike are left out of it.
    """
    before = recordings.left_out(last.vehicle, _fitted_there(last), problem)
    if not last.tables:  # the file as given was fitted to nothing here
        before = min(before, recordings.left_out(last.vehicle, []), key=recordings.error)

    here = recordings.error(before) if last.left_out is None or not last.tables else last.left_out

    def predicted(one: Quick) -> tuple[float, Quick]:
        """Return the error of left-out stretches, infinite where an axis is worse, and the ended fit."""
        one = one.ended(recordings)
        after = recordings.left_out(one.vehicle, names_of(one.wanted))
        return np.inf if recordings.spoils(before, after) else recordings.error(after), one

    def joins(error: float, one: Quick) -> bool:
        """Return whether it may be added."""
        return error < LOWER * here or (states(last, one.effect) and np.isfinite(error))

    errors, listed = list[tuple[float, Quick]](), list(dict.fromkeys(one.effect for one in quick))[:SHORTLIST]
    for one in (one for one in quick if one.effect in listed):
        if errors and one.fanciful > errors[0][1].fanciful:
            break
        found = predicted(one)
        errors += [found] if np.isfinite(found[0]) else []
    better = [found for found in errors if joins(*found)]
    if not better:
        return []
    alike = min(error for error, _ in better) / LOWER
    first = min((found for found in better if found[0] <= alike), key=lambda found: found[1].entries)[1]
    for load in [name for name in STEADY if name in first.found and name != first.effect]:
        rest = {name: table for name, table in first.found.items() if name != load}
        for error, one in map(predicted, _quick_fit(last, rest, recordings, problem)):
            better += [(error, one)] if joins(error, one) else []
            first = one if error <= alike else first
    better.sort(key=lambda found: found[0])
    return [first, *(one for _, one in better if one is not first)]


def _beside(
    last: Step, every: Sequence[Mapping[str, Table]], recordings: Recordings
) -> list[dict[str, Table]]:
    """What else of the catalogue may be added, the most promising first."""
    found = recordings.promising(last.vehicle, _fitted_there(last))
    tried = {next(iter(one)) for one in every}
    others: list[dict[str, Table]] = [{table["name"]: table} for table in found if table["name"] not in tried]
    return others[: max(TRIED - len(every), 0)]


def _with_loads(last: Step, found: Mapping[str, Table]) -> list[dict[str, Table]]:
    """Return an option with the steady loads that the vehicle lacks; none where no thruster changes.

    Mean thrust balances steady loads.  A change of the thrusters changes that thrust, and alone it would
    move the vehicle off its balance.
    """
    loads = {name: {"name": name} for name in STEADY if not (name in found or last.vehicle.effects(name))}
    changes_thrust = CATALOGUE[next(iter(found))].kind == "actuator"
    return [{**found, **loads}] if changes_thrust and loads else []


@dataclass(frozen=True)
class Quick:
    """A quick fit of what a step may add.

    Attributes:
        found: It, by effect.
        wanted: All that was fitted together.
        vehicle: The vehicle with it.
        fanciful: Whether its values are none that physics leaves to it.
        error: Of the predictions HORIZON ahead of what was fitted to [m/s].
    """

    found: Mapping[str, Table]
    wanted: Wanted
    vehicle: Vehicle
    fanciful: bool
    error: float

    @property
    def effect(self) -> str:
        """What is new in it."""
        return next(iter(self.found))

    def ended(self, recordings: Recordings) -> Quick:
        """Return it with its fit ended, to shots weighed by what it leaves; as it is where that diverges."""
        try:
            problem = recordings.judged(self.vehicle)
            vehicle = recordings.tried(self.vehicle, names_of(self.wanted), problem, ITERATIONS)
        except DataError:
            return self
        return replace(self, vehicle=vehicle)

    @property
    def entries(self) -> int:
        """How many numbers of what is fitted together it has."""
        return len(free(self.vehicle, names_of(self.wanted)).entries)


def quick_fits(
    last: Step,
    every: Sequence[Mapping[str, Table]],
    recordings: Recordings,
    problem: OutputError,
    progress: Progress,
) -> Iterator[Quick]:
    """Quick fits of what may be added, and of the plainer effects that it may be; of what diverges none."""

    def tried(found: Mapping[str, Table]) -> list[Quick]:
        effect, quick = next(iter(found)), _quick_fit(last, found, recordings, problem)
        rest = {name: table for name, table in found.items() if name != effect}
        plain = [table for one in quick for table in plainer(one.vehicle, effect, last.vehicle, itself=True)]
        others = [{table["name"]: table, **rest} for table in plain]
        return [*quick, *(one for each in others for one in _quick_fit(last, each, recordings, problem))]

    for number, (found, quick) in enumerate(zip(every, shared(tried, every), strict=True)):
        progress(f"{next(iter(found))} was tried with all that is there", 0.5 * number / len(every))
        yield from quick


def _quick_fit(
    last: Step, found: Mapping[str, Table], recordings: Recordings, problem: OutputError
) -> list[Quick]:
    """Return the quick fit of what may be added; none where it diverges."""
    wanted = _wanted(last, found)
    try:
        vehicle = recordings.tried(last.vehicle, wanted, problem)
        fanciful = bool(implausible(vehicle, list(found)))
        return [Quick(found, wanted, vehicle, fanciful, recordings.error_ahead(vehicle))]
    except DataError:
        return []


def _trial(
    last: Step,
    found: Mapping[str, Table],
    file: Vehicle,
    recordings: Recordings,
    tried: Vehicle | None = None,
) -> Trial:
    """All that the last step has and what was found, fitted together; perhaps from a quick fit, too.

    With the hull of a recording before, what kinematics shows of the velocity log stays as it shows it: what
    the model of the hull leaves would only spoil it.

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
    """Effects fitted together, from the values that the last diagnosis found, with their standard errors.

    What the recording does not show stays as it stands in the file of step 0.  Far from the noise it is no
    measure of what counts: the channel that is measured best would decide all.  Then shots weighed by what
    matters of each are fitted too, from where a quick fit has been, and from the better of both shots as long
    as the ladder looks ahead; these values are not drawn back to the file: no straight line leads so far.
    Of all the vehicle is taken that predicts best.
    """
    if not wanted:
        return None
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
    names = list(dict.fromkeys(entry.effect for entry in model.unknown.entries))

    def better(fit: Fit, there: Vehicle, problem: OutputError) -> Fit:
        """The fit, or one to other shots from a vehicle where that predicts better."""
        try:
            other = fit_model(
                there, names, problem.at_measured_states(there), log.track, ITERATIONS
            ).estimated()
        except Diverges:
            return fit
        return min(fit, other, key=lambda one: recordings.error_ahead(one.vehicle))

    fit = better(fit, start if tried is None else tried, resolved(problem))
    ahead = recordings.ahead(fit.vehicle, ENOUGH)
    return fit if ahead is None else better(fit, fit.vehicle, ahead)


def _wanted(last: Step, found: Mapping[str, Table]) -> list[str | Table]:
    """What is fitted together: the file's own effects and all added, from their values, and what is new.

    What acts by chance is estimated by the diagnosis, not by a fit.
    """
    new = [
        bare(table) if len(table) > 1 else name
        for name, table in found.items()
        if not CATALOGUE[name].is_random
    ]
    return [*(name for name in _fitted_there(last) if name not in found), *new]


def _fitted_there(last: Step) -> list[str]:
    """The file's own effects and all that was added, but for what acts by chance."""
    there = dict.fromkeys([*own_effects(last.vehicle), *(table["name"] for table in last.tables)])
    return [name for name in there if not CATALOGUE[name].is_random]


def bare(table: Table) -> dict[str, Any]:
    """An effect's values alone."""
    return {key: value for key, value in table.items() if key not in BOOKKEEPING or key == "name"}
