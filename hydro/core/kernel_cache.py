"""Cache of compiled kernels on disk: its location, its ownership, and the handling of damaged files.

Numba's cache files are pickles, which execute code when they are loaded.  They are therefore read only from
folders and files that only the user and root can write.  The cache only saves time, so no fault of it ends a
command: kernels are then compiled again, and one line names the folder.
"""

from __future__ import annotations

import contextlib
import functools
import os
import pickle
import stat
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import caching
from numba.core.runtime import rtsys

from hydro.core import separate_code
from hydro.core.errors import HydroNotice, HydroWarning
from hydro.core.kernel_turns import SILENCE, Turns

COMPILING = "compiling kernels for this machine, about 15 s, only once"
"""Notice before the first kernels are compiled."""
ELSEWHERE = "name another folder in HYDRO_CACHE_DIR"
_MARK = b"hydro-kernel/1 "  # first bytes of a cache file, with the version of its format
_HEAD = len(_MARK) + 4
"""Bytes before the content of a cache file: the mark and the CRC-32 of the content."""
_WRITABLE = stat.S_IWGRP | stat.S_IWOTH  # permissions that make a file or folder untrustworthy
_Locator: Any = getattr(caching, "UserProvidedCacheLocator", None) or caching._UserProvidedCacheLocator
"""Numba's locator for a folder that the user names; it lost its underscore in version 0.62."""


@functools.cache
def folder(name: str) -> Path | None:
    """Return a folder that only the user can write to; create it if it is missing.

    The first choice is `HYDRO_CACHE_DIR`, or `hydro` in the user's cache folder.  The second is the user's
    own folder among the temporary files.  A warning gives the reason if the first is not used.

    Args:
        name: Last part of the path.

    Returns:
        The folder; None if neither is usable.
    """
    try:
        base = _base()
    except RuntimeError:  # neither HOME nor an entry in the user database, as in some containers
        where, why = "kernel cache", "there is no home folder"
    else:
        where, why = _first_fault(base, base / "hydro", base / "hydro" / name)
        if not why:
            return base / "hydro" / name
    for other in _temporary():
        if not (_fault_in(other, private=True) or _fault_in(other / name, private=True)):
            _warn(f"{where}: {why}, so compiled kernels are kept in {other}: {ELSEWHERE} to change that")
            return other / name
    _warn(f"{where}: {why}, so kernels are compiled in every run: {ELSEWHERE}")
    return None


def _base() -> Path:
    """Return the folder of caches named by the environment, otherwise the user's own.

    Raises:
        RuntimeError: The user has no home folder.
    """
    if chosen := os.environ.get("HYDRO_CACHE_DIR"):
        return Path(chosen)
    shared = os.environ.get("XDG_CACHE_HOME", "")
    return Path(shared) if Path(shared).is_absolute() else Path("~/.cache").expanduser()


def _temporary() -> list[Path]:
    """Return the user's own folder among the temporary files, if there is a folder for those."""
    try:
        return [
            Path(tempfile.gettempdir()) / (f"hydro-{os.geteuid()}" if hasattr(os, "geteuid") else "hydro")
        ]
    except FileNotFoundError:
        return []


def _first_fault(base: Path, ours: Path, kernels: Path) -> tuple[str, str]:
    """Return the first of three nested folders that is not trustworthy, and why; two '' if all are."""
    if why := _fault_above(base):
        return str(base), why
    if why := _fault_in(ours, repair=True):
        return str(ours), why
    why = _fault_in(kernels)
    return str(kernels) if why else "", why


def _fault_above(place: Path) -> str:
    """Return why folders cannot safely be created in `place`, or ''; create `place` if it is missing."""
    try:
        place.mkdir(parents=True, exist_ok=True)
        mode = place.stat().st_mode
    except OSError as error:
        return _reason(error)
    return "others can replace it" if mode & stat.S_IWOTH and not mode & stat.S_ISVTX else ""


def _fault_in(place: Path, *, repair: bool = False, private: bool = False) -> str:
    """Return why a folder is not trustworthy, or ''; create it if it is missing.

    Args:
        place: The folder.
        repair: Remove write access of others instead of refusing, for a folder whose subfolders are tested.
        private: Refuse links, folders of root, and any access of others.
    """
    try:
        with contextlib.suppress(FileExistsError):
            place.mkdir(mode=0o700)
        link, found = place.lstat(), place.stat()
        if not stat.S_ISDIR(found.st_mode) or (private and stat.S_ISLNK(link.st_mode)):
            return "it is no folder"
        if not hasattr(os, "geteuid"):
            return ""
        own = os.geteuid()
        trusted = {own} if private else {own, 0}
        if not {link.st_uid, found.st_uid} <= trusted:
            return "it belongs to another user"
        if found.st_mode & (0o077 if private else _WRITABLE):
            if not (repair and found.st_uid == own):
                return "others can write to it"
            place.chmod(stat.S_IMODE(found.st_mode) & ~_WRITABLE)
    except OSError as error:
        return _reason(error)
    return ""


def _reason(error: OSError) -> str:
    """Return the message of the operating system, in lower case."""
    return (error.strerror or str(error)).lower()


def _warn(line: str) -> None:
    warnings.warn(line, HydroWarning, stacklevel=3)


class _Saving:
    """Whether this process still writes to the cache; it stops after the first failure."""

    works = True


def _stop_saving(place: object, error: OSError) -> None:
    """Warn once that the cache cannot be written, and stop writing."""
    if _Saving.works:
        _Saving.works = False
        _warn(f"{place}: compiled kernels cannot be kept ({_reason(error)}): make room, or {ELSEWHERE}")


@functools.cache
def _warn_of_damage(place: str) -> None:
    """Warn once per folder that a file in it was rejected."""
    _warn(f"{place}: damaged or foreign compiled kernels are compiled again; remove the folder if this stays")


class _First:
    """First compilation in this process, into an empty folder.

    Attributes:
        told: Time of the last line on it [s]; None without one.
        count: Kernels compiled since it began.
    """

    told: float | None = None
    count = 0


@functools.cache
def _announce_compilation(place: str) -> None:
    """Announce once per folder that it is empty, so that kernels are compiled."""
    if not any(Path(place).rglob("*.nbi")):
        _First.told = time.monotonic()
        warnings.warn(COMPILING, HydroNotice, stacklevel=2)


def tell_compiled() -> None:
    """Count one more compiled kernel, and print the count if the last line is older than SILENCE [s]."""
    if _First.told is None:
        return
    _First.count += 1
    if time.monotonic() - _First.told > SILENCE:
        _First.told = time.monotonic()
        warnings.warn(f"compiling kernels: {_First.count} compiled", HydroNotice, stacklevel=2)


class _Files(caching.IndexDataCacheFile):  # type: ignore[misc]
    """Numba's index and data files with a checksum, read only if nobody else can have written them."""

    def _load_index(self) -> dict[Any, str]:
        content = self._content(self._index_path)
        if content is None:
            return {}
        version, stamp, overloads = pickle.loads(content)
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, self._dump((self._version, self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        content = self._content(self._data_path(name))
        if content is None:
            raise FileNotFoundError(name)  # `load` treats it as a deleted file
        return pickle.loads(content)

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), self._dump(data))

    def _content(self, path: str) -> bytes | None:
        """Return the content of a file; None if it is missing or not trustworthy."""
        try:
            with open(path, "rb") as file:
                status, whole = os.fstat(file.fileno()), file.read()
        except OSError:
            return None
        content = whole[_HEAD:]
        foreign = hasattr(os, "geteuid") and (
            status.st_uid not in (os.geteuid(), 0) or status.st_mode & _WRITABLE
        )
        if foreign or whole[:_HEAD] != _MARK + zlib.crc32(content).to_bytes(4, "little"):
            _warn_of_damage(str(Path(path).parents[1]))
            return None
        return content

    def _write(self, path: str, content: bytes) -> None:
        with self._open_for_write(path) as file:
            if hasattr(os, "fchmod"):
                os.fchmod(file.fileno(), 0o600)  # the umask may give a group write access
            file.write(_MARK + zlib.crc32(content).to_bytes(4, "little") + content)


class _Place(_Locator):  # type: ignore[misc]
    """Cache folder of a function, without numba's test of write access."""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Place | None:
        return cls(py_func, py_file) if os.path.exists(py_file) else None

    def ensure_cache_path(self) -> None:
        place = Path(self.get_cache_path())
        if fault := _fault_in(place):
            raise PermissionError(None, fault)


class _Compiled(caching.CompileResultCacheImpl):  # type: ignore[misc]
    """Numba's serialisation of compiled functions with the separate code they call, in the folder above."""

    _locator_classes = (_Place,)

    def reduce(self, cres: Any) -> Any:
        return separate_code.referred(cres.library), super().reduce(cres)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """Return the compiled function from its cached form.

        Returns:
            The function; None if separate code that it calls has been compiled again since.
        """
        symbols, compiled = payload
        return super().rebuild(target_context, compiled) if separate_code.are_loaded(symbols) else None


class KernelCache(caching.FunctionCache):  # type: ignore[misc]
    """Cache of one function's machine code on disk; a fault of the cache costs time, but raises nothing.

    Args:
        function: The Python function.
        place: Folder of the cache, which only the user can write to (`folder`).

    Raises:
        RuntimeError: The function has no source file.
    """

    _impl_class = _Compiled

    def __init__(self, function: Callable[..., Any], place: Path) -> None:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(place)
        try:
            super().__init__(function)
        finally:
            numba.config.CACHE_DIR = before
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file: Any = _Files(self._cache_path, self._impl.filename_base, stamp)
        self.turns = Turns(Path(self._cache_path) / f"{self._impl.filename_base}.lock")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function for a signature from the cache; None if it must be compiled.

        While another process compiles it, wait for the result.

        Args:
            sig: Numba's types of the arguments.
            target_context: Numba's context of the target machine.
        """
        try:
            if _fault_in_existing(self._cache_path):
                return None
            _announce_compilation(str(Path(self._cache_path).parent))
            # Numba's method would first load all that only a compilation needs, which takes 0.3 s.
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                found = self._load_overload(sig, target_context)
                if found is None and self._has_folder() and self.turns.wait():
                    found = self._load_overload(sig, target_context)
                return found
        except Exception:  # any error of numba with a file that it did not write
            _warn_of_damage(str(Path(self._cache_path).parent))
            return None

    def _has_folder(self) -> bool:
        """Return whether the folder of the kernel's files exists or can be created, and is trustworthy."""
        try:
            self._impl.locator.ensure_cache_path()
        except OSError:
            return False
        return _Saving.works

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled function `data` of the signature `sig`.

        A full or read-only disk gives a warning.
        """
        tell_compiled()
        if not _Saving.works:
            return
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _stop_saving(Path(self._cache_path).parent, error)


@functools.cache
def _fault_in_existing(place: str) -> str:
    """Return why a folder with cache files is not trustworthy; '' if it is or does not exist yet."""
    if not os.path.isdir(place):
        return ""
    if fault := _fault_in(Path(place)):
        _warn_of_damage(str(Path(place).parent))
    return fault
