"""Folders that the workbench may read and write, and names of uploaded files."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hydro.core.errors import DataError, shown

LOGS = (".mcap", ".bag", ".db3", ".bin", ".tlog", ".ulg", ".csv", ".parquet", ".npz", ".mat")
"""Endings of recordings that the page offers to open, in lower case."""
LONGEST_NAME = 120
"""Maximum length of the name of an uploaded or saved file [characters]: below the limits of file systems."""
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_. ()+-]*")
"""Pattern of such a name: no separator of folders, no control character, no leading dot."""
MOST_LISTED = 200
"""Maximum number of files that the page lists, so that a large folder does not block it."""
SKIPPED = frozenset({"node_modules", "__pycache__"})
"""Folders that are not searched for recordings."""
DEPTH = 2
"""Depth of folders that are searched for recordings and vehicle files."""


def safe_name(name: str) -> str:
    """Return the name of an uploaded file, unchanged, if it is a plain file name.

    Raises:
        DataError: The name has a folder in it, starts with a dot, is too long, or has other characters.
    """
    if len(name) > LONGEST_NAME or not NAME.fullmatch(name):
        raise DataError(
            f"file name {shown(name[:LONGEST_NAME])}: use letters, digits, spaces and . _ - + ( ), "
            f"at most {LONGEST_NAME}, without a folder"
        )
    return name


@dataclass(frozen=True)
class Places:
    """Folders and files that the workbench may read and write.

    Attributes:
        folders: Folders that are listed, read and written; the first is the default for saving.
        files: Further files that may be read.
        uploads: Private folder for uploads; `close` removes it.
    """

    folders: tuple[Path, ...]
    files: tuple[Path, ...] = ()
    uploads: Path = field(default_factory=lambda: Path(tempfile.mkdtemp(prefix="hydro-app-")))

    @classmethod
    def of(cls, folders: Iterable[str | Path], files: Iterable[str | Path] = ()) -> Places:
        """Return the places for given folders and files, with all symbolic links followed now.

        Changing a link later has therefore no effect.
        """
        return cls(tuple(Path(one).resolve() for one in folders), tuple(Path(one).resolve() for one in files))

    def close(self) -> None:
        """Remove the private folder with all uploaded files."""
        shutil.rmtree(self.uploads, ignore_errors=True)

    def readable(self, path: str | Path) -> Path:
        """Return a path with all symbolic links followed, after a check that it may be read.

        Raises:
            DataError: It is outside the folders and is not a file of the command line.
        """
        found = Path(path).resolve()
        inside = any(found.is_relative_to(one) for one in (*self.folders, self.uploads.resolve()))
        if not inside and found not in self.files:
            raise self._outside(path)
        return found

    def writable(self, path: str | Path) -> Path:
        """Return a path with all symbolic links followed, after a check that it may be written.

        Raises:
            DataError: It is outside the folders.
        """
        found = Path(path).resolve()
        if not any(found.is_relative_to(one) for one in self.folders):
            raise self._outside(path)
        return found

    def listed(self, endings: Sequence[str]) -> list[Path]:
        """Return the paths of the files with one of the given endings in or below the folders, sorted.

        Names that are not valid Unicode are left out.
        """
        found = list[Path]()
        for folder in self.folders:
            self._list(folder, DEPTH, tuple(endings), found)
        return found[:MOST_LISTED]

    def _list(self, folder: Path, depth: int, endings: tuple[str, ...], found: list[Path]) -> None:
        """Append to `found` a folder's files with one of the endings, including subfolders to a depth."""
        try:
            inside = sorted(folder.iterdir())
        except OSError:
            return
        for one in inside:
            if one.name.startswith(".") or one.is_symlink() or len(found) >= MOST_LISTED:
                continue
            if not _is_text(one.name):  # the page could not show it
                continue
            if one.is_dir() and depth > 0 and one.name not in SKIPPED:
                self._list(one, depth - 1, endings, found)
            elif one.suffix.lower() in endings and one.is_file():
                found.append(one)

    def _outside(self, path: str | Path) -> DataError:
        """Return the error for a path outside the folders."""
        named = ", ".join(map(str, self.folders))
        return DataError(f"{shown(str(path))}: outside {named}; add its folder with --folder")


def _is_text(name: str) -> bool:
    """Return whether a file name is valid Unicode; Python reads other bytes as surrogates."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True
