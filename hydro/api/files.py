"""Functions that read and write tables, vehicle files, logs and networks."""

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
    """Read a table that a command or `hydro.write` wrote, and check it against the schema of its kind.

    Args:
        source: path of a Parquet file, or a binary stream.
        kind: expected kind: `raw`, `labels`, `split`, `blocks`, `features`, `metrics`, `replay`, `commands`,
            `comparison`, `diagnosis` or `ladder`; by default any.

    Returns:
        The table. `hydro.io.table.read` also returns its provenance: command, inputs and hashes.

    Raises:
        hydro.core.errors.DataError: the file is damaged, of another kind, or does not fit its schema.
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
    """Check a table against the schema of its kind, and write it as a Parquet file that the commands read.

    The file is complete or absent, even if the program is interrupted.

    Args:
        frame: table, or a result such as that of `hydro.diagnose`.
        destination: path, or a binary stream.
        kind: kind of the table, as for `hydro.read`.
        vehicle_file: vehicle file to store in the footer, so that later commands need no `--vehicle`.

    Raises:
        hydro.core.errors.DataError: the table does not fit its schema, or the file cannot be written.
    """
    from hydro.io import table
    from hydro.io import vehicle as vehicles

    text = vehicles.read(vehicle_file)[1] if vehicle_file is not None else None
    footer = frame.footer if isinstance(frame, Result) else None
    made = table.make(kind, frame_of(frame), stage="python", parameters=footer, vehicle_text=text)
    table.write(made, destination)


def vehicle(path: str | Path) -> Vehicle:
    """Read and check a vehicle file.

    Args:
        path: path of the TOML file.

    Returns:
        The vehicle: mass, buoyancy, thrusters and effects, in SI units and body axes (FRD).

    Raises:
        hydro.core.errors.DataError: the file is not a valid vehicle file; the message names the wrong key.
    """
    from hydro.core import effects
    from hydro.io import vehicle as vehicles

    known, _ = vehicles.read(path)
    effects.validate(known)
    return known


def write_vehicle(vehicle: Vehicle, destination: str | Path, *, source: str | Path | None = None) -> None:
    """Write a vehicle file.

    The file is complete or absent, even if the program is interrupted.

    Args:
        vehicle: vehicle, such as that of `hydro.add` or `hydro.fit`.
        destination: path of the TOML file.
        source: vehicle file whose comments and layout are kept for all values that have not changed; may be
            the same path.

    Raises:
        hydro.core.errors.DataError: `source` or the vehicle is not valid, or the file cannot be written.
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
    """Convert a log to a raw table: one clock, NED and FRD frames, SI units, commands from -1 to 1.

    Args:
        log: file in any format that `hydro import` reads, or a binary stream; or several files of one dive.
            Files that overlap in time are merged; others become sessions with the names of the files.
        map: meaning of the columns (channel, unit, frame, sign), as a map file or a `hydro.LogMap`; by
            default it is guessed from their names. `hydro import --write-map` writes a draft.
        rate: rows per second; by default the median rate of the channels, or the rate of the fastest channel
            if that is clearly higher, but at most 50.
        strict: raise an error if the motion contradicts the map.
        fill: interpolate linearly between the samples of sensors that are slower than the rows; by default
            these rows are null.
        msg: folder with the `.msg` files of ROS messages that the log does not describe.
        max_expanded: maximum size of the decompressed contents of a file [GB]; by default 100 times its size
            on disk, but at least 0.1 GB.

    Returns:
        The raw table, and a report. `report.verdict.contradictions` lists frames, units and signs that the
        kinematics contradict; `report.map` is the map that was used; `report.lines()` returns the lines that
        `hydro import` prints.

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
    """Read a trained network.

    Args:
        source: path of the file that `hydro train` or `hydro.write_model` wrote, or a binary stream.

    Returns:
        The network with its scalers, for `hydro.evaluate`, `hydro.replay` or `hydro.diagnose`.

    Raises:
        hydro.core.errors.DataError: the file is damaged or is not a network.
    """
    from hydro.io import model, table

    return model.from_artefact(table.read(source, "model"))


def write_model(model: Model, destination: str | Path | BinaryIO) -> None:
    """Write a trained network: a table of its tensors, with architecture and scalers in the footer.

    Args:
        model: network, from `hydro.train`.
        destination: path, or a binary stream.

    Raises:
        hydro.core.errors.DataError: a tensor is not finite, or the file cannot be written.
    """
    from hydro.io import model as models
    from hydro.io import table

    table.write(models.to_artefact(model, stage="python"), destination)
