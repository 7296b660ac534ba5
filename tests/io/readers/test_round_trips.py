"""Every format written with its own library and read back: numbers to half a unit, and times."""

from __future__ import annotations

import io
from pathlib import Path

import logs
import message_logs as written
import numpy as np
import polars as pl
import pytest
from scipy.spatial.transform import Rotation

import hydro
from hydro.core.errors import DataError
from hydro.io import log

RATE = 20.0


@pytest.fixture(scope="module")
def raw() -> pl.DataFrame:
    return logs.raw(6.0, RATE)


@pytest.fixture(scope="module")
def files(raw: pl.DataFrame, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("logs")
    return {name: write(raw, folder / name) for name, (write, _) in written.WRITERS.items()}


def column(frame: pl.DataFrame, name: str) -> np.ndarray:
    return frame[name].drop_nulls().to_numpy()


def times(frame: pl.DataFrame, name: str, clock: str = "time") -> np.ndarray:
    return frame.filter(pl.col(name).is_not_null())[clock].to_numpy()


def quaternions(raw: pl.DataFrame) -> np.ndarray:
    return Rotation.from_euler("ZYX", written.pose(raw)[:, [5, 4, 3]]).as_quat()


# What stands in the file stands in the table


@pytest.mark.parametrize("name", ["ros1.bag", "ros2.mcap", "ros2.db3"])
def test_ros_messages_are_exact_and_timed_by_their_stamps(name, raw, files):
    frame = log.read(files[name]).frame
    for axis in "xyz":
        np.testing.assert_array_equal(column(frame, f"/odom.pose.pose.position.{axis}"), raw[axis])
    for part, values in zip("xyzw", quaternions(raw).T, strict=True):
        np.testing.assert_array_equal(column(frame, f"/imu.orientation.{part}"), values)
    np.testing.assert_array_equal(column(frame, "/cmd.data[1]"), raw["cmd_2"])
    t = written.BEGUN + raw["t"].to_numpy()
    np.testing.assert_allclose(times(frame, "/imu.orientation.x"), t, rtol=0, atol=5e-7)
    np.testing.assert_allclose(times(frame, "/cmd.data[0]"), t, rtol=0, atol=5e-7)
    received = times(frame, "/imu.orientation.x", "receive_time")
    np.testing.assert_allclose(received, t + written.LATE, rtol=0, atol=5e-7)
    assert not [each for each in frame.columns if "camera.data" in each or "note" in each]
    assert frame["time"].is_sorted()


def test_without_stamps_the_time_is_that_of_receipt(raw, tmp_path):
    frame = log.read(written.ros1(raw, tmp_path / "log.bag", stamps=False)).frame
    expected = written.BEGUN + raw["t"].to_numpy() + written.LATE
    np.testing.assert_allclose(times(frame, "/odom.pose.pose.position.x"), expected, rtol=0, atol=5e-7)


@pytest.mark.parametrize("compression", ["LZ4", "BZ2"])
@pytest.mark.parametrize("suffix", [".bag", ".csv", ""])
def test_the_first_bytes_tell_the_format_whatever_the_file_is_called(compression, suffix, raw, tmp_path):
    path = written.ros1(raw.head(3), tmp_path / f"log{suffix}", compression=compression)
    assert log.read(path, ["/cmd.data[0]"]).frame.height == 3


def test_a_stream_is_read_as_its_file_is(raw, files):
    name = "ros2.db3"
    wanted = ["/imu.orientation.x"]
    streamed = log.read(io.BytesIO(files[name].read_bytes()), wanted)
    assert streamed.frame.equals(log.read(files[name], wanted).frame)
    assert streamed.digest == log.read(files[name], wanted).digest


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_ros_2_recording_is_named_by_its_folder(storage, raw, tmp_path):
    folder = written.ros2(raw.head(5), tmp_path / "dive", storage)
    assert column(log.read(folder).frame, "/odom.pose.pose.position.x").tolist() == raw["x"].head(5).to_list()


def test_types_that_a_log_does_not_describe_come_from_msg_files(raw, tmp_path):
    path = written.custom(raw, tmp_path / "old.db3", tmp_path / "msgs")
    frame = log.read(path, definitions=tmp_path / "msgs").frame
    np.testing.assert_allclose(column(frame, "/thrusters.setpoint[1]"), raw["cmd_2"], atol=1e-7)
    with pytest.raises(DataError, match=r"/thrusters .* is not read: no definition of auv_msgs.* --msg DIR"):
        log.read(path, ["/thrusters.setpoint[1]"])


def test_json_and_cdr_stand_side_by_side(raw, files):
    frame = log.read(files["blueos.mcap"]).frame
    np.testing.assert_array_equal(column(frame, "mavlink/1/1/ATTITUDE.message.yaw"), raw["psi"])
    np.testing.assert_array_equal(column(frame, "ahrs.position[2]"), raw["z"])
    np.testing.assert_array_equal(column(frame, "/cmd.data[0]"), raw["cmd_1"])
    t = written.BEGUN + raw["t"].to_numpy()
    for name in ("ahrs.position[2]", "/cmd.data[0]"):
        np.testing.assert_allclose(times(frame, name), t, rtol=0, atol=5e-7)


def test_dataflash_in_the_units_of_its_messages(raw, files):
    frame = log.read(files["dive.bin"]).frame
    np.testing.assert_allclose(column(frame, "ATT.Roll"), np.degrees(raw["phi"]), rtol=0, atol=0.005001)
    for core, offset in ((0, 0.0), (1, 50.0)):
        expected = np.float32(raw["x"].to_numpy() + offset)
        np.testing.assert_array_equal(column(frame, f"XKF1[{core}].PN"), expected)
    np.testing.assert_array_equal(column(frame, "RCOU.C2"), written.pulses(raw)[:, 1])
    assert column(frame, "PIDR.I").tolist() == [0.5] * raw.height, "an integral, no instance"
    np.testing.assert_allclose(times(frame, "RCOU.C1"), 5.0 + raw["t"].to_numpy(), rtol=0, atol=1e-6)


@pytest.mark.parametrize("begun", [60_000, 4_294_966])
def test_telemetry_is_timed_by_the_autopilot_not_by_bursts(begun, raw, tmp_path):
    read = log.read(written.tlog(raw, tmp_path / "dive.tlog", begun))
    frame = read.frame
    for name, source in (("ATTITUDE.yaw", "psi"), ("LOCAL_POSITION_NED.z", "z")):
        np.testing.assert_array_equal(column(frame, name), np.float32(raw[source].to_numpy()))
    np.testing.assert_array_equal(column(frame, "SERVO_OUTPUT_RAW.servo1_raw"), written.pulses(raw)[:, 0])
    for name in ("ATTITUDE.yaw", "SERVO_OUTPUT_RAW.servo1_raw"):
        t = times(frame, name)
        np.testing.assert_allclose(t - t[0], raw["t"].to_numpy(), rtol=0, atol=1e-6)
        assert abs(t[0] - written.BEGUN) < 0.5
    assert column(frame, "NAMED_VALUE_FLOAT[Lights].value")[0] == 0.5
    assert {"HEARTBEAT.type", "HEARTBEAT@255.190.type"} <= set(frame.columns)
    assert any("are of another clock" in note for note in read.notes)


@pytest.mark.parametrize("name", ["dive.npz", "dive.mat"])
def test_arrays_are_columns_whichever_way_they_lie(name, raw, files):
    frame = log.read(files[name]).frame
    np.testing.assert_array_equal(frame["t"], raw["t"])
    np.testing.assert_array_equal(frame["pose[4]"], raw["theta"])
    np.testing.assert_array_equal(frame["velocity[2]"], raw["w"])
    assert "gain" not in frame.columns


def test_arrays_that_the_map_names_must_be_of_one_length(tmp_path):
    np.savez(tmp_path / "a.npz", t=np.arange(9.0), u=np.arange(9.0), psi=np.arange(4.0))
    assert log.read(tmp_path / "a.npz", ["t", "u"]).frame.shape == (9, 2)
    with pytest.raises(DataError, match="u has 9 and psi has 4 rows: name arrays of one length in the map"):
        log.read(tmp_path / "a.npz", ["u", "psi"])


def test_structs_of_matlab_are_columns_of_their_fields(raw, tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "s.mat", {"dvl": {"vx": raw["u"].to_numpy(), "deep": {"z": raw["z"].to_numpy()}}})
    frame = log.read(tmp_path / "s.mat").frame
    assert frame.columns == ["dvl.vx", "dvl.deep.z"]


# Only what is wanted


def test_only_wanted_topics_are_decoded(raw, files):
    frame = log.read(files["ros1.bag"], ["time", "/cmd.data[1]"]).frame
    assert frame.columns == ["time", "receive_time", "/cmd.data[1]"]
    assert frame.height == raw.height
    line = r"no column is called /cmd.dat\[1\], which the map names in commands: did you mean /cmd.data\[1"
    with pytest.raises(DataError, match=line):
        log.numbers(log.read(files["ros1.bag"], ["/cmd.dat[1]"]), "/cmd.dat[1]", "commands")


# The whole way


@pytest.mark.parametrize("name", written.WRITERS)
def test_a_recording_survives_the_way_through_every_format(name, raw, files, tmp_path):
    map_ = tmp_path / "map.toml"
    map_.write_text(written.WRITERS[name][1])
    frame, report = hydro.import_log(files[name], map_, strict=True)
    assert frame["session"].unique().to_list() == [files[name].stem]
    assert report.imported.dt == pytest.approx(1.0 / RATE)
    shift = round((frame.height - raw.height) * -1)
    assert 0 <= shift <= 1, "stamped sensors and commands by receipt share all rows but one"
    apart = np.abs(np.angle(np.exp(1j * (frame["psi"] - raw["psi"][: frame.height]).to_numpy())))
    assert apart.max() < {"dive.bin": 2e-4}.get(name, 1e-5 if "tlog" in name else 1e-6) + 1e-6 * 2
    for axis in "xyz":
        np.testing.assert_allclose(frame[axis], raw[axis][: frame.height], rtol=0, atol=2e-6)
