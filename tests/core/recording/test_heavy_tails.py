"""Noise with heavy tails: told from Gauss by the samples alone, and as good as Gauss afterwards."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import damped, log, moved, noisy

from hydro.core.columns import VELOCITY
from hydro.core.recording.arrays import noise, recording
from hydro.core.recording.heavy_tails import Tail, heavy_tails, pseudo_observations, pseudo_observed
from hydro.core.recording.sensor_faults import without_faults

VEHICLE = synthetic.vehicle()
DVL = VELOCITY[:3]
SCALE = 0.02


@pytest.fixture(scope="module")
def flight():
    """A vehicle under slow sines, without noise."""
    return moved(damped(), rows=4000)


def student(flight, seed, freedom=3.0, columns=DVL):
    """The flight with ordinary noise, and t noise in some columns in its place."""
    rng, raw = np.random.default_rng(seed), noisy(flight, seed)
    return raw.with_columns(
        flight[name] + pl.Series(SCALE * rng.standard_t(freedom, raw.height)) for name in columns
    )


def seeds(seed):
    return np.random.default_rng([seed, 7])


@pytest.mark.parametrize("freedom", [2.5, 4.0])
def test_students_t_is_told_with_its_tail_and_scale(flight, freedom):
    found = heavy_tails(recording(damped(), student(flight, 1, freedom)))
    assert {tail.channel for tail in found.values()} == set(DVL)
    for tail in found.values():
        assert tail.freedom == pytest.approx(freedom, rel=0.35)
        assert tail.scale == pytest.approx(SCALE, rel=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_a_log_with_gaussian_noise_keeps_every_bit(flight, seed):
    for raw in (noisy(flight, seed), log(seed=seed)):
        corrected = without_faults(damped(), raw)
        assert corrected.raw.equals(raw)
        assert corrected.record.sigma is None


def held(u):
    return np.repeat(u[::10], 10)


def lines(u):
    return np.interp(np.arange(len(u)), np.arange(0, len(u), 10), u[::10])


@pytest.mark.parametrize(
    "other",
    [
        held,
        lines,
        lambda u: 0.02 * np.round(u / 0.02),
        lambda u: u + np.cumsum(1e-3 * seeds(3).standard_t(3, len(u))),
        lambda u: u + 0.5 * (np.arange(len(u)) % 500 > 250),
    ],
    ids=["held", "lines", "steps", "random walk", "jumps of the motion"],
)
def test_what_else_is_no_white_gauss_is_left_alone(flight, other):
    raw = noisy(flight, 2).with_columns(pl.Series(name, other(flight[name].to_numpy())) for name in DVL)
    assert not heavy_tails(recording(damped(), raw))


@pytest.mark.parametrize("freedom", [2.0, 3.0, 6.0])
def test_pseudo_observations_reach_the_cramer_rao_bound(freedom):
    """White noise of the variance s^2 (nu + 3)/(nu + 1), over single samples and over means of forty."""
    rows = 40_000
    motion = np.sin(np.arange(rows) * 0.02)
    y = motion + SCALE * seeds(0).standard_t(freedom, rows)
    (pseudo,), sigma = pseudo_observations([y], Tail("u", freedom, SCALE, 13))
    error, bound = pseudo - motion, SCALE * np.sqrt((freedom + 3.0) / (freedom + 1.0))
    means = np.sqrt(40.0) * error.reshape(-1, 40).mean(axis=1)
    assert [sigma, error.std(), means.std()] == pytest.approx([bound] * 3, rel=0.15)
    assert error.std() < (y - motion).std()
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.05


def test_they_follow_the_motion_not_a_smooth_curve():
    """Where the cubic of a quarter of a second cannot follow, by a third of the noise, they still do."""
    rows, freedom = 40_000, 3.0
    motion = 0.05 * np.sin(2.0 * np.pi * np.arange(rows) / 16.0)
    y = motion + SCALE * seeds(1).standard_t(freedom, rows)
    (pseudo,), _ = pseudo_observations([y], Tail("u", freedom, SCALE, 13))
    assert pseudo @ motion / (motion @ motion) == pytest.approx(1.0, abs=0.1)


FAST = {
    "all the time, 4 Hz": lambda t: 10.0 * np.sin(2.0 * np.pi * 4.0 * t),
    "all the time, 2.5 Hz": lambda t: 40.0 * np.sin(2.0 * np.pi * 2.5 * t),
    "in bursts": lambda t: 40.0 * np.sin(2.0 * np.pi * 2.5 * t) * np.sin(np.pi * t / 60.0) ** 20,
    "1 to 2.5 Hz": lambda t: sum(20.0 * np.sin(2.0 * np.pi * f * t + f) for f in (1.0, 1.3, 1.7, 2.1, 2.5)),
    "faster than any cubic": lambda t: 10.0 * np.sin(2.0 * np.pi * 9.0 * t),
}
"""Rolling and pitching rates in units of the noise's scale."""


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("fast", FAST.values(), ids=FAST)
def test_fast_rolling_and_pitching_is_not_smoothed(fast, seed):
    """Else a bias follows the curvature of the motion, as if thrusters or commands were late."""
    rng, rows = seeds(seed), 15_000
    flight = moved(damped(), rows=rows)
    motion = SCALE * fast(np.arange(rows) * 0.02)
    error = SCALE * rng.standard_t(3, rows)
    raw = noisy(flight, seed).with_columns(pl.Series("p", motion + error))
    record = recording(damped(), raw)
    cleaned, _ = pseudo_observed(raw, record, heavy_tails(record))
    left, turns = cleaned["p"].to_numpy() - motion, np.gradient(np.gradient(motion))
    assert abs(np.corrcoef(left, turns)[0, 1]) < 0.05
    assert left.std() <= 1.01 * error.std()
    if fast is not FAST["faster than any cubic"]:
        assert left.std() < SCALE * np.sqrt(1.5) * 1.12  # of the Cramer-Rao bound


def test_gross_errors_leave_no_trace_and_their_noise_is_known(flight):
    """One in a hundred readings off by twenty standard deviations."""
    rng, raw = seeds(2), noisy(flight, 3)
    gross = {name: 0.2 * rng.normal(size=raw.height) * (rng.random(raw.height) < 0.01) for name in DVL}
    corrected = without_faults(
        damped(), raw.with_columns(pl.Series(name, raw[name].to_numpy() + e) for name, e in gross.items())
    )
    assert corrected.raw.height == raw.height
    for i, name in enumerate(DVL):
        error = corrected.record.nu[:, i] - flight[name].to_numpy()
        assert np.abs(error).max() < 0.1 < 0.4 < np.abs(gross[name]).max()
        assert noise(corrected.record)[6 + i] == pytest.approx(error.std(), rel=0.1)


def test_jumps_that_the_noise_makes_are_no_faults(flight):
    assert not without_faults(damped(), student(flight, 4, 2.5)).faults
    spike = np.zeros(flight.height)
    spike[700] = 40.0
    raw = student(flight, 4, 4.0).with_columns(pl.col("u") + pl.Series(spike))
    (fault,) = without_faults(damped(), raw).faults
    assert fault.columns == ("u",)


def test_samples_of_a_slow_sensor_stay_samples(flight):
    """The table stays as it was, with null between samples; the observation model has better ones."""
    raw = student(flight, 5)
    sampled = pl.Series(np.arange(raw.height) % 2 == 0)
    slow = raw.with_columns(pl.when(sampled).then(pl.col(name)).alias(name) for name in DVL)
    corrected = without_faults(damped(), slow)
    assert {tail.channel for tail in corrected.tails} == set(DVL)
    assert corrected.raw.equals(slow)
    seen = corrected.record.seen
    for i, name in enumerate(DVL):
        assert seen is not None
        assert np.array_equal(seen[:, 6 + i], sampled.to_numpy())
        error = (corrected.record.nu[:, i] - flight[name].to_numpy())[sampled.to_numpy()]
        assert error.std() < 0.9 * (slow[name] - flight[name]).drop_nulls().std()


def sparse(seed, rate, held):
    """Five minutes of a vehicle whose surge follows random steps, at a few samples a second."""
    rng, rows, dt = seeds(seed), 15_000, 0.02
    force = rng.choice([-0.75, -0.5, 0.0, 0.5, 0.75], rows)
    edges = np.cumsum(rng.uniform(*held, rows) / dt).astype(int)
    force = force[np.searchsorted(edges, np.arange(rows), side="right")]
    u = np.zeros(rows)
    for k in range(rows - 1):
        u[k + 1] = u[k] + dt * (85.0 * force[k] - 14.0 * u[k] - 140.0 * abs(u[k]) * u[k]) / 20.0
    u, every = u[:: round(1.0 / (rate * dt))], round(1.0 / (rate * dt))
    raw = moved(damped(), rows=rows)[::every]
    raw = raw.with_columns(pl.Series("u", u + 0.003 * rng.standard_normal(len(u))))
    return noisy(raw, seed).with_columns(raw["u"])


@pytest.mark.parametrize("rate", [2, 5, 10])
@pytest.mark.parametrize("held", [(0.3, 1.5), (1.0, 5.0), (3.0, 12.0)])
def test_corners_of_a_motion_between_sparse_samples_are_no_outliers(rate, held):
    for seed in range(2):
        raw = sparse(seed, rate, held)
        corrected = without_faults(damped(), raw)
        assert corrected.tails == ()
        assert corrected.raw["u"].equals(raw["u"])


def test_a_jump_beyond_all_motion_is_found_between_sparse_samples():
    raw = sparse(0, 5, (0.3, 1.5))
    spike = np.zeros(raw.height)
    spike[400] = 5.0
    (fault,) = without_faults(damped(), raw.with_columns(pl.col("u") + pl.Series(spike))).faults
    assert fault.columns == ("u",)
