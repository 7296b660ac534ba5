"""Reading and atomic writing of files and pipes; every failure is an error of one line."""

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
from hydro.io import pipe

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
    """Return the path of a bundled data set or vehicle file, in an installed package or a checkout.

    Args:
        name: Path within the folder of data sets, such as `vehicles/auv151.toml`.
    """
    packaged = _PACKAGE / "_datasets"
    return (packaged if packaged.is_dir() else _PACKAGE.parent / "datasets") / name


def name_of(place: Source, stream: str = "stdin") -> str:
    """Return the name of a file or stream in error messages: the path as given, or `stream` for a stream."""
    return shown(os.fspath(place)) if isinstance(place, str | Path) else stream


def explained(name: str, error: OSError) -> DataError:
    """Return (not raise) a `DataError` of one line for a failure of the operating system.

    Args:
        name: Name of the file in the message.
        error: The failure.
    """
    reason = (error.strerror or str(error) or type(error).__name__).splitlines()[0]
    remedy = _REMEDIES.get(error.errno or 0, f"{reason}: check the device and run again")
    return DataError(f"{name}: {remedy}")


def read_bytes(source: Source) -> bytes:
    """Return all bytes of a file or stream.

    Raises:
        DataError: The path cannot be read, is a device or is a pipe without a writer, or there are no bytes.
        UsageError: The stream is a terminal.
    """
    name = name_of(source)
    try:
        refuse_device(source)
        content = _content(source) if isinstance(source, str | Path) else source.read()
    except OSError as error:
        raise explained(name, error) from error
    if not content:
        raise DataError(f"{name}: empty file: did the command that should have written it fail?")
    return content


def _content(path: str | Path) -> bytes:
    """Return all bytes of a file or of a named pipe."""
    if not pipe.is_pipe(path):
        return Path(path).read_bytes()
    with pipe.opened(path) as stream:
        return stream.read()


def refuse_device(source: Source) -> None:
    """Raise an error for an input that may never end, such as a disk, a terminal or /dev/zero.

    Raises:
        DataError: The path is a device other than the null device, which is empty.
        UsageError: The stream is a terminal.
        OSError: There is no such path.
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
    """Check that a file could be written to a path, without writing it.

    Raises:
        DataError: The path is empty or a folder, or its parent folder is missing or not writable.
    """
    name = os.fspath(destination)
    _refuse_no_name(name)
    try:
        found = _found(name)
    except OSError as error:
        raise explained(name, error) from error
    if found is None or stat.S_ISREG(found.st_mode):
        _check_writable(name, Path(os.path.realpath(name)).parent)


def check_folder(destination: str | Path) -> None:
    """Check that a folder of results could be made at a path, without making it.

    Raises:
        DataError: The path is empty, a part of it is a file, or the last existing folder is not writable.
    """
    name = os.fspath(destination)
    _refuse_no_name(name)
    target = Path(os.path.realpath(name))
    if target.exists() and not target.is_dir():
        raise DataError(f"{shown(name)}: a file, not a folder: name a folder")
    _check_writable(name, next(one for one in (target, *target.parents) if one.exists()))


def _refuse_no_name(name: str) -> None:
    """Refuse an empty output path, as an unset variable of a shell leaves it."""
    if not name:
        raise DataError("the output has no name: name a file or folder")


def _check_writable(name: str, folder: Path) -> None:
    """Check that a file can be made in a folder.

    Args:
        name: Name of the file in the error message.
        folder: The folder.
    """
    if not folder.exists():
        raise explained(name, FileNotFoundError(errno.ENOENT, "no such folder"))
    if not folder.is_dir():
        raise explained(name, NotADirectoryError(errno.ENOTDIR, "not a folder"))
    if not os.access(folder, os.W_OK | os.X_OK):
        raise explained(name, PermissionError(errno.EACCES, "permission denied"))


@contextlib.contextmanager
def whole_file(destination: str | Path) -> Iterator[BinaryIO]:
    """Yield a temporary file, and rename it to `destination` at the end: a whole file or none.

    If the block fails (an error, Ctrl-C), the temporary file is removed and an existing file at `destination`
    stays unchanged.  The new file has the permissions of the old one; a read-only file is not replaced.  A
    symbolic link is followed.  A device or pipe is written to directly.

    Raises:
        DataError: The operating system refused; the message has the remedy.
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
    """Return the status of an output path, or None if nothing is there.

    The system follows links, such as that of /dev/stdout to a pipe, which has no path of its own.

    Raises:
        OSError: The path is a folder, or it is not writable.
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
    """Yield a temporary file that replaces `target` at the end, with the permissions of the file there."""
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
    """Return eight letters that identify this machine, because process numbers are local to it."""
    import socket
    import zlib

    return f"{zlib.crc32(socket.gethostname().encode()):08x}"


def _sweep(folder: Path, ours: str) -> None:
    """Remove temporary files of the destination `ours` whose process on this machine no longer exists."""
    for left in os.listdir(folder) if os.name == "posix" else ():
        if left.startswith(ours) and left.endswith(_UNFINISHED):
            owner = left.removeprefix(ours).partition("-")[0]
            if owner.isdigit() and not _alive(int(owner)):
                with contextlib.suppress(OSError):
                    (folder / left).unlink()


def _alive(process: int) -> bool:
    """Return whether a process with this number runs on this machine."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # another user's
        return True
    return True


def write_bytes(content: bytes | memoryview, destination: Source) -> None:
    """Write all of `content` to a file (atomically) or to a binary stream.

    Raises:
        DataError: The operating system refused; the message has the remedy.
        UsageError: The stream is a terminal.
        BrokenPipeError: The reader of the stream has closed; the command then ends without a message.
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
