"""A known motion as other people's loggers write it, by their own libraries; and the maps that read it.

Each writer takes a raw table (NED, FRD) of one session and a path.  Stamps are exact, receipt comes
`LATE` after.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from scipy.spatial.transform import Rotation

BEGUN = 1_700_000_000
"""When the logs begin [s since 1970]."""
LATE = 0.03
"""Receipt after the stamp [s]; commands have no stamp and no delay."""
THRUSTER = "std_msgs/Header header\nfloat32[] setpoint\nfloat64 voltage\n"
"""A message type that no distribution has."""

ROS_MAP = """
[time]
column = "time"
[position]
columns = ["/odom.pose.pose.position.x", "/odom.pose.pose.position.y", "/odom.pose.pose.position.z"]
[attitude]
quaternion = ["/imu.orientation.x", "/imu.orientation.y", "/imu.orientation.z", "/imu.orientation.w"]
layout = "xyzw"
[velocity]
columns = ["/odom.twist.twist.linear.x", "/odom.twist.twist.linear.y", "/odom.twist.twist.linear.z"]
[rates]
columns = ["/imu.angular_velocity.x", "/imu.angular_velocity.y", "/imu.angular_velocity.z"]
[commands]
columns = ["/cmd.data[0]", "/cmd.data[1]"]
"""
JSON_MAP = """
[time]
column = "time"
[position]
columns = ["ahrs.position[0]", "ahrs.position[1]", "ahrs.position[2]"]
[attitude]
columns = ["mavlink/1/1/ATTITUDE.message.roll", "mavlink/1/1/ATTITUDE.message.pitch",
           "mavlink/1/1/ATTITUDE.message.yaw"]
[commands]
columns = ["/cmd.data[0]", "/cmd.data[1]"]
"""
DATAFLASH_MAP = """
[time]
column = "time"
[position]
columns = ["XKF1[0].PN", "XKF1[0].PE", "XKF1[0].PD"]
[attitude]
columns = ["ATT.Roll", "ATT.Pitch", "ATT.Yaw"]
unit = "deg"
[rates]
columns = ["IMU[0].GyrX", "IMU[0].GyrY", "IMU[0].GyrZ"]
[commands]
columns = ["RCOU.C1", "RCOU.C2"]
unit = "pwm"
"""
TLOG_MAP = """
[time]
column = "time"
[position]
columns = ["LOCAL_POSITION_NED.x", "LOCAL_POSITION_NED.y", "LOCAL_POSITION_NED.z"]
[attitude]
columns = ["ATTITUDE.roll", "ATTITUDE.pitch", "ATTITUDE.yaw"]
[rates]
columns = ["ATTITUDE.rollspeed", "ATTITUDE.pitchspeed", "ATTITUDE.yawspeed"]
[commands]
columns = ["SERVO_OUTPUT_RAW.servo1_raw", "SERVO_OUTPUT_RAW.servo2_raw"]
unit = "pwm"
"""
ULOG_MAP = """
[time]
column = "time"
[position]
columns = ["vehicle_local_position.x", "vehicle_local_position.y", "vehicle_local_position.z"]
[attitude]
quaternion = ["vehicle_attitude.q[0]", "vehicle_attitude.q[1]", "vehicle_attitude.q[2]",
              "vehicle_attitude.q[3]"]
[rates]
columns = ["vehicle_angular_velocity.xyz[0]", "vehicle_angular_velocity.xyz[1]",
           "vehicle_angular_velocity.xyz[2]"]
[commands]
columns = ["actuator_motors.control[0]", "actuator_motors.control[1]"]
"""
ARRAYS_MAP = """
[time]
column = "t"
[position]
columns = ["pose[0]", "pose[1]", "pose[2]"]
[attitude]
columns = ["pose[3]", "pose[4]", "pose[5]"]
[velocity]
columns = ["velocity[0]", "velocity[1]", "velocity[2]"]
[commands]
columns = ["cmd[0]", "cmd[1]"]
"""


def pose(raw: pl.DataFrame) -> np.ndarray:
    """x, y, z, phi, theta, psi of a raw table, (N, 6)."""
    return raw.select("x", "y", "z", "phi", "theta", "psi").to_numpy()


def pulses(raw: pl.DataFrame) -> np.ndarray:
    """Commands in whole microseconds, (N, 2)."""
    return np.round(1500.0 + 400.0 * raw.select("cmd_1", "cmd_2").to_numpy()).astype(int)


def ros_messages(
    raw: pl.DataFrame, types: Any, ros: int, stamps: bool = True
) -> list[tuple[str, str, int, Any]]:
    """Topic, type, time of receipt [ns] and message of every message that a ROS vehicle would log."""
    make = types.types
    header = {"seq": 0} if ros == 1 else {}
    empty = np.zeros(36)
    out = []
    turns = Rotation.from_euler("ZYX", pose(raw)[:, [5, 4, 3]]).as_quat()
    for row, turn in zip(raw.iter_rows(named=True), turns, strict=True):
        ns = BEGUN * 10**9 + round(row["t"] * 1e9)
        late = ns + round(LATE * 1e9)
        sec, nanosec = divmod(ns, 10**9) if stamps else (0, 0)
        stamp = make["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        head = make["std_msgs/msg/Header"](stamp=stamp, frame_id="odom", **header)
        vector, point = make["geometry_msgs/msg/Vector3"], make["geometry_msgs/msg/Point"]
        quaternion = make["geometry_msgs/msg/Quaternion"](*turn)
        spin = vector(row["p"], row["q"], row["r"])
        at = make["geometry_msgs/msg/Pose"](point(row["x"], row["y"], row["z"]), quaternion)
        twist = make["geometry_msgs/msg/Twist"](vector(row["u"], row["v"], row["w"]), spin)
        odom = make["nav_msgs/msg/Odometry"](
            head,
            "base",
            make["geometry_msgs/msg/PoseWithCovariance"](at, empty),
            make["geometry_msgs/msg/TwistWithCovariance"](twist, empty),
        )
        imu = make["sensor_msgs/msg/Imu"](
            head, quaternion, empty[:9], spin, empty[:9], vector(0, 0, 0), empty[:9]
        )
        layout = make["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        drive = make["std_msgs/msg/Float64MultiArray"](layout, np.array([row["cmd_1"], row["cmd_2"]]))
        out += [
            ("/odom", "nav_msgs/msg/Odometry", late, odom),
            ("/imu", "sensor_msgs/msg/Imu", late, imu),
            ("/cmd", "std_msgs/msg/Float64MultiArray", ns, drive),
            ("/note", "std_msgs/msg/String", ns, make["std_msgs/msg/String"]("all is well")),
        ]
        if len(out) % 40 == 4:
            picture = np.zeros(300, np.uint8)
            image = make["sensor_msgs/msg/Image"](head, 10, 10, "rgb8", 0, 30, picture)
            out.append(("/camera", "sensor_msgs/msg/Image", late, image))
    return out


def ros1(raw: pl.DataFrame, path: Path, stamps: bool = True, compression: str = "LZ4") -> Path:
    """A ROS 1 bag."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        links: dict[str, Any] = {}
        for topic, kind, ns, message in ros_messages(raw, types, 1, stamps):
            if topic not in links:
                links[topic] = writer.add_connection(topic, kind, typestore=types)
            writer.write(links[topic], ns, types.serialize_ros1(message, kind))
    return path


def ros2(raw: pl.DataFrame, path: Path, storage: str, stamps: bool = True) -> Path:
    """A ROS 2 recording, a folder with its metadata; `storage` is SQLITE3 or MCAP."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        links: dict[str, Any] = {}
        for topic, kind, ns, message in ros_messages(raw, types, 2, stamps):
            if topic not in links:
                links[topic] = writer.add_connection(topic, kind, typestore=types)
            writer.write(links[topic], ns, types.serialize_cdr(message, kind))
    return path


def custom(raw: pl.DataFrame, path: Path, folder: Path) -> Path:
    """A ROS 2 recording of an old layout, that describes no type, and the `.msg` file of its own type."""
    import sqlite3

    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    (folder / "auv_msgs" / "msg").mkdir(parents=True)
    (folder / "auv_msgs" / "msg" / "ThrusterState.msg").write_text(THRUSTER)
    types = get_typestore(Stores.LATEST)
    kind = "auv_msgs/msg/ThrusterState"
    types.register(get_types_from_msg(THRUSTER, kind))
    database = sqlite3.connect(path)
    database.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
        " offered_qos_profiles TEXT);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
    )
    database.execute("INSERT INTO topics VALUES (1, '/thrusters', ?, 'cdr', '')", (kind,))
    make = types.types
    for row in raw.iter_rows(named=True):
        ns = BEGUN * 10**9 + round(row["t"] * 1e9)
        head = make["std_msgs/msg/Header"](make["builtin_interfaces/msg/Time"](*divmod(ns, 10**9)), "")
        message = make[kind](head, np.array([row["cmd_1"], row["cmd_2"]], np.float32), 16.0)
        data = bytes(types.serialize_cdr(message, kind))
        database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", (ns, data))
    database.commit()
    database.close()
    return path


def blueos(raw: pl.DataFrame, path: Path) -> Path:
    """An MCAP with JSON channels beside CDR and one that nobody reads."""
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=4096)
        writer.start()
        plain = writer.register_schema("mavlink", "jsonschema", b'{"type": "object"}')
        kind = "std_msgs/msg/Float64MultiArray"
        text, _ = types.generate_msgdef(kind, ros_version=2)
        described = writer.register_schema(kind, "ros2msg", text.encode())
        attitude = writer.register_channel("mavlink/1/1/ATTITUDE", "json", plain)
        ahrs = writer.register_channel("ahrs", "json", 0)
        drive = writer.register_channel("/cmd", "cdr", described)
        other = writer.register_channel("/proto", "protobuf", 0)
        for row in raw.iter_rows(named=True):
            ns = BEGUN * 10**9 + round(row["t"] * 1e9)
            message = {
                "header": {"system_id": 1, "component_id": 1, "sequence": 3},
                "message": {"type": "ATTITUDE", "roll": row["phi"], "pitch": row["theta"], "yaw": row["psi"]},
            }
            sec, nanosec = divmod(ns, 10**9)
            place = {
                "header": {"stamp": {"sec": sec, "nanosec": nanosec}},
                "position": [row["x"], row["y"], row["z"]],
                "state": "ok",
            }
            layout = types.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
            both = types.types[kind](layout, np.array([row["cmd_1"], row["cmd_2"]]))
            late = ns + round(LATE * 1e9)
            for channel, log_time, data in (
                (attitude, ns, json.dumps(message).encode()),
                (ahrs, late, json.dumps(place).encode()),
                (drive, ns, bytes(types.serialize_cdr(both, kind))),
                (other, ns, b"\x08\x01"),
            ):
                writer.add_message(channel, log_time, data, log_time)
        writer.finish()
    return path


FORMATS = {
    "ATT": (133, "QccCf", "TimeUS,Roll,Pitch,Yaw,Alt"),
    "XKF1": (134, "QBfff", "TimeUS,C,PN,PE,PD"),
    "IMU": (135, "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ"),
    "RCOU": (136, "QHH", "TimeUS,C1,C2"),
    "MSG": (137, "QZ", "TimeUS,Message"),
    "PIDR": (138, "Qff", "TimeUS,P,I"),
}
"""DataFlash messages: number, format and columns, as their FMT messages say."""
_CODES = {"Q": "Q", "c": "h", "C": "H", "f": "f", "B": "B", "H": "H", "Z": "64s", "n": "4s", "N": "16s"}


def _packed(name: str, *values: Any) -> bytes:
    number, form, _ = FORMATS[name]
    return struct.pack(f"<BBB{''.join(_CODES[each] for each in form)}", 0xA3, 0x95, number, *values)


def dataflash(raw: pl.DataFrame, path: Path) -> Path:
    """An ArduPilot log, packed by its FMT messages: angles in centidegrees, two EKF cores."""
    parts = [
        struct.pack(
            "<BBBBB4s16s64s", 0xA3, 0x95, 0x80, 0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"
        )
    ]
    for name, (number, form, columns) in FORMATS.items():
        size = 3 + struct.calcsize("<" + "".join(_CODES[each] for each in form))
        parts.append(
            struct.pack(
                "<BBBBB4s16s64s",
                0xA3,
                0x95,
                0x80,
                number,
                size,
                name.encode(),
                form.encode(),
                columns.encode(),
            )
        )
    drives = pulses(raw)
    parts.append(_packed("MSG", 0, b"ArduSub V4.1"))
    for row, drive in zip(raw.iter_rows(named=True), drives, strict=True):
        us = round(row["t"] * 1e6) + 5_000_000
        roll, pitch = (round(np.degrees(row[name]) * 100) for name in ("phi", "theta"))
        yaw = round((np.degrees(row["psi"]) % 360.0) * 100) % 36000
        parts += [
            _packed("ATT", us, roll, pitch, yaw, 0.0),
            _packed("XKF1", us, 0, row["x"], row["y"], row["z"]),
            _packed("XKF1", us, 1, row["x"] + 50.0, row["y"], row["z"]),
            _packed("IMU", us, 0, row["p"], row["q"], row["r"]),
            _packed("RCOU", us, *(int(each) for each in drive)),
            _packed("PIDR", us, 0.25, 0.5),
        ]
    path.write_bytes(b"".join(parts))
    return path


def tlog(raw: pl.DataFrame, path: Path, begun_ms: int = 60_000) -> Path:
    """A telemetry log: received in bursts of five, stamped by the autopilot since its start."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    ground = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    with path.open("wb") as file:
        rows = list(zip(raw.iter_rows(named=True), pulses(raw), strict=True))
        for number, (row, drive) in enumerate(rows):
            ms = begun_ms + round(row["t"] * 1e3)
            burst = rows[min(number // 5 * 5 + 4, len(rows) - 1)][0]["t"]
            received = struct.pack(">Q", BEGUN * 10**6 + round((burst + LATE) * 1e6))
            servo = [int(each) for each in drive] + [0] * 6
            for message in (
                mavlink.MAVLink_attitude_message(
                    ms, *(row[n] for n in ("phi", "theta", "psi", "p", "q", "r"))
                ),
                mavlink.MAVLink_local_position_ned_message(ms, *(row[n] for n in ("x", "y", "z")), 0, 0, 0),
                mavlink.MAVLink_servo_output_raw_message(ms * 1000 % 2**32, 0, *servo),
                mavlink.MAVLink_named_value_float_message(ms, b"Lights", 0.5),
            ):
                file.write(received + message.pack(link))
            file.write(received + mavlink.MAVLink_heartbeat_message(12, 3, 0, 0, 4, 3).pack(link))
            file.write(received + mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(ground))
    return path


def dataflash_text(raw: pl.DataFrame, path: Path) -> Path:
    """The same log as the text that Mission Planner makes of it."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    for name, (number, form, columns) in FORMATS.items():
        lines.append(f"FMT, {number}, 50, {name}, {form}, {columns}")
    lines.append("MSG, 0, ArduSub V4.1")
    for row, drive in zip(raw.iter_rows(named=True), pulses(raw), strict=True):
        us = round(row["t"] * 1e6) + 5_000_000
        roll, pitch, yaw = (np.degrees(row[name]) for name in ("phi", "theta", "psi"))
        lines += [
            f"ATT, {us}, {roll:.6f}, {pitch:.6f}, {yaw % 360.0:.6f}, 0",
            f"XKF1, {us}, 0, {row['x']:.8f}, {row['y']:.8f}, {row['z']:.8f}",
            f"XKF1, {us}, 1, {row['x'] + 50.0:.8f}, {row['y']:.8f}, {row['z']:.8f}",
            f"IMU, {us}, 0, {row['p']:.8f}, {row['q']:.8f}, {row['r']:.8f}",
            f"RCOU, {us}, {drive[0]}, {drive[1]}",
        ]
    path.write_text("\n".join(lines) + "\n")
    return path


ULOG_FORMATS = {
    "vehicle_local_position": "uint64_t timestamp;double x;double y;double z;",
    "vehicle_attitude": "uint64_t timestamp;double[4] q;",
    "vehicle_angular_velocity": "uint64_t timestamp;float[3] xyz;uint8_t[4] _padding0;",
    "actuator_motors": "uint64_t timestamp;float[12] control;",
}
"""Topics of PX4 and their fields."""


def ulog(raw: pl.DataFrame, path: Path) -> Path:
    """A PX4 log whose position was subscribed to twice, each time for half of the log; a second battery."""

    def message(letter: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(letter)) + body

    def subscribed(number: int, name: str, instance: int = 0) -> bytes:
        return message("A", struct.pack("<BH", instance, number) + name.encode())

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 5_000_000), message("B", bytes(40))]
    parts += [message("F", f"{name}:{fields}".encode()) for name, fields in ULOG_FORMATS.items()]
    parts.append(message("F", b"battery_status:uint64_t timestamp;float voltage_v;"))
    parts += [subscribed(number, name) for number, name in enumerate(ULOG_FORMATS)]
    parts += [subscribed(7, "battery_status"), subscribed(8, "battery_status", 1)]
    turns = Rotation.from_euler("ZYX", pose(raw)[:, [5, 4, 3]]).as_quat()[:, [3, 0, 1, 2]]
    for place, (row, turn) in enumerate(zip(raw.iter_rows(named=True), turns, strict=True)):
        at = struct.pack("<Q", round(row["t"] * 1e6) + 5_000_000)
        first = place < raw.height // 2
        if place == raw.height // 2:
            parts += [message("R", struct.pack("<H", 0)), subscribed(9, "vehicle_local_position")]
        motors = [row["cmd_1"], row["cmd_2"], *[float("nan")] * 10]
        for number, body in (
            (0 if first else 9, struct.pack("<3d", row["x"], row["y"], row["z"])),
            (1, struct.pack("<4d", *turn)),
            (2, struct.pack("<3f", row["p"], row["q"], row["r"])),
            (3, struct.pack("<12f", *motors)),
            (7, struct.pack("<f", 16.0)),
            (8, struct.pack("<f", 12.0)),
        ):
            parts.append(message("D", struct.pack("<H", number) + at + body))
    path.write_bytes(b"".join(parts))
    return path


def arrays(raw: pl.DataFrame) -> dict[str, np.ndarray]:
    """The columns as arrays, as a notebook would save them."""
    return {
        "t": raw["t"].to_numpy(),
        "pose": pose(raw),
        "velocity": raw.select("u", "v", "w").to_numpy().T,
        "cmd": raw.select("cmd_1", "cmd_2").to_numpy(),
        "gain": np.array(3.0),
    }


def npz(raw: pl.DataFrame, path: Path) -> Path:
    """A numpy archive, with an array of text in it."""
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays(raw), names=np.array(["a", "b"]))
    return path


def mat(raw: pl.DataFrame, path: Path) -> Path:
    """A MATLAB file of version 5."""
    from scipy.io import savemat

    savemat(path, arrays(raw), appendmat=False, do_compression=True)
    return path


WRITERS: dict[str, tuple[Callable[[pl.DataFrame, Path], Path], str]] = {
    "ros1.bag": (ros1, ROS_MAP),
    "ros2.mcap": (lambda raw, path: _one(ros2(raw, path.with_suffix(""), "MCAP"), "*.mcap"), ROS_MAP),
    "ros2.db3": (lambda raw, path: _one(ros2(raw, path.with_suffix(".folder"), "SQLITE3"), "*.db3"), ROS_MAP),
    "blueos.mcap": (blueos, JSON_MAP),
    "dive.bin": (dataflash, DATAFLASH_MAP),
    "dive.log": (dataflash_text, DATAFLASH_MAP),
    "dive.ulg": (ulog, ULOG_MAP),
    "dive.tlog": (tlog, TLOG_MAP),
    "dive.npz": (npz, ARRAYS_MAP),
    "dive.mat": (mat, ARRAYS_MAP),
}
"""Every format, by a file's name: what writes it and the map that reads it."""


def _one(folder: Path, pattern: str) -> Path:
    """The only file of a recording's folder."""
    (file,) = folder.glob(pattern)
    return file
