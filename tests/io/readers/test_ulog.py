"""PX4's ULog: topics in slices, several instances, and what its logger lost."""

from __future__ import annotations

import struct
from pathlib import Path

import logs
import message_logs as written
import numpy as np
import polars as pl
import pytest

from hydro.core.errors import DataError
from hydro.io import log


@pytest.fixture(scope="module")
def raw() -> pl.DataFrame:
    return logs.raw(6.0, 20.0)


def test_a_topic_in_two_slices_is_one_and_instances_are_numbered(raw, tmp_path: Path):
    frame = log.read(written.ulog(raw, tmp_path / "dive.ulg")).frame
    np.testing.assert_array_equal(frame["vehicle_local_position.z"].drop_nulls(), raw["z"])
    t = frame.filter(pl.col("vehicle_local_position.z").is_not_null())["time"]
    np.testing.assert_allclose(t - 5.0, raw["t"], rtol=0, atol=1e-6)
    assert frame["battery_status.voltage_v"].drop_nulls().unique().to_list() == [16.0]
    assert frame["battery_status[1].voltage_v"].drop_nulls().unique().to_list() == [12.0]
    np.testing.assert_allclose(frame["actuator_motors.control[1]"].drop_nulls(), raw["cmd_2"], atol=1e-7)


def test_only_wanted_topics_are_read(raw, tmp_path: Path):
    frame = log.read(written.ulog(raw, tmp_path / "dive.ulg"), ["battery_status[1].voltage_v"]).frame
    assert frame.columns == ["time", "receive_time", "battery_status[1].voltage_v"]


def test_dropouts_are_told(raw, tmp_path: Path):
    path = written.ulog(raw, tmp_path / "dive.ulg")
    with path.open("ab") as file:
        file.write(struct.pack("<HBH", 2, ord("O"), 120) + struct.pack("<HBH", 2, ord("O"), 80))
    assert "the logger lost data 2 times, 0.2 s in all" in log.read(path).notes


def test_a_log_without_data_is_one_line(tmp_path: Path):
    path = tmp_path / "dive.ulg"
    path.write_bytes(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0))
    with pytest.raises(DataError, match="no message with data in this ULog"):
        log.read(path)
