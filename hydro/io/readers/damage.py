"""Files that are not what they claim to be: one line for whatever a library makes of them.

What a file declares about its own sizes is not believed: no read takes more than the file still has.
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
_LARGE = 1 << 16


@contextlib.contextmanager
def reading(name: str, kind: str) -> Iterator[None]:
    """Turn every failure of the block into one line about the file.

    Libraries raise all there is on a damaged file (`struct.error`, `KeyError`, `AssertionError` and their
    own), so all is caught here, at the one place where it can only be the file.

    Raises:
        DataError: the block failed, or the library that it needs is not installed.
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
    """The first line of an error, short and printable."""
    text = (str(error) or type(error).__name__).splitlines()[0]
    return shown(text if len(text) <= 160 else f"{text[:157]}...")


class Bounded(io.BufferedReader):
    """A file whose reads are cut to what is left of it, so that no declared size is ever allocated."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        super().__init__(io.FileIO(path))
        self.size = os.stat(path).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """Read up to `size` bytes, all that are left by default."""
        if size is not None and size > _LARGE:
            size = max(0, min(size, self.size - self.tell()))
        return super().read(size)


class BoundedPath(type(pathlib.Path())):  # type: ignore[misc]
    """A path that opens its file bounded, for libraries that take no open file."""

    def open(self, *args: Any, **kwargs: Any) -> Any:
        """Open the file for reading bytes, whatever else is asked for."""
        return Bounded(self)
