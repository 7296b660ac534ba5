"""Recording in Stonefish: sessions for `sim.teacher.collect`, and flights with given commands.

Commands follow from demands as in the embedded simulator, with its knowledge of the vehicle.  The holds of
depth and heading use the motion in Stonefish.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.errors import DataError
from hydro.core.simulation.dynamics import BODY, Motion, afloat, observe_state
from hydro.core.simulation.excitation import LOG_RATE
from hydro.core.simulation.pilot import Pilot, steer
from hydro.core.vehicle.control_allocation import Mixing
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import body_states, euler_from_quaternion
from hydro.sim.stonefish.program import Program
from hydro.sim.stonefish.scenario import RATE, Delays, Scenario, scenario
from hydro.sim.teacher import Teacher, surface_of, teacher

TICKS = round(RATE / LOG_RATE)
"""Number of ticks per row."""

Launch = Callable[[Scenario], Program]


@dataclass(frozen=True)
class StonefishTeacher:
    """Vehicle ready to be recorded in Stonefish, for `sim.teacher.collect`.

    Attributes:
        pilot: Embedded simulator of the vehicle, with the allocation of demands and the errors of the DVL.
        scenario: Scenario for Stonefish.
        launch: Function that starts the program with a scenario.
    """

    pilot: Teacher
    scenario: Scenario
    launch: Launch = Program

    @property
    def vehicle(self) -> Vehicle:
        """Vehicle with the hidden effects, and the embedded simulator's added mass."""
        return self.pilot.vehicle

    @property
    def mixing(self) -> Mixing:
        """Control allocation: constants that convert demanded wrenches to commands."""
        return self.pilot.mixing

    @property
    def log(self) -> Array:
        """Errors of the DVL as one vector, (16,), from the sensor effects; see `core.effects.sensor`."""
        return self.pilot.log

    @property
    def ignored(self) -> tuple[str, ...]:
        """Names of the effects in the vehicle file that Stonefish's own water model replaces."""
        return self.pilot.ignored

    def version(self) -> str:
        """Start the program with the scenario, and return the version of Stonefish.

        Raises:
            DataError: Stonefish refuses the scenario, or the program fails.
            UsageError: The program is not installed.
        """
        with self.launch(self.scenario) as program:
            return program.greet()

    def fly(
        self, demand: Array, *, depth: float, heading: float, hold_heading: bool, sea: Sequence[int]
    ) -> tuple[Array, Array]:
        """Return the true motion of one session in Stonefish, and its effective commands.

        Args:
            demand: Demanded wrench of N rows of 1/50 s, as fractions of each axis's greatest wrench, (N, 6).
            depth: Depth of the start, which is held [m].
            heading: Heading of the start, which is held if `hold_heading` is true [rad].
            hold_heading: Hold the heading in addition to depth, roll and pitch.
            sea: Ignored, because Stonefish has no waves.

        Returns:
            Motion (N, 12), x to psi [m, rad] and u to r [m/s, rad/s], and the commands (N, n).

        Raises:
            DataError: The motion diverges, or the program fails.
        """
        program = self.pilot.program
        pilot = Pilot.of(self.mixing, demand, depth, heading if hold_heading else None)
        motion = afloat(program.flat, self.pilot.facets)

        def command(row: int, state: Array) -> Array:
            return _command(motion, pilot, row, state, program.thrusters)

        eta = np.array([0.0, 0.0, depth, 0.0, 0.0, heading])
        return fly(self.scenario, command, len(demand), eta=eta, launch=self.launch)


def stonefish_teacher(
    vehicle: Vehicle,
    *,
    mesh: tuple[Array, Any] | None = None,
    hidden: Sequence[Mapping[str, Any]] = (),
    launch: Launch = Program,
) -> StonefishTeacher:
    """Return a vehicle that is ready to be recorded in Stonefish.

    Args:
        vehicle: Vehicle file.
        mesh: Vertices and faces of the hull; None for an ellipsoid, see `sim.teacher.teacher`.
        hidden: `[[effect]]` tables that the simulated vehicle has in addition to its file.
        launch: Function that starts Stonefish.

    Raises:
        DataError: The embedded simulator refuses the vehicle, or Stonefish cannot represent a part of it.
    """
    surface = surface_of(vehicle, mesh)
    pilot = teacher(vehicle, mesh=surface, hidden=hidden)
    return StonefishTeacher(pilot, scenario(pilot.vehicle, surface), launch)


def fly(
    given: Scenario,
    command: Callable[[int, Array], Array],
    rows: int,
    *,
    eta: ArrayLike,
    nu: ArrayLike = (0.0,) * 6,
    launch: Launch = Program,
) -> tuple[Array, Array]:
    """Return the motion of a vehicle in Stonefish over N = `rows` rows of 1/50 s, and its commands.

    Args:
        given: Scenario of the vehicle.
        command: Function of the number of a row and the state there, (13,), that returns effective commands,
            (n,).
        rows: Number of rows N.
        eta: Pose of CO at the first row, (6,), NED [m] and Euler angles [rad].
        nu: Velocity over ground at the first row, (6,), body axes [m/s, rad/s].
        launch: Function that starts the program.

    Returns:
        Motion (N, 12), x to psi [m, rad] and u to r [m/s, rad/s], and the commands (N, n).

    Raises:
        DataError: The motion diverges, or the program fails.
    """
    late = Delays(given.table, TICKS)
    states, commands = np.empty((rows, BODY)), list[Array]()
    with launch(given) as program:
        program.reset(body_states(eta, nu))
        states[0] = program.answer().state
        for k in range(rows):
            commands.append(command(k, states[k]))
            if k + 1 < rows:
                for ticks, setpoints in late.felt(given.setpoints(commands[k])):
                    program.hold(ticks, setpoints)
                    states[k + 1] = program.answer().state
                if not np.isfinite(states[k + 1]).all():
                    raise DataError(
                        f"the motion in Stonefish diverges by t = {(k + 1) / LOG_RATE:g} s: check the "
                        "vehicle's mass, inertia and hull"
                    )
    motion = np.hstack([states[:, :3], euler_from_quaternion(states[:, 3:7]), states[:, 7:]])
    return motion, np.array(commands)


@jit
def _command(motion: Motion, pilot: Pilot, row: int, state: Array, thrusters: int) -> Array:
    """Return the pilot's commands (n,) of a row, at a state of the body (13,)."""
    commands = np.zeros(thrusters)
    motion.y[:BODY] = state
    observe_state(motion.flat, motion.y, motion.s)
    steer(pilot, row, motion.s, motion.work[0, :6], commands)
    return commands
