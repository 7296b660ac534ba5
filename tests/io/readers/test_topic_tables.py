"""Logs of messages in bounded memory: topics in rows of their own, against one wide table of all of them."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import logs
import message_logs as written
import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.core.logs import delays, importing
from hydro.io import log_import, logmap
from hydro.io.log import Log
from hydro.io.readers import spill
from hydro.io.readers.chunks import by_chunk
from hydro.io.readers.collect import collect
from hydro.io.readers.expansion import Expansion
from hydro.io.readers.messages import Item, Selection, Topic
from hydro.io.readers.tables import Tables, _mean_travel
from hydro.io.sessions import sessions

POSE, VELOCITY = logs.NAMES[:6], logs.NAMES[6:]
FIELDS = {
    "nav": (POSE[:3], 1),
    "ahrs": ((*POSE[3:], *VELOCITY[3:]), 1),
    "dvl": (VELOCITY[:3], 4),
    "lock": (("ok", "gain"), 6),
    "drive": (("cmd_1", "cmd_2"), 2),
    "battery": (("volts",), 50),
}
"""Topics, their fields, and every which row of the motion has a message of theirs."""
PLAIN = """
time.column = "time"
position.columns = ["nav.x", "nav.y", "nav.z"]
attitude.columns = ["ahrs.phi", "ahrs.theta", "ahrs.psi"]
velocity = { columns = ["dvl.u", "dvl.v", "dvl.w"], VELOCITY }
rates.columns = ["ahrs.p", "ahrs.q", "ahrs.r"]
commands.columns = ["drive.cmd_1", "drive.cmd_2"]
"""
MAPS = {
    "plain": PLAIN.replace("VELOCITY", "held = false"),
    "valid by another topic": PLAIN.replace("VELOCITY", 'valid = "lock.ok"'),
    "divided by another topic": PLAIN.replace("VELOCITY", 'per = "lock.gain"'),
    "late": PLAIN.replace("VELOCITY", "lag = 0.3"),
    "mounted": PLAIN.replace("VELOCITY", "mount = { yaw = 3.0, position = [0.4, 0.0, 0.1] }"),
    "rates derived": PLAIN.replace("VELOCITY", "held = false").replace(
        'rates.columns = ["ahrs.p", "ahrs.q", "ahrs.r"]', 'rates = { from = "attitude" }'
    ),
    "two topics of one sensor": PLAIN.replace("VELOCITY", "held = false").replace('"nav.z"', '"dvl.w"'),
    "sessions by silence": PLAIN.replace("VELOCITY", "held = false") + "session.gap = 2.0\n",
    "voltage": PLAIN.replace("VELOCITY", "held = false") + 'voltage.column = "battery.volts"\n',
    "stamped by a topic": PLAIN.replace("VELOCITY", "held = false").replace('"time"', '"receive_time"'),
    "milliseconds": PLAIN.replace("VELOCITY", "held = false").replace(
        'time.column = "time"', 'time = { column = "time", unit = "ms" }'
    ),
    "a column too many": PLAIN.replace("VELOCITY", "held = false").replace("nav.x", "nav.northing"),
}


def stream(seconds: float, rate: float = 20.0, unnamed: int = 0) -> Iterator[Item]:
    """Messages of a motion, silent for 3 s after 12; and `unnamed` more in every row that no map names."""
    raw = logs.raw(seconds, rate)
    t = raw["t"].to_numpy()
    columns = {name: raw[name].to_numpy() for name in raw.columns[1:]}
    columns |= {
        "ok": (np.sin(t) > -0.8).astype(float),
        "gain": 1.0 + 0.01 * np.cos(t),
        "volts": 16.0 - 0.001 * t,
    }
    topics = {name: Topic(name, "", lambda raw: raw, lambda message: message["stamp"]) for name in FIELDS}
    more = Topic("camera", "", lambda raw: raw)
    begun = 1.7e9 + t + np.where(t > 12.0, 3.0, 0.0)
    for row, now in enumerate(begun):
        for name, (fields, every) in FIELDS.items():
            if row % every == 0:
                stamp = {"stamp": now - 0.002 * len(fields) if name != "drive" else 0.0}
                yield topics[name], now, stamp | {field: columns[field][row] for field in fields}
        for number in range(unnamed):
            yield more, now, {"number": number}


def every() -> frozenset[str]:
    return frozenset(f"{name}.{field}" for name, (fields, _) in FIELDS.items() for field in fields)


def read(messages: Iterator[Item], columns: frozenset[str] | None = None) -> Log:
    return Log("dive", collect(messages, Selection(columns or every()), "dive"), "sha256:0")


def told(source: Log, text: str) -> tuple[pl.DataFrame | None, list[str]]:
    """What an import makes of a log and says of it, or its error."""
    try:
        report = log_import.import_log(source, logmap.parse(text))
    except DataError as error:
        return None, [str(error)]
    return report.imported.frame, list(report.lines())


@pytest.mark.parametrize("name", MAPS)
def test_topics_in_rows_of_their_own_import_as_one_table_of_all(name):
    source = read(stream(40.0))
    assert isinstance(source.table, Tables)
    frame, lines = told(source, MAPS[name])
    expected, same = told(Log("dive", source.frame, "sha256:0"), MAPS[name])
    assert lines == same
    if expected is None:
        assert frame is None
        assert name in ("a column too many", "stamped by a topic", "milliseconds")
    else:
        assert frame is not None
        assert frame.equals(expected)


@pytest.mark.parametrize("clock", ["time", "receive_time"])
def test_a_map_that_takes_the_clock_for_a_measurement_is_told(clock):
    name, text = next(iter(MAPS.items()))
    column = logmap.parse(text).commands.columns[0]
    frame, lines = told(read(stream(40.0)), text.replace(f'"{column}"', f'"{clock}"'))
    assert frame is None, name
    assert lines == [f"dive: commands names {clock}, which is the log's clock: name a measured column there"]


def test_a_log_is_resampled_in_pieces_as_at_once(monkeypatch):
    source = read(stream(40.0))
    whole = told(source, MAPS["voltage"])
    monkeypatch.setattr(importing, "LEAST_ROWS", 37)
    monkeypatch.setattr(delays, "TOGETHER", 5)
    frame, lines = told(source, MAPS["voltage"])
    assert lines == whole[1]
    assert frame is not None
    assert frame.equals(whole[0])


@given(
    rows=st.lists(st.integers(-5, 5), max_size=60),
    block=st.integers(1, 9),
    small=st.sampled_from([1, 40, 10_000]),
    edges=st.tuples(st.integers(0, 60), st.integers(0, 60)),
)
def test_what_is_spilled_is_read_back_in_any_stretch(rows, block, small, edges):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(spill, "BLOCK", block)
        patch.setattr(spill, "SMALL", small)
        shared = spill.Spill()
        both = [spill.Columns(2, shared), spill.Columns(1, shared)]
        for value in rows:
            for columns in both:
                for number, each in enumerate(columns.open):
                    each.append(10.0 * value + number)
                columns.advance()
        start, stop = sorted(min(edge, len(rows)) for edge in edges)
        expected = 10.0 * np.array(rows, float)
        for columns in both:
            assert len(columns.open[0]) < block
            np.testing.assert_array_equal(columns.column(0), expected)
            np.testing.assert_array_equal(columns.column(0, start, stop), expected[start:stop])
        np.testing.assert_array_equal(both[0].column(1, start, stop), expected[start:stop] + 1.0)


def test_a_full_disk_is_one_line(monkeypatch):
    import errno

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    shared = spill.Spill()
    monkeypatch.setattr(shared._file, "write", full)
    with pytest.raises(DataError, match=r"no room for the numbers of this log.*TMPDIR"):
        shared.put(spill.Columns(1, shared).open)


def test_a_topic_with_two_publishers_is_one():
    first, second = (Topic("nav", "", lambda raw: raw) for _ in range(2))
    sent = [(first, 0.0, {"x": 1.0}), (second, 1.0, {"x": 2.0, "y": 3.0}), (first, 2.0, {"x": 4.0})]
    found = collect(iter(sent), Selection(frozenset({"nav.x", "nav.y"})), "two")
    assert found.wide()["nav.x"].to_list() == [1.0, 2.0, 4.0]
    assert found.wide()["nav.y"].to_list() == [None, 3.0, None]
    ((table, names),) = found.together([["nav.x"], ["nav.y"]])
    assert sorted(names) == ["nav.x", "nav.y"]
    np.testing.assert_array_equal(table.column("nav.x", 1), [2.0, 4.0])


# Memory


@pytest.fixture
def small(monkeypatch):
    """Blocks and pieces of a log that is a thousandth of a long one."""
    monkeypatch.setattr(spill, "BLOCK", 64)
    monkeypatch.setattr(spill, "SMALL", 4096)
    monkeypatch.setattr(importing, "LEAST_ROWS", 300)
    monkeypatch.setattr(delays, "TOGETHER", 8)
    monkeypatch.setattr(delays, "MOST_WINDOWS", 40)


def peak(work: Any) -> tuple[Any, int]:
    """What some work gives, and the most bytes that it held beside what there was."""
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        found = work()
        return found, tracemalloc.get_traced_memory()[1] - before
    finally:
        tracemalloc.stop()


def growth(seconds: float, unnamed: int = 0) -> tuple[int, int]:
    """The most bytes in use while a log is read, resampled and asked for its delay; and its raw table.

    Lags of sensors and conventions are looked for in windows, of which there are never more than so many.
    """
    messages, meaning = list(stream(seconds, unnamed=unnamed)), logmap.parse(MAPS["plain"])
    named = every() - {"lock.ok", "lock.gain", "battery.volts"}

    def work() -> pl.DataFrame:
        made = importing.raw_table(sessions(read(iter(messages), named), meaning), meaning)
        delays.command_delay(made.logs, made.times, made.dt, made.meaning)
        return made.frame

    frame, most = peak(work)
    return most, frame.estimated_size()


def test_memory_grows_with_the_raw_table_and_not_with_the_messages(small):
    """Times of the messages are kept beside it, and some columns at a time; one of all topics was nine."""
    growth(40.0)  # what is made once is made
    (short, rows), (long, more) = growth(80.0), growth(240.0)
    assert long - short < 2.5 * (more - rows)


def test_a_topic_that_no_map_names_takes_no_memory(small):
    growth(40.0)
    (plain, _), (more, _) = growth(60.0), growth(60.0, unnamed=20)
    assert more < plain + 40_000


@pytest.mark.parametrize("compression", ["BZ2", None])
def test_a_bag_is_read_with_the_index_of_one_chunk(tmp_path: Path, compression: str | None):
    from rosbags.rosbag1 import Reader, Writer
    from rosbags.typesys import Stores, get_typestore

    types, path = get_typestore(Stores.ROS1_NOETIC), tmp_path / "dive.bag"
    writer = Writer(path)
    writer.chunk_threshold = 4000
    if compression is not None:
        writer.set_compression(Writer.CompressionFormat[compression])
    with writer:
        links: dict[str, Any] = {}
        for topic, kind, ns, message in written.ros_messages(logs.raw(6.0, 20.0), types, 1):
            link = links.get(topic) or writer.add_connection(topic, kind, typestore=types)
            links[topic] = link
            writer.write(link, ns, types.serialize_ros1(message, kind))
    with Reader(path) as library:
        expected = [(link.topic, ns, bytes(raw)) for link, ns, raw in library.messages()]
        counts = {link.topic: link.msgcount for link in library.connections}
    with by_chunk(Expansion.of(path.name, path))(path) as reader:
        assert {link.topic: link.msgcount for link in reader.connections} == counts
        found, most = [], 0
        for link, ns, raw in reader.messages():
            found.append((link.topic, ns, bytes(raw)))
            most = max(most, sum(map(len, reader.indexes.values())))
        chosen = [link for link in reader.connections if link.topic == "/imu"]
        assert sum(1 for _ in reader.messages(chosen)) == counts["/imu"]
    assert len(reader.chunk_infos) == 0
    assert sorted(found) == sorted(expected)
    assert most < len(expected) / 10


def test_a_logger_that_stalls_does_not_change_the_travel_of_messages() -> None:
    """Two of five hundred messages come when a full disk is free again, seconds late."""
    sent = np.arange(500) * 0.02
    received = sent + 0.012 + np.random.default_rng(0).exponential(0.004, 500)
    received[[100, 300]] += 3.0
    assert _mean_travel(received, sent) == pytest.approx(0.016, abs=5e-4)
