"""Resampling: each channel from its own samples, nothing across a gap, commands held."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.core.logs import resample
from hydro.core.logs.resample import Channel


def channel(t, values=None):
    t = np.asarray(t, float)
    return Channel(t, np.zeros(len(t)) if values is None else np.asarray(values, float))


def test_a_channel_is_its_filled_cells_and_the_first_of_repeated_times():
    t = np.array([0.0, 0.1, 0.1, 0.2, 0.3])
    found = resample.channel(t, np.array([1.0, 2.0, 3.0, np.nan, 5.0]))
    np.testing.assert_array_equal(found.t, [0.0, 0.1, 0.3])
    np.testing.assert_array_equal(found.values, [1.0, 2.0, 5.0])
    assert len(resample.channel(t, np.full(5, np.nan)).t) == 0


@pytest.mark.parametrize(
    ("rates", "expected"),
    [((50.0, 50.0, 5.0), 0.02), ((20.0, 20.0, 5.0, 5.0), 0.05), ((5.0, 5.0, 50.0), 0.2), ((29.97,), 1 / 30)],
)
def test_the_rate_is_that_of_most_channels_and_a_whole_number_where_it_is_near_one(rates, expected):
    steps = [channel(np.arange(50) / rate).step for rate in rates]
    assert resample.sample_time(steps) == pytest.approx(expected, rel=1e-12)


def test_jitter_and_a_single_channel_without_samples_do_not_move_the_rate():
    rng = np.random.default_rng(3)
    t = np.arange(500) / 25.0 + rng.uniform(-2e-3, 2e-3, 500)
    assert resample.sample_time([channel(t).step, channel([]).step]) == 1 / 25
    with pytest.raises(DataError, match="the rate is unknown"):
        resample.sample_time([channel([]).step, channel([1.0]).step])


def test_spans_end_where_a_channel_is_silent_for_longer_than_usual():
    t = np.r_[0.0:1.05:0.1, 1.4:2.05:0.1, 5.0:6.05:0.1]
    np.testing.assert_allclose(resample.spans(channel(t)), [[0.0, 2.0], [5.0, 6.0]])
    np.testing.assert_allclose(resample.spans(channel(t), 0.2), [[0.0, 1.0], [1.4, 2.0], [5.0, 6.0]])
    assert resample.spans(channel([])).shape == (0, 2)


intervals = st.lists(
    st.tuples(st.integers(0, 60), st.integers(1, 10)), min_size=1, max_size=6, unique_by=lambda one: one[0]
).map(lambda pairs: np.array([[a, a + length] for a, length in sorted(pairs)], float))


@given(st.lists(intervals, min_size=1, max_size=3))
def test_the_common_stretches_are_those_instants_that_lie_in_a_stretch_of_every_channel(stretches):
    found = resample.common(stretches)
    for instant in np.arange(0.25, 72.0, 0.5):
        inside = all(((each[:, 0] <= instant) & (instant <= each[:, 1])).any() for each in stretches)
        assert ((found[:, 0] <= instant) & (instant <= found[:, 1])).any() == inside


def test_rows_share_one_grid_and_none_stands_in_a_gap():
    t = resample.rows(np.array([[0.03, 0.31], [0.512, 0.75], [0.8, 0.82]]), 0.05)
    steps = (t - 0.03) / 0.05
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert not ((t > 0.31) & (t < 0.512)).any()
    np.testing.assert_allclose(t, [0.03, 0.08, 0.13, 0.18, 0.23, 0.28, 0.53, 0.58, 0.63, 0.68, 0.73])
    assert resample.rows(np.empty((0, 2)), 0.05).shape == (0,)


@given(st.integers(1, 400), st.floats(1e-3, 0.2))
def test_a_stretch_of_whole_steps_keeps_its_last_row(count, dt):
    assert len(resample.rows(np.array([[0.0, count * dt]]), dt)) == count + 1


def test_a_command_holds_until_the_next_and_rounding_does_not_delay_it():
    given_ = channel([0.0, 0.1, 0.2000001, 0.35], [1.0, 2.0, 3.0, 4.0])
    at = np.array([0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.35, 9.0])
    np.testing.assert_array_equal(resample.held(given_, at, 0.05), [1, 1, 2, 2, 3, 3, 4, 4])


@given(st.floats(-50.0, 50.0), st.sampled_from([2.0 * np.pi, 360.0]))
def test_angles_pass_through_their_jump_by_the_short_way(start, turn):
    t = np.arange(200) / 10.0
    true = start + 0.03 * turn * t
    wrapped = channel(t, np.mod(true, turn))
    between = t[:-1] + 0.05
    found = resample.interpolated(resample.unwrapped(wrapped, turn), between)
    off = (found - np.interp(between, t, true)) / turn
    np.testing.assert_allclose(off - np.round(off), 0.0, atol=1e-9)


def test_a_quaternion_keeps_its_sign_from_sample_to_sample():
    angle = np.linspace(0.0, 3.0, 30)
    q = np.stack([np.cos(angle / 2), np.zeros(30), np.zeros(30), np.sin(angle / 2)])
    signs = np.where(np.arange(30) % 3 == 0, -1.0, 1.0)
    channels = [channel(np.arange(30.0), part * signs) for part in q]
    channels[0] = Channel(channels[0].t[1:], channels[0].values[1:])  # one cell of a sample is empty
    found = np.stack([each.values for each in resample.same_sign(channels)])
    assert found.shape == (4, 29)
    assert np.sum(found[:, 1:] * found[:, :-1], axis=0).min() > 0.99
    np.testing.assert_allclose(np.abs(found), np.abs(q[:, 1:]))


@given(st.lists(st.floats(0.001, 0.3), min_size=3, max_size=40), st.integers(0, 2**32 - 1))
def test_a_mean_over_rows_keeps_the_impulse(steps: list[float], seed: int) -> None:
    t = np.concatenate([[0.0], np.cumsum(steps)])
    each = resample.channel(t, np.random.default_rng(seed).uniform(-1.0, 1.0, t.size))
    dt = 0.05
    at = np.arange(int(t[-1] / dt)) * dt
    if not at.size:
        return
    ends = np.concatenate([t[t < at[-1] + dt], [at[-1] + dt]])
    impulse = float((np.diff(ends) * each.values[: ends.size - 1]).sum())
    mean = resample.averaged(each, at, dt)
    assert mean.sum() * dt == pytest.approx(impulse, abs=2.0 * resample.HELD_EARLY * dt * len(steps))
    assert (np.abs(mean) <= np.abs(each.values).max() + 1e-12).all()


def test_a_command_that_comes_a_moment_after_its_row_is_not_a_row_late() -> None:
    rng, dt = np.random.default_rng(3), 0.05
    at = np.arange(200) * dt
    values = rng.uniform(-1.0, 1.0, at.size)
    late = resample.channel(at + np.append(0.0, rng.uniform(0.0, 0.002, at.size - 1)), values)
    assert np.abs(resample.averaged(late, at, dt) - values).max() < 0.04 * 2.0
    assert np.abs(resample.held(late, at, dt) - values).max() > 0.5
    exact = resample.channel(at, values)
    np.testing.assert_array_equal(resample.averaged(exact, at, dt), values)
