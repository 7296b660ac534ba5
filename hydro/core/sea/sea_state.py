"""Detection of waves: a narrow band of orbital water motion above a smooth continuum.

`water_motion` returns the water velocity with which a vehicle file would explain a recording completely.
Missing or wrong effects and sensor noise give this velocity a smooth spectrum, the continuum.  A sea gives it
a narrow band in which the water oscillates along one direction, and downward a quarter of a period later. The
most likely sea and continuum are fitted from several initial periods (`sea.likelihood`).  A force that
oscillates independently in each axis could have the same spectra.  So a sea is accepted only if the orbital
phase between the axes adds enough likelihood.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from hydro.core.columns import Array
from hydro.core.effects.waves import COMPONENTS, WAVES, harmonics
from hydro.core.errors import DataError
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import Recording
from hydro.core.sea.likelihood import (
    AXES,
    DEGREE,
    PEAK_PRIOR,
    PERIODS,
    STEP,
    Coefficients,
    coefficients,
    spectra,
    unlikely,
)
from hydro.core.sea.water_motion import water_motion
from hydro.core.vehicle.description import Vehicle

CYCLES = 5.0  # minimum number of periods of the slowest tested waves in the longest segment
STARTS, FITTED = 24, 3
"""Number of initial periods that are compared, and of the most likely ones from which a fit starts."""
HEIGHTS = (0.02, 0.06, 0.2, 0.6, 2.0)  # candidate initial wave heights [m]
PEAKS = (0.0, 4.0)  # candidate initial peak enhancements, minus 1
MOST_PEAK = 20.0  # upper bound of the peak enhancement minus 1
LEAST_HEIGHT, MOST_HEIGHT = 1e-4, 30.0  # bounds of the wave height [m]
INDEPENDENT_HEIGHT = -0.35
"""Initial log height of each axis in the fit of a band of independent axes, relative to that of the sea."""
SAMPLES = 4.0  # minimum number of samples of attitude and velocity in the shortest period
MAX_PEAK_DEVIATION = 1.0  # upper bound of the standard deviation of the log of the peak enhancement
LEAST_RATIO, LEAST_ORBITAL_RATIO = 100.0, 50.0
"""Minimum of twice the log likelihood ratio of a sea to a continuum, and to a band of independent axes.

Without waves, slow model errors of a hull that pitches as it sinks reach 100 and 35.
"""
LEAST_HEIGHT_ERRORS = 2.0  # minimum wave height, in its standard errors
ERROR_FACTOR = 1.4
"""Factor on the standard errors from Fisher's information.

A minute has few waves, and no taper makes their coefficients fully independent.
"""
RELIABLE = (0.6, 2.2)
"""Range of frequencies around the peak, relative to the peak, to which the values of a sea are fitted."""
DRIFT_MARGIN = 0.05
"""Minimum distance of a sea's log peak frequency from that of the slowest tested waves; below are drifts."""
FIT_OPTIONS = {"ftol": 1e-9, "maxiter": 500}  # tolerance and iteration limit of the likelihood fit
LEAST_START_RATIO = 12.0
"""Minimum of twice the log likelihood ratio at the initial values for a fit to start."""
EIGENVALUE_FLOOR = 1e-12
"""Lower bound of the eigenvalues of a spectral matrix relative to the largest, against rounding."""


@dataclass(frozen=True)
class SeaState:
    """Sea (one system of waves) that a recording shows.

    Attributes:
        values: Significant height [m], peak period [s], direction of travel [rad] and peak enhancement minus
            1, (4,).
        spread: Covariance of the values, (4, 4).
        telling: Twice the log likelihood ratio of the sea to a smooth spectrum (continuum) alone.
        orbital: Twice the log likelihood ratio of the sea to a spectral peak with independent axes.
        speed: Root mean square velocity of the water at the recording's median depth [m/s].
    """

    values: Array
    spread: Array
    telling: float
    orbital: float
    speed: float

    @property
    def parameters(self) -> dict[str, float]:
        """Values of effect `ocean_waves` by parameter name, rounded to 0.01 of their standard errors."""
        digits = 2 - np.floor(np.log10(np.sqrt(np.diag(self.spread)) + 1e-12)).astype(int)
        names = (one.name for one in WAVES.parameters)
        each = zip(names, self.values.tolist(), digits.tolist(), strict=True)
        return {name: round(value, places) for name, value, places in each}

    @property
    def table(self) -> dict[str, Any]:
        """The sea as a dict, as in an `[[effect]]` table of a vehicle file."""
        return {"name": WAVES.name, **self.parameters}

    @property
    def p_value(self) -> float:
        """p-value of the sea if there is a smooth spectrum only, corrected for the number of trials."""
        return float(min(STARTS * scipy.special.chdtrc(len(self.values), max(self.telling, 0.0)), 1.0))

    @property
    def errors(self) -> dict[str, float]:
        """Standard errors of the values, by parameter name."""
        names = (one.name for one in WAVES.parameters)
        each = zip(names, np.sqrt(np.diag(self.spread)), strict=True)
        return {name: float(f"{error:.3g}") for name, error in each}


def shown(vehicle: Vehicle, record: Recording, motion: Motion | None = None) -> SeaState | None:
    """Return the sea that a recording shows beyond the forces of a vehicle file.

    Args:
        vehicle: Vehicle without waves.
        record: Recording.
        motion: Smoothed motion of the recording, if available.

    Returns:
        The sea; None if attitude or velocity is sampled too rarely, the recording is too short, or the
        evidence is too weak.
    """
    if record.seen is not None and record.seen[:, 3:].mean(axis=0).min() < SAMPLES * record.dt / PERIODS[0]:
        return None
    try:
        motion = motion or Motion.of(record)
    except DataError:  # too short to be smoothed
        return None
    water = water_motion(candidate(vehicle), record, motion)
    found = sea_state(water, record, vehicle.environment.gravity) if np.isfinite(water).all() else None
    return (
        found
        if found is not None and found.telling > LEAST_RATIO and found.orbital > LEAST_ORBITAL_RATIO
        else None
    )


def sea_state(water: Array, record: Recording, gravity: float) -> SeaState | None:
    """Return the most likely sea in a recording, even if the evidence is weak.

    Args:
        water: Water velocity that explains the recording, NED, from `water_motion`, (N, 3) [m/s].
        record: Recording of N rows.
        gravity: Acceleration of gravity [m/s^2].

    Returns:
        The sea.  None if the recording is too short, no sea is more likely than a smooth spectrum, the fit
        finds a drift, or the height is not significant.
    """
    seen = coefficients(water, record, gravity)
    if seen is None:
        return None
    slowest = max(min(PERIODS[1], seen.longest / CYCLES), PERIODS[0] + 1e-3)
    floor = np.zeros((AXES, DEGREE + 1))
    floor[:, 0] = np.log(seen.squares.mean(axis=0) + 1e-300)
    still = _minimised(lambda at: unlikely(seen, at), floor.ravel())
    beginnings = _initial_seas(seen, still.x, slowest)
    if 2.0 * (still.fun - unlikely(seen, still.x, beginnings[0])[0]) < LEAST_START_RATIO:
        return None
    bounds = _bounds(slowest)
    seas = [
        _minimised(lambda at: unlikely(seen, at[:-4], at[-4:]), np.concatenate([still.x, begin]), bounds)
        for begin in beginnings
    ]
    sea = min(seas, key=lambda one: float(one.fun))
    each = np.concatenate([still.x, np.full(AXES, sea.x[-4] + INDEPENDENT_HEIGHT), sea.x[[-3, -1]]])
    limits = [bounds[0]] * AXES + [bounds[1], bounds[3]]
    apart = _minimised(lambda at: unlikely(seen, at[:-5], apart=at[-5:]), each, limits)
    near = seen.within(*(share * math.exp(sea.x[-3]) for share in RELIABLE))
    last = _minimised(lambda at: unlikely(near, at[:-4], at[-4:]), sea.x, bounds)
    values, spread = _physical(last.x, near)
    drifts = min(sea.x[-3], last.x[-3]) < math.log(2.0 * math.pi / slowest) + DRIFT_MARGIN
    if drifts or not np.isfinite(spread).all() or values[0] < LEAST_HEIGHT_ERRORS * math.sqrt(spread[0, 0]):
        return None
    speed = _speed(values, gravity, max(float(np.median(record.eta[:, 2])), 0.0))
    return SeaState(values, spread, 2.0 * (still.fun - sea.fun), 2.0 * (apart.fun - sea.fun), speed)


def _initial_seas(seen: Coefficients, floor: Array, slowest: float) -> list[Array]:
    """Return the FITTED most likely seas, one for each initial period, above a given continuum.

    Args:
        seen: Fourier coefficients of the recording.
        floor: Polynomial coefficients of the log continua.
        slowest: Longest tested period [s].

    Returns:
        Parameters (4,) of each sea in the order of `likelihood.unlikely`, the most likely first.
    """
    best = []
    for period in np.geomspace(PERIODS[0], slowest, STARTS):
        top = 2.0 * math.pi / period
        way = _direction_near(seen, top)
        seas = [
            np.array([math.log(height), math.log(top), way, math.log1p(peak)])
            for height, peak in itertools.product(HEIGHTS, PEAKS)
        ]
        best.append(min((unlikely(seen, floor, one)[0], number, one) for number, one in enumerate(seas)))
    return [one for *_, one in sorted(best, key=lambda one: one[0])[:FITTED]]


def _bounds(slowest: float) -> list[tuple[float | None, float | None]]:
    """Return the bounds of log height, log peak frequency, direction and log of the peak enhancement."""
    heights = math.log(LEAST_HEIGHT), math.log(MOST_HEIGHT)
    tops = math.log(2.0 * math.pi / slowest), math.log(2.0 * math.pi / PERIODS[0])
    return [heights, tops, (None, None), (0.0, math.log1p(MOST_PEAK))]


def _minimised(
    unlikely: Callable[[Array], tuple[float, Array]], begin: Array, bounds: Sequence[Any] = ()
) -> scipy.optimize.OptimizeResult:
    """Minimise a negative log likelihood from initial values; `bounds` are those of the last parameters."""
    free = [(None, None)] * (len(begin) - len(bounds))
    return scipy.optimize.minimize(
        unlikely, begin, jac=True, method="L-BFGS-B", bounds=[*free, *bounds], options=FIT_OPTIONS
    )


def _direction_near(seen: Coefficients, top: float) -> float:
    """Return the direction of travel of waves near a frequency [rad/s], from the phase of the orbit [rad]."""
    y = seen.within(RELIABLE[0] * top, RELIABLE[1] * top).y
    quarter = (y[:, :2] * np.conj(y[:, 2:])).imag.sum(axis=0)
    return math.atan2(quarter[1], quarter[0])


def _speed(values: Array, gravity: float, depth: float) -> float:
    """Return the root mean square velocity of the water in a sea at a depth [m/s]."""
    _, k, amplitude, *_ = harmonics(values, gravity, np.full(COMPONENTS, 0.5)).T
    return math.sqrt(2.0 * float((amplitude**2 * np.exp(-2.0 * k * depth)).sum()))


def _physical(found: Array, near: Coefficients) -> tuple[Array, Array]:
    """Return height, period, direction and peak enhancement minus 1, (4,), with their covariance, (4, 4).

    The covariance is the inverse of Fisher's information, scaled by ERROR_FACTOR squared.

    Args:
        found: Fitted parameters of continua and sea, in the order of `likelihood.spectra`.
        near: Fourier coefficients near the peak, to which they were fitted.
    """
    count, base = found.size, _inverse_root(spectra(near, found))
    slopes = []
    for move in STEP * np.eye(count):
        slope = (spectra(near, found + move) - spectra(near, found - move)) / (2.0 * STEP)
        slopes.append((base @ slope @ base).reshape(len(near.omega), -1))
    each = np.stack(slopes)
    information = np.einsum("pij,qij->pq", each.conj(), each).real
    information[-1, -1] += PEAK_PRIOR[1] ** -2
    size = np.sqrt(np.diag(information)) + 1e-12
    inverse = np.linalg.inv(information / np.outer(size, size) + 1e-9 * np.eye(count)) / np.outer(size, size)
    spread = ERROR_FACTOR**2 * inverse
    height, top, way, raised = found[-4:]
    # The uncertainty of the log enhancement is large: use mean and standard deviation of a lognormal.
    wide = min(spread[-1, -1], MAX_PEAK_DEVIATION**2)
    enhanced = math.exp(raised + 0.5 * wide)
    values = np.array(
        [math.exp(height), 2.0 * math.pi / math.exp(top), way % (2.0 * math.pi), enhanced - 1.0]
    )
    natural = np.array([values[0], -values[1], 1.0, enhanced * math.sqrt(math.expm1(wide) / wide)])
    return values, np.asarray(spread[-4:, -4:] * np.outer(natural, natural))


def _inverse_root(matrices: Array) -> Array:
    """Return S^-1/2 of positive definite Hermitian matrices S, (F, 3, 3)."""
    values, vectors = np.linalg.eigh(matrices)
    values = np.maximum(values, EIGENVALUE_FLOOR * values[:, -1:])
    root: Array = (vectors * values[:, None, :] ** -0.5) @ vectors.conj().transpose(0, 2, 1)
    return root
