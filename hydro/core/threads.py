"""How many threads one process may use: all processors, unless its share of the machine is said."""

from __future__ import annotations

import os

from hydro.core.errors import UsageError

VARIABLE = "HYDRO_THREADS"
"""Environment variable with the threads of a process that shares its machine with others."""


def available() -> int:
    """Threads for work that is shared among them; no result depends on how many there are.

    A worker of a cluster has a share of a machine and still sees all its processors: what starts it says how
    many are its own.

    Raises:
        UsageError: HYDRO_THREADS is not a whole number from 1.
    """
    said = os.environ.get(VARIABLE)
    if said is None:
        return os.cpu_count() or 1
    if not said.isdecimal() or int(said) < 1:
        raise UsageError(f"{VARIABLE}={said!r:.40}: set it to a whole number of threads, or unset it")
    return int(said)
