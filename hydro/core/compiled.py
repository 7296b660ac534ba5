"""Compile scalar kernels once per version of the sources, whichever module they stand in.

Numba keys its on-disk cache on the file of the *calling* function alone, so a kernel edited in another
module would leave stale machine code behind.  The cache folder of a layer's kernels is therefore named by a
digest of every source that they can see: the modules of the layer that compile something, and all that these
import.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba.core import sigutils
from numba.core.ccallback import CFunc
from numba.core.cpu import CPUTargetOptions

from hydro.core import kernel_cache
from hydro.core.kernel_cache import KernelCache

F = TypeVar("F", bound=Callable[..., Any])


_PACKAGE = Path(__file__).resolve().parents[1]
_IMPORTS = re.compile(
    rb"^\s*(?:from\s+(hydro[\w.]*)\s+import\s+(?:\(([^)]*)\)|(.*))|import\s+(hydro[\w.]*))", re.M
)


PARTS = ("core", "sim", "rl")
"""Layers that compile something."""


@functools.cache
def _cache_folder(part: str) -> Path | None:
    """Return the folder of compiled kernels for exactly the sources that a layer's kernels can see."""
    digest = hashlib.sha256(numba.__version__.encode())
    # sim's kernels hold offsets into MuJoCo's structs
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        digest.update(importlib.metadata.version("mujoco").encode())
    for source in kernel_sources((part,) if part in PARTS else PARTS):
        digest.update(source.read_bytes())
    return kernel_cache.folder(f"kernels-{digest.hexdigest()[:16]}")


def kernel_sources(parts: tuple[str, ...] = PARTS) -> list[Path]:
    """Sources of some layers that compile something, with all of hydro's that they import, in order."""
    text = _sources()
    own = tuple(_PACKAGE / part for part in parts)
    waiting = [
        path
        for path, source in text.items()
        if b"hydro.core.compiled" in source and any(path.is_relative_to(folder) for folder in own)
    ]
    found = set[Path]()
    while waiting:
        path = waiting.pop()
        if path not in found and path in text:
            found.add(path)
            waiting += _imported(text[path])
    return sorted(found)


@functools.cache
def _sources() -> dict[Path, bytes]:
    """Text of every module of the layers that compile something."""
    return {path: path.read_bytes() for part in PARTS for path in (_PACKAGE / part).rglob("*.py")}


def _imported(source: bytes) -> list[Path]:
    """Files that the import statements of a module may mean: a module, a package, or a module of one."""
    files = []
    for origin, listed, line, whole in _IMPORTS.findall(source):
        module = _PACKAGE.parent.joinpath(*(origin or whole).decode().split("."))
        names = re.findall(r"(\w+)(?:\s+as\s+\w+)?", (listed or line).decode())
        for path in (module, *(module / name for name in names)):
            files += [path.with_suffix(".py"), path / "__init__.py"]
    return files


def _cache(function: Callable[..., Any]) -> KernelCache | None:
    """Return the cache of a function; None where there is no folder for it, or it stands in no file."""
    place = _cache_folder(function.__module__.removeprefix("hydro.").split(".")[0])
    try:
        return None if place is None else KernelCache(function, place)
    except RuntimeError:
        return None


def jit(function: F, *, reorder_sums: bool = False, counted: bool = True, within: bool = False) -> F:
    """`numba.njit` with the cache above, or without one where there is no folder for it.

    `reorder_sums` lets the compiler add in another, fixed order, so that a long sum uses vector instructions:
    the same bits every time on one machine, rounding that may differ on another.  `counted`: see `kernel`.
    `within` puts the code into whoever calls it: an array takes seven arguments of a call.
    """
    fastmath = {"reassoc", "contract", "nsz"} if reorder_sums else False
    # said of every function: one that says nothing takes over what its first caller says
    counts = {"_nrt": counted} if hasattr(CPUTargetOptions, "_nrt") else {}
    dispatcher = numba.njit(
        function, error_model="numpy", nogil=True, fastmath=fastmath, forceinline=within, **counts
    )
    if (cache := _cache(function)) is not None:
        dispatcher._cache = cache
    return dispatcher  # type: ignore[no-any-return]


def kernel(function: F, *, reorder_sums: bool = False, within: bool = False) -> F:
    """`jit` for a function that makes no arrays, returns none, and calls none that does.

    Numba counts references to the memory behind every slice, by atomic operations that take longer than the
    arithmetic of a thruster.  Whoever calls a kernel holds its arrays meanwhile, so nothing need be counted.
    Making an array in one does not compile; that none returns one, and that all memory is given back, is
    tested.
    """
    return jit(function, reorder_sums=reorder_sums, counted=False, within=within)


def within(function: F) -> F:
    """A `kernel` whose code stands in whoever calls it, for short ones in the innermost loops."""
    return kernel(function, within=True)


@kernel
def copy_kernel(values: Any, out: Any) -> None:
    """Write a vector into another one: a slice that is assigned to a slice may need memory of its own."""
    for i in range(out.size):
        out[i] = values[i]


def cfunc(signature: Any, *, counted: bool = True) -> Callable[[F], F]:
    """`numba.cfunc` (a native function pointer, called without the GIL) with the same cache.

    `counted`: see `kernel`.
    """
    counts = {"_nrt": counted} if hasattr(CPUTargetOptions, "_nrt") else {}

    def decorate(function: F) -> F:
        types = sigutils.normalize_signature(signature)
        callback: Any = CFunc(function, types, locals={}, options={"error_model": "numpy", **counts})
        if (cache := _cache(function)) is not None:
            callback._cache = cache
        callback.compile()
        return callback  # type: ignore[no-any-return]

    return decorate
