"""What the surroundings do to a vehicle: the current, a tether, the nearness of the surface."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.layout import (
    ADDED_MASS,
    BUOYANCY,
    CENTER_OF_BUOYANCY,
    GRAVITY,
    POSITION,
    ROTATION,
    VELOCITY,
)
from hydro.core.effects.parting import DEPTHS, DISTANCES, HEADINGS, PASSES, TILTS
from hydro.core.effects.record import (
    Advice,
    Effect,
    Identification,
    Index,
    Parameter,
    Rest,
    Role,
    Shape,
    Table,
)
from hydro.core.effects.restoring import push_at, push_down
from hydro.core.effects.shapes import LEVER, along
from hydro.core.effects.units import of_weight
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import Plausible, between, within_box
from hydro.core.vehicle.plausible import of_weight as up_to_weight

LITTLE = 0.01  # of the plain stiffness, in a column
FAR = 1e4
"""Distance of an anchor whose pull is as good as steady [m]."""
DECAYS = (0.5, 1.5, 4.0)  # m, depths of decay that are tried
TIDAL = between(-3.0, 3.0, "m/s", "strong tidal streams; vehicles do not fly against more")
VERTICAL = between(-1.0, 1.0, "m/s", "overfalls; elsewhere centimetres per second")
SHEARED = between(
    -0.3, 0.3, "1/s", "boundary layers of tidal streams; elsewhere centimetres per second and metre"
)
DEEPEST_SEA = 11_000.0
TURNING = between(
    -0.02, 0.02, "m/s^2", "internal waves and eddies over a minute; a tide has a thousandth of it"
)
LEAST_DECAY, SHALLOWEST, DEEPEST = 1e-3, 0.1, 30.0


def ocean_current(p: Array, flow: Array) -> None:
    """Velocity v_c of the water [m/s], NED: steady, irrotational, uniform.

    Every force of the water then depends on nu_r = nu - [R^T v_c; 0] and nu_r_dot = nu_dot + [omega x R^T
    v_c; 0] (the current is at rest in the world and thus turns in the body frame).  A vehicle left alone
    drifts with it.
    """
    flow[:3] += p


def current_shear(p: Array, flow: Array) -> None:
    """Velocity v_c + (g_N, g_E) (z - z_0) of the water [m/s], NED: it grows with depth z and is steady.

    z_0 is a depth that the file states and no fit moves: about it the shear says nothing of the mean current,
    which `ocean_current` stands for.  Counted from the surface it would be one itself wherever a recording
    keeps to one depth.
    """
    flow[:2] -= p[:2] * p[2]
    flow[3:5] += p[:2]


@kernel
def dive_through_shear(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench M_A [R^T v_c_dot; 0] with v_c_dot = (g_N, g_E, 0) z_dot, the water's rate as the vehicle dives.

    Of nu_r_dot = nu_dot + [omega x R^T v_c; 0] - [R^T v_c_dot; 0] it is the last term.  It acts through the
    added mass alone: a dry body obeys Newton's law over ground, and M_RB nu_dot + C_RB(nu) nu = M_RB (nu_dot
    + [omega x R^T v_c; 0]) + C_RB(nu_r) nu_r holds for any v_c.  Left out are the lift of a body in a flow
    with vorticity, the gradient over the hull, and the pressure of accelerating water, rho V (v_c grad) v_c,
    which a horizontal current does not have.
    """
    sinking = (
        s[ROTATION + 6] * s[VELOCITY] + s[ROTATION + 7] * s[VELOCITY + 1] + s[ROTATION + 8] * s[VELOCITY + 2]
    )
    north, east = p[0] * sinking, p[1] * sinking
    for j in range(3):
        rate = s[ROTATION + j] * north + s[ROTATION + 3 + j] * east
        for i in range(6):
            tau[i] += c[ADDED_MASS + 6 * i + j] * rate


def current_trend(p: Array, flow: Array) -> None:
    """Velocity v_c + (a_N, a_E) (t - t_0) of the water [m/s], NED: it changes with the time t of the session.

    A tide, an eddy or an internal wave within the minutes of a recording.  t_0 is a time that the file states
    and no fit moves, as the depth z_0 of `current_shear`.
    """
    flow[:2] -= p[:2] * p[2]
    flow[5:] += p[:2]


@kernel
def carried_along(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench (M_A + rho V) [R^T v_c_dot; 0] with v_c_dot = (a_N, a_E, 0), rho V at the centre of buoyancy.

    rho V is B/g.  The added mass feels the water's rate as under `current_shear`, and the pressure by which
    the water is accelerated acts on the hull in the place of the water's own (Newman 1977, chapter 4; the
    inertia coefficient 1 + C_A of Morison et al. 1950).  So a neutral vehicle at rest in the water stays at
    rest in it.
    """
    mass, at = c[BUOYANCY] / c[GRAVITY], CENTER_OF_BUOYANCY
    fx = s[ROTATION] * p[0] + s[ROTATION + 3] * p[1]
    fy = s[ROTATION + 1] * p[0] + s[ROTATION + 4] * p[1]
    fz = s[ROTATION + 2] * p[0] + s[ROTATION + 5] * p[1]
    push_at(mass * fx, mass * fy, mass * fz, c[at], c[at + 1], c[at + 2], tau)
    for i in range(6):
        row = ADDED_MASS + 6 * i
        tau[i] += c[row] * fx + c[row + 1] * fy + c[row + 2] * fz


def about_the_middle(vehicle: Vehicle, reach: Array | None) -> list[Table]:
    """No shear, about the depth that a recording is about."""
    return [{"z_0": 0.0 if reach is None else round(float(np.median(reach[:, 2])), 1)}]


def amid_the_time(vehicle: Vehicle, reach: Array | None) -> list[Table]:
    """No trend, about the middle of a recording's times."""
    return [{"t_0": 0.0 if reach is None else round(float(np.median(reach[:, 3])), 1)}]


@kernel
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
    push_at(fx, fy, fz, ax, ay, az, tau)


@kernel
def surface_suction(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Force A exp(-max(z, 0)/decay) upward in the world at the centre of buoyancy, z the depth of CO.

    A hull under way close below a free surface is drawn toward it, the more the closer (an empirical law).
    """
    force = p[0] * math.exp(-max(s[POSITION + 2], 0.0) / p[1])
    at = CENTER_OF_BUOYANCY
    push_down(s, -force, c[at], c[at + 1], c[at + 2], tau)


def on_the_hull(index: Index, rest: Rest) -> tuple[float, float]:
    """Points within a length of CO."""
    return -rest.vehicle.hull.length, rest.vehicle.hull.length


def cables(vehicle: Vehicle, reach: Array | None) -> list[Table]:
    """Anchors amid the recorded track and on its edges, cables that pull always or far out only."""
    track = np.zeros((1, 3)) if reach is None else reach[:, :3]
    middle, half = np.median(track, axis=0), np.maximum(0.5 * np.ptp(track, axis=0), 2.0)
    anchors = [middle, track[0]]
    anchors += [middle + sign * half[i] * np.eye(3)[i] for i in range(3) for sign in (-1.0, 1.0)]
    found = []
    for anchor in anchors:
        distance = np.linalg.norm(track - anchor, axis=1)
        for slack in np.quantile(distance, [0.0, 0.5]):
            found.append(_cable(of_weight(0.002)(vehicle), float(slack), np.zeros(3), anchor))
    return found


def without_slack(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
    """A cable without slack: the stiffness k, k times the anchor, and the moments of k at one anchor.

    Without slack the force is k (anchor - position), linear in all of them, so that anchors amid the track
    and to three sides of it stand for any.
    """
    length, stiffness = vehicle.hull.length, TETHER.parameter("k").scale_at((), vehicle)
    lever, held = LEVER * length, np.array(cables(vehicle, reach)[0]["anchor"])
    side = max(float(np.ptp(reach[:, :3], axis=0).max()), 2.0) if reach is not None else 2.0

    def cable(k: float, anchor: Array, attachment: Array) -> Table:
        return _cable(k, 0.0, attachment, anchor)

    def begin(amounts: Array) -> Table:
        stiff = max(float(amounts.sum()), 1e-3)
        anchor = held + np.clip(amounts[1:4] / stiff, -3.0, 3.0) * side
        attachment = np.clip(np.clip(amounts[4:] / stiff, -4.0, 4.0) * lever, -length, length)
        return cable(stiff * stiffness, anchor, attachment)

    little = LITTLE * stiffness
    tables = [cable(little, held + side * way, np.zeros(3)) for way in (np.zeros(3), *np.eye(3))]
    tables += [cable(little, held, lever * way) for way in np.eye(3)]
    yield Shape(tuple(tables), (LITTLE,) * 7, begin)


def with_slack(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
    """For each anchor and slack, the stiffness k and its moments k a about CO: linear in all four."""
    length, stiffness = vehicle.hull.length, TETHER.parameter("k").scale_at((), vehicle)
    lever = LEVER * length
    for start in cables(vehicle, reach):

        def cable(k: float, attachment: Array, start: Table = start) -> Table:
            return _cable(k, start["slack"], attachment, np.array(start["anchor"]))

        def begin(amounts: Array, cable: Callable[[float, Array], Table] = cable) -> Table:
            stiff = max(float(amounts.sum()), 1e-3)
            return cable(stiff * stiffness, np.clip(amounts[1:] / stiff * lever, -length, length))

        tables = tuple(cable(LITTLE * stiffness, lever * way) for way in (np.zeros(3), *np.eye(3)))
        yield Shape(tables, (LITTLE,) * 4, begin)


def steady_pull(force: float, way: Array, attachment: Array) -> Table:
    """A cable whose anchor is so far off that it pulls alike everywhere.

    Args:
        force: Pull [N].
        way: Direction, NED, (3,), of length 1.
        attachment: Point on the body [m], (3,).
    """
    return _cable(force / FAR, 0.0, attachment, FAR * way)


def _cable(k: float, slack: float, attachment: Array, anchor: Array) -> Table:
    return {
        "name": TETHER.name,
        "k": k,
        "slack": slack,
        "attachment": attachment.tolist(),
        "anchor": anchor.tolist(),
    }


def shallow_to_deep(index: Index, rest: Rest) -> tuple[float, float]:
    """Depths of decay that a recording can show."""
    return SHALLOWEST, DEEPEST


def absent(decay: float) -> Table:
    """A suction of no force."""
    return {"name": SURFACE_SUCTION.name, "A": 0.0, "decay": decay}


def suctions(vehicle: Vehicle, reach: Array | None) -> Iterator[Shape]:
    """The force at the surface for each depth of decay."""
    for decay in DECAYS:
        yield along(SURFACE_SUCTION, "A", absent(decay), vehicle)


TETHER = Effect(
    name="tether",
    repeatable=True,
    family="surroundings",
    kind="wrench",
    definition="k max(0, distance - slack) toward the anchor, at the attachment",
    source="Hooke's law for a straight massless cable",
    excitation="excursions beyond the slack in several directions",
    lookalikes=("ocean_current", "net_buoyancy"),
    parameters=(
        Parameter(
            "k",
            ("N/m",),
            "stiffness",
            low=0.0,
            scale=(of_weight(0.005),),
            plausible=Plausible(
                lambda index, vehicle: (0.0, of_weight(1.0)(vehicle)),
                "up to the vehicle's weight per metre",
                "slack-laid cables give way",
            ),
        ),
        Parameter(
            "slack",
            ("m",),
            "length before it pulls",
            low=0.0,
            scale=(5.0,),
            plausible=between(0.0, FAR, "m", "lengths of tethers"),
        ),
        Parameter(
            "attachment",
            ("m",),
            "point on the body",
            (3,),
            limits=on_the_hull,
            plausible=within_box(2.0, "either way up to the hull's length along each axis", "mounting"),
        ),
        Parameter(
            "anchor",
            ("m",),
            "fixed end, NED",
            (3,),
            required=True,
            scale=(10.0,),
            plausible=between(-FAR, FAR, "m", "lengths of tethers, from where NED begins"),
        ),
    ),
    kernel=tether,
    identification=Identification(step=1e-2, starts=cables, coarse=without_slack, fine=with_slack),
    advice=Advice(parted_by=(HEADINGS,)),
)
SURFACE_SUCTION = Effect(
    name="surface_suction",
    family="surroundings",
    kind="wrench",
    definition="A exp(-max(z, 0)/decay) upward in the world at the centre of buoyancy",
    source="empirical: free-surface effects decay exponentially with depth",
    excitation="slow passages at several depths near the surface",
    lookalikes=("net_buoyancy",),
    parameters=(
        Parameter(
            "A",
            ("N",),
            "force at the surface",
            plausible=up_to_weight(
                0.3, "either way up to 0.3 of the vehicle's weight", "what thrusters hold for long"
            ),
        ),
        Parameter(
            "decay",
            ("m",),
            "depth over which it falls to 1/e",
            low=LEAST_DECAY,
            required=True,
            scale=(1.0,),
            limits=shallow_to_deep,
            plausible=between(SHALLOWEST, DEEPEST, "m", "a part of the hull's length to some lengths"),
        ),
    ),
    kernel=surface_suction,
    identification=Identification(
        starts=lambda vehicle, reach: [absent(decay) for decay in DECAYS], coarse=suctions
    ),
    advice=Advice(parted_by=(TILTS,)),
)

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
            Parameter("v_N", ("m/s",), "northward velocity of the water", plausible=TIDAL),
            Parameter("v_E", ("m/s",), "eastward velocity of the water", plausible=TIDAL),
            Parameter("v_D", ("m/s",), "downward velocity of the water", plausible=VERTICAL),
        ),
        flow=ocean_current,
        advice=Advice(parted_by=(HEADINGS, DISTANCES)),
        roles=frozenset({Role.OFTEN_LACKING}),
    ),
    Effect(
        name="current_shear",
        family="surroundings",
        kind="flow",
        definition="v_c(z) = v_c + (g_N, g_E, 0) (z - z_0), and M_A [R^T (g_N, g_E, 0) z_dot; 0]",
        source="Fossen (2011), section 8.3; nu_r_dot by differentiation",
        excitation="the same thrust and heading at several depths, or dives under way",
        lookalikes=("ocean_current", "body_lift", "coupled_damping"),
        parameters=(
            Parameter(
                "g_N",
                ("1/s",),
                "growth of the northward current with depth",
                scale=(0.05,),
                plausible=SHEARED,
            ),
            Parameter(
                "g_E", ("1/s",), "growth of the eastward current with depth", scale=(0.05,), plausible=SHEARED
            ),
            Parameter(
                "z_0",
                ("m",),
                "depth at which it adds nothing",
                plausible=between(
                    -10.0, DEEPEST_SEA, "m", "the deepest sea; NED may begin below its surface"
                ),
                held=True,
            ),
        ),
        flow=current_shear,
        kernel=dive_through_shear,
        identification=Identification(starts=about_the_middle),
        advice=Advice(parted_by=(DEPTHS, HEADINGS)),
    ),
    Effect(
        name="current_trend",
        family="surroundings",
        kind="flow",
        definition="v_c(t) = v_c + (a_N, a_E, 0) (t - t_0), and (M_A + rho V) [R^T (a_N, a_E, 0); 0]",
        source="Fossen (2011), section 8.3; Newman (1977), chapter 4",
        excitation="the same thrusts and headings early and late in a long session",
        lookalikes=("ocean_current", "tether"),
        parameters=(
            Parameter(
                "a_N",
                ("m/s^2",),
                "growth of the northward current with time",
                scale=(2e-3,),
                plausible=TURNING,
            ),
            Parameter(
                "a_E",
                ("m/s^2",),
                "growth of the eastward current with time",
                scale=(2e-3,),
                plausible=TURNING,
            ),
            Parameter(
                "t_0",
                ("s",),
                "time of the session at which it adds nothing",
                plausible=between(-math.inf, math.inf, "s", "clocks begin anywhere"),
                held=True,
            ),
        ),
        flow=current_trend,
        kernel=carried_along,
        identification=Identification(starts=amid_the_time),
        advice=Advice(parted_by=(PASSES, HEADINGS)),
    ),
    TETHER,
    SURFACE_SUCTION,
)
