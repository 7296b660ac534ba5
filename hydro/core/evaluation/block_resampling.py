"""Block bootstrap of one recording, the basis of intervals and confidences.

Neighbouring samples of a motion are not independent, so whole blocks are drawn with replacement (Künsch
1989). With few blocks they get random weights instead (the Bayesian bootstrap of Rubin 1981), so that none is
left out. Only sums over blocks are drawn: every measure follows from them.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array

SAMPLES = 1000
"""Number of recordings drawn for an interval."""
INTERVAL = (2.5, 97.5)
"""Percentiles that bound 95 % of the drawn values."""


def block_sums(values: Array, size: int) -> Array:
    """Return sums over blocks of `size` rows of (N, K), shape (B, K); the last block may have fewer rows."""
    sums: Array = np.add.reduceat(values, np.arange(0, len(values), size), axis=0)
    return sums


def draws(blocks: int, seed: int) -> Array:
    """Return how often each of SAMPLES recordings contains each block, shape (SAMPLES, blocks)."""
    drawn = np.random.default_rng(seed).multinomial(blocks, np.full(blocks, 1.0 / blocks), size=SAMPLES)
    return drawn.astype(np.float64)


def redrawn(sums: Array, seed: int) -> Array:
    """Draw the sums of SAMPLES recordings from those of each block (B, K), shape (SAMPLES, K).

    Recordings are drawn one by one, because a table of all draws would be large with many blocks.
    """
    rng, blocks = np.random.default_rng(seed), len(sums)
    drawn = np.empty((SAMPLES, sums.shape[1]))
    for sample in range(SAMPLES):
        drawn[sample] = np.bincount(rng.integers(0, blocks, blocks), minlength=blocks) @ sums
    return drawn


def weights(blocks: int, samples: int, seed: int) -> Array:
    """Draw random weights of the blocks, shape (samples, blocks), each row of sum 1."""
    return np.random.default_rng(seed).dirichlet(np.ones(blocks), samples)


def interval(drawn: Array) -> Array:
    """Return the lower and upper end of the 95 % interval of drawn values (S, ...), shape (2, ...)."""
    return np.percentile(drawn, INTERVAL, axis=0)
