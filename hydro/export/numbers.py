"""Numbers and kernels of a vehicle for `export.equations`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hydro.core.effects.catalogue import entries, thruster_table
from hydro.core.effects.layout import CONSTANTS
from hydro.core.effects.program import HEADER, assemble
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import nominal_voltage, table_of
from hydro.export.equations import Model, Numbers


def model_of(vehicle: Vehicle, kernel: Callable[[Any, str], Any] = lambda function, name: function) -> Model:
    """Return a vehicle as plain numbers and kernels, with thrust tables at its nominal voltage.

    Args:
        vehicle: The vehicle.
        kernel: Function that replaces a kernel, given the kernel and the name of its effect.

    Raises:
        DataError: An effect is not in the catalogue, or a thruster is invalid.
    """
    listed = entries(vehicle)
    program = assemble(vehicle, listed)
    effects = []
    for effect, parameters, _ in listed:
        if effect.kernel is not None:
            start = None if effect.start is None else kernel(effect.start, f"{effect.name}_start")
            count = 0 if effect.states is None else effect.states(parameters)
            effects.append((kernel(effect.kernel, effect.name), start, parameters.tolist(), count))
    flat = program.flat[: HEADER + CONSTANTS].tolist()
    return Model(flat, thruster_table(vehicle, listed).tolist(), curves_of(vehicle), effects)


def curves_of(vehicle: Vehicle) -> Numbers:
    """Return a list with the thrust table of each thruster at nominal voltage.

    Returns:
        For each thruster a tuple of commands (a list), thrusts (a list) [N], and full thrust ahead and astern
        [N]; None for a thruster without a table.
    """
    found: Numbers = []
    for thruster in vehicle.thruster:
        table = table_of(thruster)
        if table is None:
            found.append(None)
            continue
        volts = nominal_voltage(vehicle)
        thrust = np.asarray(table.at(table.command, volts))
        found.append((table.command.tolist(), thrust.tolist(), *table.limits(volts)))
    return found
