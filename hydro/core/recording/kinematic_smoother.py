"""Kinematic smoother: pose, velocity and acceleration with standard deviations, from any samples.

An error-state extended Kalman filter runs forward over each segment of a recording, and a fixed-interval
smoother runs back.  The smoother gives the Rauch-Tung-Striebel estimates in the form of Bryson and Frazier
(Bierman 1973, Automatica 9).  That form inverts no covariance, so it tolerates undetermined states.  Each
sample is one scalar measurement; a null is no measurement.  Motion and sensors are those of
`kinematic_model`.

The spectral densities of the white noise maximise the likelihood.  The score is half the sum over the rows of
lambda' Q_i lambda - tr(Lambda Q_i), with the smoother's adjoint (lambda, Lambda) (Koopman and Shephard 1992,
Biometrika 79).  A density is multiplied by the ratio of both terms until they agree.  Zhou et al. 2019, J.
Comput. Graph. Stat. 28, use its square root, which never overshoots but is slower by half.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array, Mask, Rows
from hydro.core.compiled import copy_kernel, jit
from hydro.core.effects import sensor
from hydro.core.recording import kinematic_model as kinematics
from hydro.core.recording.filling import filled
from hydro.core.recording.kinematic_model import (
    CHANNELS,
    ERRORS,
    QUATERNION,
    SPEED,
    STATES,
    Model,
)
from hydro.core.threads import spread
from hydro.core.vehicle.frames import euler_from_quaternion, quaternion_from_euler, wrapped

PRIOR = np.repeat([30.0, 1.0, 5.0, 2.0, 3.0, 5.0, 10.0, 30.0], 3)
"""Prior standard deviation of the first position [m], attitude, velocity, rates and two derivatives.

The mean is interpolated between samples, without acceleration.  The values are wide for a vehicle in water,
but narrow enough to keep rounding errors out of the posterior.
"""
BIASES = np.repeat([0.005, 0.005], 3)
"""Prior standard deviation of the bias of a DVL and of a gyroscope [m/s, rad/s].

DVL makers specify 1 to 5 mm/s in addition to a scale error.  A MEMS gyroscope has 0.1 to 1 degree/s between
power cycles, less if an attitude filter removes it.
"""
PRIOR_VARIANCE = np.concatenate([PRIOR, BIASES]) ** 2
BLOCK = 128
"""Rows whose covariances are stored at once; others are recomputed in the backward pass."""
WINDOW, WINDOWS = 768, 2  # rows and number of the windows used to estimate the densities
ROUNDS = 12  # maximum rounds of the search for densities
SETTLED = 0.05  # relative change at which the search ends
FASTEST = 30.0  # maximum factor of a density in a round
SLOW, QUICK = 1e-10, 1e8
"""Bounds of a density [SI]."""
FIRST = np.array([[1e-4, 10.0]] * 3 + [[1e-4, 1.0]] * 3)
"""Initial densities of the search: a smooth motion."""
ASTRAY, ENOUGH = 5.0, 5
"""Median deviation of a channel's samples from the smoothed motion, in its noise, above which they disagree;
minimum number of samples."""
FASTEST_TURN = 0.5
"""Maximum plausible rotation of a vehicle between rows [rad]."""
ROUGH = (3.0, 0.0)
"""Density of an axis without data: an acceleration that changes by 1 m/s^2 in a third of a second."""
OUT = STATES + 18 + 36


@dataclass(frozen=True)
class Smoothed:
    """Smoothed motion of N rows; NaN in segments without samples of an angle, or with contradictory samples.

    Attributes:
        pose: x y z phi theta psi, NED, (N, 6) [m, rad].
        motion: (nu, nu_dot) of CO, body axes, (N, 6, 2) [m/s, rad/s; per s].
        pose_sd: Standard deviation of position, NED, and of the attitude about body axes, (N, 6).
        motion_sd: Standard deviation of (nu, nu_dot), (N, 6, 2).
        covariance: Covariance of nu_dot, (N, 6, 6).
    """

    pose: Array
    motion: Array
    pose_sd: Array
    motion_sd: Array
    covariance: Array


class Samples(NamedTuple):
    """Values of pose and velocity in n rows.

    Attributes:
        z: The values, (n, 12), angles in rad; not used where there is no sample.
        seen: Mask of the values that are samples, (n, 12).
    """

    z: Array
    seen: Mask


class _Kept(NamedTuple):
    """Data of each row of a block for the backward pass.

    Attributes:
        state: Corrected state (n, 31).
        P: Its covariance (n, 24, 30).
        H: Row of each sample (n, 12, 30).
        gain: Gain of each sample (n, 12, 30).
        residual: Residual of each sample and its variance, (n, 12, 2).
    """

    state: Array
    P: Array
    H: Array
    gain: Array
    residual: Array


@jit
def _copy(values: Array, out: Array) -> None:
    """Copy a matrix to `out`, of the same shape.

    Numba compiles the message of an assignment's possible error, which takes longer than all of this module.
    """
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = values[i, j]


@jit
def _forward(model: Model, state: Array, P: Array, samples: Samples, kept: _Kept) -> float:
    """Filter rows in place, from the prediction (state, P) of the first row to that after the last row.

    `kept` stores as many rows as it has space for.  Returns log det S + e' S^-1 e, summed over the rows.
    """
    e, H, PH, delta = np.empty(CHANNELS), np.empty((CHANNELS, ERRORS)), np.empty(ERRORS), np.empty(ERRORS)
    after, phi, R, onward = np.empty(STATES), np.eye(ERRORS), np.empty((3, 3)), np.empty((ERRORS, ERRORS))
    cost = 0.0
    for k in range(samples.z.shape[0]):
        kinematics.sensor_rows(state, samples.z[k], samples.seen[k], model, e, H)
        delta[:] = 0.0
        for i in range(CHANNELS):
            if not samples.seen[k, i]:
                continue
            s, residual = model.variance[i], e[i]
            for a in range(ERRORS):
                PH[a] = 0.0
            for b in range(ERRORS):
                if H[i, b] != 0.0:
                    for a in range(ERRORS):
                        PH[a] += P[b, a] * H[i, b]
                    residual -= H[i, b] * delta[b]
            for b in range(ERRORS):
                s += H[i, b] * PH[b]
            cost += np.log(s) + residual * residual / s
            for a in range(ERRORS):
                gain = PH[a] / s
                delta[a] += gain * residual
                for b in range(ERRORS):
                    P[a, b] -= gain * PH[b]
                if k < kept.P.shape[0]:
                    kept.gain[k, i, a] = gain
            if k < kept.P.shape[0]:
                kept.residual[k, i, 0], kept.residual[k, i, 1] = residual, s
        kinematics.corrected(state, delta, after)
        if k < kept.P.shape[0]:
            copy_kernel(after, kept.state[k])
            _copy(P, kept.P[k])
            _copy(H, kept.H[k])
        kinematics.advance(after, model.dt, state, phi, R)
        np.dot(phi, P, onward)
        np.dot(onward, phi.T, P)
        kinematics.disturb(P, model.density, R, model.dt)
        for a in range(ERRORS):
            for b in range(a):
                P[a, b] = P[b, a] = 0.5 * (P[a, b] + P[b, a])
    return cost


@jit
def _score(lam: Array, Lam: Array, R: Array, dt: float, score: Array) -> None:
    """Add lambda' Q_i lambda and tr(Lambda Q_i) of both unit noises of each axis to `score` (6, 2, 2)."""
    entry, share, times = np.empty(6, np.int64), np.empty(6), np.empty(6, np.int64)
    for axis in range(6):
        count = kinematics.driven(axis, R, entry, share, times)
        for a in range(count):
            for b in range(count):
                first, second, weight = entry[a], entry[b], share[a] * share[b]
                for order in range(2):
                    m, n = times[a] - 1 + order, times[b] - 1 + order
                    if m >= 0 and n >= 0:
                        size = weight * kinematics.integrated(dt, m, n)
                        score[axis, order, 0] += size * lam[first] * lam[second]
                        score[axis, order, 1] += size * Lam[first, second]


@jit
def _backward(
    model: Model, seen: Mask, kept: _Kept, lam: Array, Lam: Array, out: Array, score: Array
) -> None:
    """Smooth the rows of one block, from the adjoint (lam, Lam) after its last row to that of its first row.

    Row k of `out` (85) holds the state, the variances of position, attitude, nu and nu_dot, and the
    covariance (6, 6) of nu_dot.
    """
    phi, R, ahead, back = np.eye(ERRORS), np.empty((3, 3)), np.empty(STATES), np.empty((ERRORS, ERRORS))
    g, away = np.empty(ERRORS), np.empty(ERRORS)
    for k in range(seen.shape[0] - 1, -1, -1):
        state, P = kept.state[k], kept.P[k]
        kinematics.advance(state, model.dt, ahead, phi, R)
        if score.shape[0]:
            _score(lam, Lam, R, model.dt, score)
        np.dot(phi.T, lam, g)
        copy_kernel(g, lam)
        np.dot(phi.T, Lam, back)
        np.dot(back, phi, Lam)
        for a in range(ERRORS):
            for b in range(a):
                Lam[a, b] = Lam[b, a] = 0.5 * (Lam[a, b] + Lam[b, a])
        np.dot(P, lam, away)
        for a in range(ERRORS):
            away[a] = -away[a]
        kinematics.corrected(state, away, out[k, :STATES])
        after = P[:18] - P[:18] @ Lam @ P
        for i in range(18):
            out[k, STATES + i] = after[i, i]
        for i in range(6):
            for j in range(6):
                out[k, STATES + 18 + 6 * i + j] = after[12 + i, 12 + j]
        for i in range(CHANNELS - 1, -1, -1):
            if not seen[k, i]:
                continue
            gain, H = kept.gain[k, i], kept.H[k, i]
            share, size = -kept.residual[k, i, 0] / kept.residual[k, i, 1], 1.0 / kept.residual[k, i, 1]
            for a in range(ERRORS):
                g[a] = 0.0
                for b in range(ERRORS):
                    g[a] += Lam[a, b] * gain[b]
                share -= gain[a] * lam[a]
            for a in range(ERRORS):
                size += gain[a] * g[a]
            for a in range(ERRORS):
                if H[a] != 0.0:
                    lam[a] += share * H[a]
                    for b in range(ERRORS):
                        Lam[a, b] -= H[a] * g[b]
                        Lam[b, a] -= g[b] * H[a]
                    for b in range(ERRORS):
                        Lam[a, b] += size * H[a] * H[b]


@jit
def _empty(rows: int) -> _Kept:
    """Return space for `rows` rows."""
    return _Kept(
        np.empty((rows, STATES)),
        np.empty((rows, ERRORS, ERRORS)),
        np.empty((rows, CHANNELS, ERRORS)),
        np.empty((rows, CHANNELS, ERRORS)),
        np.empty((rows, CHANNELS, 2)),
    )


@jit
def _smooth(model: Model, start: Array, samples: Samples, out: Array, score: Array) -> None:
    """Smooth a segment into `out` (n, 85), from a state (31,) with the prior; `score` may be empty."""
    count = samples.z.shape[0]
    blocks = (count + BLOCK - 1) // BLOCK
    states, covariances = np.empty((blocks, STATES)), np.empty((blocks, ERRORS, ERRORS))
    state, P, none, kept = start.copy(), np.diag(model.prior), _empty(0), _empty(BLOCK)
    for n in range(blocks):
        copy_kernel(state, states[n])
        _copy(P, covariances[n])
        part = slice(n * BLOCK, min((n + 1) * BLOCK, count))
        _forward(model, state, P, Samples(samples.z[part], samples.seen[part]), none)
    lam, Lam = np.zeros(ERRORS), np.zeros((ERRORS, ERRORS))
    for n in range(blocks - 1, -1, -1):
        part = slice(n * BLOCK, min((n + 1) * BLOCK, count))
        copy_kernel(states[n], state)
        _copy(covariances[n], P)
        _forward(model, state, P, Samples(samples.z[part], samples.seen[part]), kept)
        _backward(model, samples.seen[part], kept, lam, Lam, out[part], score)


def smooth(
    samples: Array,
    bounds: Rows,
    dt: float,
    noise: Array,
    *,
    log: Array | None = None,
    density: Array | None = None,
) -> Smoothed:
    """Smooth a recording with missing samples: estimate the motion of every row by a Kalman smoother.

    Args:
        samples: Pose and velocity, NaN without a sample, (N, 12) [m, rad, m/s, rad/s]; pose in NED, velocity
            of CO over ground, body axes.
        bounds: Segments [start, stop), (S, 2).
        dt: Sample time [s].
        noise: Standard deviation of the white noise of each channel, (12,).
        log: The errors of the vehicle's DVL, (13,), see `effects.sensor`; the motion is corrected for them.
            By default none.
        density: Spectral densities of the white noise, (6, 2), see `kinematic_model.Model`; by default those
            of maximum likelihood.

    Returns:
        The motion, for every row of the segments with samples of each angle; NaN in other segments, and in
        those whose samples contradict each other.
    """
    shown = np.array([np.isfinite(samples[a:b, 3:6]).any(axis=0).all() for a, b in bounds], dtype=bool)
    known, late = _in_time(samples, bounds, dt, log)
    rows, offset = kinematics.velocity_rows(np.zeros(sensor.LOG) if log is None else log, late)
    model = Model(dt, FIRST, noise**2, PRIOR_VARIANCE, rows, offset)
    if density is None:
        density = likeliest_density(model, known, bounds[shown])
    model = model._replace(density=np.asarray(density, float))
    out = np.full((len(samples), OUT), np.nan)

    def work(segment: Rows) -> None:
        part = slice(*segment)
        _smooth(*_prepared(model, known[part]), out[part], np.empty((0, 2, 2)))
        if not _follows(model, known[part], out[part]):
            out[part] = np.nan

    spread(work, bounds[shown])
    return _unpacked(out)


def likeliest_density(model: Model, samples: Array, bounds: Rows) -> Array:
    """Return the maximum-likelihood spectral densities of the white noise of each axis, (6, 2).

    They are those of the derivatives of nu' and nu'' [m^2/s^5, rad^2/s^5; m^2/s^7, rad^2/s^7], estimated from
    at most WINDOWS windows of WINDOW rows, evenly spread.  The density is ROUGH along body axes for which
    neither the velocity nor the whole position is measured.

    Args:
        model: Parameters of the smoother; its densities are the initial values of the search.
        samples: Pose and velocity, NaN without a sample, (N, 12) [m, rad, m/s, rad/s].
        bounds: Segments [start, stop), (S, 2).
    """
    seen: Mask = np.asarray(np.isfinite(samples).any(axis=0))
    shown = np.append(seen[6:9] | seen[:3].all(), np.ones(3, bool))[:, None]
    pieces = [(at, min(at + WINDOW, stop)) for start, stop in bounds for at in range(start, stop, WINDOW)]
    chosen = sorted(set(np.linspace(0, len(pieces) - 1, WINDOWS).round().astype(int).tolist()))
    density = np.where(shown, model.density, ROUGH)
    for _ in range(ROUNDS if pieces else 0):
        score = np.zeros((6, 2, 2))
        for k in chosen:
            part = samples[slice(*pieces[k])]
            if np.isfinite(part[:, 3:6]).any(axis=0).all():
                _smooth(*_prepared(model._replace(density=density), part), np.empty((len(part), OUT)), score)
        step = np.where(shown, _step(score), 1.0)
        density = np.clip(density * step, SLOW, QUICK)
        if np.abs(np.log(step)).max() < SETTLED:
            break
    return density


def _follows(model: Model, samples: Array, out: Array) -> bool:
    """Return whether smoothed rows (n, 85) follow the samples (n, 12): the median error is within ASTRAY.

    A filter linearised far from the true motion, or contradictory sensors, cause larger deviations, which the
    standard deviations would not show.
    """
    if not np.isfinite(out).all() or np.abs(out[:, 10:13]).max() * model.dt > FASTEST_TURN:
        return False
    turned = euler_from_quaternion(out[:, QUATERNION : QUATERNION + 4])
    off = np.empty(samples.shape)
    off[:, :3] = samples[:, :3] - out[:, :3]
    off[:, 3:6] = wrapped(samples[:, 3:6] - turned)
    off[:, [3, 5]] *= np.cos(turned[:, 1:2])  # near the vertical, roll and yaw are large for small turns
    off[:, 6:] = samples[:, 6:] - model.offset - out[:, 7:STATES] @ model.log[:, SPEED:].T
    size = np.abs(off) / np.sqrt(model.variance)
    seen = np.isfinite(size)
    return all(np.median(size[rows, i]) <= ASTRAY for i, rows in enumerate(seen.T) if rows.sum() >= ENOUGH)


def _step(score: Array) -> Array:
    """Return the factor of each density (6, 2) from the sums (6, 2, 2) of `_score`.

    A density without information is unchanged.  A filter that diverged, with a negative or infinite sum,
    followed too closely, so its density is reduced.
    """
    there, expected = score[..., 0], score[..., 1]
    with np.errstate(all="ignore"):
        ratio = there / expected
    sane = np.isfinite(ratio) & (ratio >= 0.0)
    ratio = np.where(sane, ratio, np.where((there == 0.0) & (expected == 0.0), 1.0, 0.0))
    return np.asarray(np.clip(ratio, 1.0 / FASTEST, FASTEST))


def _prepared(model: Model, samples: Array) -> tuple[Model, Array, Samples]:
    """Return the model with the observable biases of a segment, its first state, and its samples."""
    seen = np.isfinite(samples)
    counts = seen.sum(axis=0) > 1
    prior = model.prior.copy()
    prior[kinematics.SPEED_BIAS :] = BIASES**2 * counts[6:]
    prior[kinematics.SPEED_BIAS : kinematics.RATE_BIAS] *= counts[:3].all()
    prior[kinematics.RATE_BIAS :] *= counts[3:6].all()
    first = filled(samples, np.array([[0, len(samples)]]), model.dt)[0]
    start = np.zeros(STATES)
    start[:3], start[QUATERNION : QUATERNION + 4] = first[:3], quaternion_from_euler(*first[3:6])
    start[QUATERNION + 4 : QUATERNION + 10] = first[6:]
    return (
        model._replace(prior=prior),
        start,
        Samples(*map(np.ascontiguousarray, (np.where(seen, samples, 0.0), seen))),
    )


def _in_time(samples: Array, bounds: Rows, dt: float, log: Array | None) -> tuple[Array, float]:
    """Return the samples of a late DVL moved by whole rows to their times, and the remaining delay [s]."""
    rows = 0 if log is None else round(log[sensor.DELAY] / dt)
    late = 0.0 if log is None else float(log[sensor.DELAY] - rows * dt)
    if not rows:
        return samples, late
    moved = samples.copy()
    for start, stop in bounds:
        moved[start:stop, 6:9] = np.nan
        moved[start : max(stop - rows, start), 6:9] = samples[start + rows : stop, 6:9]
    return moved, late


def _unpacked(out: Array) -> Smoothed:
    """Return the rows (N, 85) of `_smooth` by name."""
    pose, motion = np.full((len(out), 6), np.nan), np.empty((len(out), 6, 2))
    there = np.isfinite(out[:, 0])
    pose[:, :3] = out[:, :3]
    pose[there, 3:] = euler_from_quaternion(out[there, QUATERNION : QUATERNION + 4])
    motion[:, :, 0], motion[:, :, 1] = out[:, 7:13], out[:, 13:19]
    left = out[:, STATES : STATES + 18]
    spread = np.sqrt(np.where(left > 0.0, left, np.nan))
    return Smoothed(
        pose=pose,
        motion=motion,
        pose_sd=spread[:, :6],
        motion_sd=np.stack([spread[:, 6:12], spread[:, 12:]], axis=2),
        covariance=out[:, STATES + 18 :].reshape(-1, 6, 6),
    )
