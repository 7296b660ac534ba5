"""One cleaned recording: every command sees it, every change is told, and samples stay as logged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from recordings import damped, moved, noisy

import hydro
from hydro.core.cleaning.cleaned import cleaned
from hydro.core.columns import POSE, VELOCITY
from hydro.core.explanation.trials import Recordings

REAL = Path(__file__).resolve().parents[4] / "shared" / "data" / "real"
KEYS = ["level", "axis", "by", "place", "horizon", "rmse", "noise_floor"]


@pytest.fixture(scope="module")
def flight():
    """A vehicle under slow sines for 26 s."""
    return moved(damped(), rows=1300)


def with_outliers(raw):
    rng = np.random.default_rng(3)
    return raw.with_columns(
        pl.col(name) + pl.Series(0.02 * rng.standard_t(3, raw.height)) for name in VELOCITY[:3]
    )


def with_jumps(raw):
    spike = np.zeros(raw.height)
    spike[[500, 1100]] = 3.0
    return raw.with_columns(pl.col("u") + pl.Series(spike))


def reversed_thruster(raw):
    return raw.with_columns(-pl.col("cmd_3"))


def with_bias(raw):
    return raw.with_columns(pl.col("r") + 0.02)


def without_velocity(raw):
    return raw.with_columns(pl.lit(None, pl.Float64).alias(name) for name in VELOCITY[:3])


def as_logged(raw):
    return raw


LOGS = (as_logged, with_outliers, with_jumps, reversed_thruster, with_bias, without_velocity)


def same_error(vehicle, raw):
    """Compare by the command's function and by step 0 of explain; the errors must be the same numbers."""
    compared = hydro.compare(vehicle, raw).select(KEYS)
    log = Recordings.of(vehicle, raw, None, None)
    step_0 = log.compared(vehicle, log.log, lambda words, share: None).select(KEYS)
    assert compared.equals(step_0.cast(compared.schema))


@pytest.mark.parametrize("spoil", LOGS)
def test_compare_and_step_0_of_explain_give_the_same_error(flight, spoil):
    same_error(damped(), spoil(noisy(flight, 1)))


@pytest.mark.parametrize(
    ("log", "mapped", "vehicle", "seconds"),
    [
        ("tauv/hold.csv", "tauv/map.toml", "tauv/vehicle.toml", 60.0),
        ("tauv/fit.csv", "tauv/map.toml", "tauv/vehicle2.toml", 30.0),
        ("bluerov1/test1_all_2016-04-04-15-23-32.bag", "bluerov1/map04.toml", "bluerov1/veh.toml", 20.0),
    ],
)
def test_they_do_on_real_logs(log, mapped, vehicle, seconds):
    if not (REAL / log).exists():
        pytest.skip("the real logs are not beside this checkout")
    raw, _ = hydro.import_log(REAL / log, REAL / mapped)
    first = raw.filter(pl.col("session") == raw["session"][0])
    same_error(
        hydro.vehicle(REAL / vehicle),
        first.filter(pl.col("t") < first["t"][0] + seconds),
    )


def test_samples_with_heavy_tails_stay_in_the_table_and_are_told(flight):
    raw = with_outliers(noisy(flight, 1))
    log = cleaned(damped(), raw)
    assert log.raw.equals(raw)
    assert not np.array_equal(log.record.nu[:, 0], raw["u"].to_numpy())
    (told,) = log.changes
    assert "u (" in told
    assert "outliers count for less" in told


def test_a_sound_log_has_no_changes(flight):
    raw = noisy(flight, 1)
    log = cleaned(damped(), raw)
    assert (log.changes, log.raw.equals(raw)) == ((), True)
    assert np.array_equal(log.record.eta, raw.select(POSE).to_numpy().astype(float))
