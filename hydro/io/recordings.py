"""A recording as a table: a raw table as it stands, or a log that a map makes one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

from hydro.core.errors import DataError
from hydro.core.logs.logmap import BLOCKS, blocks_of
from hydro.core.logs.mixer import thrusters
from hydro.core.vehicle.description import Vehicle
from hydro.io import log_files, log_import, mistaken, provenance, table, vehicle
from hydro.io.files import name_of
from hydro.io.log import Log, LogFile
from hydro.io.table import Artefact

KEYS = {"session", "t"}
"""What every table of a recording has, and hardly a log of somebody's."""


def imported(
    files: Sequence[LogFile],
    map_: Path | None,
    tell: Callable[[str], None],
    *,
    vehicle_file: Path | None = None,
    preset: str | None = None,
    rate: float | None = None,
    strict: bool = False,
    fill: bool = False,
    progress: log_files.Progress = log_files.silent,
) -> Artefact:
    """Import logs, and tell what `hydro import` tells.

    Args:
        files: The files of one dive.
        map_: Their map; None to guess it from the columns' names.
        tell: Called with each line.
        vehicle_file: The vehicle, whose thrusters must be as many as the commands and whose file goes into
            the footer.
        preset: Whose names a guess takes the columns to have; by default those of any.
        rate: Rows per second; by default as `raw_table` has it.
        strict: Refuse a log whose motion contradicts the map.
        fill: Draw lines between the samples of a slow sensor instead of leaving rows empty.
        progress: Gives what is told how far each file is read.

    Returns:
        The raw table, with the logs and the map in its footer.

    Raises:
        DataError: a file, the map or the vehicle is broken, or they do not fit each other.
    """
    count = len(vehicle.read(vehicle_file)[0].thruster) if vehicle_file is not None and map_ is None else None
    source, meaning = log_files.gather(files, map_, progress, preset, count)
    for note in source.notes:
        tell(f"note: {note}")
    if map_ is None:
        tell(f"guessed from the columns' names: {'; '.join(log_import.described(meaning))}")
        if unknown := [name for name in BLOCKS if name not in blocks_of(meaning)]:
            tell(
                f"note: no column's name says {', '.join(unknown)}, so that they are null; if the log has "
                "them, name their columns in a map (--write-map FILE begins one)"
            )
    known, text = _known(vehicle_file, thrusters(meaning.mixer, len(meaning.commands.columns)))
    report = log_import.import_log(source, meaning, rate=rate, strict=strict, fill=fill)
    for line in report.lines():
        tell(line)
    if known is not None:
        for line in log_import.wiring(report.imported, known):
            tell(line)
    return _artefact(source, report, text)


def _known(file: Path | None, count: int) -> tuple[Vehicle | None, str | None]:
    """The vehicle and its text, once it is known to have as many thrusters as the log has commands for."""
    if file is None:
        return None, None
    known, text = vehicle.read(file)
    if len(known.thruster) != count:
        raise DataError(
            f"the map names {count} commands, but {file} has {len(known.thruster)} thrusters: name one "
            "column per thruster in commands.columns, in the file's order, or say in [mixer] what they demand"
        )
    return known, text


def _artefact(source: Log, report: log_import.ImportReport, text: str | None) -> Artefact:
    """The raw table with the log and the map in its footer."""
    files = source.files or (source.digest,)
    return table.make(
        "raw",
        report.imported.frame,
        stage="import",
        parameters={"rate": round(1.0 / report.imported.dt, 9), "map": msgspec.to_builtins(report.map)},
        inputs=[Artefact("log", pl.DataFrame(), provenance.Provenance("log", "", each)) for each in files],
        vehicle_text=text,
    )


def is_artefact(file: LogFile) -> bool:
    """Whether a file has hydro's own footer; a damaged one has none."""
    if file.reader.name != "Parquet file":
        return False
    try:
        return provenance.FOOTER_KEY in (pq.read_metadata(file.path).metadata or {})
    except (pa.ArrowException, OSError, UnicodeDecodeError):
        return False


def read(file: LogFile, kinds: Sequence[str]) -> Artefact:
    """A table as it stands.

    Raises:
        DataError: the file is a log, which needs a map; or it is broken, of another kind, or breaks its
            schema.
    """
    if file.reader.name != "Parquet file":
        what = "text" if file.reader.name == "CSV file" else file.reader.name
        error = DataError(
            f"{file.name}: not a Parquet file ({what}): if it is a log, give --map FILE, "
            "which hydro import LOG --write-map FILE begins"
        )
        raise mistaken.explained(error, file.path, mistaken.RECORDING)
    if file.name == name_of(file.path):
        return _of_columns(file, lambda: table.read(file.path, kinds))
    with file.path.open("rb") as stream:
        return _of_columns(file, lambda: table.read(stream, kinds))


def _of_columns(file: LogFile, read: Callable[[], Artefact]) -> Artefact:
    """What `read` reads; where the columns are those of a log, its error says what a log needs."""
    try:
        return read()
    except DataError as error:
        try:
            foreign = bool(KEYS - pl.read_parquet_schema(file.path).keys())
        except (pl.exceptions.PolarsError, OSError):
            foreign = False
        if foreign:
            raise DataError(f"{error}; if it is a log, give --map FILE") from error
        raise
