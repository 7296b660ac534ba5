"""Filter and limits of a residual network's output (conditioning)."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import synthetic
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.signal import lfilter

from hydro.core.errors import DataError
from hydro.core.vehicle.frames import FRD_FLU
from hydro.sim.residual.conditioning import (
    COUNTS,
    OFF,
    PRESETS,
    Conditioning,
    condition,
    condition_kernel,
    counts_of,
    preset,
)

WRENCHES = arrays(np.float64, (30, 6), elements=st.floats(-500, 500))
VELOCITIES = arrays(np.float64, (30, 6), elements=st.floats(-2, 2))
PAPER = preset("paper", synthetic.vehicle())


@given(WRENCHES, VELOCITIES)
def test_off_changes_nothing(wrenches, nu):
    out, counts = condition(wrenches, nu, OFF)
    np.testing.assert_array_equal(out, wrenches)
    assert counts == (30, (0,) * 6, 0)


@given(WRENCHES, st.floats(0.0, 0.99), st.sampled_from(["old", "new"]))
def test_low_pass_is_scipys_one_pole_filter(wrenches, beta, weighs):
    keep = beta if weighs == "old" else 1 - beta
    if keep == 1.0:
        return
    out, _ = condition(wrenches, np.zeros((30, 6)), Conditioning(beta=beta, weighs=weighs))
    np.testing.assert_allclose(out, lfilter([1 - keep], [1, -keep], wrenches, axis=0), atol=1e-9)


def test_the_two_readings_of_beta():
    step, nu = np.ones((50, 6)), np.ones((50, 6))
    old, new = (condition(step, nu, Conditioning(beta=0.9, weighs=w))[0][:, 0] for w in ("old", "new"))
    np.testing.assert_allclose(old[:2], [0.1, 0.19])
    np.testing.assert_allclose(new[:2], [0.9, 0.99])
    assert np.interp(1 - math.exp(-1), old, 0.04 * np.arange(1, 51)) == pytest.approx(0.38, abs=0.005)


@given(WRENCHES, arrays(np.float64, 6, elements=st.floats(1, 400)))
def test_clipping(wrenches, limits):
    out, counts = condition(wrenches, np.ones((30, 6)), Conditioning(limits=tuple(limits)))
    np.testing.assert_array_equal(out, np.clip(wrenches, -limits, limits))
    assert list(counts.clipped) == (np.abs(wrenches) > limits).sum(axis=0).tolist()


def test_clipping_does_not_wind_up_the_filter():
    """The filter state is not clipped, so within the limits the output is the low-pass again."""
    wrenches = np.concatenate([np.full((40, 6), 100.0), np.full((40, 6), 1.0)])
    low_pass, clipped = Conditioning(beta=0.5), Conditioning(beta=0.5, limits=(10.0,) * 6)
    free, out = (condition(wrenches, np.ones((80, 6)), c)[0] for c in (low_pass, clipped))
    np.testing.assert_array_equal(out, np.minimum(free, 10.0))


@given(arrays(np.float64, (30, 6), elements=st.floats(-0.05, 0.05)))
def test_dead_band_scales_the_whole_wrench(nu):
    both = Conditioning(linear_deadband=0.02, angular_deadband=0.04)
    out, counts = condition(np.full((30, 6), 7.0), nu, both)
    s = np.minimum(1, np.linalg.norm(nu / [0.02, 0.02, 0.02, 0.04, 0.04, 0.04], axis=1))
    np.testing.assert_allclose(out, np.repeat(7.0 * (3 * s**2 - 2 * s**3)[:, None], 6, axis=1), atol=1e-9)
    assert counts.held_back == (s < 1).sum()


def test_dead_band_is_smooth_and_whole_beyond():
    speed = np.linspace(0, 0.04, 4001)
    nu = np.zeros((4001, 6))
    nu[:, 1] = speed
    out = condition(np.ones((4001, 6)), nu, Conditioning(linear_deadband=0.02, angular_deadband=0.02))[0][
        :, 0
    ]
    slope = np.gradient(out, speed)
    assert out[0] == 0.0
    assert (out[speed >= 0.02] == 1.0).all()
    assert np.abs(np.diff(slope)).max() < 0.01 * np.abs(slope).max()
    assert slope[1] < 2
    assert slope[1995] < 2


@given(WRENCHES, VELOCITIES)
def test_same_in_both_frames(wrenches, nu):
    there, _ = condition(wrenches, nu, PAPER)
    mirrored, _ = condition(wrenches * FRD_FLU, nu * FRD_FLU, PAPER)
    np.testing.assert_array_equal(mirrored, there * FRD_FLU)


@given(WRENCHES, VELOCITIES)
def test_kernel_step_by_step(wrenches, nu):
    expected, counts = condition(wrenches, nu, PAPER)
    state, numbers, out = np.zeros(6), np.zeros(COUNTS), np.empty(6)
    for k in range(30):
        condition_kernel(wrenches[k], nu[k], PAPER.parameters(), state, numbers, out)
        np.testing.assert_array_equal(out, expected[k])
    assert counts_of(numbers) == counts


def test_presets():
    vehicle = synthetic.vehicle()
    assert preset("off", vehicle) == OFF
    assert preset("paper-old", vehicle).keep == pytest.approx(0.9)
    assert preset("paper-new", vehicle).keep == pytest.approx(0.1)
    assert preset("paper", vehicle) == preset("paper-new", vehicle)
    assert PAPER.limits[0] == pytest.approx(2 * 4 * 155 * math.sqrt(0.5))
    assert PAPER.limits[2] == pytest.approx(2 * 4 * 155)
    whole = dataclasses.asdict(PAPER)
    pieces = {
        "low-pass-new": ["beta", "weighs"],
        "clipping": ["limits"],
        "dead-band": ["linear_deadband", "angular_deadband"],
    }
    for name, fields in pieces.items():
        alone = dataclasses.asdict(preset(name, vehicle)) | {"weighs": "new"}
        bare = dataclasses.asdict(OFF) | {"weighs": "new"}
        assert alone == bare | {field: whole[field] for field in fields}, name
    assert preset("low-pass-old", vehicle).keep == pytest.approx(0.9)
    with pytest.raises(DataError, match=f"'papr' is not known; choose one of {', '.join(PRESETS)}"):
        preset("papr", vehicle)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"beta": 1.1}, "within 0 and 1"),
        ({"beta": math.nan}, "within 0 and 1"),
        ({"beta": 1.0}, "lets nothing through"),
        ({"beta": 0.0, "weighs": "new"}, "lets nothing through"),
        ({"limits": (1.0,) * 5}, "six limits above 0"),
        ({"limits": (1.0,) * 5 + (0.0,)}, "six limits above 0"),
        ({"linear_deadband": 0.1}, "two speeds above 0"),
        ({"linear_deadband": -0.1, "angular_deadband": 0.1}, "two speeds above 0"),
    ],
)
def test_bad_values(options, message):
    with pytest.raises(DataError, match=message):
        Conditioning(**options)
