"""Lossless packing of transitions for a checkpoint; equal observations are stored once.

The following observation of a transition is usually the observation of a later one.  Parquet columns hold
the numbers, with byte-stream split and zstd compression, because neighbouring steps have similar values.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import torch
from numpy.typing import NDArray
from torch import Tensor

SEEN, FOLLOWING = "observation", "next.observation"  # columns before and after a step
UNLINKED = -1
"""Link of a following observation that equals no observation of a transition; it is stored separately."""
ROWS = 1 << 16
"""Rows of a row group."""

Packed = dict[str, Any]


def pack(transitions: dict[str, Tensor]) -> Packed:
    """Return a dict with the columns of transitions as bytes of Parquet tables; `unpack` restores them.

    Args:
        transitions: Tensors of K transitions by column, (K, ...).  If `next.observation` is among them,
            `observation` must be too: equal rows of both are stored once.  An empty dict gives an empty one.
    """
    if not transitions:
        return {}
    columns = {name: tensor.numpy() for name, tensor in transitions.items()}
    shapes = {name: list(column.shape[1:]) for name, column in columns.items() if name != FOLLOWING}
    if FOLLOWING not in columns:
        return {"shapes": shapes, "columns": _write(columns), "order": list(transitions)}
    link, alone = _link(columns[SEEN], columns.pop(FOLLOWING))
    return {
        "shapes": shapes,
        "columns": _write(columns | {"link": link}),
        "alone": _write({FOLLOWING: alone}),
        "order": list(transitions),
    }


def unpack(packed: Packed) -> dict[str, Tensor]:
    """Return the columns of transitions that `pack` packed, bit for bit, as tensors by name."""
    if not packed:
        return {}
    columns, width = _read(packed["columns"]), packed["shapes"][SEEN]
    made = {name: columns[name].reshape(-1, *shape) for name, shape in packed["shapes"].items()}
    if FOLLOWING not in packed["order"]:
        return {name: torch.from_numpy(made[name]) for name in packed["order"]}
    link = columns["link"][:, 0]
    following = made[SEEN][np.maximum(link, 0)]
    following[link == UNLINKED] = _read(packed["alone"])[FOLLOWING].reshape(-1, *width)
    made[FOLLOWING] = following
    return {name: torch.from_numpy(made[name]) for name in packed["order"]}


def _link(seen: NDArray[Any], following: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[Any]]:
    """Find the row of `seen` equal to each row of `following`, both (K, O).

    Returns:
        Row numbers (K,), UNLINKED where no row is equal, and the rows of `following` without an equal row.
    """
    number = {row.tobytes(): k for k, row in enumerate(np.ascontiguousarray(seen))}
    found = [number.get(row.tobytes(), UNLINKED) for row in np.ascontiguousarray(following)]
    link = np.array(found, dtype=np.int64)
    return link, following[link == UNLINKED]


def _write(columns: dict[str, NDArray[Any]]) -> Tensor:
    """Write columns (K, ...) as the bytes of a Parquet file with one column per number of a row."""
    flat = {
        f"{name}/{i}": pa.array(np.ascontiguousarray(part))
        for name, column in columns.items()
        for i, part in enumerate(column.reshape(len(column), -1).T)
    }
    table, sink = pa.table(flat), pa.BufferOutputStream()
    split = [name for name, part in flat.items() if pa.types.is_floating(part.type)]
    pq.write_table(
        table, sink, row_group_size=ROWS, compression="zstd", use_dictionary=False,
        use_byte_stream_split=split, write_statistics=False, store_schema=False,
    )  # fmt: skip
    return torch.frombuffer(bytearray(sink.getvalue().to_pybytes()), dtype=torch.uint8)


def _read(content: Tensor) -> dict[str, NDArray[Any]]:
    """Read the bytes of `_write` as arrays by name, each (K, numbers of a row)."""
    table = pq.read_table(pa.py_buffer(content.numpy().tobytes()))
    parts: dict[str, list[NDArray[Any]]] = {}
    for name in table.column_names:
        parts.setdefault(name.rpartition("/")[0], []).append(table[name].to_numpy())
    return {name: np.column_stack(each) for name, each in parts.items()}
