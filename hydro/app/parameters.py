"""Switches and sliders: effects of the catalogue on a vehicle, and the values of each with their ranges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from hydro.core import toml_text
from hydro.core.effects import CATALOGUE
from hydro.core.effects.describe import toml
from hydro.core.effects.record import Index, Parameter
from hydro.core.errors import DataError
from hydro.core.simulation.estimates import Estimate, with_numbers
from hydro.core.vehicle.description import Vehicle

REACH = 10.0
"""Half width of the range of a slider without a plausible range [significant sizes of the parameter]."""
STEPS = 1000
"""Minimum number of positions of a slider, finer than a screen shows."""
AXES = ("x", "y", "z", "roll", "pitch", "yaw")
"""Names of the components of a 6-vector."""


@dataclass(frozen=True)
class Slider:
    """Slider of one number of an effect's parameter.

    Attributes:
        effect: Name of the effect on the vehicle.
        parameter: Name of the parameter.
        index: Index in the parameter; () for a scalar.
        label: Name on the page.
        unit: Unit; empty for a pure number.
        value: Present value.
        low: Lower end of the slider.
        high: Upper end of the slider.
        step: Step of the slider.
        least: Minimum admissible value.
        most: Maximum admissible value.
        known: Whether the file marks the value as known, so that no fit changes it.
    """

    effect: str
    parameter: str
    index: Index
    label: str
    unit: str
    value: float
    low: float
    high: float
    step: float
    least: float
    most: float
    known: bool

    @property
    def key(self) -> str:
        """Unique name of the slider, such as `linear_damping.diagonal[0]`."""
        return f"{self.effect}.{self.parameter}" + "".join(f"[{i}]" for i in self.index)


def sliders(vehicle: Vehicle, effect: str) -> list[Slider]:
    """Return the sliders of an effect of a vehicle, one for each number.

    Empty if the vehicle lacks the effect. A symmetric matrix has no sliders below its diagonal.
    """
    table = next(iter(vehicle.effects(effect)), None)
    if table is None:
        return []
    record, found = CATALOGUE[effect], list[Slider]()
    held = record.known(table)
    for parameter in record.parameters:
        if table.get(parameter.name) is None:  # another form of the effect is given
            continue
        values = np.asarray(table[parameter.name], float)
        for index in np.ndindex(*values.shape):
            if parameter.symmetric and len(index) == 2 and index[0] > index[1]:
                continue
            value = float(values[index])
            low, high = _range(parameter, index, vehicle, value)
            found.append(
                Slider(
                    effect=effect,
                    parameter=parameter.name,
                    index=index,
                    label=f"{parameter.name}{_place(parameter, index, vehicle)}",
                    unit=parameter.unit_at(index).removeprefix("1") or "",
                    value=value,
                    low=low,
                    high=high,
                    step=_step(high - low),
                    least=parameter.low,
                    most=parameter.high,
                    known=parameter.name in held,
                )
            )
    return found


def with_value(vehicle: Vehicle, slider: Slider, value: float) -> Vehicle:
    """Return a copy of the vehicle with a slider's number set to `value`, limited to its admissible range.

    Raises:
        DataError: The value is not finite.
    """
    if not math.isfinite(value):
        raise DataError(f"{slider.key}: give a number")
    place = Estimate(slider.effect, slider.parameter, slider.index, slider.unit, value)
    return with_numbers(vehicle, [place], np.array([min(max(value, slider.least), slider.most)]))


def switchable(vehicle: Vehicle) -> list[str]:
    """Return the names of all effects to switch: the vehicle's, then the others of the catalogue."""
    present = [str(table["name"]) for table in vehicle.effect]
    names = [name for name, record in CATALOGUE.items() if not record.is_written]
    return [*present, *(name for name in names if not vehicle.effects(name))]


def neutral(effect: str, vehicle: Vehicle) -> dict[str, Any]:
    """Return a new `[[effect]]` table of an effect with values of 0, or of 1 where 0 is not allowed.

    Args:
        effect: Name of the effect in the catalogue.
        vehicle: Vehicle, for the number of its thrusters.
    """
    tables: Sequence[dict[str, Any]] = toml_text.content(toml(CATALOGUE[effect], len(vehicle.thruster)))[
        "effect"
    ]
    return dict(tables[0])


def with_effect(vehicle: Vehicle, table: dict[str, Any]) -> Vehicle:
    """Return a copy of the vehicle with one more effect.

    Args:
        vehicle: The vehicle.
        table: `[[effect]]` table of the effect.
    """
    return msgspec.structs.replace(vehicle, effect=(*vehicle.effect, table))


def _range(parameter: Parameter, index: Index, vehicle: Vehicle, value: float) -> tuple[float, float]:
    """Return the ends of a slider: the plausible range, or some significant sizes, and the value."""
    if parameter.plausible is not None:
        low, high = parameter.plausible.at(index, vehicle)
    else:
        reach = REACH * parameter.scale_at(index, vehicle)
        low, high = -reach, reach
    low, high = max(low, parameter.low), min(high, parameter.high)
    low, high = min(low, value), max(high, value)
    return (low, high) if high > low else (low - 1.0, high + 1.0)


def _step(width: float) -> float:
    """Return a round step, 1, 2 or 5 times a power of ten, at most a STEPS-th of a width."""
    power = 10.0 ** math.floor(math.log10(width / STEPS))
    return float(
        max(factor for factor in (1.0, 2.0, 5.0) if factor * power <= width / STEPS * (1.0 + 1e-9)) * power
    )


def _place(parameter: Parameter, index: Index, vehicle: Vehicle) -> str:
    """Return the name of a component: an axis, a thruster, or its number."""
    if not index:
        return ""
    if parameter.shape == ("thrusters",):
        return f" {vehicle.thruster[index[0]].name or index[0] + 1}"
    names = [AXES[i] if size == 6 else str(i + 1) for i, size in zip(index, parameter.shape, strict=True)]
    return f" {', '.join(names)}"
