"""Recordings of the companion distribution deep-hydro-sim-data: where they are, and whether they are intact.

hydro works without the distribution.  Its package has a manifest of all files, and the files themselves in
one folder.
"""

from __future__ import annotations

import hashlib
from importlib import util
from pathlib import Path

import msgspec

from hydro.core.errors import DataError, UsageError, listed
from hydro.io import table
from hydro.io.files import read_bytes

PACKAGE = "deep_hydro_sim_data"
"""Import name of the distribution."""
FORMAT = "hydro-data/1"
"""Format of the manifest of the distribution's files that this version reads."""
INSTALL = (
    "the recordings are not installed: `pip install deep_hydro_sim_data-1.0.0-py3-none-any.whl`, the wheel "
    "that packaging/data/build.py makes (datasets/README.md)"
)


class Entry(msgspec.Struct, frozen=True, omit_defaults=True):
    """Entry of the manifest for one file of the distribution.

    Attributes:
        name: File name in the folder of recordings.
        about: Description of the file's content.
        bytes: Size of the file [bytes].
        sha256: SHA-256 of the file's bytes, hexadecimal.
        rows: Number of rows of a table; 0 for other files.
        sessions: Number of sessions of a table.
        content: Hash of a table's values (`provenance.content_hash`); empty for other files.
    """

    name: str
    about: str
    bytes: int
    sha256: str
    rows: int = 0
    sessions: int = 0
    content: str = ""


class Manifest(msgspec.Struct, frozen=True):
    """List of all files of the companion distribution of recordings.

    Attributes:
        format: Name and version of the format.
        version: Version of the data.
        files: Path, size and hashes of each file.
    """

    format: str
    version: str
    files: tuple[Entry, ...]


def folder() -> Path:
    """Return the folder of the installed recordings.

    Raises:
        DataError: The distribution is not installed.
    """
    return _package() / "stonefish"


def manifest() -> Manifest:
    """Return the manifest of the installed recordings.

    Raises:
        DataError: The distribution is not installed, or its manifest is damaged or of another format.
    """
    path = _package() / "manifest.json"
    try:
        found = msgspec.json.decode(read_bytes(path), type=Manifest)
    except msgspec.MsgspecError as error:
        raise DataError(f"{path}: not a manifest ({error}): install the wheel again") from error
    if found.format != FORMAT:
        raise DataError(
            f"{path}: format {found.format}, but this hydro reads {FORMAT}: install a matching wheel"
        )
    return found


def path_of(name: str) -> Path:
    """Return the path of an installed file.

    Args:
        name: Name of the file, with or without its suffix.

    Raises:
        DataError: The distribution is not installed, or the file is missing from it.
        UsageError: The distribution has no such file.
    """
    names = [one.name for one in manifest().files]
    for found in (name, f"{name}.parquet"):
        if found in names:
            return _there(folder() / found)
    raise UsageError(f"no recording is called {name!r}: there are {listed(names)}")


def fault(entry: Entry) -> str:
    """Return one clause on the damage of an installed file; empty if the file is intact.

    Size and SHA-256 of the bytes are compared with the manifest, and for a table also the hash of the values.

    Args:
        entry: Entry of the file in the manifest.

    Raises:
        DataError: The file is missing.
    """
    path = _there(folder() / entry.name)
    content = path.read_bytes()
    if len(content) != entry.bytes:
        return f"{len(content):,} bytes, but the manifest has {entry.bytes:,}"
    if hashlib.sha256(content).hexdigest() != entry.sha256:
        return "its SHA-256 differs from the manifest's"
    if entry.content and table.read(path, "raw").provenance.content != entry.content:
        return "the hash of its values differs from the manifest's"
    return ""


def _package() -> Path:
    """Return the folder of the installed package."""
    spec = util.find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        raise DataError(INSTALL)
    return Path(spec.origin).parent


def _there(path: Path) -> Path:
    """Return a path, after a check that it exists.

    Raises:
        DataError: Nothing is at the path.
    """
    if not path.exists():
        raise DataError(f"{path}: this file of the manifest is missing: install the wheel again")
    return path
