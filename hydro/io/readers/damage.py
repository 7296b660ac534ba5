"""Errors of one line for damaged files, whatever exception a library raises.

Sizes that a file declares are not trusted: no read requests more than the rest of the file.
"""

from __future__ import annotations

import contextlib
import io
import os
import pathlib
from collections.abc import Iterator
from typing import Any

from hydro.core.errors import DataError, HydroError, shown

EXTRA = "pip install 'deep-hydro-sim[logs]'"
"""Command that installs the libraries of readers."""
_LARGE = 1 << 16
"""Minimum size of a read that is limited to the rest of the file [bytes]."""


@contextlib.contextmanager
def reading(name: str, kind: str) -> Iterator[None]:
    """Convert every exception in a `with` block to a `DataError` of one line about the file.

    Libraries raise many exceptions on a damaged file (`struct.error`, `KeyError`, `AssertionError` and their
    own).  All are caught here, where only the file can be the cause.

    Args:
        name: Name of the file.
        kind: Kind of file in words.

    Raises:
        DataError: The block failed, or the library that it needs is not installed.
    """
    try:
        yield
    except HydroError:
        raise
    except ModuleNotFoundError as error:
        raise DataError(f"{name}: {kind} needs {error.name}, which is not installed: {EXTRA}") from error
    except Exception as error:
        raise DataError(
            f"{name}: this {kind} is damaged ({_reason(error)}): copy it again or repair it"
        ) from error


def _reason(error: Exception) -> str:
    """Return the first line of an error, short and printable."""
    text = (str(error) or type(error).__name__).splitlines()[0]
    return shown(text if len(text) <= 160 else f"{text[:157]}...")


class Bounded(io.BufferedReader):
    """Open file that never reads more than its remaining bytes, so that a wrong declared size is harmless."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        super().__init__(io.FileIO(path))
        self.size = os.stat(path).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """Return up to `size` bytes of the file; by default all that remain."""
        if size is not None and size > _LARGE:
            size = max(0, min(size, self.size - self.tell()))
        return super().read(size)


class BoundedPath(type(pathlib.Path())):  # type: ignore[misc]
    """Path that opens its file as `Bounded`, for libraries that accept no open file."""

    def open(self, *args: Any, **kwargs: Any) -> Any:
        """Open the file for reading bytes, whatever the arguments."""
        return Bounded(self)
