"""Numbers such as -9999 that a recorder writes where a sensor has no value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError

MARKS = (99.0, 999.0, 9999.0, 99999.0, 999999.0, 32.767, 32.768, 32767.0, 32768.0, 65535.0, 2147483648.0)
"""Magnitudes in use as marks: nines, and the limits of integers, for DVLs in thousandths."""
SAME = 1e-6
"""Greatest relative difference between a mark and the number in a log, for rounding to 32 bits."""
LEAST = 2
"""Fewest samples with a mark: one alone may be a fault of transmission."""
FAR = 2.0
"""Least ratio of a mark to all other magnitudes: a measured motion is continuous, so that it has values in
between."""


def refuse_marks(where: str, sessions: Sequence[Mapping[str, Array]], names: Sequence[str]) -> None:
    """Refuse samples of a sensor that mark missing values.

    Args:
        where: Name of the sensor's block in the map, such as `velocity`.
        sessions: Columns of each session as logged, (n,), by name; NaN where the map excludes a sample.
        names: Columns of the sensor.

    Raises:
        DataError: At least LEAST samples of a column are a mark that is FAR from all others.
    """
    for name in names:
        values = [columns[name] for columns in sessions]
        peak = _extreme(values)
        if not any(abs(abs(peak) - mark) <= SAME * mark for mark in MARKS):
            continue
        own = np.abs(np.concatenate([each[np.isfinite(each)] for each in values]))
        marked = np.abs(own - abs(peak)) <= SAME * abs(peak)
        others = own[~marked]
        if marked.sum() >= LEAST and len(others) and others.max() * FAR < abs(peak):
            raise DataError(
                f"column {name} is {peak:.8g} in {marked.sum():,} of {len(own):,} samples, far beyond all "
                f"others: if this marks missing values, set {where}.valid = {{not = {peak:.8g}}}, or empty "
                "these cells"
            )


def _extreme(values: Sequence[Array]) -> float:
    """Return the number of greatest magnitude; 0 without a finite one."""
    finite = [np.where(np.isfinite(each), each, 0.0) for each in values if len(each)]
    edges = [float(edge) for each in finite for edge in (each.min(), each.max())]
    return max(edges, key=abs, default=0.0)
