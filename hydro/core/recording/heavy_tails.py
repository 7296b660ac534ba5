"""Sensors that err grossly now and then: their samples made as good as those of Gaussian noise.

Errors of a Doppler log are often Student's t rather than Gauss: most are small, a few are large, and the
mean squared residual that a right model leaves is those few.  How heavy the tails are is estimated from the
samples of a channel alone, from what each lies off the polynomial through its neighbours, where motion
cancels: so that what a model cannot explain is never taken for an outlier.

Let errors e have scale s and nu degrees of freedom.  The score of a sample is psi(e/s)/s with
psi(z) = (nu + 1) z/(nu + z^2); let c be the mean of its slope psi'.  A sample y near a smooth motion m is
replaced by the pseudo-observation (Huber 1981, section 7.8)

    y* = m + s psi((y - m)/s)/c.

To first order it is the true value with an independent error of variance s^2 E[psi^2]/c^2, wherever m lies;
of t noise that is s^2 (nu + 3)/(nu + 1), the Cramer-Rao bound.  Least squares on y* is then as efficient as
maximum likelihood on y (Lange, Little and Taylor 1989), and what supposes Gaussian noise holds its level.

That order ends where m is off by about s: from there on y* is drawn to m, and misses every turn as if the
motion had been smoothed.  So m is the widest local cubic that follows the channel's motion: a wide one is
drawn less by outliers, a narrow one sees faster motion.  Where none follows, the samples stay as they are.

Where samples are sparse beside the motion, its corners look like outliers.  Two conditions rule that out.
Seven samples must lie within a second (`jumps.is_sparse`).  And large residuals
must not grow when the polynomial is laid through every second sample: an independent error keeps its size
at any spacing, while the interpolation error of a motion grows with it.

Pseudo-observations belong to the observation model (`recording.arrays.Recording`).  The raw table keeps the
samples as they were logged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import polars as pl
import scipy
from scipy.special import gamma, kv, stdtr

from hydro.core.columns import POSE, VELOCITY, Array, Mask
from hydro.core.recording.arrays import LEAST_NOISE, Recording, evenly_spaced, samples
from hydro.core.recording.jumps import is_sparse
from hydro.core.vehicle.frames import wrapped

CHANNELS = (*POSE, *VELOCITY)
FREEDOMS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0)
"""Degrees of freedom that are tried beside Gauss; above eight there is little to gain."""
FILTERS = ((3, 3), (5, 7))
"""Neighbours to each side, and degree of the polynomial through them: the second sees less of the motion."""
LIKELIER = 3.0
"""Logarithm of the likelihood, per sample times independent samples, by which t must beat Gauss in both,"""
ALIKE = 0.3
"""and part of the first's that the second's must be: noise leaves half, corners of the motion a tenth."""
LARGE = 4.0
"""Residuals above this multiple of their median size are compared at both spacings."""
GROWTH = 0.95
"""Largest slope of the residuals at twice the spacing against those at single spacing, for large residuals.

Independent errors give 0.75 to 0.94 (Gauss to t with 1.5 degrees of freedom), corners of a motion 1.2 to 4:
`benchmarks/heavy_tails.py` counts the errors."""
MOST_SAMPLES, LEAST_SAMPLES = 20_000, 200
STEPS_ALIKE = 0.05  # share of equal neighbours from which a channel reads in steps, or is held
REACH = 0.12  # s, half-width of the widest cubic that the motion is taken for,
LEAST_REACH = 3  # samples, that of the narrowest
FINE = (11, 7)  # samples and degree of the local polynomial that the cubics are held against
MISFIT = 1.5  # of the narrowest, from which the motion is too fast for any: the bias is still small there
WIDER = 1.15  # misfit below which a wider one is taken: little is lost where chance alone exceeds it
TURNS = 12  # of the smoothed motion and the samples
PLAUSIBLE = 0.01  # samples expected as far off, from which one such is no fault
LEVEL = 0.5  # cosine of the pitch below which roll and heading swing with the noise
ANGLES = range(3, 6)
GRID, FARTHEST = 0.02, 80.0  # of the densities, in units of the scale


@dataclass(frozen=True)
class Tail:
    """Noise of one channel as Student's t.

    Attributes:
        channel: Its name.
        freedom: Degrees of freedom nu.
        scale: s, in the channel's unit.
        width: Samples of the cubic that the channel's motion is taken for, odd.
    """

    channel: str
    freedom: float
    scale: float
    width: int

    def score(self, z: Array) -> Array:
        """psi(z) = (nu + 1) z/(nu + z^2)."""
        psi: Array = (self.freedom + 1.0) * z / (self.freedom + z**2)
        return psi

    def slope(self, z: Array) -> Array:
        """psi'(z)."""
        square = z**2
        slope: Array = (self.freedom + 1.0) * (self.freedom - square) / (self.freedom + square) ** 2
        return slope

    def plausible(self, error: Array, count: int) -> Mask:
        """Which errors the greatest of so many samples may well be."""
        beyond = count * 2.0 * stdtr(self.freedom, -np.abs(error) / self.scale)
        return np.asarray(beyond >= PLAUSIBLE)


def heavy_tails(record: Recording) -> dict[int, Tail]:
    """The channels, pose then velocity, whose noise is plainly Student's t, and whose motion is followed."""
    steep = bool((np.cos(record.eta[:, 4]) <= LEVEL).any())
    found = {}
    for i, parts in enumerate(samples(record)):
        if i in ANGLES and steep:
            continue
        if is_sparse(_spacing(record, i)):
            continue
        tail = _tail(CHANNELS[i], evenly_spaced(parts, record, i), _widest(record, i))
        if tail is not None:
            found[i] = tail
    return found


def pseudo_observed(
    raw: pl.DataFrame, record: Recording, tails: Mapping[int, Tail]
) -> tuple[pl.DataFrame, Array]:
    """A raw table whose channels with heavy tails hold pseudo-observations; all else stays bit for bit.

    Args:
        raw: Raw table.
        record: The same as arrays.
        tails: Of `heavy_tails`.

    Returns:
        The table, and the standard deviations of the pseudo-observations, (12,), NaN of other channels.
    """
    columns, sigma, every = [], np.full(len(CHANNELS), np.nan), list(samples(record))
    for i, tail in tails.items():
        parts, sigma[i] = pseudo_observations(evenly_spaced(every[i], record, i), tail)
        values, pseudo = raw[tail.channel].cast(pl.Float64).to_numpy().copy(), np.concatenate(parts)
        for start, stop in record.segments:
            seen = np.ones(stop - start, bool) if record.seen is None else record.seen[start:stop, i]
            part, pseudo = np.split(pseudo, [np.count_nonzero(seen)])
            values[start:stop][seen] = wrapped(part) if i in ANGLES else part
        columns.append(pl.Series(tail.channel, values, nan_to_null=True))
    return raw.with_columns(columns), sigma


def pseudo_observations(parts: Sequence[Array], tail: Tail) -> tuple[list[Array], float]:
    """y* about the local cubic through themselves, and their standard deviation; see the module.

    Args:
        parts: Evenly spaced samples, segment by segment; fewer than the cubic's stay as they are.
        tail: Their noise.
    """
    width = tail.width
    pseudo = [part.copy() for part in parts]
    long = [i for i, part in enumerate(parts) if len(part) >= width]
    kept = 1.0 - float(scipy.signal.savgol_coeffs(width, 3)[width // 2])  # of the variance, off the cubic
    for _ in range(TURNS):
        motion = [scipy.signal.savgol_filter(pseudo[i], width, 3) for i in long]
        z = [(parts[i] - smooth) / tail.scale for i, smooth in zip(long, motion, strict=True)]
        reach = tail.scale / float(tail.slope(np.concatenate(z) / np.sqrt(kept)).mean())
        for i, smooth, off in zip(long, motion, z, strict=True):
            pseudo[i] = smooth + reach * tail.score(off)
    left = np.concatenate([pseudo[i] - scipy.signal.savgol_filter(pseudo[i], width, 3) for i in long])
    return pseudo, float(np.sqrt(np.mean(left**2) / kept))


def _spacing(record: Recording, channel: int) -> float:
    """Return the mean time from one sample of a channel to the next [s]."""
    share = 1.0 if record.seen is None else max(float(record.seen[:, channel].mean()), 1e-9)
    return record.dt / share


def _widest(record: Recording, channel: int) -> int:
    """Samples of the widest cubic that the motion may be taken for."""
    return 2 * max(round(REACH / _spacing(record, channel)), LEAST_REACH) + 1


def _tail(name: str, parts: Sequence[Array], widest: int) -> Tail | None:
    """Student's t of one channel, of the filter that sees the lighter tail.

    None where Gauss does as well, and where the motion is too fast.
    """
    parts = [part for part in parts if len(part) >= max(widest, FINE[0])]
    if sum(map(len, parts)) < LEAST_SAMPLES:
        return None
    if np.mean(np.concatenate([np.diff(part) == 0.0 for part in parts])) > STEPS_ALIKE:
        return None
    (first, freedom, scale), (second, lighter, its) = (_likeliest(parts, i) for i in range(len(FILTERS)))
    if second < max(LIKELIER, ALIKE * first) or first < LIKELIER or min(scale, its) < LEAST_NOISE:
        return None
    if _growth(parts) > GROWTH:
        return None
    likely = (freedom, scale) if freedom >= lighter else (lighter, its)
    return _following(Tail(name, *likely, widest), parts)


def _growth(parts: Sequence[Array]) -> float:
    """Return the slope of residuals at twice the spacing against those at single spacing, for large ones.

    Args:
        parts: Evenly spaced samples of one channel.
    """
    reach, degree = FILTERS[0]
    taps = _taps(reach, degree)
    spread = np.zeros(4 * reach + 1)
    spread[::2] = taps
    near, far = (
        np.concatenate([np.convolve(part, filtered, "valid") for part in parts if len(part) >= len(spread)])
        for filtered in (_centred(taps, len(spread)), spread)
    )
    large = np.abs(near) > LARGE * np.median(np.abs(near))
    return float(near[large] @ far[large] / (near[large] @ near[large])) if large.any() else 1.0


def _following(tail: Tail, parts: Sequence[Array]) -> Tail | None:
    """The same with a narrower cubic where its own does not follow the motion; None where none does.

    From the narrowest up: pseudo-observations about a cubic far too wide hide its misfit, for they follow it.
    """
    reach, widest = LEAST_REACH, tail.width // 2
    found = replace(tail, width=2 * reach + 1)
    if _misfit(parts, found) > MISFIT:
        return None
    while reach < widest:
        reach = min(2 * reach, widest)
        wider = replace(tail, width=2 * reach + 1)
        if _misfit(parts, wider) > WIDER:
            break
        found = wider
    return found


def _misfit(parts: Sequence[Array], tail: Tail) -> float:
    """Mean square that the cubic lies off a finer polynomial, over that of white noise: 1 if it follows.

    Both go through the pseudo-observations, of which no outlier hides a short stretch of fast motion.
    """
    pseudo, _ = pseudo_observations(parts, tail)
    whole = max(tail.width, FINE[0])
    cubic, fine = (_centred(scipy.signal.savgol_coeffs(*shape), whole) for shape in ((tail.width, 3), FINE))
    noise = _power(pseudo, _centred(np.ones(1), whole) - fine)
    return _power(pseudo, cubic - fine) / noise


def _power(parts: Sequence[Array], taps: Array) -> float:
    """Variance of white noise that would leave as much behind a filter."""
    left = np.concatenate([np.convolve(part, taps, "valid") for part in parts])
    return float(np.mean(left**2) / (taps @ taps))


def _centred(taps: Array, count: int) -> Array:
    """Taps in the middle of so many."""
    return np.pad(taps, (count - len(taps)) // 2)


def _likeliest(parts: Sequence[Array], place: int) -> tuple[float, float, float]:
    """By a filter's output: by how much t beats Gauss, its degrees of freedom, and its scale."""
    taps = _taps(*FILTERS[place])
    off = np.abs(np.concatenate([np.convolve(part, taps, "valid") for part in parts]))
    off = np.sort(off[:: -(-len(off) // MOST_SAMPLES)])  # in order, their densities are found far sooner
    median = float(np.median(off))
    if median <= 0.0:
        return 0.0, np.inf, 0.0
    found = [_density(place, freedom) for freedom in (*FREEDOMS, np.inf)]
    *each, gauss = (float(np.interp(off / median, *density).mean()) for density, _ in found)
    best = int(np.argmax(each))
    independent = sum(map(len, parts)) / len(taps)
    return (each[best] - gauss) * independent, FREEDOMS[best], median / found[best][1]


@cache
def _density(place: int, freedom: float) -> tuple[tuple[Array, Array], float]:
    """Of a filter's output over its median: places and logarithms of the density; and the median."""
    x, density = _distribution(_taps(*FILTERS[place]), freedom)
    middle = _middle(x, density)
    return (x / middle, np.log(np.maximum(density * middle, 1e-300))), middle


def _distribution(taps: Array, freedom: float) -> tuple[Array, Array]:
    """Density of the size of sum_j taps_j e_j, e of scale 1, by its characteristic function."""
    count = round(FARTHEST / GRID)
    t = np.arange(count) * np.pi / FARTHEST
    whole = np.ones(count)
    for tap in taps[taps != 0.0]:
        whole *= _characteristic(t * abs(tap), freedom)
    folded = np.fft.irfft(whole)[:count] * 2.0 * (count - 1) / FARTHEST
    return np.arange(count) * FARTHEST / (count - 1), np.maximum(folded, 1e-12)


def _characteristic(t: Array, freedom: float) -> Array:
    """Characteristic function of Student's t, or of the normal law."""
    if not np.isfinite(freedom):
        return np.asarray(np.exp(-0.5 * t**2))
    half, way = 0.5 * freedom, np.sqrt(freedom) * np.maximum(t, 1e-9)
    value: Array = kv(half, way) * way**half / (gamma(half) * 2.0 ** (half - 1.0))
    return np.where(t > 1e-9, value, 1.0)


def _middle(x: Array, density: Array) -> float:
    """Median of a density on a grid."""
    below = np.cumsum(density) - 0.5 * (density + density[0])  # trapezoidal rule
    return float(np.interp(0.5 * below[-1], below, x))


def _taps(reach: int, degree: int) -> Array:
    """What a sample lies off the polynomial through its neighbours: 1 for itself, less their weights."""
    k = np.arange(-reach, reach + 1)
    powers = np.vander(k, degree + 1, increasing=True).astype(float)
    taps = np.zeros(len(k))
    taps[k == 0] = 1.0
    taps[k != 0] = -np.linalg.pinv(powers[k != 0])[0]
    return taps
