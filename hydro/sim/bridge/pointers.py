"""Bare memory for compiled code: fields of C structs as numbers and arrays, and scratch on the stack."""

from __future__ import annotations

from typing import Any

import llvmlite.ir
import numpy as np
from numba import carray, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.compiled import jit

Integers = NDArray[np.int32]

ROOM = 160
"""Doubles of scratch that `stack` gives."""


@intrinsic  # type: ignore[untyped-decorator]
def pointer(_context: Any, address: Any) -> Any:
    """An address as a pointer."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], cgutils.voidptr_t)

    return types.voidptr(types.intp), generate


@intrinsic  # type: ignore[untyped-decorator]
def stack(_context: Any) -> Any:
    """Room for `ROOM` doubles on the stack of the calling function: no allocator in the callback."""

    def generate(_context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        room = cgutils.alloca_once(builder, llvmlite.ir.ArrayType(llvmlite.ir.DoubleType(), ROOM))
        return builder.bitcast(room, cgutils.voidptr_t)

    return types.voidptr(), generate


@intrinsic  # type: ignore[untyped-decorator]
def as_doubles(_context: Any, pointer: Any) -> Any:
    """A void pointer as a pointer to doubles."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], llvmlite.ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.voidptr), generate


@jit
def field(struct: int, at: int) -> int:
    """The 64-bit integer or pointer at a byte offset of a struct."""
    return int(carray(pointer(struct + at), (1,), np.int64)[0])


@jit
def number(struct: int, at: int) -> float:
    """The double at a byte offset of a struct."""
    return float(carray(pointer(struct + at), (1,), np.float64)[0])


@jit
def numbers(struct: int, at: int, start: int, length: int) -> Array:
    """A view of `length` doubles from entry `start` on of an array field."""
    view: Array = carray(pointer(field(struct, at) + 8 * start), (length,), np.float64)
    return view


@jit
def integers(struct: int, at: int, start: int, length: int) -> Integers:
    """A view of `length` ints from entry `start` on of an array field."""
    view: Integers = carray(pointer(field(struct, at) + 4 * start), (length,), np.int32)
    return view
