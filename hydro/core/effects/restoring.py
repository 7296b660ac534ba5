"""Corrections to weight and buoyancy: static forces, vertical in the world (Fossen 2011, section 4.1).

The third row of R, [R20, R21, R22], is the world's downward direction seen from the body.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case
from hydro.core.effects.layout import BUOYANCY, CENTER_OF_BUOYANCY, GRAVITY, RELATIVE_VELOCITY, ROTATION
from hydro.core.effects.phrases import Entry, changed, coordinates, displaced, undetermined
from hydro.core.effects.record import (
    SLIGHTLY_ABSORBED,
    Advice,
    Effect,
    Identification,
    Index,
    Parameter,
    Rest,
    Role,
    Shape,
    Shapes,
    Table,
)
from hydro.core.effects.shapes import LEVER, along
from hydro.core.effects.units import of_mass, of_weight
from hydro.core.effects.wording import listed, number, place
from hydro.core.effects.words import TILTS
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import Plausible, between, within_box
from hydro.core.vehicle.plausible import of_weight as up_to_weight

TILTS_TRIED, LAGS_TRIED = (0.1, 0.4), (0.5, 2.0, 8.0)
LEAST_TILT, MOST_TILT, LEAST_LAG, MOST_LAG = 0.02, 1.0, 0.1, 60.0  # rad, s, bounds of observable values
CARRIED = "a vehicle does not carry more than itself"
ON_BOARD = tuple(
    within_box(2.0, "up to the hull's length along this axis from CO", CARRIED, i) for i in range(3)
)
INSIDE = tuple(within_box(1.0, "up to half of the hull's box", "inside the hull", i) for i in range(3))


@kernel
def moved_at(s: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the velocity v_r + omega x r of a point r of the body through the water, body axes [m/s].

    Args:
        s: State of motion, as in `layout`.
        x: Coordinate of the point forward of CO [m].
        y: Coordinate to starboard [m].
        z: Coordinate downward [m].
    """
    roll, pitch, yaw = s[RELATIVE_VELOCITY + 3], s[RELATIVE_VELOCITY + 4], s[RELATIVE_VELOCITY + 5]
    return (
        s[RELATIVE_VELOCITY] + pitch * z - yaw * y,
        s[RELATIVE_VELOCITY + 1] + yaw * x - roll * z,
        s[RELATIVE_VELOCITY + 2] + roll * y - pitch * x,
    )


@kernel
def push_at(fx: float, fy: float, fz: float, x: float, y: float, z: float, tau: Array) -> None:
    """Add to `tau` the wrench about CO of a force that acts at a point of the body.

    Args:
        fx: Force forward, in body axes [N].
        fy: Force to starboard [N].
        fz: Force downward in body axes [N].
        x: Coordinate of the point forward of CO [m].
        y: Coordinate to starboard [m].
        z: Coordinate downward [m].
        tau: Wrench about CO in body axes, (6,) [N, N m], changed in place.
    """
    tau[0] += fx
    tau[1] += fy
    tau[2] += fz
    tau[3] += y * fz - z * fy
    tau[4] += z * fx - x * fz
    tau[5] += x * fy - y * fx


@kernel
def push_down(s: Array, force: float, x: float, y: float, z: float, tau: Array) -> None:
    """Add to `tau` the wrench about CO of a vertical force that acts at a point of the body.

    Args:
        s: State of motion, as in `layout`.
        force: Force, positive downward in the world [N].
        x: Coordinate of the point forward of CO [m].
        y: Coordinate to starboard [m].
        z: Coordinate downward in body axes [m].
        tau: Wrench about CO in body axes, (6,) [N, N m], changed in place.
    """
    push_at(force * s[ROTATION + 6], force * s[ROTATION + 7], force * s[ROTATION + 8], x, y, z, tau)


@kernel
def net_buoyancy(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Force dB upward in the world at the centre of buoyancy: wrong ballast, or water of another density.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    at = CENTER_OF_BUOYANCY
    push_down(s, -p[0], c[at], c[at + 1], c[at + 2], tau)


@kernel
def buoyancy_offset(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Moment d x (R^T [0, 0, -B]): the vehicle's buoyancy B acts at d = (dx, dy, dz) from the file's centre.

    Lowering the centre of buoyancy (dz > 0) reduces stability: the righting moment at a roll phi changes by
    +B dz sin(phi).

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    push_down(s, -c[BUOYANCY], p[0], p[1], p[2], tau)
    push_down(s, c[BUOYANCY], 0.0, 0.0, 0.0, tau)


@kernel
def payload(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Weight in water w, downward in the world, at a point of the body; its dry mass m adds only inertia.

    w is weight minus buoyancy, so m enters only M (about CO, with its Coriolis terms), not the force.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    push_down(s, p[0], p[1], p[2], p[3], tau)


def point_mass(p: Array, matrix: Array) -> None:
    """Inertia of the payload: m [I, -S(r); S(r), -S(r)^2], Fossen (2011) eq. 3.44 for a point mass.

    Adds to `matrix`, the mass matrix about CO, (6, 6), by the parameters `p`; arguments as in `layout`.
    """
    x, y, z, mass = p[1:5]
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    arm = np.hstack([np.eye(3), -lever])
    matrix += mass * arm.T @ arm


@kernel
def drifting_ballast(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Moment g x d of ballast that has moved by x = m (x_b, y_b, 0), d being the world's down in body axes.

    It slides toward the lower end up to its stop, S = mass times travel, with a lag: x' = (S tanh(d/tilt) -
    x)/T along surge and along sway.  Its weight is part of the vehicle's, so it adds no force, and the
    inertia of its sliding is neglected.  At small tilts and low rates it is the free-surface effect of a
    liquid: it reduces the slope of the righting moment by g S/tilt, and damps.  Its stored energy is g (tilt
    int artanh(x/S) dx - x d).

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    for i in range(2):
        dx[i] = (p[i] * math.tanh(s[ROTATION + 6 + i] / p[2]) - x[i]) / p[3]
    weigh_aside(c[GRAVITY], s, x[0], x[1], tau)


@kernel
def weigh_aside(gravity: float, s: Array, x: float, y: float, tau: Array) -> None:
    """Add to `tau` the moment of weight that has moved within the body.

    Args:
        gravity: Acceleration of gravity [m/s^2].
        s: State of motion, as in `layout`.
        x: Mass times displacement forward [kg m].
        y: Mass times displacement to starboard [kg m].
        tau: Wrench about CO in body axes, (6,) [N, N m], changed in place.
    """
    push_down(s, gravity, x, y, 0.0, tau)
    push_down(s, -gravity, 0.0, 0.0, 0.0, tau)


@kernel
def slid_down(p: Array, c: Array, s: Array, x: Array) -> None:
    """Set the internal states `x` to S tanh(d/tilt), the place of sliding ballast at rest.

    S is the ballast's mass times travel, d the world's down direction in body axes, `tilt` a parameter;
    arguments as in `layout`.
    """
    for i in range(2):
        x[i] = p[i] * math.tanh(s[ROTATION + 6 + i] / p[2])


def loose(tilt: float, lag: float) -> Table:
    """Return a new `[[effect]]` table of `drifting_ballast` with zero mass, a tilt [rad] and a lag [s]."""
    return {"name": DRIFTING_BALLAST.name, "S": [0.0, 0.0], "tilt": tilt, "T": lag}


def at_lags(tilts: Sequence[float], lags: Sequence[float]) -> Shapes:
    """Return a function that yields trial shapes of `drifting_ballast`, one for each pair of tilt and lag.

    Each shape is a linear problem with one column for each direction of sliding, surge and sway.

    Args:
        tilts: Values [rad] of the parameter `tilt` in the ballast's steady place S tanh(d/tilt), with its
            mass times travel S and the world's down d in body axes.
        lags: Time constants of the sliding [s].
    """

    def shapes(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
        for tilt in tilts:
            for lag in lags:
                yield along(DRIFTING_BALLAST, "S", loose(tilt, lag), vehicle)

    return shapes


def shown_tilts(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the least and greatest tilt parameter that a recording can show [rad].

    Args:
        index: Not used.
        rest: Not used.
    """
    return LEAST_TILT, MOST_TILT


def shown_lags(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the least and greatest lag that a recording can show [s].

    Args:
        index: Not used.
        rest: Not used.
    """
    return LEAST_LAG, MOST_LAG


def most_ballast(index: Index, vehicle: Vehicle) -> tuple[float, float]:
    """Return the least (0) and greatest plausible sliding ballast, as mass times travel [kg m].

    The greatest is a fifth of the vehicle's mass, moved from the middle of the hull to its end.

    Args:
        index: Index of the component, with the direction of sliding as last entry: 0 for surge, 1 for sway.
        vehicle: The vehicle, for its mass and hull.
    """
    hull = vehicle.hull
    return 0.0, 0.1 * vehicle.rigid_body.mass * (hull.length, hull.width)[index[-1]]


def near_the_hull(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the bounds of a coordinate of a payload in a fit [m]: two hull lengths to either side of CO.

    Args:
        index: Not used.
        rest: Vehicle without the fitted effect, for the length of its hull.
    """
    return -2.0 * rest.vehicle.hull.length, 2.0 * rest.vehicle.hull.length


def light_or_heavy(vehicle: Vehicle, reach: Array | None) -> list[Table]:
    """Return two `[[effect]]` tables of `payload`, initial values of fits: a weight, and a lift, at CO.

    The weight is not zero, because the place of a payload without weight has no influence on the motion.

    Args:
        vehicle: The vehicle, whose weight sets the size.
        reach: Not used.
    """
    weight = of_weight(0.005)(vehicle)
    return [{"w": weight}, {"w": -weight}]


def payloads(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
    """Yield one trial shape of `payload`, a linear problem with five columns.

    The columns are the weight w at CO, w displaced along x, y and z, and the dry mass m.  The force is linear
    in w, w x, w y, w z and m.

    Args:
        vehicle: The vehicle, whose mass, weight and length set the sizes of the columns.
        reach: Not used.
    """
    weight = of_weight(0.01)(vehicle)
    mass, lever = 0.3 * vehicle.rigid_body.mass, LEVER * vehicle.hull.length
    little = 0.01
    at_origin = {"name": PAYLOAD.name, "w": little * weight}
    pairs = [at_origin | {axis: lever} for axis in ("x", "y", "z")]
    dry = {"name": PAYLOAD.name, "mass": little * mass}

    def begin(amounts: Array) -> Table:
        total = float(amounts[:4].sum())
        heavy = total if abs(total) > 1e-3 else 1e-3
        places = np.clip(amounts[1:4] / heavy * lever, -vehicle.hull.length, vehicle.hull.length)
        return {
            "name": PAYLOAD.name,
            "w": heavy * weight,
            **dict(zip(("x", "y", "z"), places.tolist(), strict=True)),
            "mass": max(float(amounts[4]), 0.0) * mass,
        }

    yield Shape((at_origin, *pairs, dry), (little,) * 5, begin)


def weight_or_moment(table: Mapping[str, Any], vehicle: Vehicle) -> list[Table]:
    """Return two simpler effects, each a new `[[effect]]` table, that may explain the same log as a payload.

    The first is a net buoyancy [N] of the payload's weight, for a payload without mass at the centre of
    buoyancy.  The second is a shift of the centre of buoyancy, in body axes [m], with the payload's moment
    and no weight.

    Args:
        table: The payload's parameters: weight in water `w` [N], and its place `x`, `y`, `z` [m].
        vehicle: Vehicle file with the buoyancy.
    """
    weight, lift = table.get("w", 0.0), max(vehicle.buoyancy.force, 1.0)
    shift = {f"d{axis}": -weight * table.get(axis, 0.0) / lift for axis in "xyz"}
    return [{"name": "net_buoyancy", "dB": -weight}, {"name": BUOYANCY_OFFSET.name} | shift]


def in_water(force: float, error: float, vehicle: Vehicle) -> str:
    """Return text with a force and its mass in water: `31 N (3.2 kg in water)`.

    Args:
        force: Force [N].
        error: Standard error of the force [N].
        vehicle: Vehicle file, for gravity.
    """
    gravity = vehicle.environment.gravity
    return f"{number(abs(force), error)} N ({number(abs(force) / gravity, error / gravity)} kg in water)"


def buoyancy_sentence(case: Case) -> str:
    """Return a sentence that states by how much the vehicle is lighter or heavier than in the file."""
    lift = case.one("dB")
    if not lift.clear:
        return undetermined(case, "the added buoyancy", lift.text("N"))
    side = "lighter" if lift.change > 0.0 else "heavier"
    return f"The vehicle is {in_water(lift.change, lift.error, case.vehicle)} {side} than modelled."


def payload_sentence(case: Case) -> str:
    """Return a sentence that states weight in water, place and dry mass of a payload."""
    weight, mass, point = case.one("w"), case.one("mass"), [case.one(axis) for axis in "xyz"]
    if case.in_file:
        entries = [Entry("the payload's weight in water", "", weight, "N")]
        entries += [*coordinates("the payload's", point), Entry("the payload's dry mass", "", mass, "kg")]
        return changed(case, "the payload", entries)
    where = place([one.value for one in point], [one.error for one in point])
    dry = mass.clear and mass.value > 0.0
    if not weight.clear:
        if dry:
            return f"A payload with a dry mass of {mass.text('kg')} is missing at {where}."
        return undetermined(case, "the weight of a payload in water", weight.text("N"))
    side = "heavier" if weight.value > 0.0 else "lighter"
    also = f", with a dry mass of {mass.text('kg')}" if dry else ""
    amount = in_water(weight.value, weight.error, case.vehicle)
    return f"The vehicle is {amount} {side} than modelled, at {where}{also}."


def ballast_sentence(case: Case) -> str:
    """Return a sentence that states the mass times travel, tilt and lag of sliding ballast."""
    slides = list(zip(("surge", "sway"), case.many("S", (2,)), strict=True))
    tilt, lag = case.one("tilt").times(180.0 / math.pi), case.one("T")
    if case.in_file:
        entries = [Entry(f"sliding ballast in {axis}", "", one, "kg m") for axis, one in slides]
        entries += [Entry("the tilt that moves the ballast", "", tilt, "°")]
        entries += [Entry("the ballast's time constant", "", lag, "s")]
        return changed(case, "the sliding ballast", entries)
    clear = [f"{one.text('kg m')} in {axis}" for axis, one in slides if one.clear]
    if not clear:
        return undetermined(case, "sliding ballast", f"{slides[0][1].text('kg m')} in surge")
    return (
        f"Ballast of {listed(clear)} slides toward the lower end, three quarters of the way at "
        f"a tilt of {tilt.text('°')}, with a time constant of {lag.text('s')}."
    )


BUOYANCY_OFFSET = Effect(
    name="buoyancy_offset",
    family="restoring",
    kind="wrench",
    definition="d x R^T [0, 0, -B]",
    source="Fossen (2011), eq. 4.6",
    excitation="slow roll and pitch, or trim angles at rest",
    lookalikes=("payload", "thruster_gain"),
    parameters=(
        Parameter("dx", ("m",), "centre of buoyancy moved forward", scale=(0.02,), plausible=INSIDE[0]),
        Parameter("dy", ("m",), "centre of buoyancy moved to starboard", scale=(0.02,), plausible=INSIDE[1]),
        Parameter("dz", ("m",), "centre of buoyancy moved down", scale=(0.02,), plausible=INSIDE[2]),
    ),
    kernel=buoyancy_offset,
    sentence=displaced("the centre of buoyancy", "lies", ("dx", "dy", "dz"), "where the file has it"),
    advice=Advice(parted_by=(TILTS,)),
    roles=frozenset({Role.STEADY_LOAD}),
)
PAYLOAD = Effect(
    name="payload",
    repeatable=True,
    family="restoring",
    kind="wrench",
    definition="[R^T [0, 0, w]; r x R^T [0, 0, w]], and m [I, -S(r); S(r), -S(r)^2] in M",
    source="Fossen (2011), eqs. 3.44, 4.6",
    excitation="slow roll and pitch for the weight, accelerations for the dry mass",
    lookalikes=("net_buoyancy", "buoyancy_offset", "added_mass"),
    parameters=(
        Parameter(
            "w",
            ("N",),
            "weight in water",
            plausible=up_to_weight(1.0, "either way up to the vehicle's weight", CARRIED),
        ),
        Parameter("x", ("m",), "position forward", limits=near_the_hull, plausible=ON_BOARD[0]),
        Parameter("y", ("m",), "position to starboard", limits=near_the_hull, plausible=ON_BOARD[1]),
        Parameter("z", ("m",), "position down", limits=near_the_hull, plausible=ON_BOARD[2]),
        Parameter(
            "mass",
            ("kg",),
            "dry mass, inertia only",
            low=0.0,
            plausible=Plausible(
                lambda index, vehicle: (0.0, vehicle.rigid_body.mass), "up to the vehicle's mass", CARRIED
            ),
        ),
    ),
    kernel=payload,
    sentence=payload_sentence,
    inertia=point_mass,
    identification=Identification(starts=light_or_heavy, coarse=payloads, plainer=weight_or_moment),
    advice=Advice(parted_by=(TILTS,)),
)
DRIFTING_BALLAST = Effect(
    name="drifting_ballast",
    family="restoring",
    kind="wrench",
    definition="g [0; x x d], x' = (S tanh(d/tilt) - x)/T in surge and sway, d = R^T [0, 0, 1]",
    source="Lewis (1988), Principles of Naval Architecture, vol. I (free surfaces), with a lag",
    excitation="roll and pitch to several tilts, held for both less and more than T",
    lookalikes=("buoyancy_offset", "linear_damping", "payload"),
    parameters=(
        Parameter(
            "S",
            ("kg m",),
            "mass times travel from the middle to the stop, surge and sway",
            (2,),
            low=0.0,
            required=True,
            scale=(of_mass(0.01),),
            plausible=Plausible(
                most_ballast, "up to a fifth of the vehicle's mass over half of the hull's box", CARRIED
            ),
        ),
        Parameter(
            "tilt",
            ("rad",),
            "tilt at which it has gone three quarters of the way",
            low=LEAST_TILT,
            required=True,
            scale=(0.2,),
            limits=shown_tilts,
            plausible=between(LEAST_TILT, MOST_TILT, "rad", "vehicles hardly ever tilt more"),
        ),
        Parameter(
            "T",
            ("s",),
            "time constant of sliding",
            low=LEAST_LAG,
            required=True,
            scale=(1.0,),
            limits=shown_lags,
            plausible=between(LEAST_LAG, MOST_LAG, "s", "from what slides freely to what seeps"),
        ),
    ),
    kernel=drifting_ballast,
    sentence=ballast_sentence,
    states=lambda p: 2,
    start=slid_down,
    identification=Identification(
        starts=lambda vehicle, reach: [loose(tilt, lag) for tilt in TILTS_TRIED for lag in LAGS_TRIED],
        coarse=at_lags(TILTS_TRIED[-1:], LAGS_TRIED[::2]),
        fine=at_lags(TILTS_TRIED, LAGS_TRIED),
        absorbs=SLIGHTLY_ABSORBED,
    ),
    advice=Advice(parted_by=(TILTS,)),
)

NET_BUOYANCY = Effect(
    name="net_buoyancy",
    family="restoring",
    kind="wrench",
    definition="dB upward in the world at the centre of buoyancy",
    source="Fossen (2011), eq. 4.6",
    excitation="slow heave, or hovering with known thrust",
    lookalikes=("payload", "surface_suction", "ocean_current"),
    parameters=(
        Parameter(
            "dB",
            ("N",),
            "extra buoyancy",
            plausible=up_to_weight(
                0.3, "either way up to 0.3 of the vehicle's weight", "what thrusters hold for long"
            ),
        ),
    ),
    kernel=net_buoyancy,
    sentence=buoyancy_sentence,
    advice=Advice(parted_by=(TILTS,)),
    roles=frozenset({Role.STEADY_LOAD}),
)
EFFECTS = (
    NET_BUOYANCY,
    BUOYANCY_OFFSET,
    PAYLOAD,
    DRIFTING_BALLAST,
)
