"""The embedded teacher: a reference simulator of a vehicle in water that needs no other program.

Rigid body, weight and buoyancy, and thrusters are those of the vehicle file; the water's forces are not.
They come from panels on the hull (`vehicle.panels`) and the added mass of the ellipsoid of the hull's size
(`vehicle.ellipsoid`), independent of the catalogue's laws.  The file's own effects of the names in `REPLACED`
are therefore ignored; its other effects act, and so do hidden ones, which the file knows nothing of.

The motion is integrated by RK4 at 500 Hz, with the panel force evaluated at every stage.  Commands are made
at 50 Hz from the session's demand and holds (`vehicle.control_allocation`), in the same compiled loop, from
the true state.
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
"""Integration steps per row: 500 Hz."""
DEPTH = 50.0
"""Depth [m] by default: walks stray by some 20 m from the light hold, and should not break the surface."""
REPLACED = frozenset(with_role(Role.HULL_WATER))
"""Effects of a file that panels and ellipsoid stand in for; the lift of fins is not among them."""

Report = Callable[[int], None]


class Subject(Protocol):
    """A vehicle that can be recorded, in whatever simulator; attributes as of `Teacher`."""

    @property
    def vehicle(self) -> Vehicle:
        """What is simulated."""

    @property
    def mixing(self) -> Mixing:
        """How demands become commands."""

    @property
    def log(self) -> Array:
        """The velocity log, with the errors of its sensor effects."""

    def fly(
        self, demand: Array, *, depth: float, heading: float, hold_heading: bool, sea: Sequence[int]
    ) -> tuple[Array, Array]:
        """True motion of one session and the commands that made it; arguments as of the function `fly`."""


@dataclass(frozen=True)
class Programme:
    """What a vehicle is recorded doing.

    Attributes:
        excitation: One of `simulation.excitation.DECKS`.
        depth: Depth of the start and of the hold [m].
    """

    excitation: str = "hybrid"
    depth: float = DEPTH


@dataclass(frozen=True)
class Teacher:
    """A vehicle ready to be recorded.

    Attributes:
        vehicle: What is simulated: the file without the effects that the teacher replaces, with the
            ellipsoid's added mass and the hidden effects.
        program: The same, compiled.
        hull: Its panels.
        facets: (8, F), for the panel kernel.
        mixing: How demands become commands; it knows the file and the hull, nothing that is hidden.
        log: The velocity log, with the errors of its sensor effects.
        ignored: Names of the file's effects that panels and ellipsoid stand in for.
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
        """M_A (6, 6) of the equivalent ellipsoid about CO."""
        return _ellipsoid_added_mass(self.vehicle)

    def fly(
        self, demand: Array, *, depth: float, heading: float, hold_heading: bool, sea: Sequence[int]
    ) -> tuple[Array, Array]:
        """True motion of one session and the commands that made it; arguments as of the function `fly`."""
        return fly(self, demand, depth=depth, heading=heading, hold_heading=hold_heading, sea=sea)


def teacher(
    vehicle: Vehicle,
    *,
    mesh: tuple[Array, Any] | None = None,
    hidden: Sequence[Mapping[str, Any]] = (),
) -> Teacher:
    """Build the teacher of a vehicle.

    Args:
        vehicle: The vehicle file.
        mesh: Vertices [m] and faces of its hull in body axes about CO; by default a superellipsoid of the
            hull's size.
        hidden: Effect tables that act without standing in the vehicle file, as under `[[effect]]`.

    Raises:
        DataError: The mesh encloses nothing or has not the hull's size, or an effect is not admitted.
    """
    hull = panels(*surface_of(vehicle, mesh))
    _require_size(hull, vehicle)
    validate(vehicle)
    kept = [table for table in vehicle.effect if called(table)[1] not in REPLACED]
    ellipsoid = {"name": ADDED_MASS.name, "matrix": _ellipsoid_added_mass(vehicle).tolist()}
    believed = msgspec.structs.replace(vehicle, effect=(*kept, ellipsoid))
    besides = [dict(table) for table in hidden]
    actual = msgspec.structs.replace(vehicle, effect=(*believed.effect, *besides))
    # Panels damp, and the file says by about how much: what couples axes needs that beside it.
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
    """Vertices [m] and faces of a hull: those of a mesh, else of a superellipsoid of the hull's size."""
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
    """Record a vehicle under a programme of excitation.

    Args:
        subject: From `teacher`, or a vehicle in another simulator.
        rows: Rows to record in all, at 50 Hz.
        seed: Seed of the sessions, the demands, the headings and the noise.
        programme: What it does, and how deep.
        noise: Of the sensors; none by default.
        threads: Sessions flown at a time, by default one per core; the result does not depend on it.
        report: Called with the number of rows done, from this thread.

    Returns:
        The raw table: `session`, `t` (float64), pose, velocity and commands (float32).

    Raises:
        DataError: Too many rows, no such programme, no axis to excite, or a motion that diverges.
    """
    extent.require_rows(rows)
    flown = programme or Programme()
    sessions = plan(rows, seed, subject.mixing.axes, excitation=flown.excitation)

    def fly_one(session: Session) -> pl.DataFrame:
        return _logged(subject, session, seed, flown.depth, noise or Noise())

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
    """True motion of one session, from a level attitude, and the commands that made it.

    Args:
        subject: From `teacher`.
        demand: (N, 6) shares of each axis's authority, one row per 1/50 s.
        depth: Depth of the start and of the hold [m].
        heading: Heading of the start, and of the hold [rad].
        hold_heading: Whether heading is held besides depth, roll and pitch.
        nu: Velocity of the start over ground (6,), body axes; rest by default [m/s, rad/s].
        sea: Seeds of the waves, where the file has them or they are hidden.

    Returns:
        Motion (N, 12) x … psi, u … r, and effective commands (N, n), see `recording.supply`.

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
    reached: int = _follow(program.flat, subject.facets, first, course, pilot, states)
    if reached < rows:
        raise DataError(
            f"the motion diverges by t = {reached / LOG_RATE:g} s: check the vehicle's inertia, "
            "and what is hidden"
        )
    return np.hstack([states[:, :3], euler_from_quaternion(states[:, 3:7]), states[:, 7:]]), commands


def _logged(subject: Subject, session: Session, seed: int, depth: float, noise: Noise) -> pl.DataFrame:
    """One session as it is logged: sensor effects on the true motion, then noise."""
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
    motion[:, 6:] = sensor.measured(subject.log, t, motion[:, 6:])
    motion = disturb(motion, noise, noise_rng)
    names = [*MOTION_COLUMNS, *command_columns(commands.shape[1])]
    columns = np.hstack([motion, given_commands(subject.vehicle, commands)]).astype(np.float32)
    return pl.DataFrame(
        {"session": [session.name] * session.rows, "t": t}
        | {name: np.ascontiguousarray(columns[:, i]) for i, name in enumerate(names)}
    )


@jit
def _follow(flat: Array, facets: Array, first: Array, course: Course, pilot: Pilot, out: Array) -> int:
    """Fly one session from `first` (13,); the number of rows of `out` (N, 13) that stayed finite.

    The commands of the course are the pilot's, written row by row.
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
    """Refuse a mesh that is not of the hull's size: most likely it is in other units or axes."""
    stated = np.array([vehicle.hull.length, vehicle.hull.width, vehicle.hull.height])
    if np.abs(hull.extent - stated).max() > 0.05 * stated.max():
        found, wanted = (" x ".join(f"{value:.3g}" for value in sizes) for sizes in (hull.extent, stated))
        raise DataError(
            f"hull.mesh: the mesh is {found} m, but [hull] says {wanted} m: give it in metres, with axes x "
            "forward, y right, z down"
        )
