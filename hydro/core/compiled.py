"""Compilation of scalar kernels, once per version of all sources that a kernel uses.

Numba keys its on-disk cache on the file of the function alone.  A kernel edited in another module would
therefore leave stale machine code.  Here, the name of a layer's cache folder contains a digest of every
source that its kernels can use: the modules of the layer that compile something, and all their imports.
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

from hydro.core import kernel_cache, separate_code
from hydro.core.compiler_flags import use_plain_messages
from hydro.core.embedded_code import embed, embedded, outermost
from hydro.core.kernel_cache import KernelCache
from hydro.core.kernel_turns import compile_in_turns

F = TypeVar("F", bound=Callable[..., Any])
use_plain_messages()


_PACKAGE = Path(__file__).resolve().parents[1]
_IMPORTS = re.compile(
    rb"^\s*(?:from\s+(hydro[\w.]*)\s+import\s+(?:\(([^)]*)\)|(.*))|import\s+(hydro[\w.]*))", re.M
)


PARTS = ("core", "sim", "rl")
"""Layers with compiled functions."""


@functools.cache
def _cache_folder(part: str) -> Path | None:
    """Return the folder of compiled kernels for exactly the sources that a layer's kernels can use."""
    digest = hashlib.sha256(numba.__version__.encode())
    # The kernels of sim contain offsets into MuJoCo's structs.
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        digest.update(importlib.metadata.version("mujoco").encode())
    for source in kernel_sources((part,) if part in PARTS else PARTS):
        digest.update(source.read_bytes())
    return kernel_cache.folder(f"kernels-{digest.hexdigest()[:16]}")


def kernel_sources(parts: tuple[str, ...] = PARTS) -> list[Path]:
    """Return the source files on which compiled kernels depend, sorted.

    They are the modules that compile something, and all hydro modules that these import.

    Args:
        parts: Layers whose compiling modules count, some of PARTS; imported modules count from every layer.
    """
    sources = _sources()
    own = tuple(f"hydro.{part}." for part in parts)
    waiting = [
        name for name, (_, text) in sources.items() if b"hydro.core.compiled" in text and name.startswith(own)
    ]
    found = set[str]()
    while waiting:
        name = waiting.pop()
        if name not in found and name in sources:
            found.add(name)
            waiting += _imported(sources[name][1])
    return sorted(sources[name][0] for name in found)


@functools.cache
def _sources() -> dict[str, tuple[Path, bytes]]:
    """Return file and text of every module in the layers with compiled functions, by the module's name."""
    files = [path for part in PARTS for path in (_PACKAGE / part).rglob("*.py")]
    names = [".".join(path.parts[len(_PACKAGE.parts) - 1 :])[: -len(".py")] for path in files]
    return {
        name.removesuffix(".__init__"): (path, path.read_bytes())
        for name, path in zip(names, files, strict=True)
    }


def _imported(source: bytes) -> list[str]:
    """Return the names of modules that a module's imports may refer to: a module or one in a package."""
    names = []
    for origin, listed, line, whole in _IMPORTS.findall(source):
        module = (origin or whole).decode()
        within = re.findall(r"(\w+)(?:\s+as\s+\w+)?", (listed or line).decode())
        names += [module, *(f"{module}.{name}" for name in within)]
    return names


def _cache(function: Callable[..., Any]) -> KernelCache | None:
    """Return the cache of a function; None without a cache folder or a source file."""
    place = _cache_folder(function.__module__.removeprefix("hydro.").split(".")[0])
    try:
        return None if place is None else KernelCache(function, place)
    except RuntimeError:
        return None


def jit(
    function: F,
    *,
    reorder_sums: bool = False,
    counted: bool = True,
    within: bool = False,
    embeds: bool = True,
) -> F:
    """Return a function compiled with `numba.njit`; the machine code is cached on disk.

    Args:
        function: Python function to compile.
        reorder_sums: Allow another, fixed order of additions, so that long sums use vector instructions.  The
            result is reproducible on one machine; its rounding may differ on another.
        counted: Count references to arrays; a function that allocates or returns an array needs the count.
        within: Inline the code into its callers; otherwise a call passes seven arguments per array.
        embeds: Give other kernels an uncompiled form, which is compiled as a part of their code
            (`embedded_code`).
    """
    options = _options(counted=counted, within=within, reorder_sums=reorder_sums)
    if reorder_sums:  # as a part of other code it might add in another order
        dispatcher: Any = numba.njit(function, no_cfunc_wrapper=True, **options)
    else:
        dispatcher = outermost(function, **options)
        if embeds:
            embed(dispatcher, embedded(function, **options))
    if (cache := _cache(function)) is not None:
        dispatcher._cache = cache
        compile_in_turns(dispatcher, cache.turns)
    return dispatcher  # type: ignore[no-any-return]


def kernel(function: F, *, reorder_sums: bool = False, within: bool = False, embeds: bool = True) -> F:
    """Return a compiled function without reference counts: it must not allocate or return arrays.

    The function must not call a function that does so, either.  Numba counts references to the memory of
    every slice, with atomic operations that take longer than the arithmetic of a thruster.  The caller of a
    kernel holds its arrays, so counting is unnecessary.  A kernel that allocates an array does not compile.

    Args:
        function: Python function to compile.
        reorder_sums: Allow another, fixed order of additions, so that long sums use vector instructions.
        within: Inline the code into its callers.
        embeds: Give other kernels an uncompiled form, which is compiled as a part of their code.
    """
    return jit(function, reorder_sums=reorder_sums, counted=False, within=within, embeds=embeds)


def within(function: F) -> F:
    """Return a compiled `kernel` that is inlined into its callers, for short functions in inner loops."""
    return kernel(function, within=True)


def separate(function: F) -> F:
    """Return a compiled `kernel` for a long function: callers do not contain a copy of its code."""
    compiled = kernel(function, embeds=False)
    separate_code.separate(compiled)
    return compiled


def inlined_copy(function: F) -> F:
    """Return a copy of a `kernel` that is inlined into its callers, while the original is not.

    A call passes seven arguments per array, which takes longer than the arithmetic of a small effect.  Python
    cannot call the copy.
    """
    return embedded(  # type: ignore[no-any-return]
        getattr(function, "py_func", function), **_options(counted=False, within=True)
    )


def _options(*, counted: bool, within: bool = False, reorder_sums: bool = False) -> dict[str, Any]:
    """Return numba's options for those of `jit`."""
    # Set explicitly for every function; otherwise it would inherit the setting of its first caller.
    counts = {"_nrt": counted} if hasattr(CPUTargetOptions, "_nrt") else {}
    fastmath = {"reassoc", "contract", "nsz"} if reorder_sums else False
    return {"error_model": "numpy", "nogil": True, "fastmath": fastmath, "forceinline": within, **counts}


@kernel
def copy_kernel(values: Any, out: Any) -> None:
    """Copy the vector `values` to `out`, of the same length, without allocating memory."""
    for i in range(out.size):
        out[i] = values[i]


def cfunc(signature: Any, *, counted: bool = True) -> Callable[[F], F]:
    """Return a decorator that compiles a function with `numba.cfunc` and caches the machine code on disk.

    C code can call the compiled function by its address, without Python's global lock.

    Args:
        signature: Types of the result and of the arguments, in the form that `numba.cfunc` takes.
        counted: Whether references to arrays are counted; False is faster, and possible for a function that
            allocates and returns no array.
    """
    counts = {"_nrt": counted} if hasattr(CPUTargetOptions, "_nrt") else {}

    def decorate(function: F) -> F:
        types = sigutils.normalize_signature(signature)
        callback: Any = CFunc(function, types, locals={}, options={"error_model": "numpy", **counts})
        if (cache := _cache(function)) is not None:
            callback._cache = cache
            compile_in_turns(callback, cache.turns)
        callback.compile()
        return callback  # type: ignore[no-any-return]

    return decorate
