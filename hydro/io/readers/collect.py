"""Messages into typed columns: a pass that lists what a log has, and one that keeps what is wanted of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hydro.core.errors import DataError
from hydro.io.readers.messages import Item, Selection, Topic, leaves
from hydro.io.readers.spill import Spill
from hydro.io.readers.tables import CLOCKS, Buffer, Tables

LOOKED_AT = 20
"""Messages of a topic whose fields are listed: lengths of arrays may grow, names do not."""


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


def collect(stream: Iterable[Item], selection: Selection, name: str) -> Tables:
    """The wanted columns of a log, of every topic in rows of its own.

    Raises:
        DataError: a wanted topic cannot be read; the line calls the log `name`.
    """
    buffers: dict[Topic, Buffer] = {}
    spill = Spill()
    for topic, received, raw in stream:
        buffer = buffers.get(topic)
        if buffer is None:
            buffer = buffers[topic] = Buffer(topic, selection.paths(topic.name) or [], spill)
            if buffer.paths and topic.decode is None:
                raise DataError(f"{name}: {topic.name} ({topic.kind}) is not read: {topic.unread}")
        if buffer.paths:
            buffer.add(received, raw)
    return Tables([each for each in buffers.values() if len(each)])
