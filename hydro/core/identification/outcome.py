"""Result of a fit: values with covariance, a passive vehicle, and warnings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE
from hydro.core.effects.catalogue import implausible
from hydro.core.identification.levenberg_marquardt import PRIOR
from hydro.core.identification.passivity import accepted, possible
from hydro.core.identification.prior import KNOWN, combined, in_file, stated
from hydro.core.prediction.normal_equations import Normal, covariance
from hydro.core.prediction.parameters import Free, effect_table
from hydro.core.simulation.estimates import Estimate, Estimates
from hydro.core.vehicle.description import Vehicle

UNDETERMINED = 0.5  # standard error in scales above which a value is undetermined, unless it is significant
PLAIN_ERRORS = 3.0
CONTRADICTED = 0.95
"""Chi-square probability above which undetermined components may not return to their initial values."""
ALIKE = 0.995  # correlation above which the data cannot separate two estimates
IMPASSIVE = (
    "the best-fit damping or added mass would add energy to the vehicle; the values given are the best "
    "ones of a passive hull"
)
OF_FORCE = ("wrench", "inertia", "actuator")
"""Kinds of effects whose values follow from accelerations."""


@dataclass(frozen=True)
class Fit:
    """Result of a fit of P components of a vehicle file.

    Attributes:
        vehicle: The vehicle with the fitted values.
        free: The components that were fitted.
        values: Fitted values in the units of the components, (P,).
        standard_errors: Standard errors of the values, (P,).
        covariance: Covariance of the values, (P, P).
        determined: Mask of the components that the data determine, (P,).
        chi2: Reduced chi-square: mean squared residual in units of the noise variance; about 1 for a true
            model.
        method: `output` or `equation`.
        warnings: Warnings to the user, one line each.
        share: Share of the recording that was used.
        changes: Corrections of the log, one sentence each; part of `warnings`.
    """

    vehicle: Vehicle
    free: Free
    values: Array
    standard_errors: Array
    covariance: Array
    determined: NDArray[np.bool_]
    chi2: float
    method: str
    warnings: tuple[str, ...]
    share: float = 1.0
    changes: tuple[str, ...] = ()

    def with_covariance(self, spread: Array) -> Fit:
        """Return a copy with another covariance of the values, (P, P), and its standard errors."""
        return replace(self, covariance=spread, standard_errors=np.sqrt(np.diag(spread)))

    def tables(self) -> tuple[dict[str, Any], ...]:
        """Return the fitted effects, one dict each, as their `[[effect]]` tables in a vehicle file.

        Each has the `name`, the values by parameter, and `standard_error`, a dict by parameter.  Values are
        rounded to a hundredth of their standard errors.  Damping at the limit of passivity keeps as many more
        digits as it needs to stay passive.  A parameter that another one replaces, such as `diagonal` by
        `matrix`, is None.
        """
        places = 2 - np.floor(np.log10(np.maximum(self.standard_errors, 1e-300))).astype(int)
        values = self._rounded(places)
        while not accepted(self.free, values) and not np.array_equal(values, self.values):
            places += 1
            values = self._rounded(places)
        errors = np.array([float(f"{error:.3g}") for error in self.standard_errors])
        tables = []
        for name in self.free.effects:
            table = effect_table(self.free, name, self.free.within(values))
            replaced = {other: None for other in CATALOGUE[name].one_of if other not in table}
            spread = _errors_of(self.free, name, errors)
            text = CATALOGUE[name].written(next(iter(self.free.vehicle.effects(name))))
            tables.append({"name": name} | text | replaced | table | {"standard_error": spread})
        return tuple(tables)

    def table(self, effect: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return values and standard errors of one fitted effect, as two dictionaries by parameter.

        Values are rounded as in `tables`.  A parameter that another parameter replaces is left out.

        Args:
            effect: Name of the effect.

        Raises:
            KeyError: The effect was not fitted.
        """
        for table in self.tables():
            if table["name"] == effect:
                apart = ("name", "standard_error")
                values = {k: v for k, v in table.items() if k not in apart and v is not None}
                return values, dict(table["standard_error"])
        raise KeyError(effect)

    def estimates(self) -> Estimates:
        """Return an object with the fitted values, rounded as in `tables`, and their covariance."""
        written = {table["name"]: table for table in self.tables()}
        entries = tuple(
            Estimate(
                entry.effect,
                entry.parameter,
                entry.index,
                entry.unit,
                float(np.asarray(written[entry.effect][entry.parameter], float)[entry.index]),
            )
            for entry in self.free.entries
        )
        return Estimates(entries, self.covariance)

    def _rounded(self, places: NDArray[np.int64]) -> Array:
        pairs = zip(self.values.tolist(), places.tolist(), strict=True)
        return np.array([round(value, digits) for value, digits in pairs])

    def frame(self) -> pl.DataFrame:
        """Return a new table with a row for each fitted component.

        Its columns are `parameter` (the component's name), `value`, `standard_error`, `unit` and
        `determined`, whether the data determine the value.
        """
        entries = self.free.entries
        return pl.DataFrame(
            {
                "parameter": [entry.name for entry in entries],
                "value": self.values,
                "standard_error": self.standard_errors,
                "unit": [entry.unit for entry in entries],
                "determined": self.determined,
            }
        )


def _errors_of(free_: Free, name: str, errors: Array) -> dict[str, Any]:
    """Return the standard errors of one effect in the shape of its table; 0 for held components."""
    found = effect_table(free_, name, errors)
    fitted = effect_table(free_, name, np.full(len(errors), np.nan))
    return {key: np.where(np.isnan(fitted[key]), found[key], 0.0).tolist() for key in found}


def information(normal: Normal) -> Array:
    """Return the information matrix of a linearised problem: X^T X of all pieces plus the prior's, (P, P).

    X are the residuals' derivatives by the P components, in units of the noise and of the components' scales.
    """
    information = normal.matrix.sum(axis=0)
    total: Array = information + PRIOR**-2 * np.eye(len(information))
    return total


def with_response_error(fit: Fit, file: Vehicle) -> Fit:
    """Return a fit whose standard errors include the error of the file's response to forces.

    A fit infers a force from the motion that it causes, by the inertia of the file.  Where no model reaches
    the noise, the added mass is known to KNOWN.  It is about half of the inertia; the other half is the mass
    of the body.  So a change of a force or mass from its value in the file is known to KNOWN / 2.  Places,
    times, sensor errors and the motion of the water do not follow from inertia.

    The added error is relative to the change.  So a test whether there is a change leaves it out.
    """
    entries = fit.free.entries
    of_force = [CATALOGUE[one.effect].kind in OF_FORCE and one.unit not in ("m", "s") for one in entries]
    error = np.where(of_force, 0.5 * KNOWN * (fit.values - in_file(file, entries)), 0.0)
    return fit.with_covariance(fit.covariance + np.diag(error**2))


def with_uncertainty(
    unknown: Free,
    values: Array,
    normal: Normal,
    chi2: float,
    method: str,
    file: Vehicle | None = None,
    least: Array | None = None,
) -> Fit:
    """Return the result of a fit: covariance, warnings, and values that are physically possible.

    Args:
        unknown: The P free components.
        values: Best values, (P,).
        normal: The problem linearised at the values.
        chi2: Reduced chi-square, the mean squared residual in units of the noise variance.
        method: `output` or `equation`.
        file: Vehicle whose file gives standard errors; its values count as an independent estimate.
        least: Lower limits of the standard errors, (P,); correlations stay.
    """
    warnings: list[str] = []
    within = possible(unknown, values, information(normal))
    if not np.array_equal(within, values):
        warnings.append(IMPASSIVE)
        values = within
    scales = unknown.scales
    spread = covariance(normal, np.full(len(values), PRIOR**-2)) * np.outer(scales, scales)
    if least is not None:
        wider = np.maximum(least / np.sqrt(np.diag(spread)), 1.0)
        spread = spread * np.outer(wider, wider)
    if file is not None and np.isfinite(stated(file, unknown.entries)).any():
        values, spread, told = combined(values, spread, file, unknown.entries)
        known = np.asarray(np.linalg.inv(spread / np.outer(scales, scales)), np.float64)
        values = possible(unknown, unknown.within(values), known)
        warnings += told
    errors = np.sqrt(np.diag(spread))
    plain = (np.abs(values) > PLAIN_ERRORS * errors) & (errors < 0.3 * PRIOR * scales)
    determined = (errors <= UNDETERMINED * scales) | plain
    if file is not None:
        values = _at_start(unknown, values, spread, determined)
    if lost := int(normal.lost.sum()):
        warnings.append(
            f"{lost} of {len(normal.lost)} predictions diverge with these values and are left "
            "out; check the vehicle's damping"
        )
    warnings += _advice(unknown, determined)
    warnings += _confusions(unknown, spread, errors, determined)
    low, high = unknown.bounds
    at_bound = [
        e.name for e, stuck in zip(unknown.entries, (values <= low) | (values >= high), strict=True) if stuck
    ]
    if at_bound:
        warnings.append(f"on a bound of the admissible range: {', '.join(at_bound)}")
    fitted = unknown.at(values)
    warnings += implausible(fitted, [entry.effect for entry in unknown.entries])
    return Fit(
        vehicle=fitted,
        free=unknown,
        values=values,
        standard_errors=errors,
        covariance=spread,
        determined=determined,
        chi2=chi2,
        method=method,
        warnings=tuple(warnings),
    )


def _at_start(unknown: Free, values: Array, spread: Array, determined: NDArray[np.bool_]) -> Array:
    """Return the values with undetermined components at their initial values, as in the file.

    The other components move to their conditional mean.  The values stay unchanged where the data contradict
    the initial values, for example where they determine the sum of two components alone.
    """
    left, start = np.flatnonzero(~determined), unknown.starts[0]
    change = start[left] - values[left]
    if not left.size or not change.any():
        return values
    share = np.linalg.solve(spread[np.ix_(left, left)], change)
    if change @ share > scipy.special.chdtri(len(left), 1.0 - CONTRADICTED):
        return values
    moved = values + spread[:, left] @ share
    moved[left] = start[left]
    inside = np.array_equal(moved, unknown.within(moved))
    return moved if inside and np.array_equal(possible(unknown, moved, np.eye(len(moved))), moved) else values


def _advice(unknown: Free, determined: NDArray[np.bool_]) -> list[str]:
    """Return one line for each effect with undetermined components."""
    lines = []
    for name in unknown.effects:
        pairs = zip(unknown.entries, determined, strict=True)
        left = [entry.name for entry, known in pairs if entry.effect == name and not known]
        if left:
            need = CATALOGUE[name].excitation
            lines.append(f"not determined by these data: {', '.join(left)}; it would need {need}")
    return lines


def _confusions(unknown: Free, spread: Array, errors: Array, determined: NDArray[np.bool_]) -> list[str]:
    """Return a warning for each pair of components that the data can hardly separate."""
    correlation = spread / np.outer(errors, errors)
    return [
        f"{unknown.entries[i].name} and {unknown.entries[j].name} can hardly be separated by these data "
        f"(correlation {correlation[i, j]:+.3f})"
        for i in range(len(errors))
        for j in range(i)
        if abs(correlation[i, j]) > ALIKE and determined[i] and determined[j]
    ]
