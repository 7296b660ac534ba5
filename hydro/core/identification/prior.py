"""What a vehicle file says, where the recording says less.

A fit lets go of what a recording does not show: a slow survey may leave the quadratic damping of roll
anywhere, and a file that had it right would fly worse with the fitted values.  A file's number is taken to
be known to within its own size, or that of the fitted one where that is greater, so that numbers ten times
wrong are still mended, or to within the standard error that the file states.  Where the recording tells more
than that, nothing changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE
from hydro.core.identification.levenberg_marquardt import PRIOR
from hydro.core.prediction.normal_equations import Normal, covariance
from hydro.core.prediction.parameters import Entry, Free
from hydro.core.vehicle.description import Vehicle

KNOWN = 0.2
"""Part of itself, or of its natural scale where that is larger, to which a file's number is known,"""
EXACTLY = 1e-6
"""and what is held as known."""
ABSURD = 4.0
"""Standard deviations of what is known of a value beyond which another is not believed."""


@dataclass(frozen=True)
class Change:
    """How a fit changes the value of a file's entry.

    Attributes:
        entry: The entry.
        given: Its value in the file.
        value: As fitted.
        deviations: Their distance, in standard deviations of what is known of the file's.
    """

    entry: Entry
    given: float
    value: float
    deviations: float


def deviations(file: Vehicle, entries: Sequence[Entry]) -> Array:
    """Standard deviation of what is known of entries in the tables of a file, (P,), in their units.

    The `standard_error` beside a value is it, and next to nothing of what is held as known; where neither is
    said, KNOWN.
    """
    said = stated(file, entries)
    return np.where(np.isfinite(said), said, KNOWN * _sizes(file, entries))


def stated(file: Vehicle, entries: Sequence[Entry]) -> Array:
    """Standard deviations that a file itself states of entries, (P,); infinite where it says nothing."""
    found, sizes = np.full(len(entries), np.inf), _sizes(file, entries)
    for i, entry in enumerate(entries):
        table = next(iter(file.effects(entry.effect)), {})
        error = table.get("standard_error", {}).get(entry.parameter, 0.0)
        value = _number(error, entry)
        if table and entry.parameter in CATALOGUE[entry.effect].known(table):
            found[i] = EXACTLY * sizes[i]
        elif value > 0.0:
            found[i] = value
    return found


def combined(
    values: Array, spread: Array, file: Vehicle, entries: Sequence[Entry]
) -> tuple[Array, Array, list[str]]:
    """An estimate and what a file states of some of its entries, together (a Kalman update).

    Args:
        values: Estimates from a recording, (P,).
        spread: Their covariance, (P, P).
        file: The vehicle with its own values and their standard errors, from elsewhere.
        entries: The entries.

    Returns:
        Values and covariance of both together, and a sentence for each entry in which recording and file
        contradict each other.
    """
    said, given = stated(file, entries), in_file(file, entries)
    own = np.flatnonzero(np.isfinite(said))
    away = values[own] - given[own]
    both = spread[np.ix_(own, own)] + np.diag(said[own] ** 2)
    gain = np.linalg.solve(both, spread[own]).T
    apart = np.abs(away) / np.sqrt(np.diag(both))
    told = [
        f"{entries[int(i)].name}: the recording says {values[i]:.3g} ± {spread[i, i] ** 0.5:.2g}, the file "
        f"{given[i]:.3g} ± {said[i]:.2g}: {far:.2g} standard deviations apart; one of them is wrong"
        for i, far in zip(own, apart, strict=True)
        if far > ABSURD
    ]
    return values - gain @ away, spread - gain @ spread[own], told


def _sizes(file: Vehicle, entries: Sequence[Entry]) -> Array:
    """Size of each entry: that of its value in the file, or its scale where that is larger, (P,)."""
    return np.maximum(np.abs(in_file(file, entries)), [entry.scale for entry in entries])


def greatest_change(file: Vehicle, entries: Sequence[Entry], values: Array) -> Change:
    """The entry (of one at least) that fitted values (P,) take farthest from what is known of it."""
    given = in_file(file, entries)
    away = np.abs(values - given) / deviations(file, entries)
    most = int(away.argmax())
    return Change(entries[most], float(given[most]), float(values[most]), float(away[most]))


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
    loosely = np.maximum(np.maximum(np.abs(given), np.abs(values[own])), 1e-9 * scales[own])
    size = np.minimum(loosely, stated(file, [unknown.entries[i] for i in own]))
    away = values[own] - given
    pull = spread[:, own] @ np.linalg.solve(spread[np.ix_(own, own)] + np.diag(size**2), away)
    return unknown.within(values - pull)


def in_file(file: Vehicle, entries: Sequence[Entry]) -> Array:
    """Values of entries in the tables of a file, (P,); what a table leaves out, or is too short for, is 0."""
    tables = (next(iter(file.effects(entry.effect)), {}) for entry in entries)
    return np.array(
        [_number(table.get(e.parameter, 0.0), e) for table, e in zip(tables, entries, strict=True)]
    )


def _number(value: object, entry: Entry) -> float:
    """The number of an entry in a parameter of a table; 0 where that ends before it."""
    values = np.asarray(value, float)
    if values.ndim and any(i >= size for i, size in zip(entry.index, values.shape, strict=True)):
        return 0.0
    return float(values[entry.index] if values.ndim else values)
