"""The record of one physical effect, and how its table in a vehicle file becomes numbers."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError

Kind = Literal["wrench", "inertia", "flow", "actuator", "sensor"]
Kernel = Callable[[Array, Array, Array, Array, Array, Array], None]
Fill = Callable[[Array, Array], None]

BOOKKEEPING = frozenset({"name", "standard_error", "fit"})
"""Keys of an `[[effect]]` table that are no parameters: what a fit leaves beside its values."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, as it stands in a vehicle file.

    Attributes:
        name: Key in the `[[effect]]` table.
        unit: One unit for all entries; or two, for the three forces and the three moments of a 6-vector;
            or three, for the force-velocity, mixed and moment-rate blocks of a 6x6 matrix.
        meaning: What it is, in a few words.
        shape: Lengths; `"thrusters"` and `"rates"` stand for numbers that the vehicle file settles.
        low: Least admissible value (inclusive).
        high: Greatest admissible value (inclusive).
        required: False where leaving it out means 0.
    """

    name: str
    unit: tuple[str, ...]
    meaning: str
    shape: tuple[int | str, ...] = ()
    low: float = -math.inf
    high: float = math.inf
    required: bool = False


@dataclass(frozen=True)
class Effect:
    """One effect of the catalogue: everything that any part of the program needs to know of it.

    Exactly the callables of its kind are set.  All take the effect's packed parameter vector first.

    Attributes:
        name: Name in a vehicle file.
        family: The file of `core.effects` it stands in.
        kind: What it acts on: `wrench` adds to tau, `inertia` to M (and brings its Coriolis terms), `flow` to
            the current v_c, `actuator` to the thruster table, `sensor` to the logged velocity.
        definition: Its equation on one line, the wrench being the one ON the vehicle.
        source: Where the equation comes from.
        excitation: The motion that a recording must contain for its parameters to be determined.
        lookalikes: Effects that it is easily taken for.
        parameters: In packing order.
        one_of: Names of parameters of which exactly one is given, and the others are not packed.
        kernel: Scalar compiled wrench, see `core.effects.layout`.
        inertia: `inertia(p, M)` adds to a 6x6 matrix.
        flow: `flow(p, v_c)` adds to the current [m/s], NED.
        actuator: `actuator(p, table)` changes the thruster table of `vehicle.thrusters` in place.
        sensor: `sensor(p, log)` changes the row `core.effects.sensor` describes, in place.
        states: Number of internal states for a packed parameter vector.
        start: `start(p, c, s, x)` sets them for a motion that has been steady until now.
    """

    name: str
    family: str
    kind: Kind
    definition: str
    source: str
    excitation: str
    lookalikes: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    one_of: tuple[str, ...] = ()
    kernel: Kernel | None = None
    inertia: Fill | None = None
    flow: Fill | None = None
    actuator: Fill | None = None
    sensor: Fill | None = None
    states: Callable[[Array], int] | None = None
    start: Callable[[Array, Array, Array, Array], None] | None = None

    @property
    def description(self) -> str:
        """The docstring of the function that defines it: what a naval engineer would check."""
        for function in (self.kernel, self.inertia, self.flow, self.actuator, self.sensor):
            if function is not None:
                return inspect.getdoc(function) or ""
        raise TypeError(f"effect {self.name} has no defining function")

    def pack(self, table: Mapping[str, Any], *, thrusters: int, where: str = "effect") -> Array:
        """Packed parameter vector of an `[[effect]]` table.

        Args:
            table: The table as read from TOML.
            thrusters: Number of thrusters of the vehicle.
            where: Path of the table, for errors.

        Returns:
            The parameters in order, matrices row by row; a scalar or vector left out is 0.

        Raises:
            DataError: An unknown or missing key, a wrong size, a number out of bounds or not finite.
        """
        known = {parameter.name for parameter in self.parameters}
        unknown = sorted(set(table) - known - BOOKKEEPING)
        if unknown:
            raise DataError(
                f"{where}.{unknown[0]}: {self.name} has no such parameter; it has {', '.join(sorted(known))}"
            )
        given = [name for name in self.one_of if name in table]
        if self.one_of and len(given) != 1:
            raise DataError(f"{where}: {self.name} needs exactly one of {', '.join(self.one_of)}")
        sizes: dict[str, int] = {"thrusters": thrusters}
        parts = [
            _entries(parameter, table, sizes, f"{where}.{parameter.name}")
            for parameter in self.parameters
            if parameter.name not in self.one_of or parameter.name in given
        ]
        return np.concatenate(parts)


def _entries(parameter: Parameter, table: Mapping[str, Any], sizes: dict[str, int], where: str) -> Array:
    """One parameter as a flat vector; a symbolic length not met before is fixed by the first that uses it."""
    if parameter.name not in table:
        if parameter.required:
            raise DataError(f"{where}: is missing ({parameter.meaning})")
        return np.zeros([sizes[n] if isinstance(n, str) else n for n in parameter.shape]).ravel()
    given = table[parameter.name]
    try:
        values = np.asarray(given, dtype=object)
        numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values.flat)
        if not numbers:
            raise ValueError
        values = values.astype(np.float64)
    except ValueError:
        raise DataError(f"{where}: must be {_wanted(parameter, sizes)}") from None
    if parameter.shape and isinstance(parameter.shape[0], str) and values.ndim and len(values):
        sizes.setdefault(parameter.shape[0], len(values))
    if values.shape != tuple(sizes.get(n, -1) if isinstance(n, str) else n for n in parameter.shape):
        raise DataError(f"{where}: must be {_wanted(parameter, sizes)}")
    if not np.isfinite(values).all():
        raise DataError(f"{where}: must be finite")
    if (values < parameter.low).any() or (values > parameter.high).any():
        raise DataError(f"{where}: must lie within [{parameter.low:g}, {parameter.high:g}]")
    return values.ravel()


def _wanted(parameter: Parameter, sizes: Mapping[str, int]) -> str:
    """What a parameter should look like, for an error message."""
    if not parameter.shape:
        return "a number"
    lengths = [
        str(sizes.get(n, f"one per {n[:-1]}")) if isinstance(n, str) else str(n) for n in parameter.shape
    ]
    return f"an array of {' x '.join(lengths)} numbers"
