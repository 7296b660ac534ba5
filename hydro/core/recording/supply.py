"""Conversion of commands and supply voltage of a recording to effective commands, and back.

If the curve of a thruster is a table, the kernels receive an effective command.  It gives the table's thrust
with a simple curve: linear or, if the rotor speed has a lag, quadratic (`vehicle.thrusters`).  It is computed
here, row by row, before any integration.  For other thrusters it is the command itself.
"""

from __future__ import annotations

import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from hydro.core.columns import VOLTAGE, Array, checked_commands
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import curve_power, nominal_voltage, table_of, voltage_matters


def recorded_commands(vehicle: Vehicle, raw: pl.DataFrame) -> Array:
    """Return the effective commands of a table: logged commands, converted to those of a simple thrust curve.

    Args:
        vehicle: Vehicle with n thrusters.
        raw: Raw table or table of commands: N rows with `cmd_1 ... cmd_n` in [-1, 1] and possibly `voltage`
            [V].

    Returns:
        Shape (N, n).  The effective command of a thruster with a thrust table gives the table's thrust at the
        supply voltage; that of any other thruster is the logged command.

    Raises:
        DataError: The commands do not fit the thrusters, or a curve is invalid.
    """
    names = checked_commands(raw.columns, len(vehicle.thruster), vehicle.name)
    commands = np.ascontiguousarray(raw.select(pl.col(names).cast(pl.Float64)).to_numpy())
    return effective_commands(vehicle, commands, supply_voltage(vehicle, raw))


def supply_voltage(vehicle: Vehicle, raw: pl.DataFrame) -> Array | None:
    """Return the supply voltage of each row [V], filled where a row has no reading.

    A row without a reading has the last reading of the session; rows before the first reading have the first.
    A session without readings has the nominal voltage.

    Args:
        vehicle: Vehicle file.
        raw: Raw table with N rows.

    Returns:
        Shape (N,); None if no thruster's thrust depends on the voltage, or if it was not logged.
    """
    if VOLTAGE not in raw.columns or not voltage_matters(vehicle):
        return None
    read = pl.col(VOLTAGE).cast(pl.Float64).fill_nan(None)
    held = read.forward_fill().backward_fill().over("session")
    volts: Array = raw.select(held.fill_null(nominal_voltage(vehicle))).to_series().to_numpy()
    return volts


def unknown_voltage(vehicle: Vehicle, raw: pl.DataFrame) -> str:
    """Return a warning if a recording lacks the supply voltage that the thrust curves need.

    Args:
        vehicle: Vehicle file.
        raw: Raw table.

    Returns:
        One sentence; an empty string if the voltage is known, or if no thrust depends on it.
    """
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
        f"no supply voltage{where}: thrust is computed for the file's {nominal_voltage(vehicle):g} V; "
        "for the thrust at the actual voltage, log it and name its column in [voltage] of the map"
    )


def effective_commands(vehicle: Vehicle, commands: Array, voltage: ArrayLike | None = None) -> Array:
    """Return the effective commands of logged commands: those that give the same thrust by a simple curve.

    Args:
        vehicle: The vehicle, with n thrusters.
        commands: Commands as logged, (N, n), in [-1, 1].
        voltage: Supply voltage of each row [V], (N,), or one for all; by default the nominal one.

    Returns:
        (N, n); `commands` itself if no thrust curve is a table.

    Raises:
        DataError: A curve is not a valid table, or has several voltages without a nominal one.
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
    """Return the commands (N, n) in [-1, 1] that have given effective commands at the nominal voltage.

    This inverts `effective_commands`: an effective command gives by a simple curve, linear or quadratic, the
    thrust that the command gives by the thruster's table.

    Args:
        vehicle: Vehicle with n thrusters.
        effective: Effective commands (N, n); returned themselves if no thrust curve is a table.

    Raises:
        DataError: A curve is not a valid table, or has several voltages without a nominal one.
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
