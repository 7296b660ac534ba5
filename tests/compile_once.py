"""Compile every numba kernel in one worker of a test run; the others wait and load it from the cache."""

from __future__ import annotations

import functools
import getpass
import hashlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from filelock import FileLock
from numba.core.ccallback import CFunc
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

LONGEST = 600.0
"""Seconds to wait for another worker's compilation: the slowest kernel takes some thirty."""


LOCKS = Path(tempfile.gettempdir()) / f"hydro-compile-{getpass.getuser()}"
"""Folder of the locks: the cache of kernels itself trusts no file that it did not write."""


@functools.cache
def lock(path: Path) -> FileLock:
    """Return the lock of one kernel's cache files; a process may enter it again while it holds it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return FileLock(path, timeout=LONGEST, thread_local=False)


def locked(compile: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap numba's method that loads or compiles a function, so that only one process at a time is in it."""

    @functools.wraps(compile)
    def wait_and_compile(function: Any, *arguments: Any) -> Any:
        files = getattr(function._cache, "_cache_file", None)
        if files is None:  # a function without a cache
            return compile(function, *arguments)
        index = hashlib.sha256(str(Path(files._cache_path, files._index_name)).encode()).hexdigest()[:32]
        # numba's own lock comes first: otherwise two threads of a process could wait for each other
        with global_compiler_lock, lock(LOCKS / f"{index}.lock"):
            return compile(function, *arguments)

    return wait_and_compile


def install() -> None:
    """Make all kernels of this process wait for workers that compile the same kernel."""
    Dispatcher.compile = locked(Dispatcher.compile)  # type: ignore[method-assign]
    CFunc.compile = locked(CFunc.compile)  # type: ignore[method-assign]
