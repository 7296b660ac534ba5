"""A plant of vehicles in Stonefish, one process each, for a policy to fly where it was not trained."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array, Mask
from hydro.core.errors import UsageError
from hydro.core.vehicle.description import Vehicle
from hydro.sim.flight import require_alike
from hydro.sim.plant import Readings, Snapshot, upright
from hydro.sim.stonefish.program import STATE, Program, Row
from hydro.sim.stonefish.recorder import Launch, StonefishTeacher, stonefish_teacher
from hydro.sim.stonefish.scenario import RATE, Delays, Scenario

MOST = 256
"""Vehicles at most: each is a process with a world of its own."""


class StonefishPlant:
    """Vehicles in Stonefish; see `sim.plant.Plant` for its arrays.

    A snapshot holds how every vehicle began and what it was told since: Stonefish gives nothing of its
    insides away, but does the same again.  To restore takes as long as it took to get there.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        count: int = 1,
        period: float = 0.04,
        mesh: tuple[Array, Any] | None = None,
        hidden: Sequence[Mapping[str, Any]] = (),
        launch: Launch = Program,
    ) -> None:
        """Start Stonefish so many times.

        Args:
            vehicle: The vehicle file.
            count: Number of vehicles.
            period: Control step [s], whole ticks of 2 ms.
            mesh: Vertices [m] and faces of its hull; see `sim.teacher.teacher`.
            hidden: Effects that act without standing in the vehicle file.
            launch: Starts the program.

        Raises:
            DataError: Stonefish has no place for something of the vehicle.
            UsageError: The program is not installed, the control step has no whole ticks, or there are too
                many vehicles.
        """
        ticks = round(period * RATE)
        if ticks < 1 or abs(ticks - period * RATE) > 1e-6:
            raise UsageError(f"the control step of {period:g} s is no multiple of Stonefish's {1 / RATE:g} s")
        if count > MOST:
            raise UsageError(f"{count} vehicles are {count} processes of Stonefish: ask for {MOST} at most")
        self.vehicle, self._ticks, self._mesh, self._hidden = vehicle, ticks, mesh, hidden
        self._launch = launch
        self._readings = Readings.of(count, len(vehicle.thruster))
        self.pose, self.velocity, self.specific_force, self.thrust, self.diverged = self._readings
        subject = self._subject(vehicle)
        self._flat = subject.pilot.program.flat
        self._vehicles = [_One(subject.scenario, ticks) for _ in range(count)]
        self._coming = dict[int, _One]()

    def _subject(self, vehicle: Vehicle) -> StonefishTeacher:
        return stonefish_teacher(vehicle, mesh=self._mesh, hidden=self._hidden)

    def change(self, vehicles: Mapping[int, Vehicle]) -> None:
        """Let some be other vehicles; see `sim.plant.Plant`.

        Raises:
            DataError: Stonefish has no place for something of one, or it has other thrusters.
        """
        for number, vehicle in vehicles.items():
            subject = self._subject(vehicle)
            require_alike(vehicle.name, subject.pilot.program.flat, self._flat)
            self._coming[number] = _One(subject.scenario, self._ticks)

    def reset(self, mask: Mask, pose: Array, velocity: Array) -> None:
        """Put some vehicles somewhere; see `Plant`."""
        self.diverged[mask] = False
        chosen = np.flatnonzero(mask).tolist()
        for k in chosen:
            self._vehicles[k] = self._coming.pop(k, self._vehicles[k])
            self._vehicles[k].begin(np.concatenate([pose[k], velocity[k]]), self._launch)
        for k in chosen:
            self._read(k, self._vehicles[k].answers())

    def step(self, commands: Array, flying: Mask | None = None) -> None:
        """Fly one control step; see `Plant`."""
        going = np.flatnonzero(~self.diverged if flying is None else flying & ~self.diverged).tolist()
        for k in going:
            self._vehicles[k].go_on(commands[k])
        for k in going:
            self._read(k, self._vehicles[k].answers())

    def _read(self, k: int, rows: Iterator[Row]) -> None:
        """Bring the arrays of a vehicle up to date by the last of its answers, or mark it as diverged."""
        *_, last = rows
        if not all(np.isfinite(part).all() for part in last):
            self.diverged[k] = True
            return
        upright(last.state, self.pose[k])
        self.velocity[k], self.specific_force[k] = last.state[7:], last.specific_force
        self.thrust[k, self._vehicles[k].scenario.pushing] = last.thrust

    def snapshot(self) -> Snapshot:
        """How every vehicle began and what it was told since, and the arrays of the present."""
        told = [one.told for one in self._vehicles]
        longest = max((len(each) for each in told), default=0)
        padded = np.zeros((len(told), longest, self.thrust.shape[1]))
        for row, each in zip(padded, told, strict=True):
            row[: len(each)] = np.reshape(each, (len(each), -1))
        return {name: np.array(array) for name, array in self._readings._asdict().items()} | {
            "first": np.array([one.first for one in self._vehicles]),
            "steps": np.array([len(each) for each in told]),
            "told": padded,
        }

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot, bit for bit, by doing everything since each beginning again."""
        first = np.asarray(snapshot["first"], dtype=np.float64)
        begun = np.asarray(np.isfinite(first).all(axis=1))
        self.reset(begun, first[:, :7], first[:, 7:])
        for k in np.flatnonzero(begun).tolist():
            for row in snapshot["told"][k, : snapshot["steps"][k]]:
                self._vehicles[k].go_on(row)
                self._read(k, self._vehicles[k].answers())
        for name, array in self._readings._asdict().items():
            array[:] = snapshot[name]


class _One:
    """One vehicle: its scenario, its program once it has begun, and what it was told since."""

    def __init__(self, scenario: Scenario, ticks: int) -> None:
        self.scenario, self.told = scenario, list[Array]()
        self.first = np.full(STATE, np.nan)
        self._ticks, self._asked = ticks, 0
        self._program: Program | None = None
        self._late = Delays(scenario.table, ticks)

    def begin(self, first: Array, launch: Launch) -> None:
        """Ask to begin at a pose and velocity (13,)."""
        self._program = self._program or launch(self.scenario)
        self.first, self.told, self._late = first, [], Delays(self.scenario.table, self._ticks)
        self._program.reset(first)
        self._asked = 1

    def go_on(self, commands: Array) -> None:
        """Ask for one control step under commands (n,)."""
        assert self._program is not None
        self.told.append(np.array(commands))
        parts = list(self._late.felt(self.scenario.setpoints(commands)))
        for ticks, setpoints in parts:
            self._program.hold(ticks, setpoints)
        self._asked = len(parts)

    def answers(self) -> Iterator[Row]:
        """The answers to what was asked last."""
        assert self._program is not None
        for _ in range(self._asked):
            yield self._program.answer()
