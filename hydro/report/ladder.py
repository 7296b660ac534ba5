"""Ladder of a study as text and tables: the prediction error of each step, and the effects that it added."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl

from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects import CATALOGUE, describe
from hydro.core.evaluation.yardsticks import PREDICTORS, column
from hydro.core.explanation.ladder import HORIZON
from hydro.core.identification.outcome import UNDETERMINED
from hydro.report import words

TITLES = {
    "fit": "Errors of predictions {:g} s ahead on the data: {}",
    "holdout": "The same on held-out data, to which nothing was fitted",
}
"""Titles of the tables of errors, by data set."""
AS_GIVEN = "as given"
"""Name of step 0."""
PLAIN_ERRORS = 3.0
"""Minimum distance of a shown component of a list from 0, in standard errors."""


def title(ladder: pl.DataFrame, dataset: str) -> str:
    """Return the title of a study's table of errors, with its units.

    Args:
        ladder: Ladder table: prediction errors of each step of a study.
        dataset: `fit` or `holdout`.
    """
    moving = "all" in measured(ladder.filter(dataset=dataset))
    units = "u v w [m/s], p q r [rad/s], all [m/s]" if moving else "x y z [m], phi theta psi [rad], pose [m]"
    return TITLES[dataset].format(HORIZON, units)


def errors(ladder: pl.DataFrame, dataset: str, horizon: float = HORIZON) -> pl.DataFrame:
    """Return the errors of a study's steps, then of simple predictors and the noise floor, one row each.

    Args:
        ladder: Ladder table.
        dataset: `fit` or `holdout`.
        horizon: Horizon of the predictions [s].

    Returns:
        Column `step` with the number and the effects that it added; and a column of root mean square errors
        for each axis: u v w [m/s], p q r [rad/s], and `all` axes as one speed [m/s]. Without velocities they
        are x y z [m], phi theta psi [rad] and `pose` [m].
    """
    rows = ladder.filter(pl.col("horizon") == horizon, dataset=dataset)
    axes = measured(rows)
    rows = rows.filter(pl.col("axis").is_in(axes)).with_columns(
        name=pl.format("{} {}", "step", pl.col("effect").replace("", AS_GIVEN))
    )
    last = rows.filter(pl.col("step") == pl.col("step").max())
    simple = [
        last.with_columns(name=pl.lit(name), rmse=column(name))
        for name in PREDICTORS
        if column(name) in rows.columns and last[column(name)].count()
    ]
    noise = last.with_columns(name=pl.lit("noise floor"), rmse="noise_floor")
    wide = pl.concat([rows, *simple, noise]).pivot(
        on="axis", index="name", values="rmse", maintain_order=True
    )
    return wide.select(pl.col("name").alias("step"), *axes)


def measured(rows: pl.DataFrame) -> tuple[str, ...]:
    """Return the names of the axes to show: velocities and `all`, or pose if no velocity was measured.

    Args:
        rows: Rows of a ladder or comparison table.
    """
    there = set(rows["axis"].unique())
    if "all" in there:
        return tuple(axis for axis in (*VELOCITY, "all") if axis in there)
    return tuple(axis for axis in (*POSE, "pose") if axis in there)


def by_dataset(rows: pl.DataFrame) -> Iterator[tuple[str, str, pl.DataFrame]]:
    """Yield each data set of a ladder: its name (`fit` or `holdout`), its label, and its rows step by step.

    Args:
        rows: Rows of the ladder table of one axis and horizon.
    """
    for name, label in words.DATASETS.items():
        if not (one := rows.filter(dataset=name).sort("step")).is_empty():
            yield name, label, one


def values(table: Mapping[str, Any]) -> Iterator[str]:
    """Yield one line for each parameter of a fitted effect: values ± standard errors and their unit.

    Of a list, only components that differ significantly from 0 are shown, numbered from 1.  All others are
    near 0 if their standard errors are small, and else not determined.

    Args:
        table: `[[effect]]` table of the effect, with standard errors.
    """
    effect = CATALOGUE[table["name"]]
    texts = effect.written(table)
    for parameter in effect.parameters:
        found = table.get(parameter.name)
        if found is None or not np.size(found):
            continue
        value, error = np.asarray(found, float), np.asarray(table["standard_error"][parameter.name], float)
        terms = words.terms_of(parameter, texts)
        shown = [i for i in np.ndindex(*value.shape) if not i or terms or _plain(value, error, i)]
        name = _name_of(terms) if len(shown) < value.size or terms else lambda index: ""
        numbers = [name(index) + _sized(float(value[index]), float(error[index])) for index in shown]
        rest = _others(value, error, shown, parameter.scale)
        unit = describe.unit(parameter)
        yield f"{parameter.name}: {', '.join(numbers)}{rest}{'' if unit == '1' else f' [{unit}]'}"


def _others(value: Any, error: Any, shown: Sequence[tuple[int, ...]], scale: tuple[Any, ...]) -> str:
    """Return a remark on components of a parameter that are not shown: near 0, or not determined.

    Args:
        value: Array of values.
        error: Array of standard errors.
        shown: Indices of the components that are shown.
        scale: Typical sizes of the parameter.
    """
    others = [i for i in np.ndindex(*value.shape) if i not in shown]
    sizes = [abs(value[i]) for i in shown] + [one for one in scale if isinstance(one, int | float)]
    size = max(sizes, default=np.inf)
    loose = [i for i in others if error[i] > UNDETERMINED * size]
    parts = []
    if len(loose) < len(others):
        parts.append("all others near 0" if shown or loose else "all near 0")
    if loose:
        places = ", ".join(", ".join(str(k + 1) for k in i) for i in loose)
        parts.insert(0, f"not determined: no. {places}")
    return "".join(f", {part}" for part in parts) if shown else ", ".join(parts)


def _plain(value: Any, error: Any, index: tuple[int, ...]) -> bool:
    return bool(abs(value[index]) > PLAIN_ERRORS * error[index])


def _name_of(terms: Sequence[str]) -> Callable[[tuple[int, ...]], str]:
    """Return a function from the index of a component to its label: its term, or its number from 1."""
    return (lambda index: f"{terms[index[0]]} ") if terms else _numbered


def _numbered(index: tuple[int, ...]) -> str:
    return f"no. {', '.join(str(i + 1) for i in index)}: " if index else ""


def _sized(value: float, error: float) -> str:
    """Return a value and its standard error, both to the first figure of the error: `-0.3001 ± 0.0001`."""
    if error == 0.0:
        return f"{value:g} (known)"
    places = max(0, -int(np.floor(np.log10(max(error, 1e-12)))))
    return f"{value:.{places}f} ± {error:.{places}f}"
