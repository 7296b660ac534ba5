"""Target `gz`: a Gazebo world (SDF 1.11) with a vehicle in water.

The link's frame is CO with axes forward, left, up.  Forces in Gazebo (gz-sim 8 and later, engine DART):

* `<fluid_added_mass>` about the link's origin, with its Coriolis terms;
* the Hydrodynamics plug-in: coefficients of nu_j, |nu_k| nu_j and nu_k nu_j, and a constant current;
* a Thruster plug-in for each thruster; its command is the thrust in newtons, which acts at once;
* the Buoyancy plug-in, which takes the volume and its centre from the collision shape.

`core.simulation.velocity_laws` tests which effects can be expressed by these coefficients.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from functools import reduce
from typing import Any

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.catalogue import Entry, current, entries, inertia_matrix, thruster_table
from hydro.core.effects.program import constants
from hydro.core.effects.record import Effect
from hydro.core.errors import DataError
from hydro.core.simulation.velocity_laws import Law, law
from hydro.core.vehicle.description import Thruster, Vehicle, require_names
from hydro.core.vehicle.frames import FRD_FLU, HALF_TURN
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.core.vehicle.thrusters import (
    ASYMMETRY,
    COLUMNS,
    DEADBAND,
    DELAY,
    GAIN,
    INFLOW,
    MAX_REVERSE,
    MAX_THRUST,
    POWER,
    REACTION,
    SHIFT,
    TIME_CONSTANT,
    raised,
)
from hydro.export.targets import Lack, Target, lacking_effects, sensor_reason

FORCES, VELOCITIES, AXES = "xyzkmn", "UVWPQR", "xyzpqr"  # letters in the names of Gazebo's coefficients
LINK = "base_link"
WORDS = (
    f" Written by hydro: frame {LINK} is the vehicle file's origin, forward, left, up. "
    "Thrusters take newtons. "
)
"""Comment at the top of the world."""
PROPELLER_MASS, PROPELLER_RADIUS = 1e-3, 0.02
"""Mass and radius of the links that carry the thrust [kg, m]; the main link is lighter by this mass."""
PROPELLER = {"propeller_diameter": 0.076, "thrust_coefficient": 0.02}
"""Parameters of the displayed propeller speed; the thrust does not depend on them."""


def to_sdf(vehicle: Vehicle) -> bytes:
    """Return the bytes of an SDF world file with a vehicle in water.

    Raises:
        DataError: An effect, a thruster or a name is invalid, or the vehicle has no buoyancy.
    """
    require_names(vehicle)
    found, listed = _supported(vehicle), entries(vehicle)
    total = _law(found, entries(found))
    root = ET.Element("sdf", version="1.11")
    world = _add(root, "world", name=f"{vehicle.name} in water")
    world.append(ET.Comment(WORDS))  # contains no names, because comments are not escaped
    _add(world, "gravity", [0.0, 0.0, -vehicle.environment.gravity])
    for name, system in (
        ("physics", "Physics"),
        ("user-commands", "UserCommands"),
        ("scene-broadcaster", "SceneBroadcaster"),
    ):
        _plugin(world, name, system)
    _add(_plugin(world, "buoyancy", "Buoyancy"), "uniform_fluid_density", vehicle.environment.water_density)
    sun = _add(world, "light", name="sun", type="directional")
    _add(sun, "direction", [0.0, 0.0, -1.0])
    model = _add(world, "model", name=vehicle.name)
    table = thruster_table(vehicle, listed)
    pushing = [
        (one, row) for one, row in zip(vehicle.thruster, table, strict=True) if one.position is not None
    ]
    link = _add(model, "link", name=LINK)
    _inertial(link, vehicle, inertia_matrix(found), [np.asarray(one.position) for one, _ in pushing])
    _hull(link, vehicle, total)
    for thruster, row in pushing:
        _thruster(model, vehicle, thruster, row)
    _hydrodynamics(model, total, current(found))
    ET.indent(root)
    return b'<?xml version="1.0"?>\n' + ET.tostring(root) + b"\n"


def lacks(vehicle: Vehicle) -> list[Lack]:
    """Return the properties of a vehicle that Gazebo cannot represent, such as some effects."""
    c = constants(vehicle, entries(vehicle))
    supported = {entry.where for entry in entries(vehicle) if _supports(entry, c)}
    names = {entry.effect.name for entry in entries(vehicle) if entry.where not in supported}

    def why(effect: Effect) -> str:
        if effect.actuator is not None:
            return ""
        reason = "no sum of products of velocities, nor a constant current or weight"
        return sensor_reason(effect) or (reason if effect.name in names else "")

    return [*lacking_effects(vehicle, why), *_thruster_lacks(vehicle)]


def warnings(vehicle: Vehicle) -> list[str]:
    """Return sentences of warning for the user of the SDF file, such as that thrusters take newtons."""
    lines = ["thrusters take newtons, not commands: publish on /model/NAME/joint/THRUSTER/cmd_thrust"]
    found = _supported(vehicle)
    added, body = np.diag(inertia_matrix(found)), np.diag(mass_matrix(found))
    heavy = [name for name, a, b in zip(VELOCITIES, added, body, strict=True) if a >= b]
    if heavy:
        lines.append(
            f"added mass is at least that of the vehicle in {', '.join(heavy)}: use the engine DART, which "
            "supports fluid_added_mass; the plug-in of other engines feeds it back, which is unstable"
        )
    if current(found).any():
        lines.append(
            "current: Gazebo's added mass uses nu_dot instead of nu_r_dot, so M_A [omega x R^T v_c; 0] is "
            "missing while the vehicle turns; releases before April 2026 (gz-sim 8.11, 9.5, 10.1 and older) "
            "also compute its Coriolis forces from nu"
        )
    return lines


def _supports(entry: Entry, c: Array) -> bool:
    """Return whether Gazebo can represent an effect that does not act through thrusters.

    Args:
        entry: The effect with its parameters.
        c: Constants of the vehicle's program.
    """
    effect, parameters, _ = entry
    if effect.kind == "sensor":
        return False
    if effect.flow is not None:
        flow = np.zeros(7)
        effect.flow(parameters, flow)
        return effect.kernel is None and not flow[3:].any()
    return effect.kernel is None or law(entry, c) is not None


def _supported(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with the effects that Gazebo represents, including those of thrusters."""
    listed = entries(vehicle)
    c = constants(vehicle, listed)
    kept = [table for table, entry in zip(vehicle.effect, listed, strict=True) if _supports(entry, c)]
    return msgspec.structs.replace(vehicle, effect=tuple(kept))


def _law(vehicle: Vehicle, listed: Sequence[Entry]) -> Law:
    """Return the sum of the water forces of effects as one polynomial of velocity, without inertia."""
    c = constants(vehicle, listed)
    found = (law(entry, c) for entry in listed if entry.effect.kernel is not None)
    return reduce(lambda one, other: one + other, (one for one in found if one is not None), Law.none())


def _thruster_lacks(vehicle: Vehicle) -> list[Lack]:
    """Return the properties of thrusters that Gazebo cannot represent."""
    table, found = thruster_table(vehicle), list[Lack]()
    for what, why, columns, plain in (
        (
            "thruster lag",
            "thrust follows its command at once",
            (TIME_CONSTANT,),
            {"time_constant": 0.0, "lag_step": None},
        ),
        ("command delay", "commands act at once", (DELAY,), {"delay": 0.0}),
        ("thruster inflow", "thrust does not depend on the speed of the water", (INFLOW,), {}),
        ("propeller torque", "the reaction torque of propellers is left out", (REACTION,), {}),
    ):
        if (table[:, list(columns)] != 0.0).any():
            effects = tuple(one for one in vehicle.effect if not _changes_column(one, vehicle, columns[0]))
            thrusters = tuple(
                msgspec.structs.replace(one, **plain) if one.pushes else one for one in vehicle.thruster
            )
            without = msgspec.structs.replace(vehicle, effect=effects, thruster=thrusters)
            found.append(Lack(what, why, without))
    turning = tuple(one for one in vehicle.thruster if one.wrench is not None)
    if turning:
        names = ", ".join(one.name for one in turning)
        still = tuple(
            Thruster(name=one.name, curve="none") if one.wrench is not None else one
            for one in vehicle.thruster
        )
        why = "an axis demand has no position for a propeller"
        found.append(Lack(f"thruster {names}", why, msgspec.structs.replace(vehicle, thruster=still)))
    return found


def _changes_column(table: dict[str, Any], vehicle: Vehicle, column: int) -> bool:
    """Return whether the effect of a table changes a column of the thruster table."""
    (entry,) = entries(msgspec.structs.replace(vehicle, effect=(table,)))
    if entry.effect.actuator is None:
        return False
    rows = np.zeros((len(vehicle.thruster), COLUMNS))
    entry.effect.actuator(entry.parameters, rows)
    return bool(rows[:, column].any())


def _inertial(link: ET.Element, vehicle: Vehicle, added: Array, propellers: Sequence[Array]) -> None:
    """Add mass, inertia about the centre of gravity and added mass, less those of the propellers."""
    body = vehicle.rigid_body
    mass, center = body.mass, np.array(body.center_of_gravity)
    rest = mass - PROPELLER_MASS * len(propellers)
    if rest <= 0.0:
        raise DataError(
            f"rigid_body.mass: {mass:g} kg must exceed the mass of {len(propellers)} propellers of 1 g"
        )
    middle = (mass * center - PROPELLER_MASS * sum(propellers, np.zeros(3))) / rest
    inertia = np.array(body.inertia) - _point_inertia(rest, middle - center)
    for place in propellers:
        inertia -= _point_inertia(PROPELLER_MASS, place - center) + _propeller_inertia() * np.eye(3)
    inertial = _add(link, "inertial")
    _add(inertial, "pose", [*HALF_TURN * middle, 0.0, 0.0, 0.0])
    _add(inertial, "mass", rest)
    _add_inertia(inertial, inertia * np.outer(HALF_TURN, HALF_TURN))
    turned = added * np.outer(FRD_FLU, FRD_FLU)
    if turned.any():
        water = _add(inertial, "fluid_added_mass")
        for i in range(6):
            for j in range(i, 6):
                _add(water, AXES[i] + AXES[j], turned[i, j])


def _point_inertia(mass: float, at: Array) -> Array:
    """Return the inertia (3, 3) [kg m^2] of a point mass [kg] at a place (3,) [m] about the origin."""
    found: Array = mass * (at @ at * np.eye(3) - np.outer(at, at))
    return found


def _propeller_inertia() -> float:
    """Return the moment of inertia of a propeller's link [kg m^2]."""
    return PROPELLER_MASS * PROPELLER_RADIUS**2


def _add_inertia(inertial: ET.Element, inertia: Array) -> None:
    """Add the six independent entries of an inertia matrix (3, 3) [kg m^2] to an element."""
    matrix = _add(inertial, "inertia")
    for i in range(3):
        for j in range(i, 3):
            _add(matrix, f"i{AXES[i]}{AXES[j]}", inertia[i, j])


def _hull(link: ET.Element, vehicle: Vehicle, total: Law) -> None:
    """Add a collision box with the volume of the buoyancy about its centre, and a visual of the hull.

    Volume and centre include the constant vertical forces of effects.

    Args:
        link: Element of the link.
        vehicle: The vehicle.
        total: Sum of the effects' forces, with their constant force and moment.
    """
    lift = vehicle.buoyancy.force - total.force
    if lift <= 0.0:
        raise DataError("buoyancy: the vehicle with its effects has no buoyancy, which Gazebo requires")
    center = (vehicle.buoyancy.force * np.array(vehicle.buoyancy.center) - total.moment) / lift
    volume = lift / (vehicle.environment.water_density * vehicle.environment.gravity)
    sides = np.array([vehicle.hull.length, vehicle.hull.width, vehicle.hull.height])
    for tag, size, at in (
        ("collision", sides * (volume / sides.prod()) ** (1.0 / 3.0), center),
        ("visual", sides, np.array(vehicle.hull.center)),
    ):
        shape = _add(link, tag, name=f"hull_{tag}")
        _add(shape, "pose", [*HALF_TURN * at, 0.0, 0.0, 0.0])
        _add(_add(_add(shape, "geometry"), "box"), "size", size)


def _thruster(model: ET.Element, vehicle: Vehicle, thruster: Thruster, row: Array) -> None:
    """Add a propeller's link, its joint along the thrust, and its plug-in."""
    assert thruster.position is not None
    ahead, astern = row[MAX_THRUST] * (1.0 + row[GAIN]), row[MAX_REVERSE] * (1.0 + row[GAIN])
    astern *= 1.0 - row[ASYMMETRY]
    link = _add(model, "link", name=thruster.name)
    _add(link, "pose", [*HALF_TURN * np.array(thruster.position), 0.0, 0.0, 0.0])
    inertial = _add(link, "inertial")
    _add(inertial, "mass", PROPELLER_MASS)
    _add_inertia(inertial, _propeller_inertia() * np.eye(3))
    joint = _add(model, "joint", name=f"{thruster.name}_joint", type="revolute")
    _add(joint, "parent", LINK)
    _add(joint, "child", thruster.name)
    _add(_add(joint, "axis"), "xyz", HALF_TURN * row[:3])
    plugin = _plugin(model, "thruster", "Thruster")
    _add(plugin, "namespace", vehicle.name)
    _add(plugin, "joint_name", f"{thruster.name}_joint")
    _add(plugin, "fluid_density", vehicle.environment.water_density)
    for key, value in PROPELLER.items():
        _add(plugin, key, value)
    _add(plugin, "velocity_control", "true")
    _add(plugin, "max_thrust_cmd", ahead)
    _add(plugin, "min_thrust_cmd", -astern)
    if row[DEADBAND] > 0.0 and not row[SHIFT]:
        _add(plugin, "deadband", raised(row[DEADBAND], row[POWER]) * min(ahead, astern))


def _hydrodynamics(model: ET.Element, total: Law, flow: Array) -> None:
    """Add the Hydrodynamics plug-in with the coefficients of a force law and a constant current.

    Signs are those of the derivatives, X_u < 0 for drag.

    Args:
        model: Element of the vehicle.
        total: Coefficients of all water forces.
        flow: Velocity of the water and its rates (7,).
    """
    plugin = _plugin(model, "hydrodynamics", "Hydrodynamics")
    _add(plugin, "link_name", LINK)
    _add(plugin, "disable_added_mass", "true")
    _add(plugin, "disable_coriolis", "true")
    if flow[:3].any():
        _add(plugin, "default_current", HALF_TURN * flow[:3])
    s = FRD_FLU
    for i, force in enumerate(FORCES):
        for j, velocity in enumerate(VELOCITIES):
            if total.linear[i, j]:
                _add(plugin, force + velocity, s[i] * s[j] * total.linear[i, j])
            for k, other in enumerate(VELOCITIES):
                if total.sized[i, j, k]:
                    _add(plugin, f"{force}{velocity}abs{other}", s[i] * s[j] * total.sized[i, j, k])
                if total.plain[i, j, k]:
                    _add(plugin, f"{force}{velocity}{other}", s[i] * s[j] * s[k] * total.plain[i, j, k])


def _plugin(parent: ET.Element, name: str, system: str) -> ET.Element:
    return _add(parent, "plugin", filename=f"gz-sim-{name}-system", name=f"gz::sim::systems::{system}")


def _add(parent: ET.Element, tag: str, value: Any = None, **attributes: str) -> ET.Element:
    """Add an element `tag` with attributes and a text, a number or several numbers; return the element."""
    element = ET.SubElement(parent, tag, attributes)
    if isinstance(value, str):
        element.text = value
    elif value is not None:
        values = value if isinstance(value, Iterable) else [value]
        element.text = " ".join(f"{float(one) + 0.0:.12g}" for one in values)  # no -0
    return element


TARGET = Target(
    name="gz",
    takes="vehicle",
    suffix=".sdf",
    summary="a Gazebo world (SDF 1.11): added mass, Hydrodynamics, Thruster and Buoyancy plug-ins",
    write=to_sdf,
    lacks=lacks,
    warnings=warnings,
)
