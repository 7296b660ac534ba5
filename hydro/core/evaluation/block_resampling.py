"""Block bootstrap of one recording, the basis of intervals and confidences.

Neighbouring samples of a motion are not independent, so whole blocks are drawn with replacement (Künsch
1989). With few blocks, random weights replace the draws (the Bayesian bootstrap of Rubin 1981), so that no
block is left out. Only sums over blocks are resampled, because every error measure follows from sums.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array

SAMPLES = 1000
"""Number of bootstrap resamples of a recording for an interval."""
INTERVAL = (2.5, 97.5)
"""Percentiles of the bootstrap values that bound the 95 % interval."""


def block_sums(values: Array, size: int) -> Array:
    """Return the sum of each of K columns over each of B blocks of consecutive rows, (B, K).

    Args:
        values: Values of K columns in N rows, (N, K).
        size: Rows of a block; the last block may be shorter.
    """
    sums: Array = np.add.reduceat(values, np.arange(0, len(values), size), axis=0)
    return sums


def draws(blocks: int, seed: int) -> Array:
    """Draw how often each of SAMPLES bootstrap resamples of a recording contains each of its blocks.

    Args:
        blocks: Number B of blocks of the recording.
        seed: Seed of the draws.

    Returns:
        Numbers, (SAMPLES, B); each row sums to B.
    """
    drawn = np.random.default_rng(seed).multinomial(blocks, np.full(blocks, 1.0 / blocks), size=SAMPLES)
    return drawn.astype(np.float64)


def redrawn(sums: Array, seed: int) -> Array:
    """Return the sums of K quantities over each of SAMPLES bootstrap resamples of B blocks, (SAMPLES, K).

    A resample contains B blocks, drawn with replacement.

    Args:
        sums: Sums of K quantities over each block, (B, K).
        seed: Seed of the draws.
    """
    rng, blocks = np.random.default_rng(seed), len(sums)
    drawn = np.empty((SAMPLES, sums.shape[1]))
    for sample in range(SAMPLES):
        drawn[sample] = np.bincount(rng.integers(0, blocks, blocks), minlength=blocks) @ sums
    return drawn


def weights(blocks: int, samples: int, seed: int) -> Array:
    """Draw weights of blocks for a Bayesian bootstrap; the weights of each resample sum to 1.

    Args:
        blocks: Number of blocks of the recording.
        samples: Number of resamples.
        seed: Seed of the draws.

    Returns:
        Weights, (samples, blocks).
    """
    return np.random.default_rng(seed).dirichlet(np.ones(blocks), samples)


def interval(drawn: Array) -> Array:
    """Return the lower and the upper end of the 95 % interval of bootstrap values, (2, ...).

    Args:
        drawn: Values of S resamples, (S, ...).
    """
    return np.percentile(drawn, INTERVAL, axis=0)
