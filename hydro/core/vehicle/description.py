"""Vehicle description: rigid body, buoyancy, hull, thrusters and a list of effects.

SI units, frame FRD about the body origin CO (Fossen 2011, ch. 2 and 7).  These structs are both the model in
memory and the validator of the TOML file; `io.vehicle` reads and writes the file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

import msgspec

from hydro.core.thrust_curves.curve import Curve
from hydro.core.vehicle import names

Vector3 = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]
Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
DeadBand = Annotated[float, msgspec.Meta(ge=0, lt=1)]
Name = Annotated[str, msgspec.Meta(extra_json_schema={"pattern": names.PATTERN})]
"""Name by the rule of `vehicle.names`; `io.vehicle` checks the rule, for a better error message."""

APART = ":"
"""Separator between the catalogue name of an effect and the label or number of one effect in a file."""


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Table of the vehicle file.  Unknown keys are errors, so that a misspelt name is never ignored."""


class Environment(_Part, frozen=True):
    """Water and gravity of a vehicle file.

    Attributes:
        water_density: Density of the water [kg/m^3].
        gravity: Acceleration of gravity [m/s^2].
    """

    water_density: Positive = 1025.0
    gravity: Positive = 9.81


class RigidBody(_Part, frozen=True):
    """Dry body of a vehicle file.

    Attributes:
        mass: Dry mass [kg].
        center_of_gravity: Centre of gravity from CO, FRD [m].
        inertia: Inertia matrix about the centre of gravity [kg m^2]; off-diagonal entries are -int xy dm.
    """

    mass: Positive
    center_of_gravity: Vector3
    inertia: Matrix3


class Buoyancy(_Part, frozen=True):
    """Buoyancy of a vehicle file.

    Attributes:
        force: Buoyant force [N].
        center: Point at which the force acts, FRD from CO [m].
    """

    force: NonNegative
    center: Vector3


class Hull(_Part, frozen=True):
    """Box around the hull in a vehicle file.

    Attributes:
        length: Length of the box [m].
        width: Width of the box [m].
        height: Height of the box [m].
        center: Centre of the box from CO, FRD [m].
        mesh: Name of a file with a triangulated surface of the hull, next to the vehicle file; None without.
    """

    length: Positive
    width: Positive
    height: Positive
    center: Vector3 = (0.0, 0.0, 0.0)
    mesh: str | None = None


class Battery(_Part, frozen=True):
    """Battery of the thrusters in a vehicle file.

    Attributes:
        voltage: Nominal supply voltage [V], used for recordings without a voltage.
    """

    voltage: Positive


class Thruster(_Part, frozen=True):
    """Thruster of a vehicle file: a point and direction, or a constant body wrench per newton of thrust.

    A command is clipped to [-1, 1], delayed, and passes dead band, curve and lag in the order set by `lag`.

    Attributes:
        name: Name of the thruster.
        max_thrust: Maximum thrust ahead [N], for a curve by name.
        max_reverse_thrust: Maximum thrust astern [N], for a curve by name.
        position: Place from CO, FRD [m].
        direction: Direction of positive thrust, FRD.
        wrench: Wrench about CO per newton of thrust, instead of place and direction.
        curve: Thrust over command: `linear`, `quadratic` (proportional to the command or its square), a
            table, or `t200`, the published table of that thruster.  A table includes maximum thrusts and dead
            band, so these keys are omitted.  `none` is for a command that drives the servo of a fin
            (`control_surface`); such a command has only a name.
        lag: First-order lag: `thrust` lags the thrust, after dead band and curve; `speed` lags the normalised
            rotor speed, before both.  With a table, the speed is the root of the share of full thrust.
        time_constant: Time constant of the lag [s]; 0 for none.
        lag_step: Step with which the source of the data integrates the lag by explicit Euler [s]; None for an
            exact lag.
        deadband: Size of commands that give no thrust, as a share of full command.
        deadband_style: `cut`: thrust jumps to the curve's value at the edge of the dead band; `shift`: thrust
            starts at 0 there.
        delay: Delay of the command [s].
    """

    name: Name
    max_thrust: Positive | None = None
    max_reverse_thrust: Positive | None = None
    position: Vector3 | None = None
    direction: Vector3 | None = None
    wrench: Vector6 | None = None
    curve: Literal["linear", "quadratic", "t200", "none"] | Curve = "linear"
    lag: Literal["thrust", "speed"] = "thrust"
    time_constant: NonNegative = 0.0
    lag_step: Positive | None = None
    deadband: DeadBand = 0.0
    deadband_style: Literal["cut", "shift"] = "cut"
    delay: NonNegative = 0.0

    @property
    def pushes(self) -> bool:
        """Whether the command drives a thruster; False for the servo of a fin (`curve = "none"`)."""
        return self.curve != "none"


class Vehicle(_Part, frozen=True):
    """Content of a vehicle file.

    In memory, several effects of the same catalogue name have distinct names, such as
    `control_surface:rudder` (`told_apart`).

    Attributes:
        name: Name of the vehicle.
        rigid_body: Mass, centre of gravity and inertia.
        buoyancy: Buoyant force and its centre.
        hull: Box around the hull.
        format: Name and version of the format.
        environment: Water density and gravity.
        battery: Battery; None if unknown.
        thruster: Thrusters and servos, in the order of the commands.
        effect: Physical effects, one `[[effect]]` table each: `name` in the catalogue, and parameters.
    """

    name: Name
    rigid_body: RigidBody
    buoyancy: Buoyancy
    hull: Hull
    format: Literal["hydro-vehicle/1"] = "hydro-vehicle/1"
    environment: Environment = Environment()
    battery: Battery | None = None
    thruster: tuple[Thruster, ...] = ()
    effect: tuple[dict[str, Any], ...] = ()

    def effects(self, name: str) -> tuple[dict[str, Any], ...]:
        """Return the `[[effect]]` tables with a given name, in the order of the file.

        Empty if there are none.

        Args:
            name: `control_surface:rudder` for one effect, `control_surface` for all effects with this name in
                the catalogue.
        """
        return tuple(entry for entry in self.effect if name in called(entry))

    def names(self, name: str) -> tuple[str, ...]:
        """Return the distinct names in this file of all effects with a given name; empty if there are none.

        Args:
            name: Name in the catalogue, such as `control_surface`, or in this file, such as
                `control_surface:rudder`.
        """
        return tuple(dict.fromkeys(str(entry["name"]) for entry in self.effects(name)))

    def without(self, name: str) -> Vehicle:
        """Return a copy of the vehicle without the effects of a given name.

        Args:
            name: `control_surface:rudder` for one effect, `control_surface` for all effects with this name in
                the catalogue.
        """
        kept = tuple(entry for entry in self.effect if name not in called(entry))
        return msgspec.structs.replace(self, effect=kept)


def require_names(vehicle: Vehicle) -> None:
    """Raise an error if the name of the vehicle or of a thruster has characters that no name may have.

    Raises:
        DataError: A name is invalid; the message starts with its path in the vehicle file and gives the rule.
    """
    thrusters = {f"thruster[{index}].name": one.name for index, one in enumerate(vehicle.thruster)}
    names.require({"name": vehicle.name, **thrusters})


def catalogue_name(name: str) -> str:
    """Return the catalogue name of an effect: `control_surface` for `control_surface:rudder`."""
    return name.partition(APART)[0]


def called(table: Mapping[str, Any]) -> tuple[str, str]:
    """Return the name of an effect in its vehicle, and its name in the catalogue.

    Example: `control_surface:rudder` and `control_surface`.

    Args:
        table: `[[effect]]` table of the effect.
    """
    name = str(table.get("name"))
    return name, catalogue_name(name)


def own_names(tables: Iterable[Mapping[str, Any]]) -> tuple[str, ...]:
    """Return a unique name for each effect of a vehicle file, in the order of the effects.

    An effect with a label is `NAME:LABEL`; several effects of one name without labels are `NAME:1`, `NAME:2`
    in order.  Any other effect keeps its name.

    Args:
        tables: `[[effect]]` tables of the file.
    """
    listed = [(str(table.get("name")), table.get("label")) for table in tables]
    count = Counter(name for name, _ in listed)
    met = Counter[str]()
    found = []
    for name, label in listed:
        met[name] += 1
        apart = label if label is not None else met[name] if count[name] > 1 else None
        found.append(name if apart is None else f"{name}{APART}{apart}")
    return tuple(found)


def told_apart(vehicle: Vehicle) -> Vehicle:
    """Return a copy of the vehicle with a unique name for each effect, as used in memory.

    The names are those of `own_names`, such as `control_surface:rudder`.
    """
    pairs = zip(vehicle.effect, own_names(vehicle.effect), strict=True)
    effects = tuple(table if table.get("name") == name else {**table, "name": name} for table, name in pairs)
    return msgspec.structs.replace(vehicle, effect=effects)


def as_written(vehicle: Vehicle) -> Vehicle:
    """Return a copy of the vehicle with the catalogue's names of the effects, as written in a file."""
    effects = tuple({**table, "name": called(table)[1]} for table in vehicle.effect)
    return msgspec.structs.replace(vehicle, effect=effects)
