"""Fitted values of one effect, with the vehicle file: input of the sentence that states the effect."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import wording
from hydro.core.vehicle.description import Vehicle

CLEAR = 2.0
"""Standard errors by which a value must differ to be stated: about 95 % confidence."""
LARGEST = 1e15
"""Absolute value above which a number is treated as not finite: the fit diverged."""
ONE_SAMPLE = 1.05
"""Samples of the log up to which a delay counts as one sample."""


class Quantity(NamedTuple):
    """Fitted number of an effect, with the value in the vehicle file.

    Attributes:
        value: Fitted value.
        error: Standard error of `value`; NaN if unknown, or if the value was held fixed; infinite if the fit
            gives no value.
        before: Value in the vehicle file; 0 if the file has none.
    """

    value: float
    error: float = math.nan
    before: float = 0.0

    @property
    def change(self) -> float:
        """Fitted value minus the file's value."""
        return self.value - self.before

    @property
    def deviations(self) -> float:
        """Size of the difference from the file's value, in standard errors.

        With an unknown error it is infinite, or 0 without a difference.
        """
        if math.isnan(self.error):
            return math.inf if self.change else 0.0
        return abs(self.change) / self.error

    @property
    def clear(self) -> bool:
        """Whether the value differs from the file's value by more than CLEAR (2) standard errors."""
        return self.deviations > CLEAR

    def times(self, factor: float) -> Quantity:
        """Return the quantity multiplied by a factor, for example to change its unit."""
        return Quantity(self.value * factor, self.error * abs(factor), self.before * factor)

    def text(self, unit: str = "") -> str:
        """Return the value with its unit and standard error as text, such as `0.25 m/s (±0.01)`."""
        return wording.quantity(self.value, self.error, unit)

    def size(self, unit: str = "") -> str:
        """Return the absolute value with its unit and standard error as text, such as `0.25 m/s (±0.01)`."""
        return wording.quantity(abs(self.value), self.error, unit)

    def changed(self, unit: str = "") -> str:
        """Return the absolute difference from the file's value, with unit and standard error, as text."""
        return wording.quantity(abs(self.change), self.error, unit)


@dataclass(frozen=True)
class Case:
    """Fitted values of one effect and the vehicle file as given, from which a sentence is made.

    Attributes:
        vehicle: The vehicle file.
        name: Name of the effect, with its label if it has one.
        values: `[[effect]]` table with the fitted values, or a part of that table.
        errors: Standard errors in the shape of `values`; they may be missing, NaN, or 0 for values held
            fixed.
        dt: Sample time of the log [s].
        before: The vehicle file's `[[effect]]` table of the effect; None if the file lacks the effect.
        brief: Whether the sentence is for a headline: only the most significant of several components.
        earlier: Whether the vehicle's values are those of an earlier recording, to which it was fitted.
    """

    vehicle: Vehicle
    name: str
    values: Mapping[str, Any]
    errors: Mapping[str, Any]
    dt: float
    before: Mapping[str, Any] | None
    brief: bool = False
    earlier: bool = False

    @property
    def old_value(self) -> str:
        """Words for the value with which the fitted one is compared."""
        return "its earlier value" if self.earlier else "the file's value"

    @property
    def as_given(self) -> str:
        """Words for a value that is the one with which the fitted one is compared."""
        return "as before" if self.earlier else "as in the file"

    @property
    def in_file(self) -> bool:
        """Whether the vehicle file has the effect."""
        return self.before is not None

    @property
    def finite(self) -> bool:
        """Whether all numbers of the fitted table are finite and below LARGEST."""
        return all((np.abs(_numbers(value)) < LARGEST).all() for value in self.values.values())

    def of_file(self, key: str, shape: tuple[int, ...] = ()) -> Array:
        """Return a parameter's value in the vehicle file as an array; zeros if the file has no value.

        Args:
            key: Name of the parameter.
            shape: Shape of the result; () for a number.
        """
        return _shaped((self.before or {}).get(key, 0.0), shape, 0.0)

    def one(self, key: str) -> Quantity:
        """Return the fitted value of a parameter that is one number; if not fitted, the file's value or 0.

        Args:
            key: Name of the parameter.
        """
        return self.many(key, ())[0]

    def many(self, key: str, shape: tuple[int, ...]) -> list[Quantity]:
        """Return the components of a parameter in one list, matrices row by row.

        A component that was not fitted has the file's value, or 0.

        Args:
            key: Name of the parameter.
            shape: Shape of the parameter's array; () for a number.
        """
        before = self.of_file(key, shape)
        given = key in self.values
        values = _shaped(self.values[key], shape, math.nan) if given else before
        errors = _shaped(self.errors.get(key, math.nan), shape, math.nan)
        return [
            estimate(*entry)
            for entry in zip(
                values.ravel().tolist(), errors.ravel().tolist(), before.ravel().tolist(), strict=True
            )
        ]

    def error_of(self, key: str, shape: tuple[int, ...]) -> list[float]:
        """Return the standard errors of a parameter's components, row by row; NaN where none is given.

        Args:
            key: Name of the parameter.
            shape: Shape of the parameter; () for a number.
        """
        errors: list[float] = _shaped(self.errors.get(key, math.nan), shape, math.nan).ravel().tolist()
        return errors

    def sampled(self, time: float) -> str:
        """Return a clause that a fitted time is at most one sample of the log; empty if the time is longer.

        Args:
            time: Fitted time, such as a delay [s].
        """
        short = 0.0 < abs(time) <= ONE_SAMPLE * self.dt
        return ", no more than one sample of the log" if short else ""


def estimate(value: float, error: float, before: float = 0.0) -> Quantity:
    """Return a quantity from a fitted value, its standard error and the file's value.

    A value that is not finite is replaced by the file's value with an infinite error.

    Args:
        value: Fitted value.
        error: Its standard error; NaN if unknown.
        before: Value in the vehicle file; 0 if the file has none.
    """
    if not abs(value) < LARGEST:
        return Quantity(before, math.inf, before)
    return Quantity(value, math.nan if math.isnan(error) or error <= 0.0 else error, before)


def _numbers(given: Any) -> Array:
    """Return numbers as an array; an empty one if they are not numbers."""
    try:
        return np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        return np.zeros(0)


def _shaped(given: Any, shape: tuple[int, ...], otherwise: float) -> Array:
    """Return numbers in a shape, filled with `otherwise` if they have another shape or are not numbers."""
    try:
        found = np.asarray(given, dtype=np.float64)
        return np.array(np.broadcast_to(found, shape))
    except (TypeError, ValueError):
        return np.full(shape, otherwise)
