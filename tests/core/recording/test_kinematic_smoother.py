"""The smoother of samples against filterpy, dense least squares, and flights whose motion is known."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import DT, tumbling
from scipy.spatial.transform import Rotation

from hydro.core.effects import sensor
from hydro.core.recording.kinematic_smoother import smooth
from hydro.core.vehicle.frames import euler_rate_matrix, rotation

NOISE = np.repeat([0.02, 0.001, 0.01, 0.002], 3)
POSITIONS, ANGLES, SPEEDS, RATES = slice(3), slice(3, 6), slice(6, 9), slice(9, 12)
DENSITY = np.tile([0.3, 2.0], (6, 1))
DRIVEN = np.array([[0.02, 0.05]] * 3 + [[0.0002, 0.0005]] * 3)


def integrated(order: int, dt: float) -> np.ndarray:
    """Covariance (3, 3) of (nu, nu', nu'') after dt of unit white noise in the derivative of nu' or nu''."""
    Q, top = np.zeros((3, 3)), 2 + order  # entries below `top` are driven
    for i in range(top):
        for j in range(top):
            m, n = top - 1 - i, top - 1 - j
            Q[i, j] = dt ** (m + n + 1) / ((m + n + 1) * factorial(m) * factorial(n))
    return Q


@pytest.fixture(scope="module")
def straight() -> tuple[np.ndarray, np.ndarray]:
    """A body that never turns, driven as the model says; its surge is measured in one row of five."""
    rng, rows, dt = np.random.default_rng(4), 300, 0.1
    F = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])
    L = np.linalg.cholesky(0.3 * integrated(0, dt) + 2.0 * integrated(1, dt) + 1e-15 * np.eye(3))
    state, truth = np.array([0.5, 0.2, 0.0]), np.zeros((rows, 3))
    for k in range(rows):
        truth[k], state = state, F @ state + L @ rng.normal(size=3)
    samples = np.full((rows, 12), np.nan)
    samples[:, ANGLES] = samples[:, RATES] = 0.0
    samples[::5, 6] = truth[::5, 0] + 0.05 * rng.normal(size=rows // 5)
    samples[:, 7:9] = 0.0
    return truth, samples


def test_straight_motion_is_smoothed_as_filterpy_does(straight):
    """States and variances of one axis; the first acceleration's prior is all but forgotten."""
    truth, samples = straight
    sigma = np.repeat([1.0, 1e-4, 0.05, 1e-4], 3)
    found = smooth(samples, np.array([[0, 300]]), 0.1, sigma, density=DENSITY)
    axis = KalmanFilter(dim_x=3, dim_z=1)
    axis.x, axis.P = np.array([[samples[0, 6]], [0.0], [0.0]]), np.diag([25.0, 9.0, 100.0])
    axis.F = np.array([[1, 0.1, 0.005], [0, 1, 0.1], [0, 0, 1]])
    axis.H, axis.R = np.array([[1.0, 0.0, 0.0]]), np.eye(1) * 0.05**2
    axis.Q = 0.3 * integrated(0, 0.1) + 2.0 * integrated(1, 0.1)
    means, covariances = [], []
    for k in range(300):
        if k:
            axis.predict()
        axis.update(samples[k, 6] if np.isfinite(samples[k, 6]) else None)
        means.append(axis.x.copy())
        covariances.append(axis.P.copy())
    expected, spread, *_ = axis.rts_smoother(np.array(means), np.array(covariances))
    np.testing.assert_allclose(found.motion[:, 0, 0], expected[:, 0, 0], atol=1e-6)
    np.testing.assert_allclose(found.motion[:, 0, 1], expected[:, 1, 0], atol=1e-5)
    np.testing.assert_allclose(found.motion_sd[:, 0], np.sqrt(spread[:, [0, 1], [0, 1]]), rtol=1e-4)
    score = (found.motion[:, 0, 0] - truth[:, 0]) / found.motion_sd[:, 0, 0]
    assert np.mean(score**2) == pytest.approx(1.0, abs=0.5)


def test_position_alone_is_the_dense_least_squares_estimate():
    """Gauss-Markov: all rows of one axis at once, from their joint covariance."""
    rng, rows, dt = np.random.default_rng(1), 40, 0.05
    F = np.array([[1, dt, dt**2 / 2, dt**3 / 6], [0, 1, dt, dt**2 / 2], [0, 0, 1, dt], [0, 0, 0, 1.0]])
    Q = np.zeros((4, 4))
    for top, density in ((3, 0.3), (4, 2.0)):
        for i in range(top):
            for j in range(top):
                m, n = top - 1 - i, top - 1 - j
                Q[i, j] += density * dt ** (m + n + 1) / ((m + n + 1) * factorial(m) * factorial(n))
    C = np.zeros((rows, rows, 4, 4))
    C[0, 0] = np.diag([30.0, 5.0, 3.0, 10.0]) ** 2
    for k in range(1, rows):
        C[k, k] = F @ C[k - 1, k - 1] @ F.T + Q
    for i in range(rows):
        for j in range(i + 1, rows):
            C[j, i] = F @ C[j - 1, i]
            C[i, j] = C[j, i].T
    samples = np.full((rows, 12), np.nan)
    samples[:, ANGLES], samples[:, 1:3] = 0.0, 0.0
    samples[::2, 0] = np.sin(np.arange(0, rows, 2) * dt) + 0.01 * rng.normal(size=rows // 2)
    sigma = np.repeat([0.01, 1e-4, 1.0, 1.0], 3)
    found = smooth(samples, np.array([[0, rows]]), dt, sigma, density=DENSITY)
    seen = np.arange(0, rows, 2)
    G = C[:, seen][:, :, :, 0].transpose(0, 2, 1).reshape(rows * 4, -1)
    S = C[np.ix_(seen, seen)][:, :, 0, 0] + 0.01**2 * np.eye(len(seen))
    gain = np.linalg.solve(S, G.T).T
    left = np.array(
        [np.diag(C[k, k] - gain[4 * k : 4 * k + 4] @ G[4 * k : 4 * k + 4].T) for k in range(rows)]
    )
    np.testing.assert_allclose(found.motion_sd[:, 0], np.sqrt(left[:, 1:3]), rtol=1e-3)
    expected = (gain @ samples[seen, 0]).reshape(rows, 4)
    np.testing.assert_allclose(found.motion[:, 0], expected[:, 1:3], atol=2e-3)


@pytest.fixture(scope="module")
def flight() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a body that turns over and over: samples of all channels with noise, velocity, and acceleration."""
    t, x, R, v, omega = (part[:2000] for part in tumbling())
    rng, nu = np.random.default_rng(2), np.hstack([v, omega])
    noise = rng.normal(size=(len(t), 12)) * NOISE
    turned = Rotation.from_matrix(R) * Rotation.from_rotvec(noise[:, ANGLES])
    angles = turned.as_euler("ZYX")[:, ::-1]
    samples = np.hstack([x + noise[:, POSITIONS], angles, nu + noise[:, 6:]])
    return samples, nu, np.gradient(nu, DT, axis=0)


def thinned(samples: np.ndarray, **every: int) -> np.ndarray:
    """With a channel group in one of so many rows only; in none where it is 0."""
    out = samples.copy()
    groups = {"xy": slice(2), "position": POSITIONS, "attitude": ANGLES, "speeds": SPEEDS, "rates": RATES}
    for name, n in every.items():
        rows = np.arange(len(out)) % n != n // 2 if n else slice(None)
        out[rows, groups[name]] = np.nan
    return out


def whole(samples: np.ndarray) -> np.ndarray:
    return np.array([[0, len(samples)]])


@pytest.mark.parametrize(
    "sensors",
    [
        {"speeds": 10, "attitude": 5},
        {"speeds": 0, "rates": 0},
        {"xy": 0, "speeds": 10},
        {"xy": 0, "speeds": 10, "attitude": 5, "rates": 0},
        {},
    ],
    ids=["slow velocity and attitude", "motion capture", "DVL, AHRS, depth", "no gyroscope", "everything"],
)
def test_intervals_hold_the_truth(flight, sensors):
    """95 % intervals of velocity and acceleration, densities found from the same samples."""
    samples, nu, dot = flight
    found = smooth(thinned(samples, **sensors), whole(samples), DT, NOISE)
    score = (np.stack([nu, dot], axis=2) - found.motion)[5:-5] / found.motion_sd[5:-5]
    held = (np.abs(score) < 1.96).mean(axis=0)
    assert (held > 0.88).all()
    speed, acceleration = held.mean(axis=0)
    assert 0.9 < speed < 0.99
    assert acceleration > 0.9  # or more: sines are smoother than what white noise drives
    square = (score**2).mean(axis=(0, 1))
    assert (square > 0.1).all()
    assert (square < 1.3).all()


def driven(seed: int, rows: int = 500) -> tuple[np.ndarray, np.ndarray]:
    """Pose and velocity, and acceleration, of a body that white noise drives as the model says."""
    rng, fine = np.random.default_rng(seed), DT / 10
    F = np.array([[1, fine, fine**2 / 2], [0, 1, fine], [0, 0, 1]])
    L = np.linalg.cholesky(0.02 * integrated(0, fine) + 0.05 * integrated(1, fine) + 1e-18 * np.eye(3))
    size = np.repeat([1.0, 0.1], 3)[:, None]
    state, R, x = np.zeros((6, 3)), Rotation.identity(), np.zeros(3)
    samples, dot = np.zeros((rows, 12)), np.zeros((rows, 6))
    for k in range(10 * rows):
        if k % 10 == 0:
            samples[k // 10] = [*x, *R.as_euler("ZYX")[::-1], *state[:, 0]]
            dot[k // 10] = state[:, 1]
        ahead = state @ F.T + (rng.normal(size=(6, 3)) @ L.T) * size
        mean = 0.5 * (state + ahead)[:, 0]
        half = R * Rotation.from_rotvec(0.5 * fine * mean[3:])
        x, R, state = (
            x + fine * half.apply(mean[:3]),
            half * Rotation.from_rotvec(0.5 * fine * mean[3:]),
            ahead,
        )
    return samples, dot


def test_intervals_of_what_white_noise_drives_are_exact():
    """Normalised squared errors of velocity and acceleration are 1, in three dimensions."""
    held, squares = [], []
    for seed in range(3):
        samples, dot = driven(seed)
        rng = np.random.default_rng(seed + 9)
        logged = thinned(samples + rng.normal(size=samples.shape) * NOISE, position=5, speeds=10, rates=3)
        found = smooth(logged, whole(logged), DT, NOISE, density=DRIVEN)
        score = (np.stack([samples[:, 6:], dot], axis=2) - found.motion) / found.motion_sd
        held.append((np.abs(score) < 1.96).mean(axis=(0, 1)))
        squares.append((score**2).mean(axis=(0, 1)))
    assert np.mean(held, axis=0) == pytest.approx([0.95, 0.95], abs=0.04)
    assert np.mean(squares, axis=0) == pytest.approx([1.0, 1.0], abs=0.3)


@given(st.floats(-3.0, 3.0))
@settings(max_examples=5, deadline=None)
def test_turning_the_world_about_its_vertical_changes_nothing_fixed_to_the_body(angle):
    _, x, R, v, omega = (part[300:500] for part in tumbling())
    turn = Rotation.from_euler("z", angle).as_matrix()
    made = []
    for Z in (np.eye(3), turn):
        angles = Rotation.from_matrix(Z @ R).as_euler("ZYX")[:, ::-1]
        samples = thinned(np.hstack([x @ Z.T, angles, v, omega]), position=3, attitude=2, speeds=7)
        made.append(smooth(samples, whole(samples), DT, NOISE, density=DENSITY))
    one, other = made
    np.testing.assert_allclose(other.motion, one.motion, atol=1e-7)
    np.testing.assert_allclose(other.motion_sd, one.motion_sd, rtol=1e-5)
    np.testing.assert_allclose(other.pose[:, :3], one.pose[:, :3] @ turn.T, atol=1e-6)


def test_errors_of_the_velocity_log_are_undone(flight):
    """Scale, mounting, lever, bias and a delay of two and a half rows."""
    samples, nu, dot = flight
    log = np.zeros(sensor.LOG)
    log[sensor.SCALE], log[sensor.ANGLES], log[sensor.DELAY] = 0.05, (0.1, -0.05, 0.2), 0.05
    log[sensor.LEVER], log[sensor.BIAS] = (0.4, -0.2, 0.3), (0.02, 0.0, -0.03)
    logged = samples.copy()
    logged[:, 6:] = sensor.measured(log, np.arange(len(nu)) * DT, nu) + (samples[:, 6:] - nu)
    logged = thinned(logged, xy=0, speeds=5)
    known, ignored = (smooth(logged, whole(logged), DT, NOISE, log=one) for one in (log, None))
    error, wrong = ((one.motion - np.stack([nu, dot], axis=2))[10:-10] for one in (known, ignored))
    assert (np.abs(error / known.motion_sd[10:-10]) < 1.96).mean() > 0.9
    assert np.sqrt((wrong[:, :3, 0] ** 2).mean()) > 5.0 * np.sqrt((error[:, :3, 0] ** 2).mean())


def test_biases_that_the_pose_shows_are_taken_off(flight):
    samples, nu, _ = flight
    biased = samples.copy()
    biased[:, 6:] += [0.008, -0.006, 0.004, 0.006, -0.004, 0.008]
    found = smooth(biased, whole(biased), DT, NOISE)
    assert (
        np.abs((found.motion[:, :, 0] - nu).mean(axis=0)) < 0.15 * np.abs((biased[:, 6:] - nu).mean(axis=0))
    ).all()


def test_angles_may_be_measured_one_by_one():
    """Roll and pitch in each row, heading in one of five, no gyroscope: a slow turn with some swaying."""
    t = np.arange(0.0, 30.0, 0.05)
    angles = np.stack([0.2 * np.sin(t), 0.15 * np.cos(0.7 * t), 3.0 + 0.2 * t], axis=1)
    slope = np.stack([0.2 * np.cos(t), -0.105 * np.sin(0.7 * t), 0.2 + 0 * t], axis=1)
    omega = np.linalg.solve(euler_rate_matrix(angles[:, 0], angles[:, 1]), slope[:, :, None])[:, :, 0]
    rng, samples = np.random.default_rng(0), np.full((len(t), 12), np.nan)
    samples[:, ANGLES] = np.angle(np.exp(1j * (angles + 0.002 * rng.normal(size=angles.shape))))
    samples[np.arange(len(t)) % 5 != 2, 5] = np.nan
    samples[:, SPEEDS] = [0.5, 0.0, 0.0]
    found = smooth(samples, whole(samples), 0.05, np.repeat([0.02, 0.002, 0.01, 0.002], 3))
    error = found.motion[20:-20, 3:, 0] - omega[20:-20]
    assert (np.abs(error / found.motion_sd[20:-20, 3:, 0]) < 1.96).mean() > 0.9
    turned = np.einsum("kji,kjl->kil", rotation(*angles.T), rotation(*found.pose[:, ANGLES].T))
    assert np.abs(Rotation.from_matrix(turned).magnitude()).max() < 0.03


def test_samples_that_contradict_each_other_leave_nothing(flight):
    """Velocity to port for velocity to starboard: the position says otherwise, and no value is given."""
    wrong = flight[0].copy()
    wrong[:, 6:8] *= -1.0
    assert np.isnan(smooth(wrong, whole(wrong), DT, NOISE).motion).all()


def test_what_nothing_measures_is_not_known(flight):
    """Depth and attitude alone: no standard deviation of a speed is small, and each holds its error."""
    samples, nu, _ = flight
    blind = thinned(samples, xy=0, speeds=0)
    found = smooth(blind, whole(blind), DT, NOISE)
    assert (np.median(found.motion_sd[:, :3, 0], axis=0) > 0.1).all()
    assert (np.abs(found.motion[:, :3, 0] - nu[:, :3]) < 3.0 * found.motion_sd[:, :3, 0]).mean() > 0.95


def test_a_segment_without_a_heading_has_no_motion(flight):
    samples = flight[0][:200].copy()
    samples[100:, 5] = np.nan
    found = smooth(samples, np.array([[0, 100], [100, 200]]), DT, NOISE, density=DENSITY)
    alone = smooth(samples[:100], whole(samples[:100]), DT, NOISE, density=DENSITY)
    np.testing.assert_array_equal(found.motion[:100], alone.motion)
    assert np.isnan(found.motion[100:]).all()
    assert np.isnan(found.motion_sd[100:]).all()
