"""Recordings in which sensors gave a sample now and then, or are not there: each sample counts once."""

from __future__ import annotations

import dataclasses

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import damped, moved, noisy
from scipy.spatial.transform import Rotation

from hydro.core.columns import POSE, VELOCITY
from hydro.core.errors import DataError
from hydro.core.identification.fit import fit
from hydro.core.prediction import multiple_shooting, sensitivity
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import noise, recording
from hydro.core.recording.filling import filled
from hydro.core.recording.sensor_faults import without_faults
from hydro.core.recording.shots import make_shots
from hydro.core.simulation.simulate import simulate

NOISE = np.repeat([0.02, 0.001, 0.01, 0.002], 3)
ANGLES, SPEEDS = ("phi", "theta", "psi"), ("u", "v", "w")
SLOW = {**dict.fromkeys(SPEEDS, (10, 3)), **dict.fromkeys(ANGLES, (5, 1))}


def thinned(raw: pl.DataFrame, every: dict[str, tuple[int, int]]) -> pl.DataFrame:
    """With samples in one of so many rows only, from the given one on."""
    row = pl.int_range(pl.len())
    return raw.with_columns(pl.when(row % n == at).then(pl.col(name)) for name, (n, at) in every.items())


def without(raw: pl.DataFrame, *names: str) -> pl.DataFrame:
    return raw.with_columns(pl.lit(None, pl.Float64).alias(name) for name in names)


@pytest.fixture(scope="module")
def flown() -> pl.DataFrame:
    return noisy(moved(damped(), rows=6000), 0)


@pytest.fixture(scope="module")
def whole(flown):
    return fit(damped(), flown, ["linear_damping"])


def off(found) -> np.ndarray:
    """Standard errors from the truth."""
    return (found.values - synthetic.LINEAR) / found.standard_errors


def test_a_slow_sensor_counts_by_its_samples(flown, whole):
    """Velocity at 5 Hz, attitude at 10 Hz, never in one row: less is known, but not a tenth of it."""
    found = fit(damped(), thinned(flown, SLOW), ["linear_damping"])
    assert np.abs(off(found)).max() < 3.0
    assert found.chi2 == pytest.approx(1.0, abs=0.06)
    ratio = found.standard_errors / whole.standard_errors
    assert (ratio > 1.1).all()
    assert (ratio < np.sqrt(10.0)).all()
    assert not found.warnings


def test_errors_grow_as_the_information_shrinks(flown, whole):
    """One row in four of everything has a quarter of the information."""
    found = fit(damped(), thinned(flown, dict.fromkeys((*POSE, *VELOCITY), (4, 2))), ["linear_damping"])
    assert np.abs(off(found)).max() < 3.5
    ratio = found.standard_errors / whole.standard_errors
    assert np.exp(np.log(ratio).mean()) == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (SPEEDS, "no velocity (u, v, w): the other sensors and the model give surge ±"),
        (VELOCITY, "no velocity (u, v, w): the other"),
        (("x", "y", "z"), "no position (x, y, z): nothing shows north, east, depth"),
        (("x", "y"), "no position (x, y): nothing shows north, east, nor"),
    ],
)
def test_what_one_sensor_does_not_show_another_does(flown, whole, names, words):
    found = fit(damped(), without(flown, *names), ["linear_damping"])
    assert np.abs(off(found)).max() < 3.5
    assert found.chi2 == pytest.approx(1.0, abs=0.06)
    assert (found.standard_errors > 0.9 * whole.standard_errors).all()
    assert found.warnings[0].startswith(words)


def test_the_cost_is_that_of_the_samples_alone(flown):
    """Against plain numpy; what stands in rows without a sample does not matter."""
    record = recording(damped(), thinned(flown.head(600), SLOW))
    shots = make_shots(record)
    prepared = multiple_shooting.prepare(candidate(damped()), shots)
    predicted, rows = multiple_shooting.predict(prepared, shots), shots.starts[:, None] + np.arange(100)
    logged = flown.select("x", "y", "z", *VELOCITY).to_numpy()[rows]
    error = (logged - predicted[..., [0, 1, 2, *range(7, 13)]]) / shots.sigma[[0, 1, 2, *range(6, 12)]]
    turned = Rotation.from_quat(predicted[..., 3:7].reshape(-1, 4), scalar_first=True).inv() * (
        Rotation.from_euler("ZYX", flown.select(*ANGLES).to_numpy()[rows].reshape(-1, 3)[:, ::-1])
    )
    twist = turned.as_rotvec().reshape(*rows.shape, 3) / shots.sigma[3:6]
    expected = (error[..., :3] ** 2).sum() + (error[..., 6:] ** 2).sum()
    expected += (error[..., 3:6][rows % 10 == 3] ** 2).sum() + (twist[rows % 5 == 1] ** 2).sum()
    assert multiple_shooting.cost(prepared, shots) == pytest.approx(expected, rel=1e-4)
    spoilt = dataclasses.replace(shots, measured=np.where(seen_states(shots.seen), shots.measured, 7.0))
    assert multiple_shooting.cost(prepared, spoilt) == multiple_shooting.cost(prepared, shots)
    one, other = (sensitivity.linearise(prepared, [], [], each) for each in (shots, spoilt))
    np.testing.assert_array_equal(one.gram, other.gram)


def seen_states(seen: np.ndarray) -> np.ndarray:
    """The same of states with a quaternion, (..., 13)."""
    return np.concatenate([seen[..., :3], np.repeat(seen[..., 3:4], 4, axis=-1), seen[..., 6:]], axis=-1)


def test_freedom_is_the_number_of_samples_less_that_of_what_they_show_of_the_beginning(flown):
    def freedom(raw: pl.DataFrame) -> np.ndarray:
        shots = make_shots(recording(damped(), raw))
        prepared = multiple_shooting.prepare(candidate(damped()), shots)
        return sensitivity.linearise(prepared, [], [], shots).freedoms

    part = flown.head(600)
    assert (freedom(part) == 12 * 100 - 12).all()
    np.testing.assert_allclose(freedom(thinned(part, SLOW)), 6 * 100 + 3 * 10 + 3 * 20 - 12, atol=0.2)
    np.testing.assert_allclose(freedom(without(part, "x", "y", "z")), 9 * 100 - 9, atol=0.2)


def test_noise_is_that_of_the_samples(flown):
    record = recording(damped(), thinned(flown, SLOW))
    np.testing.assert_allclose(noise(record), NOISE, rtol=0.2)


def test_a_jump_of_a_rare_sample_is_no_sample(flown):
    sparse = thinned(flown, SLOW)
    u = sparse["u"].to_list()
    u[1503] += 1.0
    found = without_faults(damped(), sparse.with_columns(u=pl.Series(u)))
    assert "u jump away" in found.faults[0].message
    assert found.raw["u"][1503] is None
    assert found.raw.height == sparse.height
    assert not found.record.seen[1503, 6]


def test_what_needs_every_row_says_what_to_do(flown):
    sparse = thinned(flown, SLOW)
    with pytest.raises(DataError, match="`hydro import --fill`") as caught:
        simulate(damped(), sparse)
    assert "\n" not in str(caught.value)


# Filling


def motion(**changed) -> tuple[np.ndarray, np.ndarray]:
    """Motion without noise, and its segments: two, with a gap between."""
    raw = moved(damped(), rows=900)
    return raw.select(*POSE, *VELOCITY).to_numpy().copy(), np.array([[0, 500], [500, 900]])


@pytest.mark.parametrize(
    ("channels", "within"),
    [(range(6, 9), 0.02), (range(9, 12), 0.02), (range(6, 12), 0.02), ([7], 0.02), ([3, 5, 8], None)],
)
def test_filling_follows_the_motion(channels, within):
    truth, bounds = motion()
    holes = truth.copy()
    if within is None:  # now and then a sample
        within = 0.01
        for at in range(4):
            holes[at + 1 :: 5, list(channels)] = np.nan
    else:
        holes[:, list(channels)] = np.nan
    found = filled(holes, bounds, 0.02)
    there = np.isfinite(holes)
    np.testing.assert_array_equal(found[there], truth[there])
    inside = np.r_[20:480, 520:880]
    off = found[inside] - truth[inside]
    off[:, 3:6] = np.angle(np.exp(1j * off[:, 3:6]))
    assert np.abs(off).max() < within


def test_a_position_that_nobody_measured_is_the_sum_of_the_velocity():
    truth, bounds = motion()
    holes = truth.copy()
    holes[:, :2] = np.nan
    found = filled(holes, bounds, 0.02)
    for start, stop in bounds:
        way = found[start:stop] - found[start]
        np.testing.assert_allclose(way, truth[start:stop] - truth[start], atol=1e-3)


def test_an_angle_is_filled_the_short_way_round():
    truth = np.zeros((21, 12))
    psi = np.pi - 0.1 + 0.01 * np.arange(21)
    truth[:, 5] = np.angle(np.exp(1j * psi))
    holes = truth.copy()
    holes[1:20, 5] = np.nan
    found = filled(holes, np.array([[0, 21]]), 0.1)
    np.testing.assert_allclose(found[:, 5], truth[:, 5], atol=1e-12)


def test_an_attitude_that_nobody_measured_is_level():
    truth, bounds = motion()
    truth[500:, 3:6] = np.nan
    assert (filled(truth, bounds, 0.02)[500:, 3:6] == 0.0).all()
