"""Prior from the values of a vehicle file, for components that a recording determines poorly.

Without a prior, a fit moves undetermined components arbitrarily.  A slow survey may leave the quadratic
damping of roll anywhere, and a vehicle with a correct value would become worse.  A value of a file is assumed
to be known within its own size, or within that of the fitted value if that is larger.  So values that are
wrong by a factor of ten are still corrected.  If the file gives a standard error, it replaces this
assumption.  The result hardly depends on the prior where the recording has more information.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE
from hydro.core.identification.levenberg_marquardt import PRIOR, Prior
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
    """Change of one component from the value in a vehicle file to the fitted value.

    Attributes:
        entry: The component.
        given: Value in the file.
        value: Fitted value.
        deviations: Difference of the two values, in standard deviations of the prior of the file's value.
    """

    entry: Entry
    given: float
    value: float
    deviations: float


def deviations(file: Vehicle, entries: Sequence[Entry]) -> Array:
    """Return the prior standard deviation of each component of a vehicle file, in its unit, (P,).

    A component has the file's `standard_error`, if given; EXACTLY, a tiny value, if marked as known; and
    otherwise KNOWN times its value.

    Args:
        file: Vehicle file.
        entries: The P components.
    """
    said = stated(file, entries)
    return np.where(np.isfinite(said), said, KNOWN * _sizes(file, entries))


def stated(file: Vehicle, entries: Sequence[Entry]) -> Array:
    """Return the standard errors that a vehicle file gives for components, in their units, (P,).

    They are tiny for components marked as known, and infinite where the file gives none.

    Args:
        file: Vehicle file.
        entries: The P components.
    """
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


def about_file(file: Vehicle, effects: Collection[str], unknown: Free) -> Prior:
    """Return the tempered prior of a fit: a file's effects near its values, all others near their start.

    Args:
        file: Vehicle file.
        effects: Names of the effects that have their values in the file, as far as the file has them.
        unknown: The P free components.
    """
    scales, begun = unknown.scales, unknown.starts[0]
    own = np.array([e.effect in effects and bool(file.effects(e.effect)) for e in unknown.entries], bool)
    centre = np.where(own, unknown.within(in_file(file, unknown.entries)), begun) / scales
    spread = np.where(own, deviations(file, unknown.entries) / scales, PRIOR)
    return Prior(centre, spread**-2.0, tempered=True)


def combined(
    values: Array, spread: Array, file: Vehicle, entries: Sequence[Entry]
) -> tuple[Array, Array, list[str]]:
    """Return estimates from a recording combined with a file's values and standard errors (a Kalman update).

    Args:
        values: Estimates from a recording, (P,).
        spread: Covariance of the estimates, (P, P).
        file: Vehicle whose file gives independent values with standard errors.
        entries: The P components.

    Returns:
        Combined values, (P,); their covariance, (P, P); and a sentence for each component on which recording
        and file contradict each other.
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


def change_of(effect: str, file: Vehicle, unknown: Free, values: Array) -> Change:
    """Return the component of one effect whose fitted value deviates most from the file's.

    Args:
        effect: Name of the effect.
        file: Vehicle file.
        unknown: The P components of the fit.
        values: Fitted values, (P,).
    """
    own = unknown.places(effect)
    return greatest_change(file, [unknown.entries[i] for i in own], values[own])


def greatest_change(file: Vehicle, entries: Sequence[Entry], values: Array) -> Change:
    """Return the change of the component whose fitted value differs most from the file's.

    The difference is measured in prior standard deviations.

    Args:
        file: Vehicle file.
        entries: The P components.
        values: Fitted values, (P,).
    """
    given = in_file(file, entries)
    away = np.abs(values - given) / deviations(file, entries)
    most = int(away.argmax())
    return Change(entries[most], float(given[most]), float(values[most]), float(away[most]))


def shrunk_to_prior(unknown: Free, values: Array, normal: Normal, file: Vehicle) -> Array:
    """Return fitted values shrunk toward those of the vehicle file, by the prior of each (a Kalman update).

    Args:
        unknown: The P free components.
        values: Fitted values, (P,).
        normal: The problem linearised at the fitted values, in units of the components' scales.
        file: Vehicle file.  Components of new effects change only through their correlation with others.

    Returns:
        Values within the bounds, (P,).
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
    """Return the values of components in the tables of a vehicle file, (P,); missing components are 0.

    Args:
        file: Vehicle file.
        entries: The P components.
    """
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
