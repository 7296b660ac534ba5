"""How sure is a name?  Which effects explain a recording as well as the best, and how much does one explain.

Whole blocks of shots are weighed at random (Bayesian bootstrap, Rubin 1981): how often would each rival win,
and within what limits does the share lie.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hydro.core.columns import Array
from hydro.core.diagnosis.search import Model
from hydro.core.evaluation.block_resampling import block_sums, interval, weights
from hydro.core.identification.normal_equations import block_length

RESAMPLES = 2000
TIED = 0.02
"""Part of the resamples that a rival must win to be told beside the best."""


def wins(rivals: Mapping[str, Model], best: str, seed: int = 0) -> dict[str, float]:
    """Part of the resamples in which each rival explains most for its parameters.

    Args:
        rivals: A model for each effect.
        best: The effect whose residuals say how long a block is.
        seed: Of the weights.

    Returns:
        The best and all that are tied with it, the most frequent winner first.
    """
    size = max(block_length(rivals[best].normal.score), 2)
    blocks = block_sums(np.stack([model.penalised for model in rivals.values()], axis=1), size)
    winner = np.argmin(weights(len(blocks), RESAMPLES, seed) @ blocks, axis=1)
    part = dict(zip(rivals, np.bincount(winner, minlength=len(rivals)) / RESAMPLES, strict=True))
    tied = [name for name in rivals if part[name] >= TIED or name == best]
    return {name: float(part[name]) for name in sorted(tied, key=lambda name: -part[name])}


def share(gain: Array, excess: Array, pieces: int, seed: int = 1) -> tuple[float, float, float]:
    """What part of an error is explained, with its 95 % interval.

    Args:
        gain: Squared residual explained in each shot, (S,).
        excess: Squared residual beyond the noise in each shot, (S,).
        pieces: Shots that make one block.
        seed: Of the weights.
    """
    blocks = block_sums(np.column_stack([gain, excess]), max(pieces, 1))
    drawn = weights(len(blocks), RESAMPLES, seed) @ blocks
    ratio = np.clip(drawn[:, 0] / np.maximum(drawn[:, 1], 1e-9), 0.0, 1.0)
    middle = float(np.clip(gain.sum() / max(excess.sum(), 1e-9), 0.0, 1.0))
    low, high = interval(ratio)
    return middle, float(min(low, middle)), float(max(high, middle))
