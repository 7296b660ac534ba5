"""Limit of linear algebra to one thread, for functions that already use several threads.

Matrices have a few dozen rows, so that more threads of linear algebra only wait for each other. On two busy
cores the fit of one recording then takes three times the processor time.  The command line sets the limit
before the library is loaded (`hydro.cli`); a program that imports `hydro` has often loaded it already.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Return a version of a function that limits linear algebra to one thread while the function runs.

    Args:
        function: The function.
    """

    @functools.wraps(function)
    def alone(*given: P.args, **named: P.kwargs) -> R:
        with _limited():
            return function(*given, **named)

    return alone


def _limited() -> AbstractContextManager[object]:
    from threadpoolctl import threadpool_limits

    limited: AbstractContextManager[object] = threadpool_limits(1, user_api="blas")
    return limited
