"""Errors of a model per axis, with block-bootstrap intervals, and the single figures of Deep Hydro-Sim.

Table II of that paper (Wu et al.) combines newtons and newton metres: its RMSE and MAE are over all rows and
all six axes.  Here these have the axis `all`, and the mean of R^2 over the axes has the axis `mean`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from hydro.core.columns import UNITS, WRENCH, Array
from hydro.core.errors import DataError
from hydro.core.evaluation.block_resampling import interval, redrawn


class Sums(NamedTuple):
    """Sums over rows, from which all error measures follow, on six axes.

    Arrays have the shape (..., 6), except `rows` (..., 1); leading dimensions are blocks or resamples.

    Attributes:
        rows: Number of rows.
        squares: Sum of squared errors.
        sizes: Sum of absolute errors.
        values: Sum of the measured values.
        values_squared: Sum of the squared measured values.
    """

    rows: Array
    squares: Array
    sizes: Array
    values: Array
    values_squared: Array


class Subject(NamedTuple):
    """Subject of errors: the columns that are the same in all rows of its part of a metrics table.

    Attributes:
        model: Name of the model.
        dataset: Name of the recording.
        variant: Name of a regime of motion or of a way of computing; empty for none.
    """

    model: str
    dataset: str
    variant: str = ""


def measure(
    truth: ArrayLike,
    predicted: ArrayLike,
    blocks: NDArray[Any] | pl.Series,
    subject: Subject,
    *,
    axes: Sequence[str] = WRENCH,
    seed: int = 0,
) -> pl.DataFrame:
    """Return root mean square error, mean absolute error and R^2 of each axis and of all together.

    Args:
        truth: Measured values in N rows, (N, 6).
        predicted: Predicted values, (N, 6).
        blocks: Name or number of the block that holds each row, (N,), for the bootstrap; see `consecutive`.
        subject: Model, dataset and variant, which every row of the result names.
        axes: Names of the axes, columns whose units `hydro.core.columns` knows.
        seed: Seed of the bootstrap.

    Returns:
        A metrics table: `rmse`, `mae`, `r2` of each axis, `rmse` and `mae` of axis `all`, `r2` of axis
        `mean`.  `low` and `high` are the 95 % interval, null where it is undefined, as with fewer than two
        blocks.  R^2 of a constant axis is undefined and has no row.

    Raises:
        DataError: There are no rows, the shapes differ, or a value is not finite.
    """
    y, guess = np.asarray(truth, float), np.asarray(predicted, float)
    if y.shape != guess.shape or y.ndim != 2 or y.shape[0] == 0:
        raise DataError(f"errors need two tables of the same rows, at least one: {y.shape} and {guess.shape}")
    broken = ~(np.isfinite(y) & np.isfinite(guess)).all(axis=1)
    if broken.any():
        raise DataError(
            f"errors need finite numbers: {broken.sum()} of {len(y)} rows are not "
            f"(first: row {broken.argmax()})"
        )
    by_block = _sums(y, guess, pl.Series(blocks).rank("dense").to_numpy() - 1)
    whole = Sums(*(part.sum(axis=0) for part in by_block))
    spread = _bootstrap(by_block, seed) if len(by_block.rows) > 1 else None
    lines = (
        (axis, metric, value, *_interval(drawn), unit)
        for axis, metric, value, unit, drawn in _measures(whole, spread, axes)
    )
    return rows_of(subject, lines)


def rows_of(subject: Subject, lines: Iterable[tuple[str, str, float, float, float, str]]) -> pl.DataFrame:
    """Return a new metrics table with one row for each given line.

    Args:
        subject: Model, dataset and variant, which every row names.
        lines: For each row axis, metric, value, lower and upper end of the value's 95 % interval (NaN without
            an interval) and unit.
    """
    table = pl.DataFrame(
        list(lines),
        schema=["axis", "metric", "value", "low", "high", "unit"],
        orient="row",
        infer_schema_length=None,
    )
    head = {"model": subject.model, "variant": subject.variant, "dataset": subject.dataset}
    named = table.select(*(pl.lit(text).alias(name) for name, text in head.items()), pl.all())
    return named.with_columns(pl.col("low", "high").fill_nan(None))


def _interval(drawn: Array | None) -> tuple[float, float]:
    """Return the 95 % interval of bootstrap values; NaN if a value is undefined."""
    if drawn is None or not np.isfinite(drawn).all():
        return np.nan, np.nan
    low, high = interval(drawn)
    return float(low), float(high)


def consecutive(rows: int, length: int) -> NDArray[np.int64]:
    """Return the number of the block, from 0, that holds each row of a table, (rows,).

    Args:
        rows: Number of rows.
        length: Rows of a block; the last block also has the remainder.
    """
    return np.minimum(np.arange(rows) // length, max(rows // length, 1) - 1)


def _sums(truth: Array, predicted: Array, group: NDArray[np.int64]) -> Sums:
    """Return the sums over each of B blocks, arrays (B, 6).

    Args:
        truth: Measured values, (N, 6).
        predicted: Predicted values, (N, 6).
        group: Block of each row, from 0, (N,).
    """
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    error = predicted - truth

    def add(values: Array) -> Array:
        return np.add.reduceat(values[order], starts, axis=0)

    rows = add(np.ones((len(truth), 1)))
    return Sums(rows, add(error**2), add(np.abs(error)), add(truth), add(truth**2))


def _bootstrap(by_block: Sums, seed: int) -> Sums:
    """Return the sums of SAMPLES recordings drawn from the blocks, arrays (SAMPLES, 6)."""
    drawn = redrawn(np.concatenate(by_block, axis=1), seed)
    edges = np.cumsum([part.shape[1] for part in by_block])[:-1]
    return Sums(*np.split(drawn, edges, axis=1))


def _measures(
    whole: Sums, spread: Sums | None, axes: Sequence[str]
) -> Iterator[tuple[str, str, float, str, Array | None]]:
    """Yield axis, metric, value, unit and bootstrap values of every line of the table."""
    units = [UNITS[axis] for axis in axes]
    together = ", ".join(dict.fromkeys(units))
    moving = _variance(whole) > 0.0
    for metric, function in (("rmse", _rmse), ("mae", _mae), ("r2", _r2)):
        value, drawn = function(whole), None if spread is None else function(spread)
        for i, (axis, unit) in enumerate(zip(axes, units, strict=True)):
            if metric != "r2":
                yield axis, metric, float(value[i]), unit, None if drawn is None else drawn[:, i]
            elif moving[i]:
                yield axis, metric, float(value[i]), "1", None if drawn is None else drawn[:, i]
    for metric, function in (("rmse", _rmse), ("mae", _mae)):
        drawn = None if spread is None else function(_merged(spread))[:, 0]
        yield "all", metric, float(function(_merged(whole))[0]), together, drawn
    if moving.any():
        drawn = None if spread is None else _r2(spread)[:, moving].mean(axis=1)
        yield "mean", "r2", float(_r2(whole)[moving].mean()), "1", drawn


def _merged(sums: Sums) -> Sums:
    """Return sums over all axes as if they were one axis, for the single figures of the paper."""
    axes = sums.squares.shape[-1]
    return Sums(sums.rows * axes, *(part.sum(axis=-1, keepdims=True) for part in sums[1:]))


def _rmse(sums: Sums) -> Array:
    return np.sqrt(sums.squares / sums.rows)


def _mae(sums: Sums) -> Array:
    return sums.sizes / sums.rows


def _variance(sums: Sums) -> Array:
    """Return the variance of the truth, exactly 0 where it is due to rounding."""
    mean_square = sums.values_squared / sums.rows
    variance = mean_square - (sums.values / sums.rows) ** 2
    return np.where(variance > 1e-12 * mean_square, variance, 0.0)


def _r2(sums: Sums) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return 1.0 - sums.squares / sums.rows / _variance(sums)
