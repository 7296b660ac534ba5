"""Arrays for training and evaluation from rows of a labels or split table."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.distillation import history
from hydro.core.distillation.features import INPUTS, OUTPUTS, features
from hydro.core.distillation.labels import labelled
from hydro.core.errors import DataError, UsageError
from hydro.core.recording.segments import sample_time, segments

VALIDATION_SHARE = 0.1  # expected share of training blocks for validation


def of_part(table: pl.DataFrame, part: str) -> pl.DataFrame:
    """Return the rows of one part of the split: `train` or `test`; `all` returns every row.

    Raises:
        DataError: If the table has not been split or the part is empty.
    """
    if part == "all":
        return table
    if "part" not in table.columns:
        raise DataError("labels: column part is missing: split the labels first with `hydro split`")
    rows = table.filter(pl.col("part") == part)
    if rows.is_empty():
        raise DataError(f"split: no row belongs to the {part} part: give more data or change --test")
    return rows


def for_minutes(table: pl.DataFrame, minutes: float) -> pl.DataFrame:
    """Return a copy of a split table whose training part is limited to a number of minutes.

    Whole blocks of the training part are taken in the order of a hash of their ids until they reach that
    duration; all other training blocks become guard rows, which no step uses.  The blocks of fewer minutes
    are always among those of more minutes.

    Args:
        table: Split table.
        minutes: Greatest duration of the training data [min].

    Raises:
        DataError: If the table has not been split or has no training row.
        UsageError: If the minutes are not positive.
    """
    if not minutes > 0.0:
        raise UsageError(f"minutes of training data must be above 0, not {minutes:g}")
    training = of_part(table, "train")
    _require(training, ("block", "session", "t"))
    dt = sample_time(table)
    lengths = training.group_by("block", maintain_order=True).len()
    order = sorted(lengths.iter_rows(), key=lambda one: _fraction(one[0], "minutes"))
    before = np.cumsum([0, *(count for _, count in order)])[:-1]
    kept = [block for (block, _), rows in zip(order, before, strict=True) if rows * dt < 60.0 * minutes]
    spare = (pl.col("part") == "train") & ~pl.col("block").is_in(kept)
    return table.with_columns(part=pl.when(spare).then(pl.lit("guard")).otherwise(pl.col("part")))


def states(rows: pl.DataFrame) -> Array:
    """Return (nu, nu_dot) of the rows as one array (N, 12) [m/s, rad/s, m/s^2, rad/s^2], body FRD.

    Raises:
        DataError: If a column is missing or not finite.
    """
    return _columns(rows, INPUTS)


def inputs(table: pl.DataFrame, part: str, architecture: Mapping[str, Any]) -> tuple[pl.DataFrame, Array]:
    """Return the rows of one part of the split and the inputs of a network for them.

    The past velocities of a network with a window may come from rows of other parts, mostly guard rows, which
    separate training and test.  Only their velocities are used, not their labels.  The window does not cross
    gaps, starts of sessions or rows without a label.

    Args:
        table: labels; all rows of their sessions in order if the network has a window.
        part: `train`, `test` or `all`, as for `of_part`.
        architecture: description of the network.

    Returns:
        The N rows with a complete window, and the inputs (N, k).

    Raises:
        DataError: If the part is empty, a column is missing or not finite, or the sample time does not fit
            the network's period.
    """
    table = labelled(table)
    chosen = of_part(table, part)
    made = features(states(chosen), architecture["features"])
    if (window := architecture.get("window", 1)) == 1:
        return chosen, made
    _require(table, ("session", "t"))
    steps = history.stride(architecture["period"], sample_time(table))
    past = history.past(_columns(table, INPUTS[:6]), segments(table), window, steps)
    if part != "all":
        past = past[(table["part"] == part).to_numpy()]
    return chosen, np.hstack([made, past])


def wrenches(rows: pl.DataFrame) -> Array:
    """Return the labels tau_res of the rows as one array (N, 6) [N, N m], body FRD.

    Raises:
        DataError: If a column is missing or not finite.
    """
    return _columns(rows, OUTPUTS)


def validation(rows: pl.DataFrame) -> NDArray[np.bool_]:
    """Return a mask (N,) of the rows, whole blocks of the training part, that control early stopping.

    A block is chosen if the hash of its id, read as a fraction, is below 0.1; if none is, the block with the
    smallest hash.  The choice depends only on the content of the blocks.  No guard rows separate the chosen
    blocks from the fitted blocks.

    Raises:
        DataError: If there are fewer than two blocks.
    """
    if "block" not in rows.columns:
        raise DataError("split: column block is missing: split the labels with `hydro split`")
    fractions = {block: _fraction(block) for block in rows["block"].unique().to_list()}
    if len(fractions) < 2:
        raise DataError(
            "split: the training part needs two blocks or more, one of them for validation: give more data"
        )
    chosen = [block for block, fraction in fractions.items() if fraction < VALIDATION_SHARE]
    chosen = chosen or [min(fractions, key=fractions.__getitem__)]
    return rows["block"].is_in(chosen).to_numpy()


def _fraction(block: str, purpose: str = "validation") -> float:
    digest = hashlib.sha256(f"{purpose} {block}".encode()).digest()
    return int.from_bytes(digest[:8], "big") / 2**64


def _columns(rows: pl.DataFrame, names: Sequence[str]) -> Array:
    _require(rows, names)
    values = rows.select(pl.col(names).cast(pl.Float64)).to_numpy(order="c")
    finite = np.isfinite(values)
    if not finite.all():
        column = int(np.flatnonzero(~finite.all(axis=0))[0])
        bad = np.flatnonzero(~finite[:, column])
        raise DataError(
            f"labels: {names[column]} must be finite: {len(bad)} of {len(values)} rows are not "
            f"(first: row {bad[0]}): make the labels again with `hydro labels`"
        )
    return values


def _require(rows: pl.DataFrame, names: Sequence[str]) -> None:
    missing = [name for name in names if name not in rows.columns]
    if missing:
        raise DataError(f"labels: column {missing[0]} is missing: make the labels with `hydro labels`")
