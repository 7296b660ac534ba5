"""Detection of samples that jump away from their neighbours and back, which no force can cause."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro.core.columns import Array, Mask, Rows
from hydro.core.recording.arrays import LEAST_NOISE

NEIGHBOURS = 3
"""Samples on each side in the cubic that predicts a sample."""
JUMP = 8.0
"""Standard deviations from that cubic above which a sample may be a jump."""
ALONE = 10.0
"""Minimum ratio of a jump to the deviations of its neighbours, which are as large at a corner of the motion.
"""
BACK = 2.0
"""Minimum ratio of a jump to the change from the sample before to the one after: a persistent change is a
step."""
SHARP = 0.8
"""Share of a jump that must occur between two samples, on either side."""
PASSES = 6
RESOLVED = 1.0
"""Maximum time span of the samples of one cubic [s]: thrusters and small hulls respond in 0.1 to 1 s."""
BEYOND = 1.5
"""Factor by which a jump between sparse samples must exceed all other changes."""


def is_sparse(spacing: float) -> bool:
    """Return whether samples `spacing` [s] apart are too sparse to tell a corner from an outlier."""
    return 2 * NEIGHBOURS * spacing > RESOLVED


def jumping(series: Sequence[Array], bursts: Sequence[int], spacing: float = 0.0) -> list[Mask]:
    """Return one mask for each series of samples, true for the samples that jump away and back.

    The search is repeated without the samples already found.

    Args:
        series: Series of samples, evenly spaced.
        bursts: Numbers of consecutive samples that may jump together, each of which is tried.
        spacing: Time from sample to sample [s].  Between sparse samples a jump must exceed every other
            change, since the motion may change as fast.
    """
    values, odd = [part.copy() for part in series], [np.zeros(len(part), bool) for part in series]
    for stride in bursts:
        for _ in range(PASSES):
            compared = [_off_cubic(part, stride) for part in values]
            usual, found = _usual(np.concatenate(compared)), 0
            for part, flags, off in zip(values, odd, compared, strict=True):
                large = np.flatnonzero(np.abs(off) > JUMP * max(usual, _usual(off)))
                new = large[_alone(part, stride, large)]
                flags[new + NEIGHBOURS * stride] = True
                part[new + NEIGHBOURS * stride] -= off[new]
                found += new.size
            if not found:
                break
    return _beyond_motion(series, odd) if is_sparse(spacing) else odd


def _beyond_motion(series: Sequence[Array], odd: Sequence[Mask]) -> list[Mask]:
    """Return the jumps whose both edges exceed BEYOND times the largest other change between samples."""
    changes = [np.abs(np.diff(part))[~(bad[1:] | bad[:-1])] for part, bad in zip(series, odd, strict=True)]
    largest, kept = max((float(part.max()) for part in changes if part.size), default=0.0), []
    for part, bad in zip(series, odd, strict=True):
        flags = np.zeros(len(part), bool)
        for begin, end in np.flatnonzero(np.diff(bad, prepend=False, append=False)).reshape(-1, 2):
            edges = np.abs(np.diff(part[begin - 1 : end + 1])) if begin else np.zeros(1)
            flags[begin:end] = min(edges[0], edges[-1]) > BEYOND * largest
        kept.append(flags)
    return kept


def _usual(off: Array) -> float:
    """Return the robust standard deviation from the median size, at least the least noise."""
    return max(float(np.median(np.abs(off))) / 0.6745, LEAST_NOISE) if off.size else LEAST_NOISE


def _off_cubic(y: Array, stride: int) -> Array:
    """Return each sample's deviation from the cubic through its neighbours.

    Args:
        y: Samples, (n,).
        stride: Step between the neighbours: a burst of `stride` samples jumps as one.

    Returns:
        (n - 2 NEIGHBOURS stride,), without both ends.
    """
    count = max(len(y) - 2 * NEIGHBOURS * stride, 0)
    off = np.zeros(count)
    for i, weight in enumerate(OFF[NEIGHBOURS]):
        off += weight * y[i * stride : i * stride + count]
    return off


def _alone(y: Array, stride: int, places: Rows) -> Mask:
    """Return which samples are jumps: sharp, back after the burst, and larger than their neighbours, (m,).

    Args:
        y: Samples, (n,).
        stride: Step between the neighbours.
        places: Places of m samples among those of `_off_cubic`, (m,).
    """
    reach = NEIGHBOURS * stride
    around = y[places[:, None] + np.arange(2 * reach + 1)]
    left = around[:, ::stride] @ OFF.T
    off, beside = left[:, NEIGHBOURS], np.delete(left, NEIGHBOURS, axis=1)
    size, way = np.abs(off), np.abs(around[:, reach + stride] - around[:, reach - stride])
    edges = np.sign(off)[:, None] * np.diff(around[:, reach - stride : reach + stride + 1], axis=1)
    up, down = edges[:, :stride].max(axis=1), -edges[:, stride:].min(axis=1)
    sharp = np.minimum(up, down) > SHARP * size
    return np.asarray(sharp & (size > ALONE * np.sqrt((beside**2).mean(axis=1))) & (size > BACK * way))


def _off() -> Array:
    """Return the map from 2 NEIGHBOURS + 1 samples to deviations from a cubic without the middle, (7, 7)."""
    k = np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    powers = np.vander(k, 4, increasing=True).astype(float)
    through = np.zeros((len(k), len(k)))
    through[:, k != 0] = powers @ np.linalg.pinv(powers[k != 0])
    off: Array = np.eye(len(k)) - through
    return off


OFF = _off()
