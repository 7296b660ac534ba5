"""Messages that do not fit, have no definition, or are compressed one by one: never the end of a log."""

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import zstandard

from hydro import cli
from hydro.core.errors import DataError
from hydro.io import log

SECOND = 10**9
BEGUN = 1_700_000_000


def db3(path: Path, topics: dict[str, tuple[str, Sequence[bytes]]]) -> Path:
    """Write a ROS 2 recording of Humble or before, which describes no type: ten messages a second."""
    database = sqlite3.connect(path)
    database.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
        " offered_qos_profiles TEXT);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);"
    )
    for number, (name, (kind, messages)) in enumerate(topics.items(), 1):
        database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (number, name, kind))
        for place, data in enumerate(messages):
            ns = BEGUN * SECOND + place * SECOND // 10
            database.execute("INSERT INTO messages VALUES (NULL, ?, ?, ?)", (number, ns, data))
    database.commit()
    database.close()
    return path


CDR = b"\x00\x01\x00\x00"


def packed(*fields: tuple[str, object]) -> bytes:
    """Return a message of CDR: numbers by their letter of `struct`, each aligned to its size; "s" is text."""
    out = b""
    for letter, value in fields:
        for each in np.atleast_1d(value).tolist():
            if letter == "s":
                text = str(each).encode() + b"\0"
                out += bytes(-len(out) % 4) + struct.pack("<I", len(text)) + text
            else:
                out += bytes(-len(out) % struct.calcsize(letter)) + struct.pack(f"<{letter}", each)
    return CDR + out


def header(place: int) -> tuple[tuple[str, object], ...]:
    """Return the fields of a std_msgs/Header."""
    return ("i", BEGUN), ("I", place * SECOND // 10), ("s", "b")


def floats(count: int = 5) -> list[bytes]:
    return [packed(("d", 0.5 * place)) for place in range(count)]


def test_a_topic_whose_messages_do_not_fit_is_told_and_the_others_are_read(tmp_path, capsys):
    path = db3(
        tmp_path / "log.db3",
        {"/cmd": ("std_msgs/msg/Float64", floats()), "/odd": ("sensor_msgs/msg/Range", [CDR + b"abc"] * 5)},
    )
    assert cli.main(["import", str(path), "--topics"]) == 0
    said = capsys.readouterr().out
    assert "not read: /odd  sensor_msgs/msg/Range  5 messages: its messages do not fit the definition" in said
    np.testing.assert_array_equal(log.read(path).frame["/cmd.data"], [0.0, 0.5, 1.0, 1.5, 2.0])
    with pytest.raises(
        DataError, match=r"/odd \(sensor_msgs/msg/Range\) is not read: its messages do not fit"
    ):
        log.read(path, ["/odd.range"])


def test_single_messages_that_do_not_fit_are_left_out_and_counted(tmp_path):
    messages = floats()
    messages[2] = CDR + b"ab"
    found = log.read(db3(tmp_path / "log.db3", {"/cmd": ("std_msgs/msg/Float64", messages)}))
    np.testing.assert_array_equal(found.frame["/cmd.data"], [0.0, 0.5, 1.5, 2.0])
    assert found.notes == ("/cmd: 1 of 5 messages cannot be decoded and are left out",)


def test_a_type_of_an_older_distribution(tmp_path):
    """The Range of Humble ends without the variance that Jazzy's has."""
    messages = [packed(*header(k), ("B", 0), ("f", [0.1, 0.2, 50.0, 3.0 + k])) for k in range(4)]
    frame = log.read(db3(tmp_path / "log.db3", {"/range": ("sensor_msgs/msg/Range", messages)})).frame
    np.testing.assert_array_equal(frame["/range.range"], [3.0, 4.0, 5.0, 6.0])
    np.testing.assert_allclose(frame["time"], BEGUN + np.arange(4) * 0.1, atol=1e-6)


@pytest.mark.parametrize("thrusters", [12, 8])
def test_px4_actuators_without_definitions(thrusters, tmp_path):
    """12 controls since PX4 1.14, 8 before; stamps are microseconds of the autopilot."""
    messages = [
        packed(("Q", [5_000_000 + 100_000 * k, 0]), ("H", 0), ("f", np.arange(thrusters) * 0.125))
        for k in range(4)
    ]
    found = log.read(
        db3(tmp_path / "log.db3", {"/fmu/out/actuator_motors": ("px4_msgs/msg/ActuatorMotors", messages)})
    )
    assert found.frame[f"/fmu/out/actuator_motors.control[{thrusters - 1}]"][0] == (thrusters - 1) * 0.125
    assert f"/fmu/out/actuator_motors.control[{thrusters}]" not in found.frame.columns
    np.testing.assert_allclose(np.diff(found.frame["time"]), 0.1, atol=1e-6)


def test_mavros_and_a_doppler_log_without_definitions(tmp_path):
    out = [packed(*header(k), ("I", 8), ("H", np.arange(1500, 1508))) for k in range(3)]
    dvl = [
        packed(
            *header(k), ("B", [1, 0]), ("d", [0.1 * k, 0.2, 0.3]), ("d", np.zeros(9)), ("d", [4.5, 0.0, 0.0]),
            ("B", 4), ("f", 1500.0), ("?", [True, True]), ("d", np.arange(12.0)), ("d", [1.0, 2.0, 3.0, 4.0]),
            ("f", np.zeros(16)),
        )
        for k in range(3)
    ]  # fmt: skip
    topics = {
        "/mavros/rc/out": ("mavros_msgs/msg/RCOut", out),
        "/dvl": ("marine_acoustic_msgs/msg/Dvl", dvl),
    }
    frame = log.read(db3(tmp_path / "log.db3", topics)).frame
    assert frame["/mavros/rc/out.channels[7]"].drop_nulls().to_list() == [1507.0] * 3
    np.testing.assert_allclose(frame["/dvl.velocity.x"].drop_nulls(), [0.0, 0.1, 0.2])
    assert frame["/dvl.altitude"].drop_nulls().to_list() == [4.5] * 3
    assert frame["/dvl.range[3]"].drop_nulls().to_list() == [4.0] * 3


# MCAP


def mcap(path: Path, encoding: str, messages: Sequence[bytes]) -> Path:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        if encoding == "cdr":
            schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        else:
            schema = writer.register_schema("nav", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/nav", encoding, schema)
        for place, data in enumerate(messages):
            ns = BEGUN * SECOND + place * SECOND // 10
            writer.add_message(channel, ns, data, ns)
        writer.finish()
    return path


def test_messages_compressed_one_by_one(tmp_path):
    packer = zstandard.ZstdCompressor()
    path = mcap(tmp_path / "log.mcap", "cdr", [packer.compress(each) for each in floats()])
    np.testing.assert_array_equal(log.read(path).frame["/nav.data"], [0.0, 0.5, 1.0, 1.5, 2.0])


def test_a_compressed_message_that_declares_too_much_is_not_read(tmp_path):
    """A frame that declares 2**40 bytes: magic, a header with eight bytes of size, and no content."""
    frame = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 2**40) + b"\x01\0\0"
    packer = zstandard.ZstdCompressor()
    path = mcap(tmp_path / "log.mcap", "cdr", [packer.compress(floats()[1]), frame])
    found = log.read(path)
    assert found.frame["/nav.data"].to_list() == [0.5]
    assert found.notes == ("/nav: 1 of 2 messages cannot be decoded and are left out",)


def test_nan_and_infinity_in_json_are_numbers(tmp_path):
    messages = [
        json.dumps({"u": float("nan") if k % 2 else float(k), "v": float("inf")}).encode() for k in range(4)
    ]
    frame = log.read(mcap(tmp_path / "log.mcap", "json", messages)).frame
    np.testing.assert_array_equal(frame["/nav.u"].fill_null(np.nan), [0.0, np.nan, 2.0, np.nan])


def test_what_is_no_json_is_left_out_and_counted(tmp_path):
    found = log.read(mcap(tmp_path / "log.mcap", "json", [b'{"u": 1}', b'{"u": ', b'{"u": 3}']))
    assert found.frame["/nav.u"].to_list() == [1.0, 3.0]
    assert found.notes == ("/nav: 1 of 3 messages cannot be decoded and are left out",)
