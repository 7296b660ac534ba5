"""Added mass: the inertia of the water that accelerates with a body (Fossen 2011, section 6.3).

Parameters are entries of M_A, the negatives of the SNAME derivatives: M_A[0,0] = -X_udot, M_A[1,5] = -Y_rdot.
An `inertia` effect enters M, and with it C_A built from M_A by the skew parametrisation (theorem 3.2), so
that its Coriolis terms do no work.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case
from hydro.core.effects.layout import ADDED_MASS as M_A
from hydro.core.effects.layout import RELATIVE_VELOCITY
from hydro.core.effects.phrases import coefficients, diagonal, undetermined
from hydro.core.effects.record import (
    SLIGHTLY_ABSORBED,
    Advice,
    Effect,
    Identification,
    Index,
    Parameter,
    Rest,
    Role,
)
from hydro.core.effects.units import of_mixed
from hydro.core.effects.wording import AXES, capital, number, quantity
from hydro.core.effects.words import CHIRP, DRIFT
from hydro.core.vehicle.plausible import ADDED_INERTIA, between, of_entry

UNITS = ("kg", "kg m", "kg m^2")
BETWEEN = of_mixed(0.1)  # significant size between a force and an angular acceleration
COUPLED = ((1, 5), (2, 4), (0, 4), (1, 3), (0, 2))


def symmetric_or_diagonal(p: Array, matrix: Array) -> None:
    """Wrench -M_A nu_r_dot - C_A(nu_r) nu_r, with M_A given by its diagonal or as a full matrix.

    A body with three planes of symmetry has a diagonal M_A; a full one must be symmetric, as it is in
    potential flow (Newman 1977, section 4.14).

    Adds to `matrix`, the mass matrix about CO, (6, 6), by the parameters `p`; arguments as in `layout`.
    """
    matrix += np.diag(p) if p.size == 6 else p.reshape(6, 6)


def couplings(p: Array, matrix: Array) -> None:
    """Off-diagonal entries of M_A, each on both sides of the diagonal.

    Sway-yaw (1,5) and heave-pitch (2,4) occur for a hull without fore-aft symmetry.  Surge-pitch (0,4) and
    sway-roll (1,3) occur without top-bottom symmetry, surge-heave (0,2) without both.

    Adds to `matrix`, the mass matrix about CO, (6, 6), by the parameters `p`; arguments as in `layout`.
    """
    for value, (i, j) in zip(p, COUPLED, strict=True):
        matrix[i, j] += value
        matrix[j, i] += value


@kernel
def coriolis_excess(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -kappa C_A(nu_r) nu_r with the vehicle's whole M_A: -1 removes the Munk moment, 0 leaves it.

    With the momentum of the water [a; b] = M_A nu_r, Fossen (2011) eq. 3.46 gives
    C_A nu_r = [omega x a; v_r x a + omega x b].  For a diagonal M_A the yaw moment -C_A nu_r is
    (M_A[0,0] - M_A[1,1]) u_r v_r: negative, thus destabilising, for u_r, v_r > 0 and M_A[1,1] > M_A[0,0].
    It does no work for any kappa.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    u, v, w = s[RELATIVE_VELOCITY], s[RELATIVE_VELOCITY + 1], s[RELATIVE_VELOCITY + 2]
    q0, q1, q2 = s[RELATIVE_VELOCITY + 3], s[RELATIVE_VELOCITY + 4], s[RELATIVE_VELOCITY + 5]
    a0 = a1 = a2 = b0 = b1 = b2 = 0.0
    for j in range(6):
        n = s[RELATIVE_VELOCITY + j]
        a0 += c[M_A + j] * n
        a1 += c[M_A + 6 + j] * n
        a2 += c[M_A + 12 + j] * n
        b0 += c[M_A + 18 + j] * n
        b1 += c[M_A + 24 + j] * n
        b2 += c[M_A + 30 + j] * n
    kappa = p[0]
    tau[0] -= kappa * (q1 * a2 - q2 * a1)
    tau[1] -= kappa * (q2 * a0 - q0 * a2)
    tau[2] -= kappa * (q0 * a1 - q1 * a0)
    tau[3] -= kappa * (v * a2 - w * a1 + q1 * b2 - q2 * b1)
    tau[4] -= kappa * (w * a0 - u * a2 + q2 * b0 - q0 * b2)
    tau[5] -= kappa * (u * a1 - v * a0 + q0 * b1 - q1 * b0)


def keeps_diagonal(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the minimum and maximum of one component in a fit of added mass.

    A diagonal component keeps the total added mass on its axis at least 0; others have no bounds.

    Args:
        index: Index of the component: (axis,) in a diagonal, (row, column) in a matrix.
        rest: Inertia and damping of the vehicle without the fitted effect.
    """
    if len(set(index)) > 1:
        return -math.inf, math.inf
    return -float(rest.added_mass[index[0], index[0]]), math.inf


def coriolis_sentence(case: Case) -> str:
    """Return a sentence on the fitted Coriolis force of the added mass, in percent of its theory."""
    share = case.one("kappa").times(100.0)
    subject = "the Coriolis force of the added mass (Munk moment)"
    if not share.clear:
        return undetermined(case, f"the correction of {subject}", share.text("%"))
    if case.in_file:
        now, was = quantity(100.0 + share.value, share.error, "%"), number(100.0 + share.before)
        return f"{capital(subject)} is {now} of what the added mass gives, not {was} % {case.as_given}."
    more = "stronger" if share.value > 0.0 else "weaker"
    return f"{capital(subject)} is {share.size('%')} {more} than modelled."


ADDED_MASS = Effect(
    name="added_mass",
    family="inertia",
    kind="inertia",
    definition="-M_A nu_r_dot - C_A(nu_r) nu_r",
    source="Fossen (2011), section 6.3, theorem 3.2",
    excitation="accelerations of both signs on every axis",
    lookalikes=("fluid_memory", "thruster_lag", "payload"),
    parameters=(
        Parameter(
            "diagonal",
            ("kg", "kg m^2"),
            "diagonal of M_A",
            (6,),
            limits=keeps_diagonal,
            plausible=ADDED_INERTIA,
        ),
        Parameter(
            "matrix",
            UNITS,
            "all of M_A, symmetric",
            (6, 6),
            scale=(None, BETWEEN, None),
            limits=keeps_diagonal,
            symmetric=True,
            plausible=ADDED_INERTIA,
        ),
    ),
    one_of=("diagonal", "matrix"),
    inertia=symmetric_or_diagonal,
    sentence=diagonal("added mass", "added mass", UNITS, symmetric=True),
    identification=Identification(absorbs=SLIGHTLY_ABSORBED),
    advice=Advice(parted_by=(CHIRP,)),
    roles=frozenset({Role.HULL_WATER}),
)

ADDED_MASS_COUPLING = Effect(
    name="added_mass_coupling",
    family="inertia",
    kind="inertia",
    definition="-M_A nu_r_dot - C_A(nu_r) nu_r with M_A[i,j] = M_A[j,i] for five pairs",
    source="Fossen (2011), section 6.3.1; Newman (1977), section 4.14",
    excitation="sway with yaw acceleration, heave with pitch, surge with pitch, sway with roll",
    lookalikes=("coupled_damping", "sensor_lever_arm", "payload"),
    parameters=tuple(
        Parameter(
            f"M{i}{j}",
            ("kg" if j < 3 else "kg m",),
            f"M_A[{i},{j}] and M_A[{j},{i}]",
            scale=(None if j < 3 else BETWEEN,),
            plausible=replace(ADDED_INERTIA, at=of_entry(ADDED_INERTIA.at, i, j)),
        )
        for i, j in COUPLED
    ),
    inertia=couplings,
    sentence=coefficients(
        "coupled added mass",
        [
            (
                f"M{i}{j}",
                "kg" if j < 3 else "kg m",
                f"{AXES[i]}-{AXES[j]} added mass",
                f"between {AXES[i]} and {AXES[j]}",
            )
            for i, j in COUPLED
        ],
    ),
    advice=Advice(parted_by=(DRIFT,)),
    roles=frozenset({Role.HULL_WATER, Role.COUPLING}),
)

EFFECTS = (
    ADDED_MASS,
    ADDED_MASS_COUPLING,
    Effect(
        name="added_mass_coriolis",
        family="inertia",
        kind="wrench",
        definition="-kappa C_A(nu_r) nu_r",
        source="Fossen (2011), theorem 3.2, section 6.3.1 (Munk moment)",
        excitation="turns and drift at speed: surge with sway, surge with heave",
        lookalikes=("body_lift", "coupled_damping"),
        parameters=(
            Parameter(
                "kappa",
                ("1",),
                "share of C_A that is missing (or, below 0, too much)",
                plausible=between(-1.0, 1.0, "", "-1 leaves no C_A at all, 1 doubles it"),
            ),
        ),
        kernel=coriolis_excess,
        sentence=coriolis_sentence,
        advice=Advice(parted_by=(DRIFT,)),
        roles=frozenset({Role.HULL_WATER}),
    ),
)
