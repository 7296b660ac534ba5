"""Forces of a long hull across and along the flow: cross-flow drag and lift (Hoerner 1965; Prestero 2001)."""

from __future__ import annotations

import math

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.layout import DENSITY, HULL, HULL_CENTER, RELATIVE_VELOCITY
from hydro.core.effects.parting import DRIFT
from hydro.core.effects.record import (
    ABSORBED,
    Advice,
    Effect,
    Identification,
    Index,
    Limits,
    Parameter,
    Rest,
    Role,
)
from hydro.core.effects.units import of_mass, of_mixed
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import DRAG_SOURCE, MOST_DRAG, Plausible, between, most_lift

SECTIONS = 32
COEFFICIENT = between(0.0, MOST_DRAG, "", DRAG_SOURCE)
LIFT = ((1, 1), (1, 5), (5, 1), (5, 5), (2, 2), (2, 4), (4, 2), (4, 4))


@kernel
def crossflow_drag(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Drag of every section of the hull in the flow across it, each as if it were alone.

    At the station x the water comes sideways with s_H = v_r + x r and from below with s_W = w_r - x q, so
    that Y = -1/2 rho Cd_y int H |s_H| s_H dx and Z = -1/2 rho Cd_z int W |s_W| s_W dx, N = int x dY and
    M = -int x dZ.  Midpoint rule over 32 stations of a box of the hull's length L, width W and height H about
    its centre.
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

    A fin of lift slope c_L and area A at the station x meets drift at the angle (v_r + x r)/|u_r|, ahead or
    astern, and answers with Y = -1/2 rho c_L A |u_r| (v_r + x r) and N = x Y: L = 1/2 rho c_L A [1, x; x,
    x^2].  In heave and pitch the sign of x turns: L = 1/2 rho c_L A [1, -x; -x, x^2].
    """
    speed = abs(s[RELATIVE_VELOCITY])
    v, w = s[RELATIVE_VELOCITY + 1], s[RELATIVE_VELOCITY + 2]
    q, r = s[RELATIVE_VELOCITY + 4], s[RELATIVE_VELOCITY + 5]
    tau[1] -= speed * (p[0] * v + p[1] * r)
    tau[5] -= speed * (p[2] * v + p[3] * r)
    tau[2] -= speed * (p[4] * w + p[5] * q)
    tau[4] -= speed * (p[6] * w + p[7] * q)


def keeps_crossflow(which: int) -> Limits:
    """Nothing that would leave a coefficient below 0 in sum with the rest of the file."""

    def limits(index: Index, rest: Rest) -> tuple[float, float]:
        return -float(rest.crossflow[which]), math.inf

    return limits


def as_a_wing(i: int, j: int) -> Plausible:
    """An entry of L, of a wing as large as the hull's side or bottom, at most half a length from CO."""

    def at(index: Index, vehicle: Vehicle) -> tuple[float, float]:
        arms = (i >= 3) + (j >= 3)
        bottom = 2 in (i, j) or i == j == 4
        most = float(most_lift(vehicle)[int(bottom)]) * (0.5 * vehicle.hull.length) ** arms
        return -most, most

    words = "either way up to a wing of lift slope 2 pi as large as the hull's side or bottom"
    return Plausible(at, words, "Hoerner (1965); thin-wing theory")


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
        advice=Advice(parted_by=(DRIFT,)),
        roles=frozenset({Role.HULL_WATER, Role.DRAG}),
    ),
    BODY_LIFT,
)
