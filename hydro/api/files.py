"""Tables, vehicle files, logs and models, read and written."""

from __future__ import annotations

from typing import TYPE_CHECKING, BinaryIO

from hydro.api.result import Result, frame_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import polars as pl

    from hydro.core.logs.logmap import LogMap
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.log_import import ImportReport
    from hydro.io.model import Model


def read(source: str | Path | BinaryIO, kind: str | None = None) -> pl.DataFrame:
    """Read an artefact and check it against its schema.

    Args:
        source: path of a Parquet file, or a binary stream.
        kind: `raw`, `labels`, `split`, `blocks`, `features`, `metrics`, `replay`, `commands`, `comparison`,
            `diagnosis` or `ladder`; any by default.

    Returns:
        The table. `hydro.io.table.read` returns its provenance too.

    Raises:
        hydro.core.errors.DataError: the file is broken, of another kind, or breaks its schema.
    """
    from hydro.io import table

    return table.read(source, kind).frame


def write(
    frame: pl.DataFrame | Result,
    destination: str | Path | BinaryIO,
    kind: str,
    *,
    vehicle_file: str | Path | None = None,
) -> None:
    """Write a table as an artefact of `kind`, whole or not at all, once it has passed its schema.

    Args:
        frame: the table, or a result such as `hydro.diagnose` returns.
        destination: path, or a binary stream.
        kind: kind of table, as for `read`.
        vehicle_file: vehicle file to put into the footer, so that later commands need no `--vehicle`.

    Raises:
        hydro.core.errors.DataError: the table breaks its schema, or the file cannot be written.
    """
    from hydro.io import table
    from hydro.io import vehicle as vehicles

    text = vehicles.read(vehicle_file)[1] if vehicle_file is not None else None
    footer = frame.footer if isinstance(frame, Result) else None
    made = table.make(kind, frame_of(frame), stage="python", parameters=footer, vehicle_text=text)
    table.write(made, destination)


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


def write_vehicle(vehicle: Vehicle, destination: str | Path, *, source: str | Path | None = None) -> None:
    """Write a vehicle file, whole or not at all.

    Args:
        vehicle: the vehicle, such as `hydro.add` or `hydro.fit` returns it.
        destination: path of the file.
        source: vehicle file whose comments and layout are kept where it says the same; may be the same path.

    Raises:
        hydro.core.errors.DataError: `source` or the vehicle breaks a rule of vehicle files, or the file
            cannot be written.
    """
    from hydro.io import rewrite
    from hydro.io import vehicle as vehicles

    text = vehicles.read(source)[1] if source is not None else ""
    vehicles.write(rewrite.rewritten(vehicle, text), destination)


def import_log(
    log: str | Path | BinaryIO | Sequence[str | Path],
    map: str | Path | LogMap | None = None,
    *,
    rate: float | None = None,
    strict: bool = False,
    fill: bool = False,
    msg: str | Path | None = None,
    max_expanded: float | None = None,
) -> tuple[pl.DataFrame, ImportReport]:
    """Turn a log into a raw table: one clock, NED and FRD, SI units, commands from -1 to 1.

    Args:
        log: file in any format that `hydro import` reads, or a binary stream; several files of one dive are
            merged by time, and those that do not overlap are sessions, named by their files.
        map: what the columns mean: a map file (`hydro import --write-map` begins one) or a `LogMap`; by
            default guessed from the columns' names.
        rate: rows per second; by default the median of the rates of the channels, or the fastest of them
            if it is clearly faster, but at most 50.
        strict: refuse a log whose motion contradicts the map.
        fill: values in every row, on lines between the samples of a sensor slower than the rows; by default
            such a column is null between its samples.
        msg: folder with the `.msg` files of ROS messages that the log does not describe.
        max_expanded: how much the contents of a file may take once decompressed [GB]; by default 100 times
            the file's size, or 0.1 GB where that is more.

    Returns:
        The raw table, and a report: `report.verdict.contradictions` are the frames, units and signs that the
        kinematics contradict, `report.map` is what the columns were taken for, and `report.lines()` says all
        that `hydro import` prints.

    Raises:
        hydro.core.errors.DataError: the log or the map is broken, or they do not fit each other.
    """
    from contextlib import ExitStack
    from pathlib import Path
    from typing import cast

    from hydro.io import log_files, log_import
    from hydro.io.log import opened
    from hydro.io.readers.expansion import allowed

    sources: list[str | Path | BinaryIO] = []
    if isinstance(log, list | tuple):
        sources.extend(log)
    else:
        sources.append(cast("str | Path | BinaryIO", log))
    with allowed(max_expanded), ExitStack() as stack:
        folder = Path(msg) if msg is not None else None
        files = [stack.enter_context(opened(source, folder)) for source in sources]
        source, meaning = log_files.gather(files, map)
        report = log_import.import_log(source, meaning, rate=rate, strict=strict, fill=fill)
    return report.imported.frame, report


def read_model(source: str | Path | BinaryIO) -> Model:
    """Read a trained model.

    Raises:
        hydro.core.errors.DataError: the file is broken or is not a model.
    """
    from hydro.io import model, table

    return model.from_artefact(table.read(source, "model"))


def write_model(model: Model, destination: str | Path | BinaryIO) -> None:
    """Write a trained model as a table of tensors with its architecture and scalers in the footer.

    Raises:
        hydro.core.errors.DataError: a tensor is not finite, or the file cannot be written.
    """
    from hydro.io import model as models
    from hydro.io import table

    table.write(models.to_artefact(model, stage="python"), destination)
