"""Samples that count, at their own time, of the body origin: against a motion known in closed form."""

from __future__ import annotations

import logs
import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

from hydro.core.errors import DataError
from hydro.core.logs import conventions
from hydro.core.logs.clocks import bunched, evened
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.delays import sensor_offsets
from hydro.core.logs.importing import raw_table
from hydro.core.logs.logmap import (
    Commands,
    LogMap,
    Mixer,
    Mount,
    Rates,
    Time,
    Use,
    Valid,
    Velocity,
)
from hydro.core.logs.mixer import matrix, mixed
from hydro.core.logs.samples import prepared
from hydro.core.vehicle.thrusters import configuration_matrix
from hydro.io import vehicle
from hydro.io.files import bundled

NAMES, PLAIN = logs.NAMES, logs.PLAIN


def replaced(**blocks: object) -> LogMap:
    import msgspec

    return msgspec.structs.replace(PLAIN, **blocks)


def session(seconds: float = 30.0, rate: float = 50.0, **others: np.ndarray) -> SessionLog:
    t = np.arange(round(seconds * rate)) / rate
    values = logs.motion(t)
    columns = dict(zip(NAMES, values.T, strict=True)) | {"cmd_1": np.sign(np.sin(t))}
    return SessionLog("dive", t, columns | others)


def of(imported: pl.DataFrame, *names: str) -> np.ndarray:
    return imported.select(names).to_numpy()


@pytest.mark.parametrize(
    ("valid", "flag"),
    [
        ("ok", (0.0, 1.0)),
        (Valid("ok", equals=2.0), (1.0, 2.0)),
        (Valid("ok", above=-1.0), (-1.0, 0.01)),
        (Valid("ok", below=3.0), (3.0, 1.0)),
        (Valid("ok", differs=-1.0), (-1.0, 0.0)),
    ],
)
def test_samples_that_are_not_valid_are_null_and_their_rows_stay(valid, flag):
    bad = np.zeros(1500, bool)
    bad[400:700] = True
    log = session(ok=np.where(bad, *flag))
    log.columns["u"][bad] = 7.0
    found = raw_table([log], replaced(velocity=Velocity(NAMES[6:9], valid=valid)))
    assert found.frame.height == 1500
    null = found.frame["u"].is_null().to_numpy()
    assert null[402:698].all()
    assert not null[:399].any()
    assert found.frame["x"].null_count() == 0
    assert "300 samples are not valid" in found.notes[0]
    assert np.abs(of(found.frame.drop_nulls(), "u")).max() < 5.0


def test_a_sentinel_needs_no_column():
    log = session()
    log.columns["w"][100:150] = -32.768
    found = raw_table([log], replaced(velocity=Velocity(NAMES[6:9], valid=Valid(differs=-32.768))))
    assert found.frame["w"].min() > -5.0
    assert found.frame["u"].null_count() >= 48


def test_a_value_per_another_column_is_a_velocity():
    plain = session()
    step = 0.05 + 0.01 * np.sin(plain.t)
    log = session(step=step)
    for name in NAMES[6:9]:
        log.columns[name][:] *= step
    found = raw_table([log], replaced(velocity=Velocity(NAMES[6:9], per="step")))
    np.testing.assert_allclose(of(found.frame, *NAMES[6:9]), logs.motion(plain.t)[:, 6:9], atol=1e-12)


def test_a_lag_puts_late_samples_where_they_were_taken():
    log = session()
    late = logs.motion(log.t - 0.3)
    log.columns.update(zip(NAMES[6:9], late[:, 6:9].T, strict=True))
    found = raw_table([log], replaced(velocity=Velocity(NAMES[6:9], lag=0.3))).frame
    np.testing.assert_allclose(of(found, *NAMES[6:9]), logs.motion(found["t"].to_numpy())[:, 6:9], atol=1e-3)


@pytest.mark.parametrize("block", ["velocity", "rates"])
@pytest.mark.parametrize("late", [-0.22, 0.35])
def test_the_lag_of_a_sensor_is_within_its_interval(block, late):
    rng = np.random.default_rng(3)
    log = session(90.0, 20.0)
    lagged = logs.motion(log.t - late)
    names = NAMES[6:9] if block == "velocity" else NAMES[9:]
    first = NAMES.index(names[0])
    log.columns.update(zip(names, lagged[:, first : first + 3].T, strict=True))
    for name, size in zip(NAMES, logs.ORDINARY, strict=True):
        log.columns[name][:] = log.columns[name] + size * rng.standard_normal(len(log.t))
    found = {one.block: one for one in sensor_offsets([log], [log.t], 0.05, PLAIN)}
    assert found[block].low - 0.005 < late < found[block].high + 0.005
    assert found[block].high - found[block].low < 0.2
    assert found[block].plain
    others = [one for name, one in found.items() if name != block]
    assert not any(one.plain and abs(one.seconds) > 0.02 for one in others)


def test_demands_are_clipped_before_they_are_mixed():
    """A demand beyond full deflection is full deflection: half of it is half."""
    log = session(a=np.repeat([1.5, -1.5, 0.4], 500), b=np.zeros(1500))
    block = Commands(("a", "b"))
    found, beyond = conventions.commands(
        log, block, log.t, 0.02, Mixer(("surge", "yaw"), matrix=((0.5, 0.0), (1.0, 1.0)))
    )
    inside = [250, 750, 1250]
    np.testing.assert_allclose(found[inside], [[0.5, 1.0], [-0.5, -1.0], [0.2, 0.4]])
    assert not beyond[inside].any()


def test_a_motor_of_a_vectored_frame_gives_no_more_than_full_thrust():
    """Surge, sway and yaw add up to three times full thrust on one motor; opposite demands cancel."""
    mixer = Mixer(("surge", "sway", "yaw"), preset="ardusub_vectored")
    both = mixed(mixer, np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, -1.0]]))
    np.testing.assert_array_equal(both[0, :4], [1.0, -1.0, -1.0, -1.0])
    np.testing.assert_array_equal(both[1], -both[0])


@pytest.mark.parametrize(("late", "told"), [(1.0, True), (1.5, False)])
def test_a_lag_beyond_those_that_are_looked_for_is_not_told(late, told):
    log = session(60.0, 20.0)
    lagged = logs.motion(log.t - late)
    log.columns.update(zip(NAMES[6:9], lagged[:, 6:9].T, strict=True))
    found = {one.block: one.seconds for one in sensor_offsets([log], [log.t], 0.05, PLAIN)}
    assert (abs(found.get("velocity", 0.0) - late) < 0.02) is told
    assert abs(found.get("velocity", 0.0)) < 1.2


@pytest.mark.parametrize("frame", ["FRD", "FLU", "NED"])
def test_a_mounted_velocity_log_and_gyroscope_are_put_right(frame):
    """A point at r in a rigid body moves with v + omega x r, whatever its axes."""
    log, arm = session(), np.array([0.4, -0.2, 0.3])
    values = logs.motion(log.t)
    moved = values[:, 6:9] + np.cross(values[:, 9:], arm)
    mount = Mount(yaw=45.0, roll=180.0, position=tuple(arm))
    turned = Rotation.from_euler("ZYX", [45.0, 0.0, 180.0], degrees=True)
    if frame == "NED":
        mount = Mount(position=tuple(arm))
        moved = Rotation.from_euler("ZYX", values[:, [5, 4, 3]]).apply(moved)
    else:
        moved = logs.turned(turned.inv().apply(moved), frame)
    gyro = turned.inv().apply(values[:, 9:])
    log.columns.update(zip(NAMES[6:], np.hstack([moved, gyro]).T, strict=True))
    meaning = replaced(
        velocity=Velocity(NAMES[6:9], frame=frame, mount=mount),
        rates=Rates(NAMES[9:], mount=Mount(matrix=tuple(map(tuple, turned.as_matrix().tolist())))),
    )
    found = raw_table([log], meaning).frame
    np.testing.assert_allclose(of(found, *NAMES[6:]), values[:, 6:], atol=1e-9)


def test_rates_of_the_attitude_are_those_of_the_motion():
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0.0, 30.0, 600))
    log = SessionLog("dive", t, {**dict(zip(NAMES, logs.motion(t).T, strict=True)), "cmd_1": np.ones(600)})
    found = raw_table([log], replaced(rates=Rates(source="attitude")))
    rows = found.frame.drop_nulls()
    np.testing.assert_allclose(of(rows, *"pqr"), logs.motion(rows["t"].to_numpy())[:, 9:], atol=0.01)
    assert any("derived from the attitude" in line for line in found.notes)


def test_repeats_of_a_velocity_are_no_readings():
    log = session()
    held = {name: log.columns[name][np.arange(1500) // 10 * 10] for name in NAMES[6:9]}
    log.columns.update(held)
    found = raw_table([log], PLAIN)
    assert found.frame["u"].drop_nulls().len() == pytest.approx(150, abs=2)
    kept = raw_table([log], replaced(velocity=Velocity(NAMES[6:9], held=False)))
    assert kept.frame["u"].null_count() == 0


def test_receipts_in_bursts_go_back_to_their_even_clock():
    rng = np.random.default_rng(1)
    sent = 3.0 + 0.02 * np.arange(2000)
    wakes = np.sort(rng.uniform(3.0, 45.0, 500))
    received = wakes[np.minimum(np.searchsorted(wakes, sent), 499)]
    received = np.maximum.accumulate(np.maximum(received, sent)) + 1e-5 * np.arange(2000) % 1e-4
    received = np.sort(received)
    assert bunched(received)
    found = evened(received)
    assert found is not None
    assert found.period == pytest.approx(0.02, rel=1e-3)
    assert np.abs(np.diff(found.t) - 0.02).max() < 1e-4
    assert np.abs(found.t - sent).max() < 0.02
    assert not bunched(sent + 0.002 * rng.standard_normal(2000))
    lost = np.delete(received, slice(500, 900))
    assert evened(lost) is None or np.abs(evened(lost).t[:500] - sent[:500]).max() < 0.05


def test_only_the_stretch_to_use_gives_rows():
    found = raw_table([session()], replaced(use=(Use("dive", 5.0, 12.0), Use(None, 0.0, 1.0))))
    assert (found.frame["t"].min(), found.frame["t"].max()) == pytest.approx((5.0, 12.0))


@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "us"), (1e3, "ms"), (1e6, "us")])
def test_a_rate_that_no_vehicle_has_names_the_unit(factor, unit):
    log = session()
    log = SessionLog("dive", log.t * factor, log.columns)
    time = Time("clock", "ms" if factor < 1.0 else "s")
    expected = "s" if factor < 1.0 else unit
    with pytest.raises(DataError, match=f'set time.unit = "{expected}"'):
        raw_table([log], replaced(time=time))


def test_one_column_with_two_clocks_is_refused():
    with pytest.raises(DataError, match="say different things of its samples"):
        prepared([session()], replaced(rates=Rates(("u", "q", "r"), lag=0.1)))


def test_ardusub_mixes_demands_into_the_wrench_they_are_called():
    """By the bundled heavy BlueROV2, whose propellers all count the other way round."""
    known = vehicle.read(bundled("logs/rov.toml"))[0]
    demands = ("surge", "sway", "heave", "roll", "pitch", "yaw")
    mixer = Mixer(demands, preset="ardusub_vectored_6dof", directions=(-1,) * 8)
    wrench = configuration_matrix(known) @ matrix(mixer)
    assert (np.diag(wrench) > 0.0).all()
    cross = wrench - np.diag(np.diag(wrench))
    assert np.abs(cross[np.ix_([0, 1, 2, 5], [0, 1, 2, 5])]).max() < 0.25 * np.diag(wrench)[[0, 1, 2]].min()


def test_mixed_commands_stay_within_full_thrust_and_virtual_ones_as_they_are():
    rng = np.random.default_rng(0)
    demands = rng.uniform(-1.0, 1.0, (200, 4))
    names = ("surge", "sway", "heave", "yaw")
    for preset, count in (("ardusub_vectored", 6), ("ardusub_vectored_6dof", 8)):
        drive = mixed(Mixer(names, preset=preset), demands)
        assert drive.shape == (200, count)
        assert np.abs(drive).max() <= 1.0
    np.testing.assert_array_equal(mixed(Mixer(names), demands), demands)
    single = mixed(Mixer(("surge",), preset="ardusub_vectored"), np.array([[0.5]]))
    np.testing.assert_array_equal(single, [[-0.5, -0.5, 0.5, 0.5, 0.0, 0.0]])
