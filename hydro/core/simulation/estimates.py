"""Estimated parameters of a vehicle file with their covariance: tables, subsets and random draws.

A random draw is a vehicle whose estimated values are normally distributed about the estimates, with their
covariance.  Values beyond the plausible range of a parameter are clipped to the range.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec
import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.effects import CATALOGUE
from hydro.core.vehicle.description import Vehicle

AGREES = 0.02
"""Difference of a rounded value in a file from its estimate that is allowed, in standard errors."""


class Place(Protocol):
    """Address of one number in a vehicle file: name of the effect, name of the parameter, and index."""

    @property
    def effect(self) -> str:
        """Name of the effect."""

    @property
    def parameter(self) -> str:
        """Name of the parameter."""

    @property
    def index(self) -> tuple[int, ...]:
        """Index in the parameter's array; () for a scalar."""


@dataclass(frozen=True)
class Estimate:
    """Estimated number in the effects of a vehicle file.

    Attributes:
        effect: Name of the effect.
        parameter: Name of the parameter.
        index: Index in the parameter's array; () for a scalar.
        unit: Unit of the number.
        value: The number in the file.
    """

    effect: str
    parameter: str
    index: tuple[int, ...]
    unit: str
    value: float

    @property
    def name(self) -> str:
        """Name of the number, such as `linear_damping.diagonal[0]`."""
        return f"{self.effect}.{self.parameter}" + "".join(f"[{i}]" for i in self.index)


@dataclass(frozen=True)
class Estimates:
    """Estimated numbers of a vehicle file, with their covariance.

    Attributes:
        entries: The P numbers.
        covariance: Covariance of the numbers, (P, P), in their units.
    """

    entries: tuple[Estimate, ...]
    covariance: Array

    @property
    def values(self) -> Array:
        """Estimated values, (P,)."""
        return np.array([entry.value for entry in self.entries])

    @property
    def errors(self) -> Array:
        """Standard errors of the values, (P,), in their units."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def frame(self) -> pl.DataFrame:
        """Return the covariance table, with a row for each number.

        Its columns are `effect`, `parameter`, `index`, `unit`, `value`, `standard_error` and `correlation`, a
        list with the correlation with every number.
        """
        errors = np.maximum(self.errors, np.finfo(float).tiny)
        correlation = np.clip(self.covariance / np.outer(errors, errors), -1.0, 1.0)
        return pl.DataFrame(
            {
                "effect": [entry.effect for entry in self.entries],
                "parameter": [entry.parameter for entry in self.entries],
                "index": pl.Series([list(entry.index) for entry in self.entries], dtype=pl.List(pl.Int64)),
                "unit": [entry.unit for entry in self.entries],
                "value": self.values,
                "standard_error": self.errors,
                "correlation": correlation.tolist(),
            }
        )

    @classmethod
    def of(cls, frame: pl.DataFrame) -> Estimates:
        """Return the estimates that a covariance table contains; the inverse of the method `frame`."""
        entries = tuple(
            Estimate(row["effect"], row["parameter"], tuple(row["index"]), row["unit"], row["value"])
            for row in frame.iter_rows(named=True)
        )
        errors = frame["standard_error"].to_numpy()
        return cls(entries, np.array(frame["correlation"].to_list(), float) * np.outer(errors, errors))

    def of_effects(self, names: Sequence[str]) -> Estimates:
        """Return a new set with the estimates of the named effects alone, and their covariance."""
        kept = [i for i, entry in enumerate(self.entries) if entry.effect in names]
        return Estimates(tuple(self.entries[i] for i in kept), self.covariance[np.ix_(kept, kept)])

    def after(self, earlier: Estimates | None) -> Estimates:
        """Return these estimates together with earlier estimates of other effects, as one new set.

        For an effect in both sets, these estimates count.  The two sets are assumed to be independent.

        Args:
            earlier: Earlier estimates, which come first in the result; None for none.
        """
        if earlier is None:
            return self
        own = {entry.effect for entry in self.entries}
        kept = earlier.of_effects([entry.effect for entry in earlier.entries if entry.effect not in own])
        first = len(kept.entries)
        both = np.zeros((first + len(self.entries),) * 2)
        both[:first, :first], both[first:, first:] = kept.covariance, self.covariance
        return Estimates((*kept.entries, *self.entries), both)

    def disagreement(self, vehicle: Vehicle) -> str:
        """Return a clause on the first number of a file that differs from its estimate; empty if none does.

        Args:
            vehicle: Vehicle file.
        """
        for entry, error in zip(self.entries, self.errors, strict=True):
            there = number(vehicle, entry)
            if there is None or abs(there - entry.value) > AGREES * error + 1e-9 * abs(entry.value):
                says = "has no such value" if there is None else f"has {there:.6g}"
                return f"{entry.name} is {entry.value:.6g}, but the vehicle file {says}"
        return ""

    def drawn(self, vehicle: Vehicle, draws: int, seed: int) -> Iterator[Vehicle]:
        """Yield copies of a vehicle whose numbers are drawn at random from the covariance of these estimates.

        Args:
            vehicle: The vehicle of the estimates; it is not changed.
            draws: Number of copies.
            seed: Seed of the draws.
        """
        rng, low, high = np.random.default_rng(seed), *self._plausible(vehicle)
        errors = np.maximum(self.errors, np.finfo(float).tiny)
        sizes, ways = np.linalg.eigh(self.covariance / np.outer(errors, errors))
        root = ways * np.sqrt(np.maximum(sizes, 0.0))
        for _ in range(draws):
            values = self.values + errors * (root @ rng.standard_normal(len(errors)))
            yield with_numbers(vehicle, self.entries, np.clip(values, low, high))

    def _plausible(self, vehicle: Vehicle) -> tuple[Array, Array]:
        """Return the minimum and maximum plausible value of each number, (P,) each, widened to include it."""
        ends = []
        for entry in self.entries:
            record = CATALOGUE[entry.effect].parameter(entry.parameter)
            low, high = record.plausible.at(entry.index, vehicle) if record.plausible else (-np.inf, np.inf)
            ends.append((min(max(low, record.low), entry.value), max(min(high, record.high), entry.value)))
        low_ends, high_ends = np.array(ends).reshape(-1, 2).T
        return low_ends, high_ends


def number(vehicle: Vehicle, place: Place) -> float | None:
    """Return a number of a vehicle file; None if the file does not contain it.

    Args:
        vehicle: Vehicle file.
        place: Effect, parameter and index of the number.
    """
    table = next(iter(vehicle.effects(place.effect)), {})
    values = np.asarray(table.get(place.parameter, np.nan), float)
    there = len(place.index) == values.ndim and all(np.array(place.index) < values.shape)
    found = float(values[place.index]) if there else np.nan
    return None if np.isnan(found) else found


def with_numbers(vehicle: Vehicle, places: Sequence[Place], values: Array) -> Vehicle:
    """Return a copy of a vehicle with given numbers in its effects.

    In a symmetric matrix, both entries of an off-diagonal pair change.

    Args:
        vehicle: The vehicle.
        places: Effect, parameter and index of each of P numbers.
        values: The new numbers, (P,).
    """
    tables = {place.effect: {} for place in places}  # type: dict[str, dict[str, Any]]
    for place, value in zip(places, values, strict=True):
        table = tables[place.effect]
        if not place.index:
            table[place.parameter] = float(value)
            continue
        if place.parameter not in table:
            current = next(iter(vehicle.effects(place.effect)))
            table[place.parameter] = np.array(current[place.parameter], float).tolist()
        _put(table[place.parameter], place.index, float(value))
        if CATALOGUE[place.effect].parameter(place.parameter).symmetric:
            _put(table[place.parameter], place.index[::-1], float(value))
    changed = tuple({**table, **tables.get(table["name"], {})} for table in vehicle.effect)
    return msgspec.structs.replace(vehicle, effect=changed)


def _put(nested: list[Any], index: tuple[int, ...], value: float) -> None:
    """Set a number in nested lists, in place."""
    for i in index[:-1]:
        nested = nested[i]
    nested[index[-1]] = value
