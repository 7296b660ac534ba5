"""Damping: viscous forces as functions of the velocity relative to the water (Fossen 2011, section 6.4).

Parameters are entries of D, the negatives of the SNAME derivatives: D[0,0] = -X_u, D[1,5] = -Y_r, and are
therefore positive for a force that opposes motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case
from hydro.core.effects.layout import RELATIVE_VELOCITY
from hydro.core.effects.phrases import (
    Entry,
    changed,
    coefficients,
    coordinates,
    diagonal,
    force_per_speed,
    missing,
    valued,
)
from hydro.core.effects.record import (
    ABSORBED,
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
from hydro.core.effects.restoring import moved_at, near_the_hull, push_at
from hydro.core.effects.shapes import LEVER, along
from hydro.core.effects.units import of_mass, of_moment
from hydro.core.effects.wording import AXES, listed, place
from hydro.core.effects.words import COASTING, DRIFT
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import (
    BOOMS,
    DRAG_SOURCE,
    HULL_DRAG,
    Plausible,
    between,
    most_cross_drag,
    of_entry,
    within_box,
)

LINEAR = ("N s/m", "N s", "N m s")
COUPLED = ((1, 5), (5, 1), (2, 4), (4, 2), (1, 3), (3, 1))
FRICTION = (of_mass(0.3), of_moment(0.5))  # significant sizes of linear damping
FRICTION_MATRIX = (FRICTION[0], None, FRICTION[1])
ACROSS = tuple((i, j) for i in range(6) for j in range(3) if i != j)
LEAST_POWER, MOST_POWER = 1.0, 3.5
COARSE_POWERS, POWERS = (1.5, 2.7), (1.15, 1.3, 1.6, 1.8, 2.2, 2.5, 3.0, 3.3)
NEARER = 1.5  # exponent between linear and quadratic
LITTLE = 0.01  # share of a significant drag in a column


@kernel
def linear(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -D_L nu_r: laminar skin friction and potential damping, which dominate at low speed.

    D_L is given by its diagonal or as a full matrix.  It does no positive work if its symmetric part is
    positive semi-definite.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    if p.size == 6:
        for i in range(6):
            tau[i] -= p[i] * s[RELATIVE_VELOCITY + i]
    else:
        for i in range(6):
            for j in range(6):
                tau[i] -= p[6 * i + j] * s[RELATIVE_VELOCITY + j]


@kernel
def quadratic(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -D_Q |nu_r| nu_r, axis by axis: form drag of the separated flow.

    In surge D_Q[0] = 1/2 rho C_d A with the frontal area A.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    for i in range(6):
        n = s[RELATIVE_VELOCITY + i]
        tau[i] -= p[i] * abs(n) * n


@kernel
def coupled(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -D[i,j] nu_r[j] for sway-yaw, heave-pitch and sway-roll, each with its own coefficient.

    A centre of lateral resistance aft of CO (x_c < 0) gives D[1,5] = D[5,1] = x_c D[1,1] < 0: a turn to
    starboard then drags to port at the stern.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    v, w = s[RELATIVE_VELOCITY + 1], s[RELATIVE_VELOCITY + 2]
    roll, pitch, yaw = s[RELATIVE_VELOCITY + 3], s[RELATIVE_VELOCITY + 4], s[RELATIVE_VELOCITY + 5]
    tau[1] -= p[0] * yaw + p[4] * roll
    tau[5] -= p[1] * v
    tau[2] -= p[2] * pitch
    tau[4] -= p[3] * w
    tau[3] -= p[5] * v


@kernel
def across(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -D[i,j] |nu_r[j]| nu_r[i]: drag along or about one axis, increased by speed along another one.

    The flow separates from a blunt hull or an open frame at the total speed, so that a vehicle in heave has
    more drag in surge.  A cylinder across the flow has Y = -1/2 rho C_d A sqrt(v^2 + w^2) v, and these
    products approximate it.  With every D[i,j] >= 0, as here, it never does positive work.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    k = 0
    for i in range(6):
        for j in range(3):
            if j != i:
                tau[i] -= p[k] * abs(s[RELATIVE_VELOCITY + j]) * s[RELATIVE_VELOCITY + i]
                k += 1


@kernel
def power(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -D_i |nu_r,i|^(n-1) nu_r,i: drag whose coefficient changes with the Reynolds number.

    Friction of a laminar boundary layer has an exponent of 1.5, of a turbulent one 1.8.  Flutter and wave
    making have 2.5 and more.  D is the drag at 1 m/s and 1 rad/s, so that its unit does not depend on n.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    n = p[6]
    for i in range(6):
        speed = s[RELATIVE_VELOCITY + i]
        if speed != 0.0 and p[i] != 0.0:
            tau[i] -= p[i] * math.copysign(math.pow(abs(speed), n), speed)


@kernel
def offset(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Force f_i = -d_i |v_p,i| v_p,i at a point r off CO, v_p = v_r + omega x r, and its moment r x f.

    The drag of a frame, a skid or a sonar causes pitch and yaw moments in straight motion: N per |v| v is -x
    d_y, M per |u| u is -z d_x and per |w| w is x d_z.  It does no positive work, as f . v_p <= 0.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    rx, ry, rz = p[3], p[4], p[5]
    u, v, w = moved_at(s, rx, ry, rz)
    push_at(-p[0] * abs(u) * u, -p[1] * abs(v) * v, -p[2] * abs(w) * w, rx, ry, rz, tau)


def keeps_linear(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the minimum and maximum of one component in a fit of linear damping.

    A diagonal component keeps the total linear damping on its axis at least 0; others have no bounds.

    Args:
        index: Index of the component: (axis,) in a diagonal, (row, column) in a matrix.
        rest: Inertia and damping of the vehicle without the fitted effect.
    """
    if len(set(index)) > 1:
        return -math.inf, math.inf
    return -float(rest.linear[index[0], index[0]]), math.inf


def keeps_quadratic(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the minimum and maximum of one component in a fit of quadratic damping.

    They keep the total quadratic damping on its axis at least 0.

    Args:
        index: Index of the component, (axis,).
        rest: Inertia and damping of the vehicle without the fitted effect.
    """
    return -float(rest.quadratic[index[0]]), math.inf


def raised_across(i: int) -> Plausible:
    """Return the plausible range of a cross-axis drag coefficient: 0 to the drag of the hull's box.

    Args:
        i: Axis of the drag, 0 to 5.
    """

    def at(index: Index, vehicle: Vehicle) -> tuple[float, float]:
        return 0.0, float(most_cross_drag(vehicle)[i])

    return Plausible(at, "up to the drag of the hull's box in all of the flow with C_d 2.5", DRAG_SOURCE)


def at_powers(powers: Sequence[float]) -> Shapes:
    """Return a function that yields trial shapes of `power_drag`, one for each given exponent.

    Each shape, a linear problem at a fixed exponent, has one column for the drag on each of the six axes.

    Args:
        powers: Exponents n of the speed in |nu_r,i|^(n-1) nu_r,i.
    """
    return lambda vehicle, reach: (along(POWER_DRAG, "diagonal", without_drag(n), vehicle) for n in powers)


def without_drag(n: float) -> Table:
    """Return a new `[[effect]]` table of `power_drag` with the exponent `n` and no drag."""
    return {"name": POWER_DRAG.name, "diagonal": [0.0] * 6, "n": n}


def nearest_plain(table: Mapping[str, Any], vehicle: Vehicle) -> list[Table]:
    """Return the simpler effect nearest to a power drag: linear or quadratic damping of equal coefficients.

    Args:
        table: `[[effect]]` table of `power_drag`; linear damping is nearer if its exponent is below NEARER.
        vehicle: Not used.

    Returns:
        A list of one new `[[effect]]` table.
    """
    plain = LINEAR_DAMPING if table["n"] < NEARER else QUADRATIC_DAMPING
    return [{"name": plain.name, "diagonal": list(table["diagonal"])}]


def parts(vehicle: Vehicle, reach: Array | None) -> list[Table]:
    """Return four `[[effect]]` tables of `offset_drag`, the initial values of four fits.

    All have the same small drag, at a point ahead, astern, above or below CO.  The drag is not zero, because
    the point of a zero drag has no influence on the motion.

    Args:
        vehicle: The vehicle, whose mass and length set the drag and the distance of the points.
        reach: Not used.
    """
    little, lever = np.full(3, 0.05 * vehicle.rigid_body.mass), LEVER * vehicle.hull.length
    return [_part(little, sign * lever * np.eye(3)[axis]) for axis in (0, 2) for sign in (-1.0, 1.0)]


def drags_and_moments(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
    """Yield one trial shape of `offset_drag`, a linear problem with nine columns.

    Three columns are a drag along each axis at CO.  Six are the same drags displaced along each of the two
    other axes.  In slow turns the force is nearly linear in these coefficients.

    Args:
        vehicle: The vehicle, whose mass and length set the sizes of the columns.
        reach: Not used.
    """
    drag, length, axes = 0.5 * vehicle.rigid_body.mass, vehicle.hull.length, np.eye(3)
    levers = [(i, j) for i in range(3) for j in range(3) if j != i]

    def begin(amounts: Array) -> Table:
        total, moments = amounts[:3].copy(), np.zeros(3)
        for amount, (i, _) in zip(amounts[3:], levers, strict=True):
            total[i] += amount
        size = np.maximum(total, LITTLE)
        for amount, (i, j) in zip(amounts[3:], levers, strict=True):
            moments[j] += amount * size[i]
        point = LEVER * length * moments / ((size**2).sum() - size**2)  # a drag has no moment along itself
        return _part(np.maximum(total, 0.0) * drag, np.clip(point, -length, length))

    tables = [_part(LITTLE * drag * axis, np.zeros(3)) for axis in axes]
    tables += [_part(LITTLE * drag * axes[i], LEVER * length * axes[j]) for i, j in levers]
    yield Shape(tuple(tables), (LITTLE,) * 9, begin)


def _part(drag: Array, position: Array) -> Table:
    return {"name": OFFSET_DRAG.name, "drag": drag.tolist(), "position": position.tolist()}


def power_sentence(case: Case) -> str:
    """Return a sentence that states the drag of each axis at 1 m/s and 1 rad/s, and the exponent."""
    entries = []
    for i, (axis, one) in enumerate(zip(AXES, case.many("diagonal", (6,)), strict=True)):
        speed, unit = ("1 rad/s", "N m") if i >= 3 else ("1 m/s", "N")
        entries.append(Entry(f"{axis} drag at {speed}", f"in {axis} at {speed}", one, unit))
    n = case.one("n")
    if case.in_file:
        return changed(case, "power drag", [*entries, Entry("the power of speed in drag", "", n, "1")])
    grows = f"drag with the power {n.text()} of speed" if case.finite else "power drag"
    return missing(case, grows, entries)


def offset_sentence(case: Case) -> str:
    """Return a sentence that states the drag along three axes and the point where it acts."""
    axes, point = AXES[:3], case.many("position", (3,))
    drags = case.many("drag", (3,))
    entries = [
        Entry(f"{axis} drag", f"in {axis}", one, "N s^2/m^2") for axis, one in zip(axes, drags, strict=True)
    ]
    if case.in_file:
        return changed(case, "offset drag", [*entries, *coordinates("the drag's", point)])
    clear = [one for one in entries if one.quantity.clear]
    if not clear:
        return missing(case, "drag off the origin", entries)
    where = place([one.value for one in point], [one.error for one in point])
    return f"Drag of {listed([valued(one) for one in clear])} is missing at {where}."


LINEAR_DAMPING = Effect(
    name="linear_damping",
    family="damping",
    kind="wrench",
    definition="-D_L nu_r",
    source="Fossen (2011), section 6.4",
    excitation="slow motion on every axis, and coasting down",
    lookalikes=("quadratic_damping", "thruster_inflow", "fluid_memory"),
    parameters=(
        Parameter(
            "diagonal",
            ("N s/m", "N m s"),
            "diagonal of D_L",
            (6,),
            scale=FRICTION,
            limits=keeps_linear,
            plausible=HULL_DRAG,
        ),
        Parameter(
            "matrix",
            LINEAR,
            "all of D_L",
            (6, 6),
            scale=FRICTION_MATRIX,
            limits=keeps_linear,
            plausible=HULL_DRAG,
        ),
    ),
    one_of=("diagonal", "matrix"),
    kernel=linear,
    sentence=diagonal("linear damping", "linear damping", LINEAR),
    advice=Advice(parted_by=(COASTING,)),
    roles=frozenset({Role.HULL_WATER}),
)

QUADRATIC_DAMPING = Effect(
    name="quadratic_damping",
    family="damping",
    kind="wrench",
    definition="-D_Q abs(nu_r) nu_r",
    source="Morison et al. (1950); Fossen (2011), section 6.4",
    excitation="steady speeds from slow to full on every axis",
    lookalikes=("linear_damping", "crossflow_drag", "cross_axis_drag", "thruster_inflow", "thruster_gain"),
    parameters=(
        Parameter(
            "diagonal",
            ("N s^2/m^2", "N m s^2"),
            "diagonal of D_Q",
            (6,),
            required=True,
            scale=(of_mass(1.0), of_moment(1.0)),
            limits=keeps_quadratic,
            plausible=HULL_DRAG,
        ),
    ),
    kernel=quadratic,
    sentence=diagonal("quadratic damping", "drag", ("N s^2/m^2", "N s^2", "N m s^2")),
    advice=Advice(parted_by=(COASTING,)),
    roles=frozenset({Role.HULL_WATER, Role.DRAG}),
)

POWER_DRAG = Effect(
    name="power_drag",
    family="damping",
    kind="wrench",
    definition="-D abs(nu_r)^n sign(nu_r), n the same on all axes",
    source="Hoerner (1965), chapter 2 (friction and the Reynolds number)",
    excitation="steady speeds from slow to full on every axis, and coasting down",
    lookalikes=("linear_damping", "quadratic_damping", "thruster_curve"),
    parameters=(
        Parameter(
            "diagonal",
            ("N", "N m"),
            "drag at 1 m/s, moment at 1 rad/s",
            (6,),
            low=0.0,
            required=True,
            scale=(of_mass(1.0), of_moment(1.0)),
            plausible=HULL_DRAG,
        ),
        Parameter(
            "n",
            ("1",),
            "power of the speed",
            low=LEAST_POWER,
            high=MOST_POWER,
            required=True,
            plausible=between(LEAST_POWER, MOST_POWER, "", "from laminar friction to flutter and waves"),
            power=True,
        ),
    ),
    kernel=power,
    sentence=power_sentence,
    identification=Identification(
        starts=lambda vehicle, reach: [without_drag(n) for n in COARSE_POWERS],
        coarse=at_powers(COARSE_POWERS),
        fine=at_powers(POWERS),
        absorbs=ABSORBED,
        plainer=nearest_plain,
    ),
    advice=Advice(parted_by=(COASTING,)),
    roles=frozenset({Role.HULL_WATER, Role.DRAG}),
)

OFFSET_DRAG = Effect(
    name="offset_drag",
    repeatable=True,
    family="damping",
    kind="wrench",
    definition="f_i = -d_i abs(v_p,i) v_p,i at r, v_p = v_r + omega x r, with its moment r x f",
    source="Morison et al. (1950); Fossen (2011), section 6.4",
    excitation="straight runs along surge, sway and heave, and turns on the spot",
    lookalikes=("quadratic_damping", "cross_axis_drag", "crossflow_drag", "buoyancy_offset"),
    parameters=(
        Parameter(
            "drag",
            ("N s^2/m^2",),
            "drag d along surge, sway and heave",
            (3,),
            low=0.0,
            scale=(of_mass(0.5),),
            plausible=HULL_DRAG,
        ),
        Parameter(
            "position",
            ("m",),
            "point of the body where it acts",
            (3,),
            limits=near_the_hull,
            plausible=within_box(BOOMS, "up to the hull's size from CO along each axis", DRAG_SOURCE),
        ),
    ),
    kernel=offset,
    sentence=offset_sentence,
    identification=Identification(step=1e-2, starts=parts, coarse=drags_and_moments, absorbs=ABSORBED),
    advice=Advice(parted_by=(DRIFT,)),
    roles=frozenset({Role.HULL_WATER, Role.DRAG}),
)

EFFECTS = (
    LINEAR_DAMPING,
    QUADRATIC_DAMPING,
    Effect(
        name="coupled_damping",
        family="damping",
        kind="wrench",
        definition="-D[i,j] nu_r[j] for (1,5), (5,1), (2,4), (4,2), (1,3), (3,1)",
        source="Fossen (2011), section 6.4 (off-diagonal entries)",
        excitation="yaw without sway and sway without yaw, and likewise heave with pitch, sway with roll",
        identification=Identification(absorbs=ABSORBED),
        lookalikes=("body_lift", "crossflow_drag", "added_mass_coupling", "sensor_lever_arm"),
        parameters=tuple(
            Parameter(
                f"D{i}{j}",
                ("N s",),
                f"D[{i},{j}]",
                plausible=replace(HULL_DRAG, at=of_entry(HULL_DRAG.at, i, j)),
            )
            for i, j in COUPLED
        ),
        kernel=coupled,
        sentence=coefficients(
            "coupled damping",
            [
                (f"D{i}{j}", "N s", f"damping of {force_per_speed(i, j)}", f"for {force_per_speed(i, j)}")
                for i, j in COUPLED
            ],
        ),
        advice=Advice(parted_by=(DRIFT,)),
        roles=frozenset({Role.HULL_WATER, Role.COUPLING}),
    ),
    Effect(
        name="cross_axis_drag",
        family="damping",
        kind="wrench",
        definition="-D[i,j] abs(nu_r[j]) nu_r[i] for the six axes i and the three speeds j, j not i",
        source="Fossen (2011), section 6.4 (abs(nu)^T D_n nu, its terms that only oppose motion)",
        excitation="surge, sway, heave and turns at once, in pairs and at several speeds",
        identification=Identification(absorbs=ABSORBED),
        lookalikes=("quadratic_damping", "body_lift", "crossflow_drag", "linear_damping"),
        parameters=tuple(
            Parameter(
                f"D{i}{j}",
                ("N s^2/m^2" if i < 3 else "N s^2",),
                f"{'XYZKMN'[i]} per abs({'uvw'[j]}) {'uvwpqr'[i]}",
                low=0.0,
                # A moment per rate and speed, not one per speed squared.
                scale=(of_mass(1.0) if i < 3 else of_moment(1.0),),
                plausible=raised_across(i),
            )
            for i, j in ACROSS
        ),
        kernel=across,
        sentence=coefficients(
            "cross-axis drag",
            [
                (
                    f"D{i}{j}",
                    "N s^2/m^2" if i < 3 else "N s^2",
                    f"{AXES[i]} drag per {AXES[j]} speed",
                    f"in {AXES[i]} per {AXES[j]} speed",
                )
                for i, j in ACROSS
            ],
        ),
        advice=Advice(parted_by=(DRIFT,)),
        roles=frozenset({Role.HULL_WATER, Role.DRAG}),
    ),
    POWER_DRAG,
    OFFSET_DRAG,
)
