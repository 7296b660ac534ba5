"""Clocks that begin again or jump: a session ends there, and nothing of two dives is mixed."""

from __future__ import annotations

import io
from pathlib import Path

import log_writers as writers
import numpy as np
import polars as pl
import pytest

from hydro.core.errors import DataError
from hydro.io import log, logmap
from hydro.io.readers.clocks import Stamps, one_clock
from hydro.io.sessions import A_DAY, sessions

MAP = '[rates]\ncolumns = ["p", "q", "r"]\n[commands]\ncolumns = ["c"]\n'
TABLE = '[time]\ncolumn = "t"\n' + MAP
NONE = np.full(40, np.nan)
T = np.arange(40) * 0.1


def csv(t: np.ndarray, **columns: np.ndarray) -> log.Log:
    every = {name: columns.get(name, np.arange(len(t)) * 1.0) for name in "pqrc"}
    frame = pl.DataFrame({"t": t, **every}, nan_to_null=True)
    return log.read(io.BytesIO(frame.write_csv().encode()))


# Stamps of messages


def test_an_autopilot_that_restarts_begins_a_session_for_all_topics():
    """Stamps 60 s to 62 s, twice, received 600 s apart; another topic has no stamp."""
    stamped = np.r_[60.0 + T[:20], 60.0 + T[:20]]
    received = 1e9 + np.r_[T[:20], 600.0 + T[:20]] + 0.02
    slow = slice(0, None, 7)
    found = one_clock(
        [
            Stamps("a", received, stamped),
            Stamps("b", received[slow], stamped[slow]),
            Stamps("c", received, NONE),
        ]
    )
    np.testing.assert_allclose(found.times[0] - 1e9, np.r_[T[:20], 600.0 + T[:20]] + 0.02, atol=1e-6)
    np.testing.assert_allclose(found.times[1], found.times[0][slow], atol=1e-6)
    np.testing.assert_allclose(found.begins - 1e9, [600.02], atol=1e-6)
    assert "the clock of a, b begins again 600.00 s after" in found.notes[-1]


@pytest.mark.parametrize("back", [0.0, 5.0])
def test_a_restart_between_messages_whose_receipt_does_not_rise(back):
    """As in a damaged log, or with a coarse clock of receipt."""
    stamped = np.r_[600.0 + T[:20], 60.0 + T[:20]]
    received = 1e9 + np.r_[T[:20], T[19] - back + T[:20]]
    found = one_clock([Stamps("a", received, stamped), Stamps("b", received, NONE)])
    assert len(found.begins) == 1
    assert np.isfinite(np.concatenate(found.times)).all()
    assert (np.diff(found.times[0][:20]) > 0.0).all()


def test_a_restart_soon_after_a_long_run_is_no_overflow_of_microseconds():
    wraps = 2**32 / 1e6
    stamped = np.r_[3000.0 + T[:20], T[:20] + 5.0]
    received = 1e9 + np.r_[T[:20], 10.0 + T[:20]]
    assert len(one_clock([Stamps("a", received, stamped, wraps)]).begins) == 1
    over = np.r_[wraps - 2.0 + T[:20], T[:20]]
    found = one_clock([Stamps("a", 1e9 + T, over, wraps)])
    np.testing.assert_allclose(np.diff(found.times[0]), 0.1, atol=1e-6)
    assert not len(found.begins)


def test_single_wrong_stamps_and_late_links_are_no_restart():
    stamped = 1e9 + T
    stamped[[5, 20]] = [1e9 - 50.0, 1e9 + 5000.0]
    late = 1e9 + T + np.where(T > 2.0, 8.0, 0.0)
    assert not len(one_clock([Stamps("a", 1e9 + T, stamped), Stamps("b", late, 1e9 + T)]).begins)


def test_a_clock_that_is_set_to_true_time():
    """Stamps of 1970, then of the year of receipt."""
    stamped = np.where(T < 2.0, 40.0 + T, 1e9 + T)
    found = one_clock([Stamps("a", 1e9 + T, stamped)])
    np.testing.assert_allclose(found.times[0], 1e9 + T, atol=2e-3)
    assert len(found.begins) == 1


@pytest.mark.parametrize("form", ["bag", "mcap"])
def test_a_simulator_that_is_reset_within_a_recording(form, tmp_path: Path):
    """Receipt follows the simulator's time, so that both fall; the order in the file is all there is."""
    t = np.r_[0.5 + T, 0.5 + T]
    value = np.r_[np.zeros(40), np.ones(40)]
    kind = "std_msgs/msg/Float64"
    messages = [
        writers.Message(f"/{name}", kind if form == "bag" else "", round((at + extra) * 1e9), {"data": one})
        for at, one in zip(t, value, strict=True)
        for name, extra in (("p", 0.0), ("q", 0.0), ("r", 0.0), ("c", 0.01))
    ]
    path = tmp_path / f"log.{form}"
    writers.ros1(path, messages, {}, "LZ4") if form == "bag" else writers.json_mcap(path, messages)
    text = '[rates]\ncolumns = ["/p.data", "/q.data", "/r.data"]\n[commands]\ncolumns = ["/c.data"]\n'
    read = log.read(path)
    found = sessions(read, logmap.parse(text))
    assert [each.channel("/p.data").values.tolist() for each in found] == [[0.0] * 40, [1.0] * 40]
    for each in found:
        np.testing.assert_allclose(each.channel("/p.data").t, T, atol=1e-6)
        assert set(each.channel("/c.data").values) == {each.channel("/p.data").values[0]}
    assert any("the clock of receipt begins again" in note for note in read.notes)


# Tables


def test_a_table_whose_clock_begins_again_is_two_sessions():
    found = sessions(csv(np.r_[T, T + 0.05]), logmap.parse(TABLE))
    assert [(each.name, len(each.t)) for each in found] == [("log-1", 40), ("log-2", 40)]
    np.testing.assert_allclose(found[1].t, T, atol=1e-9)
    assert found[1].cut == "the clock goes back by 3.85 s and begins again"


def test_sensors_one_after_the_other_are_to_be_sorted():
    """The same time twice with other columns is one dive."""
    first = np.r_[T, NONE]
    with pytest.raises(DataError, match=r"goes backwards .* sort the log by time"):
        sessions(csv(np.r_[T, T], p=first, q=first, r=first, c=first[::-1]), logmap.parse(TABLE))


@pytest.mark.parametrize("jump", [365 * A_DAY, 20 * 365 * A_DAY, 30 * A_DAY])
def test_a_clock_that_jumps_by_days_to_years_is_cut_there(jump):
    found = sessions(csv(np.r_[T, T + 4.0 + jump]), logmap.parse(TABLE))
    assert [(each.name, len(each.t)) for each in found] == [("log-1", 40), ("log-2", 40)]
    assert found[1].cut.startswith("the clock jumps forward by ")
