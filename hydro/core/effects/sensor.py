"""Errors of the DVL, which change the recorded velocity but not the motion.

u_m(t) = (1 + s) R(alpha)^T [v(t - d) + omega(t - d) x r] + b, with the velocity v of CO.  The logged p, q, r
and the pose are not affected.  No force can make d(pose)/dt and R nu differ, so these effects are visible in
the kinematics, and are inverted once, before any dynamics.

A reference point is the exception.  Where position and velocity are both those of another point of the body,
as in a position that was integrated from the DVL, they agree with each other, and forces alone show it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.effects.case import Case, Quantity
from hydro.core.effects.phrases import along_body, displaced, undetermined
from hydro.core.effects.record import Advice, Effect, Identification, Index, Kinematics, Parameter, Rest
from hydro.core.effects.shapes import of_sizes
from hydro.core.effects.wording import AXES, known, listed, quantity
from hydro.core.effects.words import CHIRP, DISTANCES, DRIFT, HEADINGS, a_heading_off, a_sample_late
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation, skew
from hydro.core.vehicle.plausible import between, within_box

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# DVL errors as a row of numbers, filled by the effects.
SCALE = slice(0, 3)
ANGLES = slice(3, 6)
DELAY = 6
LEVER = slice(7, 10)
BIAS = slice(10, 13)
LOG = 13

# Point whose position and velocity are logged, after the errors of the DVL.
POINT = slice(13, 16)
ROW = 16

SHORT = 256  # rows up to which all pairs fit into memory
LONGEST_DELAY = 0.5
"""Largest delay of a DVL that is searched [s]."""
SCALE_ERROR = between(
    -0.2, 0.2, "", "Kinsey and Whitcomb (2007): per cents; the speed of sound varies by a tenth"
)
DELAYS, MORE_DELAYS = (0.02, 0.06, 0.2), (0.02, 0.035, 0.06, 0.1, 0.2, 0.4)  # s, delays that are tried


def sensor_scale(p: Array, log: Array) -> None:
    """Reading (1 + s) v of the velocity v, with one scale error s or three: a wrong speed of sound.

    Changes `log`, the vector of DVL errors of `core.effects.sensor`, (16,), by the parameters `p`;
    arguments as in `layout`.
    """
    log[SCALE] += p


def sensor_misalignment(p: Array, log: Array) -> None:
    """Reading R(alpha)^T v of the velocity v: the DVL is rotated by roll, pitch, yaw alpha (ZYX).

    Changes `log`, the vector of DVL errors of `core.effects.sensor`, (16,), by the parameters `p`;
    arguments as in `layout`.
    """
    log[ANGLES] += p


def sensor_delay(p: Array, log: Array) -> None:
    """Reading of the time t - d, stamped t, with the delay d: averaging and transmission.

    Changes `log`, the vector of DVL errors of `core.effects.sensor`, (16,), by the parameters `p`;
    arguments as in `layout`.
    """
    log[DELAY] += p[0]


def sensor_lever_arm(p: Array, log: Array) -> None:
    """Reading v + omega x r of the velocity v: the DVL is at the lever arm r from its assumed place.

    Changes `log`, the vector of DVL errors of `core.effects.sensor`, (16,), by the parameters `p`;
    arguments as in `layout`.
    """
    log[LEVER] += p


def reference_point(p: Array, log: Array) -> None:
    """Reading v + omega x r and position + R r: both are those of a point r of the body, not of CO.

    Changes `log`, the vector of DVL errors of `core.effects.sensor`, (16,), by the parameters `p`;
    arguments as in `layout`.
    """
    log[POINT] += p


def sensor_bias(p: Array, log: Array) -> None:
    """Reading v + b of the velocity v, with a constant bias b in the DVL's axes.

    Changes `log`, the vector of DVL errors of `core.effects.sensor`, (16,), by the parameters `p`;
    arguments as in `layout`.
    """
    log[BIAS] += p


def measured(log: Array, t: ArrayLike, nu: ArrayLike) -> Array:
    """Return the velocity that the DVL and gyros would log for a motion of the vehicle.

    Args:
        log: DVL errors from `catalogue.velocity_log`, (16,); the last three entries, a reference point, may
            be missing.
        t: Times of one segment [s], shape (N,), ascending.
        nu: Velocity of CO over ground, body frame, shape (..., N, 6).

    Returns:
        Logged velocity, shape (..., N, 6); p, q, r unchanged.  The motion before the first row is assumed
        equal to that of the first row.
    """
    motion = np.array(nu, dtype=np.float64)
    local = motion[..., :3]
    if (arm := _arm(log)).any():
        local = local + motion[..., 3:] @ skew(arm)  # faster than np.cross for a few rows
    local = _at(np.asarray(t, float) - log[DELAY], np.asarray(t, float), local)
    if log[ANGLES].any():
        local = local @ rotation(*log[ANGLES])
    motion[..., :3] = (1.0 + log[SCALE]) * local + log[BIAS]
    return motion


def corrected(log: Array, t: ArrayLike, nu: ArrayLike) -> Array:
    """Return the velocity of CO from the logged velocity: the inverse of `measured`.

    A delay d leaves the last d seconds without later samples; there the result is approximate.

    Args:
        log: DVL errors from `catalogue.velocity_log`, (13,) or (16,).
        t: Times of one segment [s], shape (N,), ascending.
        nu: Logged velocity, shape (N, 6).

    Returns:
        Velocity of CO, shape (N, 6).
    """
    motion = np.array(nu, dtype=np.float64)
    local = ((motion[:, :3] - log[BIAS]) / (1.0 + log[SCALE])) @ rotation(*log[ANGLES]).T
    local = _at(np.asarray(t, float) + log[DELAY], np.asarray(t, float), local)
    motion[:, :3] = local - motion[:, 3:] @ skew(_arm(log))
    return motion


def logged_position(log: Array, states: Array) -> Array:
    """Return states with the position of CO replaced by that of the logged reference point, (..., 13).

    The states themselves are returned if CO is the reference point.

    Args:
        log: DVL errors and reference point from `catalogue.velocity_log`, (16,).
        states: Position, unit quaternion and velocity, (..., 13); NaN stays NaN.
    """
    return _moved(states, _rotated(states[..., 3:7], log[POINT])) if log[POINT].any() else states


def true_position(log: Array, states: Array) -> Array:
    """Return states with the position of the logged reference point replaced by that of CO, (..., 13).

    The function is the inverse of `logged_position`.  The states themselves are returned if CO is the
    reference point.

    Args:
        log: DVL errors and reference point from `catalogue.velocity_log`, (16,).
        states: Position, unit quaternion and velocity, (..., 13); NaN stays NaN.
    """
    return _moved(states, -_rotated(states[..., 3:7], log[POINT])) if log[POINT].any() else states


def logged_pose(log: Array, eta: Array) -> Array:
    """Return poses with the position of CO replaced by that of the logged reference point, (..., 6).

    The poses themselves are returned if CO is the reference point.

    Args:
        log: DVL errors and reference point from `catalogue.velocity_log`, (16,).
        eta: Poses, NED, (..., 6) [m, rad].
    """
    return _moved(eta, _turned(eta, log[POINT])) if log[POINT].any() else eta


def true_pose(log: Array, eta: Array) -> Array:
    """Return poses with the position of the logged reference point replaced by that of CO, (..., 6).

    The poses themselves are returned if CO is the reference point.

    Args:
        log: DVL errors and reference point from `catalogue.velocity_log`, (16,).
        eta: Poses, NED, (..., 6) [m, rad].
    """
    return _moved(eta, -_turned(eta, log[POINT])) if log[POINT].any() else eta


def logged_shift(log: Array, quaternion: Array, deviations: Array) -> Array:
    """Return the changes of the logged position [m] that small changes of the motion cause, (..., 3, Q).

    Args:
        log: DVL errors and reference point from `catalogue.velocity_log`, (16,).
        quaternion: Attitude, (..., 4).
        deviations: Q changes of the motion, (..., 6 or more, Q): rows 0 to 2 the position of CO [m], rows 3
            to 5 a small rotation about the body's axes [rad].
    """
    turn = deviations[..., 3:6, :].swapaxes(-1, -2) @ skew(log[POINT])
    moved = _rotated(quaternion[..., None, :], turn).swapaxes(-1, -2)
    shift: Array = deviations[..., :3, :] + moved
    return shift


def _arm(log: Array) -> Array:
    """Return the place of the point whose velocity is measured, (3,) [m]."""
    arm: Array = log[LEVER] + log[POINT] if len(log) == ROW else log[LEVER]
    return arm


def _moved(states: Array, shift: Array) -> Array:
    """Return a copy of states with their positions shifted."""
    out = np.array(states, dtype=np.float64)
    out[..., :3] += shift
    return out


def _turned(eta: Array, vector: Array) -> Array:
    """Return a body vector (3,) in the world, by the Euler angles of poses (..., 6)."""
    turned: Array = rotation(eta[..., 3], eta[..., 4], eta[..., 5]) @ vector
    return turned


def _rotated(quaternion: Array, vector: Array) -> Array:
    """Return a body vector (..., 3) in the world, by unit quaternions (..., 4)."""
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    once = np.cross(axis, vector)
    turned: Array = vector + 2.0 * (w * once + np.cross(axis, once))
    return turned


def _at(moments: Array, t: Array, values: Array) -> Array:
    """Return values (..., N, 3) given at t at other times: a cubic spline, constant beyond both ends."""
    if len(t) < 2 or np.array_equal(moments, t):
        return values
    inside = np.clip(moments, t[0], t[-1])
    if len(t) > SHORT:
        return np.asarray(_spline(t, values, -2)(inside))
    by_time = np.moveaxis(values, -2, 0)
    taken = _weights(t.tobytes(), inside.tobytes()) @ by_time.reshape(len(t), -1)
    return np.moveaxis(taken.reshape(by_time.shape), 0, -2)


@lru_cache(64)
def _weights(t: bytes, moments: bytes) -> Array:
    """Return the weights of spline interpolation between times, (N, N), shared by all shots of a fit."""
    times = np.frombuffer(t)
    return np.asarray(_spline(times, np.eye(len(times)), 0)(np.frombuffer(moments)))


def _spline(t: Array, values: Array, axis: int) -> CubicSpline:
    from scipy.interpolate import CubicSpline

    return CubicSpline(t, values, axis=axis)


def room_of_delay(vehicle: Vehicle) -> tuple[float, float]:
    """Return the least (0) and greatest (LONGEST_DELAY) admissible delay of a DVL [s]."""
    return 0.0, LONGEST_DELAY


def up_to_longest(index: Index, rest: Rest) -> tuple[float, float]:
    """Return the minimum and maximum of a DVL delay in a fit [s].

    Args:
        index: Not used.
        rest: Not used.
    """
    return room_of_delay(rest.vehicle)


def delay_sentence(case: Case) -> str:
    """Return a sentence that states the delay of the DVL velocity."""
    delay = case.one("d")
    if not delay.clear:
        return undetermined(case, "the delay of the DVL velocity", delay.text("s"))
    was = f", not {quantity(delay.before, unit='s')} {case.as_given}" if case.in_file else ""
    side = "late" if delay.value >= 0.0 else "early"
    return f"DVL velocity arrives {delay.size('s')} {side}{was or case.sampled(delay.value)}."


def scale_sentence(case: Case) -> str:
    """Return a sentence that states the scale error of the DVL velocity, for all axes or for each."""
    than = f"than {'before' if case.earlier else 'the file says'}" if case.in_file else ""
    words = ("higher", "lower") if case.in_file else ("too high", "too low")

    def side(one: Quantity) -> str:
        return f"{one.changed('%')} {words[one.change < 0.0]}"

    axes = {"axes"} & (set(case.values) | set(case.before or {}))
    if not axes:
        scale = case.one("s").times(100.0)
        if not scale.clear:
            return undetermined(case, "the scale error of the DVL", scale.text("%"))
        return f"DVL velocity reads {side(scale)} {than}".strip() + "."
    three = [one.times(100.0) for one in scales(case)]
    kept = [f"{side(one)} in {axis}" for axis, one in zip(AXES, three, strict=False) if one.clear]
    if not kept:
        far = max(range(3), key=lambda i: three[i].deviations)
        return undetermined(case, f"the scale error of the DVL in {AXES[far]}", three[far].text("%"))
    return f"DVL velocity reads {listed(kept)} {than}".strip() + "."


def scales(case: Case) -> list[Quantity]:
    """Return the scale errors of the DVL on three axes, also where one number holds for all axes."""
    form = "axes" if "axes" in case.values or "s" not in case.values else "s"
    old = "axes" if "axes" in (case.before or {}) else "s"
    before = case.of_file(old, (3,)).tolist()
    return [one._replace(before=was) for one, was in zip(case.many(form, (3,)), before, strict=True)]


TURNS = (
    ("starboard side down in roll", "port side down in roll"),
    ("nose up in pitch", "nose down in pitch"),
    ("to starboard in yaw", "to port in yaw"),
)
"""Words for a positive and a negative angle about each axis of the body, FRD."""
LEAST_ANGLE = 0.05
"""Angle below which a value without a standard error is negligible [deg]."""


def misalignment_sentence(case: Case) -> str:
    """Return a sentence that states the angles by which the DVL is rotated against the body."""
    angles = [one.times(180.0 / np.pi) for one in case.many("alpha", (3,))]
    kept = [
        f"{one.changed('°')} {words[one.change < 0.0]}"
        for one, words in zip(angles, TURNS, strict=True)
        if one.clear and (known(one.error) or abs(one.change) >= LEAST_ANGLE)
    ]
    if not kept:
        far = max(angles, key=lambda one: one.deviations)
        return undetermined(case, "the misalignment of the DVL", far.changed("°"))
    mounting = case.old_value.replace("value", "mounting")
    against = mounting if case.in_file else "the body"
    return f"The DVL is turned {listed(kept)} against {against}."


def bias_sentence(case: Case) -> str:
    """Return a sentence that states the constant error of the DVL velocity along the body's axes."""
    three = case.many("b", (3,))
    pieces = [
        piece.replace(" below", " downward").replace(" above", " upward")
        for piece in along_body(three, "m/s", 5e-4)
    ]
    if not pieces:
        far = max(three, key=lambda one: one.deviations)
        return undetermined(case, "the bias of the DVL velocity", far.changed("m/s"))
    more = f" more than {'before' if case.earlier else 'in the file'}" if case.in_file else ""
    return f"DVL velocity has a constant error of {listed(pieces)}{more}."


SENSOR_DELAY = Effect(
    name="sensor_delay",
    family="sensor",
    kind="sensor",
    definition="v(t - d)",
    source="pure delay",
    excitation="fast changes of velocity with the pose known",
    lookalikes=("command_delay", "thruster_lag"),
    parameters=(
        Parameter(
            "d",
            ("s",),
            "age of a reading",
            low=0.0,
            limits=up_to_longest,
            plausible=between(0.0, 2.0, "s", "averaging over some pings and transmission"),
        ),
    ),
    sensor=sensor_delay,
    sentence=delay_sentence,
    identification=Identification(
        step=1e-2,
        coarse=of_sizes("sensor_delay", "d", room_of_delay, DELAYS),
        fine=of_sizes("sensor_delay", "d", room_of_delay, MORE_DELAYS),
    ),
    kinematics=Kinematics("d", slice(DELAY, DELAY + 1)),
    advice=Advice(parted_by=(DISTANCES, CHIRP), saying=a_sample_late),
)

EFFECTS = (
    Effect(
        name="sensor_scale",
        family="sensor",
        kind="sensor",
        definition="(1 + s) v",
        source="Kinsey and Whitcomb (2007)",
        excitation="straight runs over known distances",
        lookalikes=("ocean_current", "sensor_bias"),
        parameters=(
            Parameter("s", ("1",), "relative error, all axes", low=-0.9, scale=(0.1,), plausible=SCALE_ERROR),
            Parameter(
                "axes",
                ("1",),
                "relative error of each axis",
                (3,),
                low=-0.9,
                scale=(0.1,),
                plausible=SCALE_ERROR,
            ),
        ),
        one_of=("s", "axes"),
        sensor=sensor_scale,
        sentence=scale_sentence,
        identification=Identification(form="axes"),
        kinematics=Kinematics("axes", SCALE, negligible=0.005),
        advice=Advice(parted_by=(DISTANCES,)),
    ),
    Effect(
        name="sensor_misalignment",
        family="sensor",
        kind="sensor",
        definition="R(alpha)^T v",
        source="Kinsey and Whitcomb (2007)",
        excitation="straight runs ahead and sideways with the pose known",
        lookalikes=("ocean_current", "sensor_bias"),
        parameters=(
            Parameter(
                "alpha",
                ("rad",),
                "roll, pitch, yaw of the log against the body",
                (3,),
                plausible=between(-0.5, 0.5, "rad", "mounting; 45 degrees are a convention of the log"),
            ),
        ),
        sensor=sensor_misalignment,
        sentence=misalignment_sentence,
        kinematics=Kinematics("alpha", ANGLES, negligible=0.005),
        advice=Advice(parted_by=(DISTANCES,), saying=a_heading_off),
    ),
    SENSOR_DELAY,
    Effect(
        name="sensor_lever_arm",
        family="sensor",
        kind="sensor",
        definition="v + omega x r",
        source="Fossen (2011), eq. 2.20 (velocity of a point)",
        excitation="turning about every axis with the pose known",
        lookalikes=("added_mass_coupling", "coupled_damping"),
        parameters=(
            Parameter(
                "r",
                ("m",),
                "position of the log",
                (3,),
                plausible=within_box(2.0, "either way up to the hull's length along each axis", "mounting"),
            ),
        ),
        sensor=sensor_lever_arm,
        sentence=displaced("the DVL", "sits", "r", "where the file has it"),
        kinematics=Kinematics("r", LEVER, negligible=0.01),
        advice=Advice(parted_by=(DRIFT,)),
    ),
    Effect(
        name="reference_point",
        family="sensor",
        kind="sensor",
        definition="v + omega x r, position + R r",
        source="Fossen (2011), eq. 2.20 (velocity of a point)",
        excitation="turning about every axis with known thrust",
        lookalikes=("sensor_lever_arm", "added_mass_coupling", "coupled_damping", "thruster_gain"),
        parameters=(
            Parameter(
                "r",
                ("m",),
                "position of the logged point",
                (3,),
                plausible=within_box(2.0, "either way up to the hull's length along each axis", "mounting"),
            ),
        ),
        sensor=reference_point,
        sentence=displaced(
            "the point of the logged position and velocity", "lies", "r", "where the file has it"
        ),
        advice=Advice(parted_by=(DRIFT,)),
    ),
    Effect(
        name="sensor_bias",
        family="sensor",
        kind="sensor",
        definition="v + b",
        source="Kinsey and Whitcomb (2007)",
        excitation="several headings with the pose known",
        lookalikes=("ocean_current", "sensor_scale"),
        parameters=(
            Parameter(
                "b",
                ("m/s",),
                "constant error of each axis",
                (3,),
                plausible=between(-0.3, 0.3, "m/s", "Kinsey and Whitcomb (2007): centimetres per second"),
            ),
        ),
        sensor=sensor_bias,
        sentence=bias_sentence,
        kinematics=Kinematics("b", BIAS, negligible=0.003),
        advice=Advice(parted_by=(DISTANCES, HEADINGS)),
    ),
)
