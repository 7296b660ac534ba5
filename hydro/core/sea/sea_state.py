"""Waves in a recording: a narrow band of the water's motion on orbits, beside a smooth continuum.

`water_motion` says how the water would have to move for a file to explain a recording.  What the file lacks
or has wrong, and noise, make of it a continuum over frequency; a sea makes a band in which the water swings
alike along one direction and a quarter of a period later down.  The spectra of north, east and down and what
they share,

    S(omega) = S_v(omega) d d^H + diag(continuum),   d = (cos direction, sin direction, -i),

S_v that of JONSWAP at the recording's depths, are fitted to the Fourier coefficients by Whittle's likelihood
(Whittle 1953; Brillinger 1981, section 7.3).  As much again could be made by a force that swings in each axis
for itself; only where the orbit tells more than that is it a sea.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import OptimizeResult, minimize
from scipy.stats import chi2

from hydro.core.columns import Array
from hydro.core.effects.waves import COMPONENTS, WAVES, elevation_spectrum, harmonics
from hydro.core.errors import DataError
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.identification.candidate import candidate
from hydro.core.recording.arrays import Recording
from hydro.core.sea.water_motion import water_motion
from hydro.core.vehicle.description import Vehicle

PERIODS = (1.5, 20.0)
"""Of the waves that are looked for [s]."""
FASTEST = 1.6  # frequency that is looked at, over that of the fastest waves
CYCLES = 5.0  # of the slowest waves that are looked for in the longest segment
SLOWEST = 3  # Fourier frequency of a segment that is looked at first: drifts are below
EVERY = 2  # Fourier frequencies under Hann's taper that are nearly independent
LEAST_FREQUENCIES = 24
SPARSE = 10  # rows from one depth that counts to the next
DEGREE = 3  # of the logarithm of a continuum in that of frequency
STARTS = 24  # periods from which a fit begins,
HEIGHTS = (0.02, 0.06, 0.2, 0.6, 2.0)  # [m],
PEAKS = (0.0, 4.0)  # and peaks
MOST_PEAK = 20.0
LEAST_HEIGHT, MOST_HEIGHT = 1e-4, 30.0  # [m]
SPLIT = -0.35  # logarithm of the height in each axis, from which a band without orbits begins
SAMPLES = 4.0  # of attitude and velocity in the shortest period
RAISED = (0.8, 0.8)
"""Logarithm of the peak enhancement of seas, and its standard deviation (Hasselmann et al. 1973)."""
TELLING, ORBITAL = 100.0, 50.0
"""Twice the logarithm of the likelihood that waves must gain over a continuum, and orbits over a band that
swings in each axis for itself: slow errors of a hull that pitches as it sinks gain up to 100 and 35."""
SURE = 2.0  # standard errors by which a sea must have a height
SCATTER = 1.4
"""Times Fisher's information by which values scatter: a minute has few waves, and no taper parts them all."""
TRUSTED = (0.6, 2.2)
"""Frequencies, over that of the peak, at which a sea is as its spectrum says: its values are of these."""
BOUND = 0.05  # logarithm of frequency beyond the slowest waves that are looked for: below it are drifts
ENDED = {"ftol": 1e-7}  # tolerance of the likelihood
LOGARITHMS = (-80.0, 20.0)  # bounds of a continuum's
WORTH = 12.0
"""What waves must gain from where a fit begins for it to be made."""
STEP = 1e-3  # of a parameter, for the slopes of the spectra
AXES = 3


@dataclass(frozen=True)
class Coefficients:
    """Fourier coefficients of the water's velocity under Hann's taper.

    Attributes:
        omega: Their frequencies [rad/s], (F,).
        y: North, east, down; of unit expected square where the one-sided spectrum is 1, (F, 3).
        decay: What depth leaves of a wave's power in the segment of each, (F,), of its own frequency.
        longest: Of the segments [s].
    """

    omega: Array
    y: Any
    decay: Array
    longest: float

    @cached_property
    def squares(self) -> Array:
        """Squared size of each, (F, 3)."""
        return np.asarray(np.abs(self.y) ** 2)

    @cached_property
    def powers(self) -> Array:
        """Of the logarithm of frequency, (F, DEGREE + 1)."""
        return np.asarray(np.log(self.omega)[:, None] ** np.arange(DEGREE + 1))

    def within(self, low: float, high: float) -> Coefficients:
        """Those between two frequencies [rad/s]."""
        kept = (self.omega >= low) & (self.omega <= high)
        return Coefficients(self.omega[kept], self.y[kept], self.decay[kept], self.longest)


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
        return float(min(STARTS * chi2.sf(self.telling, len(self.values)), 1.0))

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
    still = minimize(lambda at: _still(seen, at), floor.ravel(), jac=True, method="L-BFGS-B", options=ENDED)
    begin = _beginning(seen, still.x, slowest)
    if 2.0 * (still.fun - _unlikely(seen, still.x, begin)) < WORTH:
        return None
    bounds = _bounds(slowest)
    sea = _descended(lambda at: _unlikely(seen, at[:-4], at[-4:]), np.concatenate([still.x, begin]), bounds)
    each = np.concatenate([still.x, np.full(AXES, sea.x[-4] + SPLIT), sea.x[[-3, -1]]])
    limits = [bounds[0]] * AXES + [bounds[1], bounds[3]]
    apart = _descended(lambda at: _unlikely(seen, at[:-5], apart=at[-5:]), each, limits)
    near = seen.within(*(share * math.exp(sea.x[-3]) for share in TRUSTED))
    last = _descended(lambda at: _unlikely(near, at[:-4], at[-4:]), sea.x, bounds)
    values, spread = _natural(last.x, near)
    drifts = min(sea.x[-3], last.x[-3]) < math.log(2.0 * math.pi / slowest) + BOUND
    if drifts or not np.isfinite(spread).all() or values[0] < SURE * math.sqrt(spread[0, 0]):
        return None
    speed = _speed(values, gravity, max(float(np.median(record.eta[:, 2])), 0.0))
    return SeaState(values, spread, 2.0 * (still.fun - sea.fun), 2.0 * (apart.fun - sea.fun), speed)


def _beginning(seen: Coefficients, floor: Array, slowest: float) -> Array:
    """The most likely of some seas beside a continuum."""
    grid = itertools.product(HEIGHTS, np.geomspace(PERIODS[0], slowest, STARTS), PEAKS)
    seas = []
    for height, period, peak in grid:
        top = 2.0 * math.pi / period
        seas.append(np.array([math.log(height), math.log(top), _way(seen, top), math.log1p(peak)]))
    return min(seas, key=lambda one: _unlikely(seen, floor, one))


def _bounds(slowest: float) -> list[tuple[float | None, float | None]]:
    """Of logarithms of height and frequency, of direction and of the logarithm of the enhancement."""
    heights = math.log(LEAST_HEIGHT), math.log(MOST_HEIGHT)
    tops = math.log(2.0 * math.pi / slowest), math.log(2.0 * math.pi / PERIODS[0])
    return [heights, tops, (None, None), (0.0, math.log1p(MOST_PEAK))]


def coefficients(water: Array, record: Recording, gravity: float) -> Coefficients | None:
    """Fourier coefficients of the water's motion; None of too short a recording."""
    parts = list[tuple[Array, Any, Array]]()
    longest = 0.0
    for begin, end in record.segments:
        seconds, rows = (end - begin) * record.dt, end - begin
        harmonics = np.arange(SLOWEST, rows // 2, EVERY)
        omega = 2.0 * math.pi * harmonics / seconds
        omega = omega[omega <= FASTEST * 2.0 * math.pi / PERIODS[0]]
        if omega.size < LEAST_FREQUENCIES // 2:
            continue
        longest = max(longest, seconds)
        taper = np.hanning(rows)
        y = water[begin:end] - water[begin:end].mean(axis=0)
        spectrum = np.fft.rfft(y * taper[:, None], axis=0)[harmonics[: omega.size]]
        spectrum *= math.sqrt(record.dt / (math.pi * (taper @ taper)))
        depth, weight = np.maximum(record.eta[begin:end:SPARSE, 2], 0.0), taper[::SPARSE] ** 2
        decay = np.exp(-2.0 * np.outer(omega**2 / gravity, depth)) @ weight / weight.sum()
        parts.append((omega, spectrum, decay))
    if sum(len(omega) for omega, _, _ in parts) < LEAST_FREQUENCIES:
        return None
    omega, y, decay = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Coefficients(omega, y, decay, longest)


def _unlikely(
    seen: Coefficients, floor: Array, sea: Array | None = None, apart: Array | None = None
) -> float:
    """Negative log likelihood of the coefficients.

    Args:
        seen: They.
        floor: Of the continua, (3 (DEGREE + 1),).
        sea: Logarithms of height and frequency of the peak, direction, logarithm of the enhancement; or None.
        apart: Of a band without orbits: logarithms of the height in each axis, of frequency and enhancement.
    """
    f = _continuum(seen, floor)
    if apart is not None:
        band = _velocity_spectrum(seen, 1.0, apart[AXES], apart[AXES + 1])
        f = f + band[:, None] * np.exp(2.0 * apart[:AXES])
    each = np.log(f).sum(axis=1) + (seen.squares / f).sum(axis=1)
    if sea is not None:
        g = _velocity_spectrum(seen, math.exp(sea[0]), sea[1], sea[3])
        d = np.array([math.cos(sea[2]), math.sin(sea[2]), -1j])
        h = (np.abs(d) ** 2 / f).sum(axis=1)
        along = np.abs((np.conj(d) * seen.y / f).sum(axis=1)) ** 2
        each += np.log1p(g * h) - g * along / (1.0 + g * h)
    raised = sea[3] if sea is not None else apart[AXES + 1] if apart is not None else RAISED[0]
    return float(each.sum() + 0.5 * ((raised - RAISED[0]) / RAISED[1]) ** 2)


def _continuum(seen: Coefficients, floor: Array) -> Array:
    """Continua of north, east and down: polynomials of logarithms, (F, 3)."""
    return np.asarray(np.exp(np.clip(seen.powers @ floor.reshape(AXES, -1).T, *LOGARITHMS)))


def _still(seen: Coefficients, floor: Array) -> tuple[float, Array]:
    """The same without waves, and its gradient."""
    f = _continuum(seen, floor)
    relative = seen.squares / f
    free = (f > math.exp(LOGARITHMS[0])) & (f < math.exp(LOGARITHMS[1]))
    slope = (1.0 - relative) * free
    return float((np.log(f) + relative).sum()), (slope.T @ seen.powers).ravel()


def _velocity_spectrum(seen: Coefficients, height: float, top: float, raised: float) -> Array:
    """Spectrum of the water's velocity along the waves at the depths of the recording, (F,)."""
    elevation = elevation_spectrum(seen.omega, height, 2.0 * math.pi / math.exp(top), math.expm1(raised))
    velocity: Array = seen.omega**2 * elevation * seen.decay
    return velocity


def _descended(
    unlikely: Callable[[Array], float], begin: Array, bounds: Sequence[Any] = ()
) -> OptimizeResult:
    """The most likely parameters from a beginning; the last of them within bounds."""
    free = [(None, None)] * (len(begin) - len(bounds))
    return minimize(unlikely, begin, method="L-BFGS-B", bounds=[*free, *bounds], options=ENDED)


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
    count, base = found.size, _inverse_root(_spectra(near, found))
    slopes = []
    for move in STEP * np.eye(count):
        slope = (_spectra(near, found + move) - _spectra(near, found - move)) / (2.0 * STEP)
        slopes.append((base @ slope @ base).reshape(len(near.omega), -1))
    each = np.stack(slopes)
    information = np.einsum("pij,qij->pq", each.conj(), each).real
    information[-1, -1] += RAISED[1] ** -2
    size = np.sqrt(np.diag(information)) + 1e-12
    inverse = np.linalg.inv(information / np.outer(size, size) + 1e-9 * np.eye(count)) / np.outer(size, size)
    spread = SCATTER**2 * inverse
    height, top, way, raised = found[-4:]
    values = np.array(
        [math.exp(height), 2.0 * math.pi / math.exp(top), way % (2.0 * math.pi), math.expm1(raised)]
    )
    natural = np.array([values[0], -values[1], 1.0, values[3] + 1.0])
    return values, np.asarray(spread[-4:, -4:] * np.outer(natural, natural))


def _spectra(seen: Coefficients, at: Array) -> Array:
    """Spectral matrices of continua and sea, (F, 3, 3)."""
    floor, sea = at[:-4], at[-4:]
    d = np.array([math.cos(sea[2]), math.sin(sea[2]), -1j])
    g = _velocity_spectrum(seen, math.exp(sea[0]), sea[1], sea[3])
    diagonal = np.eye(AXES) * _continuum(seen, floor)[:, None, :]
    return np.asarray(g[:, None, None] * np.outer(d, d.conj()) + diagonal)


def _inverse_root(matrices: Array) -> Array:
    """S^-1/2 of Hermitian matrices."""
    values, vectors = np.linalg.eigh(matrices)
    root: Array = (vectors * values[:, None, :] ** -0.5) @ vectors.conj().transpose(0, 2, 1)
    return root
