"""Kernel cache of a mutation test: a change keeps all compiled kernels that it cannot reach.

Hydro names its cache by a digest of all kernel sources, and Numba stamps each entry with a digest of its
file.  Either would discard all kernels here.  Numba loads this class by the variable
NUMBA_CACHE_LOCATOR_CLASSES.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba.core.caching import _CacheLocator  # the documented base of classes named in the variable

PLAN = "HYDRO_MUTANT"
"""Environment variable of the file that describes the change: `kernels`, `scratch` and `affected`."""


@cache
def plan() -> dict[str, Any]:
    """Return the description of the change under test."""
    return dict(json.loads(Path(os.environ[PLAN]).read_text()))


def affected(function: Callable[..., Any]) -> bool:
    """Return whether the change under test may alter the compiled code of a function."""
    return f"{function.__module__}:{function.__name__}" in plan()["affected"]


class Locator(_CacheLocator):  # type: ignore[misc]
    """Cache folder of the unchanged kernels, or a temporary one for kernels that the change reaches."""

    def __init__(self, function: Callable[..., Any]) -> None:
        folder = plan()["scratch" if affected(function) else "kernels"]
        self._folder = os.path.join(folder, function.__module__)
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Locator:
        """Return the locator of a function."""
        found = cls(py_func)
        found.ensure_cache_path()
        return found

    def get_cache_path(self) -> str:
        """Return the folder of a function's cache files."""
        return self._folder

    def get_source_stamp(self) -> str:
        """Return one stamp for all versions of a source: the folder has only one version."""
        return "one version"

    def get_disambiguator(self) -> str:
        """Return the first line of the function; a change moves no line."""
        return str(self._line)
