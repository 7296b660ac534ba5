"""Stonefish scenario (`.scn`) of a vehicle, and its commands as setpoints of Stonefish's thrusters.

Rigid body, buoyancy, thrusters, a uniform current, constant weights and payloads are those of the vehicle.
Stonefish computes the water forces, from the facets of the hull's mesh and an ellipsoid around it.

A thruster's setpoint is the settled value of its lag state (`vehicle.thrusters`): the normalised rotor speed,
or the thrust [N] if the lag acts on thrust.  Stonefish's first-order rotor takes an Euler step per tick.  Its
time constant is chosen so that a tick has the same decay as the vehicle's lag.  Dead band, curve, gain and
asymmetry form its thrust model: exact if Stonefish has that form, else a table.  `Delays` applies delays in
whole ticks.
"""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.effects.catalogue import Entry, current, entries, inertia_matrix, thruster_table
from hydro.core.effects.program import constants
from hydro.core.errors import DataError
from hydro.core.simulation.velocity_laws import Law, law
from hydro.core.vehicle.description import RigidBody, Thruster, Vehicle, require_names
from hydro.core.vehicle.frames import euler_from_rotation, skew
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.core.vehicle.thrusters import (
    ASYMMETRY,
    BEYOND,
    DEADBAND,
    DELAY,
    GAIN,
    INFLOW,
    MAX_REVERSE,
    MAX_THRUST,
    POWER,
    SHIFT,
    SPEED_LAG,
    UNIT_FORCE,
    UNIT_MOMENT,
    lag_decay,
    settled_state,
    state_to_thrust,
)
from hydro.sim.teacher import REPLACED

RATE = 500.0
"""Ticks per second [Hz]."""
HULL, SCENARIO = "hull.obj", "vehicle.scn"
KNOTS = 400
"""Number of knots of a thrust table on either side of zero."""
SATURATING = 1e9
"""Command that saturates every thruster."""
BEGIN = "0 0 100"
"""Position of the vehicle before its first reset: under water."""
PROPELLER = {"diameter": 0.2, "right": "true"}
"""Attributes of every propeller in the scenario."""


@dataclass(frozen=True)
class Scenario:
    """Description of a vehicle for Stonefish: scenario file, hull mesh and thrusters.

    Attributes:
        text: Text of the `.scn` file.
        hull: Mesh of the hull, as a Wavefront OBJ file.
        pushing: Indices (k,) of the commands of the k thrusters, without those of servos.
        table: Thruster table (k, columns) of these thrusters, with all effects of the vehicle.
    """

    text: str
    hull: str
    pushing: NDArray[np.int64]
    table: Array

    def write(self, folder: Path) -> Path:
        """Write the scenario and its mesh into a folder; return the path of the scenario."""
        (folder / HULL).write_text(self.hull, encoding="utf-8")
        (folder / SCENARIO).write_text(self.text, encoding="utf-8")
        return folder / SCENARIO

    def setpoints(self, commands: ArrayLike) -> Array:
        """Return the setpoints of Stonefish's k thrusters (k,), given effective commands (n,)."""
        return _setpoints(self.table, np.asarray(commands, dtype=np.float64)[self.pushing])


class Delays:
    """Memory of thruster setpoints, which act after their delays, in steps (ticks) of Stonefish."""

    def __init__(self, table: Array, ticks: int) -> None:
        """Start at rest.

        Args:
            table: Thruster table.
            ticks: Number of ticks per step.
        """
        late = np.rint(table[:, DELAY] * RATE).astype(np.int64)
        self._whole, self._part = np.divmod(late, ticks)
        self._ticks = ticks
        self._past = np.zeros((int(self._whole.max(initial=0)) + 2, len(table)))

    def felt(self, setpoints: Array) -> Iterator[tuple[int, Array]]:
        """Store the setpoints of a new control step; yield the parts of this step with constant setpoints.

        Args:
            setpoints: Setpoints that are given from now on (k,).

        Yields:
            Number of ticks of the part, and the delayed setpoints (k,) that act during it.
        """
        self._past[:-1] = self._past[1:]
        self._past[-1] = setpoints
        each = np.arange(len(setpoints))
        new, old = self._past[-1 - self._whole, each], self._past[-2 - self._whole, each]
        edges = np.unique([0, *self._part, self._ticks]).tolist()
        for begin, end in itertools.pairwise(edges):
            yield end - begin, np.where(self._part <= begin, new, old)


def scenario(vehicle: Vehicle, mesh: tuple[Array, NDArray[np.int64]]) -> Scenario:
    """Return the description of a vehicle for Stonefish.

    Args:
        vehicle: Vehicle; Stonefish replaces its effects named in `teacher.REPLACED`.
        mesh: Vertices (V, 3) [m], FRD about CO, and faces (F, 3) of its hull, closed and outward.

    Raises:
        DataError: Stonefish cannot represent an effect or a thruster, or a name is not allowed; the message
            has its path in the vehicle file.
    """
    require_names(vehicle)
    listed = [entry for entry in entries(vehicle) if entry.effect.name not in REPLACED]
    laws = _laws(vehicle, listed)
    body = _with_payloads(vehicle, listed)
    lift, moment = _buoyancy(vehicle, laws, body)
    water, table = _water(vehicle, listed), thruster_table(vehicle, listed)
    root = ET.Element("scenario")
    own = _add(root, "hydro", rate=RATE, gravity=vehicle.environment.gravity)
    _add(own, "buoyancy", force=lift, moment=moment)
    environment = _add(root, "environment")
    _add(environment, "ned", latitude=0.0, longitude=0.0)
    ocean = _add(environment, "ocean")
    _add(ocean, "water", density=vehicle.environment.water_density)
    if water.any():
        _add(_add(ocean, "current", type="uniform"), "velocity", xyz=water)
    _add(_add(root, "materials"), "material", name="hull", density=1000.0, restitution=0.5)
    robot = _add(root, "robot", name="vehicle", fixed="false", self_collisions="false", algorithm="general")
    _body(_add(robot, "base_link", name="base", type="model", physics="submerged"), body)
    for thruster, row in zip(vehicle.thruster, table, strict=True):
        if thruster.pushes:
            _thruster(_add(robot, "actuator", name=thruster.name, type="thruster"), thruster, row)
    _add(robot, "world_transform", xyz=BEGIN, rpy="0 0 0")
    ET.indent(root)
    pushing = np.flatnonzero([thruster.pushes for thruster in vehicle.thruster])
    return Scenario(ET.tostring(root, encoding="unicode") + "\n", _obj(*mesh), pushing, table[pushing])


@jit
def _setpoints(table: Array, commands: Array) -> Array:
    out = np.empty(len(table))
    for i in range(len(table)):
        out[i] = settled_state(table[i], commands[i])
    return out


def _laws(vehicle: Vehicle, listed: list[Entry]) -> list[Law]:
    """Return the constant forces of the vehicle's weights and payloads.

    Raises:
        DataError: An effect is not a weight, payload or current, nor of thrusters or sensors.
    """
    c, laws = constants(vehicle, listed), []
    for entry in listed:
        effect, found = entry.effect, law(entry, c)
        still = effect.kernel is None if found is None else not _depends_on_motion(found)
        if effect.is_random or not still:
            raise DataError(
                f"{entry.where}: Stonefish has no {effect.name} like this one; leave it out, or record with "
                "--teacher panel"
            )
        laws += [] if found is None else [found]
    return laws


def _depends_on_motion(found: Law) -> bool:
    """Return whether a force law has terms that depend on the velocity."""
    return any(one.any() for one in (found.linear, found.sized, found.plain))


def _with_payloads(vehicle: Vehicle, listed: list[Entry]) -> RigidBody:
    """Return the rigid body including the dry mass of its payloads.

    Raises:
        DataError: An effect adds inertia that no rigid body can have.
    """
    body, added = vehicle.rigid_body, inertia_matrix(vehicle, listed)
    if not added.any():
        return body
    matrix = mass_matrix(vehicle) + added
    mass = float(matrix[0, 0])
    center = np.array([matrix[5, 1], matrix[3, 2], matrix[4, 0]]) / mass
    about = matrix[3:, 3:] + mass * skew(center) @ skew(center)
    loaded = msgspec.convert(
        {"mass": mass, "center_of_gravity": center.tolist(), "inertia": about.tolist()}, RigidBody
    )
    made = mass_matrix(msgspec.structs.replace(vehicle, rigid_body=loaded))
    if np.abs(made - matrix).max() > 1e-9 * np.abs(matrix).max():
        raise DataError("effect: adds inertia that no rigid body has, and Stonefish's added mass is its own")
    return loaded


def _buoyancy(vehicle: Vehicle, laws: list[Law], body: RigidBody) -> tuple[float, Array]:
    """Return the buoyancy B [N] reduced by constant weights, and B times its centre about CO (3,) [N m].

    Payloads state their weight in water.  Stonefish adds the weight of their dry mass, so B compensates it.

    Args:
        vehicle: The vehicle.
        laws: Constant forces of weights and payloads.
        body: Rigid body including the dry mass of payloads.
    """
    lift = vehicle.buoyancy.force
    moment = lift * np.array(vehicle.buoyancy.center)
    dry, gravity = vehicle.rigid_body, vehicle.environment.gravity
    for sign, one in ((1.0, body), (-1.0, dry)):
        lift += sign * gravity * one.mass
        moment = moment + sign * gravity * one.mass * np.array(one.center_of_gravity)
    for weight in laws:
        lift -= weight.force
        moment = moment - weight.moment
    return lift, moment


def _water(vehicle: Vehicle, listed: list[Entry]) -> Array:
    """Return the velocity of the water (3,), NED [m/s].

    Raises:
        DataError: The velocity varies in space or time.
    """
    flow = current(vehicle, listed)
    if flow[3:].any():
        raise DataError(
            "effect: the water velocity varies in space or time, but Stonefish's current is uniform: "
            "give one velocity, or record with --teacher panel"
        )
    return np.asarray(flow[:3])


def _body(link: ET.Element, body: RigidBody) -> None:
    """Add mesh, mass, centre of gravity and principal inertia of the only link."""
    physical = _add(link, "physical")
    _add(physical, "mesh", filename=HULL, scale=1.0)
    _add(physical, "origin", xyz="0 0 0", rpy="0 0 0")
    _add(link, "material", name="hull")
    _add(link, "look", name="hull")
    moments, axes = _principal(np.array(body.inertia))
    _add(link, "mass", value=body.mass)
    _add(link, "inertia", xyz=moments)
    _add(link, "cg", xyz=np.array(body.center_of_gravity), rpy=euler_from_rotation(axes))


def _principal(inertia: Array) -> tuple[Array, Array]:
    """Return principal moments (3,) [kg m^2] and axes (3, 3) as columns; a diagonal matrix stays as it is.

    Of all permutations of the axes, the one with the smallest rotation is returned.
    """
    if not (inertia - np.diag(np.diag(inertia))).any():
        return np.diag(inertia), np.eye(3)
    moments, axes = np.linalg.eigh(inertia)
    order = list(max(itertools.permutations(range(3)), key=lambda p: np.abs(axes[:, list(p)]).trace()))
    axes = axes[:, order] * np.where(np.diag(axes[:, order]) < 0.0, -1.0, 1.0)
    if np.linalg.det(axes) < 0.0:
        axes[:, np.argmin(np.diag(axes))] *= -1.0
    return moments[order], axes


def _thruster(actuator: ET.Element, thruster: Thruster, row: Array) -> None:
    """Add position, rotor and thrust model of one thruster.

    Raises:
        DataError: The thruster has a torque about its own axis, or loses thrust to the flow.
    """
    force, moment = row[UNIT_FORCE], row[UNIT_MOMENT]
    size = float(np.linalg.norm(force))
    if size == 0.0 or abs(force @ moment) > 1e-9 * size * max(float(np.linalg.norm(moment)), size):
        raise DataError(
            f"thruster {thruster.name}: Stonefish has no thruster with a torque about its own axis: give a "
            "position and a direction, without propeller torque"
        )
    if row[INFLOW] != 0.0:
        raise DataError(
            f"thruster {thruster.name}: Stonefish's thrust by table or dead band ignores the flow: leave the "
            "loss to inflow out, or record with --teacher panel"
        )
    a, b, c = force / size
    place = np.cross(force, moment) / size**2 if thruster.position is None else np.array(thruster.position)
    _add(actuator, "link", name="base")
    _add(actuator, "origin", xyz=place, rpy=np.array([0.0, np.arctan2(-c, np.hypot(a, b)), np.arctan2(b, a)]))
    propeller = _add(actuator, "propeller", **PROPELLER)
    _add(propeller, "mesh", filename=HULL, scale=0.1)
    _add(propeller, "material", name="hull")
    _add(
        actuator, "specs", max_setpoint=max(settled_state(row, SATURATING), -settled_state(row, -SATURATING))
    )
    decay = lag_decay(row, 1.0 / RATE)
    rotor = _add(actuator, "rotor_dynamics", type="first_order" if decay > 0.0 else "zero_order")
    if decay > 0.0:
        _add(rotor, "time_constant", value=1.0 / RATE / (1.0 - decay))
    _thrust_model(actuator, row, size)


def _thrust_model(actuator: ET.Element, row: Array, size: float) -> None:
    """Add the thrust model: Stonefish's square law with a dead band if it fits, else a table."""
    band = row[DEADBAND]
    if row[SPEED_LAG] and row[POWER] == 2.0 and (row[SHIFT] or band == 0.0):
        slope = size * (1.0 + row[GAIN]) / (1.0 - band**2)
        model = _add(actuator, "thrust_model", type="deadband")
        ahead, astern = row[MAX_THRUST], row[MAX_REVERSE] * (1.0 - row[ASYMMETRY])
        _add(model, "thrust_coeff", forward=slope * ahead, reverse=slope * astern)
        _add(model, "deadband", lower=-(band**2), upper=band**2)
        return
    if row[SPEED_LAG]:
        beyond = np.linspace(np.nextafter(band, 2.0), 1.0 + row[BEYOND], KNOTS)
        beyond = beyond if band == 0.0 else np.concatenate([[band], beyond])
        knots = np.concatenate([-beyond[::-1], [0.0], beyond])
    else:
        knots = np.array([settled_state(row, -SATURATING), 0.0, settled_state(row, SATURATING)])
    model = _add(actuator, "thrust_model", type="linear_interpolation")
    _add(model, "input", value=knots)
    _add(model, "output", value=np.array([size * state_to_thrust(row, knot, 0.0) for knot in knots]))


def _obj(vertices: Array, faces: NDArray[np.int64]) -> str:
    """Return a mesh as a Wavefront OBJ file."""
    lines = [f"v {_text(vertex)}" for vertex in np.asarray(vertices, np.float64)]
    lines += [f"f {' '.join(str(corner + 1) for corner in face)}" for face in np.asarray(faces).tolist()]
    return "\n".join(lines) + "\n"


def _add(parent: ET.Element, tag: str, **attributes: Any) -> ET.Element:
    """Add an element; numbers are written with all digits."""
    return ET.SubElement(parent, tag, {name: _text(value) for name, value in attributes.items()})


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    return " ".join(repr(float(each)) for each in np.atleast_1d(value))
