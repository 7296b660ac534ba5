"""What a file is that was given in the place of another: a recording for a vehicle, or a vehicle for one."""

from __future__ import annotations

from pathlib import Path

from hydro.core.errors import DataError

_BEGINNING = 65536
"""Bytes in which a file of TOML says what it is; its tables come early."""
_TABLES = (
    b"PAR1",
    b"#ROSBAG",
    b"SQLite format 3\0",
    b"\x89MCAP0\r\n",
    b"\xa3\x95",
    b"ULog\x01\x12",
    b"MATLAB 5.0",
    b"PK\x03\x04",
)
"""First bytes of recordings; what has none of these is text."""
VEHICLE, MAP, RECORDING = "a vehicle file", "a map of a log", "a recording, or another table"
_NEEDED = {
    VEHICLE: "a vehicle is a .toml, as `hydro vehicle new` writes it",
    MAP: "a map is a .toml, as `hydro import LOG --write-map FILE` begins it",
    RECORDING: "a recording is a raw table (.parquet), or a log with --map",
}


def kind(path: object) -> str:
    """What a file is by its first bytes; empty where they do not say, or it cannot be read."""
    try:
        if not Path(str(path)).is_file():  # of a pipe nothing is left to read
            return ""
        with open(Path(str(path)), "rb") as file:
            head = file.read(_BEGINNING)
    except (OSError, ValueError):
        return ""
    if head.startswith(_TABLES):
        return RECORDING
    if b"hydro-map/" in head:
        return MAP
    if b"hydro-vehicle/" in head or b"[rigid_body]" in head:
        return VEHICLE
    first = next((line for line in head.splitlines() if line.strip() and not line.startswith(b"#")), b"")
    named = max((first.split(mark) for mark in (b",", b";", b"\t")), key=len)
    return RECORDING if len(named) > 2 and b"=" not in first and b"\0" not in first else ""


def explained(error: DataError, path: object, needed: str) -> DataError:
    """The error, or that the file is of another kind than is needed, where it is.

    Args:
        error: What reading it said.
        path: The file.
        needed: What belongs in its place.
    """
    found = kind(path)
    return error if found in ("", needed) else DataError(f"{path}: this is {found}; {_NEEDED[needed]}")
