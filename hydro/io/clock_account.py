"""How late each sensor of a log is, and the motion on the commands, in words and what to write in the map."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import msgspec

from hydro.core.logs.delays import Offset, command_delay, sensor_offsets, shifted
from hydro.core.logs.importing import Imported
from hydro.core.logs.logmap import LogMap

ANSWERS = 0.25
"""A thruster and its controller take up to so long [s]: a later answer of the motion may be a clock's."""
TOLD = 0.01
"""Minimum lag of a sensor that is reported although it is shorter than a sample [s]."""
AGAINST = {"velocity": "the position", "attitude": "the position", "rates": "the attitude"}


@dataclass(frozen=True)
class Clocks:
    """Offsets of a log's clocks.

    Attributes:
        sensors: Of velocity, attitude and rates on the pose; those that the motion shows.
        commands: Of the motion on the commands, None where the log does not show it.
        declared: The map, which may name some lags already.
    """

    sensors: tuple[Offset, ...]
    commands: Offset | None
    declared: LogMap

    def lines(self) -> Iterator[str]:
        """What was found, a line for all, and one for each lag to put right."""
        told = [f"{one.block} {_interval(one)}" for one in self.sensors]
        if told:
            yield f"lag of stamps on the pose, with 95 %: {'; '.join(told)}"
        if self.commands is not None:
            late = _interval(self.commands)
            yield f"the motion follows the commands by {late} with 95 %, thrusters' lag included"
        yield from (f"warning: {line}" for line in (*self.contradictions(), *self.suspicions()))

    def contradictions(self) -> list[str]:
        """Lags that are plain and longer than a sample: what `--strict` refuses."""
        return [self._line(one) for one in self._plain() if one.over_a_sample]

    def suspicions(self) -> list[str]:
        """Lags that are plain, but shorter than a sample of their sensor."""
        return [
            self._line(one) for one in self._plain() if not one.over_a_sample and abs(one.seconds) >= TOLD
        ]

    def lags(self) -> dict[str, float]:
        """Lags of the sensors to write into the map [s], by the name of the block."""
        told = (one for one in self.sensors if one.plain and (one.over_a_sample or abs(one.seconds) >= TOLD))
        return {one.block: self._lag(one) for one in told}

    def _lag(self, one: Offset) -> float:
        """Return the lag of a sensor to write into the map [s]."""
        declared: float = getattr(self.declared, one.block).lag
        return declared + one.seconds

    def _plain(self) -> list[Offset]:
        sensors = [one for one in self.sensors if one.plain]
        late = self.commands
        if late is None or not late.plain or 0.0 <= late.low <= ANSWERS:
            return sensors
        return [*sensors, late] if late.high < 0.0 or late.low > ANSWERS else sensors

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
            f"{one.block} is stamped {abs(one.seconds):.3g} s {early} on {AGAINST[one.block]} "
            f"({_range(one)}); write lag = {self._lag(one):.3g} in [{one.block}]"
        )


def clocks(imported: Imported, follows: LogMap, declared: LogMap) -> Clocks:
    """Estimate the lags of a log.

    Args:
        imported: The log on one clock.
        follows: The map that the data follow.
        declared: The map as given.
    """
    derived = declared.rates is not None and declared.rates.source == "attitude"
    logs = imported.logs
    found = sensor_offsets(logs, imported.times, imported.dt, follows)
    for one in found:
        if one.plain:
            logs = tuple(shifted(log, follows, one.block, one.seconds) for log in logs)
    moving = msgspec.structs.replace(follows, rates=imported.meaning.rates) if derived else follows
    return Clocks(tuple(found), command_delay(logs, imported.times, imported.dt, moving), declared)


def _interval(one: Offset) -> str:
    return f"{one.seconds:.3f} s ({one.low:.3f} to {one.high:.3f})"


def _range(one: Offset) -> str:
    return f"95 %: {one.low:.3g} to {one.high:.3g} s"
