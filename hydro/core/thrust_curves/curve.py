"""Thrust curve of a vehicle file as a table, and its conversion."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated

import msgspec

from hydro.core.errors import DataError
from hydro.core.thrust_curves.t200 import t200
from hydro.core.thrust_curves.table import ThrustTable, commands_of_pulses, thrust_table

Volts = Annotated[float, msgspec.Meta(gt=0)]


class Curve(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Thrust curve of a vehicle file as points: `thrust` at pulse widths or at commands.

    Thrust is linear between the points and constant beyond the ends.  Either `pwm` or `command` is given.

    Attributes:
        thrust: Thrust [N] at each point; with `voltage`, a row of points for each supply voltage.
        pwm: Pulse widths [us]; 1100, 1500 and 1900 us are the commands -1, 0 and 1.
        command: Commands in [-1, 1].
        voltage: Supply voltages [V]; empty if thrust does not depend on the voltage.
    """

    thrust: tuple[float | tuple[float, ...], ...]
    pwm: tuple[float, ...] = ()
    command: tuple[float, ...] = ()
    voltage: tuple[Volts, ...] = ()


@lru_cache(maxsize=64)
def curve_table(curve: str | Curve) -> ThrustTable | None:
    """Return a thrust curve as a table; None for a named curve without a table.

    Args:
        curve: Curve of a thruster in a vehicle file: numbers, or a name; only `t200` has a table.

    Raises:
        DataError: The numbers are not a valid table.
    """
    if isinstance(curve, str):
        return t200() if curve == "t200" else None
    if bool(curve.pwm) == bool(curve.command):
        raise DataError("curve: give either pwm or command")
    commands = commands_of_pulses(curve.pwm) if curve.pwm else curve.command
    return thrust_table(commands, curve.thrust, curve.voltage)
