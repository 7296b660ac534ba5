"""Pseudo-observations for sensors with occasional gross errors, as informative as Gaussian noise.

Errors of a DVL often follow Student's t instead of a Gaussian: most are small, a few are large.  The mean
squared residual of a true model then consists of those few.  The weight of the tails is estimated from the
samples of a channel alone.  It uses the deviation of each sample from the polynomial through its neighbours,
where motion cancels.  So model errors are never mistaken for outliers.

Let errors e have scale s and nu degrees of freedom.  The score of a sample is psi(e/s)/s with psi(z) = (nu +
1) z/(nu + z^2); let c be the mean of its slope psi'.  A sample y near a smooth motion m is replaced by the
pseudo-observation (Huber 1981, section 7.8)

    y* = m + s psi((y - m)/s)/c.

To first order it is the true value with an independent error of variance s^2 E[psi^2]/c^2, wherever m lies.
For t noise that is s^2 (nu + 3)/(nu + 1), the Cramer-Rao bound.  Least squares on y* is then as efficient as
maximum likelihood on y (Lange, Little and Taylor 1989), and tests that assume Gaussian noise keep their
level.

The approximation fails where the error of m is about s: y* is then drawn to m and misses every turn, as if
the motion had been smoothed.  So m is the widest local cubic that follows the channel's motion.  A wide one
is less affected by outliers, a narrow one follows faster motion.  If none follows, the samples stay
unchanged.

If samples are sparse relative to the motion, its corners look like outliers.  Two conditions exclude that.
Seven samples must lie within a second (`jumps.is_sparse`).  And large residuals must not grow when the
polynomial uses every second sample.  An independent error keeps its size at any spacing, while the
interpolation error of a motion grows with the spacing.

Pseudo-observations belong to the observation model (`recording.arrays.Recording`).  The raw table keeps the
samples as logged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import polars as pl
import scipy

from hydro.core.columns import POSE, VELOCITY, Array, Mask
from hydro.core.local_polynomials import savitzky_golay, savitzky_golay_weights
from hydro.core.recording.arrays import LEAST_NOISE, Recording, evenly_spaced, samples
from hydro.core.recording.jumps import is_sparse
from hydro.core.vehicle.frames import wrapped

CHANNELS = (*POSE, *VELOCITY)
FREEDOMS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0)
"""Candidate degrees of freedom in addition to Gauss; above eight there is little to gain."""
FILTERS = ((3, 3), (5, 7))
"""Neighbours on each side, and degree of the polynomial through them; the second filter passes less motion.
"""
LIKELIER = 3.0
"""Minimum log-likelihood ratio of t over Gauss in both filters, per sample times independent samples."""
ALIKE = 0.3
"""Minimum ratio of the second filter's log-likelihood gain to the first's: noise leaves half, corners of the
motion a tenth."""
LARGE = 4.0
"""Ratio to the median residual above which residuals are compared at both spacings."""
GROWTH = 0.95
"""Maximum slope of large residuals at twice the spacing versus those at single spacing.

Independent errors give 0.75 to 0.94 (Gauss to t with 1.5 degrees of freedom), corners of a motion 1.2 to 4;
see `benchmarks/heavy_tails.py`.
"""
MOST_SAMPLES, LEAST_SAMPLES = 20_000, 200
STEPS_ALIKE = 0.05  # share of equal neighbours above which a channel is quantised or held
REACH = 0.12  # s, half-width of the widest cubic
LEAST_REACH = 3  # samples, half-width of the narrowest cubic
FINE = (11, 7)  # samples and degree of the reference polynomial
MISFIT = 1.5  # misfit of the narrowest cubic above which the motion is too fast
WIDER = 1.15  # misfit below which a wider cubic is used; a false rejection costs little
TURNS = 12  # iterations of smoothed motion and pseudo-observations
PLAUSIBLE = 0.01  # expected number of samples with such an error above which one is not a fault
LEVEL = 0.5  # cosine of the pitch below which noise dominates roll and heading
ANGLES = range(3, 6)
GRID, FARTHEST = 0.02, 80.0  # step and range of the densities, in units of the scale
NOTHING = 1e-20
"""Value of a characteristic function that no longer changes a density, of which 1e-12 is the least."""


@dataclass(frozen=True)
class Tail:
    """Noise of one channel, described by Student's t distribution.

    Attributes:
        channel: Name of the channel.
        freedom: Degrees of freedom nu.
        scale: Scale s of the distribution, in the channel's unit.
        width: Number of samples, odd, of the local cubic polynomial that represents the channel's motion.
    """

    channel: str
    freedom: float
    scale: float
    width: int

    def score(self, z: Array) -> Array:
        """Return the score function psi(z) = (nu + 1) z/(nu + z^2), an array like `z`.

        nu are the degrees of freedom.

        Args:
            z: Errors in units of the scale.
        """
        psi: Array = (self.freedom + 1.0) * z / (self.freedom + z**2)
        return psi

    def slope(self, z: Array) -> Array:
        """Return the derivative psi'(z) of the score function, an array like `z`.

        Args:
            z: Errors in units of the scale.
        """
        square = z**2
        slope: Array = (self.freedom + 1.0) * (self.freedom - square) / (self.freedom + square) ** 2
        return slope

    def plausible(self, error: Array, count: int) -> Mask:
        """Return a mask of the errors that are plausible even as the largest of several samples.

        Args:
            error: Errors, in the channel's unit, of any shape; the mask has the same.
            count: Number of these samples.
        """
        beyond = count * 2.0 * scipy.special.stdtr(self.freedom, -np.abs(error) / self.scale)
        return np.asarray(beyond >= PLAUSIBLE)


def heavy_tails(record: Recording) -> dict[int, Tail]:
    """Find the channels whose noise has heavy tails, and fit Student's t distribution to the noise.

    Channels whose motion is too fast for a local cubic polynomial are left out, because their noise cannot be
    separated from the motion.

    Args:
        record: Recording.

    Returns:
        Noise of each such channel, by its number: 0 to 5 pose, 6 to 11 velocity.
    """
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
    """Return a table with pseudo-observations in the place of samples with heavy-tailed noise.

    A pseudo-observation has Gaussian noise with as much information as the sample.  Other channels stay
    unchanged.

    Args:
        raw: Raw table; it is not changed.
        record: The table as arrays.
        tails: Noise of the channels with heavy tails, from `heavy_tails`.

    Returns:
        The table, and the standard deviations of the pseudo-observations, (12,), NaN for other channels.
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
    """Return pseudo-observations of one channel, segment by segment, and their common standard deviation.

    A pseudo-observation is the value of a local cubic polynomial plus a limited part of the sample's error.

    Args:
        parts: Evenly spaced samples, one array per segment; segments shorter than `tail.width` stay
            unchanged.
        tail: Noise of the samples.
    """
    width = tail.width
    pseudo = [part.copy() for part in parts]
    long = [i for i, part in enumerate(parts) if len(part) >= width]
    kept = 1.0 - float(savitzky_golay_weights(width, 3)[width // 2])  # share of the variance
    for _ in range(TURNS):
        motion = [savitzky_golay(pseudo[i], width, 3) for i in long]
        z = [(parts[i] - smooth) / tail.scale for i, smooth in zip(long, motion, strict=True)]
        reach = tail.scale / float(tail.slope(np.concatenate(z) / np.sqrt(kept)).mean())
        for i, smooth, off in zip(long, motion, z, strict=True):
            pseudo[i] = smooth + reach * tail.score(off)
    left = np.concatenate([pseudo[i] - savitzky_golay(pseudo[i], width, 3) for i in long])
    return pseudo, float(np.sqrt(np.mean(left**2) / kept))


def _spacing(record: Recording, channel: int) -> float:
    """Return the mean time from one sample of a channel to the next [s]."""
    share = 1.0 if record.seen is None else max(float(record.seen[:, channel].mean()), 1e-9)
    return record.dt / share


def _widest(record: Recording, channel: int) -> int:
    """Return the samples of the widest cubic for the motion."""
    return 2 * max(round(REACH / _spacing(record, channel)), LEAST_REACH) + 1


def _tail(name: str, parts: Sequence[Array], widest: int) -> Tail | None:
    """Fit Student's t to one channel, by the filter that gives the lighter tail.

    The result is None if Gauss fits equally well, or if the motion is too fast.
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
    """Return the slope of large residuals at twice the spacing versus those at single spacing.

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
    """Return the tail with the widest cubic that follows the motion; None if none does.

    The search starts with the narrowest cubic: pseudo-observations about a cubic that is too wide follow it
    and hide its misfit.
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
    """Return the mean squared deviation of the cubic from a finer polynomial over that of white noise.

    It is 1 if the cubic follows the motion.  Both pass through the pseudo-observations, so that outliers do
    not hide a short stretch of fast motion.
    """
    pseudo, _ = pseudo_observations(parts, tail)
    whole = max(tail.width, FINE[0])
    cubic, fine = (_centred(savitzky_golay_weights(*shape), whole) for shape in ((tail.width, 3), FINE))
    noise = _power(pseudo, _centred(np.ones(1), whole) - fine)
    return _power(pseudo, cubic - fine) / noise


def _power(parts: Sequence[Array], taps: Array) -> float:
    """Return the variance of white noise with the same power after a filter."""
    left = np.concatenate([np.convolve(part, taps, "valid") for part in parts])
    return float(np.mean(left**2) / (taps @ taps))


def _centred(taps: Array, count: int) -> Array:
    """Return taps padded on both sides to `count`."""
    return np.pad(taps, (count - len(taps)) // 2)


def _likeliest(parts: Sequence[Array], place: int) -> tuple[float, float, float]:
    """Return the log-likelihood gain of t over Gauss, its degrees of freedom and scale, for a filter."""
    taps = _taps(*FILTERS[place])
    off = np.abs(np.concatenate([np.convolve(part, taps, "valid") for part in parts]))
    off = np.sort(off[:: -(-len(off) // MOST_SAMPLES)])  # sorted values interpolate faster
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
    """Return places and log density of a filter's output over its median, and the median."""
    x, density = _distribution(_taps(*FILTERS[place]), freedom)
    middle = _middle(x, density)
    return (x / middle, np.log(np.maximum(density * middle, 1e-300))), middle


def _distribution(taps: Array, freedom: float) -> tuple[Array, Array]:
    """Return the density of |sum_j taps_j e_j|, e of scale 1, from its characteristic function."""
    count = round(FARTHEST / GRID)
    t = np.arange(count) * np.pi / FARTHEST
    whole = np.ones(count)
    sizes, times = np.unique(np.abs(taps[taps != 0.0]).round(12), return_counts=True)
    for size, number in zip(sizes[::-1], times[::-1], strict=True):  # each but the middle one twice
        some = slice(np.searchsorted(-whole, -NOTHING))  # it falls with t
        whole[some] *= _characteristic(t[some] * size, freedom) ** number
    folded = np.fft.irfft(whole)[:count] * 2.0 * (count - 1) / FARTHEST
    return np.arange(count) * FARTHEST / (count - 1), np.maximum(folded, 1e-12)


def _characteristic(t: Array, freedom: float) -> Array:
    """Return the characteristic function of Student's t, or of the normal distribution."""
    if not np.isfinite(freedom):
        return np.asarray(np.exp(-0.5 * t**2))
    half, way = 0.5 * freedom, np.sqrt(freedom) * np.maximum(t, 1e-9)
    value: Array = scipy.special.kv(half, way) * way**half / (scipy.special.gamma(half) * 2.0 ** (half - 1.0))
    return np.where(t > 1e-9, value, 1.0)


def _middle(x: Array, density: Array) -> float:
    """Return the median of a density on a grid."""
    below = np.cumsum(density) - 0.5 * (density + density[0])  # trapezoidal rule
    return float(np.interp(0.5 * below[-1], below, x))


def _taps(reach: int, degree: int) -> Array:
    """Return the filter of a sample's deviation from the polynomial through its neighbours."""
    k = np.arange(-reach, reach + 1)
    powers = np.vander(k, degree + 1, increasing=True).astype(float)
    taps = np.zeros(len(k))
    taps[k == 0] = 1.0
    taps[k != 0] = -np.linalg.pinv(powers[k != 0])[0]
    return taps
