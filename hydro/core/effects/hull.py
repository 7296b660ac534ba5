"""Forces of a long hull across and along the flow, and of fins on it (Hoerner 1965; Prestero 2001)."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case, Quantity
from hydro.core.effects.ellipsoid import ELLIPSOID_DRAG
from hydro.core.effects.layout import (
    COMMAND_NAMES,
    COMMANDS,
    DENSITY,
    HULL,
    HULL_CENTER,
    MOST_COMMANDS,
    RELATIVE_VELOCITY,
)
from hydro.core.effects.phrases import (
    Entry,
    changed,
    coefficients,
    coordinates,
    force_per_speed,
    undetermined,
)
from hydro.core.effects.record import (
    ABSORBED,
    LAST_COMMAND,
    Advice,
    Effect,
    Identification,
    Index,
    Limits,
    Parameter,
    Rest,
    Role,
    Shape,
    Shapes,
    Table,
    Words,
)
from hydro.core.effects.restoring import moved_at, near_the_hull, push_at
from hydro.core.effects.shapes import LEVER
from hydro.core.effects.units import of_mass, of_mixed
from hydro.core.effects.wording import capital, listed, place, quantity
from hydro.core.effects.words import DRIFT
from hydro.core.errors import DataError
from hydro.core.vehicle.description import APART, Vehicle
from hydro.core.vehicle.plausible import (
    BOOMS,
    DRAG_SOURCE,
    MOST_DRAG,
    Plausible,
    between,
    most_lift,
    within_box,
)

SECTIONS = 32
COEFFICIENT = between(0.0, MOST_DRAG, "", DRAG_SOURCE)
LIFT = ((1, 1), (1, 5), (5, 1), (5, 5), (2, 2), (2, 4), (4, 2), (4, 4))
LITTLE = 0.01  # share of a significant fin in a column
SLOPE = math.pi
"""Lift slope of a fin with a span of twice its chord, 2 pi/(1 + 2/2) of thin-wing theory; REMUS has 3.12."""
PROFILE_DRAG = 0.01
"""Drag coefficient of a fin along the flow."""
FLATTENING = 0.05
"""Angle of the transition of lift from attached flow to a flat plate [rad]."""
STALL = 0.35
"""Initial stall angle of short fins [rad]."""
LEAST_STALL, MOST_STALL = 0.05, 1.0
LEAST_ROLL, MOST_ROLL = -0.375 * math.pi, 0.625 * math.pi
"""Range of the roll of fins: a half-turn contains elevators, rudders and the X between; the rest is
equivalent."""
ROLLS = tuple((k - 0.2) * 0.25 * math.pi for k in range(-1, 3))  # rad, rolls that are tried
AFT, TURNED = -0.4, 0.1  # station in hull lengths and deflection in rad of a trial fin


@kernel
def crossflow_drag(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Drag of every section of the hull in the cross-flow, each independent of the others.

    The cross-flow at the station x is s_H = v_r + x r sideways and s_W = w_r - x q vertically.  The forces
    are Y = -1/2 rho Cd_y int H |s_H| s_H dx and Z = -1/2 rho Cd_z int W |s_W| s_W dx.  The moments are N =
    int x dY and M = -int x dZ.  The integrals use the midpoint rule over 32 stations of a box of the hull's
    length L, width W and height H about its centre.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    length, width, height = c[HULL], c[HULL + 1], c[HULL + 2]
    step = length / SECTIONS
    v, w = s[RELATIVE_VELOCITY + 1], s[RELATIVE_VELOCITY + 2]
    q, r = s[RELATIVE_VELOCITY + 4], s[RELATIVE_VELOCITY + 5]
    side = bottom = yaw = pitch = 0.0
    for k in range(SECTIONS):
        station = c[HULL_CENTER] + (k + 0.5) * step - 0.5 * length
        sway = v + station * r
        heave = w - station * q
        side += abs(sway) * sway
        yaw += station * abs(sway) * sway
        bottom += abs(heave) * heave
        pitch += station * abs(heave) * heave
    lateral = 0.5 * c[DENSITY] * p[0] * height * step
    vertical = 0.5 * c[DENSITY] * p[1] * width * step
    tau[1] -= lateral * side
    tau[5] -= lateral * yaw
    tau[2] -= vertical * bottom
    tau[4] += vertical * pitch


@kernel
def body_lift(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -|u_r| L nu_r with L in sway and yaw (11, 15, 51, 55) and heave and pitch (22, 24, 42, 44).

    A fin of lift slope c_L and area A at the station x has the drift angle (v_r + x r)/|u_r|, ahead or
    astern.  Its force is Y = -1/2 rho c_L A |u_r| (v_r + x r), its moment N = x Y: L = 1/2 rho c_L A [1, x;
    x, x^2].  In heave and pitch the sign of x changes: L = 1/2 rho c_L A [1, -x; -x, x^2].

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    speed = abs(s[RELATIVE_VELOCITY])
    v, w = s[RELATIVE_VELOCITY + 1], s[RELATIVE_VELOCITY + 2]
    q, r = s[RELATIVE_VELOCITY + 4], s[RELATIVE_VELOCITY + 5]
    tau[1] -= speed * (p[0] * v + p[1] * r)
    tau[5] -= speed * (p[2] * v + p[3] * r)
    tau[2] -= speed * (p[4] * w + p[5] * q)
    tau[4] -= speed * (p[6] * w + p[7] * q)


@kernel
def plate(along: float, across: float, stall: float) -> tuple[float, float]:
    """Return the force on a fin along its chord and along its normal, each divided by 1/2 rho A [m^2/s^2].

    Args:
        along: Velocity through the water along the chord [m/s].
        across: Velocity through the water along the normal [m/s].
        stall: Angle of attack at which the flow separates [rad].

    The angle of attack is a = atan2(across, along).  The lift coefficient is SLOPE a up to the stall.  Then
    it changes to that of a flat plate, sin(2 a), for either leading edge. The drag coefficient is
    PROFILE_DRAG + 2 sin^2(a).
    """
    speed = math.sqrt(along * along + across * across)
    if speed == 0.0:
        return 0.0, 0.0
    angle, sine, cosine = math.atan2(across, along), across / speed, along / speed
    attached = 1.0 / (1.0 + math.exp((abs(angle) - stall) / FLATTENING))
    lift = attached * SLOPE * angle + (1.0 - attached) * 2.0 * sine * cosine
    drag = PROFILE_DRAG + 2.0 * sine * sine
    return speed * (lift * across - drag * along), -speed * (lift * along + drag * across)


@kernel
def control_surface(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Lift and drag of a fin at r whose span is rolled about the body's x axis, with stall.

    Its normal is n = (0, -sin(roll), cos(roll)): an elevator has a roll of 0, a rudder one of pi/2; half a
    turn more with the opposite deflection is the same fin.  Each of its `commands`, clipped to [-1, 1], adds
    to a fixed deflection in proportion, without delay.  A positive deflection turns the trailing edge toward
    n, and pushes the fin toward -n in motion ahead.  Flow along the span has no effect.  The area assumes a
    lift slope of pi: a fin of another slope a appears a/pi times as large.  A fixed fin does no positive
    work, since its lift does none.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    driven = int(p[0])
    at = 1 + driven
    area, rx, ry, rz = p[at], p[at + 1], p[at + 2], p[at + 3]
    roll, deflection, stall = p[at + 4], p[at + 5], p[at + 6]
    for k in range(driven):
        deflection += p[at + 7 + k] * min(max(s[int(p[1 + k])], -1.0), 1.0)
    u, v, w = moved_at(s, rx, ry, rz)
    ny, nz = -math.sin(roll), math.cos(roll)
    sine, cosine = math.sin(deflection), math.cos(deflection)
    drift = ny * v + nz * w
    chord, normal = plate(cosine * u - sine * drift, sine * u + cosine * drift, stall)
    pressure = 0.5 * c[DENSITY] * area
    force = pressure * (cosine * normal - sine * chord)
    push_at(pressure * (cosine * chord + sine * normal), ny * force, nz * force, rx, ry, rz, tau)


def obeyed(table: Mapping[str, Any], where: str = "effect") -> tuple[Array, dict[str, int]]:
    """Return the servo commands that a fin follows, in the form that the kernel reads.

    Args:
        table: `[[effect]]` table of the fin.
        where: Path of the table, for errors.

    Returns:
        Number of commands, followed by the index of each in the state of motion (`layout.COMMANDS`); and the
        number of commands, with `last_command`, the number of the last command in use (0 for none).

    Raises:
        DataError: A command is not one of `c1 c2 ...`, or is listed twice.
    """
    names = table.get("commands", [])
    if not isinstance(names, list | tuple) or not all(one in COMMAND_NAMES for one in names):
        raise DataError(f"{where}.commands: must be a list of commands, c1 to c{MOST_COMMANDS}: {names!r}")
    if len(set(names)) < len(names):
        raise DataError(f"{where}.commands: a command stands twice: {', '.join(names)}")
    numbers = [COMMAND_NAMES.index(one) for one in names]
    places = [float(COMMANDS + number) for number in numbers]
    return np.array([float(len(names)), *places]), {
        "commands": len(names),
        LAST_COMMAND: max(numbers, default=-1) + 1,
    }


def keeps_crossflow(which: int) -> Limits:
    """Return a function that gives the bounds of a fitted cross-flow drag coefficient.

    The bounds keep the sum of the fitted coefficient and the file's other coefficients at least 0.

    Args:
        which: 0 for the sideways coefficient, 1 for the vertical one.
    """

    def limits(index: Index, rest: Rest) -> tuple[float, float]:
        return -float(rest.crossflow[which]), math.inf

    return limits


def as_a_wing(i: int, j: int) -> Plausible:
    """Return the plausible range of one lift coefficient of `body_lift`, of either sign.

    The limit is the lift of a wing near CO as large as the hull's side or bottom.

    Args:
        i: Row of the entry, the axis of the lift, 0 to 5.
        j: Column of the entry, the axis of the drift, 0 to 5.
    """

    def at(index: Index, vehicle: Vehicle) -> tuple[float, float]:
        arms = (i >= 3) + (j >= 3)
        bottom = 2 in (i, j) or i == j == 4
        most = float(most_lift(vehicle)[int(bottom)]) * (0.5 * vehicle.hull.length) ** arms
        return -most, most

    words = "either way up to a wing of lift slope 2 pi as large as the hull's side or bottom"
    return Plausible(at, words, "Hoerner (1965); thin-wing theory")


def plain_area(vehicle: Vehicle) -> float:
    """Return the significant area of a fin: a hundredth of the hull's length squared [m^2]."""
    return 0.01 * vehicle.hull.length**2


def up_to_the_hulls(index: Index, vehicle: Vehicle) -> tuple[float, float]:
    """Return the least (0) and greatest plausible area of a fin [m^2].

    The greatest is the hull's side or bottom.

    Args:
        index: Not used.
        vehicle: The vehicle, for the size of its hull.
    """
    return 0.0, vehicle.hull.length * max(vehicle.hull.width, vehicle.hull.height)


def tail_fins(vehicle: Vehicle, reach: Array | None) -> list[Table]:
    """Return two `[[effect]]` tables of `control_surface`, initial values of fits: an elevator and a rudder.

    Both are small fins at the stern.  The area is not zero, because the place of a fin without area has no
    influence on the motion.

    Args:
        vehicle: The vehicle, for the length of its hull.
        reach: Not used.
    """
    aft = np.array([AFT * vehicle.hull.length, 0.0, 0.0])
    return [_fin(0.2 * plain_area(vehicle), aft, roll) for roll in (0.0, 0.5 * math.pi)]


def fins(rolls: Sequence[float], stations: Sequence[float]) -> Shapes:
    """Return a function that yields trial shapes of `control_surface`, for fins at given rolls and stations.

    A shape is a linear problem.  Its columns are the fin's area, its moment along the span and its fixed
    deflection; further shapes let the fin follow a servo command that no effect uses yet.  No fin is tried at
    CO, because its negative area would explain errors of fins ahead and astern.

    Args:
        rolls: Roll angles of the span about the x axis [rad].
        stations: Positions of the fin along x, in hull lengths from CO.
    """

    def shapes(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
        for roll, station in itertools.product(rolls, stations):
            yield _at(roll, station * vehicle.hull.length, vehicle)
            for command in idle_servos(vehicle):
                yield _turned_by(command, roll, station * vehicle.hull.length, vehicle)

    return shapes


def idle_servos(vehicle: Vehicle) -> list[str]:
    """Return the names, such as `c7`, of the servo commands that no effect of the vehicle file uses."""
    written = (table.get(key, ()) for table in vehicle.effect for key in ("commands", "forces", "moments"))
    obeyed = set(re.findall(r"\bc\d+\b", " ".join(itertools.chain.from_iterable(written))))
    commands = zip(COMMAND_NAMES, vehicle.thruster, strict=False)
    return [name for name, thruster in commands if not thruster.pushes and name not in obeyed]


def _at(roll: float, x: float, vehicle: Vehicle) -> Shape:
    """Return columns of a fin of this roll at the station x [m]."""
    length, area = vehicle.hull.length, plain_area(vehicle)
    root, tip = np.array([x, 0.0, 0.0]), LEVER * length * np.array([0.0, math.cos(roll), math.sin(roll)])

    def begin(amounts: Array) -> Table:
        total = max(float(amounts.sum()), LITTLE)
        _, out, turned = np.clip(amounts / total, -4.0, 4.0)
        place = np.clip(root + out * tip, -length, length)
        return _fin(total * area, place, roll, float(turned) * TURNED)

    little = LITTLE * area
    tables = _fin(little, root, roll), _fin(little, root + tip, roll), _fin(little, root, roll, TURNED)
    return Shape(tables, (LITTLE,) * 3, begin)


def _turned_by(command: str, roll: float, x: float, vehicle: Vehicle) -> Shape:
    """Return columns of a fin deflected by a command: its area, and the deflected area."""
    area, place = plain_area(vehicle), np.array([x, 0.0, 0.0])

    def fin(size: float, turn: float) -> Table:
        return _fin(size, place, roll) | {"commands": [command], "turn": [turn]}

    def begin(amounts: Array) -> Table:
        total = max(float(amounts.sum()), LITTLE)
        return fin(total * area, float(np.clip(amounts[1] / total, -4.0, 4.0)) * TURNED)

    return Shape((fin(LITTLE * area, 0.0), fin(LITTLE * area, TURNED)), (LITTLE,) * 2, begin)


def _fin(area: float, position: Array, roll: float, deflection: float = 0.0) -> Table:
    return {
        "name": CONTROL_SURFACE.name,
        "area": area,
        "position": position.tolist(),
        "roll": roll,
        "deflection": deflection,
        "stall": STALL,
    }


def fin_sentence(case: Case) -> str:
    """Return a sentence that states area, attitude and place of a fin, and its commands."""
    area, point = case.one("area"), case.many("position", (3,))
    roll, deflection, stall = (case.one(key).times(DEGREES) for key in ("roll", "deflection", "stall"))
    commands = [str(one) for one in case.values.get("commands", (case.before or {}).get("commands", ()))]
    turns = [one.times(DEGREES) for one in case.many("turn", (len(commands),))]
    turned = [(f"command {name.removeprefix('c')}", one) for name, one in zip(commands, turns, strict=True)]
    if case.in_file:
        fin = named_fin(case.name)
        still = [name for name, one in turned if stopped(one)]
        if still:
            at = quantity(deflection.value, unit="°") if case.brief else deflection.text("°")
            return f"{capital(fin)} no longer follows {listed(still)}: it stays at {at}."
        entries = [Entry(f"{fin}'s area", "", area, "m^2"), *coordinates(f"{fin}'s", point)]
        entries += [
            Entry(f"{fin}'s roll", "", roll, "°"),
            Entry(f"{fin}'s deflection", "", deflection, "°"),
        ]
        entries += [Entry(f"{fin}'s stall angle", "", stall, "°")]
        entries += [Entry(f"{fin}'s deflection at full {name}", "", one, "°") for name, one in turned]
        return changed(case, fin, entries)
    if not area.clear:
        return undetermined(case, "the area of a fin", area.text("m^2"))
    where = place([one.value for one in point], [one.error for one in point])
    moved = [f"{one.text('°')} by {command}" for command, one in turned if one.clear]
    rest = [f"turned {listed(moved)}"] if moved else []
    rest += [f"set at {deflection.text('°')}"] if deflection.clear else []
    also = f", {listed(rest)}," if rest else ""
    return f"{fin_of(roll.value)} of {area.text('m^2')} at {where}{also} is missing."


DEGREES = 180.0 / math.pi
STOPPED = 0.1
"""Share of the travel in the file below which a fin counts as stuck: a tenth is within linkage play."""
UPRIGHT = 15.0
"""Maximum roll at which a fin is called an elevator or a rudder [deg]."""


def named_fin(name: str) -> str:
    """Return words for a fin of the file: `the rudder` for `control_surface:rudder`, else `the fin`."""
    label = name.partition(APART)[2]
    return f"the {label.replace('_', ' ')}" if label and not label.isdecimal() else "the fin"


def stopped(turn: Quantity) -> bool:
    """Return whether a fin follows its command by less than STOPPED times the travel in the vehicle file.

    Args:
        turn: Fitted deflection of the fin for a full command, with that of the file.
    """
    return turn.clear and abs(turn.value) < STOPPED * abs(turn.before)


def fin_of(roll: float) -> str:
    """Return words for a fin with a given roll of its span, such as "A vertical fin".

    A roll near 0 is horizontal, near 90 vertical; other rolls are stated in degrees.

    Args:
        roll: Roll of the span about the x axis [deg].
    """
    roll = (roll + 90.0) % 180.0 - 90.0  # half a turn more is the same fin
    if abs(roll) <= UPRIGHT:
        return "A horizontal fin"
    if abs(roll) >= 90.0 - UPRIGHT:
        return "A vertical fin"
    return f"A fin rolled by {roll:.0f}°"


BODY_LIFT = Effect(
    name="body_lift",
    family="hull",
    kind="wrench",
    definition="-|u_r| L nu_r in Y, N of v_r, r and in Z, M of w_r, q",
    source="Prestero (2001), chapter 4 (body and fin lift); Hoerner (1965)",
    excitation="drift and turns at speed, ahead and astern",
    identification=Identification(absorbs=ABSORBED),
    lookalikes=("added_mass_coriolis", "coupled_damping", "cross_axis_drag"),
    parameters=tuple(
        Parameter(
            f"L{i}{j}",
            ("kg/m" if i == j < 3 else "kg m" if i == j else "kg",),
            f"force {'XYZKMN'[i]} per speed and {'uvwpqr'[j]}",
            scale=(of_mass(0.5) if i == j < 3 else of_mixed(0.1) if i == j else None,),
            plausible=as_a_wing(i, j),
        )
        for i, j in LIFT
    ),
    kernel=body_lift,
    sentence=coefficients(
        "lift of hull and fins",
        [
            (
                f"L{i}{j}",
                "kg/m" if i == j < 3 else "kg m" if i == j else "kg",
                f"lift coefficient of {force_per_speed(i, j)}",
                f"for {force_per_speed(i, j)}",
            )
            for i, j in LIFT
        ],
    ),
    advice=Advice(parted_by=(DRIFT,)),
)

CONTROL_SURFACE = Effect(
    name="control_surface",
    repeatable=True,
    family="hull",
    kind="wrench",
    definition="1/2 rho A abs(v_p)^2 C_L(a) across the flow, C_D(a) against it, at r, with its moment r x f",
    source="Fossen (2011), section 9.7; Prestero (2001), chapter 4 (fins); Hoerner (1965)",
    excitation="straight runs at several speeds, drift up to large angles and turns, ahead and astern",
    lookalikes=("body_lift", "crossflow_drag", "coupled_damping", "offset_drag"),
    parameters=(
        Parameter(
            "area",
            ("m^2",),
            "area A, of a fin with a lift slope of pi",
            low=0.0,
            scale=(plain_area,),
            plausible=Plausible(up_to_the_hulls, "up to the hull's side or bottom", "fins on the hull"),
        ),
        Parameter(
            "position",
            ("m",),
            "point of the body where it acts",
            (3,),
            limits=near_the_hull,
            plausible=within_box(BOOMS, "up to the hull's size from CO along each axis", "fins on the hull"),
        ),
        Parameter(
            "roll",
            ("rad",),
            "roll of the span: 0 of an elevator, pi/2 of a rudder",
            low=LEAST_ROLL,
            high=MOST_ROLL,
            plausible=between(LEAST_ROLL, MOST_ROLL, "rad", "half a turn more is the same fin"),
        ),
        Parameter(
            "deflection",
            ("rad",),
            "fixed deflection",
            low=-0.5 * math.pi,
            high=0.5 * math.pi,
            plausible=between(-0.7, 0.7, "rad", "stops of rudders; Fossen (2011), section 9.5"),
        ),
        Parameter(
            "stall",
            ("rad",),
            "angle of attack at which the flow separates",
            low=LEAST_STALL,
            high=MOST_STALL,
            required=True,
            plausible=between(LEAST_STALL, MOST_STALL, "rad", "Hoerner (1965): long wings to short fins"),
        ),
        Parameter(
            "turn",
            ("rad",),
            "deflection at each of `commands` in full",
            ("commands",),
            low=-0.5 * math.pi,
            high=0.5 * math.pi,
            scale=(TURNED,),
            plausible=between(-0.7, 0.7, "rad", "stops of rudders; Fossen (2011), section 9.5"),
        ),
    ),
    words=(Words("commands", "commands that turn it, none of a fixed one", ("c1",), optional=True),),
    structure=obeyed,
    roles=frozenset({Role.COMMANDED}),
    kernel=control_surface,
    sentence=fin_sentence,
    identification=Identification(
        step=1e-2,
        starts=tail_fins,
        coarse=fins((0.0, 0.5 * math.pi), (AFT,)),
        fine=fins(ROLLS, (AFT, -AFT)),
        absorbs=ABSORBED,
    ),
    advice=Advice(parted_by=(DRIFT,)),
)

EFFECTS = (
    Effect(
        name="crossflow_drag",
        family="hull",
        kind="wrench",
        definition="dY = -1/2 rho Cd_y H abs(s_H) s_H dx, dZ likewise of W, s_W; N = int x dY, M = -int x dZ",
        source="Hoerner (1965); Fossen (2011), section 6.4.3",
        excitation="sway together with yaw, heave together with pitch rate, at strong drift angles",
        identification=Identification(absorbs=ABSORBED),
        lookalikes=("quadratic_damping", "coupled_damping", "cross_axis_drag"),
        parameters=(
            Parameter(
                "Cd_y",
                ("1",),
                "drag coefficient of the hull's side",
                scale=(1.0,),
                limits=keeps_crossflow(0),
                plausible=COEFFICIENT,
            ),
            Parameter(
                "Cd_z",
                ("1",),
                "drag coefficient of the hull's bottom",
                scale=(1.0,),
                limits=keeps_crossflow(1),
                plausible=COEFFICIENT,
            ),
        ),
        kernel=crossflow_drag,
        sentence=coefficients(
            "cross-flow drag",
            [
                (
                    key,
                    "1",
                    f"the drag coefficient of the hull's {face}",
                    f"as drag coefficient of the hull's {face}",
                )
                for key, face in (("Cd_y", "side"), ("Cd_z", "bottom"))
            ],
        ),
        advice=Advice(parted_by=(DRIFT,)),
        roles=frozenset({Role.HULL_WATER, Role.DRAG}),
    ),
    BODY_LIFT,
    CONTROL_SURFACE,
    ELLIPSOID_DRAG,
)
