"""Raw memory access for compiled code: fields of C structs as numbers and arrays, and stack buffers.

Arrays made here are views of foreign memory, without reference counts and without bounds checks.  A slice by
`part` costs one addition; a slice by brackets costs a dozen comparisons.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import llvmlite.ir
import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array
from numpy.typing import NDArray

F = TypeVar("F", bound=Callable[..., Any])
Integers = NDArray[np.int32]

ROOM = 160
"""Number of doubles in a `stack` buffer."""

_DOUBLES, _SINGLES, _INTEGERS = (
    types.Array(kind, 1, "C") for kind in (types.float64, types.float32, types.int32)
)


def _load(kind: Any) -> Any:
    """Return the code that reads one number of a type at a byte offset of a struct."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        at = builder.inttoptr(builder.add(*arguments), context.get_value_type(kind).as_pointer())
        return builder.load(at)

    return kind(types.intp, types.intp), generate


def inlined(function: F) -> F:
    """Return a function compiled inline in its callers, because a view of memory cannot be returned."""
    return numba.njit(function, inline="always")  # type: ignore[no-any-return]


@intrinsic  # type: ignore[untyped-decorator]
def field(_context: Any, struct: Any, at: Any) -> Any:
    """Implement, for numba, `field(struct, at)`: the 64-bit integer or pointer at a byte offset."""
    return _load(types.int64)


@intrinsic  # type: ignore[untyped-decorator]
def choice(_context: Any, struct: Any, at: Any) -> Any:
    """Implement, for numba, `choice(struct, at)`: the 32-bit int at a byte offset of a struct."""
    return _load(types.int32)


@intrinsic  # type: ignore[untyped-decorator]
def number(_context: Any, struct: Any, at: Any) -> Any:
    """Implement, for numba, `number(struct, at)`: the double at a byte offset of a C struct."""
    return _load(types.float64)


@intrinsic  # type: ignore[untyped-decorator]
def stack(_context: Any) -> Any:
    """Implement, for numba, `stack()`: a buffer of `ROOM` doubles on the caller's stack."""

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        room = cgutils.alloca_once(builder, llvmlite.ir.ArrayType(llvmlite.ir.DoubleType(), ROOM))
        return _view(
            context, builder, _DOUBLES, builder.bitcast(room, cgutils.voidptr_t), cgutils.intp_t(ROOM)
        )

    return _DOUBLES(), generate


@intrinsic  # type: ignore[untyped-decorator]
def as_doubles(_context: Any, array: Any) -> Any:
    """Implement, for numba, `as_doubles(array)`: the pointer to an array of doubles."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return make_array(array)(context, builder, arguments[0]).data

    return types.CPointer(types.float64)(array), generate


def _view(context: Any, builder: Any, kind: Any, data: Any, length: Any) -> Any:
    """Return an array of the given length at a pointer."""
    width = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    array = make_array(kind)(context, builder)
    at = builder.bitcast(data, context.get_data_type(kind.dtype).as_pointer())
    populate_array(
        array, data=at, shape=[length], strides=[cgutils.intp_t(width)], itemsize=width, meminfo=None
    )
    return array._getvalue()


def _of_a_field(kind: Any) -> Any:
    """Return signature and code of `numbers` or `integers`, for numbers of the array type `kind`."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        struct, at, start, length = arguments
        place = builder.inttoptr(builder.add(struct, at), cgutils.intp_t.as_pointer())
        width = cgutils.intp_t(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
        begin = builder.add(builder.load(place), builder.mul(start, width))
        return _view(context, builder, kind, builder.inttoptr(begin, cgutils.voidptr_t), length)

    return kind(types.intp, types.intp, types.intp, types.intp), generate


def _of_an_array(kind: Any, whole: Any) -> Any:
    """Return signature and code of `part` or `singles`: views of type `kind` into arrays of type `whole`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = make_array(whole)(context, builder, arguments[0])
        at = builder.bitcast(builder.gep(array.data, [arguments[1]]), cgutils.voidptr_t)
        return _view(context, builder, kind, at, arguments[2])

    return kind(whole, types.intp, types.intp), generate


@intrinsic  # type: ignore[untyped-decorator]
def numbers(_context: Any, struct: Any, at: Any, start: Any, length: Any) -> Any:
    """Implement, for numba, `numbers(struct, at, start, length)`: a view of an array field of doubles.

    The field is at the byte offset `at`; the view has `length` entries, from entry `start`.
    """
    return _of_a_field(_DOUBLES)


@intrinsic  # type: ignore[untyped-decorator]
def integers(_context: Any, struct: Any, at: Any, start: Any, length: Any) -> Any:
    """Implement, for numba, `integers(struct, at, start, length)`: a view of an array field of ints.

    The field is at the byte offset `at` of the struct; the view has `length` entries, from entry `start`.
    """
    return _of_a_field(_INTEGERS)


@intrinsic  # type: ignore[untyped-decorator]
def part(_context: Any, array: Any, start: Any, length: Any) -> Any:
    """Implement, for numba, `part(array, start, length)`: a view of doubles of an array of doubles."""
    return _of_an_array(_DOUBLES, array)


@intrinsic  # type: ignore[untyped-decorator]
def singles(_context: Any, array: Any, start: Any, length: Any) -> Any:
    """Implement, for numba, `singles(array, start, length)`: a view of float32 stored in an array of doubles.

    The view has `length` float32 numbers, from number `start`.
    """
    return _of_an_array(_SINGLES, array)
