"""Commands that mean "stop": NaN, and pulses of width 0; empty cells still hold the last one."""

from __future__ import annotations

import io
from pathlib import Path

import log_writers as writers
import numpy as np
import polars as pl
import pytest

from hydro.core.logs.importing import Imported, raw_table
from hydro.io import log, logmap
from hydro.io.sessions import sessions

T = np.arange(100) * 0.05
MAP = '[time]\ncolumn = "t"\n[rates]\ncolumns = ["p", "q", "r"]\n[commands]\ncolumns = ["c", "d"]\n'


def imported(changes: str = "", **columns: object) -> Imported:
    frame = pl.DataFrame({"t": T, **dict.fromkeys("pqr", np.sin(T)), "d": np.full(100, 0.25), **columns})
    read = log.read(io.BytesIO(frame.write_csv().encode()))
    meaning = logmap.parse(MAP + changes)
    return raw_table(sessions(read, meaning), meaning)


def sometimes(value: float | None, start: int = 40, stop: int = 80) -> pl.Series:
    return pl.Series([0.5] * start + [value] * (stop - start) + [-0.5] * (100 - stop), dtype=pl.Float64)


def test_nan_is_no_thrust_and_said():
    found = imported(c=sometimes(np.nan))
    np.testing.assert_allclose(found.frame["cmd_1"], sometimes(0.0))
    assert found.notes[-1].startswith("commands: 40 samples of NaN or a pulse width of 0 are no thrust")
    assert (found.frame["cmd_2"] == 0.25).all()


def test_nan_before_the_first_command_and_after_the_last():
    values = pl.Series([np.nan] * 30 + [0.5] * 40 + [np.nan] * 30)
    frame = imported(c=values).frame
    assert frame.height == 100
    np.testing.assert_allclose(frame["cmd_1"], values.fill_nan(0.0))


def test_an_empty_cell_holds_the_last_command():
    found = imported(c=sometimes(None))
    np.testing.assert_allclose(found.frame["cmd_1"], [0.5] * 80 + [-0.5] * 20)
    assert not found.notes


def test_the_map_may_say_that_nan_holds():
    found = imported('off = "hold"', c=sometimes(np.nan))
    np.testing.assert_allclose(found.frame["cmd_1"], [0.5] * 80 + [-0.5] * 20)


def test_nan_between_the_samples_of_a_slow_topic_is_an_empty_cell():
    """Sensors of several rates that were put side by side: every fourth row has a command."""
    values = pl.Series(np.where(np.arange(100) % 4 == 0, 0.5, np.nan))
    assert (imported(c=values).frame["cmd_1"].head(97) == 0.5).all()


@pytest.mark.parametrize("key", ["", "pwm = {min = 1000, neutral = 1400, max = 1800}"])
def test_a_pulse_of_width_0_is_no_thrust(key):
    rest = 1400 if key else 1500
    values = pl.Series([0] * 30 + [rest + 200] * 40 + [0] * 30)
    found = imported(f'unit = "pwm"\n{key}', c=values, d=np.full(100, rest))
    np.testing.assert_allclose(found.frame["cmd_1"], [0.0] * 30 + [0.5] * 40 + [0.0] * 30)
    assert found.frame.height == 100


def test_a_sample_that_the_map_excludes_is_no_stop():
    values = pl.Series([1700] * 50 + [0] * 50)
    found = imported('unit = "pwm"\nvalid = {not = 0}', c=values, d=np.full(100, 1500))
    np.testing.assert_allclose(found.frame["cmd_1"], 0.5)


def test_outputs_that_are_always_off_are_named():
    found = imported('unit = "pwm"', c=np.full(100, 1600), d=np.zeros(100))
    assert "commands: d never drive a thruster" in found.notes[-1]
    assert (found.frame["cmd_2"] == 0.0).all()


def test_nan_in_messages_is_no_thrust_but_the_silence_of_one_of_two_topics_is_not(tmp_path: Path):
    """Each thruster has a topic; the second is sent at changes alone, and holds."""
    kind = "std_msgs/msg/Float64"
    messages = []
    for place, at in enumerate(T):
        ns = round((1e9 + at) * 1e9)
        messages += [writers.Message(f"/{name}", kind, ns, {"data": np.sin(at)}) for name in "pqr"]
        messages.append(writers.Message("/c", kind, ns, {"data": np.nan if 40 <= place < 80 else 0.5}))
        if place < 20 or place > 90:
            messages.append(writers.Message("/d", kind, ns, {"data": 0.25}))
    read = log.read(writers.ros1(tmp_path / "log.bag", messages, {}, "LZ4"))
    text = (
        '[rates]\ncolumns = ["/p.data", "/q.data", "/r.data"]\n[commands]\ncolumns = ["/c.data", "/d.data"]\n'
    )
    frame = raw_table(sessions(read, logmap.parse(text)), logmap.parse(text)).frame
    np.testing.assert_allclose(frame["cmd_1"][1:99], np.where((T >= 2.0) & (T < 4.0), 0.0, 0.5)[1:99])
    assert (frame["cmd_2"] == 0.25).all()
