"""Order of arguments of the public functions: the vehicle, then the data."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

Progress = Callable[[str, float], None]
"""Function that is called with a few words on the present work and the share that is done, 0 to 1."""


def vehicle_first(function: Callable[P, R]) -> Callable[P, R]:
    """Return a version of a public function that also accepts its first two arguments in the old order.

    The old order, that of version 0.1, is the recording before the vehicle.  It is accepted for one more
    version, with a warning.

    Args:
        function: Function whose first arguments are a vehicle and a table.
    """

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
