"""The public functions of hydro, on polars frames; each loads what it needs when it is called."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

if TYPE_CHECKING:
    from pathlib import Path

    import polars as pl

    from hydro.core.vehicle import Vehicle
    from hydro.io.model import Model

Acceleration = Literal["rts", "kalman", "kalman-difference"]


def read(source: str | Path | BinaryIO, kind: str | None = None) -> pl.DataFrame:
    """Read an artefact and hold it to its schema.

    Args:
        source: path of a Parquet file, or a binary stream.
        kind: `raw`, `labels`, `split`, `blocks`, `features`, `metrics` or `replay`; any by default.

    Returns:
        The table. `hydro.io.table.read` gives its provenance beside it.

    Raises:
        hydro.core.errors.DataError: the file is broken, of another kind, or breaks its schema.
    """
    from hydro.io import table

    return table.read(source, kind).frame


def write(
    frame: pl.DataFrame, destination: str | Path | BinaryIO, kind: str, *, vehicle_file: str | Path | None = None
) -> None:
    """Write a table as an artefact of `kind`, whole or not at all, once it has passed its schema.

    Args:
        frame: the table.
        destination: path, or a binary stream.
        kind: kind of table, as for `read`.
        vehicle_file: vehicle file to put into the footer, so that later commands need no `--vehicle`.

    Raises:
        hydro.core.errors.DataError: the table breaks its schema, or the file cannot be written.
    """
    from hydro.io import table
    from hydro.io import vehicle as vehicles

    text = vehicles.read(vehicle_file)[1] if vehicle_file is not None else None
    table.write(table.make(kind, frame, stage="python", vehicle_text=text), destination)


def vehicle(path: str | Path) -> Vehicle:
    """Read and check a vehicle file.

    Raises:
        hydro.core.errors.DataError: the file is not a vehicle; the line names the path in the file.
    """
    from hydro.core import effects
    from hydro.io import vehicle as vehicles

    known, _ = vehicles.read(path)
    effects.validate(known)
    return known
