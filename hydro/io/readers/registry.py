"""Which reader a log needs: by its first bytes; by its suffix only where a format has none of its own."""

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
"""Bytes at the beginning of a file by which its format is told."""


@dataclass(frozen=True)
class Reader:
    """A format of logs.

    Attributes:
        name: What people call it.
        begins: Whether a file that begins with these bytes is of it.
        messages: Reads its messages; None for a table.
        table: Reads its table; None for messages.
        suffix: Of files that no bytes tell, the ending.
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
"""All formats, the one that no bytes tell at the end."""
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
"""What people also have: first bytes, name, and what makes a readable log of it."""
_POINTER = b"version https://git-lfs.github.com/spec/"
"""How Git LFS begins the small file that it puts in the place of a large one."""
FORMATS = (
    "CSV, Parquet, .npz, .mat, ROS 1 bag, ROS 2 (.db3, .mcap or their folder), DataFlash .bin or its .log, "
    "PX4 .ulg, MAVLink .tlog"
)


def reader_of(path: Path, name: str) -> Reader:
    """The reader of a file, or of a ROS 2 recording's folder.

    Raises:
        DataError: nothing here reads it; the line says what to make of it.
    """
    if path.is_dir():
        _refuse_pointers([each for each in sorted(path.iterdir()) if each.is_file()], name)
        if any(path.glob("*.mcap")):
            return _named("MCAP file")
        if (path / "metadata.yaml").is_file():
            return _named("ROS 2 recording")
        raise DataError(
            f"{name}: a folder without metadata.yaml is no ROS 2 recording, and without "
            "session=NAME/part.parquet no dataset: name a file in it"
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
    """Refuse a file that Git LFS left in the place of the log."""
    for each in files:
        with each.open("rb") as file:
            if file.read(len(_POINTER)) == _POINTER:
                where = name if len(files) == 1 and name.endswith(each.name) else f"{name}: {each.name}"
                raise DataError(
                    f"{where}: this is a pointer of Git LFS, not the log itself: "
                    "run `git lfs pull` in its repository"
                )


def _named(name: str) -> Reader:
    return next(each for each in READERS if each.name == name)


def read(path: Path, reader: Reader, selection: Selection, options: Options) -> pl.DataFrame | Tables:
    """A table whole, or the wanted columns of a log of messages; all of them cost a second pass over it.

    Raises:
        DataError: the file is damaged, or its library is not installed.
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
    """The topics of a log of messages, in one pass that keeps none of them.

    Raises:
        DataError: the file is damaged, or its library is not installed.
    """
    assert reader.messages is not None
    with reading(options.name, reader.name):
        return inventory(reader.messages(path, Selection(), options))
