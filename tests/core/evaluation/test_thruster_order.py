"""Command columns exchanged or reversed in the log of a vehicle that scipy moved."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
import synthetic
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import damped, moved
from scipy.optimize import lsq_linear

from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis.log_faults import in_order, preprocess
from hydro.core.evaluation.thruster_order import THRUSTS, Wiring, _summed, _told, _within_bounds, rewired
from hydro.core.prediction.weak_form import Windows
from hydro.core.recording.arrays import recording
from hydro.core.simulation.sensor_noise import PROFILES, disturb

N = 8


def noisy(raw: pl.DataFrame) -> pl.DataFrame:
    logged = disturb(raw.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], np.random.default_rng(0))
    return raw.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


@pytest.fixture(scope="module")
def log() -> pl.DataFrame:
    return noisy(moved(damped(), rows=2500))


def drawn(log: pl.DataFrame, column, sign) -> pl.DataFrame:
    """The log with its columns so that `column[i]`, times `sign[i]`, drives thruster i."""
    back = np.argsort(column)
    values = {f"cmd_{j + 1}": sign[i] * log[f"cmd_{i + 1}"] for j, i in enumerate(back)}
    return log.with_columns(**values)


@pytest.mark.parametrize(
    "beside",
    [
        [],
        [{"name": "thruster_gain", "g": [-0.95, 0, 0, 0.2, 0, -0.4, 0, 0]}],
        [{"name": "ocean_current", "v_N": 0.3, "v_E": -0.2}],
        [{"name": "payload", "w": 30.0, "x": 0.4, "mass": 10.0}],
        [{"name": "thruster_asymmetry", "a": 0.4}, {"name": "thruster_deadband", "d": 0.1}],
    ],
)
def test_a_sound_log_is_left_alone_whatever_else_is_missing(beside):
    raw = noisy(moved(damped(*beside), rows=2500, seed=1))
    assert rewired(damped(), recording(damped(), raw)) is None
    assert preprocess(damped(), raw).wiring is None


def test_windows_answer_to_accelerations_by_their_test_function(log):
    windows = Windows.of(recording(damped(), log), most=9)
    accelerations = np.random.default_rng(0).standard_normal((log.height, 6))
    summed = _summed(windows, accelerations)
    assert len(summed) == 9
    for answer, start in zip(summed, windows.rows[windows.starts], strict=True):
        np.testing.assert_allclose(answer, windows.test @ accelerations[start : start + windows.test.size])


def test_values_at_their_bounds_may_be_otherwise(log):
    """A power of 4, the most that a formula may have, is what a study may end at."""
    steep = {"name": "formula", "forces": ["X |u|^n sgn(u)"], "force": [-1e-3], "exponents": [4.0]}
    vehicle = damped(steep)
    assert rewired(vehicle, recording(vehicle, log)) is None


@settings(max_examples=8)
@given(data=st.data())
def test_columns_that_are_exchanged_or_reversed_are_found(log, data):
    pair = data.draw(st.lists(st.integers(0, N - 1), min_size=2, max_size=3, unique=True))
    column, sign = list(range(N)), [1] * N
    for i, k in zip(pair, pair[1:] + pair[:1], strict=True):
        column[i] = k
    reversed_ = data.draw(st.integers(0, N - 1))
    sign[reversed_] = -1
    raw = drawn(log, column, sign)
    found = preprocess(damped(), raw)
    assert found.wiring == Wiring(tuple(column), tuple(sign))
    commands = [f"cmd_{i + 1}" for i in range(N)]
    np.testing.assert_array_equal(found.raw.select(commands), log.select(commands))
    (fault,) = found.faults
    assert fault.verdict == "log_fault"
    assert fault.confidence > 0.99
    assert f"minus cmd_{column[reversed_] + 1} drives thruster {reversed_ + 1}" in fault.advice
    assert f"cmd_{column[pair[0]] + 1}" in fault.members


def test_the_other_end_first_is_found(log):
    raw = drawn(log, list(range(N))[::-1], [1] * N)
    assert preprocess(damped(), raw).wiring == Wiring(tuple(range(N))[::-1], (1,) * N)
    assert in_order(raw, None) is raw


def test_a_recording_too_short_for_it_says_nothing(log):
    raw = drawn(log, [1, 0, *range(2, N)], [1] * N).head(200)
    assert rewired(damped(), recording(damped(), raw)) is None


def test_a_vehicle_without_thrusters_is_no_matter(log):
    bare = msgspec.structs.replace(synthetic.vehicle(), thruster=())
    raw = log.drop([f"cmd_{i + 1}" for i in range(N)])
    assert rewired(bare, recording(bare, raw)) is None


class _Costs:
    """What stands for a problem in which reversing the first thruster leaves these squares of each window."""

    def __init__(self, before, after):
        self.before, self.after = before, after

    def thrusts(self, wiring):
        return np.array([0.0 if wiring == Wiring.plain(2) else 1.0, 1.0])

    def costs(self, wiring):
        return self.before if wiring == Wiring.plain(2) else self.after


@pytest.mark.parametrize(("scatter", "told"), [(0.01, True), (0.9, False)])
def test_an_order_that_the_stretches_are_not_sure_of_is_not_told(scatter, told):
    """All else would be reported of columns that were in order: on the mean alone it is no less plain."""
    before = np.full(20, 1.0)
    after = 0.8 + scatter * np.where(np.arange(20) % 5 == 0, 0.8, -0.2)
    assert after.mean() == pytest.approx(0.8)
    found = _told(_Costs(before, after), Wiring((0, 1), (-1, 1)))
    assert (found is not None) == told


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(2, 8),
    apart=st.floats(-6.0, 0.0),
    reach=st.floats(0.1, 3.0),
)
def test_thrusts_are_at_their_least_squares_within_bounds(seed, count, apart, reach):
    """Of thrusters that push much alike, too, as those do that hold a vehicle's depth."""
    rng = np.random.default_rng(seed)
    alike = rng.standard_normal((40, 1)) * rng.uniform(-2.0, 2.0, count)
    answers = alike + 10.0**apart * rng.standard_normal((40, count))
    needed = answers @ rng.uniform(-reach, reach, count) + 0.1 * rng.standard_normal(40)
    found = _within_bounds((answers.T @ answers)[None], (answers.T @ needed)[None], 1e-12)[0]
    assert ((found >= THRUSTS[0]) & (found <= THRUSTS[1])).all()
    least = 2.0 * lsq_linear(answers, needed, bounds=THRUSTS, method="bvls", tol=1e-14).cost
    assert ((answers @ found - needed) ** 2).sum() <= least * (1.0 + 1e-6)


def test_a_thruster_that_does_not_show_stays_as_the_file_says():
    """Of two of which only the sum shows each has as much more or less."""
    answers = np.array([[1.0, 1.0, 0.0]])
    found = _within_bounds((answers.T @ answers)[None], (answers.T @ [1.4])[None], 1e-12)[0]
    np.testing.assert_allclose(found, [0.7, 0.7, 1.0], atol=1e-6)
