"""Kernels whose code is compiled only as a part of their callers.

Numba optimises every kernel that a kernel calls, translates it to machine code, and wraps it for Python.
Then it links the same code into the caller, and does all of this again.  Python calls the outermost kernel
only.  An embedded kernel is therefore only typed and lowered to LLVM's intermediate code.  The caller is
optimised once, with the code of all its embedded kernels in it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.dispatcher import Dispatcher

from hydro.core.compiler_flags import quicken
from hydro.core.kernel_cache import tell_compiled

_PRIVATE = "_get_module_for_linking", "_optimize_functions", "_optimize_final_module"
"""Methods of numba's code library (0.61 to 0.68) on which the ones below rely."""
_KNOWN = all(hasattr(JITCodeLibrary, name) for name in _PRIVATE)
"""Whether all are there; otherwise kernels are compiled as numba does."""


class _Outermost(JITCodeLibrary):  # type: ignore[misc]
    """Machine code of a kernel that Python calls."""

    def _optimize_functions(self, module: Any) -> None:
        """Optimise nothing; the code is optimised as a whole, after its embedded kernels are linked."""
        module.data_layout = self._codegen._data_layout


class _Embedded(_Outermost):
    """Intermediate code of a kernel and of all that it calls, without machine code."""

    @property
    def codegen(self) -> _Embedded:
        """This library itself, in the place of numba's code generator, so that numba calls its `set_env`."""
        return self

    def set_env(self, name: str, environment: object) -> None:
        """Do nothing; numba stores a function's Python environment here, which embedded code never uses."""

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, numba's value for a function without machine code."""
        return 0

    def finalize(self) -> None:
        """Link the intermediate code of all called functions into this library, without optimising it."""
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


class _OutermostCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler, which optimises the code as a whole."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.library = _Outermost(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(function)


class _EmbeddedCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler, which keeps intermediate code only."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.library = _Embedded(self.state.targetctx.codegen(), function.__qualname__)
        compiled = super().compile_extra(function)
        tell_compiled()
        return compiled


def outermost(function: Callable[..., Any], **options: Any) -> Any:
    """Return a kernel, compiled with all kernels that it calls as one piece of code, for calls from Python.

    Args:
        function: Python function to compile.
        options: Options of `numba.njit`.
    """
    compiler = {"pipeline_class": _OutermostCompiler} if _KNOWN else {}
    return _quick(numba.njit(function, no_cfunc_wrapper=True, **compiler, **options))


def _quick(kernel: Any) -> Any:
    quicken(kernel)
    return kernel


def embedded(function: Callable[..., Any], **options: Any) -> Any:
    """Return the form of a kernel that only other kernels can call; a call from Python ends the process.

    Args:
        function: Python function, not a compiled form of it.
        options: Options of `numba.njit`.
    """
    compiler = {"pipeline_class": _EmbeddedCompiler} if _KNOWN else {}
    return _quick(numba.njit(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, **compiler, **options))


def embed(dispatcher: Any, part: Any) -> None:
    """Change a kernel's dispatcher in place, so that kernels that call the kernel use its embedded form.

    Args:
        dispatcher: Numba's dispatcher of the kernel.  A plain function stays as it is; with NUMBA_DISABLE_JIT
            kernels are plain functions.
        part: The kernel's embedded form, from `embedded`.
    """
    if isinstance(dispatcher, Dispatcher):
        kernel: Any = dispatcher  # numba's stubs do not allow another method
        kernel.get_call_template, kernel.get_overload = part.get_call_template, part.get_overload
