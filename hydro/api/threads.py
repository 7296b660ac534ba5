"""One thread of linear algebra during a call: its own threads are shared among shots and windows already.

Matrices have a few dozen rows, and threads of the linear algebra beside the call's own only wait for one
another: on two busy cores the problem of one recording took three times the processor time.  The command line
says so to the library before it is loaded (`hydro.cli`); a program that imports `hydro` has loaded it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function, run with one thread of linear algebra."""

    @functools.wraps(function)
    def alone(*given: P.args, **named: P.kwargs) -> R:
        with _limited():
            return function(*given, **named)

    return alone


def _limited() -> AbstractContextManager[object]:
    from threadpoolctl import threadpool_limits

    limited: AbstractContextManager[object] = threadpool_limits(1, user_api="blas")
    return limited
