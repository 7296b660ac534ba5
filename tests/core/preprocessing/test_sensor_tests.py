"""Errors of the DVL from kinematics alone: motions that no dynamics made, formulas of their own."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import DT, damped, moved, tumbling
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects.sensor import LOG, corrected
from hydro.core.errors import DataError
from hydro.core.preprocessing.sensor_tests import (
    ENTRIES,
    PLAIN_SIZE,
    _mount,
    _mount_derivatives,
    _reading,
    kinematic_tests,
    shown,
    vetoed,
)
from hydro.core.recording.arrays import Recording, recording
from hydro.core.simulation.sensor_noise import PROFILES, Noise, disturb
from hydro.io import vehicle as files

ORDINARY = PROFILES["ordinary"]


def logged(noise: Noise = ORDINARY, *, seed: int = 0, **wrong) -> Recording:
    """A recording of the tumbling body: u_m = (1 + s) R(alpha)^T [v(t-d) + omega x r] + b, written anew."""
    t, x, R, v, omega = tumbling()
    at = CubicSpline(t, v + np.cross(omega, wrong.get("r", (0.0, 0.0, 0.0))))(t - wrong.get("d", 0.0))
    mount = Rotation.from_euler("ZYX", wrong.get("alpha", (0.0, 0.0, 0.0))[::-1])
    read = (1.0 + np.array(wrong.get("axes", (0.0, 0.0, 0.0)))) * mount.inv().apply(at)
    read = read + np.array(wrong.get("b", (0.0, 0.0, 0.0)))
    angles = Rotation.from_matrix(R).as_euler("ZYX")[:, ::-1]
    motion = disturb(np.hstack([x, angles, read, omega]), noise, np.random.default_rng(seed))
    table = pl.DataFrame(np.column_stack([t, motion]), schema=["t", *POSE, *VELOCITY])
    still = [pl.lit(0.0).alias(f"cmd_{i + 1}") for i in range(8)]
    return recording(synthetic.vehicle(), table.with_columns(pl.lit("a").alias("session"), *still))


FAULTS = [
    ("sensor_scale", "axes", (0.03, -0.05, 0.2)),
    ("sensor_misalignment", "alpha", (0.03, -0.05, 0.3)),
    ("sensor_delay", "d", 0.25),
    ("sensor_lever_arm", "r", (0.3, -0.1, 0.05)),
    ("sensor_bias", "b", (0.03, -0.02, 0.01)),
]


@pytest.mark.parametrize(("effect", "key", "value"), FAULTS)
@pytest.mark.parametrize("times", [1.0, 3.0])
def test_each_fault_shows_with_its_values_and_no_other_does(effect, key, value, times):
    noise = Noise(*(times * s for s in (0.01, 0.002, 0.02, 0.001)))
    tests = kinematic_tests(logged(noise, **{key: value}))
    assert {name for name, test in tests.items() if shown(test)} == {effect}
    found = tests[effect]
    assert (np.abs(found.estimate - value) < 4.0 * found.standard_error).all()
    assert found.table == {"name": effect, key: pytest.approx(value, abs=0.03)}
    truth = {"name": effect, key: value}
    assert not vetoed(found, truth)
    for name, test in tests.items():
        claim = next({"name": n, k: v} for n, k, v in FAULTS if n == name)
        assert vetoed(test, claim) == (name != effect)


def by_depth(record: Recording, missing: slice = slice(0, 2)) -> Recording:
    """Return a recording without samples of some channels, by default of north and east."""
    seen, eta = np.ones((record.rows, 12), bool), record.eta.copy()
    seen[:, missing], eta[:, :2] = False, 0.0
    return Recording(**{**vars(record), "eta": eta, "seen": seen})


@pytest.mark.parametrize(("effect", "key", "value"), [FAULTS[0], FAULTS[1], FAULTS[3]])
def test_depth_alone_shows_a_fault_on_every_axis_if_the_vehicle_tilts(effect, key, value):
    tests = kinematic_tests(by_depth(logged(**{key: value})))
    assert {name for name, test in tests.items() if shown(test)} == {effect}
    found = tests[effect]
    assert (np.abs(found.estimate - value) < 4.0 * found.standard_error).all()
    assert (found.standard_error < 0.05).all()


def test_depth_alone_shows_nothing_where_nothing_is_wrong():
    tests = kinematic_tests(by_depth(logged(seed=5)))
    assert tests
    assert not [name for name, test in tests.items() if shown(test)]
    assert kinematic_tests(by_depth(logged(seed=5), slice(0, 3))) == {}
    assert kinematic_tests(by_depth(logged(seed=5), slice(6, 7))) == {}


def test_faults_that_come_together_are_told_apart():
    tests = kinematic_tests(logged(d=0.1, alpha=(0.0, 0.0, 0.1), b=(0.0, 0.03, 0.0)))
    there = {"sensor_delay", "sensor_misalignment", "sensor_bias"}
    assert {name for name, test in tests.items() if shown(test)} == there
    assert tests["sensor_delay"].estimate == pytest.approx(0.1, abs=0.005)
    assert tests["sensor_misalignment"].estimate[2] == pytest.approx(0.1, abs=0.005)


def test_without_noise_the_values_are_exact():
    wrong = {key: value for _, key, value in FAULTS}
    found = kinematic_tests(logged(Noise(), **wrong))
    for name, key, value in FAULTS:
        np.testing.assert_allclose(found[name].estimate, value, atol=3e-4, err_msg=key)


@pytest.mark.parametrize("noise", [Noise(), *PROFILES.values()])
def test_nothing_shows_where_nothing_is_wrong(noise):
    for test in kinematic_tests(logged(noise, seed=5)).values():
        assert not shown(test)
        assert (test.visible >= test.negligible).all()


def test_what_the_pose_reads_late_is_no_late_velocity():
    assert not shown(kinematic_tests(logged(d=-0.1))["sensor_delay"])


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_promised():
    """200 recordings of ordinary to threefold noise and of the Doppler log's; each test at 1 % and 10 %."""
    levels = [Noise(*(k * s for s in (0.01, 0.002, 0.02, 0.001))) for k in (1.0, 2.0, 3.0)]
    levels.append(PROFILES["dvl"])
    p = np.array(
        [
            [test.p_value for test in kinematic_tests(logged(levels[i % 4], seed=i)).values()]
            for i in range(200)
        ]
    )
    assert (p <= 0.01).mean() <= 0.018  # 1,000 tests: 2.5 standard errors above 1 %
    assert 0.05 < (p <= 0.1).mean() < 0.13


def test_as_large_as_visible_is_nearly_always_seen():
    faint = kinematic_tests(logged())["sensor_bias"].visible
    seen = [
        shown(kinematic_tests(logged(seed=i, b=(max(2.0 * faint[0], 0.006), 0.0, 0.0)))["sensor_bias"])
        for i in range(20)
    ]
    assert np.mean(seen) > 0.8


def test_a_current_and_forces_that_no_model_has_show_nothing():
    strange = damped(
        {"name": "ocean_current", "v_N": 0.4, "v_E": -0.3},
        {"name": "thruster_gain", "g": [0.5, -0.4, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0]},
    )
    raw = moved(strange, rows=3000)
    rng = np.random.default_rng(0)
    noisy = disturb(raw.select(*POSE, *VELOCITY).to_numpy(), ORDINARY, rng)
    raw = raw.with_columns(pl.DataFrame(noisy, schema=[*POSE, *VELOCITY]))
    tests = kinematic_tests(recording(damped(), raw))
    assert not [name for name, test in tests.items() if shown(test)]
    assert vetoed(tests["sensor_bias"], {"name": "sensor_bias", "b": [0.3, 0.2, 0.0]})


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_stonefish_has_no_faults(stonefish, level):
    vehicle = files.read(stonefish / "vehicle.toml")[0]
    raw = pl.read_parquet(stonefish / "v1_current_replay90.parquet")
    noise = ORDINARY if level else Noise()
    motion = disturb(raw.select(*POSE, *VELOCITY).to_numpy(), noise, np.random.default_rng(1))
    raw = raw.with_columns(pl.DataFrame(motion, schema=[*POSE, *VELOCITY]))
    for test in kinematic_tests(recording(vehicle, raw)).values():
        assert not shown(test)
        assert (np.abs(test.estimate) < 0.01).all()


def test_a_level_vehicle_that_only_heaves_cannot_show_most_and_vetoes_nothing_of_it():
    t = np.arange(4000) * DT
    w = 0.5 * np.sin(0.7 * t)
    motion = np.zeros((4000, 12))
    motion[:, 2], motion[:, 8] = -0.5 / 0.7 * np.cos(0.7 * t), w
    logged = disturb(motion, ORDINARY, np.random.default_rng(0))
    table = pl.DataFrame(np.column_stack([t, logged]), schema=["t", *POSE, *VELOCITY])
    still = [pl.lit(0.0).alias(f"cmd_{i + 1}") for i in range(8)]
    record = recording(synthetic.vehicle(), table.with_columns(pl.lit("a").alias("session"), *still))
    tests = kinematic_tests(record)
    assert not vetoed(tests["sensor_lever_arm"], {"name": "sensor_lever_arm", "r": [0.2, 0.2, 0.0]})
    assert not vetoed(tests["sensor_scale"], {"name": "sensor_scale", "axes": [0.1, 0.1, 0.0]})
    assert vetoed(tests["sensor_scale"], {"name": "sensor_scale", "s": 0.1})
    assert tests["sensor_scale"].visible[2] < 0.01 < tests["sensor_scale"].visible[0]


def test_the_columns_are_the_derivatives_of_what_sensor_corrected_gives():
    rng = np.random.default_rng(2)
    t = np.arange(300) * DT
    nu = np.sin(t[:, None] * rng.uniform(0.5, 1.5, 6) + rng.uniform(0.0, 6.0, 6))
    log = np.array([0.1, -0.2, 0.3, 0.2, -0.1, 0.4, 0.13, 0.3, 0.2, -0.1, 0.05, -0.03, 0.02])
    velocity, columns = _reading(log, _mount(log), _mount_derivatives(log), nu, t)
    inner = slice(30, -30)
    np.testing.assert_allclose(velocity[inner], corrected(log, t, nu)[inner, :3], atol=1e-12)
    for i in range(LOG):
        shift = 1e-5 * np.eye(LOG)[i]
        slope = (corrected(log + shift, t, nu) - corrected(log - shift, t, nu))[inner, :3] / 2e-5
        np.testing.assert_allclose(columns[i][inner], slope, atol=4e-3 if i == 6 else 1e-8)


def test_a_short_recording_and_a_table_of_another_effect():
    record = logged()
    with pytest.raises(DataError, match="fewer than 8 stretches of 2 s"):
        kinematic_tests(Recording(**{**vars(record), "segments": np.array([[0, 500]])}))
    test = kinematic_tests(record)["sensor_bias"]
    with pytest.raises(DataError, match="no such parameter"):
        vetoed(test, {"name": "sensor_bias", "alpha": [0.0, 0.0, 0.0]})
    assert set(ENTRIES) == set(kinematic_tests(record))


@pytest.mark.parametrize(("every", "held"), [(5, False), (10, False), (5, True), (10, True)])
def test_a_position_that_comes_more_rarely_than_it_is_logged_shows_nothing(every, held):
    """At 10 and 5 Hz, between them interpolated or held: its error is then no white noise, and larger."""
    record = logged(seed=4)
    known = np.arange(0, record.rows, every)
    place = np.arange(record.rows) // every
    eta = record.eta.copy()
    for i in range(3):
        x = record.eta[known, i]
        eta[:, i] = x[place] if held else np.interp(record.t, record.t[known], x)
    tests = kinematic_tests(Recording(**{**vars(record), "eta": eta}))
    assert not [name for name, test in tests.items() if shown(test)]


def hardly_moving(seed: int) -> Recording:
    """Two minutes straight ahead, to and fro at some cm/s, with three seconds of other motion."""
    rng, rows, dt = np.random.default_rng(seed), 2400, 0.05
    t, still = np.arange(rows) * dt, np.zeros((rows, 3))
    velocity = np.outer(0.02 * np.sin(2.0 * np.pi * 0.05 * t), (1.0, 0.0, 0.0))
    pulse = np.sin(np.pi * np.clip(t / 3.0 - 13.0, 0.0, 1.0)) ** 2
    velocity += np.outer(pulse, rng.normal(0.0, 0.2, 3))
    path = cumulative_simpson(velocity, dx=dt, axis=0, initial=0.0) + np.array([0.0, 0.0, 5.0])
    motion = disturb(np.hstack([path, still, velocity, still]), ORDINARY, rng)
    table = pl.DataFrame(np.column_stack([t, motion]), schema=["t", *POSE, *VELOCITY])
    commands = [pl.lit(0.0).alias(f"cmd_{i + 1}") for i in range(8)]
    return recording(synthetic.vehicle(), table.with_columns(pl.lit("a").alias("session"), *commands))


@pytest.mark.parametrize("seed", range(0, 30, 3))
def test_what_a_recording_hardly_tells_of_the_log_has_errors_of_a_plain_size(seed):
    """What noise adds to the products is taken off; without the one lively block nothing may be left to take.

    Such errors were of 1e11 m, and their covariance singular: the diagnosis ended.
    """
    for test in kinematic_tests(hardly_moving(seed)).values():
        assert (test.standard_error < 4.0 * PLAIN_SIZE).all()
        assert np.linalg.cond(test.covariance) < 1e12
        assert not shown(test)
