"""Folder of the full Stonefish recordings: as given, or of the installed distribution deep-hydro-sim-data."""

from __future__ import annotations

from pathlib import Path

from hydro.core.errors import DataError
from hydro.io import companion


def folder_of(given: Path | None) -> Path:
    """Return the folder of the recordings.

    Args:
        given: Folder named on the command line, if any.

    Raises:
        SystemExit: No folder is given, and the distribution is not installed.
    """
    if given is not None:
        return given
    try:
        return companion.folder()
    except DataError as error:
        raise SystemExit(f"name the folder of the recordings, or install them; {error}") from error


def installed() -> Path | None:
    """Return the folder of the installed recordings; None if they are not installed."""
    try:
        return companion.folder()
    except DataError:
        return None
