"""Commands and supply voltage of a recording as the thrusters' kernels take them, and back.

Of a thruster whose curve is a table the kernels see an effective command: the one that gives the table's
thrust by a plain curve, linear or, where the rotor speed lags, quadratic (`vehicle.thrusters`).  It is made
here, row by row, before anything is integrated; of other thrusters it is the command itself.
"""

from __future__ import annotations

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from hydro.core.columns import VOLTAGE, Array, checked_commands
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import curve_power, nominal_voltage, table_of, voltage_matters


def recorded_commands(vehicle: Vehicle, raw: pl.DataFrame) -> Array:
    """Effective commands of a raw or commands table, (N, n).

    Raises:
        DataError: The commands do not fit the thrusters, or a curve is at fault.
    """
    names = checked_commands(raw.columns, len(vehicle.thruster), vehicle.name)
    commands = np.ascontiguousarray(raw.select(pl.col(names).cast(pl.Float64)).to_numpy())
    return effective_commands(vehicle, commands, supply_voltage(vehicle, raw))


def supply_voltage(vehicle: Vehicle, raw: pl.DataFrame) -> Array | None:
    """Supply voltage of each row [V], (N,); None where no thrust depends on it or the table has none.

    A row without a reading has the session's last one; before the first it has the first, and a session
    without any has the nominal voltage.
    """
    if VOLTAGE not in raw.columns or not voltage_matters(vehicle):
        return None
    read = pl.col(VOLTAGE).cast(pl.Float64).fill_nan(None)
    held = read.forward_fill().backward_fill().over("session")
    volts: Array = raw.select(held.fill_null(nominal_voltage(vehicle))).to_series().to_numpy()
    return volts


def unknown_voltage(vehicle: Vehicle, raw: pl.DataFrame) -> str:
    """That a recording lacks the voltage which the thrust curves ask for; empty where it does not."""
    if not voltage_matters(vehicle):
        return ""
    rows = raw.height
    if VOLTAGE in raw.columns:
        silent = pl.col(VOLTAGE).is_not_null().any().over("session").not_()
        rows = int(raw.select(silent.sum()).item())
    if not rows:
        return ""
    where = "" if rows == raw.height else f" in {rows:,} of {raw.height:,} rows"
    return (
        f"no supply voltage{where}: thrust is that of the vehicle file's {nominal_voltage(vehicle):g} V; "
        "a column `voltage` [V] ([voltage] in the map of `hydro import`) makes it follow the battery"
    )


def effective_commands(vehicle: Vehicle, commands: Array, voltage: ArrayLike | None = None) -> Array:
    """Effective commands of given ones.

    Args:
        vehicle: The vehicle.
        commands: (N, n), as logged.
        voltage: Supply voltage of each row [V], (N,), or one for all; by default the nominal one.

    Returns:
        (N, n); `commands` itself where no curve is a table.

    Raises:
        DataError: A curve is no table, or has several voltages without a nominal one.
    """
    tables = [table_of(thruster) for thruster in vehicle.thruster]
    if not any(tables):
        return commands
    nominal, out = nominal_voltage(vehicle), np.array(commands, dtype=np.float64)
    volts = np.broadcast_to(np.asarray(nominal if voltage is None else voltage, float), len(out))
    for i, (thruster, table) in enumerate(zip(vehicle.thruster, tables, strict=True)):
        if table is None:
            continue
        ahead, astern = table.limits(nominal)
        thrust = table.at(out[:, i], volts)
        share = np.where(thrust > 0.0, thrust / ahead, thrust / astern)
        out[:, i] = np.copysign(np.abs(share) ** (1.0 / curve_power(thruster)), share)
    return out


def given_commands(vehicle: Vehicle, effective: Array) -> Array:
    """The commands to give for effective ones (N, n), at the nominal voltage: in [-1, 1].

    Raises:
        DataError: As for `effective_commands`.
    """
    tables = [table_of(thruster) for thruster in vehicle.thruster]
    if not any(tables):
        return effective
    nominal, out = nominal_voltage(vehicle), np.array(effective, dtype=np.float64)
    for i, (thruster, table) in enumerate(zip(vehicle.thruster, tables, strict=True)):
        if table is None:
            continue
        ahead, astern = table.limits(nominal)
        share = np.copysign(np.abs(out[:, i]) ** curve_power(thruster), out[:, i])
        out[:, i] = table.command_for(np.where(share > 0.0, share * ahead, share * astern), nominal)
    return out
