"""Logs as other people's loggers write them, by their own libraries: bags, MCAP, DataFlash and MAVLink.

What is written is a list of messages in order of receipt.  The content of a ROS or JSON message is a
mapping of its fields, of DataFlash a sequence in the order of its columns, of MAVLink a mapping.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

SECOND = 10**9  # ns
TIME = "builtin_interfaces/msg/Time"


class Message(NamedTuple):
    """A message as it was received.

    Attributes:
        topic: Its topic; of DataFlash and MAVLink the name of the message.
        kind: Its type; empty where topic and type are one.
        received: Time of receipt [ns since 1970]; of DataFlash none.
        content: Its fields.
    """

    topic: str
    kind: str
    received: int
    content: Any


def ros_types(ros: int, definitions: Mapping[str, str]) -> Any:
    """The message types of ROS 1 or 2, and those of some definitions by name."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    for kind, text in definitions.items():
        types.register(get_types_from_msg(text, kind))
    return types


def ros_message(types: Any, kind: str, content: Any) -> Any:
    """A message of a type; fields that its content does not give are 0 or empty, times are in ns."""
    if kind == TIME:
        sec, nanosec = divmod(int(content or 0), SECOND)
        return types.types[TIME](sec=sec, nanosec=nanosec)
    fields = types.fielddefs[kind][1]
    given = content or {}
    return types.types[kind](**{name: _field(types, how, given.get(name)) for name, how in fields})


def _field(types: Any, how: tuple[Any, Any], value: Any) -> Any:
    """A field by its description: a number or text, a message, or an array of these."""
    what, detail = how
    if what.name == "BASE":
        return value if value is not None else "" if detail[0] == "string" else 0
    if what.name == "NAME":
        return ros_message(types, detail, value)
    (inner, element), length = detail
    if inner.name == "NAME":
        return [ros_message(types, element, each) for each in value or ()]
    if value is None:
        value = np.zeros(length if what.name == "ARRAY" else 0)
    return np.asarray(value, {"bool": np.bool_}.get(element[0], element[0]))


def ros1(path: Path, messages: Iterable[Message], definitions: Mapping[str, str], compression: str) -> Path:
    """Write a ROS 1 bag; `compression` is LZ4 or BZ2."""
    from rosbags.rosbag1 import Writer

    types = ros_types(1, definitions)
    path.unlink(missing_ok=True)
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        links: dict[str, Any] = {}
        for topic, kind, received, content in messages:
            if topic not in links:
                links[topic] = writer.add_connection(topic, kind, typestore=types)
            writer.write(
                links[topic], received, types.serialize_ros1(ros_message(types, kind, content), kind)
            )
    return path


def ros2(path: Path, messages: Iterable[Message], definitions: Mapping[str, str], storage: str) -> Path:
    """Write a ROS 2 recording, a folder with its metadata; `storage` is SQLITE3 or MCAP."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    types = ros_types(2, definitions)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage])
    if storage == "MCAP":
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        links: dict[str, Any] = {}
        for topic, kind, received, content in messages:
            if topic not in links:
                links[topic] = writer.add_connection(topic, kind, typestore=types)
            data = types.serialize_cdr(ros_message(types, kind, content), kind)
            writer.write(links[topic], received, data)
    return path


def json_mcap(path: Path, messages: Iterable[Message]) -> Path:
    """Write an MCAP file whose channels are JSON, as BlueOS records."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        for topic, kind, received, content in messages:
            if topic not in channels:
                schema = writer.register_schema(kind, "jsonschema", b'{"type": "object"}')
                channels[topic] = writer.register_channel(topic, "json", schema)
            writer.add_message(channels[topic], received, json.dumps(content).encode(), received)
        writer.finish()
    return path


FMT = ("FMT", 128, "BBnNZ", "Type,Length,Name,Format,Columns")
"""The message that describes messages."""
CODES = {"Q": "Q", "I": "I", "i": "i", "H": "H", "h": "h", "B": "B", "f": "f", "d": "d"} | {
    "c": "h",  # hundredths
    "C": "H",
    "e": "i",
    "E": "I",
    "L": "i",  # degrees of latitude or longitude, by 1e-7
    "n": "4s",
    "N": "16s",
    "Z": "64s",
}
"""DataFlash's letters as those of `struct`."""
HUNDREDTHS = "cCeE"


def dataflash(path: Path, messages: Iterable[Message], formats: Mapping[str, tuple[str, str]]) -> Path:
    """Write an ArduPilot DataFlash log, packed by its own FMT messages.

    Args:
        path: The file.
        messages: Topic and content, whose values are in the units of the reader: degrees where the format
            holds hundredths.
        formats: Format and columns of every message, by name.
    """
    numbers = {name: FMT[1] + 1 + i for i, name in enumerate(formats)}
    described = [FMT, *((name, numbers[name], form, columns) for name, (form, columns) in formats.items())]
    with path.open("wb") as file:
        for name, number, form, columns in described:
            size = 3 + struct.calcsize(_layout(form))
            file.write(
                _packed(FMT[1], FMT[2], (number, size, name.encode(), form.encode(), columns.encode()))
            )
        for topic, _, _, content in messages:
            file.write(_packed(numbers[topic], formats[topic][0], content))
    return path


def _layout(form: str) -> str:
    return "<" + "".join(CODES[each] for each in form)


def _packed(number: int, form: str, values: Sequence[Any]) -> bytes:
    """A message's bytes: two marks, its number, its values."""
    stored = [
        round(100.0 * value) if each in HUNDREDTHS else value
        for each, value in zip(form, values, strict=True)
    ]
    return struct.pack("<BBB", 0xA3, 0x95, number) + struct.pack(_layout(form), *stored)


def telemetry(path: Path, messages: Iterable[Message]) -> Path:
    """Write a MAVLink telemetry log (.tlog): the receiver's clock [us] before every frame.

    A topic `NAME@SYSTEM.COMPONENT` is of another sender than the vehicle.
    """
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    links: dict[str, Any] = {}
    with path.open("wb") as file:
        for topic, _, received, content in messages:
            name, _, sender = topic.partition("@")
            if sender not in links:
                system, component = (int(each) for each in (sender or "1.1").split("."))
                links[sender] = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
            message = getattr(mavlink, f"MAVLink_{name.lower()}_message")(**content)
            file.write(struct.pack(">Q", received // 1000) + message.pack(links[sender]))
    return path
