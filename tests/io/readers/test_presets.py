"""Logs with the topics and fields of PX4 and of Stonefish are read without a map."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import log_writers
import logs
import numpy as np
import polars as pl
import pytest
from log_writers import Message
from scipy.spatial.transform import Rotation

import hydro
from hydro.core.guessing.presets import preset_blocks
from hydro.io import log

BEGUN = 1_700_000_000 * 10**9
MOTORS = 8
PX4 = {
    "px4_msgs/msg/VehicleLocalPosition": (
        "uint64 timestamp\nuint64 timestamp_sample\nbool xy_valid\nbool z_valid\n"
        "float32 x\nfloat32 y\nfloat32 z\nfloat32 vx\nfloat32 vy\nfloat32 vz\nfloat32 heading\n"
    ),
    "px4_msgs/msg/VehicleAttitude": (
        "uint64 timestamp\nuint64 timestamp_sample\nfloat32[4] q\nfloat32[4] delta_q_reset\n"
        "uint8 quat_reset_counter\n"
    ),
    "px4_msgs/msg/VehicleAngularVelocity": (
        "uint64 timestamp\nuint64 timestamp_sample\nfloat32[3] xyz\nfloat32[3] xyz_derivative\n"
    ),
    "px4_msgs/msg/ActuatorMotors": (
        "uint64 timestamp\nuint64 timestamp_sample\nuint16 reversible_flags\nfloat32[12] control\n"
    ),
}
STONEFISH = {
    "stonefish_ros/msg/ThrusterState": (
        "std_msgs/Header header\nfloat64[] setpoint\nfloat64[] rpm\nfloat64[] thrust\nfloat64[] torque\n"
    )
}


@pytest.fixture(scope="module")
def raw() -> pl.DataFrame:
    one = logs.raw(20.0, 50.0, noise=logs.ORDINARY)
    more = {f"cmd_{i + 1}": (0.9 - 0.1 * i) * one[f"cmd_{i % 2 + 1}"] for i in range(2, MOTORS)}
    return one.with_columns(**more)


def commands(row: dict[str, float]) -> list[float]:
    return [row[f"cmd_{i + 1}"] for i in range(MOTORS)]


def px4(raw: pl.DataFrame) -> Iterator[Message]:
    """Topics of the bridge to ROS 2: NED and FRD, quaternions with w first, unused motors NaN."""
    turns = Rotation.from_euler("ZYX", raw.select("psi", "theta", "phi").to_numpy())
    world = turns.apply(raw.select("u", "v", "w").to_numpy())
    for row, turn, speed in zip(raw.iter_rows(named=True), turns, world, strict=True):
        ns, us = BEGUN + round(row["t"] * 1e9), {"timestamp": round(row["t"] * 1e6) + 9_000_000}
        x, y, z, w = turn.as_quat()
        place = {name: row[name] for name in "xyz"} | dict(zip(("vx", "vy", "vz"), speed, strict=True))
        controls = [*commands(row), *[np.nan] * 4]
        for name, content in (
            ("VehicleLocalPosition", {**us, **place, "heading": row["psi"]}),
            ("VehicleAttitude", {**us, "q": [w, x, y, z]}),
            ("VehicleAngularVelocity", {**us, "xyz": [row[name] for name in "pqr"]}),
            ("ActuatorMotors", {**us, "control": controls}),
        ):
            topic = "".join(f"_{each.lower()}" if each.isupper() else each for each in name)
            yield Message(f"/fmu/out/{topic[1:]}", f"px4_msgs/msg/{name}", ns, content)


def stonefish(raw: pl.DataFrame) -> Iterator[Message]:
    """Topics of the simulator's ROS package: NED and FRD, setpoints of the thrusters from -1 to 1."""
    turns = Rotation.from_euler("ZYX", raw.select("psi", "theta", "phi").to_numpy()).as_quat()
    for row, turn in zip(raw.iter_rows(named=True), turns, strict=True):
        ns = BEGUN + round(row["t"] * 1e9)
        head = {"stamp": ns, "frame_id": "world_ned"}
        vector = [dict(zip("xyz", [row[name] for name in part], strict=True)) for part in ("uvw", "pqr")]
        place = {"position": {name: row[name] for name in "xyz"}}
        place["orientation"] = dict(zip("xyzw", turn, strict=True))
        odometry = {
            "header": head,
            "pose": {"pose": place},
            "twist": {"twist": {"linear": vector[0], "angular": vector[1]}},
        }
        yield Message("/auv/odometry", "nav_msgs/msg/Odometry", ns, odometry)
        state = {"header": head, "setpoint": commands(row), "thrust": [0.0] * MOTORS}
        yield Message("/auv/thruster_state", "stonefish_ros/msg/ThrusterState", ns, state)


def written(name: str, raw: pl.DataFrame, folder: Path) -> Path:
    if name == "px4":
        return log_writers.ros2(folder / "px4", px4(raw), PX4, "MCAP")
    return log_writers.ros1(folder / "stonefish.bag", stonefish(raw), STONEFISH, "LZ4")


@pytest.mark.parametrize("name", ["px4", "stonefish"])
def test_a_log_is_known_by_its_names_and_read_whole(name: str, raw: pl.DataFrame, tmp_path: Path) -> None:
    path = written(name, raw, tmp_path)
    with log.opened(path) as file:
        known, blocks = preset_blocks(file.header().frame.columns)
    assert known == name
    assert set(blocks) == {"position", "attitude", "velocity", "rates", "commands"}
    frame, report = hydro.import_log(path, strict=True)
    assert not report.verdict.contradictions
    rows = frame.height
    assert rows >= raw.height - 1
    for column in (*"xyzuvwpqr", "phi", "theta", "psi", "cmd_1", "cmd_8"):
        apart = frame[column].to_numpy() - raw[column].to_numpy()[:rows]
        apart = np.angle(np.exp(1j * apart)) if column in ("phi", "psi") else apart
        assert np.abs(apart).max() < 1e-5, column
