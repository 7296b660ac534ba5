"""Parameters of named effects, and their covariance, from a recording.

Two methods.  Equation error balances accelerations over windows of the smoothed motion
(`identification.weak_form`): fast, and close, but noise in the measured motion biases it.  Output error
predicts short shots and compares them with what was logged (`identification.multiple_shooting`): it begins
where equation error ended and is unbiased where the model is true. Both are weighted least squares, solved by
a Levenberg-Marquardt iteration within bounds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE, sensor, velocity_log
from hydro.core.effects.catalogue import implausible
from hydro.core.errors import DataError
from hydro.core.identification import multiple_shooting, weak_form
from hydro.core.identification.candidate import candidate
from hydro.core.identification.initial_guess import initial_guesses
from hydro.core.identification.levenberg_marquardt import (
    ITERATIONS,
    PRIOR,
    Problem,
    descend,
    errors_of,
    linearised,
    over_standard_errors,
    profiled,
    searched,
)
from hydro.core.identification.normal_equations import Normal, covariance
from hydro.core.identification.output_error import OutputError, aimed
from hydro.core.identification.parameters import LONGEST_SENSOR_DELAY, Free, effect_table, free
from hydro.core.identification.passivity import accepted, bounded_in_sum, possible
from hydro.core.identification.prior import combined, stated
from hydro.core.identification.tracking import shot_seconds, tracked
from hydro.core.identification.visibility import of_recording
from hydro.core.logs.axis_faults import require_as_called
from hydro.core.progress import Progress, silent
from hydro.core.recording.arrays import Recording
from hydro.core.recording.heavy_tails import Tail
from hydro.core.recording.sensor_faults import (
    Corrected,
    without_bad_readings,
    without_bias,
    without_outliers,
)
from hydro.core.recording.shots import Shots, make_shots
from hydro.core.simulation.estimates import Estimate, Estimates
from hydro.core.vehicle.description import Vehicle

Method = Literal["output", "equation"]
METHODS: tuple[str, ...] = ("output", "equation")

TURNS = 8  # of search and iteration
MOST_SHOTS = 1000
"""Shots, or windows, that a fit looks at: half an hour of a recording of any length."""
UNDETERMINED = 0.5  # standard error in scales above which the data say nothing, unless the value is plain
PLAIN_ERRORS = 3.0
LOOSE = 0.1
"""Standard error of a power from which the standard errors of all else are asked for over its profile."""
ALIKE = 0.995  # correlation of two estimates that the data tell apart no more
GROSS_RESIDUAL = 100.0  # mean square in units of the noise from which the noise has no say in the weights
BEGUN_ANEW = 3  # times that beginnings which no sample shows are looked for once more
BETTER = 9.0  # squared residual of a shot by which another beginning must be better
IMPASSIVE = (
    "the best values would let damping or added mass drive the vehicle; they are the best of what "
    "a passive hull can have"
)


@dataclass(frozen=True)
class Fit:
    """Fitted effects.

    Attributes:
        vehicle: The vehicle with the fitted values.
        free: The entries that were fitted.
        values: (P,) in the units of the entries.
        standard_errors: (P,).
        covariance: (P, P).
        determined: Which entries the data determine, (P,).
        chi2: Mean square of the residuals in units of the noise; about 1 where the model is true.
        method: `output` or `equation`.
        warnings: What the user should know, one line each.
        share: Share of the recording that was looked at.
    """

    vehicle: Vehicle
    free: Free
    values: Array
    standard_errors: Array
    covariance: Array
    determined: NDArray[np.bool_]
    chi2: float
    method: str
    warnings: tuple[str, ...]
    share: float = 1.0

    def tables(self) -> tuple[dict[str, Any], ...]:
        """The `[[effect]]` tables of the fitted effects, with their standard errors.

        Values are rounded to a hundredth of their standard errors, or to as many more digits as a damping at
        the edge of what a passive hull can have needs to stay within; a form that another one has replaced (a
        diagonal by a matrix) is there as None.
        """
        places = 2 - np.floor(np.log10(np.maximum(self.standard_errors, 1e-300))).astype(int)
        values = self._rounded(places)
        while not accepted(self.free, values) and not np.array_equal(values, self.values):
            places += 1
            values = self._rounded(places)
        errors = np.array([float(f"{error:.3g}") for error in self.standard_errors])
        tables = []
        for name in dict.fromkeys(entry.effect for entry in self.free.entries):
            table = effect_table(self.free, name, self.free.within(values))
            replaced = {other: None for other in CATALOGUE[name].one_of if other not in table}
            spread = _errors_of(self.free, name, errors)
            text = CATALOGUE[name].written(next(iter(self.free.vehicle.effects(name))))
            tables.append({"name": name} | text | replaced | table | {"standard_error": spread})
        return tuple(tables)

    def table(self, effect: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Values and standard errors of one fitted effect, see `tables`.

        Raises:
            KeyError: It was not fitted.
        """
        for table in self.tables():
            if table["name"] == effect:
                apart = ("name", "standard_error")
                values = {k: v for k, v in table.items() if k not in apart and v is not None}
                return values, dict(table["standard_error"])
        raise KeyError(effect)

    def estimates(self) -> Estimates:
        """The fitted values as they stand in `tables`, with their covariance."""
        written = {table["name"]: table for table in self.tables()}
        entries = tuple(
            Estimate(
                entry.effect,
                entry.parameter,
                entry.index,
                entry.unit,
                float(np.asarray(written[entry.effect][entry.parameter], float)[entry.index]),
            )
            for entry in self.free.entries
        )
        return Estimates(entries, self.covariance)

    def _rounded(self, places: NDArray[np.int64]) -> Array:
        pairs = zip(self.values.tolist(), places.tolist(), strict=True)
        return np.array([round(value, digits) for value, digits in pairs])

    def frame(self) -> pl.DataFrame:
        """One row per entry: parameter, value, standard_error, unit, determined."""
        entries = self.free.entries
        return pl.DataFrame(
            {
                "parameter": [entry.name for entry in entries],
                "value": self.values,
                "standard_error": self.standard_errors,
                "unit": [entry.unit for entry in entries],
                "determined": self.determined,
            }
        )


def _errors_of(free_: Free, name: str, errors: Array) -> dict[str, Any]:
    """The standard errors of one effect in the shape of its table; 0 of what is held."""
    found = effect_table(free_, name, errors)
    fitted = effect_table(free_, name, np.full(len(errors), np.nan))
    return {key: np.where(np.isnan(fitted[key]), found[key], 0.0).tolist() for key in found}


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
    """Fit named effects to a recording.

    Args:
        vehicle: The vehicle; effects that it has begin at their values, new ones at nothing.  Standard errors
            beside values count as another estimate, and what is held as known is not fitted.
        raw: Raw table of the measured motion and commands.
        effects: Names in the catalogue (`linear_damping`, or `linear_damping.matrix` where there is a
            choice), or tables with values to begin from.
        method: `output` or `equation`.
        noise: Standard deviation of pose and velocity, (12,); by default found from the data.
        most: Shots of output error and windows of equation error, spread evenly over a longer recording;
            None for all there are.
        progress: Called with a few words and the share of the work done.

    Returns:
        Values with standard errors and warnings.

    Raises:
        DataError: An effect or the recording is at fault (columns that are not what they are called among
            them), or the vehicle's motion diverges.
    """
    if method not in METHODS:
        raise DataError(f"method {method!r} is not known; choose one of {', '.join(METHODS)}")
    progress = progress or silent
    log = sound(vehicle, raw)
    record = tracked(vehicle, log.record)
    blind = record is not log.record
    unknown = _not_known(vehicle, effects, record.track)
    progress("equation error", 0.0)
    windows = weak_form.Windows.of(record, noise, most)
    share = windows.share
    values, problem, chi2 = _begin(unknown, windows, record.track)
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
    told = (*(fault.message for fault in log.faults), *_heavy(log.tails))
    warnings = (*of_recording(vehicle, log.record), *told, *reduced, *found.warnings)
    return replace(found, warnings=warnings, share=share)


def _not_known(vehicle: Vehicle, effects: Sequence[str | Mapping[str, Any]], reach: Array) -> Free:
    """The free entries of effects.

    Raises:
        DataError: There are none.
    """
    unknown = free(vehicle, effects, reach=reach)
    if not unknown.entries:
        raise DataError("all that is named is held as known; name another effect, or take `known` out")
    return unknown


def sound(vehicle: Vehicle, raw: pl.DataFrame) -> Corrected:
    """The recording without faults of its sensors.

    Raises:
        DataError: The recording does not fit the vehicle, or columns are not what they are called: values
            fitted to them would be wrong.
    """
    readings = without_bad_readings(vehicle, raw)
    require_as_called(readings.raw, readings.record)
    return without_outliers(vehicle, without_bias(vehicle, readings))


def _heavy(tails: Sequence[Tail]) -> tuple[str, ...]:
    """That the noise of some channels has heavy tails."""
    if not tails:
        return ()
    names = ", ".join(f"{tail.channel} ({tail.freedom:g})" for tail in tails)
    return (f"noise with heavy tails, Student's t (degrees of freedom): {names}; outliers count for less",)


def _shots(unknown: Free, record: Recording, noise: Array | None, most: int | None) -> Shots:
    """Shots of a length that the samples allow, with what a late velocity log saw before them."""
    late = velocity_log(unknown.vehicle)[sensor.DELAY] > 0.0 or any(
        entry.effect == sensor.SENSOR_DELAY.name for entry in unknown.entries
    )
    lead = LONGEST_SENSOR_DELAY if late else 0.0
    return make_shots(record, seconds=shot_seconds(record), lead=lead, sigma=noise, most=most)


def _begin(unknown: Free, windows: weak_form.Windows, reach: Array) -> tuple[Array, Problem, float]:
    """The best of all beginnings after equation error from each, and its chi2."""
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
    """Iterate, weigh anew by what is left, and iterate again; gross residuals are weighed before."""
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
    """The same from beginnings that the fitted vehicle makes, shot by shot, while that finds better ones.

    Linear steps do not lead a beginning that no sample shows back from where the first values placed it.
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
    """Iterate; where entries act in steps, search for them and iterate over the others in turn."""
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
    """Where the best values would drive the vehicle, the best that a passive hull can have; the rest anew."""
    kept = possible(unknown, values, _information(normal))
    if np.array_equal(kept, values):
        return values, normal, problem
    held = bounded_in_sum(unknown)
    rest = unknown.holding(kept, held)
    _, problem = problem.cost(unknown.at(kept), (kept - values) / unknown.scales, normal)
    if rest.entries:
        kept[~held], _, problem = _settle(rest, rest.starts[0], problem, silent)
    return kept, linearised(unknown, kept / unknown.scales, problem), problem


def _over_powers(unknown: Free, values: Array, normal: Normal, problem: Problem) -> Array:
    """Least standard errors (P,): what powers that are hardly determined leave open of all else."""
    parameters = [CATALOGUE[entry.effect].parameter(entry.parameter) for entry in unknown.entries]
    if not any(one.power for one in parameters):
        return np.zeros(len(values))
    errors = errors_of(normal) * unknown.scales
    powers = [i for i, one in enumerate(parameters) if one.power and errors[i] > LOOSE]
    return profiled(unknown, values, normal, problem, errors, powers)


def _information(normal: Normal) -> Array:
    """X^T X of all pieces and what is known beforehand, (P, P)."""
    information = normal.matrix.sum(axis=0)
    total: Array = information + PRIOR**-2 * np.eye(len(information))
    return total


def with_uncertainty(
    unknown: Free,
    values: Array,
    normal: Normal,
    chi2: float,
    method: str,
    file: Vehicle | None = None,
    least: Array | None = None,
) -> Fit:
    """Covariance, warnings and a vehicle that is physically possible.

    Args:
        unknown: The entries.
        values: Their best values, (P,).
        normal: The problem about them.
        chi2: Mean square of the residuals.
        method: `output` or `equation`.
        file: The vehicle whose file states standard errors of its values, which count as another estimate.
        least: Standard errors at least, (P,); correlations stay.
    """
    warnings: list[str] = []
    within = possible(unknown, values, _information(normal))
    if not np.array_equal(within, values):
        warnings.append(IMPASSIVE)
        values = within
    scales = unknown.scales
    spread = covariance(normal, np.full(len(values), PRIOR**-2)) * np.outer(scales, scales)
    if least is not None:
        wider = np.maximum(least / np.sqrt(np.diag(spread)), 1.0)
        spread = spread * np.outer(wider, wider)
    if file is not None and np.isfinite(stated(file, unknown.entries)).any():
        values, spread, told = combined(values, spread, file, unknown.entries)
        information = np.asarray(np.linalg.inv(spread / np.outer(scales, scales)), np.float64)
        values = possible(unknown, unknown.within(values), information)
        warnings += told
    errors = np.sqrt(np.diag(spread))
    plain = (np.abs(values) > PLAIN_ERRORS * errors) & (errors < 0.3 * PRIOR * scales)
    determined = (errors <= UNDETERMINED * scales) | plain
    if lost := int(normal.lost.sum()):
        warnings.append(
            f"{lost} of {len(normal.lost)} predictions diverge with these values and are left "
            "out; check the vehicle's damping"
        )
    warnings += _advice(unknown, determined)
    warnings += _confusions(unknown, spread, errors, determined)
    low, high = unknown.bounds
    at_bound = [
        e.name for e, stuck in zip(unknown.entries, (values <= low) | (values >= high), strict=True) if stuck
    ]
    if at_bound:
        warnings.append(f"on the bound of what is possible: {', '.join(at_bound)}")
    fitted = unknown.at(values)
    warnings += implausible(fitted, [entry.effect for entry in unknown.entries])
    return Fit(
        vehicle=fitted,
        free=unknown,
        values=values,
        standard_errors=errors,
        covariance=spread,
        determined=determined,
        chi2=chi2,
        method=method,
        warnings=tuple(warnings),
    )


def _advice(unknown: Free, determined: NDArray[np.bool_]) -> list[str]:
    """One line for each effect of which the data leave something open."""
    lines = []
    for name in dict.fromkeys(entry.effect for entry in unknown.entries):
        pairs = zip(unknown.entries, determined, strict=True)
        left = [entry.name for entry, known in pairs if entry.effect == name and not known]
        if left:
            need = CATALOGUE[name].excitation
            lines.append(f"not determined by these data: {', '.join(left)}; it would need {need}")
    return lines


def _confusions(unknown: Free, spread: Array, errors: Array, determined: NDArray[np.bool_]) -> list[str]:
    """Pairs of entries that the data can hardly tell apart."""
    correlation = spread / np.outer(errors, errors)
    return [
        f"{unknown.entries[i].name} and {unknown.entries[j].name} can hardly be told apart by these data "
        f"(correlation {correlation[i, j]:+.3f})"
        for i in range(len(errors))
        for j in range(i)
        if abs(correlation[i, j]) > ALIKE and determined[i] and determined[j]
    ]
