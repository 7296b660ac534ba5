"""What the surroundings do to a vehicle: the current, a tether, the nearness of the surface."""

from __future__ import annotations

import math

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.effects.layout import CENTER_OF_BUOYANCY, POSITION, ROTATION
from hydro.core.effects.record import Effect, Parameter
from hydro.core.effects.restoring import push_down


def ocean_current(p: Array, current: Array) -> None:
    """Velocity v_c of the water [m/s], NED: steady, irrotational, uniform.

    Every force of the water then depends on nu_r = nu - [R^T v_c; 0] and nu_r_dot = nu_dot + [omega x R^T
    v_c; 0] (the current is at rest in the world and thus turns in the body frame).  A vehicle left alone
    drifts with it.
    """
    current += p


@jit
def tether(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Pull k max(0, distance - slack) at the attachment toward the anchor, straight, massless, undamped.

    It is the negative gradient of 1/2 k max(0, distance - slack)^2, and so keeps the energy.
    """
    stiffness, slack = p[0], p[1]
    ax, ay, az = p[2], p[3], p[4]
    lx = p[5] - s[POSITION] - (s[ROTATION] * ax + s[ROTATION + 1] * ay + s[ROTATION + 2] * az)
    ly = p[6] - s[POSITION + 1] - (s[ROTATION + 3] * ax + s[ROTATION + 4] * ay + s[ROTATION + 5] * az)
    lz = p[7] - s[POSITION + 2] - (s[ROTATION + 6] * ax + s[ROTATION + 7] * ay + s[ROTATION + 8] * az)
    distance = math.sqrt(lx * lx + ly * ly + lz * lz)
    if distance <= slack or distance == 0.0:
        return
    pull = stiffness * (distance - slack) / distance
    fx = pull * (s[ROTATION] * lx + s[ROTATION + 3] * ly + s[ROTATION + 6] * lz)
    fy = pull * (s[ROTATION + 1] * lx + s[ROTATION + 4] * ly + s[ROTATION + 7] * lz)
    fz = pull * (s[ROTATION + 2] * lx + s[ROTATION + 5] * ly + s[ROTATION + 8] * lz)
    tau[0] += fx
    tau[1] += fy
    tau[2] += fz
    tau[3] += ay * fz - az * fy
    tau[4] += az * fx - ax * fz
    tau[5] += ax * fy - ay * fx


@jit
def surface_suction(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Force A exp(-max(z, 0)/decay) upward in the world at the centre of buoyancy, z the depth of CO.

    A hull under way close below a free surface is drawn toward it, the more the closer (an empirical law).
    """
    force = p[0] * math.exp(-max(s[POSITION + 2], 0.0) / p[1])
    at = CENTER_OF_BUOYANCY
    push_down(s, -force, c[at], c[at + 1], c[at + 2], tau)


EFFECTS = (
    Effect(
        name="ocean_current",
        family="surroundings",
        kind="flow",
        definition="nu_r = nu - [R^T v_c; 0]",
        source="Fossen (2011), section 8.3, property 8.1",
        excitation="several headings with a known thrust, or free drift",
        lookalikes=("sensor_bias", "net_buoyancy", "tether"),
        parameters=(
            Parameter("v_N", ("m/s",), "northward velocity of the water"),
            Parameter("v_E", ("m/s",), "eastward velocity of the water"),
            Parameter("v_D", ("m/s",), "downward velocity of the water"),
        ),
        flow=ocean_current,
    ),
    Effect(
        name="tether",
        family="surroundings",
        kind="wrench",
        definition="k max(0, distance - slack) toward the anchor, at the attachment",
        source="Hooke's law for a straight massless cable",
        excitation="excursions beyond the slack in several directions",
        lookalikes=("ocean_current", "net_buoyancy"),
        parameters=(
            Parameter("k", ("N/m",), "stiffness", low=0.0),
            Parameter("slack", ("m",), "length before it pulls", low=0.0),
            Parameter("attachment", ("m",), "point on the body", (3,)),
            Parameter("anchor", ("m",), "fixed end, NED", (3,), required=True),
        ),
        kernel=tether,
    ),
    Effect(
        name="surface_suction",
        family="surroundings",
        kind="wrench",
        definition="A exp(-max(z, 0)/decay) upward in the world at the centre of buoyancy",
        source="empirical: free-surface effects decay exponentially with depth",
        excitation="slow passages at several depths near the surface",
        lookalikes=("net_buoyancy",),
        parameters=(
            Parameter("A", ("N",), "force at the surface"),
            Parameter("decay", ("m",), "depth over which it falls to 1/e", low=1e-3, required=True),
        ),
        kernel=surface_suction,
    ),
)
