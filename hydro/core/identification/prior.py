"""Prior from the values of a vehicle file, for components that a recording determines poorly.

Without a prior, a fit moves undetermined components arbitrarily.  A slow survey may leave the quadratic
damping of roll anywhere, and a vehicle with a correct value would become worse.  A value of a file is assumed
to be known within its own size, or within that of the fitted value if that is larger.  So values that are
wrong by a factor of ten are still corrected.  A standard error of the file is used instead.  A
recording with more information than the prior is not affected.
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
"""Prior standard deviation of a file's value, relative to itself or to its natural scale if that is larger.
"""
EXACTLY = 1e-6
"""Prior standard deviation of a value held as known, relative to its size."""
ABSURD = 4.0
"""Discrepancy of two estimates, in standard deviations, above which a warning is given."""


@dataclass(frozen=True)
class Change:
    """Change of a file's value by a fit.

    Attributes:
        entry: The component.
        given: Its value in the file.
        value: The fitted value.
        deviations: Their distance, in prior standard deviations of the file's value.
    """

    entry: Entry
    given: float
    value: float
    deviations: float


def deviations(file: Vehicle, entries: Sequence[Entry]) -> Array:
    """Return prior standard deviations of components of a file, (P,), in their units.

    They are the file's `standard_error`, EXACTLY for components held as known, and KNOWN otherwise.
    """
    said = stated(file, entries)
    return np.where(np.isfinite(said), said, KNOWN * _sizes(file, entries))


def stated(file: Vehicle, entries: Sequence[Entry]) -> Array:
    """Return the standard deviations of components in a vehicle file, (P,); infinite if the file has none."""
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
    """Combine an estimate with the values and standard errors of a file (a Kalman update).

    Args:
        values: Estimates from a recording, (P,).
        spread: Their covariance, (P, P).
        file: The vehicle with independent values and their standard errors.
        entries: The components.

    Returns:
        Combined values and covariance, and a sentence for each component with contradictory estimates.
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
    """Return the size of each component: the larger of its absolute value in the file and its scale, (P,)."""
    return np.maximum(np.abs(in_file(file, entries)), [entry.scale for entry in entries])


def greatest_change(file: Vehicle, entries: Sequence[Entry], values: Array) -> Change:
    """Return the component whose fitted value (P,) deviates most from its prior."""
    given = in_file(file, entries)
    away = np.abs(values - given) / deviations(file, entries)
    most = int(away.argmax())
    return Change(entries[most], float(given[most]), float(values[most]), float(away[most]))


def shrunk_to_prior(unknown: Free, values: Array, normal: Normal, file: Vehicle) -> Array:
    """Shrink fitted values toward those of the file, each by its prior (a Kalman update).

    Args:
        unknown: The free components.
        values: Their fitted values, (P,).
        normal: The problem linearised at them, in units of the components' scales.
        file: The vehicle of the file; components of new effects change only by their correlation with the
            others.

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
    """Return values of components in the tables of a file, (P,); missing components are 0."""
    tables = (next(iter(file.effects(entry.effect)), {}) for entry in entries)
    return np.array(
        [_number(table.get(e.parameter, 0.0), e) for table, e in zip(tables, entries, strict=True)]
    )


def _number(value: object, entry: Entry) -> float:
    """Return the number of a component in a parameter of a table; 0 beyond its end."""
    values = np.asarray(value, float)
    if values.ndim and any(i >= size for i, size in zip(entry.index, values.shape, strict=True)):
        return 0.0
    return float(values[entry.index] if values.ndim else values)
