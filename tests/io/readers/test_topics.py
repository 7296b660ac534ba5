"""What `--topics` says of a log, and what several files of one dive become."""

from __future__ import annotations

import io
from pathlib import Path

import logs
import message_logs as written
import numpy as np
import polars as pl
import pytest

import hydro
from hydro import cli
from hydro.core.errors import DataError
from hydro.io import log_topics
from hydro.io.log import opened
from hydro.io.readers.clocks import Stamps, one_clock


@pytest.fixture(scope="module")
def raw() -> pl.DataFrame:
    return logs.raw(6.0, 20.0)


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert cli.main(["import", *map(str, arguments), "--topics"]) == 0
    return capsys.readouterr().out


# Topics


def test_topics_of_a_bag_with_types_counts_rates_fields_and_spans(raw, tmp_path, capsys):
    lines = told(capsys, written.ros1(raw, tmp_path / "dive.bag")).splitlines()
    assert lines[0].endswith("from 2023-11-14 22:13:20 UTC")
    assert "ROS 1 bag" in lines[0]
    (imu,) = (line.split() for line in lines if line.startswith("/imu"))
    assert imu == ["/imu", "sensor_msgs/msg/Imu", "120", "20", "Hz", "0.0", "to", "6.0", "s"]
    text = " ".join(" ".join(lines).split())
    assert "header.seq header.stamp orientation.x" in text
    assert "orientation_covariance[0..8]" in text
    assert "pose.covariance[0..35]" in text
    assert "data[0..1]" in text
    assert "not read: /note std_msgs/msg/String 120 messages: no numbers in it" in text
    assert "header.seq header.stamp height width is_bigendian step (and 3 not numeric)" in text


@pytest.mark.parametrize("name", written.WRITERS)
def test_every_column_that_topics_promise_can_be_read(name, raw, tmp_path, capsys):
    path = written.WRITERS[name][0](raw, tmp_path / name)
    out = told(capsys, path)
    assert str(path) in out.splitlines()[0]
    with opened(path) as file:
        header, frame = file.header(), file.read().frame
    assert set(header.frame.columns) == set(frame.columns)


def test_topics_of_mixed_mcap_dataflash_and_arrays(raw, tmp_path, capsys):
    out = told(capsys, written.blueos(raw, tmp_path / "b.mcap"))
    assert "not read: /proto    120 messages: protobuf encoding: only CDR, ROS 1 and JSON are read" in out
    assert "mavlink/1/1/ATTITUDE" in out
    out = told(capsys, written.dataflash(raw, tmp_path / "d.bin"))
    assert "XKF1[0]" in out
    assert "XKF1[1]" in out
    out = told(capsys, written.npz(raw, tmp_path / "a.npz"))
    assert "120 rows of 12 columns" in out
    assert "pose[0] pose[1]" in out


def test_ranges_of_indices():
    assert log_topics.ranges(["a", "b[0]", "b[1]", "c[0].x", "c[1].x", "d[2]"]) == [
        "a",
        "b[0..1]",
        "c[0..1].x",
        "d[2]",
    ]


# Clocks


def test_stamps_of_a_foreign_clock_are_moved_as_a_whole_and_keep_their_steps():
    t = np.arange(100) * 0.1
    rng = np.random.default_rng(0)
    late = [t + 1e9 + 0.02 + 0.05 * rng.random(100) for _ in range(3)]
    boot = Stamps("boot", late[0], t + 5.0)
    other = Stamps("boot2", late[1] + 0.1, t + 5.0)
    (a, b, c), notes, _ = one_clock([boot, other, Stamps("none", late[2], np.full(100, np.nan))])
    np.testing.assert_allclose(np.diff(a), 0.1, atol=1e-6)
    np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(c, late[2])
    assert len(notes) == 1
    assert notes[0].startswith("stamps of boot, boot2 are of another clock: moved by 9999999")


def test_near_stamps_stay_and_gaps_in_them_are_filled_by_receipt():
    received = np.array([10.0, 11.0, 12.0])
    (t,), notes, _ = one_clock([Stamps("a", received, np.array([9.9, np.nan, 11.9]))])
    assert (t.tolist(), notes) == ([9.9, 11.0, 11.9], [])


# Several files


def test_files_of_one_dive_that_overlap_are_merged_by_time(raw, tmp_path):
    """Navigation and commands in a CSV each, with one clock."""
    nav, drive = tmp_path / "nav.csv", tmp_path / "drive.csv"
    raw.drop("session", "cmd_1", "cmd_2").write_csv(nav)
    raw.select("t", "cmd_1", "cmd_2").write_csv(drive)
    whole, _ = hydro.import_log(_csv(raw))
    for files in ([nav, drive], [drive, nav]):
        frame, _ = hydro.import_log(files)
        assert frame["session"].n_unique() == 1
        assert frame.drop("session").equals(whole.drop("session"))


def _csv(raw: pl.DataFrame) -> io.BytesIO:
    return io.BytesIO(raw.drop("session").write_csv().encode())


def test_bags_one_after_the_other_are_sessions_named_by_file(raw, tmp_path):
    (tmp_path / "map.toml").write_text(written.ROS_MAP)
    later = raw.with_columns(pl.col("t") + 100.0)
    files = [written.ros1(later, tmp_path / "b.bag"), written.ros1(raw, tmp_path / "a.bag")]
    frame, _ = hydro.import_log(files, tmp_path / "map.toml", strict=True)
    assert frame["session"].unique(maintain_order=True).to_list() == ["a", "b"]
    np.testing.assert_allclose(frame.filter(session="a")["x"], frame.filter(session="b")["x"], atol=1e-6)


def test_two_runs_whose_clocks_begin_at_zero_are_two_sessions(raw, tmp_path):
    for name in ("one", "two"):
        raw.drop("session").write_csv(tmp_path / f"{name}.csv")
    frame, _ = hydro.import_log([tmp_path / "one.csv", tmp_path / "two.csv"])
    assert frame["session"].unique(maintain_order=True).to_list() == ["one", "two"]


def test_files_of_different_formats_make_one_dive(raw, tmp_path):
    commands = raw.select(pl.col("t") + written.BEGUN, "cmd_1", "cmd_2").rename(
        {"t": "time", "cmd_1": "c1", "cmd_2": "c2"}
    )
    commands.write_csv(tmp_path / "commands.csv")
    bag = written.ros1(raw, tmp_path / "nav.bag")
    text = written.ROS_MAP.replace('"/cmd.data[0]", "/cmd.data[1]"', '"c1", "c2"')
    (tmp_path / "map.toml").write_text(text)
    frame, _ = hydro.import_log([bag, tmp_path / "commands.csv"], tmp_path / "map.toml", strict=True)
    assert frame["session"].n_unique() == 1
    np.testing.assert_allclose(frame["cmd_2"][1:100], raw["cmd_2"][1:100], atol=1e-3)


def test_several_files_from_the_command_line_and_what_is_missing_in_all(raw, tmp_path, capsys):
    (tmp_path / "map.toml").write_text(written.ROS_MAP.replace("/cmd.data[0]", "/cmd.dota[0]"))
    files = [
        written.ros1(raw, tmp_path / "a.bag"),
        written.ros1(raw.with_columns(pl.col("t") + 9), tmp_path / "b.bag"),
    ]
    line = ["import", *map(str, files), "--map", str(tmp_path / "map.toml"), "-o", str(tmp_path / "raw")]
    assert cli.main(line) == 1
    error = capsys.readouterr().err
    assert (
        "a.bag and 1 more: no column is called /cmd.dota[0], which the map names in commands: did you mean"
        in error
    )
    (tmp_path / "map.toml").write_text(written.ROS_MAP)
    assert cli.main(line) == 0
    assert "in 2 sessions" in capsys.readouterr().err


def test_a_file_whose_time_goes_backwards_is_named(raw, tmp_path):
    raw.drop("session").write_csv(tmp_path / "a.csv")
    raw.drop("session").with_columns(pl.col("t").reverse()).write_csv(tmp_path / "b.csv")
    with pytest.raises(DataError, match=r"b.csv: column t goes backwards in 119 of 120 rows"):
        hydro.import_log([tmp_path / "a.csv", tmp_path / "b.csv"])


def test_rostopic_csvs_have_the_clocks_of_their_bag():
    text = "%time,field.header.stamp,field.x\n2000000000,1500000000,1.5\n3000000000,0,2.5\n"
    with opened(io.BytesIO(text.encode())) as file:
        frame = file.read().frame
    assert frame["time"].to_list() == [1.5, 3.0]
    assert frame["receive_time"].to_list() == [2.0, 3.0]


def test_a_real_dive_of_several_csvs(tmp_path):
    folder = Path(__file__).resolve().parents[4] / "shared" / "data" / "real" / "tauv" / "segments"
    if not folder.is_dir():
        pytest.skip("the shared recordings are not here")
    map_ = tmp_path / "map.toml"
    map_.write_text(
        'time.column = "time"\n'
        'position.columns = ["field.position.x", "field.position.y", "field.position.z"]\n'
        'attitude.columns = ["field.orientation.x", "field.orientation.y", "field.orientation.z"]\n'
        'velocity.columns = ["field.velocity.x", "field.velocity.y", "field.velocity.z"]\n'
        "commands.columns = ["
        + ", ".join(f'{{column = "field.force.{axis}", scale = 0.01}}' for axis in "xyz")
        + "]\n"
    )
    files = [folder / f"{kind}_{number}.csv" for number in (7, 1) for kind in ("wrench", "navigation_state")]
    frame, _ = hydro.import_log(files, map_)
    assert frame["session"].n_unique() == 2
    assert frame.group_by("session").len()["len"].min() > 300
