"""Kernels whose callers call their machine code, instead of containing a copy of it.

Numba links the code of a kernel into each of its callers, and LLVM optimises and emits every copy again.  The
code of all effects would be compiled some twenty times that way.  The code of a separate kernel is compiled
once.  Its callers refer to it by the name of its symbol, which LLVM resolves when it loads them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from numba.core import sigutils
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher


class Symbol(NamedTuple):
    """Name of the machine code of a separate kernel (`compiled.separate`) for one signature.

    Attributes:
        name: Name of the linker's symbol; it differs between compilations.
        module: Module of the kernel.
        kernel: Name of the kernel in its module.
        arguments: Numba's types of the arguments.
    """

    name: str
    module: str
    kernel: str
    arguments: tuple[Any, ...]


_DISPATCHERS: dict[tuple[str, str], Any] = {}  # every separate kernel, by its module and name
_SYMBOLS: dict[str, Symbol] = {}  # code in this process that a caller can refer to, by the symbol's name

_PRIVATE = "_get_module_for_linking", "_shared_module", "_final_module"
"""Parts of numba's code library (0.61 to 0.68) that are used; callers contain copies where one is missing."""


def separate(dispatcher: Any) -> None:
    """Change a kernel's dispatcher in place: later compiled callers call its code instead of copying it.

    Args:
        dispatcher: Numba's dispatcher of the kernel, whose `compile` then runs before a caller is linked.  A
            plain function stays as it is; with NUMBA_DISABLE_JIT kernels are plain functions.
    """
    if not isinstance(dispatcher, Dispatcher):
        return
    kernel: Any = dispatcher  # numba's stubs do not allow another `compile`
    function = kernel.py_func
    place = function.__module__, function.__qualname__
    compile_alone = kernel.compile

    def compile_separately(signature: Any) -> Any:
        with global_compiler_lock:
            entry = compile_alone(signature)
            arguments = tuple(sigutils.normalize_signature(signature)[0])
            _declare(kernel.overloads[arguments], place, arguments)
        return entry

    kernel.compile = compile_separately
    _DISPATCHERS[place] = kernel


def _declare(result: Any, place: tuple[str, str], arguments: tuple[Any, ...]) -> None:
    """Announce the symbol of compiled code to LLVM, and offer callers a declaration of it for linking."""
    library, name = result.library, result.fndesc.llvm_func_name
    if name in _SYMBOLS or not all(hasattr(library, part) for part in _PRIVATE):
        return
    kind = str(library._get_module_for_linking().get_function(name).global_value_type)
    returned, _, given = kind.partition(" (")
    llvm.add_symbol(name, library.get_pointer_to_function(name))
    library._shared_module = llvm.parse_assembly(f'declare {returned} @"{name}"({given}')
    _SYMBOLS[name] = Symbol(name, *place, arguments)


def referred(library: Any) -> list[Symbol]:
    """Return the symbols of the separate kernels that the newly compiled code of a caller calls.

    Args:
        library: Numba's code library of the caller.
    """
    if not _SYMBOLS:
        return []
    names = [function.name for function in library._final_module.functions if function.is_declaration]
    return [_SYMBOLS[name] for name in names if name in _SYMBOLS]


def are_loaded(symbols: Sequence[Symbol]) -> bool:
    """Load separate kernels from the cache, and return whether each of the given symbols exists afterwards.

    A kernel that was compiled again has a new symbol.  Code that calls an old symbol must not be loaded,
    because LLVM ends the process if it does not find a symbol.
    """
    for symbol in symbols:
        if symbol.name not in _SYMBOLS and (symbol.module, symbol.kernel) in _DISPATCHERS:
            _DISPATCHERS[symbol.module, symbol.kernel].compile(symbol.arguments)
    return all(symbol.name in _SYMBOLS for symbol in symbols)
