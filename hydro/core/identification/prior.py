"""What a vehicle file says, where the recording says less.

A fit lets go of what a recording does not show: a slow survey may leave the quadratic damping of roll
anywhere, and a file that had it right would fly worse with the fitted values.  A file's number is taken to
be known to within its own size, or that of the fitted one where that is greater, so that numbers ten times
wrong are still mended.  Where the recording tells more than that, nothing changes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro.core.columns import Array
from hydro.core.identification.levenberg_marquardt import PRIOR
from hydro.core.identification.normal_equations import Normal, covariance
from hydro.core.identification.parameters import Entry, Free
from hydro.core.vehicle.description import Vehicle


def shrunk_to_prior(unknown: Free, values: Array, normal: Normal, file: Vehicle) -> Array:
    """Fitted values and those of the file, each by what is known of it (a Kalman update with the file).

    Args:
        unknown: The free entries.
        values: Their fitted values, (P,).
        normal: The problem about them, in units of the entries' scales.
        file: The vehicle as its file gives it; entries of effects that it has not stay as they are fitted,
            but for what follows from their correlation with the others.

    Returns:
        (P,), within the bounds.
    """
    own = [i for i, entry in enumerate(unknown.entries) if file.effects(entry.effect)]
    if not own:
        return values
    scales = unknown.scales
    spread = covariance(normal, np.full(len(values), PRIOR**-2)) * np.outer(scales, scales)
    given = in_file(file, [unknown.entries[i] for i in own])
    size = np.maximum(np.maximum(np.abs(given), np.abs(values[own])), 1e-9 * scales[own])
    away = values[own] - given
    pull = spread[:, own] @ np.linalg.solve(spread[np.ix_(own, own)] + np.diag(size**2), away)
    return unknown.within(values - pull)


def in_file(file: Vehicle, entries: Sequence[Entry]) -> Array:
    """Values of entries in the tables of a file, (P,); what a table leaves out is 0."""
    found = []
    for entry in entries:
        table = next(iter(file.effects(entry.effect)), {})
        value = np.asarray(table.get(entry.parameter, 0.0), float)
        found.append(float(value[entry.index] if value.ndim else value))
    return np.array(found)
