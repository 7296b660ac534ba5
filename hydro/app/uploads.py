"""Uploads of files from the page, stored under safe names in the private folder of the server."""

from __future__ import annotations

import secrets
from collections.abc import AsyncIterator
from pathlib import Path

from hydro.app.places import LOGS, Places, safe_name
from hydro.core.errors import DataError

ACCEPTED = (*LOGS, ".toml")
"""Endings of files that may be uploaded: recordings, maps and vehicle files."""


async def store(places: Places, name: str, chunks: AsyncIterator[bytes], largest: int) -> Path:
    """Store an upload piece by piece, and return its path.

    Args:
        places: Folders of the server.
        name: Name of the file that the browser gives.
        chunks: Content of the file.
        largest: Maximum size [bytes].

    Raises:
        DataError: The name is not plain, its ending is not one of ACCEPTED, the file is too large or empty,
            or the upload broke off.
    """
    name = safe_name(name)
    if not name.lower().endswith(ACCEPTED):
        raise DataError(f"{name}: not a log, a table, a map or a vehicle file ({' '.join(ACCEPTED)})")
    folder = places.uploads / secrets.token_hex(8)
    folder.mkdir(mode=0o700)
    path, size = folder / name, 0
    try:
        with path.open("wb") as file:
            async for chunk in chunks:
                size += len(chunk)
                if size > largest:
                    raise DataError(f"{name}: larger than {largest // 1_000_000} MB; see --max-upload")
                file.write(chunk)
        if not size:
            raise DataError(f"{name}: the file is empty")
    except BaseException:
        path.unlink(missing_ok=True)
        folder.rmdir()
        raise
    return path
