"""Time offsets of the sensors and commands of a log, in words and as values for the map."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import msgspec
import polars as pl
import polars.selectors as cs

from hydro.core.cleaning.readiness import ran
from hydro.core.columns import COMMAND
from hydro.core.logs.delays import Offset, command_delay, sensor_offsets, shifted
from hydro.core.logs.importing import Imported
from hydro.core.logs.logmap import LogMap, columns_of
from hydro.core.logs.receipt import late_commands

MAX_RESPONSE = 0.25
"""Maximum lag [s] that a thruster and its controller can cause; a longer lag may be a clock error."""
LEAST_REPORTED = 0.01
"""Minimum lag of a sensor or of commands that is reported although it is shorter than a sample [s]."""
REFERENCE = {"velocity": "the position", "attitude": "the position", "rates": "the attitude"}
"""Reference of each sensor's lag."""


@dataclass(frozen=True)
class Clocks:
    """Time offsets of sensors and commands in a log.

    Attributes:
        sensors: Lags of velocity, attitude and rates relative to the pose, where the motion shows them.
        commands: Lag of the motion relative to the commands; None if the log does not show it.
        declared: Map of the log, which may already state lags.
        receipt: Delay of the time stamps of commands relative to those of sensors of the same driver [s], see
            `core.logs.receipt`.
    """

    sensors: tuple[Offset, ...]
    commands: Offset | None
    declared: LogMap
    receipt: float = 0.0

    def lines(self) -> Iterator[str]:
        """Yield lines of text: the lags together in one line, and a warning for each lag to correct."""
        told = [f"{one.block} {_interval(one)}" for one in self.sensors]
        if told:
            yield f"lag of stamps relative to the pose, 95 % interval: {'; '.join(told)}"
        if self.commands is not None:
            late = _interval(self.commands)
            yield (
                f"the motion follows the commands by {late}, 95 % interval, including the lag of the "
                "thrusters"
            )
        if self._late_commands:
            yield (
                f"note: commands are stamped on receipt, other messages of their driver {self.receipt:.3g} s "
                f"before it; write lag = {self.receipt:.3g} in [commands]"
            )
        yield from (f"warning: {line}" for line in (*self.contradictions(), *self.suspicions()))

    @property
    def _late_commands(self) -> bool:
        """Whether commands are stamped late and the map does not correct the lag."""
        return self.receipt >= LEAST_REPORTED and not self.declared.commands.lag

    def contradictions(self) -> list[str]:
        """Return one line for each significant lag longer than a sample.

        `hydro import --strict` refuses such logs.
        """
        return [self._line(one) for one in self._significant() if one.over_a_sample]

    def suspicions(self) -> list[str]:
        """Return one line for each significant lag that is shorter than a sample of its sensor."""
        return [
            self._line(one)
            for one in self._significant()
            if not one.over_a_sample and abs(one.seconds) >= LEAST_REPORTED
        ]

    def lags(self) -> dict[str, float]:
        """Return the lags that the map should state [s], by name of the block, such as `velocity`.

        Lags of sensors that are significant, and the receipt delay of the commands, are included.
        """
        told = (
            one
            for one in self.sensors
            if one.plain and (one.over_a_sample or abs(one.seconds) >= LEAST_REPORTED)
        )
        late = {"commands": self.receipt} if self._late_commands else {}
        return {one.block: self._lag(one) for one in told} | late

    def _lag(self, one: Offset) -> float:
        """Return the lag of a sensor for the map [s]: the stated lag plus the lag that was found."""
        declared: float = getattr(self.declared, one.block).lag
        return declared + one.seconds

    def _significant(self) -> list[Offset]:
        sensors = [one for one in self.sensors if one.plain]
        late = self.commands
        if late is None or not late.plain or 0.0 <= late.low <= MAX_RESPONSE:
            return sensors
        return [*sensors, late] if late.high < 0.0 or late.low > MAX_RESPONSE else sensors

    def _line(self, one: Offset) -> str:
        if one.block == "commands":
            lag = self.declared.commands.lag - one.seconds
            what = (
                f"the motion comes {-one.seconds:.2f} s before the commands that cause it"
                if one.seconds < 0.0
                else f"the motion follows the commands only after {one.seconds:.2f} s"
            )
            else_ = "" if one.seconds < 0.0 else ", unless the vehicle is that slow"
            return (
                f"{what} ({_range(one)}): their clocks disagree{else_}; write lag = {lag:.2f} in [commands]"
            )
        early = "late" if one.seconds > 0.0 else "early"
        return (
            f"{one.block} {'are' if one.block == 'rates' else 'is'} stamped {abs(one.seconds):.3g} s {early} "
            f"relative to {REFERENCE[one.block]} "
            f"({_range(one)}); write lag = {self._lag(one):.3g} in [{one.block}]"
        )


def clocks(imported: Imported, follows: LogMap, declared: LogMap, travel: Mapping[str, float]) -> Clocks:
    """Return the time offsets of a log's sensors and commands, estimated from the motion.

    Args:
        imported: Log on one clock.
        follows: Map whose frames and signs agree with the motion.
        declared: Map as given.
        travel: Mean time from the stamp of a message to its receipt [s], by topic.
    """
    derived = declared.rates is not None and declared.rates.source == "attitude"
    logs = imported.logs
    found = sensor_offsets(logs, imported.times, imported.dt, follows)
    for one in found:
        if one.plain:
            logs = tuple(shifted(log, follows, one.block, one.seconds) for log in logs)
    moving = msgspec.structs.replace(follows, rates=imported.meaning.rates) if derived else follows
    commands = imported.frame.select(cs.starts_with(COMMAND)).cast(pl.Float64).to_numpy()
    delay = command_delay(logs, imported.times, imported.dt, moving) if ran(commands) else None
    return Clocks(tuple(found), delay, declared, late_commands(columns_of(declared.commands), travel))


def _interval(one: Offset) -> str:
    return f"{one.seconds:.3f} s ({one.low:.3f} to {one.high:.3f})"


def _range(one: Offset) -> str:
    return f"95 %: {one.low:.3g} to {one.high:.3g} s"
