"""Split into training and test blocks by the hash of their content; paper IV-C, but independent of order.

Every unbroken segment of a session is cut into contiguous blocks of 150 rows.  The last block takes the
remainder (150 to 299 rows); a shorter segment is one block.  A block's id is

    SHA-256(raw values of its rows, row after row, as little-endian float64; then the salt in UTF-8)

where a row's values are t, x, y, z, phi, theta, psi, u, v, w, p, q, r, cmd_1 ... cmd_n;
-0 counts as 0, and null as NaN.

The id does not contain the session's name, so equal data give equal splits.  A block is test data if its id,
read as a fraction of 2^256, is below the test share.
"""

from __future__ import annotations

import hashlib
from itertools import pairwise

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import COMMAND, MOTION, Array, Rows, command_columns
from hydro.core.compiled import jit
from hydro.core.distillation.labels import labelled, smoother_reach
from hydro.core.errors import DataError
from hydro.core.recording.segments import segments
from hydro.core.threads import spread

CONTENT = ("t", *MOTION)  # columns in the hash of a block, followed by the commands
CHUNK = 32_768  # rows hashed per task
TRAIN, TEST, GUARD = 0, 1, 2  # indices into PARTS
PARTS = pl.Series(["train", "test", "guard"])


def split(
    labels: pl.DataFrame, *, block: int = 150, test: float = 0.2, salt: str = "", guard: int | None = None
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the labelled rows of a table divided into training and test blocks, and a table of the blocks.

    Args:
        labels: Labels table, or another table with the raw columns.
        block: Rows per block.
        test: Expected share of blocks that are test data, 0 to 1.
        salt: Text added to the hashes; another salt gives another split.
        guard: Rows at the border between a training and a test block that neither uses; by default the reach
            of the smoother that `labels` designs for these velocities.

    Returns:
        The rows with a label, with the columns `block` (64 hexadecimal digits) and `part` (train, test,
        guard); and the table of all blocks: `block`, `part` (train, test), sorted, each id once.

    Raises:
        DataError: An argument is out of range, or the sample time is not constant.
    """
    if not 0.0 <= test <= 1.0:
        raise DataError(f"the test share must lie within 0 and 1, not {test:g}")
    bounds, ids = _blocks(labels, block, salt)
    is_test = np.array([int(digest, 16) / 16**64 < test for digest in ids], dtype=bool)
    return _divide(labels, bounds, ids, is_test, guard), _table(ids, is_test)


def split_from(
    labels: pl.DataFrame,
    blocks: pl.DataFrame,
    *,
    block: int = 150,
    salt: str = "",
    guard: int | None = None,
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the labelled rows of a table and its blocks, divided as in an earlier split.

    Args:
        labels: Labels table.
        blocks: Table of blocks of the earlier split, `block` and `part`; it must contain every block of
            `labels`.
        block: Rows per block of the earlier split.
        salt: Salt of the earlier split.
        guard: Rows at the border between a training and a test block that neither uses; by default the reach
            of the smoother that `labels` designs for these velocities.

    Returns:
        The rows with a label, with the columns `block` and `part` (train, test, guard); and the table of the
        blocks of these labels: `block`, `part` (train, test), sorted, each id once.

    Raises:
        DataError: A block of the labels is not in the table of blocks.
    """
    bounds, ids = _blocks(labels, block, salt)
    parts = dict(zip(blocks["block"].to_list(), blocks["part"].to_list(), strict=True))
    unknown = [start for (start, _), digest in zip(bounds, ids, strict=True) if digest not in parts]
    if unknown:
        raise DataError(
            f"{len(unknown)} of {len(ids)} blocks are not in the table of blocks (first: row {unknown[0]}, "
            f"session {labels['session'][int(unknown[0])]}); it was made from other data, or with another "
            "block length or salt"
        )
    is_test = np.array([parts[digest] == "test" for digest in ids], dtype=bool)
    return _divide(labels, bounds, ids, is_test, guard), _table(ids, is_test)


def block_bounds(bounds: Rows, block: int) -> Rows:
    """Return the bounds of blocks of rows; the last block of each segment takes the remainder.

    Args:
        bounds: First and past-the-last row of each of S segments, (S, 2).
        block: Rows per block.

    Returns:
        First and past-the-last row of each of B blocks, (B, 2).

    Raises:
        DataError: `block` is below 1.
    """
    if block < 1:
        raise DataError(f"a block must have at least one row, not {block}")
    cut: list[tuple[int, int]] = []
    for start, stop in bounds.tolist():
        edges = [*range(start, start + max((stop - start) // block, 1) * block, block), stop]
        cut.extend(pairwise(edges))
    return np.array(cut, dtype=np.int64).reshape(-1, 2)


def _blocks(labels: pl.DataFrame, block: int, salt: str) -> tuple[Rows, list[str]]:
    """Return the bounds (B, 2) and the ids of all blocks of a labels table."""
    bounds = block_bounds(segments(labels), block)
    suffix = salt.encode()

    def digests(chunk: Rows) -> list[str]:
        first = int(chunk[0, 0])
        content = _content(labels[first : int(chunk[-1, 1])])
        return [
            hashlib.sha256(content[start:stop].tobytes() + suffix).hexdigest()
            for start, stop in chunk - first
        ]

    chunks = np.array_split(bounds, min(len(bounds), 1 + labels.height // CHUNK))
    return bounds, [digest for ids in spread(digests, chunks) for digest in ids]


def _content(labels: pl.DataFrame) -> Array:
    """Return the raw values that a block's hash covers, row after row, as little-endian float64."""
    commands = sum(name.startswith(COMMAND) for name in labels.columns)
    names = (*CONTENT, *command_columns(commands))
    content = np.empty((labels.height, len(names)), "<f8")
    for i, name in enumerate(names):
        content[:, i] = labels[name].to_numpy()
    content += 0.0
    content[np.isnan(content)] = np.nan  # one bit pattern for all NaNs
    return content


def _divide(
    labels: pl.DataFrame, bounds: Rows, ids: list[str], is_test: NDArray[np.bool_], guard: int | None
) -> pl.DataFrame:
    """Return the labelled rows with the columns `block` and `part`, after marking guard rows."""
    rows = smoother_reach(labels) if guard is None else guard
    of_row = np.repeat(np.arange(len(bounds)), bounds[:, 1] - bounds[:, 0])
    part = is_test[of_row].astype(np.uint8)
    for start, stop in segments(labels):
        _guard_kernel(part[start:stop], rows)
    for side in (TRAIN, TEST):
        if (is_test == side).any() and not (part == side).any():
            raise DataError(f"a guard of {rows} rows leaves no {PARTS[side]} rows; use longer blocks")
    parts = PARTS.gather(part).alias("part")
    return labelled(labels.with_columns(pl.Series("block", ids).gather(of_row), parts))


def _table(ids: list[str], is_test: NDArray[np.bool_]) -> pl.DataFrame:
    """Return the table of all blocks with their parts, sorted, each id once."""
    table = pl.DataFrame({"block": ids, "part": PARTS.gather(is_test.astype(np.uint8))})
    return table.unique().sort("block")


@jit
def _guard_kernel(part: NDArray[np.uint8], rows: int) -> None:
    """Mark the rows of one segment that are within `rows` rows of the other part as guard."""
    side = part.copy()
    for step in (1, -1):
        begin = 0 if step == 1 else side.size - 1
        last_seen = np.array([-rows - side.size, -rows - side.size])
        for n in range(side.size):
            k = begin + step * n
            last_seen[side[k]] = n
            if n - last_seen[1 - side[k]] <= rows:
                part[k] = GUARD
