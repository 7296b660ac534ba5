"""Readings that no motion makes, put into the log of a body that turns over and over."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
import synthetic
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import ROWS, found, log, spoilt

from hydro.core.columns import VELOCITY
from hydro.core.recording.sensor_faults import CHANNELS, without_faults
from hydro.core.simulation.sensor_noise import PROFILES, Noise

ORDINARY = PROFILES["ordinary"]
U = CHANNELS.index("u")


def held(values: np.ndarray, rows: int) -> np.ndarray:
    return values[np.arange(len(values)) // rows * rows]


@pytest.mark.parametrize("noise", [Noise(), *PROFILES.values()])
@pytest.mark.parametrize("every", [1, 10])
def test_a_sound_log_has_no_faults_even_of_a_slow_sensor_that_is_held(noise, every):
    raw = log(noise)
    slow = {name: held(raw[name].to_numpy(), every) for name in "uvw"}
    assert not found(spoilt(raw, **slow)).all.any()
    steps = {name: np.round(raw[name].to_numpy() / 0.01) * 0.01 for name in VELOCITY}
    assert not found(spoilt(raw, **steps)).all.any()


def test_a_sound_log_stays_as_it_is():
    raw = log()
    log_as_is = without_faults(synthetic.vehicle(), raw)
    assert log_as_is.raw.equals(raw)
    assert log_as_is.faults == ()


@pytest.mark.parametrize("noise", [Noise(), ORDINARY])
def test_a_collision_is_no_fault(noise):
    """The velocity changes within one row, and stays changed."""
    u = log(noise)["u"].to_numpy().copy()
    u[1500:] -= 1.0
    assert not found(spoilt(log(noise), u=u)).all.any()


@pytest.mark.parametrize(("column", "told"), [("u", True), ("phi", False), ("psi", False)])
def test_at_a_steep_pitch_a_velocity_may_be_wrong_and_roll_and_heading_may_swing(column, told):
    raw = log()
    row = int(raw["theta"][100:-100].arg_max()) + 100
    raw = spoilt(raw, theta=raw["theta"].to_numpy() + 1.3 - raw["theta"][row])
    values = raw[column].to_numpy().copy()
    values[row] += 3.0
    assert found(spoilt(raw, **{column: values})).jumps[row, CHANNELS.index(column)] == told


@settings(max_examples=15)
@given(
    rows=st.lists(st.integers(20, ROWS - 40), min_size=1, max_size=12, unique=True),
    burst=st.sampled_from([1, 2, 3, 4]),
    size=st.sampled_from([-30.0, -2.0, 2.0, 5.0]),  # beyond what a tumbling body does in a burst
    column=st.sampled_from(["x", "z", "u", "w", "q"]),
)
def test_readings_that_jump_away_and_back_are_found_and_bridged(rows, burst, size, column):
    kept = [row for i, row in enumerate(sorted(rows)) if not i or row - sorted(rows)[i - 1] > 40]
    raw = log()
    values, truth = raw[column].to_numpy().copy(), np.zeros(ROWS, bool)
    for row in kept:
        truth[row : row + burst] = True
    values[truth] += size
    jumps = found(spoilt(raw, **{column: values})).jumps
    np.testing.assert_array_equal(jumps[:, CHANNELS.index(column)], truth)
    assert np.count_nonzero(jumps) == truth.sum()
    corrected = without_faults(synthetic.vehicle(), spoilt(raw, **{column: values}))
    mended, (fault,) = corrected.raw, corrected.faults
    assert mended.height == raw.height
    away = (mended[column] - raw[column]).to_numpy()
    assert np.abs(away).max() < 0.12  # six of the greatest noise, beside what the motion does in four rows
    assert not away[~truth].any()
    assert fault.columns == (column,)
    assert f": {truth.sum()} {'row' if truth.sum() == 1 else 'rows'} (" in fault.message
    assert f"session a at {raw['t'][kept[0]]:.2f} s" in fault.message


@pytest.mark.parametrize("every", [1, 10])
def test_a_sensor_that_stands_still_is_found_and_its_rows_are_left_out(every):
    raw = log()
    columns = {name: held(raw[name].to_numpy(), every) for name in "uvw"}
    for values in columns.values():
        values[1000:1200] = values[1000]
    stills = found(spoilt(raw, **columns)).stills
    where = np.flatnonzero(stills.any(axis=1))
    assert 1000 - every <= where.min()
    assert where.max() <= 1200 + every
    corrected = without_faults(synthetic.vehicle(), spoilt(raw, **columns))
    (fault,) = corrected.faults
    assert corrected.raw.height == corrected.record.rows == ROWS - where.size
    assert fault.columns == ("u", "v", "w")
    assert "stand still" in fault.message
    assert not found(corrected.raw).all.any()


def test_velocities_in_coarse_steps_that_stand_still_are_refuted_by_the_position():
    raw = log()
    columns = {name: np.round(raw[name].to_numpy() / 0.05) * 0.05 for name in "uvw"}
    for values in columns.values():
        values[1000:1200] = 0.0
    assert found(spoilt(raw, **columns)).stills[1010:1190, U : U + 3].any(axis=1).all()


def test_a_mark_for_no_reading_is_found_wherever_it_is_written():
    raw, lost = log(), np.random.default_rng(1).random(ROWS) < 0.02
    u = raw["u"].to_numpy().copy()
    u[lost] = 0.0
    faulty = found(spoilt(raw, u=u))
    np.testing.assert_array_equal(faulty.all[:, U], lost)
    assert faulty.marks.sum() == lost.sum()


def test_jumps_are_bridged_in_every_session_by_its_own_samples():
    first, second = log(), log(seed=1).with_columns(session=pl.lit("b"))
    both = pl.concat([first, second])
    u = both["u"].to_numpy().copy()
    u[[500, ROWS + 700]] += 5.0
    mended = without_faults(synthetic.vehicle(), spoilt(both, u=u)).raw
    expected = both["u"].to_numpy().copy()
    for row in (500, ROWS + 700):
        expected[row] = 0.5 * (expected[row - 1] + expected[row + 1])
    np.testing.assert_allclose(mended["u"].to_numpy(), expected, atol=1e-9)


def test_a_jump_of_a_heading_near_half_a_turn_is_bridged_across_it():
    t = np.arange(ROWS) * 0.02
    raw = log().with_columns(pl.lit(0.0).alias("theta"), pl.lit(0.0).alias("phi"))
    psi = np.angle(np.exp(1j * (np.pi + 0.2 * np.sin(0.3 * t))))
    sound = psi + 1e-3 * np.random.default_rng(0).standard_normal(ROWS)
    broken = sound.copy()
    broken[700] -= 1.0
    mended = without_faults(synthetic.vehicle(), spoilt(raw, psi=broken)).raw
    turned = np.angle(np.exp(1j * (mended["psi"].to_numpy() - sound)))
    assert np.abs(turned).max() < 0.01


def test_nothing_stands_still_behind_the_last_sample_of_a_slow_sensor():
    """Rows between samples, and behind the last one, hold no reading at all; equal samples do."""
    raw = log()
    reads = pl.int_range(pl.len()).over("session") % 20 == 0
    slow = raw.with_columns(pl.when(reads).then(name).alias(name) for name in "uvw")
    assert without_faults(synthetic.vehicle(), slow).faults == ()
    u = raw["u"].to_numpy().copy()
    u[400:1000] = u[400]
    frozen = slow.with_columns(pl.when(reads).then(pl.Series(u)).alias("u"))
    (fault,) = without_faults(synthetic.vehicle(), frozen).faults
    assert fault.columns == ("u",)
    assert "stand still" in fault.message
