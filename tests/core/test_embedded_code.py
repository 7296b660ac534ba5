"""Embedded kernels: callers contain their code, and Python calls a form of its own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from hydro.core import compiled, embedded_code
from hydro.core.compiler_flags import QuickFlags


def tripled(x: np.ndarray, out: np.ndarray) -> None:
    for i in range(x.size):
        out[i] = 3.0 * x[i]


def pair() -> tuple[Any, Any]:
    """Return a kernel, and another one that calls it twice."""
    inner = compiled.kernel(tripled)

    @compiled.kernel
    def outer(x: np.ndarray, out: np.ndarray) -> None:
        inner(x, out)
        inner(out, out)

    return inner, outer


def test_a_caller_contains_the_code_of_a_kernel_that_is_not_compiled_itself() -> None:
    inner, outer = pair()
    out = np.zeros(3)
    outer(np.arange(3.0), out)
    assert out.tolist() == [0.0, 9.0, 18.0]
    assert not inner.overloads
    (result,) = outer.overloads.values()
    defined = [one.name for one in result.library.get_defined_functions()]
    assert all("tripled" in name or "outer" in name for name in defined)


def test_python_still_calls_the_kernel_itself() -> None:
    inner, outer = pair()
    out = np.zeros(3)
    outer(np.arange(3.0), out)
    inner(np.arange(3.0), out)
    assert out.tolist() == [0.0, 3.0, 6.0]
    assert len(inner.overloads) == 1


def test_a_function_that_is_not_compiled_stays_as_it_is() -> None:
    embedded_code.embed(tripled, None)
    assert not isinstance(tripled, Dispatcher)
    assert not hasattr(tripled, "get_call_template")


def test_flags_are_equal_that_compile_an_operation_alike() -> None:
    plain, other = QuickFlags(), QuickFlags()
    plain.nrt = other.nrt = False
    other.no_cpython_wrapper, other.error_model = True, "python"  # the latter is the default
    assert plain == other
    assert hash(plain) == hash(other)
    other.fastmath = True
    assert plain != other
    assert plain != "flags"
