"""Plant (set of simulated vehicles) in Stonefish, one process each, to test a policy in another simulator."""

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

MAX_VEHICLES = 256
"""Maximum number of vehicles: each is a process with its own world."""


class StonefishPlant:
    """Plant whose N vehicles run in Stonefish; see `sim.plant.Plant` for its arrays.

    Stonefish cannot save its state, but it is deterministic.  So a snapshot holds the start and all commands
    of every vehicle.  Restoring a snapshot takes as long as the simulation so far.
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
        """Prepare the vehicles; their processes start at the first reset.

        Args:
            vehicle: Vehicle file.
            count: Number of vehicles.
            period: Control step [s], a whole number of ticks of 2 ms.
            mesh: Vertices [m] and faces of its hull; see `sim.teacher.teacher`.
            hidden: Effects that act but are not in the vehicle file.
            launch: Starts the program.

        Raises:
            DataError: Stonefish cannot represent a part of the vehicle.
            UsageError: The control step is not a whole number of ticks, or there are too many vehicles.
        """
        ticks = round(period * RATE)
        if ticks < 1 or abs(ticks - period * RATE) > 1e-6:
            raise UsageError(
                f"the control step of {period:g} s is not a multiple of Stonefish's {1 / RATE:g} s"
            )
        if count > MAX_VEHICLES:
            raise UsageError(
                f"{count} vehicles are {count} processes of Stonefish: ask for {MAX_VEHICLES} at most"
            )
        self.vehicle, self._ticks, self._mesh, self._hidden = vehicle, ticks, mesh, hidden
        self._launch = launch
        self._readings = Readings.of(count, len(vehicle.thruster))
        self.pose, self.velocity, self.specific_force, self.thrust, self.diverged = self._readings
        subject = self._subject(vehicle)
        self._flat = subject.pilot.program.flat
        self._vehicles = [_Process(subject.scenario, ticks) for _ in range(count)]
        self._pending = dict[int, _Process]()

    def _subject(self, vehicle: Vehicle) -> StonefishTeacher:
        return stonefish_teacher(vehicle, mesh=self._mesh, hidden=self._hidden)

    def change(self, vehicles: Mapping[int, Vehicle]) -> None:
        """Replace vehicles, given by their index in the plant; each must be reset before its next step.

        Raises:
            DataError: Stonefish cannot represent a part of a vehicle, or the number of thrusters differs.
        """
        for number, vehicle in vehicles.items():
            subject = self._subject(vehicle)
            require_alike(vehicle.name, subject.pilot.program.flat, self._flat)
            self._pending[number] = _Process(subject.scenario, self._ticks)

    def reset(self, mask: Mask, pose: Array, velocity: Array) -> None:
        """Start the vehicles of a mask (N,) with thrusters at rest and clock at 0.

        Args:
            mask: Vehicles that start, (N,).
            pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED (N, 7).
            velocity: u v w p q r over ground, FRD [m/s, rad/s] (N, 6).

        Raises:
            DataError: The program fails.
            UsageError: The program is not installed.
        """
        self.diverged[mask] = False
        chosen = np.flatnonzero(mask).tolist()
        for k in chosen:
            self._vehicles[k] = self._pending.pop(k, self._vehicles[k])
            self._vehicles[k].begin(np.concatenate([pose[k], velocity[k]]), self._launch)
        for k in chosen:
            self._read(k, self._vehicles[k].answers())

    def step(self, commands: Array, flying: Mask | None = None) -> None:
        """Simulate one control step, and rewrite the plant's arrays of readings.

        Args:
            commands: Commands in [-1, 1], held during the step (N, n).
            flying: Vehicles that move (N,), by default all; all others stay unchanged.
        """
        going = np.flatnonzero(~self.diverged if flying is None else flying & ~self.diverged).tolist()
        for k in going:
            self._vehicles[k].go_on(commands[k])
        for k in going:
            self._read(k, self._vehicles[k].answers())

    def _read(self, k: int, rows: Iterator[Row]) -> None:
        """Update the arrays of vehicle `k` from the last of its program's answers, or mark it as diverged."""
        *_, last = rows
        if not all(np.isfinite(part).all() for part in last):
            self.diverged[k] = True
            return
        upright(last.state, self.pose[k])
        self.velocity[k], self.specific_force[k] = last.state[7:], last.specific_force
        self.thrust[k, self._vehicles[k].scenario.pushing] = last.thrust

    def snapshot(self) -> Snapshot:
        """Return the start and all commands of every vehicle, and the current readings, as arrays by name."""
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
        """Set the state of a snapshot, bit for bit, by repeating every simulation from its start."""
        first = np.asarray(snapshot["first"], dtype=np.float64)
        begun = np.asarray(np.isfinite(first).all(axis=1))
        self.reset(begun, first[:, :7], first[:, 7:])
        for k in np.flatnonzero(begun).tolist():
            for row in snapshot["told"][k, : snapshot["steps"][k]]:
                self._vehicles[k].go_on(row)
                self._read(k, self._vehicles[k].answers())
        for name, array in self._readings._asdict().items():
            array[:] = snapshot[name]


class _Process:
    """One vehicle: its scenario, its program once started, and all commands since."""

    def __init__(self, scenario: Scenario, ticks: int) -> None:
        self.scenario, self.told = scenario, list[Array]()
        self.first = np.full(STATE, np.nan)
        self._ticks, self._asked = ticks, 0
        self._program: Program | None = None
        self._late = Delays(scenario.table, ticks)

    def begin(self, first: Array, launch: Launch) -> None:
        """Ask the vehicle's process to start the simulation; the answer is read later, by `answers`.

        Args:
            first: Pose (7,) and velocity (6,) at the start, joined, (13,).
            launch: Function that starts the process, used at the first call.
        """
        self._program = self._program or launch(self.scenario)
        self.first, self.told, self._late = first, [], Delays(self.scenario.table, self._ticks)
        self._program.reset(first)
        self._asked = 1

    def go_on(self, commands: Array) -> None:
        """Ask the vehicle's process for one control step with commands (n,); `answers` reads the result."""
        assert self._program is not None
        self.told.append(np.array(commands))
        parts = list(self._late.felt(self.scenario.setpoints(commands)))
        for ticks, setpoints in parts:
            self._program.hold(ticks, setpoints)
        self._asked = len(parts)

    def answers(self) -> Iterator[Row]:
        """Yield the process's answers to the last request, one for each part of a control step."""
        assert self._program is not None
        for _ in range(self._asked):
            yield self._program.answer()
