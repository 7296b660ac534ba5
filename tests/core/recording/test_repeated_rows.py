"""Rows that repeat the last one, in the log of a body that turns over and over."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
import synthetic
from recordings import ROWS, log, spoilt

from hydro.core.recording.arrays import recording
from hydro.core.recording.repeated_rows import repeated_rows
from hydro.core.recording.sensor_faults import CHANNELS, without_faults
from hydro.core.simulation.sensor_noise import PROFILES, Noise

VEHICLE = synthetic.vehicle()


def repeating(raw: pl.DataFrame, rows: np.ndarray) -> pl.DataFrame:
    """The log with each of these rows as the one before."""
    source = np.maximum.accumulate(np.where(rows, 0, np.arange(raw.height)))
    motion = raw.select(CHANNELS).to_numpy()[source]
    return spoilt(raw, **dict(zip(CHANNELS, motion.T, strict=True)))


def found(raw: pl.DataFrame) -> np.ndarray:
    return repeated_rows(recording(VEHICLE, raw))


@pytest.mark.parametrize("noise", [Noise(), PROFILES["ordinary"]])
@pytest.mark.parametrize("share", [0.02, 0.05, 0.3])
def test_rows_that_repeat_the_last_one_are_found_told_and_left_out(noise, share):
    raw, lost = log(noise), np.random.default_rng(1).random(ROWS) < share
    lost[[0, 1, -2, -1]] = False
    repeats = repeating(raw, lost)
    np.testing.assert_array_equal(found(repeats), lost)
    corrected = without_faults(VEHICLE, repeats)
    (fault,) = corrected.faults
    assert (
        f"repeat the row before, all at once, as a logger writes that got nothing new: {lost.sum()} rows"
        in (fault.message)
    )
    assert corrected.raw.height == ROWS
    assert corrected.raw.filter(~lost).equals(raw.filter(~lost))
    assert corrected.raw.filter(lost).select(CHANNELS).null_count().row(0) == (lost.sum(),) * len(CHANNELS)


@pytest.mark.parametrize("held", [1, 25])
def test_commands_that_are_repeated_as_well_do_not_come_late(held):
    """New in every row they are put on a straight line; held for long nothing says that they are late."""
    steps = np.random.default_rng(3).normal(0.0, 0.02, (ROWS // held + 1, 1)).cumsum(axis=0)
    given = np.repeat(steps, held, axis=0)[:ROWS, 0]
    lost = np.random.default_rng(1).random(ROWS) < 0.05
    lost[[0, 1, -2, -1]] = False
    source = np.maximum.accumulate(np.where(lost, 0, np.arange(ROWS)))
    commands = [name for name in log().columns if name.startswith("cmd_")]
    late = given[source]
    raw = repeating(log(), lost).with_columns(pl.Series(name, late) for name in commands)
    corrected = without_faults(VEHICLE, raw).raw[commands[0]].to_numpy()
    errors = [np.sqrt(np.mean((one - given)[lost] ** 2)) for one in (late, corrected)]
    assert errors[1] < 0.8 * errors[0] if held == 1 else np.array_equal(corrected, late)


@pytest.mark.parametrize(
    ("rate", "jitter"), [(48.0, 0.0), (40.0, 0.0), (40.0, 0.1), (30.0, 0.1), (24.0, 0.1), (12.5, 0.1)]
)
def test_sensors_that_are_all_slower_than_the_log_repeat_at_a_rate_which_is_no_fault(rate, jitter):
    read = (np.arange(ROWS) + jitter * np.random.default_rng(2).standard_normal(ROWS)) / rate
    newest = np.searchsorted(np.sort(read), np.arange(ROWS) * 0.02 + 1e-9)
    lost = np.concatenate([[False], np.diff(newest) == 0])
    assert lost.mean() > 0.03
    assert not found(repeating(log(), lost)).any()


def test_rows_of_coarse_sensors_that_are_equal_by_chance_are_no_fault():
    raw = log()
    coarse = {name: np.round(raw[name].to_numpy() / 0.3) * 0.3 for name in CHANNELS}
    repeats = spoilt(raw, **coarse)
    assert (np.diff(repeats.select(CHANNELS).to_numpy(), axis=0) == 0.0).all(axis=1).mean() > 0.1
    assert not found(repeats).any()


def test_a_vehicle_that_lies_still_without_noise_is_no_fault():
    rows = np.arange(ROWS)
    assert not found(repeating(log(Noise()), (rows % 500 > 400) & (rows > 0))).any()
