"""Corrections to weight and buoyancy: static forces, vertical in the world (Fossen 2011, section 4.1).

The third row of R, [R20, R21, R22], is the world's downward direction seen from the body.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.effects.layout import BUOYANCY, CENTER_OF_BUOYANCY, ROTATION
from hydro.core.effects.record import Effect, Parameter


@jit
def push_down(s: Array, force: float, x: float, y: float, z: float, tau: Array) -> None:
    """Add the wrench of a force [N], positive downward in the world, at a point of the body [m]."""
    a, b, d = force * s[ROTATION + 6], force * s[ROTATION + 7], force * s[ROTATION + 8]
    tau[0] += a
    tau[1] += b
    tau[2] += d
    tau[3] += y * d - z * b
    tau[4] += z * a - x * d
    tau[5] += x * b - y * a


@jit
def net_buoyancy(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Force dB upward in the world at the centre of buoyancy: ballast misjudged, water of another density."""
    at = CENTER_OF_BUOYANCY
    push_down(s, -p[0], c[at], c[at + 1], c[at + 2], tau)


@jit
def buoyancy_offset(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Moment d x (R^T [0, 0, -B]): the vehicle's buoyancy B acts at d = (dx, dy, dz) from the file's centre.

    Lowering the centre of buoyancy (dz > 0) takes stability away: the righting moment at a roll phi changes
    by +B dz sin(phi).
    """
    push_down(s, -c[BUOYANCY], p[0], p[1], p[2], tau)
    push_down(s, c[BUOYANCY], 0.0, 0.0, 0.0, tau)


@jit
def payload(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Weight in water w, downward in the world, at a point of the body; its dry mass m adds only inertia.

    w is already weight less buoyancy, so that m enters M (about CO, with its Coriolis terms) and no force.
    """
    push_down(s, p[0], p[1], p[2], p[3], tau)


def point_mass(p: Array, matrix: Array) -> None:
    """Inertia of the payload: m [I, -S(r); S(r), -S(r)^2], Fossen (2011) eq. 3.44 for a point mass."""
    x, y, z, mass = p[1:5]
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    arm = np.hstack([np.eye(3), -lever])
    matrix += mass * arm.T @ arm


EFFECTS = (
    Effect(
        name="net_buoyancy",
        family="restoring",
        kind="wrench",
        definition="dB upward in the world at the centre of buoyancy",
        source="Fossen (2011), eq. 4.6",
        excitation="slow heave, or hovering with known thrust",
        lookalikes=("payload", "surface_suction", "ocean_current"),
        parameters=(Parameter("dB", ("N",), "extra buoyancy"),),
        kernel=net_buoyancy,
    ),
    Effect(
        name="buoyancy_offset",
        family="restoring",
        kind="wrench",
        definition="d x R^T [0, 0, -B]",
        source="Fossen (2011), eq. 4.6",
        excitation="slow roll and pitch, or trim angles at rest",
        lookalikes=("payload", "thruster_gain"),
        parameters=(
            Parameter("dx", ("m",), "centre of buoyancy moved forward"),
            Parameter("dy", ("m",), "centre of buoyancy moved to starboard"),
            Parameter("dz", ("m",), "centre of buoyancy moved down"),
        ),
        kernel=buoyancy_offset,
    ),
    Effect(
        name="payload",
        family="restoring",
        kind="wrench",
        definition="[R^T [0, 0, w]; r x R^T [0, 0, w]], and m [I, -S(r); S(r), -S(r)^2] in M",
        source="Fossen (2011), eqs. 3.44, 4.6",
        excitation="slow roll and pitch for the weight, accelerations for the dry mass",
        lookalikes=("net_buoyancy", "buoyancy_offset", "added_mass"),
        parameters=(
            Parameter("w", ("N",), "weight in water"),
            Parameter("x", ("m",), "position forward"),
            Parameter("y", ("m",), "position to starboard"),
            Parameter("z", ("m",), "position down"),
            Parameter("mass", ("kg",), "dry mass, inertia only", low=0.0),
        ),
        kernel=payload,
        inertia=point_mass,
    ),
)
