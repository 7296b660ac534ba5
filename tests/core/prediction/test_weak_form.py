"""The weak form: its test function, and the weights of its equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from recordings import damped, moved

from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.weak_form import EQUATIONS, WINDOW_SECONDS, Windows
from hydro.core.recording.arrays import recording


@pytest.fixture(scope="module")
def windows() -> Windows:
    return Windows.of(recording(damped(), moved(damped(), rows=600)), sigma=np.full(12, 0.01))


def left(rms, windows: int = 5) -> Normal:
    """A problem whose whitened residuals have these root mean squares, channel by channel."""
    channels = np.tile(np.square(rms), (windows, 1))
    return Normal(np.zeros((windows, 1, 1)), EQUATIONS, channels, np.zeros((windows, 0, 1)))


def test_the_slope_is_that_of_the_test_function_which_vanishes_at_both_ends(windows):
    dt = windows.record.dt
    t = np.arange(windows.test.size) * dt
    assert t[-1] == pytest.approx(WINDOW_SECONDS)
    s = 2.0 * t / t[-1] - 1.0
    np.testing.assert_allclose(windows.test, (1.0 - s**2) ** 3 * dt, atol=1e-15)
    np.testing.assert_allclose(windows.slope, np.gradient(windows.test, dt, edge_order=2), atol=2e-4)


def test_a_missing_force_shows_in_the_balances_and_not_in_the_kinematics(windows):
    true, buoyant = (
        np.sqrt((windows.residuals(vehicle) ** 2).mean(axis=0))
        for vehicle in (damped(), damped({"name": "net_buoyancy", "dB": 30.0}))
    )
    assert true.max() < 1.5
    assert buoyant[2] > 50.0 * true[2]
    np.testing.assert_allclose(buoyant[6:], true[6:])


def test_residuals_of_the_size_expected_keep_their_weights(windows):
    kept, changed = windows.reweighted(left(np.full(9, 1.14)))
    assert kept is windows
    assert not changed


@pytest.mark.parametrize(
    "rms", [(1.0, 1.0, 1.0, 1.16, *[1.0] * 5), (0.5, 1.0, 1.2, 1.0, 3.0, 1.0, 1.0, 1.0, 1.1)]
)
def test_a_channel_that_leaves_more_than_expected_loses_weight_and_no_other_does(windows, rms):
    lighter, changed = windows.reweighted(left(rms))
    assert changed
    expected = np.diag(windows.whitener) / np.maximum(rms, 1.0)
    np.testing.assert_allclose(lighter.whitener, np.diag(expected))


def test_windows_that_show_half_of_an_equation_count_half_in_its_weight(windows):
    """Weights are known squared: 4 of 5 windows with weight 0 leave one whose residual counts alone."""
    known = np.zeros((5, 9))
    known[0] = 1.0
    lighter, changed = replace(windows, known=known).reweighted(left(np.full(9, 2.0)))
    assert changed
    np.testing.assert_allclose(lighter.whitener, windows.whitener / (2.0 * np.sqrt(5.0)))


def test_the_noise_of_neighbouring_windows_has_the_stated_autocovariance(windows):
    rng, lags = np.random.default_rng(0), 2
    noise = rng.standard_normal((len(windows.rows), 6)) * windows.sigma[:6]
    # Draw many series over the same windows: their sums have the covariance that the formula gives.
    series = [windows.changes(rng.permutation(noise)) for _ in range(400)]
    expected = windows.noise(lags)
    scale = expected[0]
    for lag in range(lags + 1):
        found = np.mean([(one[: len(one) - lag] * one[lag:]).mean(axis=0) for one in series], axis=0)
        np.testing.assert_allclose(found / scale, expected[lag] / scale, atol=0.15)
