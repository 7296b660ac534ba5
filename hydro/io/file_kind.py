"""Detection of a file of the wrong kind: a recording where a vehicle file is needed, or the reverse."""

from __future__ import annotations

from pathlib import Path

from hydro.core.errors import DataError

_HEAD = 65536
"""Number of bytes in which a TOML file identifies itself; its tables come early."""
_MAGIC = (
    b"PAR1",
    b"#ROSBAG",
    b"SQLite format 3\0",
    b"\x89MCAP0\r\n",
    b"\xa3\x95",
    b"ULog\x01\x12",
    b"MATLAB 5.0",
    b"PK\x03\x04",
)
"""First bytes of binary recordings; a file without them is text."""
VEHICLE, MAP, RECORDING = "a vehicle file", "a map of a log", "a recording, or another table"
"""Kinds of file."""
_HINTS = {
    VEHICLE: "a vehicle is a .toml, as `hydro vehicle new` writes it",
    MAP: "a map is a .toml, as `hydro import LOG --write-map FILE` begins it",
    RECORDING: "a recording is a raw table (.parquet), or a log with --map",
}


def kind(path: object) -> str:
    """Return the kind of a file by its first bytes, in words: a recording, map or vehicle file.

    Else empty.
    """
    try:
        if not Path(str(path)).is_file():  # a pipe has been consumed already
            return ""
        with open(Path(str(path)), "rb") as file:
            head = file.read(_HEAD)
    except (OSError, ValueError):
        return ""
    if head.startswith(_MAGIC):
        return RECORDING
    if b"hydro-map/" in head:
        return MAP
    if b"hydro-vehicle/" in head or b"[rigid_body]" in head:
        return VEHICLE
    first = next((line for line in head.splitlines() if line.strip() and not line.startswith(b"#")), b"")
    named = max((first.split(mark) for mark in (b",", b";", b"\t")), key=len)
    return RECORDING if len(named) > 2 and b"=" not in first and b"\0" not in first else ""


def explained(error: DataError, path: object, needed: str) -> DataError:
    """Return (not raise) an error that says that a file is of the wrong kind, or else the given error.

    Args:
        error: Error of reading the file.
        path: The file.
        needed: Kind of file that is needed.

    Returns:
        A new error if the file is of another known kind than needed; otherwise `error`.
    """
    found = kind(path)
    return error if found in ("", needed) else DataError(f"{path}: this is {found}; {_HINTS[needed]}")
