"""Numba's compiler flags with a quick comparison, and its messages without colours.

Numba looks up the code of every operation by a key that contains the flags of the compiled function.  It
compares all of their options, about forty, several hundred times for each kernel.  That took a fifth of the
time of a compilation.
"""

from __future__ import annotations

from typing import Any

from numba.core import errors
from numba.core.compiler import Flags

_OF_ENTRIES = frozenset({"no_cpython_wrapper", "no_cfunc_wrapper"})
"""Options that concern the entry of a function, not the code of its operations."""
_HASH = hash(Flags())  # numba's hash of flags does not depend on their values


class QuickFlags(Flags):  # type: ignore[misc]
    """Flags with which numba compiles a kernel, with a quick test of equality.

    They equal other flags under which an operation compiles to the same code.  Only options that were set are
    compared, without those that concern the entry of a function (`no_cpython_wrapper`, `no_cfunc_wrapper`).
    """

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Flags):
            return NotImplemented
        mine, its = self._values, other._values
        if mine == its:
            return True
        options = self.options
        return all(
            mine.get(name, options[name].default) == its.get(name, options[name].default)
            for name in (mine.keys() | its.keys()) - _OF_ENTRIES
        )

    def __hash__(self) -> int:
        return _HASH


def quicken(dispatcher: Any) -> None:
    """Change a kernel's dispatcher in place so that it compiles with `QuickFlags`.

    Args:
        dispatcher: Numba's dispatcher of the kernel.  A plain function stays as it is; with NUMBA_DISABLE_JIT
            kernels are plain functions.
    """
    if hasattr(dispatcher, "_compiler"):
        dispatcher._compiler._customize_flags = QuickFlags


def use_plain_messages() -> None:
    """Leave the messages of numba's errors without colours.

    Numba makes an error for every operation that does not fit, and discards it.  Where colorama is installed,
    it asks for the terminal each time, which takes a twentieth of the time of a compilation.
    """
    scheme = getattr(errors, "HighlightColorScheme", None)
    if scheme is not None:
        scheme._markup = _unchanged


def _unchanged(_: object, message: str, *__: object, **___: object) -> str:
    return message
