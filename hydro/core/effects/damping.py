"""Damping: viscous forces as functions of the velocity relative to the water (Fossen 2011, section 6.4).

Parameters are entries of D, the negatives of the SNAME derivatives: D[0,0] = -X_u, D[1,5] = -Y_r, and are
therefore positive for a force that opposes motion.
"""

from __future__ import annotations

import math
from dataclasses import replace

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.layout import RELATIVE_VELOCITY
from hydro.core.effects.parting import COASTING, DRIFT
from hydro.core.effects.record import ABSORBED, Advice, Effect, Identification, Index, Parameter, Rest, Role
from hydro.core.effects.units import of_mass, of_moment
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import DRAG_SOURCE, HULL_DRAG, Plausible, most_cross_drag, of_entry

LINEAR = ("N s/m", "N s", "N m s")
COUPLED = ((1, 5), (5, 1), (2, 4), (4, 2), (1, 3), (3, 1))
FRICTION = (of_mass(0.3), of_moment(0.5))  # plain in a linear damping
FRICTION_MATRIX = (FRICTION[0], None, FRICTION[1])
ACROSS = tuple((i, j) for i in range(6) for j in range(3) if i != j)


@kernel
def linear(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -D_L nu_r: laminar skin friction and potential damping, what is left of damping at low speed.

    D_L is given by its diagonal or whole; it does no positive work where its symmetric part is positive
    semi-definite.
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
    """
    for i in range(6):
        n = s[RELATIVE_VELOCITY + i]
        tau[i] -= p[i] * abs(n) * n


@kernel
def coupled(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -D[i,j] nu_r[j] for sway-yaw, heave-pitch and sway-roll, each with its own coefficient.

    A centre of lateral resistance aft of CO (x_c < 0) gives D[1,5] = D[5,1] = x_c D[1,1] < 0: a turn to
    starboard then drags to port at the stern.
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
    """Wrench -D[i,j] |nu_r[j]| nu_r[i]: drag along or about one axis that speed along another one raises.

    The flow separates from a blunt hull or an open frame at its whole speed, so that a vehicle which heaves
    meets more drag in surge: a cylinder across the flow has Y = -1/2 rho C_d A sqrt(v^2 + w^2) v, and these
    are the products nearest to it.  With every D[i,j] >= 0, as here, it never does positive work.
    """
    k = 0
    for i in range(6):
        for j in range(3):
            if j != i:
                tau[i] -= p[k] * abs(s[RELATIVE_VELOCITY + j]) * s[RELATIVE_VELOCITY + i]
                k += 1


def keeps_linear(index: Index, rest: Rest) -> tuple[float, float]:
    """Nothing on the diagonal that would leave it below 0 in sum with the rest of the file."""
    if len(set(index)) > 1:
        return -math.inf, math.inf
    return -float(rest.linear[index[0], index[0]]), math.inf


def keeps_quadratic(index: Index, rest: Rest) -> tuple[float, float]:
    """Likewise of quadratic damping."""
    return -float(rest.quadratic[index[0]]), math.inf


def raised_across(i: int) -> Plausible:
    """Drag along or about an axis, of all the speed that meets the hull's box there."""

    def at(index: Index, vehicle: Vehicle) -> tuple[float, float]:
        return 0.0, float(most_cross_drag(vehicle)[i])

    return Plausible(at, "up to the drag of the hull's box in all of the flow with C_d 2.5", DRAG_SOURCE)


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
    lookalikes=(
        "linear_damping",
        "crossflow_drag",
        "cross_axis_drag",
        "thruster_inflow",
        "thruster_gain",
    ),
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
    advice=Advice(parted_by=(COASTING,)),
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
        advice=Advice(parted_by=(DRIFT,)),
        roles=frozenset({Role.HULL_WATER, Role.OFTEN_LACKING, Role.COUPLING}),
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
        advice=Advice(parted_by=(DRIFT,)),
        roles=frozenset({Role.HULL_WATER, Role.DRAG}),
    ),
)
