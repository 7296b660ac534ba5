"""Recordings drawn anew from blocks of one: what intervals and confidences rest on.

Neighbouring samples of a motion are not independent: whole blocks are drawn with replacement (Künsch 1989),
or weighed at random (the Bayesian bootstrap of Rubin 1981), where none of few blocks may be left out.  All
that is drawn are sums over blocks: every measure follows from them.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array

SAMPLES = 1000
"""Recordings drawn for an interval."""
INTERVAL = (2.5, 97.5)
"""Percentiles that bound 95 % of them."""


def block_sums(values: Array, size: int) -> Array:
    """Sums over blocks of `size` rows of (N, K), shape (B, K); the last block may have fewer rows."""
    sums: Array = np.add.reduceat(values, np.arange(0, len(values), size), axis=0)
    return sums


def draws(blocks: int, seed: int) -> Array:
    """How often each of SAMPLES recordings has each block, shape (SAMPLES, blocks)."""
    drawn = np.random.default_rng(seed).multinomial(blocks, np.full(blocks, 1.0 / blocks), size=SAMPLES)
    return drawn.astype(np.float64)


def redrawn(sums: Array, seed: int) -> Array:
    """The sums of SAMPLES recordings from those of each block (B, K), shape (SAMPLES, K).

    One recording after another: with many blocks the table of all draws would be large.
    """
    rng, blocks = np.random.default_rng(seed), len(sums)
    drawn = np.empty((SAMPLES, sums.shape[1]))
    for sample in range(SAMPLES):
        drawn[sample] = np.bincount(rng.integers(0, blocks, blocks), minlength=blocks) @ sums
    return drawn


def weights(blocks: int, samples: int, seed: int) -> Array:
    """Weights of the blocks in recordings weighed at random, shape (samples, blocks), each row of sum 1."""
    return np.random.default_rng(seed).dirichlet(np.ones(blocks), samples)


def interval(drawn: Array) -> Array:
    """Lower and upper end of the 95 % interval of what was drawn, (S, ...): shape (2, ...)."""
    return np.percentile(drawn, INTERVAL, axis=0)
