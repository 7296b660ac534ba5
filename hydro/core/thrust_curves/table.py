"""Thrust table: thrust [N] at points of command and supply voltage, interpolated linearly.

This is the only place that converts a command and a voltage to a thrust.  All later steps (lags, effects of
the thrusters, MuJoCo) use the thrust alone: see `recording.supply`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.errors import DataError

NEUTRAL, SPAN = 1500.0, 400.0
"""Pulse width at rest, and its change to full command [us]."""
SCATTER = 0.01
"""Share of the maximum thrust by which a table's thrust may fall while the command rises: measurements
scatter."""


@dataclass(frozen=True)
class ThrustTable:
    """Thrust at points of command and supply voltage, for linear interpolation.

    Attributes:
        command: Commands, ascending, (K,).
        voltage: Supply voltages [V], ascending, (V,); one entry of any value if thrust does not depend on it.
        thrust: Thrust [N], (V, K).
    """

    command: Array
    voltage: Array
    thrust: Array

    @property
    def several(self) -> bool:
        """Whether thrust depends on the supply voltage."""
        return len(self.voltage) > 1

    def at(self, command: ArrayLike, voltage: ArrayLike) -> Array:
        """Return the thrust [N] at commands and voltages, in the shape to which both broadcast.

        Thrust is linear in the command between two points, linear in the voltage between two curves, and
        constant beyond the ends of the table.

        Args:
            command: Commands in [-1, 1].
            voltage: Supply voltages [V].
        """
        u, volts = np.broadcast_arrays(np.asarray(command, float), np.asarray(voltage, float))
        curves = [np.interp(u, self.command, curve) for curve in self.thrust]
        if not self.several:
            return np.asarray(curves[0])
        lower = np.clip(np.searchsorted(self.voltage, volts, "right") - 1, 0, len(self.voltage) - 2)
        low, high = self.voltage[lower], self.voltage[lower + 1]
        share = np.clip((volts - low) / (high - low), 0.0, 1.0)
        stacked = np.stack(curves)
        below, above = (np.take_along_axis(stacked, (lower + i)[None], 0)[0] for i in (0, 1))
        found: Array = (1.0 - share) * below + share * above
        return found

    def limits(self, voltage: float) -> tuple[float, float]:
        """Return the thrusts [N] of full command ahead and astern at a voltage, as two positive numbers.

        A thruster without thrust astern gets the value ahead, which is never used.

        Args:
            voltage: Supply voltage [V].
        """
        curve = self.at(self.command, voltage)
        ahead, astern = float(curve.max()), float(-curve.min())
        return ahead, astern if astern > 0.0 else ahead

    def most(self, voltage: float) -> float:
        """Return the largest ratio of a thrust in the table to the thrust of full command at a voltage.

        Ahead and astern count, over all voltages of the table; the ratio is at least 1.

        Args:
            voltage: Supply voltage [V].
        """
        ahead, astern = self.limits(voltage)
        return max(float(self.thrust.max()) / ahead, float(-self.thrust.min()) / astern, 1.0)

    def command_for(self, thrust: ArrayLike, voltage: float) -> Array:
        """Return the commands closest to rest that give thrusts at a voltage, in the shape of the thrusts.

        A thrust that cannot be reached gives full command, zero thrust the command 0.

        Args:
            thrust: Thrusts [N].
            voltage: Supply voltage [V].
        """
        wanted = np.asarray(thrust, float)
        curve = self.at(self.command, voltage)
        ahead = _side(self.command, curve)
        astern = _side(-self.command[::-1], -curve[::-1])
        up = np.interp(wanted, ahead[1], ahead[0])
        down = -np.interp(-wanted, astern[1], astern[0])
        return np.where(wanted > 0.0, up, np.where(wanted < 0.0, down, 0.0))


def thrust_table(
    command: Sequence[float], thrust: Sequence[float | Sequence[float]], voltage: Sequence[float] = ()
) -> ThrustTable:
    """Return a thrust table made from the numbers of a vehicle file, after checks.

    Args:
        command: K commands in [-1, 1], ascending.
        thrust: K thrusts [N]; with `voltage` a row of K for each voltage.
        voltage: Supply voltages [V], ascending.

    Raises:
        DataError: The numbers are not a valid table; the message names the key.
    """
    _check_rising("voltage", voltage, 0)
    _check_rising("command", command, 2)
    if not command[0] < 0.0 < command[-1] and command[0] != 0.0:
        raise DataError("curve: the commands must begin at rest or below it, and end above it")
    rows = [row if isinstance(row, Sequence) else [row] for row in thrust] if voltage else [thrust]
    if len(rows) != max(len(voltage), 1):
        raise DataError(f"curve.thrust: expected {len(voltage)} rows, one for each voltage, got {len(rows)}")
    for row in rows:
        if len(row) != len(command) or any(isinstance(entry, Sequence) for entry in row):
            raise DataError(
                f"curve.thrust: expected {'rows of ' if voltage else ''}{len(command)} numbers, one for each "
                f"command, got {len(row)}"
                + ("" if voltage else "; rows for several voltages need the key voltage")
            )
    table = np.array(rows, dtype=np.float64)
    for row in table:
        most = float(np.abs(row).max())
        if row[-1] <= 0.0 or row[0] > 0.0:
            raise DataError("curve.thrust: must be above 0 at full command ahead, and not above 0 astern")
        if (np.diff(row) < -SCATTER * most).any():
            at = int(np.argmin(np.diff(row)))
            raise DataError(
                f"curve.thrust: falls from {row[at]:g} to {row[at + 1]:g} N where the command rises: "
                "write the thrusts in the order of the commands, astern below 0"
            )
    volts = np.array(voltage or [0.0], dtype=np.float64)
    return ThrustTable(np.array(command, dtype=np.float64), volts, table)


def commands_of_pulses(pwm: Sequence[float]) -> list[float]:
    """Return the commands of pulse widths [us]: 1100, 1500 and 1900 us are -1, 0 and 1."""
    return [(width - NEUTRAL) / SPAN for width in pwm]


def _check_rising(key: str, numbers: Sequence[float], least: int) -> None:
    if len(numbers) < least or (np.diff(numbers) <= 0.0).any():
        raise DataError(f"curve.{key}: must be {least or 1} numbers or more, each above the one before")


def _side(command: Array, thrust: Array) -> tuple[Array, Array]:
    """Return commands and thrusts of one side, from the last without thrust, strictly ascending."""
    first = max(int(np.count_nonzero(np.maximum.accumulate(thrust) <= 0.0)) - 1, 0)
    kept = np.r_[True, np.diff(np.maximum.accumulate(thrust[first:])) > 0.0]
    return command[first:][kept], np.maximum.accumulate(thrust[first:])[kept]
