"""A log in any convention is the raw table it was written from; gaps, rates, units of commands."""

from __future__ import annotations

import logs
import msgspec
import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings

from hydro.core.errors import DataError
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.importing import raw_table
from hydro.core.logs.logmap import LogMap


def session(log: pl.DataFrame, name: str = "dive") -> SessionLog:
    """A log whose clock is in seconds as numbers in memory."""
    numbers = {key: log[key].to_numpy().astype(float) for key in log.columns if log[key].dtype.is_numeric()}
    return SessionLog(name, numbers["clock"] - 5000.0, numbers)


def meaning(spec, **changes) -> LogMap:
    return msgspec.convert(spec | changes, LogMap)


def difference(found: pl.DataFrame, raw: pl.DataFrame) -> float:
    """Largest difference of two raw tables, row by row, angles by the short way."""
    apart = (found.select(logs.NAMES) - raw.select(logs.NAMES)).to_numpy()
    apart[:, 3:6] = np.angle(np.exp(1j * apart[:, 3:6]))
    commands = (found.select("cmd_1", "cmd_2") - raw.select("cmd_1", "cmd_2")).to_numpy()
    return max(np.abs(apart).max(), np.abs(commands).max())


@given(logs.conventions)
def test_every_convention_reads_back_as_the_raw_table(how):
    raw = logs.raw(4.0, 20.0)
    log, spec = logs.written(raw, logs.replace(how, time="s"))
    found = raw_table([session(log)], meaning(spec))
    assert found.frame.height == raw.height
    assert found.dt == 1 / 20
    np.testing.assert_allclose(found.frame["t"], raw["t"], atol=1e-9)
    assert difference(found.frame, raw) < 1e-9


@given(logs.conventions)
@settings(max_examples=20)
def test_another_rate_and_jitter_cost_no_more_than_straight_lines_between_samples(how):
    rng = np.random.default_rng(5)
    t = np.arange(400) / 50.0 + np.r_[0.0, rng.uniform(-2e-3, 2e-3, 399)]
    values = logs.motion(t)
    columns = dict(zip(logs.NAMES, values.T, strict=True))
    raw = pl.DataFrame({"session": ["dive"] * 400, "t": t, **columns, "cmd_1": 0.25, "cmd_2": -0.5})
    log, spec = logs.written(raw, logs.replace(how, time="s"))
    found = raw_table([session(log)], meaning(spec), rate=30.0)
    at = found.frame["t"].to_numpy()
    np.testing.assert_allclose(np.diff(at), 1 / 30, atol=1e-9)
    expected = dict(zip(logs.NAMES, logs.motion(at).T, strict=True))
    assert (
        difference(found.frame, pl.DataFrame({**expected, "cmd_1": 0.25, "cmd_2": [-0.5] * len(at)})) < 2e-3
    )


def of_different_rates(raw):
    """Its log with velocity at 5, position at 25 and commands at 2 Hz, and the map."""
    log, spec = logs.written(raw, logs.Convention())
    rows = pl.int_range(pl.len())
    log = log.with_columns(
        *(pl.when(rows % 10 == 3).then(pl.col(name)).alias(name) for name in ("v1", "v2", "v3")),
        *(pl.when(rows % 25 == 0).then(pl.col(name)).alias(name) for name in ("s1", "s2")),
        *(pl.when(rows % 2 == 1).then(pl.col(name)).alias(name) for name in ("east", "north", "up")),
    ).with_columns(pl.col(pl.Float64).fill_null(np.nan))
    return log, spec


def test_rows_between_the_samples_of_a_slower_sensor_are_null():
    raw = logs.raw(20.0, 50.0)
    log, spec = of_different_rates(raw)
    found = raw_table([session(log)], meaning(spec))
    assert found.frame.height > 980
    at = np.rint(found.frame["t"].to_numpy() * 50).astype(int)
    for names, there in (("xyz", at % 2 == 1), ("uvw", at % 10 == 3), ("pqr", at >= 0)):
        for name in names:
            np.testing.assert_array_equal(found.frame[name].is_not_null(), there)
            np.testing.assert_allclose(
                found.frame[name].to_numpy()[there], raw[name].to_numpy()[at[there]], atol=1e-9
            )
    filled = raw_table([session(log)], meaning(spec), fill=True).frame
    assert not sum(filled.null_count().row(0))
    assert filled.with_columns(
        pl.when(found.frame[name].is_not_null()).then(name).alias(name) for name in "xyzuvw"
    ).equals(found.frame)


def test_rows_come_as_fast_as_the_fastest_sensor_and_a_sample_goes_to_the_nearest():
    """Rates of turn at 50 Hz alone; position on a clock of its own."""
    t = np.arange(0.0, 20.0, 0.004)
    motion = pl.DataFrame(dict(zip(logs.NAMES, logs.motion(t).T, strict=True)))
    raw = pl.concat([pl.DataFrame({"t": t}), motion], how="horizontal")
    raw = raw.with_columns(session=pl.lit("dive"), cmd_1=0.25, cmd_2=-0.5)
    log, spec = logs.written(raw, logs.Convention())
    row = np.arange(len(t))
    own = {("g1", "g2", "g3"): row % 5 == 0, ("east", "north", "up"): row % 25 == 7}
    other = row % 50 == 0
    rare = {name: there for names, there in own.items() for name in names}
    log = log.with_columns(
        pl.when(pl.Series(rare.get(name, other))).then(name).otherwise(np.nan).alias(name)
        for name in log.columns
        if log[name].dtype == pl.Float64 and name not in ("clock", "s1", "s2")
    )
    found = raw_table([session(log)], meaning(spec))
    assert found.dt == pytest.approx(0.02)
    assert raw_table([session(log)], meaning(spec), fill=True).dt == pytest.approx(0.1)
    at = found.frame["t"].to_numpy()
    seen = found.frame["x"].is_not_null().to_numpy()
    samples = t[row % 25 == 7]
    samples = samples[(samples > at[0] - 1e-6) & (samples < at[-1] + 1e-6)]
    np.testing.assert_allclose(at[seen], at[0] + np.rint((samples - at[0]) / 0.02) * 0.02, atol=1e-9)
    true = logs.motion(at[seen])[:, :3]
    np.testing.assert_allclose(found.frame.select("x", "y", "z").to_numpy()[seen], true, atol=1e-3)


def test_sensors_of_different_rates_share_a_table_with_empty_cells():
    raw = logs.raw(20.0, 50.0)
    log, spec = of_different_rates(raw)
    found = raw_table([session(log)], meaning(spec), fill=True)
    assert found.dt == 1 / 50, "position and velocity are slower than attitude and rates: the rate of most"
    assert not found.gaps
    at = found.frame["t"].to_numpy()
    assert at[0] == pytest.approx(0.06), "the first Doppler velocity"
    true = logs.motion(at)
    apart = np.abs(found.frame.select(logs.NAMES).to_numpy() - true)
    apart[:, 3:6] = np.abs(np.angle(np.exp(1j * apart[:, 3:6])))
    assert apart[:, :6].max() < 1e-3
    assert apart[:, 6:9].max() < 0.01, "a second derivative of 2 m/s^3 over 0.2 s"
    held = raw.filter(pl.int_range(pl.len()) % 25 == 0)
    last = np.floor(at / 0.5 + 1e-9).astype(int)
    np.testing.assert_array_equal(found.frame["cmd_1"], held["cmd_1"].to_numpy()[last])


def test_nothing_is_interpolated_across_a_gap():
    raw = logs.raw(20.0, 50.0)
    log, spec = logs.written(raw, logs.Convention(attitude=("ENU", "FLU"), angles="deg"))
    stopped = ~raw["t"].is_between(8.0, 11.0)
    found = raw_table([session(log.filter(stopped))], meaning(spec))
    assert [(round(gap.start, 6), round(gap.stop, 6)) for gap in found.gaps] == [(7.98, 11.02)]
    assert difference(found.frame, raw.filter(stopped)) < 1e-9
    patient = raw_table(
        [session(log.filter(stopped))], meaning(spec, time={"column": "clock", "longest_step": 5})
    )
    assert not patient.gaps
    assert patient.frame.height == raw.height


def test_one_silent_sensor_leaves_rows_out_as_a_gap_of_the_whole_log_does():
    raw = logs.raw(20.0, 50.0)
    log, spec = logs.written(raw, logs.Convention())
    dead = raw["t"].is_between(5.0, 7.0)
    log = log.with_columns(pl.when(dead).then(np.nan).otherwise(pl.col("g2")).alias("g2"))
    found = raw_table([session(log)], meaning(spec))
    assert [(round(gap.start, 6), round(gap.stop, 6)) for gap in found.gaps] == [(4.98, 7.02)]


@pytest.mark.parametrize(
    ("unit", "scale", "pulses"),
    [
        ("percent", 100.0, {}),
        ("pwm", 400.0, {}),
        ("pwm", 500.0, {"pwm": {"min": 1000, "neutral": 1500, "max": 2000}}),
    ],
)
def test_units_of_commands_and_what_is_beyond_them(unit, scale, pulses):
    raw = logs.raw(2.0)
    log, spec = logs.written(raw, logs.Convention())
    rest = 1500.0 if unit == "pwm" else 0.0
    demand = np.where(raw["t"] < 1.0, 0.5, -1.2)
    log = log.with_columns(s1=rest + scale * demand)
    block = {"columns": [{"column": "s1", "reverse": True}, {"column": "s2", "scale": scale, "offset": rest}]}
    found = raw_table([session(log)], meaning(spec, commands={**block, "unit": unit, **pulses}))
    np.testing.assert_allclose(found.frame["cmd_1"], np.where(raw["t"] < 1.0, -0.5, 1.0), atol=1e-12)
    np.testing.assert_allclose(found.frame["cmd_2"], raw["cmd_2"], atol=1e-12)
    assert found.clipped == {"cmd_1": 50}


def test_pulse_widths_read_as_shares_are_refused():
    log, spec = logs.written(logs.raw(2.0), logs.Convention(commands="pwm"))
    with pytest.raises(DataError, match=r"column s1, the command of thruster 1, reaches 1\d\d\d.*'pwm'"):
        raw_table([session(log)], meaning(spec, commands={"columns": ["s1", "s2"]}))


def test_no_overlap_and_empty_columns_are_told():
    raw = logs.raw(4.0)
    log, spec = logs.written(raw, logs.Convention())
    early, late = raw["t"] < 2.0, raw["t"] >= 2.0
    parted = log.with_columns(
        pl.when(early).then(pl.col("v1")).otherwise(np.nan).alias("v1"),
        pl.when(late).then(pl.col("g1")).otherwise(np.nan).alias("g1"),
    )
    with pytest.raises(DataError, match="in no session do all columns have values at the same time"):
        raw_table([session(parted)], meaning(spec))
    with pytest.raises(DataError, match="column v2 has no number in any row"):
        raw_table([session(log.with_columns(v2=pl.lit(np.nan)))], meaning(spec))


def test_a_session_without_common_rows_is_left_out_and_named():
    raw = logs.raw(4.0)
    log, spec = logs.written(raw, logs.Convention())
    found = raw_table([session(log), session(log.head(1), "blip")], meaning(spec))
    assert found.left_out == ("blip",)
    assert found.frame["session"].unique().to_list() == ["dive"]


def test_a_quaternion_of_length_zero_is_refused():
    log, spec = logs.written(logs.raw(2.0), logs.Convention(angles="wxyz"))
    with pytest.raises(DataError, match="a quaternion of length 0 is no rotation"):
        raw_table([session(log.with_columns(q0=0.0, q1=0.0, q2=0.0, q3=0.0))], meaning(spec))


@pytest.mark.parametrize(
    ("blocks", "null"),
    [
        (("position", "attitude"), logs.NAMES[6:]),
        (("velocity", "attitude"), (*logs.NAMES[:3], *logs.NAMES[9:])),
        (("rates",), logs.NAMES[:9]),
    ],
)
def test_what_a_log_has_no_sensor_for_is_null(blocks, null):
    raw = logs.raw(4.0, 20.0)
    log, spec = logs.written(raw, logs.Convention())
    spec = {key: block for key, block in spec.items() if key in ("time", "session", "commands", *blocks)}
    found = raw_table([session(log)], meaning(spec)).frame
    nulls = {name for name in logs.NAMES if found[name].null_count() == found.height}
    assert nulls == set(null)
    rest = [name for name in logs.NAMES if name not in null]
    np.testing.assert_allclose(found.select(rest).to_numpy(), raw.select(rest).to_numpy(), atol=1e-9)


def test_a_depth_alone_is_no_position_at_the_origin():
    raw = logs.raw(4.0, 20.0)
    log, spec = logs.written(raw, logs.replace(logs.Convention(), depth="depth"))
    found = raw_table([session(log)], meaning(spec, position={"depth": "up"})).frame
    assert found["x"].null_count() == found["y"].null_count() == found.height
    np.testing.assert_allclose(found["z"], raw["z"], atol=1e-9)
