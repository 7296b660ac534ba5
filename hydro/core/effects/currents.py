"""Water currents: steady, growing with depth, and changing with time.

Every force of the water depends on the velocity through it, nu_r = nu - [R^T v_c; 0], and on its rate.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case
from hydro.core.effects.layout import ADDED_MASS, BUOYANCY, CENTER_OF_BUOYANCY, GRAVITY, ROTATION, VELOCITY
from hydro.core.effects.phrases import horizontal_change, undetermined
from hydro.core.effects.record import Advice, Effect, Identification, Parameter, Table
from hydro.core.effects.restoring import push_at
from hydro.core.effects.wording import quantity
from hydro.core.effects.words import DEPTHS, DISTANCES, HEADINGS, PASSES
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.plausible import Plausible, between

TIDAL = between(-3.0, 3.0, "m/s", "strong tidal streams; vehicles do not run against more")
VERTICAL = between(-1.0, 1.0, "m/s", "overfalls; elsewhere centimetres per second")
SHEARED = between(
    -0.3, 0.3, "1/s", "boundary layers of tidal streams; elsewhere centimetres per second and metre"
)
DEEPEST_SEA = 11_000.0
BRISK = 0.4
"""Initial current of a search in each of four directions, used where the file is far from the recording
[m/s].  Most vehicles can hold their position against less, and not against more."""
TURNING = between(
    -0.02, 0.02, "m/s^2", "internal waves and eddies over a minute; a tide has a thousandth of it"
)


def ocean_current(p: Array, flow: Array) -> None:
    """Velocity v_c of the water [m/s], NED: steady, irrotational, uniform.

    Every force of the water then depends on nu_r = nu - [R^T v_c; 0] and nu_r_dot = nu_dot + [omega x R^T
    v_c; 0] (the current is constant in the world and thus rotates in the body frame). A vehicle without
    thrust drifts with it.

    Adds to `flow`, the motion of the water of `catalogue.current`, (7,), by the parameters `p`;
    arguments as in `layout`.
    """
    flow[:3] += p


def current_shear(p: Array, flow: Array) -> None:
    """Velocity v_c + (g_N, g_E) (z - z_0) of the water [m/s], NED: it grows with depth z and is steady.

    z_0 is a depth given in the file that no fit changes.  About z_0 the shear is independent of the mean
    current, which `ocean_current` represents.  With z_0 at the surface, the shear would act as a mean current
    in a recording at one depth.

    Adds to `flow`, the motion of the water of `catalogue.current`, (7,), by the parameters `p`;
    arguments as in `layout`.
    """
    flow[:2] -= p[:2] * p[2]
    flow[3:5] += p[:2]


@kernel
def quickened(
    north: float, east: float, down: float, c: Array, s: Array, tau: Array
) -> tuple[float, float, float]:
    """Add to `tau` the wrench M_A [R^T v_c_dot; 0] of water that accelerates; return R^T v_c_dot.

    M_A is the added mass, R the rotation from body to NED, v_c_dot the water's acceleration, NED.  The wrench
    belongs to the last term of nu_r_dot = nu_dot + [omega x R^T v_c; 0] - [R^T v_c_dot; 0].  It acts through
    the added mass alone: a dry body obeys Newton's law over ground.

    Args:
        north: Acceleration of the water toward north [m/s^2].
        east: Acceleration of the water toward east [m/s^2].
        down: Acceleration of the water downward [m/s^2].
        c: Constants of the vehicle, as in `layout`.
        s: State of motion, as in `layout`.
        tau: Wrench on the vehicle, (6,), changed in place.

    Returns:
        R^T v_c_dot, the acceleration of the water in body axes [m/s^2].
    """
    x = s[ROTATION] * north + s[ROTATION + 3] * east + s[ROTATION + 6] * down
    y = s[ROTATION + 1] * north + s[ROTATION + 4] * east + s[ROTATION + 7] * down
    z = s[ROTATION + 2] * north + s[ROTATION + 5] * east + s[ROTATION + 8] * down
    for i in range(6):
        row = ADDED_MASS + 6 * i
        tau[i] += c[row] * x + c[row + 1] * y + c[row + 2] * z
    return x, y, z


@kernel
def dive_through_shear(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench M_A [R^T v_c_dot; 0] with v_c_dot = (g_N, g_E, 0) z_dot, the water's rate as the vehicle dives.

    The lift of a body in a flow with vorticity and the gradient over the hull are neglected.  The pressure of
    accelerating water, rho V (v_c grad) v_c, is zero for a horizontal current.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    down = ROTATION + 6
    sinking = s[down] * s[VELOCITY] + s[down + 1] * s[VELOCITY + 1] + s[down + 2] * s[VELOCITY + 2]
    quickened(p[0] * sinking, p[1] * sinking, 0.0, c, s, tau)


def current_trend(p: Array, flow: Array) -> None:
    """Velocity v_c + (a_N, a_E) (t - t_0) of the water [m/s], NED: it changes with the time t of the session.

    It represents a tide, an eddy or an internal wave within the minutes of a recording.  t_0 is a time given
    in the file that no fit changes, like the depth z_0 of `current_shear`.

    Adds to `flow`, the motion of the water of `catalogue.current`, (7,), by the parameters `p`;
    arguments as in `layout`.
    """
    flow[:2] -= p[:2] * p[2]
    flow[5:] += p[:2]


@kernel
def carried_along(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench (M_A + rho V) [R^T v_c_dot; 0] with v_c_dot = (a_N, a_E, 0), rho V at the centre of buoyancy.

    rho V is B/g.  The added mass responds to the water's rate as under `current_shear`.  The pressure that
    accelerates the water acts on the hull as on the displaced water (Newman 1977, chapter 4; the inertia
    coefficient 1 + C_A of Morison et al. 1950).  So a neutral vehicle at rest in the water stays at rest in
    it.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    mass, at = c[BUOYANCY] / c[GRAVITY], CENTER_OF_BUOYANCY
    fx, fy, fz = quickened(p[0], p[1], 0.0, c, s, tau)
    push_at(mass * fx, mass * fy, mass * fz, c[at], c[at + 1], c[at + 2], tau)


def amid(name: str, column: int) -> Callable[[Vehicle, Array | None], list[Table]]:
    """Return a function that proposes a reference depth or time for a fit: the median of a recording.

    Args:
        name: Parameter, the reference depth z_0 or time t_0.
        column: 2 for the depth, 3 for the time, in the positions and times (N, 4) of the recording.

    Returns:
        Function from a vehicle and the recording's positions [m] and times [s], (N, 4) or None, to a list of
        one table with the parameter's value; 0 without a recording.
    """

    def start(vehicle: Vehicle, reach: Array | None) -> list[Table]:
        return [{name: 0.0 if reach is None else round(float(np.median(reach[:, column])), 1)}]

    return start


def growth(names: str, unit: str, over: str, scale: float, plausible: Plausible) -> tuple[Parameter, ...]:
    """Return two `Parameter` records, for the gradients of the north and east current with depth or time.

    Args:
        names: First part of the parameters' names.
        unit: Unit of the gradients.
        over: `depth` or `time`, in words.
        scale: Significant size, in `unit`.
        plausible: Plausible range.
    """
    return tuple(
        Parameter(
            f"{names}_{axis[0].upper()}",
            (unit,),
            f"growth of the {axis}ward current with {over}",
            scale=(scale,),
            plausible=plausible,
        )
        for axis in ("north", "east")
    )


def current_sentence(case: Case) -> str:
    """Return a sentence that states the speed of the current and the heading toward which it flows."""
    down = case.one("v_D")
    now, old, clear = horizontal_change(case.one("v_N"), case.one("v_E"), "m/s")
    vertical = f"{'downward' if down.value > 0.0 else 'upward'} at {down.size('m/s')}" if down.clear else ""
    if not clear and not vertical:
        return undetermined(case, "the current", now)
    if not clear:
        was = f", not at {quantity(down.before, unit='m/s')} downward {case.as_given}" if case.in_file else ""
        return f"The water flows {vertical}{was}."
    also = f" and {vertical}" if vertical else ""
    if case.in_file:
        return f"The current is {now}{also}, not {old} {case.as_given}."
    return f"A current of {now.replace(' toward', ' flows toward')}{also}."


def shear_sentence(case: Case) -> str:
    """Return a sentence that states by how much the current grows per metre of depth, and where it points."""
    now, old, clear = horizontal_change(case.one("g_N"), case.one("g_E"), "m/s")
    if not clear:
        return undetermined(case, "the gain of the current per metre of depth", now)
    if case.in_file:
        return f"Per metre of depth the current gains {now}, not {old} {case.as_given}."
    from_ = quantity(case.one("z_0").value, unit="m")
    return f"Per metre of depth the current gains {now}, counted from {from_} depth."


def trend_sentence(case: Case) -> str:
    """Return a sentence that states by how much the current grows per minute, and where the change points."""
    now, old, clear = horizontal_change(case.one("a_N"), case.one("a_E"), "m/s", 60.0)
    if not clear:
        return undetermined(case, "the gain of the current per minute", now)
    if case.in_file:
        return f"Per minute the current gains {now}, not {old} {case.as_given}."
    from_ = round(case.one("t_0").value, 1) + 0.0
    return f"Per minute the current gains {now}, counted from t = {from_:.10g} s."


EFFECTS = (
    Effect(
        name="ocean_current",
        family="currents",
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
        sentence=current_sentence,
        advice=Advice(parted_by=(HEADINGS, DISTANCES)),
        identification=Identification(
            far=tuple(
                {"v_N": BRISK * north, "v_E": BRISK * east}
                for north, east in ((1, 0), (-1, 0), (0, 1), (0, -1))
            )
        ),
    ),
    Effect(
        name="current_shear",
        family="currents",
        kind="flow",
        definition="v_c(z) = v_c + (g_N, g_E, 0) (z - z_0), and M_A [R^T (g_N, g_E, 0) z_dot; 0]",
        source="Fossen (2011), section 8.3; nu_r_dot by differentiation",
        excitation="the same thrust and heading at several depths, or dives under way",
        lookalikes=("ocean_current", "body_lift", "coupled_damping"),
        parameters=(
            *growth("g", "1/s", "depth", 0.05, SHEARED),
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
        sentence=shear_sentence,
        kernel=dive_through_shear,
        identification=Identification(starts=amid("z_0", 2)),
        advice=Advice(parted_by=(DEPTHS, HEADINGS)),
    ),
    Effect(
        name="current_trend",
        family="currents",
        kind="flow",
        definition="v_c(t) = v_c + (a_N, a_E, 0) (t - t_0), and (M_A + rho V) [R^T (a_N, a_E, 0); 0]",
        source="Fossen (2011), section 8.3; Newman (1977), chapter 4",
        excitation="the same thrusts and headings early and late in a long session",
        lookalikes=("ocean_current", "tether"),
        parameters=(
            *growth("a", "m/s^2", "time", 2e-3, TURNING),
            Parameter(
                "t_0",
                ("s",),
                "time of the session at which it adds nothing",
                plausible=between(-1e10, 1e10, "s", "clocks begin anywhere, most of them in 1970"),
                held=True,
            ),
        ),
        flow=current_trend,
        sentence=trend_sentence,
        kernel=carried_along,
        identification=Identification(starts=amid("t_0", 3)),
        advice=Advice(parted_by=(PASSES, HEADINGS)),
    ),
)
