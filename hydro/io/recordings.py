"""A recording as a table: read from a raw table, or imported from a log with a map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq

from hydro.core.errors import DataError, listed
from hydro.core.logs.logmap import BLOCKS, LogMap, blocks_of, columns_of, sensors_of
from hydro.core.logs.mixer import thrusters
from hydro.core.vehicle.description import Vehicle
from hydro.io import file_kind, log_files, log_import, provenance, table, vehicle
from hydro.io.files import name_of
from hydro.io.log import Log, LogFile
from hydro.io.table import Artefact

KEYS = {"session", "t"}
"""Columns of every table of a recording, which a user's log hardly has."""


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
    """Import the log files of one dive as a raw table, and report line by line as `hydro import` does.

    Args:
        files: Files of one dive.
        map_: Path of their map; None to guess the map from the column names.
        tell: Called with each line of the report.
        vehicle_file: Vehicle with as many thrusters as commands; its text goes into the footer.
        preset: Naming scheme of the columns for a guess; by default any.
        rate: Rows per second [Hz]; by default as in `raw_table`.
        strict: Refuse a log whose motion contradicts the map.
        fill: Interpolate between the samples of a slow sensor instead of leaving nulls.
        progress: Context that reports the progress of each file.

    Returns:
        Raw table, with the logs and the map in its footer.

    Raises:
        DataError: A file, the map or the vehicle is invalid, or they do not fit each other.
    """
    count = len(vehicle.read(vehicle_file)[0].thruster) if vehicle_file is not None and map_ is None else None
    source, meaning = log_files.gather(files, map_, progress, preset, count)
    for note in source.notes:
        tell(f"note: {note}")
    if map_ is None:
        tell(f"guessed from the columns' names: {'; '.join(log_import.described(meaning))}")
        if unknown := [name for name in BLOCKS if name not in blocks_of(meaning)]:
            tell(
                f"note: no column name identifies {', '.join(unknown)}, so they are null; if the log has "
                "them, name their columns in a map (--write-map FILE begins one)"
            )
    _require_names(meaning, str(map_))
    known, text = _read_vehicle(vehicle_file, thrusters(meaning.mixer, len(meaning.commands.columns)))
    report = log_import.import_log(source, meaning, rate=rate, strict=strict, fill=fill)
    for line in report.lines():
        tell(line)
    if known is not None:
        for line in log_import.audited(report, known, str(vehicle_file)):
            tell(line)
    return _artefact(source, report, text)


def _require_names(meaning: LogMap, name: str) -> None:
    """Refuse the draft of a map whose empty column names were not filled in.

    Raises:
        DataError: A column name is empty.
    """
    empty = [f"[{block}]" for block, sensor in sensors_of(meaning).items() if "" in columns_of(sensor)]
    if empty:
        raise DataError(
            f"{name}: a column name in {listed(empty)} is empty: fill in the names of the log's columns, or "
            "leave out the table of a sensor that the log lacks"
        )


def _read_vehicle(file: Path | None, count: int) -> tuple[Vehicle | None, str | None]:
    """Read the vehicle and its text, and check that it has a thruster for each command."""
    if file is None:
        return None, None
    known, text = vehicle.read(file)
    if len(known.thruster) != count:
        raise DataError(
            f"the map names {count} commands, but {file} has {len(known.thruster)} thrusters: name one "
            "column per thruster in commands.columns, in the file's order, or define a [mixer]"
        )
    return known, text


def _artefact(source: Log, report: log_import.ImportReport, text: str | None) -> Artefact:
    """Return the raw table with the log and the map in its footer."""
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
    """Return whether a file is a table that hydro wrote, by its footer; False for a damaged file."""
    if file.reader.name != "Parquet file":
        return False
    try:
        return provenance.FOOTER_KEY in (pq.read_metadata(file.path).metadata or {})
    except (pa.ArrowException, OSError, UnicodeDecodeError):
        return False


def read(file: LogFile, kinds: Sequence[str]) -> Artefact:
    """Return a table of a recording with its provenance, read from a file.

    Args:
        file: The file.
        kinds: Accepted kinds of table.

    Raises:
        DataError: The file is a log, which needs a map; or it is damaged, of another kind, or breaks its
            schema.
    """
    if file.reader.name != "Parquet file":
        what = "text" if file.reader.name == "CSV file" else file.reader.name
        error = DataError(
            f"{file.name}: not a Parquet file ({what}): if it is a log, give --map FILE, "
            "which hydro import LOG --write-map FILE begins"
        )
        raise file_kind.explained(error, file.path, file_kind.RECORDING)
    if file.name == name_of(file.path):
        return _with_hint(file, lambda: table.read(file.path, kinds))
    with file.path.open("rb") as stream:
        return _with_hint(file, lambda: table.read(stream, kinds))


def _with_hint(file: LogFile, read: Callable[[], Artefact]) -> Artefact:
    """Return the result of `read`; add a hint to its error if the columns are those of a log."""
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
