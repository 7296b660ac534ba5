"""Messages into typed columns: a pass that lists what a log has, and one that keeps what is wanted of it."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.io.readers.clocks import Stamps, one_clock
from hydro.io.readers.messages import Item, Selection, Topic, leaves, number, picker

LOOKED_AT = 20
"""Messages of a topic whose fields are listed: lengths of arrays may grow, names do not."""
CLOCKS = ("time", "receive_time")
"""Columns that every log of messages has beside those of its topics [s]."""


@dataclass
class Listed:
    """What a topic has.

    Attributes:
        topic: The topic.
        count: Messages.
        first: Time of its first message [s].
        last: Time of its last message [s].
        fields: Paths of its numeric fields, in the order of the message.
        skipped: Paths of fields that are no numbers.
    """

    topic: Topic
    count: int = 0
    first: float = np.inf
    last: float = -np.inf
    fields: dict[str, None] = field(default_factory=dict)
    skipped: dict[str, None] = field(default_factory=dict)

    def add(self, received: float, raw: Any) -> None:
        """Count a message, and look into it while the topic is young."""
        self.count += 1
        self.first, self.last = min(self.first, received), max(self.last, received)
        if self.count <= LOOKED_AT and self.topic.decode is not None:
            for path, value in leaves(self.topic.decode(raw)):
                (self.fields if value is not None else self.skipped)[path] = None

    @property
    def rate(self) -> float:
        """Messages per second [Hz]; NaN of fewer than two."""
        span = self.last - self.first
        return (self.count - 1) / span if span > 0.0 else np.nan


def inventory(stream: Iterable[Item]) -> list[Listed]:
    """What topics a log has, in the order in which they appear; no message is kept."""
    found: dict[Topic, Listed] = {}
    for topic, received, raw in stream:
        entry = found.get(topic)
        if entry is None:
            entry = found[topic] = Listed(topic)
        entry.add(received, raw)
    return list(found.values())


def columns(listed: Sequence[Listed]) -> list[str]:
    """The columns that a log of these topics has."""
    return [*CLOCKS, *(f"{each.topic.name}.{path}" for each in listed for path in each.fields)]


class Buffer:
    """The wanted fields of a topic, one number each for every message."""

    def __init__(self, topic: Topic, paths: Sequence[str]) -> None:
        self.topic, self.paths = topic, paths
        self.received, self.stamped = array("d"), array("d")
        self.values = [array("d") for _ in paths]
        self.there = [False] * len(paths)
        self._pick: Any = None

    def add(self, received: float, raw: Any) -> None:
        """Keep the numbers of a message."""
        assert self.topic.decode is not None
        message = self.topic.decode(raw)
        if self._pick is None:
            self._pick = picker(self.paths, message)
        self.received.append(received)
        self.stamped.append(self.topic.stamp(message) or np.nan)
        for place, (buffer, value) in enumerate(zip(self.values, self._pick(message), strict=True)):
            try:
                buffer.append(value)
                self.there[place] = True
            except TypeError:
                found = number(value)
                buffer.append(np.nan if found is None else found)
                self.there[place] |= found is not None

    def stamps(self) -> Stamps:
        """Its times."""
        return Stamps(self.topic.name, _array(self.received), _array(self.stamped), self.topic.wraps)

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Its columns that have ever held a number."""
        for path, values, there in zip(self.paths, self.values, self.there, strict=True):
            if there:
                yield f"{self.topic.name}.{path}", _array(values)


def collect(stream: Iterable[Item], selection: Selection, name: str) -> tuple[pl.DataFrame, list[str]]:
    """The wanted columns of a log as one wide table in order of time, and what was done to its clocks.

    Every topic keeps its own rows, with nulls in the columns of the others.

    Raises:
        DataError: a wanted topic cannot be read; the line calls the log `name`.
    """
    buffers: dict[Topic, Buffer] = {}
    for topic, received, raw in stream:
        buffer = buffers.get(topic)
        if buffer is None:
            buffer = buffers[topic] = Buffer(topic, selection.paths(topic.name) or [])
            if buffer.paths and topic.decode is None:
                raise DataError(f"{name}: {topic.name} ({topic.kind}) is not read: {topic.unread}")
        if buffer.paths:
            buffer.add(received, raw)
    return wide([each for each in buffers.values() if len(each.received)])


def wide(buffers: Sequence[Buffer]) -> tuple[pl.DataFrame, list[str]]:
    """The columns of all topics in one table, its rows in order of time."""
    if not buffers:
        return pl.DataFrame(schema=dict.fromkeys(CLOCKS, pl.Float64)), []
    times, notes = one_clock([each.stamps() for each in buffers])
    time, received = np.concatenate(times), np.concatenate([_array(each.received) for each in buffers])
    order = np.argsort(time, kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    table = [pl.Series("time", time[order]), pl.Series("receive_time", received[order])]
    start = 0
    for buffer in buffers:
        rows = place[start : start + len(buffer.received)]
        start += len(rows)
        for name, values in buffer.columns():
            full = np.full(len(order), np.nan)
            full[rows] = values
            table.append(pl.Series(name, full, nan_to_null=True))
    return pl.DataFrame(_merged(table)), notes


def _merged(table: Sequence[pl.Series]) -> list[pl.Series]:
    """Columns of one name, as of a topic with two publishers, in one."""
    found: dict[str, pl.Series] = {}
    for each in table:
        known = found.get(each.name)
        found[each.name] = each if known is None else known.zip_with(known.is_not_null(), each)
    return list(found.values())


def _array(values: array[float]) -> Array:
    return np.frombuffer(values, np.float64) if len(values) else np.empty(0)
