"""Bytes in and out of files and pipes: whole or not at all, and every failure reported in one line."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from hydro.core.errors import DataError, UsageError
from hydro.core.errors import shown as shown  # for those who name places by `name_of`

Source = str | Path | BinaryIO

_REMEDIES = {
    errno.ENOENT: "no such file or folder: check the path",
    errno.ENOTDIR: "part of this path is a file, not a folder: check the path",
    errno.EISDIR: "this is a folder: name a file in it",
    errno.EACCES: "permission denied: change the file's rights or choose another place",
    errno.EPERM: "permission denied: change the file's rights or choose another place",
    errno.EROFS: "this file system is read-only: choose another place",
    errno.ENOSPC: "no space left on the device: free some and run again",
    errno.EDQUOT: "disk quota exceeded: free some space and run again",
    errno.EFBIG: "file too large for this file system or user: choose another place",
    errno.EBADF: "closed: leave it open, or name a file",
    errno.ENAMETOOLONG: "file name too long: choose a shorter one",
}


_UNFINISHED = ".tmp"  # ending of temporary files
_PACKAGE = Path(__file__).resolve().parents[1]


def bundled(name: str) -> Path:
    """A bundled data set or vehicle file, inside an installed package or beside it in a checkout."""
    packaged = _PACKAGE / "_datasets"
    return (packaged if packaged.is_dir() else _PACKAGE.parent / "datasets") / name


def name_of(place: Source, stream: str = "stdin") -> str:
    """What an error line calls this place: the path as given, or `stream` for a stream."""
    return shown(os.fspath(place)) if isinstance(place, str | Path) else stream


def explained(name: str, error: OSError) -> DataError:
    """The one-line error for a failure of the operating system at `name`."""
    reason = (error.strerror or str(error) or type(error).__name__).splitlines()[0]
    remedy = _REMEDIES.get(error.errno or 0, f"{reason}: check the device and run again")
    return DataError(f"{name}: {remedy}")


def read_bytes(source: Source) -> bytes:
    """All bytes of a file, or of a stream up to its end.

    Raises:
        DataError: the path cannot be read or is a device, or nothing came in.
        UsageError: the stream is a terminal.
    """
    name = name_of(source)
    try:
        refuse_device(source)
        content = Path(source).read_bytes() if isinstance(source, str | Path) else source.read()
    except OSError as error:
        raise explained(name, error) from error
    if not content:
        raise DataError(
            f"{name}: empty, not a single byte: did the command that should have written it fail?"
        )
    return content


def refuse_device(source: Source) -> None:
    """Refuse an input that may never end: a disk, a terminal or /dev/zero; files and pipes pass.

    Raises:
        DataError: it is a device, and not the null device, which is empty.
        UsageError: the stream is a terminal.
        OSError: there is no such path.
    """
    if isinstance(source, str | Path):
        found = os.stat(source)
    elif source.isatty():
        raise UsageError("nothing is piped in: name a file, or pipe a command into this one")
    else:
        try:
            found = os.fstat(source.fileno())
        except io.UnsupportedOperation:  # bytes in memory
            return
    device = stat.S_ISBLK(found.st_mode) or stat.S_ISCHR(found.st_mode)
    if device and not os.path.samestat(found, os.stat(os.devnull)):
        raise DataError(f"{name_of(source)}: a device, not a file: name a file, or pipe a command into -")


def check_file(destination: str | Path) -> None:
    """Refuse a place that `whole_file` could not write to; nothing is written.

    Raises:
        DataError: it is a folder, or its folder is missing or cannot be written to.
    """
    name = os.fspath(destination)
    try:
        found = _found(name)
    except OSError as error:
        raise explained(name, error) from error
    if found is None or stat.S_ISREG(found.st_mode):
        _check_writable(name, Path(os.path.realpath(name)).parent)


def check_folder(destination: str | Path) -> None:
    """Refuse a place that no folder of results can be made at; nothing is made.

    Raises:
        DataError: it or a part of its path is a file, or the last folder that exists cannot be written to.
    """
    name = os.fspath(destination)
    target = Path(os.path.realpath(name))
    if target.exists() and not target.is_dir():
        raise DataError(f"{shown(name)}: a file, not a folder: name a folder")
    _check_writable(name, next(one for one in (target, *target.parents) if one.exists()))


def _check_writable(name: str, folder: Path) -> None:
    """Refuse a folder in which no file can be made."""
    if not folder.exists():
        raise explained(name, FileNotFoundError(errno.ENOENT, "no such folder"))
    if not folder.is_dir():
        raise explained(name, NotADirectoryError(errno.ENOTDIR, "not a folder"))
    if not os.access(folder, os.W_OK | os.X_OK):
        raise explained(name, PermissionError(errno.EACCES, "permission denied"))


@contextlib.contextmanager
def whole_file(destination: str | Path) -> Iterator[BinaryIO]:
    """Open a temporary file beside `destination` and rename it when the block ends well.

    Whatever ends the block early (an error, Ctrl-C) removes the temporary file and leaves a former file at
    `destination` as it was.  The new file has the rights of the former one, and takes the place of none that
    may not be written.  A symbolic link is followed; a device or a pipe is written to directly.

    Raises:
        DataError: the operating system refused; the line says what to do.
    """
    name = os.fspath(destination)
    try:
        found = _found(name)
        if found is not None and not stat.S_ISREG(found.st_mode):
            with open(name, "wb") as device:
                yield device
            return
        with _replacing(Path(os.path.realpath(name)), found) as stream:
            yield stream
    except BrokenPipeError:
        raise
    except OSError as error:
        raise explained(name, error) from error


def _found(name: str) -> os.stat_result | None:
    """Return what is at a place that is to be written; None where nothing is.

    The system follows links, as that of /dev/stdout to a pipe, which has no path of its own.

    Raises:
        OSError: It is a folder, or may not be written.
    """
    try:
        found = os.stat(name)
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, "is a folder")
    if not os.access(name, os.W_OK):
        raise PermissionError(errno.EACCES, "permission denied")
    return found


@contextlib.contextmanager
def _replacing(target: Path, former: os.stat_result | None) -> Iterator[BinaryIO]:
    """Yield the temporary file that takes the place of `target` at the end, with the rights of the former."""
    ours = f".{target.name}.{_machine()}-"
    _sweep(target.parent, ours)
    temporary = target.with_name(f"{ours}{os.getpid()}-{secrets.token_hex(2)}{_UNFINISHED}")
    try:
        with open(temporary, "xb") as stream:
            if former is not None:
                os.chmod(temporary, stat.S_IMODE(former.st_mode))
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise


def _machine() -> str:
    """Eight letters for this machine: processes are numbered on it."""
    import socket
    import zlib

    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def _sweep(folder: Path, ours: str) -> None:
    """Remove the temporary files of this name that processes of this machine left when they were killed."""
    for left in os.listdir(folder) if os.name == "posix" else ():
        if left.startswith(ours) and left.endswith(_UNFINISHED):
            owner = left.removeprefix(ours).partition("-")[0]
            if owner.isdigit() and not _alive(int(owner)):
                with contextlib.suppress(OSError):
                    (folder / left).unlink()


def _alive(process: int) -> bool:
    """Whether there is a process of this number."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # another user's
        return True
    return True


def write_bytes(content: bytes | memoryview, destination: Source) -> None:
    """Write all of `content` to a file (whole or not at all) or to a binary stream.

    Raises:
        DataError: the operating system refused; the line says what to do.
        UsageError: the stream is a terminal.
        BrokenPipeError: the reader of the stream is gone; the shell ends quietly.
    """
    if isinstance(destination, str | Path):
        with whole_file(destination) as stream:
            stream.write(content)
        return
    try:
        if destination.isatty():
            raise UsageError(
                "a table is binary and stdout is a terminal: add -o FILE, or pipe it into the next command"
            )
        destination.write(content)
        destination.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise explained(name_of(destination, "stdout"), error) from error
