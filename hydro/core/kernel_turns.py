"""Turns of processes that need the same kernel: the first compiles it, the others wait and load its code.

Workers of a study, nodes of a cluster on one machine, and two commands in two shells would otherwise compile
the same kernels at the same time.
"""

from __future__ import annotations

import contextlib
import functools
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import filelock
from numba.core.compiler_lock import global_compiler_lock

from hydro.core.errors import HydroNotice

SILENCE = 3.0
"""Longest time without a line while kernels are compiled [s]."""
LONGEST = 120.0
"""Maximum time to wait for another process [s]; the slowest kernel takes some twenty on a busy machine."""
WAITING = "another process compiles kernels, which takes some seconds: waiting for it"


class Turns:
    """Lock of one kernel, which the operating system releases when its process ends.

    Args:
        path: Lock file; its folder exists once `wait` is called.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._open = path, list[contextlib.ExitStack]()

    @contextlib.contextmanager
    def limited(self) -> Iterator[None]:
        """Release the lock at the end of a `with` block, if `wait` took it inside."""
        with contextlib.ExitStack() as stack:
            self._open.append(stack)
            try:
                yield
            finally:
                self._open.pop()

    def wait(self) -> bool:
        """Wait for the lock and hold it to the end of the `limited` block; return whether it is held.

        It is not held outside of such a block, where files cannot be locked, or after LONGEST.
        """
        if not self._open:
            return False
        lock = filelock.FileLock(self._path)
        try:
            try:
                lock.acquire(timeout=SILENCE)
            except filelock.Timeout:
                _announce_waiting()
                lock.acquire(timeout=LONGEST)
        except (OSError, NotImplementedError):  # `filelock.Timeout` is an OSError, too
            return False
        self._open[-1].callback(lock.release)
        return True


def compile_in_turns(compiling: Any, turns: Turns) -> None:
    """Change a dispatcher or callback of numba in place, so that a lock lasts for one compilation.

    Args:
        compiling: Object whose method `compile` loads or compiles a kernel.  A plain function stays as it is;
            with NUMBA_DISABLE_JIT kernels are plain functions.
        turns: Lock of the kernel, for which its cache waits.
    """
    if not hasattr(compiling, "compile"):
        return
    compile_alone = compiling.compile

    def compile_in_turn(*signature: Any) -> Any:
        # numba's own lock comes first: otherwise two threads of a process could wait for each other
        with global_compiler_lock, turns.limited():
            return compile_alone(*signature)

    compiling.compile = compile_in_turn


@functools.cache
def _announce_waiting() -> None:
    """Print once that this process waits for another one."""
    warnings.warn(WAITING, HydroNotice, stacklevel=2)
