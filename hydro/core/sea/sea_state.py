"""Waves in a recording: a narrow band of the water's motion on orbits, beside a smooth continuum.

`water_motion` says how the water would have to move for a file to explain a recording.  What the file lacks
or has wrong, and noise, make of it a continuum over frequency; a sea makes a band in which the water swings
alike along one direction and a quarter of a period later down.  Which sea, beside which continuum, is most
likely is found from several periods (`sea.likelihood`).  As much again could be made by a force that swings
in each axis for itself; only where the orbit tells more than that is it a sea.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import OptimizeResult, minimize
from scipy.special import chdtrc

from hydro.core.columns import Array
from hydro.core.effects.waves import COMPONENTS, WAVES, harmonics
from hydro.core.errors import DataError
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import Recording
from hydro.core.sea.likelihood import (
    AXES,
    DEGREE,
    PERIODS,
    RAISED,
    STEP,
    Coefficients,
    coefficients,
    spectra,
    unlikely,
)
from hydro.core.sea.water_motion import water_motion
from hydro.core.vehicle.description import Vehicle

CYCLES = 5.0  # of the slowest waves that are looked for in the longest segment
STARTS, TRIED = 24, 3  # periods from which a fit may begin, and of the most likely of which one does,
HEIGHTS = (0.02, 0.06, 0.2, 0.6, 2.0)  # [m],
PEAKS = (0.0, 4.0)  # and peaks
MOST_PEAK = 20.0
LEAST_HEIGHT, MOST_HEIGHT = 1e-4, 30.0  # [m]
SPLIT = -0.35  # logarithm of the height in each axis, from which a band without orbits begins
SAMPLES = 4.0  # of attitude and velocity in the shortest period
WIDEST = 1.0  # standard deviation at most of the logarithm of the peak enhancement
TELLING, ORBITAL = 100.0, 50.0
"""Twice the logarithm of the likelihood that waves must gain over a continuum, and orbits over a band that
swings in each axis for itself: slow errors of a hull that pitches as it sinks gain up to 100 and 35."""
SURE = 2.0  # standard errors by which a sea must have a height
SCATTER = 1.4
"""Times Fisher's information by which values scatter: a minute has few waves, and no taper parts them all."""
TRUSTED = (0.6, 2.2)
"""Frequencies, over that of the peak, at which a sea is as its spectrum says: its values are of these."""
BOUND = 0.05  # logarithm of frequency beyond the slowest waves that are looked for: below it are drifts
ENDED = {"ftol": 1e-9, "maxiter": 500}  # tolerance of the likelihood
WORTH = 12.0
"""What waves must gain from where a fit begins for it to be made."""
ROUNDED = 1e-12  # of the largest eigenvalue of a spectral matrix: less is rounding


@dataclass(frozen=True)
class SeaState:
    """What a recording shows of waves.

    Attributes:
        values: Height [m], period [s], direction [rad], peak, (4,).
        spread: Their covariance, (4, 4).
        telling: Twice the log likelihood ratio to the continuum alone.
        orbital: The same to a band in which each axis swings for itself.
        speed: Root mean square of the water's velocity at the recording's depths [m/s].
    """

    values: Array
    spread: Array
    telling: float
    orbital: float
    speed: float

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the effect, to a hundredth of their standard errors."""
        digits = 2 - np.floor(np.log10(np.sqrt(np.diag(self.spread)) + 1e-12)).astype(int)
        names = (one.name for one in WAVES.parameters)
        each = zip(names, self.values.tolist(), digits.tolist(), strict=True)
        return {name: round(value, places) for name, value, places in each}

    @property
    def table(self) -> dict[str, Any]:
        """The `[[effect]]` table."""
        return {"name": WAVES.name, **self.parameters}

    @property
    def p_value(self) -> float:
        """That a continuum alone would look like it at some period."""
        return float(min(STARTS * chdtrc(len(self.values), max(self.telling, 0.0)), 1.0))

    @property
    def errors(self) -> dict[str, float]:
        """Standard errors of its parameters."""
        names = (one.name for one in WAVES.parameters)
        each = zip(names, np.sqrt(np.diag(self.spread)), strict=True)
        return {name: float(f"{error:.3g}") for name, error in each}


def shown(vehicle: Vehicle, record: Recording) -> SeaState | None:
    """The waves that a recording shows beside a vehicle's file, by its forces; None where it shows none.

    Args:
        vehicle: The vehicle, without waves.
        record: The recording.
    """
    if record.seen is not None and record.seen[:, 3:].mean(axis=0).min() < SAMPLES * record.dt / PERIODS[0]:
        return None
    try:
        motion = Motion.of(record)
    except DataError:  # too short to be smoothed
        return None
    water = water_motion(candidate(vehicle), record, motion)
    found = sea_state(water, record, vehicle.environment.gravity) if np.isfinite(water).all() else None
    return found if found is not None and found.telling > TELLING and found.orbital > ORBITAL else None


def sea_state(water: Array, record: Recording, gravity: float) -> SeaState | None:
    """The waves that fit a recording best; None where it is too short to show any, or none is seen.

    Args:
        water: Motion of the water that explains the recording, (N, 3), of `water_motion`.
        record: The recording.
        gravity: [m/s^2].
    """
    seen = coefficients(water, record, gravity)
    if seen is None:
        return None
    slowest = max(min(PERIODS[1], seen.longest / CYCLES), PERIODS[0] + 1e-3)
    floor = np.zeros((AXES, DEGREE + 1))
    floor[:, 0] = np.log(seen.squares.mean(axis=0) + 1e-300)
    still = _descended(lambda at: unlikely(seen, at), floor.ravel())
    beginnings = _beginnings(seen, still.x, slowest)
    if 2.0 * (still.fun - unlikely(seen, still.x, beginnings[0])[0]) < WORTH:
        return None
    bounds = _bounds(slowest)
    seas = [
        _descended(lambda at: unlikely(seen, at[:-4], at[-4:]), np.concatenate([still.x, begin]), bounds)
        for begin in beginnings
    ]
    sea = min(seas, key=lambda one: float(one.fun))
    each = np.concatenate([still.x, np.full(AXES, sea.x[-4] + SPLIT), sea.x[[-3, -1]]])
    limits = [bounds[0]] * AXES + [bounds[1], bounds[3]]
    apart = _descended(lambda at: unlikely(seen, at[:-5], apart=at[-5:]), each, limits)
    near = seen.within(*(share * math.exp(sea.x[-3]) for share in TRUSTED))
    last = _descended(lambda at: unlikely(near, at[:-4], at[-4:]), sea.x, bounds)
    values, spread = _natural(last.x, near)
    drifts = min(sea.x[-3], last.x[-3]) < math.log(2.0 * math.pi / slowest) + BOUND
    if drifts or not np.isfinite(spread).all() or values[0] < SURE * math.sqrt(spread[0, 0]):
        return None
    speed = _speed(values, gravity, max(float(np.median(record.eta[:, 2])), 0.0))
    return SeaState(values, spread, 2.0 * (still.fun - sea.fun), 2.0 * (apart.fun - sea.fun), speed)


def _beginnings(seen: Coefficients, floor: Array, slowest: float) -> list[Array]:
    """The most likely seas of TRIED periods beside a continuum, the most likely first."""
    best = []
    for period in np.geomspace(PERIODS[0], slowest, STARTS):
        top = 2.0 * math.pi / period
        way = _way(seen, top)
        seas = [
            np.array([math.log(height), math.log(top), way, math.log1p(peak)])
            for height, peak in itertools.product(HEIGHTS, PEAKS)
        ]
        best.append(min((unlikely(seen, floor, one)[0], number, one) for number, one in enumerate(seas)))
    return [one for *_, one in sorted(best, key=lambda one: one[0])[:TRIED]]


def _bounds(slowest: float) -> list[tuple[float | None, float | None]]:
    """Of logarithms of height and frequency, of direction and of the logarithm of the enhancement."""
    heights = math.log(LEAST_HEIGHT), math.log(MOST_HEIGHT)
    tops = math.log(2.0 * math.pi / slowest), math.log(2.0 * math.pi / PERIODS[0])
    return [heights, tops, (None, None), (0.0, math.log1p(MOST_PEAK))]


def _descended(
    unlikely: Callable[[Array], tuple[float, Array]], begin: Array, bounds: Sequence[Any] = ()
) -> OptimizeResult:
    """The most likely parameters from a beginning; the last of them within bounds."""
    free = [(None, None)] * (len(begin) - len(bounds))
    return minimize(unlikely, begin, jac=True, method="L-BFGS-B", bounds=[*free, *bounds], options=ENDED)


def _way(seen: Coefficients, top: float) -> float:
    """Direction in which the water swings before it goes down, about a frequency."""
    y = seen.within(TRUSTED[0] * top, TRUSTED[1] * top).y
    quarter = (y[:, :2] * np.conj(y[:, 2:])).imag.sum(axis=0)
    return math.atan2(quarter[1], quarter[0])


def _speed(values: Array, gravity: float, depth: float) -> float:
    """Root mean square velocity of the water in a sea at a depth [m/s]."""
    _, k, amplitude, *_ = harmonics(values, gravity, np.full(COMPONENTS, 0.5)).T
    return math.sqrt(2.0 * float((amplitude**2 * np.exp(-2.0 * k * depth)).sum()))


def _natural(found: Array, near: Coefficients) -> tuple[Array, Array]:
    """Height, period, direction and peak, and their covariance from Fisher's information."""
    count, base = found.size, _inverse_root(spectra(near, found))
    slopes = []
    for move in STEP * np.eye(count):
        slope = (spectra(near, found + move) - spectra(near, found - move)) / (2.0 * STEP)
        slopes.append((base @ slope @ base).reshape(len(near.omega), -1))
    each = np.stack(slopes)
    information = np.einsum("pij,qij->pq", each.conj(), each).real
    information[-1, -1] += RAISED[1] ** -2
    size = np.sqrt(np.diag(information)) + 1e-12
    inverse = np.linalg.inv(information / np.outer(size, size) + 1e-9 * np.eye(count)) / np.outer(size, size)
    spread = SCATTER**2 * inverse
    height, top, way, raised = found[-4:]
    # the enhancement's logarithm scatters by so much that its mean and deviation are those of a lognormal
    wide = min(spread[-1, -1], WIDEST**2)
    enhanced = math.exp(raised + 0.5 * wide)
    values = np.array(
        [math.exp(height), 2.0 * math.pi / math.exp(top), way % (2.0 * math.pi), enhanced - 1.0]
    )
    natural = np.array([values[0], -values[1], 1.0, enhanced * math.sqrt(math.expm1(wide) / wide)])
    return values, np.asarray(spread[-4:, -4:] * np.outer(natural, natural))


def _inverse_root(matrices: Array) -> Array:
    """S^-1/2 of Hermitian matrices."""
    values, vectors = np.linalg.eigh(matrices)
    values = np.maximum(values, ROUNDED * values[:, -1:])
    root: Array = (vectors * values[:, None, :] ** -0.5) @ vectors.conj().transpose(0, 2, 1)
    return root
