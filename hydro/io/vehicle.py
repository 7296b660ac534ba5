"""Vehicle files: TOML text to a checked `Vehicle`, and additions that keep the comments."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import msgspec

from hydro.core.errors import DataError
from hydro.core.vehicle import Vehicle
from hydro.io.files import read_bytes, write_bytes


def read(path: str | Path) -> tuple[Vehicle, str]:
    """Read a vehicle file.

    Returns:
        The vehicle, and the file's text as it stands.

    Raises:
        DataError: the file cannot be read, or is not a vehicle; the line names the path in the file.
    """
    name = os.fspath(path)
    try:
        text = read_bytes(path).decode()
    except UnicodeDecodeError as error:
        raise DataError(f"{name}: not UTF-8 text: save the file as UTF-8") from error
    return parse(text, name), text


def parse(text: str, name: str = "vehicle") -> Vehicle:
    """The vehicle that a text describes, checked.

    Raises:
        DataError: the text is not TOML or not a vehicle; the line names the path in the file.
    """
    try:
        return msgspec.toml.decode(text, type=Vehicle)
    except msgspec.MsgspecError as error:
        raise DataError(f"{name}: {error}") from error


def vehicle_hash(vehicle: Vehicle) -> str:
    """SHA-256 of what a vehicle file says; comments and layout do not matter."""
    content = msgspec.json.encode(vehicle, order="sorted")
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def write(text: str, destination: str | Path) -> None:
    """Write the text of a vehicle file, whole or not at all, once it has passed all checks.

    Raises:
        DataError: the text is not a vehicle, or the operating system refuses.
    """
    parse(text, os.fspath(destination))
    write_bytes(text.encode(), destination)
