"""The order of arguments: the vehicle, then the data."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

Progress = Callable[[str, float], None]
"""Called with a few words and the share of the work done, from 0 to 1."""


def vehicle_first(function: Callable[P, R]) -> Callable[P, R]:
    """Accept a frame before the vehicle, the order of version 0.1, for one more version; with a warning."""

    @functools.wraps(function)
    def ordered(*given: P.args, **named: P.kwargs) -> R:
        arguments: tuple[Any, ...] = given
        if arguments and type(arguments[0]).__name__ == "DataFrame":
            warnings.warn(
                f"hydro.{function.__name__} takes the vehicle first, then the frame; the old order goes with "
                "the next version",
                DeprecationWarning,
                stacklevel=2,
            )
            if "vehicle" in named:
                arguments = (named.pop("vehicle"), *arguments)
            else:
                arguments = (*arguments[1::-1], *arguments[2:])
        return function(*arguments, **named)

    return ordered
