"""ArduPilot's DataFlash logs and MAVLink telemetry logs, by `pymavlink`."""

from __future__ import annotations

import contextlib
import io
import os
import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hydro.core.errors import DataError
from hydro.io.readers.damage import Bounded
from hydro.io.readers.messages import Item, Options, Selection, Topic

_EVERY = 4096
"""Number of messages between two reports of progress."""
_MICRO, _MILLI = 1e6, 1e3
_INSTANCES = ("C", "I", "Instance")
"""Fields that number several sensors or EKF cores, for logs whose FMTU messages do not name the field."""
_WHOLE = frozenset("bBhHiIM")
NO_DATA = ("FMT", "FMTU", "UNIT", "MULT", "PARM", "FILE", "ISBH", "ISBD")
"""Messages about the log itself, and parts of files."""
WRAP = 2**32 / _MICRO
"""Period after which a 32-bit counter of microseconds wraps [s]."""
CUT_SHORT = "the last message is cut short, as when power is lost: the log is read up to it"
_DAYS = 3 * 86400.0  # maximum step between two plausible times of receipt [s]
_YEARS = (946_684_800.0, 4_102_444_800.0)  # plausible times of receipt: years 2000 to 2100 [s]


def dataflash(path: Path, selection: Selection, options: Options) -> Iterator[Item]:
    """Yield the messages of a DataFlash `.bin`, each with its topic and time of receipt [s].

    Times are UTC if the log has a GPS, otherwise seconds since the autopilot was switched on.

    Args:
        path: The log.
        selection: Topics that are read.
        options: Limits and messages of the reader.
    """
    os.environ.setdefault("MAVLINK_DIALECT", "ardupilotmega")
    from pymavlink.DFReader import DFReader_binary

    said = io.StringIO()
    with _silent(), quiet(said):
        reader = DFReader_binary(os.fspath(path))
    types = {name for name in reader.name_to_id if name not in NO_DATA and selection.takes_type(name)}
    try:
        yield from messages_of(reader, types, said, selection, options)
    finally:
        reader.close()
    if _cut_short(reader):
        options.notes.append(CUT_SHORT)


def messages_of(
    reader: Any, types: set[str], said: io.StringIO, selection: Selection, options: Options
) -> Iterator[Item]:
    """Yield the messages of an open DataFlash log, each with its topic and time; a note reports damage.

    Args:
        reader: Open log of `pymavlink`.
        types: Names of the message types to read.
        said: Output of the library so far.
        selection: Topics that are read.
        options: Limits and messages of the reader.
    """
    topics: dict[tuple[str, Any], Topic] = {}
    done = 0
    while types:
        with quiet(said):
            message = reader.recv_match(type=types, strict=True)
        if message is None:
            break
        kind = message.get_type()
        instance = _instance(message)
        topic = topics.get((kind, instance))
        if topic is None:
            name = kind if instance is None else f"{kind}[{instance}]"
            topic = topics[kind, instance] = Topic(name, kind, _same)
        if selection.takes(topic.name):
            yield topic, message._timestamp, message
        done += 1
        if done % _EVERY == 0:
            options.progress(0.01 * reader.percent)
    _tell_damage(said, options)


def _cut_short(reader: Any) -> bool:
    """Check whether the last message of a log is incomplete."""
    ends = [
        places[-1] + reader.formats[number].len
        for number, places in enumerate(reader.offsets)
        if len(places) and number in reader.formats
    ]
    return bool(max(ends, default=0) > reader.data_len)


def _same(message: Any) -> Any:
    return message


def _instance(message: Any) -> Any:
    """Return the number of the sensor or core that a message belongs to; None if there is only one."""
    fmt = message.fmt
    name = fmt.instance_field
    if name is None:
        name = next((each for each in _INSTANCES if each in fmt.colhash), None)
        if name is None or fmt.format[fmt.colhash[name]] not in _WHOLE:
            return None
    return getattr(message, name)


@contextlib.contextmanager
def quiet(said: io.StringIO) -> Iterator[None]:
    """Redirect the library's output during a `with` block to `said`, away from the terminal.

    Of a long output only a part is kept.
    """
    if said.tell() > 1 << 16:
        said.seek(1 << 15)
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        yield


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Keep output of compiled code to stderr, which bypasses Python's streams, off the terminal."""
    try:
        kept = os.dup(2)
    except OSError:
        yield
        return
    try:
        with tempfile.TemporaryFile() as nowhere:
            os.dup2(nowhere.fileno(), 2)
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _tell_damage(said: io.StringIO, options: Options) -> None:
    """Add a note if the library found bytes that are not a message."""
    if lines := said.getvalue().splitlines():
        options.notes.append(
            f"the log is damaged in places, which are skipped; the first: {lines[0].strip()[:120]}"
        )


def telemetry(path: Path, selection: Selection, options: Options) -> Iterator[Item]:
    """Yield the messages of a MAVLink `.tlog`, each with its topic and time of receipt [s].

    The file has frames, each preceded by the receiver's clock.  The stamp of a message is its `time_boot_ms`
    or `time_usec`, because links deliver in bursts.
    """
    from pymavlink.dialects.v20 import ardupilotmega

    parser = ardupilotmega.MAVLink(None)
    parser.robust_parsing = True
    topics: dict[tuple[str, Any, int, int], Topic] = {}
    sources: dict[str, tuple[int, int]] = {}
    bad = done = 0
    with Bounded(path) as file:
        for received, message in _frames(file, parser, options):
            kind = message.get_type()
            if kind == "BAD_DATA":
                bad += len(message.data)
                continue
            if kind.startswith("UNKNOWN_"):
                continue
            sender = (message.get_srcSystem(), message.get_srcComponent())
            field = message._instance_field
            key = (kind, getattr(message, field) if field else None, *sender)
            topic = topics.get(key)
            if topic is None:
                topic = topics[key] = _mavlink_topic(message, key, sources.setdefault(kind, sender))
            if selection.takes(topic.name):
                yield topic, received, message
            done += 1
            if done % _EVERY == 0:
                options.progress(file.tell() / max(file.size, 1))
    if not done:
        raise DataError(f"{options.name}: no MAVLink message in this file: is it a .tlog?")
    if bad:
        options.notes.append(f"{bad:,} bytes are not MAVLink messages and are skipped")


def _mavlink_topic(message: Any, key: tuple[str, Any, int, int], first: tuple[int, int]) -> Topic:
    """Return a topic, named by its type, and by instance and sender if they are not the first."""
    kind, instance, *sender = key
    name = kind if instance is None or instance == 0 else f"{kind}[{_word(instance)}]"
    if tuple(sender) != first:
        name = f"{name}@{sender[0]}.{sender[1]}"
    types = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    if "time_boot_ms" in types:
        return Topic(name, kind, _same, lambda each: float(each.time_boot_ms) / _MILLI)
    if "time_usec" in types:
        wraps = WRAP if types["time_usec"] == "uint32_t" else 0.0
        return Topic(name, kind, _same, lambda each: float(each.time_usec) / _MICRO, wraps)
    return Topic(name, kind, _same)


def _word(instance: Any) -> str:
    return instance.rstrip("\0") if isinstance(instance, str) else str(instance)


def _frames(file: Bounded, parser: Any, options: Options) -> Iterator[tuple[float, Any]]:
    """Yield every frame with its time of receipt [s].

    After invalid bytes, reading resumes at the next plausible time.
    """
    latest, lost = None, False
    while head := file.read(8):
        if len(head) < 8:
            options.notes.append(CUT_SHORT)
            return
        received = struct.unpack(">Q", head)[0] / _MICRO
        while lost and not _plausible(received, latest):
            byte = file.read(1)
            if not byte:
                return
            head = head[1:] + byte
            received = struct.unpack(">Q", head)[0] / _MICRO
        message = None
        while message is None:
            data = file.read(max(parser.bytes_needed(), 1))
            message = parser.parse_char(data)
            if message is None and not data:
                options.notes.append(CUT_SHORT)
                return
        lost = message.get_type() == "BAD_DATA"
        latest = latest if lost else received
        yield received, message


def _plausible(received: float, latest: float | None) -> bool:
    """Return whether a time of receipt [s] is plausible after the latest one [s]."""
    if latest is None:
        return _YEARS[0] < received < _YEARS[1]
    return abs(received - latest) <= _DAYS


def is_telemetry(head: bytes) -> bool:
    """Return whether the first bytes `head` of a file are a time in this century and a MAVLink frame."""
    if len(head) < 9 or head[8] not in (0xFD, 0xFE):
        return False
    return _plausible(struct.unpack(">Q", head[:8])[0] / _MICRO, None)
