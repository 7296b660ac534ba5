"""Embedded simulator (the teacher): a reference simulation of a vehicle in water without other programs.

Rigid body, weight, buoyancy and thrusters are those of the vehicle file; the water forces are not.  They come
from panels on the hull (`vehicle.panels`) and the added mass of an ellipsoid of the hull's size
(`vehicle.ellipsoid`), independent of the laws of the catalogue.  So the file's effects in `REPLACED` are
ignored.  Its other effects act, and so do hidden effects, which are not in the file.

The motion is integrated by RK4 at 500 Hz, with the panel force evaluated at every stage.  Commands are
computed at 50 Hz from the session's demand and holds (`vehicle.control_allocation`), in the same compiled
loop, from the true state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, Protocol

import msgspec
import numpy as np
import polars as pl
from numpy.typing import ArrayLike

from hydro.core.columns import MOTION as MOTION_COLUMNS
from hydro.core.columns import Array, command_columns
from hydro.core.compiled import jit
from hydro.core.effects import CATALOGUE, Program, assemble, inertia_matrix, sensor, validate, velocity_log
from hydro.core.effects.catalogue import with_role
from hydro.core.effects.inertia import ADDED_MASS
from hydro.core.effects.layout import TIME
from hydro.core.effects.record import Role
from hydro.core.errors import DataError
from hydro.core.recording import extent
from hydro.core.recording.supply import given_commands
from hydro.core.simulation.dynamics import BODY, afloat, settle
from hydro.core.simulation.excitation import LOG_RATE, Session, demands, holds_heading, plan
from hydro.core.simulation.integrate import Course, at_rest, march, resume
from hydro.core.simulation.pilot import Pilot
from hydro.core.simulation.sensor_noise import Noise, disturb
from hydro.core.simulation.steady_motion import wrench_limits
from hydro.core.threads import available
from hydro.core.vehicle.control_allocation import Mixing, mixing
from hydro.core.vehicle.description import Vehicle, called
from hydro.core.vehicle.ellipsoid import added_mass_matrix
from hydro.core.vehicle.frames import euler_from_quaternion, quaternion_from_euler
from hydro.core.vehicle.panels import Panels, loaded_facets, panels, superellipsoid
from hydro.core.vehicle.rigid_body import mass_matrix

SUBSTEPS = 10
"""Number of integration steps per row: 500 Hz."""
DEPTH = 50.0
"""Default depth [m]: excitation moves a vehicle some 20 m from its hold; it must stay below the surface."""
REPLACED = frozenset(with_role(Role.HULL_WATER))
"""Effects of a file that panels and ellipsoid replace; the lift of fins is not among them."""

Report = Callable[[int], None]


class Subject(Protocol):
    """Interface of a vehicle that can be recorded, in any simulator; see `Teacher` for the attributes."""

    @property
    def vehicle(self) -> Vehicle:
        """Simulated vehicle."""

    @property
    def mixing(self) -> Mixing:
        """Control allocation: constants that convert demanded wrenches to commands."""

    @property
    def log(self) -> Array:
        """Errors of the DVL as one vector, (16,), from the sensor effects; see `core.effects.sensor`."""

    def fly(
        self, demand: Array, *, depth: float, heading: float, hold_heading: bool, sea: Sequence[int]
    ) -> tuple[Array, Array]:
        """Return the true motion of one session, and its effective commands.

        Args:
            demand: Demanded wrench of N rows of 1/50 s, as fractions of each axis's greatest wrench, (N, 6).
            depth: Depth of the start, which is held [m].
            heading: Heading of the start, which is held if `hold_heading` is true [rad].
            hold_heading: Hold the heading in addition to depth, roll and pitch.
            sea: Seeds of the waves.

        Returns:
            Motion (N, 12), x to psi [m, rad] and u to r [m/s, rad/s], and the commands (N, n).
        """


@dataclass(frozen=True)
class Programme:
    """Manoeuvres of a simulated recording.

    Attributes:
        excitation: One of `simulation.excitation.DECKS`.
        depth: Depth of the start, which is held [m].
    """

    excitation: str = "hybrid"
    depth: float = DEPTH


@dataclass(frozen=True)
class Teacher:
    """Vehicle ready to be recorded in the embedded simulator.

    Attributes:
        vehicle: Simulated vehicle: the file without the replaced effects, with the ellipsoid's added mass and
            the hidden effects.
        program: The simulated vehicle, compiled.
        hull: Panels of the hull.
        facets: Geometry of the F panels (8, F), for the panel kernel.
        mixing: Control allocation from demands to commands; it uses the file and the hull, but no hidden
            effects.
        log: Errors of the DVL as one vector, (16,), from the sensor effects.
        ignored: Names of the file's effects that panels and ellipsoid replace.
    """

    vehicle: Vehicle
    program: Program
    hull: Panels
    facets: Array
    mixing: Mixing
    log: Array
    ignored: tuple[str, ...]

    @property
    def added_mass(self) -> Array:
        """Added mass M_A (6, 6) of the equivalent ellipsoid about the body origin CO [kg, kg m, kg m^2]."""
        return _ellipsoid_added_mass(self.vehicle)

    def fly(
        self, demand: Array, *, depth: float, heading: float, hold_heading: bool, sea: Sequence[int]
    ) -> tuple[Array, Array]:
        """Return the true motion of one session in the embedded simulator, and its effective commands.

        Args:
            demand: Demanded wrench of N rows of 1/50 s, as fractions of each axis's greatest wrench, (N, 6).
            depth: Depth of the start, which is held [m].
            heading: Heading of the start, which is held if `hold_heading` is true [rad].
            hold_heading: Hold the heading in addition to depth, roll and pitch.
            sea: Seeds of the waves, if there are waves in the file or hidden.

        Returns:
            Motion (N, 12), x to psi [m, rad] and u to r [m/s, rad/s], and the commands (N, n).
        """
        return fly(self, demand, depth=depth, heading=heading, hold_heading=hold_heading, sea=sea)


def teacher(
    vehicle: Vehicle,
    *,
    mesh: tuple[Array, Any] | None = None,
    hidden: Sequence[Mapping[str, Any]] = (),
) -> Teacher:
    """Return a vehicle that is ready to be recorded in the embedded simulator.

    Args:
        vehicle: Vehicle file.
        mesh: Vertices [m] and faces of its hull in body axes about CO; by default a superellipsoid of the
            hull's size.
        hidden: Effect tables, as under `[[effect]]`, that act but are not in the vehicle file.

    Raises:
        DataError: The mesh encloses no volume or does not have the hull's size, or an effect is not allowed.
    """
    hull = panels(*surface_of(vehicle, mesh))
    _require_size(hull, vehicle)
    validate(vehicle)
    kept = [table for table in vehicle.effect if called(table)[1] not in REPLACED]
    ellipsoid = {"name": ADDED_MASS.name, "matrix": _ellipsoid_added_mass(vehicle).tolist()}
    believed = msgspec.structs.replace(vehicle, effect=(*kept, ellipsoid))
    besides = [dict(table) for table in hidden]
    actual = msgspec.structs.replace(vehicle, effect=(*believed.effect, *besides))
    # Effects that couple axes need damping: the panels provide it, and the file's damping is its estimate.
    validate(actual, msgspec.structs.replace(vehicle, effect=(*vehicle.effect, *besides)))
    facets = loaded_facets(hull, vehicle.environment.water_density)
    crew = mixing(vehicle, mass_matrix(vehicle) + inertia_matrix(believed))
    limits = wrench_limits(assemble(believed), facets, crew.righting)
    return Teacher(
        vehicle=actual,
        program=assemble(actual),
        hull=hull,
        facets=facets,
        mixing=replace(crew, authority=np.minimum(crew.authority, limits)),
        log=velocity_log(actual),
        ignored=tuple(dict.fromkeys(str(t["name"]) for t in vehicle.effect if called(t)[1] in REPLACED)),
    )


def surface_of(vehicle: Vehicle, mesh: tuple[Array, Any] | None) -> tuple[Array, Any]:
    """Return a pair of the vertices (V, 3) [m] and the triangles (F, 3) of a hull.

    Args:
        vehicle: Vehicle file, for the size of the hull.
        mesh: Vertices and faces of the hull, which are returned as they are; None for a superellipsoid of the
            hull's size.
    """
    size = vehicle.hull
    return superellipsoid(size.length, size.width, size.height, size.center) if mesh is None else mesh


def collect(
    subject: Subject,
    rows: int,
    seed: int,
    *,
    programme: Programme | None = None,
    noise: Noise | None = None,
    threads: int | None = None,
    report: Report | None = None,
) -> pl.DataFrame:
    """Simulate a recording in which a vehicle is excited, and return it as a raw table.

    Args:
        subject: Vehicle from `teacher`, or in another simulator.
        rows: Total number of rows, at 50 Hz.
        seed: Seed of the sessions, demands, headings and noise.
        programme: Excitation and depth.
        noise: Sensor noise; none by default.
        threads: Number of parallel sessions, by default one per core; the result does not depend on it.
        report: Called with the number of finished rows, from this thread.

    Returns:
        Raw table: `session`, `t` (float64), pose, velocity and commands (float32).

    Raises:
        DataError: There are too many rows, no such excitation or no axis to excite, or the motion diverges.
    """
    extent.require_rows(rows)
    flown = programme or Programme()
    sessions = plan(rows, seed, subject.mixing.axes, excitation=flown.excitation)

    def fly_one(session: Session) -> pl.DataFrame:
        return _logged_session(subject, session, seed, flown.depth, noise or Noise())

    frames: list[pl.DataFrame] = []
    done = 0
    with ThreadPoolExecutor(threads or available()) as pool:
        for frame in pool.map(fly_one, sessions):
            frames.append(frame)
            done += frame.height
            if report is not None:
                report(done)
    return pl.concat(frames, rechunk=True)


def fly(
    subject: Teacher,
    demand: Array,
    *,
    depth: float = DEPTH,
    heading: float = 0.0,
    hold_heading: bool = False,
    nu: ArrayLike = (0.0,) * 6,
    sea: Sequence[int] = (0,),
) -> tuple[Array, Array]:
    """Return the true motion of one session, which begins at a level attitude, and its commands.

    Args:
        subject: Vehicle from `teacher`.
        demand: Demanded wrench of N rows of 1/50 s, as fractions of each axis's greatest wrench, (N, 6).
        depth: Depth of the start, which is held [m].
        heading: Heading of the start, which is held if `hold_heading` is true [rad].
        hold_heading: Hold the heading in addition to depth, roll and pitch.
        nu: Initial velocity over ground, (6,), body axes; rest by default [m/s, rad/s].
        sea: Seeds of the waves, if there are waves in the file or hidden.

    Returns:
        Motion (N, 12), x to psi [m, rad] and u to r [m/s, rad/s], and effective commands (N, n), see
        `recording.supply`.

    Raises:
        DataError: The motion diverges.
    """
    rows, thrusters = len(demand), subject.program.thrusters
    first = np.zeros(BODY)
    first[2], first[3:7], first[7:] = depth, quaternion_from_euler(0.0, 0.0, heading), nu
    states, commands = np.empty((rows, BODY)), np.zeros((rows, thrusters))
    program = subject.program
    if any(CATALOGUE[table["name"]].is_random for table in subject.vehicle.effect):
        program = assemble(subject.vehicle, sea=sea)
    pilot = Pilot.of(subject.mixing, demand, first[2], heading if hold_heading else None)
    course = Course(commands, np.arange(rows) / LOG_RATE, SUBSTEPS, 1.0 / (LOG_RATE * SUBSTEPS))
    reached: int = _simulate(program.flat, subject.facets, first, course, pilot, states)
    if reached < rows:
        raise DataError(
            f"the motion diverges by t = {reached / LOG_RATE:g} s: check the vehicle's inertia, "
            "and hidden effects"
        )
    return np.hstack([states[:, :3], euler_from_quaternion(states[:, 3:7]), states[:, 7:]]), commands


def _logged_session(
    subject: Subject, session: Session, seed: int, depth: float, noise: Noise
) -> pl.DataFrame:
    """Return one session as logged: sensor effects on the true motion, then noise."""
    demand = demands(session, seed, 1.0 / LOG_RATE)
    heading_rng, noise_rng = (np.random.default_rng([seed, session.number + 1, use]) for use in (1, 2))
    heading = float(heading_rng.uniform(-np.pi, np.pi))
    motion, commands = subject.fly(
        demand,
        depth=depth,
        heading=heading,
        hold_heading=holds_heading(session.kind),
        sea=(seed, session.number + 1),
    )
    t = np.arange(session.rows) / LOG_RATE
    motion[:, :6] = sensor.logged_pose(subject.log, motion[:, :6])
    motion[:, 6:] = sensor.measured(subject.log, t, motion[:, 6:])
    motion = disturb(motion, noise, noise_rng)
    names = [*MOTION_COLUMNS, *command_columns(commands.shape[1])]
    columns = np.hstack([motion, given_commands(subject.vehicle, commands)]).astype(np.float32)
    return pl.DataFrame(
        {"session": [session.name] * session.rows, "t": t}
        | {name: np.ascontiguousarray(columns[:, i]) for i, name in enumerate(names)}
    )


@jit
def _simulate(flat: Array, facets: Array, first: Array, course: Course, pilot: Pilot, out: Array) -> int:
    """Simulate one session from a pose and velocity `first` (13,); return the number of finite rows of `out`.

    The pilot writes the commands of the course row by row; `out` (N, 13) gets pose and velocity.
    """
    motion, thrusters = afloat(flat, facets), at_rest(flat)
    motion.y[:BODY], motion.s[TIME] = first, course.t[0]
    settle(motion)
    resume(thrusters, course, 0, False)
    return march(motion, thrusters, course, 0, out, pilot, None)


def _ellipsoid_added_mass(vehicle: Vehicle) -> Array:
    size = vehicle.hull
    semi_axes = (0.5 * size.length, 0.5 * size.width, 0.5 * size.height)
    return added_mass_matrix(semi_axes, vehicle.environment.water_density, size.center)


def _require_size(hull: Panels, vehicle: Vehicle) -> None:
    """Check that a mesh has about the size of the vehicle's hull.

    Raises:
        DataError: The sizes differ, probably because the mesh has other units or axes.
    """
    stated = np.array([vehicle.hull.length, vehicle.hull.width, vehicle.hull.height])
    if np.abs(hull.extent - stated).max() > 0.05 * stated.max():
        found, wanted = (" x ".join(f"{value:.3g}" for value in sizes) for sizes in (hull.extent, stated))
        raise DataError(
            f"hull.mesh: the mesh is {found} m, but [hull] says {wanted} m: give it in metres, with axes x "
            "forward, y right, z down"
        )
