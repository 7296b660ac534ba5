"""Files other than tables, with the hash of their content in the first line, which detects damage."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from hydro.core.errors import DataError
from hydro.io import pipe
from hydro.io.files import explained, refuse_device, whole_file

_MARK = b"hydro-sealed/1 sha256:"
_LENGTH = len(_MARK) + 64 + 1


@contextlib.contextmanager
def writing(path: str | Path) -> Iterator[BinaryIO]:
    """Open a file for writing in a `with` block, which gets the binary file.

    At the end of the block the hash of the content is put before it, and the file gets its name.

    Raises:
        DataError: The operating system refused.
    """
    with whole_file(path) as stream:
        stream.write(bytes(_LENGTH))
        yield stream
        stream.flush()
        with open(stream.name, "rb") as written:
            line = _first_line(written)
        stream.seek(0)
        stream.write(line)


@contextlib.contextmanager
def reading(path: str | Path) -> Iterator[BinaryIO]:
    """Check the hash of a file, and open it in a `with` block at the beginning of its content.

    Raises:
        DataError: The file cannot be read, or was changed after it was written.
    """
    name = os.fspath(path)
    try:
        refuse_device(path)
        if pipe.is_pipe(path):
            raise DataError(f"{name}: a pipe, not a file: name a file")
        with open(path, "rb") as stream:
            line = stream.read(_LENGTH)
            if not line.startswith(_MARK) or line != _first_line(stream):
                raise DataError(f"{name}: damaged, or not written by this version")
            stream.seek(_LENGTH)
            yield stream
    except OSError as error:
        raise explained(name, error) from error


def _first_line(stream: io.BufferedReader) -> bytes:
    """Return the first line of a file with the content that follows in the stream: mark and SHA-256."""
    stream.seek(_LENGTH)
    return _MARK + hashlib.file_digest(stream, "sha256").hexdigest().encode() + b"\n"
