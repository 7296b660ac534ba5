"""Drag of a whole hull from the local velocity on its surface, without a separate coefficient per axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case
from hydro.core.effects.damping import QUADRATIC_DAMPING
from hydro.core.effects.layout import DENSITY, HULL, MOTION, RELATIVE_VELOCITY
from hydro.core.effects.phrases import Entry, changed, coordinates, missing, valued
from hydro.core.effects.record import (
    ABSORBED,
    Advice,
    Effect,
    Identification,
    Parameter,
    Role,
    Shape,
    Table,
)
from hydro.core.effects.restoring import moved_at, near_the_hull, push_at
from hydro.core.effects.shapes import LEVER
from hydro.core.effects.wording import AXES, listed, place
from hydro.core.effects.words import DRIFT
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import DRAG_SOURCE, MOST_DRAG, between, within_box

BANDS, AROUND = 3, 8
"""Bands along half of the ellipsoid and faces around each: 48 faces with the opposite half.

On recorded motions, forces and moments differ by 3 and 5 % from those of 3,200 faces; those of 32 faces by 4
and 7 %, of 72 faces by 2 and 4 %.
"""
FACE = 2.0 * math.pi / (BANDS * AROUND)
"""Area of a face of the unit sphere: bands of equal height have equal areas (Archimedes)."""
TURN = 2.0 * math.pi / AROUND
COSINE, SINE = math.cos(TURN), math.sin(TURN)
FIRST_COSINE, FIRST_SINE = math.cos(0.5 * TURN), math.sin(0.5 * TURN)


def _seen_from_the_side() -> float:
    """Return the sum of the faces of the unit sphere, projected on a plane along its axis; exactly: pi."""
    around = sum(max(math.cos((j + 0.5) * TURN), 0.0) for j in range(AROUND))
    along = sum(math.sqrt(1.0 - ((i + 0.5) / BANDS) ** 2) for i in range(BANDS))
    return 2.0 * FACE * along * around


SIDE = math.pi / _seen_from_the_side()
"""Correction of side and bottom areas, so that motion along an axis has the exact frontal area."""
LITTLE = 0.01  # share of the significant coefficient in a column
TYPICAL = 0.5
"""Drag coefficient at which a fit begins, between a streamlined hull's (0.1) and a plate's (1.2)."""


@kernel
def ellipsoid_drag(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Drag of every part of an ellipsoid of the hull's length, width and height about a point r.

    A part with outward normal n and area dA moves through the water at v = v_r + omega x r_dA.  Its drag is
    df_i = -1/2 rho C_i max(v . n, 0) v_i dA: it acts along the local flow on the parts that face it.  Motion
    along axis i alone gives quadratic damping 1/2 rho C_i A_i with the frontal area A_i, pi/4 W H in surge.
    Any straight motion gives X_i = -1/2 rho C_i sqrt(sum (A_j v_j)^2) v_i.  Each part dissipates power.  The
    integral is a sum over 48 faces; opposite ones are computed together.

    `explain` tries this law for every file.  A diagnosis tries it only for a file without drag: it describes
    most hulls better than their files do, in any recording, and so would hide what has changed.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    a, b, h = 0.5 * c[HULL], 0.5 * c[HULL + 1], 0.5 * c[HULL + 2]
    front, side, bottom = FACE * b * h, SIDE * FACE * a * h, SIDE * FACE * a * b
    u, v, w = moved_at(s, p[3], p[4], p[5])
    roll, pitch, yaw = s[RELATIVE_VELOCITY + 3], s[RELATIVE_VELOCITY + 4], s[RELATIVE_VELOCITY + 5]
    along_x = along_y = along_z = K_z = K_y = M_x = M_z = N_y = N_x = 0.0
    for i in range(BANDS):
        ahead = (i + 0.5) / BANDS
        radius = math.sqrt(1.0 - ahead * ahead)
        cosine, sine = radius * FIRST_COSINE, radius * FIRST_SINE
        for _ in range(AROUND):
            rx, ry, rz = a * ahead, b * cosine, h * sine
            turn_x, turn_y, turn_z = pitch * rz - yaw * ry, yaw * rx - roll * rz, roll * ry - pitch * rx
            n_x, n_y, n_z = front * ahead, side * cosine, bottom * sine
            straight = n_x * u + n_y * v + n_z * w
            turning = n_x * turn_x + n_y * turn_y + n_z * turn_z
            facing, behind = max(straight + turning, 0.0), max(turning - straight, 0.0)
            both, apart = facing + behind, facing - behind
            along_x += both * u + apart * turn_x
            along_y += both * v + apart * turn_y
            along_z += both * w + apart * turn_z
            odd_x, odd_y, odd_z = (
                apart * u + both * turn_x,
                apart * v + both * turn_y,
                apart * w + both * turn_z,
            )
            K_z += ry * odd_z
            K_y += rz * odd_y
            M_x += rz * odd_x
            M_z += rx * odd_z
            N_y += rx * odd_y
            N_x += ry * odd_x
            cosine, sine = cosine * COSINE - sine * SINE, sine * COSINE + cosine * SINE
    pressure = 0.5 * c[DENSITY]
    C_x, C_y, C_z = pressure * p[0], pressure * p[1], pressure * p[2]
    push_at(-C_x * along_x, -C_y * along_y, -C_z * along_z, p[3], p[4], p[5], tau)
    tau[3] -= C_z * K_z - C_y * K_y
    tau[4] -= C_x * M_x - C_z * M_z
    tau[5] -= C_y * N_y - C_x * N_x


def at_the_center(vehicle: Vehicle, reach: Array | None) -> list[Table]:
    """Return one `[[effect]]` table of `ellipsoid_drag`, the initial values of a fit, in a list.

    They are a typical drag about the hull's centre.  The drag is not zero, because the place of a zero drag
    has no influence on the motion.

    Args:
        vehicle: The vehicle, for the centre of its hull.
        reach: Not used.
    """
    return [_ellipsoid(np.full(3, TYPICAL), np.array(vehicle.hull.center, float))]


def coefficients_and_moments(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
    """Yield one trial shape of `ellipsoid_drag`, a linear problem with six columns.

    Three columns are a drag along each axis about the hull's centre.  Three are equal drags along all axes
    about a centre displaced along each axis.

    Args:
        vehicle: The vehicle, for the size and centre of its hull.
        reach: Not used.
    """
    center, axes = np.array(vehicle.hull.center, float), np.eye(3)
    lever = LEVER * np.array([vehicle.hull.length, vehicle.hull.width, vehicle.hull.height])

    def begin(amounts: Array) -> Table:
        moved = amounts[3:]
        size = np.maximum(amounts[:3] + moved.sum(), 0.0)
        away = np.clip(moved / max(float(size.mean()), LITTLE), -2.0, 2.0)
        return _ellipsoid(np.minimum(size, MOST_DRAG), center + away * lever)

    tables = [_ellipsoid(LITTLE * axis, center) for axis in axes]
    tables += [_ellipsoid(np.full(3, LITTLE), center + way) for way in np.diag(lever)]
    yield Shape(tuple(tables), (LITTLE,) * 6, begin)


def nearest_damping(table: Mapping[str, Any], vehicle: Vehicle) -> list[Table]:
    """Return the simpler effect nearest to an ellipsoid's drag, as a list of one `quadratic_damping` table.

    Both have the same force in motion along or about a single axis.

    Args:
        table: `[[effect]]` table of `ellipsoid_drag`.
        vehicle: The vehicle, for its hull and the density of the water.
    """
    hull, center = vehicle.hull, np.array(table.get("position", np.zeros(3)), float)
    packed, constants = np.concatenate([table["C"], center]), np.zeros(HULL + 3)
    constants[DENSITY] = vehicle.environment.water_density
    constants[HULL : HULL + 3] = hull.length, hull.width, hull.height
    diagonal = np.zeros(6)
    for i in range(6):
        motion, wrench = np.zeros(MOTION), np.zeros(6)
        motion[RELATIVE_VELOCITY + i] = 1.0
        ellipsoid_drag(packed, constants, motion, np.zeros(0), np.zeros(0), wrench)
        diagonal[i] = max(-wrench[i], 0.0)
    return [{"name": QUADRATIC_DAMPING.name, "diagonal": diagonal.tolist()}]


def _ellipsoid(coefficient: Array, position: Array) -> Table:
    return {"name": ELLIPSOID_DRAG.name, "C": coefficient.tolist(), "position": position.tolist()}


def ellipsoid_sentence(case: Case) -> str:
    """Return a sentence that states the drag coefficients along three axes and the ellipsoid's centre."""
    axes, point = AXES[:3], case.many("position", (3,))
    drags = case.many("C", (3,))
    entries = [
        Entry(f"the hull's drag coefficient in {axis}", f"in {axis}", one, "1")
        for axis, one in zip(axes, drags, strict=True)
    ]
    if case.in_file:
        return changed(case, "ellipsoid drag", [*entries, *coordinates("the ellipsoid's", point)])
    clear = [one for one in entries if one.quantity.clear]
    if not clear:
        return missing(case, "drag of the hull as an ellipsoid", entries)
    where = place([one.value for one in point], [one.error for one in point])
    found = listed([valued(one) for one in clear])
    return f"Drag of the hull as an ellipsoid is missing: coefficient {found}, centre at {where}."


ELLIPSOID_DRAG = Effect(
    name="ellipsoid_drag",
    family="hull",
    kind="wrench",
    definition="df_i = -1/2 rho C_i max(v . n, 0) v_i dA over the ellipsoid of the hull's size about r",
    source="Hoerner (1965), chapter 3 (drag on the frontal area); Fossen (2011), section 6.4",
    excitation="motion in several directions at once, such as surge with heave, and turns in motion",
    lookalikes=("quadratic_damping", "cross_axis_drag", "offset_drag", "crossflow_drag"),
    parameters=(
        Parameter(
            "C",
            ("1",),
            "drag coefficients along surge, sway and heave, of the ellipsoid's frontal areas",
            (3,),
            low=0.0,
            scale=(1.0,),
            plausible=between(0.0, MOST_DRAG, "", DRAG_SOURCE),
        ),
        Parameter(
            "position",
            ("m",),
            "centre of the ellipsoid",
            (3,),
            limits=near_the_hull,
            plausible=within_box(1.0, "up to half the hull's size from CO along each axis", DRAG_SOURCE),
        ),
    ),
    kernel=ellipsoid_drag,
    sentence=ellipsoid_sentence,
    identification=Identification(
        step=1e-2,
        starts=at_the_center,
        coarse=coefficients_and_moments,
        absorbs=ABSORBED,
        plainer=nearest_damping,
    ),
    advice=Advice(parted_by=(DRIFT,)),
    roles=frozenset({Role.HULL_WATER, Role.DRAG, Role.WHOLE_HULL}),
)
