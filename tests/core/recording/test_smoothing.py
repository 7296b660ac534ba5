from __future__ import annotations

import math
import time

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_discrete_are

from hydro.core.errors import DataError
from hydro.core.recording.smoothing import (
    DIFFUSE,
    RATIOS,
    Design,
    _innovations_kernel,
    _unit_design,
    acceleration_noise,
    estimate,
    filter_step,
    gains,
    reach,
    smooth,
)

DT = 0.02


def design(*ratios: float, noise: float = 0.01) -> Design:
    return Design(DT, ratios if len(ratios) == 6 else ratios * 6, (noise,) * 6)


def walk(rows: int, seed: int = 0, noise: float = 0.01) -> np.ndarray:
    """Measured velocities of a vehicle that changes its acceleration at random."""
    rng = np.random.default_rng(seed)
    acceleration = np.cumsum(rng.normal(size=(rows, 6)), axis=0) * 0.05
    return np.cumsum(acceleration, axis=0) * DT + noise * rng.normal(size=(rows, 6))


def filterpy_axis(design: Design, axis: int, first: float) -> KalmanFilter:
    """The textbook filter of one axis in SI units, started on its first measurement."""
    q, variance, ratio = design.jerk[axis], design.noise[axis] ** 2, design.ratio[axis]
    kf = KalmanFilter(dim_x=2, dim_z=1)
    kf.x = np.array([first, 0.0])
    kf.F = np.array([[1.0, design.dt], [0.0, 1.0]])
    kf.H = np.array([[1.0, 0.0]])
    kf.R = np.array([[variance]])
    kf.Q = Q_continuous_white_noise(2, design.dt, q)
    kf.P = np.diag([variance, DIFFUSE * max(1.0, ratio) * variance / design.dt**2])
    return kf


def filterpy_loop(z: np.ndarray, design: Design, *, both_ways: bool) -> np.ndarray:
    out = np.empty((*z.shape, 2))
    for i in range(6):
        kf = filterpy_axis(design, i, z[0, i])
        states, covariances = [kf.x.copy()], [kf.P.copy()]
        for k in range(1, len(z)):
            kf.predict()
            kf.update(z[k, i])
            states.append(kf.x.copy())
            covariances.append(kf.P.copy())
        xs, ps = np.array(states), np.array(covariances)
        out[:, i] = kf.rts_smoother(xs, ps)[0] if both_ways else xs
    return out


@given(st.lists(st.floats(-6, 4), min_size=6, max_size=6), st.integers(2, 120), st.integers(0, 99))
@example([-6.0, -3.0, 0.0, 2.0, 4.0, 6.0], 400, 1)
def test_equal_to_a_filterpy_loop(exponents, rows, seed):
    """To 1e-9 of the data's own size, across twelve decades of the ratio, filter and smoother."""
    z, d = walk(rows, seed), design(*(10.0**x for x in exponents))
    for method, both_ways in (("kalman", False), ("rts", True)):
        expected = filterpy_loop(z, d, both_ways=both_ways)
        found = smooth(z, [[0, rows]], d, method)
        np.testing.assert_allclose(found[:, :, 0], expected[:, :, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(found[:, :, 1] * DT, expected[:, :, 1] * DT, rtol=0, atol=1e-9)


def test_equal_to_filterpy_long_after_the_gains_have_settled():
    z, d = walk(3000), design(1e-3)
    assert len(gains(d).forward) < 500
    np.testing.assert_allclose(
        smooth(z, [[0, 3000]], d), filterpy_loop(z, d, both_ways=True), rtol=0, atol=1e-9
    )


def test_a_hundred_times_faster_than_filterpy():
    few, many, d = walk(2000), walk(200_000), design(1e-2)
    designed = gains(d)
    smooth(few, [[0, 2000]], d, "rts", designed)
    start = time.perf_counter()
    filterpy_loop(few, d, both_ways=True)
    slow = (time.perf_counter() - start) / 2000
    start = time.perf_counter()
    smooth(many, [[0, 200_000]], d, "rts", designed)
    fast = (time.perf_counter() - start) / 200_000
    assert slow > 100 * fast


@given(st.floats(-6, 6))
def test_settled_gain_solves_the_riccati_equation(exponent):
    ratio = 10.0**exponent
    F, H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    P = solve_discrete_are(F.T, H.T, Q_continuous_white_noise(2, 1.0, ratio), np.eye(1))
    expected = P[:, 0] / (P[0, 0] + 1.0) * [1.0, 1.0 / DT]
    np.testing.assert_allclose(gains(design(ratio)).forward[-1, 3], expected, rtol=1e-6)


def test_without_noise_the_smoother_is_the_natural_cubic_spline():
    t = np.arange(200) * DT
    z = np.stack([np.sin((i + 1) * t) for i in range(6)], axis=1)
    nu, dot = np.moveaxis(smooth(z, [[0, 200]], design(1e6)), 2, 0)
    spline = CubicSpline(t, z, bc_type="natural")
    np.testing.assert_allclose(nu, z, atol=1e-6)
    np.testing.assert_allclose(dot, spline(t, 1), atol=1e-4)
    np.testing.assert_allclose(
        dot[20:-20], np.stack([(i + 1) * np.cos((i + 1) * t) for i in range(6)], 1)[20:-20], atol=2e-5
    )


@given(st.floats(-8, 6), st.sampled_from(["rts", "kalman", "kalman-difference"]))
def test_constant_acceleration_is_found_exactly(exponent, method):
    """At the row's own time, whatever the gains: no method delays a ramp once it has started."""
    t, slopes = np.arange(300) * DT, np.array([1.0, -2.0, 0.5, 3.0, -1.0, 0.1])
    found = smooth(t[:, None] * slopes + 1.0, [[0, 300]], design(10.0**exponent), method)
    np.testing.assert_allclose(found[5:, :, 0], (t[:, None] * slopes + 1.0)[5:], atol=1e-4)
    np.testing.assert_allclose(found[5:, :, 1], np.broadcast_to(slopes, (295, 6)), atol=1e-3)


def test_rts_looks_both_ways_and_the_filter_only_back():
    """Reversing time turns the smoothed acceleration's sign: the smoother has no delay, the filter has."""
    z, d = walk(400), design(1e-2)
    there, back = smooth(z, [[0, 400]], d), smooth(z[::-1], [[0, 400]], d)[::-1]
    np.testing.assert_allclose(there[60:-60, :, 0], back[60:-60, :, 0], atol=1e-5)
    np.testing.assert_allclose(there[60:-60, :, 1], -back[60:-60, :, 1], atol=1e-4)
    changed = z.copy()
    changed[300:] += 1.0
    for method in ("kalman", "kalman-difference"):
        before, after = smooth(z, [[0, 400]], d, method), smooth(changed, [[0, 400]], d, method)
        np.testing.assert_array_equal(before[:299], after[:299])


def test_difference_is_of_the_filtered_velocity():
    z, d = walk(50), design(0.1)
    nu = smooth(z, [[0, 50]], d, "kalman")[:, :, 0]
    found = smooth(z, [[0, 50]], d, "kalman-difference")
    np.testing.assert_array_equal(found[:, :, 0], nu)
    np.testing.assert_allclose(found[:, :, 1], np.gradient(nu, DT, axis=0), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("method", ["rts", "kalman", "kalman-difference"])
def test_segments_start_afresh(method):
    z, d = walk(300), design(1e-3)
    together = smooth(z, [[0, 100], [100, 300]], d, method)
    np.testing.assert_array_equal(together[:100], smooth(z[:100], [[0, 100]], d, method))
    np.testing.assert_array_equal(together[100:], smooth(z[100:], [[0, 200]], d, method))


def test_online_steps_are_the_offline_filter():
    z, d = walk(2000), design(1e-2)
    offline = smooth(z, [[0, 2000]], d, "kalman")
    state, gain = offline[999].copy(), gains(d).forward
    for k in range(1000, 2000):
        filter_step(k, state, z[k], gain, DT)
    np.testing.assert_allclose(state, offline[-1], rtol=0, atol=1e-12)


@given(st.floats(-6, 6))
def test_reach_is_where_the_weights_end(exponent):
    d = design(10.0**exponent)
    rows = reach(d)
    z = np.zeros((4001, 6))
    z[2000] = 1.0
    weights = np.abs(smooth(z, [[0, 4001]], d)) / np.abs(smooth(z, [[0, 4001]], d)).max(axis=0)
    assert weights[: 2000 - rows].max() <= 1e-3
    assert weights[2000 - rows : 2001 - rows].max() > 1e-3 or weights[2000 + rows].max() > 1e-3


def test_reach_of_the_spline_and_of_the_slowest_axis():
    assert reach(design(1e6)) == math.floor(math.log(1e-3) / math.log(2 - math.sqrt(3))) + 1
    assert reach(design(1e6, 1e6, 1e6, 1e6, 1e6, 1e-4)) == reach(design(1e-4))


@pytest.mark.parametrize("ratio", [1e-4, 1e-2, 1.0])
def test_noise_of_the_acceleration_is_that_of_smoothed_noise(ratio):
    design = Design(0.02, (ratio,) * 6, (0.05, 0.05, 0.05, 0.01, 0.01, 0.01))
    white = np.random.default_rng(0).normal(size=(40_000, 6)) * design.noise
    left = smooth(white, [[0, len(white)]], design)[500:-500, :, 1].std(axis=0)
    np.testing.assert_allclose(acceleration_noise(design), left, rtol=0.05)


def test_same_jerk_at_another_rate():
    d = design(0.3)
    slower = d.at(2 * DT)
    assert slower.jerk == pytest.approx(d.jerk)
    assert slower.ratio == pytest.approx((2.4,) * 6)


@pytest.mark.parametrize("ratio", [1e-4, 1e-2, 1.0])
def test_likelihood_is_filterpys(ratio):
    z, out = walk(40, 3), np.empty((6, 3))
    d = design(ratio, noise=1.0)
    _innovations_kernel(z, np.array([[0, 40]]), _unit_design(ratio, 40), out)
    for i in range(6):
        kf, total = filterpy_axis(d, i, z[0, i]), 0.0
        for k in range(1, 40):
            kf.predict()
            kf.update(z[k, i])
            total += kf.log_likelihood if k >= 2 else 0.0
        mine = -0.5 * (out[i, 0] + out[i, 1] + out[i, 2] * math.log(2 * math.pi))
        assert mine == pytest.approx(total, rel=1e-8)


@pytest.mark.parametrize("sigma", [0.002, 0.05])
def test_estimate_finds_noise_and_jerk(sigma):
    """Data drawn from the model itself: the noise to 5 %, the ratio to about a step of its grid."""
    rng, rows, q = np.random.default_rng(4), 20_000, 0.2
    L = np.linalg.cholesky(Q_continuous_white_noise(2, DT, q))
    state, z = np.zeros((2, 6)), np.empty((rows, 6))
    F = np.array([[1.0, DT], [0.0, 1.0]])
    for k in range(rows):
        z[k] = state[0] + sigma * rng.normal(size=6)
        state = F @ state + L @ rng.normal(size=(2, 6))
    found = estimate(z, [[0, rows]], DT)
    np.testing.assert_allclose(found.noise, sigma, rtol=0.05)
    np.testing.assert_allclose(np.log10(found.jerk), math.log10(q), atol=0.35)
    told = estimate(z, [[0, rows]], DT, noise=[sigma] * 6)
    np.testing.assert_allclose(told.noise, sigma, rtol=1e-12)
    np.testing.assert_allclose(np.log10(told.jerk), math.log10(q), atol=0.25)


def test_clean_data_are_interpolated_even_when_stored_as_float32():
    t = np.arange(4000) * DT
    z = np.stack([np.sin((i + 1) * t / 2) for i in range(6)], axis=1).astype(np.float32).astype(float)
    found = estimate(z, [[0, 4000]], DT)
    nu, _ = np.moveaxis(smooth(z, [[0, 4000]], found), 2, 0)
    assert np.abs(nu - z).max() < 1e-6
    assert estimate(z, [[0, 4000]], DT, noise=[0.0] * 6).ratio == (RATIOS[-1],) * 6


def test_an_axis_that_never_moves():
    z = np.zeros((500, 6))
    found = estimate(z, [[0, 500]], DT)
    assert np.isfinite(found.noise).all()
    np.testing.assert_array_equal(smooth(z, [[0, 500]], found), 0.0)


@given(st.integers(8, 700), st.integers(1, 3))
def test_estimate_takes_short_segments(rows, count):
    z = walk(rows * count, rows)
    found = estimate(z, [[k * rows, (k + 1) * rows] for k in range(count)], DT)
    assert all(ratio in RATIOS for ratio in found.ratio)


@pytest.mark.parametrize("noise", [[0.1] * 5, [0.1] * 5 + [math.nan], [0.1] * 5 + [-1.0]])
def test_bad_noise(noise):
    with pytest.raises(DataError, match="six standard deviations of at least 0"):
        estimate(walk(100), [[0, 100]], DT, noise=noise)


def test_bad_method_and_too_few_rows():
    with pytest.raises(DataError, match="'rst' is not known; choose one of rts, kalman, kalman-difference"):
        smooth(walk(10), [[0, 10]], design(1.0), "rst")
    with pytest.raises(DataError, match="row 4 stands alone"):
        smooth(walk(10), [[0, 4], [4, 5], [5, 10]], design(1.0))
    with pytest.raises(DataError, match="no session has eight rows"):
        estimate(walk(10), [[0, 4], [4, 10]], DT)


def test_a_design_follows_more_closely_as_far_as_the_grid_goes():
    design = Design(0.02, (1e-3, 1e2, 1e6, 5e5, 1e-8, 1.0), (0.1,) * 6)
    closer = design.following(3.0)
    assert closer.ratio == pytest.approx((3e-3, 3e2, 1e6, 1e6, 3e-8, 3.0))
    assert closer.noise == design.noise
    assert reach(closer) <= reach(design)
