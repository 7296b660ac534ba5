"""Regimes of motion: rows by speed, by drift angle, and by distance from the training data.

A single figure over all rows hides where a network fails.  It fails where training data are few: at high
speed, in sideways motion, and beyond the training data.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from hydro.core.columns import Array, Mask
from hydro.core.errors import UsageError
from hydro.io.model import Model

SPEEDS = (0.0, 0.25, 0.5, 1.0, 1.5, np.inf)  # edges of the regimes [m/s]
DRIFTS = (0.0, 15.0, 45.0, 90.0, 135.0, 180.0)  # edges of the regimes [degrees]
REACHES = (0.0, 1.0, 2.0, 3.0, np.inf)  # edges in standard deviations of the training data
SLOWEST = 0.05  # speed below which a drift angle is meaningless [m/s]
FEWEST = 20  # least number of rows of a reported regime

BY = ("speed", "drift", "reach")  # divisions of rows into regimes


def require_ways(ways: Sequence[str]) -> None:
    """Check that every name in `ways` is a way to divide rows: `speed`, `drift` or `reach`.

    Raises:
        UsageError: A name is not in `BY`.
    """
    for way in ways:
        if way not in BY:
            raise UsageError(f"rows are divided by {', '.join(BY)}, not by '{way}'")


def regimes(model: Model, nu: Array, by: str) -> Iterator[tuple[str, Mask]]:
    """Yield the regimes of motion with enough rows, each as a pair of its name and a mask of its rows.

    Args:
        model: model whose scalers hold mean and spread of its training data.
        nu: velocities (N, 6) [m/s, rad/s].
        by: `speed` |v|; `drift`, the angle between v and the bow, 0 ahead, 180 degrees astern; or `reach`,
            the greatest deviation of the six velocities from their training means, in standard deviations.
            Above 3 the network extrapolates.

    Yields:
        A name such as `speed 0.25-0.5 m/s`, and a mask (N,).
    """
    edges: tuple[float, ...]
    speed = np.linalg.norm(nu[:, :3], axis=1)
    if by == "speed":
        size, edges, unit = speed, SPEEDS, " m/s"
    elif by == "drift":
        beside = np.hypot(nu[:, 1], nu[:, 2])
        size, edges, unit = np.degrees(np.arctan2(beside, nu[:, 0])), DRIFTS, " deg"
        size = np.where(speed < SLOWEST, -1.0, size)
    else:
        mean, scale = (np.asarray(model.scalers[f"input_{what}"])[:6] for what in ("mean", "scale"))
        size, edges, unit = np.abs((nu - mean) / scale).max(axis=1), REACHES, " sigma"
    for low, high in pairwise(edges):
        last = high == edges[-1]
        chosen = (size >= low) & ((size <= high) if last else (size < high))
        if chosen.sum() >= FEWEST:
            shown = f"{low:g}-{high:g}" if np.isfinite(high) else f"above {low:g}"
            yield f"{by} {shown}{unit}", chosen
