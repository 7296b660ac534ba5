"""MCAP, by `mcap`: ROS 2 (CDR), ROS 1 and JSON channels, also mixed in one file."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from hydro.core.errors import DataError
from hydro.io.readers.ardupilot import WRAP
from hydro.io.readers.compressed import unpacked
from hydro.io.readers.damage import Bounded
from hydro.io.readers.expansion import LEAST, Expansion
from hydro.io.readers.messages import Item, Options, Selection, Topic, number
from hydro.io.readers.ros import Definitions
from hydro.io.readers.ros import topic as ros_topic

_NANO = 1e9
_EVERY = 4096
"""Number of records between two reports of progress."""
_FORMS = {"ros1msg": "msg", "ros2msg": "msg", "ros2idl": "idl"}
_ENCODINGS = {"cdr": 2, "ros1": 1}
_MAVLINK = (("time_boot_ms", 1e3), ("time_usec", 1e6))
_SHORT = "/SERVO_OUTPUT_RAW"
"""Topic whose microseconds have 32 bits."""
_LONGEST_JSON = int(LEAST / 24)
"""Maximum size of a decoded JSON message [bytes]: `{},` takes three of them and, as an object, 72."""


def messages(path: Path, selection: Selection, options: Options) -> Iterator[Item]:
    """Yield the messages of an MCAP file, each with its topic and time of receipt [s], in file order.

    Of the folder of a ROS 2 recording, the messages of all MCAP files are read.
    """
    if path.is_dir():
        for part in sorted(path.glob("*.mcap"), key=_in_turn):
            yield from messages(part, selection, options)
        return
    from mcap.records import Channel, Footer, Message, Schema

    file = Bounded(path)
    expansion = Expansion.of(options.name, path)
    topics = _Topics(options, expansion)
    with file:
        for done, record in enumerate(_records(file, expansion)):
            if isinstance(record, Message):
                topic = topics.of(record.channel_id)
                if selection.takes(topic.name):
                    yield topic, record.log_time / _NANO, record.data
                if done % _EVERY == 0:
                    options.progress(file.tell() / max(file.size, 1))
            elif isinstance(record, Schema):
                topics.schemas[record.id] = record
            elif isinstance(record, Channel):
                topics.channels.setdefault(record.id, record)
            elif isinstance(record, Footer):
                return
    raise DataError(
        f"{options.name}: this MCAP file is cut short: copy it again, or run `mcap recover` on it"
    )


def _records(file: Bounded, expansion: Expansion) -> Iterator[Any]:
    """Yield the records of a file, reading one chunk at a time."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    reader = StreamReader(file, validate_crcs=True, record_size_limit=file.size, emit_chunks=True)
    for record in reader.records:
        if isinstance(record, Chunk):
            yield from _in_chunk(record, expansion)
        else:
            yield record


def _in_chunk(chunk: Any, expansion: Expansion) -> Iterator[Any]:
    """Yield the schemas, channels and messages of a chunk."""
    from mcap.opcode import Opcode
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import get_chunk_data_stream

    content = unpacked(chunk.data, chunk.compression, chunk.uncompressed_size, expansion)
    stream, length = get_chunk_data_stream(replace(chunk, data=content, compression=""), validate_crc=True)
    while stream.count < length:
        kind, size = stream.read1(), stream.read8()
        if kind == Opcode.MESSAGE:
            yield Message.read(stream, size)
        elif kind in (Opcode.SCHEMA, Opcode.CHANNEL):
            yield (Schema if kind == Opcode.SCHEMA else Channel).read(stream)
        else:
            stream.read(size)


def _in_turn(part: Path) -> list[tuple[str, int]]:
    """Return the sort key of a recording's files: by number, `dive_2` before `dive_10`."""
    return [(word, int(each or -1)) for word, each in re.findall(r"(\D*)(\d*)", part.name)]


class _Topics:
    """Channels of a file as topics, each created with its first message."""

    def __init__(self, options: Options, expansion: Expansion) -> None:
        self.schemas: dict[int, Any] = {}
        self.channels: dict[int, Any] = {}
        self._folder, self._expansion = options.definitions, expansion
        self._known: dict[int, Definitions] = {}
        self._made: dict[int, Topic] = {}

    def of(self, channel: int) -> Topic:
        """Return the topic with a given channel number in the file."""
        if channel not in self._made:
            self._made[channel] = self._make(self.channels[channel])
        return self._made[channel]

    def _make(self, channel: Any) -> Topic:
        schema = self.schemas.get(channel.schema_id)
        kind = schema.name if schema is not None else ""
        if channel.message_encoding == "json":
            wraps = WRAP if channel.topic.endswith(_SHORT) else 0.0
            return Topic(channel.topic, kind or "json", decoded_json, json_stamp, wraps)
        if channel.message_encoding not in _ENCODINGS:
            why = f"{channel.message_encoding or 'unnamed'} encoding: only CDR, ROS 1 and JSON are read"
            return Topic(channel.topic, kind, None, unread=why)
        ros = _ENCODINGS[channel.message_encoding]
        if ros not in self._known:
            self._known[ros] = Definitions(ros, self._folder)
        known = self._known[ros]
        kind = kind if kind.count("/") == 2 else "/msg/".join(kind.split("/"))
        if schema is not None and schema.encoding in _FORMS and schema.data:
            known.add(kind, schema.data.decode(errors="replace"), _FORMS[schema.encoding])
        return ros_topic(channel.topic, kind, known, self._expansion)


_JSON = msgspec.json.Decoder()


def decoded_json(raw: bytes) -> Any:
    """Return the content of a JSON message, including NaN or Infinity, which Python's loggers write.

    Raises:
        ValueError: It is not JSON, or too long for a measurement.
    """
    if len(raw) > _LONGEST_JSON:
        raise ValueError(f"{len(raw):,} bytes of JSON are more than a measurement has")
    try:
        return _JSON.decode(raw)
    except msgspec.DecodeError:
        return json.loads(raw)


def json_stamp(message: Any) -> float | None:
    """Return the time of measurement of a JSON message [s]; None without a time.

    The time is the stamp of the message's header, `timestamp`, or the time field of MAVLink.
    """
    if not isinstance(message, Mapping):
        return None
    for place in (_at(message, "header", "stamp"), message.get("timestamp"), message.get("stamp")):
        if isinstance(place, Mapping):
            seconds = place.get("sec", place.get("secs"))
            rest = next((place[name] for name in ("nanosec", "nsec", "nsecs") if name in place), 0)
            if isinstance(seconds, int | float) and isinstance(rest, int | float):
                return (seconds * _NANO + rest) / _NANO
    for name, per_second in _MAVLINK:
        if (own := number(_at(message, "message", name))) is not None:
            return own / per_second
    return None


def _at(message: Mapping[str, Any], *names: str) -> Any:
    found: Any = message
    for name in names:
        found = found.get(name) if isinstance(found, Mapping) else None
    return found
