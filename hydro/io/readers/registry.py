"""Choice of a log's reader: by its first bytes, or by its suffix if the format has no magic bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from hydro.core.errors import DataError
from hydro.io.readers import (
    ardupilot,
    arrays,
    columnar,
    dataflash_text,
    delimited,
    mcap_file,
    ros,
    ros2,
    ulog,
)
from hydro.io.readers.collect import Listed, collect, inventory
from hydro.io.readers.damage import reading
from hydro.io.readers.messages import Options, Selection, Stream
from hydro.io.readers.tables import Tables

HEAD = 512
"""Number of first bytes of a file that identify its format."""


@dataclass(frozen=True)
class Reader:
    """Reader of one format of logs.

    Attributes:
        name: Name of the format.
        begins: Function that tells whether a file with these first bytes has the format.
        messages: Reader of messages; None for a table.
        table: Reader of a table; None for messages.
        suffix: Suffix of files without identifying bytes.
    """

    name: str
    begins: Callable[[bytes], bool]
    messages: Stream | None = None
    table: Callable[[Path, Selection, Options], pl.DataFrame] | None = None
    suffix: str = ""


def _magic(*starts: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(starts)


READERS = (
    Reader("ROS 1 bag", _magic(b"#ROSBAG V2.0"), messages=ros.bag),
    Reader("ROS 2 recording", _magic(b"SQLite format 3\0"), messages=ros2.sqlite),
    Reader("MCAP file", _magic(b"\x89MCAP0\r\n"), messages=mcap_file.messages),
    Reader("DataFlash log", _magic(b"\xa3\x95"), messages=ardupilot.dataflash),
    Reader("DataFlash log in text", dataflash_text.begins, messages=dataflash_text.dataflash_text),
    Reader("PX4 ULog", _magic(ulog.MAGIC), messages=ulog.ulog),
    Reader("MAVLink log", ardupilot.is_telemetry, messages=ardupilot.telemetry, suffix=".tlog"),
    Reader("Parquet file", _magic(b"PAR1"), table=columnar.parquet),
    Reader("MATLAB file", _magic(b"MATLAB 5.0 MAT-file"), table=arrays.mat),
    Reader("numpy archive", _magic(b"PK\x03\x04"), table=arrays.npz),
    Reader("CSV file", lambda head: True, table=delimited.csv),
)
"""All formats; the last one accepts any bytes."""
_FOREIGN = (
    (b"#ROSBAG V1", "a ROS bag of version 1", "rosbag migrate"),
    (b"#ROSLOG", "a ROS bag of version 1", "rosbag migrate"),
    (b"MATLAB 7.3", "a MATLAB file of version 7.3", "save(..., '-v7') in MATLAB"),
    (b"\x89HDF", "an HDF5 file", "save(..., '-v7') in MATLAB, or numpy.savez"),
    (b"\x1f\x8b", "compressed with gzip", "gunzip"),
    (b"\x28\xb5\x2f\xfd", "compressed with zstd", "zstd -d"),
    (b"BZh", "compressed with bzip2", "bunzip2"),
    (b"7z\xbc\xaf", "a 7z archive", "7z x"),
)
"""Formats that are not read: first bytes, name, and the conversion to a readable log."""
_POINTER = b"version https://git-lfs.github.com/spec/"
"""First bytes of the small pointer file that Git LFS puts in the place of a large one."""
FORMATS = (
    "CSV, Parquet, .npz, .mat, ROS 1 bag, ROS 2 (.db3, .mcap or their folder), DataFlash .bin or its .log, "
    "PX4 .ulg, MAVLink .tlog"
)


def reader_of(path: Path, name: str) -> Reader:
    """Return the reader for a file, or for the folder of a ROS 2 recording.

    Args:
        path: File or folder.
        name: Its name in error messages.

    Raises:
        DataError: No reader knows the format; the message says how to convert the file.
    """
    if path.is_dir():
        _refuse_pointers([each for each in sorted(path.iterdir()) if each.is_file()], name)
        if any(path.glob("*.mcap")):
            return _reader("MCAP file")
        if (path / "metadata.yaml").is_file():
            return _reader("ROS 2 recording")
        raise DataError(
            f"{name}: without metadata.yaml this folder is not a ROS 2 recording, and without "
            "session=NAME/part.parquet it is not a dataset: name a file in it"
        )
    _refuse_pointers([path], name)
    with path.open("rb") as file:
        head = file.read(HEAD)
    for start, what, remedy in _FOREIGN:
        if head.startswith(start):
            raise DataError(f"{name}: this is {what}, which is not read: convert it first ({remedy})")
    found = next(each for each in READERS if each.begins(head))
    ending = next((each for each in READERS if each.suffix and each.suffix == path.suffix.lower()), None)
    if found is READERS[-1] and ending is not None:
        return ending
    if found is READERS[-1] and not delimited.is_text(head):
        raise DataError(
            f"{name}: not a table, and its first bytes are of no known format: give one of {FORMATS}"
        )
    return found


def _refuse_pointers(files: Sequence[Path], name: str) -> None:
    """Refuse a file that is a Git LFS pointer instead of the log."""
    for each in files:
        with each.open("rb") as file:
            if file.read(len(_POINTER)) == _POINTER:
                where = name if len(files) == 1 and name.endswith(each.name) else f"{name}: {each.name}"
                raise DataError(
                    f"{where}: this is a pointer of Git LFS, not the log itself: "
                    "run `git lfs pull` in its repository"
                )


def _reader(name: str) -> Reader:
    return next(each for each in READERS if each.name == name)


def read(path: Path, reader: Reader, selection: Selection, options: Options) -> pl.DataFrame | Tables:
    """Return the columns of a log: a table as one frame, the wanted fields of messages by topic.

    Args:
        path: Path of the file or folder.
        reader: Reader of its format.
        selection: Wanted columns of a log of messages; wanting all needs a second pass over the file.
        options: Options; the reader appends its notes.

    Raises:
        DataError: The file is damaged, or its library is not installed.
    """
    with reading(options.name, reader.name):
        if reader.table is not None:
            return reader.table(path, selection, options)
        if selection.columns is None:
            listed = topics(path, reader, Options(options.name, options.definitions))
            every = (f"{each.topic.name}.{field}" for each in listed for field in each.fields)
            selection = Selection(frozenset(every))
        assert reader.messages is not None
        found = collect(reader.messages(path, selection, options), selection, options.name)
    options.notes.extend(found.notes)
    return found


def topics(path: Path, reader: Reader, options: Options) -> list[Listed]:
    """Return a summary of each topic of a log of messages, in one pass without keeping messages.

    Raises:
        DataError: The file is damaged, or its library is not installed.
    """
    assert reader.messages is not None
    with reading(options.name, reader.name):
        return inventory(reader.messages(path, Selection(), options))
