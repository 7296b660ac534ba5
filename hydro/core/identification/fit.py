"""Fit of the parameters of named effects, with covariance, to a recording.

There are two methods.  Equation error balances forces and accelerations over windows of the smoothed motion
(`prediction.weak_form`).  It is fast and nearly right, but noise in the measured motion biases it.  Output
error predicts short shots and compares them with the log (`prediction.multiple_shooting`).  It starts from
the equation-error values and is unbiased if the model is true.  Both are weighted least squares, solved by
Levenberg-Marquardt iterations within bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import polars as pl

from hydro.core.cleaning.cleaned import cleaned
from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE, sensor, velocity_log
from hydro.core.effects.restoring import BUOYANCY_OFFSET, NET_BUOYANCY
from hydro.core.errors import DataError
from hydro.core.identification.initial_guess import initial_guesses
from hydro.core.identification.levenberg_marquardt import (
    ITERATIONS,
    Problem,
    descend,
    errors_of,
    linearised,
    over_standard_errors,
    profiled,
    searched,
)
from hydro.core.identification.outcome import IMPASSIVE, Fit, information, with_uncertainty
from hydro.core.identification.passivity import bounded_in_sum, possible
from hydro.core.prediction import multiple_shooting, weak_form
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.output_error import OutputError, aimed
from hydro.core.prediction.parameters import LONGEST_SENSOR_DELAY, Free, free
from hydro.core.prediction.tracking import shot_seconds, tracked
from hydro.core.prediction.visibility import of_recording
from hydro.core.progress import Progress, silent
from hydro.core.recording.arrays import Recording
from hydro.core.recording.shots import Shots, make_shots
from hydro.core.vehicle.description import Vehicle

Method = Literal["output", "equation"]
METHODS: tuple[str, ...] = ("output", "equation")

TURNS = 8  # maximum alternations of search and iteration
MOST_SHOTS = 1000
"""Maximum number of shots or windows in a fit: half an hour of a recording of any length."""
LOOSE = 0.1
"""Standard error of an exponent above which the other standard errors are taken over its profile."""
GROSS_RESIDUAL = 100.0  # reduced chi-square above which the first weights ignore the noise
BEGUN_ANEW = 3  # maximum repeats of the search for unmeasured initial states
MISFIT = 3.0
"""Reduced chi-square above which missing effects may distort a fit."""
EXPLAINED = 0.5
"""Maximum ratio of chi-squares, joint fit to plain fit, at which missing effects are fitted as well."""
BETTER = 9.0  # squared residual of a shot that another initial state must gain


def fit(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    effects: Sequence[str | Mapping[str, Any]],
    *,
    method: Method = "output",
    noise: Array | None = None,
    most: int | None = MOST_SHOTS,
    progress: Progress | None = None,
) -> Fit:
    """Return a fit of named effects to a recording, with standard errors and warnings.

    Args:
        vehicle: The vehicle.  Effects of its file start from their values, new effects from zero.  Standard
            errors in the file count as an independent estimate; components marked as known are not fitted.
        raw: Raw table of the measured motion and commands.
        effects: Names in the catalogue (`linear_damping`, or `linear_damping.matrix` where there is a
            choice), or tables with initial values.
        method: `output`, which minimises errors of predictions, or `equation`, which minimises errors of the
            equations of motion along the smoothed motion.
        noise: Standard deviations of pose and velocity, (12,) [m, rad, m/s, rad/s]; by default estimated from
            the data.
        most: Maximum number of shots (`output`) or windows (`equation`), spread evenly over a longer
            recording; None for no limit.
        progress: Called with a few words and the share of the work done.

    Raises:
        DataError: An effect or the recording is invalid (such as wrongly named columns), or the motion
            diverges.
    """
    if method not in METHODS:
        raise DataError(f"method {method!r} is not known; choose one of {', '.join(METHODS)}")
    found = _fitted(vehicle, raw, effects, method, noise, most, progress or silent)
    lacking = _lacking(vehicle, found)
    if not lacking:
        return found
    try:
        joint = _fitted(vehicle, raw, [*effects, *lacking], method, noise, most, progress or silent)
    except DataError:  # the motion diverges with them
        return found
    return _beside(found, joint, lacking) if joint.chi2 <= EXPLAINED * found.chi2 else found


def _lacking(vehicle: Vehicle, found: Fit) -> tuple[str, ...]:
    """Return missing restoring effects that may have distorted the fit of another one.

    An effect that the file lacks can bias the fit of the requested one.  For example, an attitude other than
    the file's trim biases net buoyancy to values that reduce the restoring moment.
    """
    if not found.chi2 > MISFIT or found.method != "output":
        return ()
    named = {entry.effect for entry in found.free.entries}
    if not any(CATALOGUE[name].family == BUOYANCY_OFFSET.family for name in named):
        return ()
    there = named | {table["name"] for table in vehicle.effect}
    return tuple(one.name for one in (NET_BUOYANCY, BUOYANCY_OFFSET) if one.name not in there)


def _beside(found: Fit, joint: Fit, lacking: Sequence[str]) -> Fit:
    """Return a joint fit with the requested components only; a warning names the others."""
    kept = [i for i, entry in enumerate(joint.free.entries) if entry.effect not in lacking]
    names = ", ".join(lacking)
    told = f"the file lacks {names}: fitted along and not written; run hydro diagnose to find missing effects"
    values = joint.values[kept]
    return replace(
        found,
        vehicle=found.free.at(values),
        values=values,
        standard_errors=joint.standard_errors[kept],
        covariance=joint.covariance[np.ix_(kept, kept)],
        determined=joint.determined[kept],
        chi2=joint.chi2,
        warnings=(*joint.warnings, told),
    )


def _fitted(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    effects: Sequence[str | Mapping[str, Any]],
    method: Method,
    noise: Array | None,
    most: int | None,
    progress: Progress,
) -> Fit:
    """Fit only the named effects, see `fit`."""
    log = cleaned(vehicle, raw, put_right=False)
    record = tracked(vehicle, log.record)
    blind = record is not log.record
    unknown = _not_known(vehicle, effects, record.track)
    progress("equation error", 0.0)
    windows = weak_form.Windows.of(record, noise, most)
    share = windows.share
    values, problem, chi2 = by_equation_error(unknown, windows, record.track)
    if method == "output":
        progress("output error", 0.2)
        shots = _shots(unknown, record, noise, most)
        share = shots.share
        values, problem = aimed(unknown, values, shots)
    values, normal, problem = _settle(unknown, values, problem, progress)
    if blind and isinstance(problem, OutputError):
        values, normal, problem = _begun_anew(unknown, log.record, values, normal, problem, shots.sigma)
    kept, normal, problem = _passive(unknown, values, normal, problem)
    if isinstance(problem, OutputError):
        chi2 = problem.weighed(shots.sigma).linearise(unknown.at(kept), [], []).chi2
    progress("done", 1.0)
    found = with_uncertainty(
        unknown, kept + 0.0, normal, chi2, method, vehicle, _over_powers(unknown, kept, normal, problem)
    )
    reduced = () if np.array_equal(kept, values) else (IMPASSIVE,)
    warnings = (*of_recording(vehicle, log.record), *log.changes, *reduced, *found.warnings)
    return replace(found, warnings=warnings, share=share, changes=log.changes)


def _not_known(vehicle: Vehicle, effects: Sequence[str | Mapping[str, Any]], reach: Array) -> Free:
    """Return the free components of effects.

    Raises:
        DataError: No component is free.
    """
    unknown = free(vehicle, effects, reach=reach)
    if not unknown.entries:
        raise DataError("all that is named is held as known; name another effect, or take `known` out")
    return unknown


def _shots(unknown: Free, record: Recording, noise: Array | None, most: int | None) -> Shots:
    """Make shots of a length that the samples allow, with a lead for the delay of a late DVL."""
    late = velocity_log(unknown.vehicle)[sensor.DELAY] > 0.0 or any(
        entry.effect == sensor.SENSOR_DELAY.name for entry in unknown.entries
    )
    lead = LONGEST_SENSOR_DELAY if late else 0.0
    return make_shots(record, seconds=shot_seconds(record), lead=lead, sigma=noise, most=most)


def by_equation_error(
    unknown: Free, windows: weak_form.Windows, reach: Array
) -> tuple[Array, Problem, float]:
    """Return the values, among fits by equation error from all initial guesses, with the smallest cost.

    Args:
        unknown: The P free components.
        windows: Windows of the recording.
        reach: Positions [m] and times [s] in the N rows of the recording, (N, 4).

    Returns:
        Values, (P,); the problem with weights that fit its residuals; and the reduced chi-square before
        reweighting.
    """
    tried = [
        descend(unknown, start, windows, ITERATIONS) for start in initial_guesses(unknown, windows, reach)
    ]
    values, normal, problem = min(tried, key=lambda result: result[1].cost)
    problem, _ = problem.reweighted(normal)
    values, _, problem = descend(unknown, values, problem, ITERATIONS)
    return values, problem, normal.chi2


def _settle(
    unknown: Free, values: Array, problem: Problem, progress: Progress
) -> tuple[Array, Normal, Problem]:
    """Iterate, reweight by the residuals, and iterate again; gross residuals are reweighted first."""
    first = linearised(unknown, values / unknown.scales, problem)
    if first.chi2 > GROSS_RESIDUAL:
        problem, _ = problem.reweighted(first)
    for attempt in range(4):
        values, normal, problem = _found(unknown, values, problem)
        progress("weights", 0.5 + 0.1 * attempt)
        problem, changed = problem.reweighted(normal)
        if not changed:
            break
    return values, over_standard_errors(unknown, values, normal, problem), problem


def _begun_anew(
    unknown: Free, record: Recording, values: Array, normal: Normal, problem: Problem, sigma: Array
) -> tuple[Array, Normal, Problem]:
    """Refit from initial states that the fitted vehicle predicts, shot by shot, while that reduces the cost.

    Linear steps cannot correct an unmeasured initial state that the first values placed wrongly.
    """
    for _ in range(BEGUN_ANEW):
        assert isinstance(problem, OutputError)
        vehicle, old = unknown.at(values), problem.shots
        fresh = old.begun_at(tracked(vehicle, record))
        alone = Free(vehicle, (), (np.zeros(0),), frozenset())
        _, _, found = descend(alone, np.zeros(0), OutputError.of(fresh, vehicle), ITERATIONS)
        assert isinstance(found, OutputError)
        prepared = multiple_shooting.prepare(candidate(vehicle), old)
        before, after = (multiple_shooting.costs(prepared, shots) for shots in (old, found.shots))
        better = after < before - BETTER
        if not better.any():
            break
        first = np.where(better[:, None], found.shots.first, old.first)
        begun = OutputError(replace(old, first=first, sigma=sigma))
        values, normal, problem = _settle(unknown, values, begun, silent)
    return values, normal, problem


def _found(unknown: Free, values: Array, problem: Problem) -> tuple[Array, Normal, Problem]:
    """Iterate; alternate with a search where components act in steps."""
    stepped = np.array([entry.resolution > 0.0 for entry in unknown.entries])
    if not stepped.any():
        return descend(unknown, values, problem, ITERATIONS)
    for _ in range(TURNS):
        better = searched(unknown, values, problem)
        smooth = unknown.holding(better, stepped)
        rest, _, problem = descend(smooth, smooth.starts[0], problem, ITERATIONS)
        settled = np.array_equal(better, values)
        values = better.copy()
        values[~stepped] = rest
        if settled:
            break
    return values, linearised(unknown, values / unknown.scales, problem), problem


def _passive(unknown: Free, values: Array, normal: Normal, problem: Problem) -> tuple[Array, Normal, Problem]:
    """Move active values to the best passive ones, and refit the other components."""
    kept = possible(unknown, values, information(normal))
    if np.array_equal(kept, values):
        return values, normal, problem
    held = bounded_in_sum(unknown)
    rest = unknown.holding(kept, held)
    _, problem = problem.cost(unknown.at(kept), (kept - values) / unknown.scales, normal)
    if rest.entries:
        kept[~held], _, problem = _settle(rest, rest.starts[0], problem, silent)
    return kept, linearised(unknown, kept / unknown.scales, problem), problem


def _over_powers(unknown: Free, values: Array, normal: Normal, problem: Problem) -> Array:
    """Return lower limits of the standard errors (P,) from the profiles of poorly determined exponents."""
    parameters = [CATALOGUE[entry.effect].parameter(entry.parameter) for entry in unknown.entries]
    if not any(one.power for one in parameters):
        return np.zeros(len(values))
    errors = errors_of(normal) * unknown.scales
    powers = [i for i, one in enumerate(parameters) if one.power and errors[i] > LOOSE]
    return profiled(unknown, values, normal, problem, errors, powers)
