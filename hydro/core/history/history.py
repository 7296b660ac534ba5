"""History of a vehicle: the estimates of all its dives, relative to the baseline, and their changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.history.change_points import variances
from hydro.core.history.changes import Change, changes, levels
from hydro.core.history.estimate import Estimate
from hydro.core.history.parameters import BUOYANCY, Parameter
from hydro.core.history.sentences import headline, sentence

LARGEST_ERROR = 0.15
"""Maximum median standard error over the dives of a reported thrust or drag, relative to the baseline [1].

With a larger error, no change of practical size would be visible.
"""
LARGEST_BUOYANCY_ERROR = 0.3
"""Maximum median standard error of a reported net buoyancy, in prior standard deviations.

It is 1.5 % of the buoyancy.
"""


@dataclass(frozen=True)
class History:
    """Estimates of a vehicle's parameters in all its dives, and the changes that they show.

    Thrust and drag are relative to their mean over the baseline dives; the net buoyancy is the difference
    from that mean.

    Attributes:
        dives: Names of the N dives with estimates, in order.
        baseline: Number of dives at the start that count as unchanged.
        parameters: The P parameters that the dives determine.
        undetermined: Parameters that the dives do not determine.
        values: Estimates relative to the baseline, (P, N).
        errors: Standard errors of the estimates, (P, N).
        found: Changes in the order of their dates.
    """

    dives: tuple[str, ...]
    baseline: int
    parameters: tuple[Parameter, ...]
    undetermined: tuple[Parameter, ...]
    values: Array
    errors: Array
    found: tuple[Change, ...]

    @property
    def sentences(self) -> list[str]:
        """One sentence for each change."""
        return [sentence(one, self.parameters[one.parameter], self.dives) for one in self.found]

    @property
    def headline(self) -> str:
        """All changes in sentences as one text, or a sentence that there are none."""
        return headline(self.sentences, len(self.dives), self.baseline)

    @property
    def levels(self) -> Array:
        """Level of each parameter in each dive: constant between changes, as fitted with them, (P, N)."""
        rows = range(len(self.parameters))
        found = [levels(self.values, self.errors, self.found, row) for row in rows]
        return np.array(found).reshape(self.values.shape)

    def table(self) -> pl.DataFrame:
        """Return a new table of the estimates with their fitted levels, whose columns are COLUMNS.

        There is one row per dive and parameter, sorted by dive.  Dives count from 1.
        """
        level, flags = self.levels, self.flags
        rows = [
            {
                "number": j + 1,
                "dive": dive,
                "parameter": one.name,
                "value": float(self.values[i, j]),
                "standard_error": float(self.errors[i, j]),
                "level": float(level[i, j]),
                "unit": one.unit,
                "flag": flags[i][j],
            }
            for j, dive in enumerate(self.dives)
            for i, one in enumerate(self.parameters)
        ]
        return pl.DataFrame(rows, schema=COLUMNS)

    def changes_table(self) -> pl.DataFrame:
        """Return a new table of the changes with the columns CHANGE_COLUMNS, one row per change."""
        rows = [
            {
                "parameter": self.parameters[one.parameter].name,
                "kind": one.kind,
                "first_dive": self.dives[one.date],
                "found_in": self.dives[one.found],
                "before": one.before,
                "after": one.after,
                "standard_error": one.error,
                "unit": self.parameters[one.parameter].unit,
                "sentence": told,
            }
            for one, told in zip(self.found, self.sentences, strict=True)
        ]
        return pl.DataFrame(rows, schema=CHANGE_COLUMNS)

    @property
    def flags(self) -> list[list[str]]:
        """Flag of each estimate: for each parameter a list with one word per dive.

        `baseline` and `unchanged` precede all changes of the parameter; `changed` follows one; `found` marks
        the dive whose estimate caused the alarm.
        """
        count = len(self.dives)
        flags = [
            ["baseline" if j < self.baseline else "unchanged" for j in range(count)] for _ in self.parameters
        ]
        for one in self.found:
            for j in range(one.date + (one.kind == "trend"), count):
                flags[one.parameter][j] = "changed"
        for one in self.found:
            flags[one.parameter][one.found] = "found"
        return flags


COLUMNS = {
    "number": pl.Int64,
    "dive": pl.String,
    "parameter": pl.String,
    "value": pl.Float64,
    "standard_error": pl.Float64,
    "level": pl.Float64,
    "unit": pl.String,
    "flag": pl.String,
}
"""Columns of the history table, `History.table`."""
CHANGE_COLUMNS = {
    "parameter": pl.String,
    "kind": pl.String,
    "first_dive": pl.String,
    "found_in": pl.String,
    "before": pl.Float64,
    "after": pl.Float64,
    "standard_error": pl.Float64,
    "unit": pl.String,
    "sentence": pl.String,
}
"""Columns of the table of changes, `History.changes_table`."""


def history(
    parameters: Sequence[Parameter], estimates: Mapping[str, Estimate], baseline: Sequence[str]
) -> History:
    """Return the history of a vehicle with the dates of its changes, from estimates of each dive.

    Parameters that the dives do not determine are left out of values and changes.

    Args:
        parameters: Parameters of the estimates.
        estimates: Estimates of each dive by name, in order; the baseline dives first.
        baseline: Names of the baseline dives, which the vehicle made unchanged.
    """
    values = np.array([one.values for one in estimates.values()]).T
    errors = np.array([one.errors for one in estimates.values()]).T
    names = tuple(estimates)
    first = sum(name in baseline for name in names)
    kept, dropped = list[int](), list[Parameter]()
    for i, one in enumerate(parameters):
        if one.reported and np.median(errors[i]) <= _largest_error(one):
            kept.append(i)
        elif one.reported:
            dropped.append(one)
    chosen = tuple(parameters[i] for i in kept)
    value, error = _relative(chosen, values[kept], errors[kept], first)
    found = changes(value, error, first) if kept else []
    return History(names, first, chosen, tuple(dropped), value, error, tuple(found))


def _largest_error(parameter: Parameter) -> float:
    """Return the largest median standard error with which a parameter counts as determined."""
    return LARGEST_BUOYANCY_ERROR * parameter.spread if parameter.kind == BUOYANCY else LARGEST_ERROR


def _relative(
    parameters: Sequence[Parameter], values: Array, errors: Array, baseline: int
) -> tuple[Array, Array]:
    """Return estimates and errors relative to the baseline mean: quotients, or differences for buoyancy."""
    if not len(values) or not baseline:
        return values, errors
    weight = 1.0 / variances(errors, np.ones(errors.shape, bool))[:, :baseline]
    mean = (weight * values[:, :baseline]).sum(axis=1) / weight.sum(axis=1)
    share = np.array([one.kind != BUOYANCY for one in parameters])
    unit = np.where(share, mean, 1.0)
    shifted = np.where(share, 0.0, mean)
    return (values - shifted[:, None]) / unit[:, None], errors / np.abs(unit)[:, None]
