"""Collection of messages in typed columns: a pass that lists topics, and one that keeps wanted fields."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hydro.core.errors import DataError, HydroError, shown
from hydro.io.readers.clocks import RESTART_FALL
from hydro.io.readers.messages import Item, Selection, Topic, leaves
from hydro.io.readers.spill import Spill
from hydro.io.readers.tables import CLOCKS, Buffer, Tables, Undecoded

LATE_MESSAGES = 20
"""Number of consecutive late messages from which the clock of receipt has restarted."""
EXAMINED = 20
"""Number of messages per topic whose fields are listed: lengths of arrays may grow, names do not."""


@dataclass
class Listed:
    """Summary of a topic of a log: its messages and fields.

    Attributes:
        topic: The topic.
        count: Number of messages.
        first: Time of its first message [s].
        last: Time of its last message [s].
        fields: Paths of its numeric fields, in the order of the message.
        skipped: Paths of fields that are not numbers.
        failed: Number of examined messages that could not be decoded.
    """

    topic: Topic
    count: int = 0
    first: float = np.inf
    last: float = -np.inf
    fields: dict[str, None] = field(default_factory=dict)
    skipped: dict[str, None] = field(default_factory=dict)
    failed: int = 0

    def add(self, received: float, raw: Any) -> None:
        """Count a message in the summary, and examine its fields if it is one of the topic's first messages.

        Args:
            received: Time of receipt [s].
            raw: The stored message.
        """
        self.count += 1
        self.first, self.last = min(self.first, received), max(self.last, received)
        if self.count <= EXAMINED and self.topic.decode is not None:
            try:
                message = self.topic.decode(raw)
            except HydroError:
                raise
            except Exception as error:
                self.failed += 1
                if self.failed == self.count:
                    self.topic.unread = unfit(error)
                return
            self.topic.unread = ""
            for path, value in leaves(message):
                (self.fields if value is not None else self.skipped)[path] = None

    @property
    def rate(self) -> float:
        """Messages per second [Hz]; NaN for fewer than two."""
        span = self.last - self.first
        return (self.count - 1) / span if span > 0.0 else np.nan


def inventory(stream: Iterable[Item]) -> list[Listed]:
    """Return a summary of each topic of a log, in order of appearance, without keeping a message.

    Args:
        stream: Messages of the log.
    """
    found: dict[Topic, Listed] = {}
    for topic, received, raw in stream:
        entry = found.get(topic)
        if entry is None:
            entry = found[topic] = Listed(topic)
        entry.add(received, raw)
    return list(found.values())


def columns(listed: Sequence[Listed]) -> list[str]:
    """Return the column names of a log: its clocks, then `topic.field` for each numeric field."""
    return [*CLOCKS, *(f"{each.topic.name}.{path}" for each in listed for path in each.fields)]


def collect(stream: Iterable[Item], selection: Selection, name: str) -> Tables:
    """Return the selected columns of a log of messages, with separate rows for each topic.

    Args:
        stream: Messages of the log.
        selection: Topics and fields to keep.
        name: Name of the log in error messages.

    Raises:
        DataError: A selected topic cannot be read.
    """
    buffers: dict[Topic, Buffer] = {}
    lost: dict[Topic, int] = {}
    spill = Spill()
    receipt = _Receipt(buffers)
    for topic, received, raw in stream:
        buffer = buffers.get(topic)
        if buffer is None:
            buffer = buffers[topic] = Buffer(topic, selection.paths(topic.name) or [], spill)
            if buffer.paths and topic.decode is None:
                raise DataError(f"{name}: {topic.name} ({topic.kind}) is not read: {topic.unread}")
        receipt.see(topic, received)
        if buffer.paths:
            try:
                buffer.add(received, raw)
            except Undecoded as error:
                lost[topic] = lost.get(topic, 0) + 1
                topic.unread = topic.unread or unfit(error)
    receipt.finish()
    notes = []
    for topic, count in lost.items():
        if not len(buffers[topic]):
            raise DataError(f"{name}: {topic.name} ({topic.kind}) is not read: {topic.unread}")
        total = count + len(buffers[topic])
        notes.append(f"{topic.name}: {count:,} of {total:,} messages cannot be decoded and are left out")
    return Tables([each for each in buffers.values() if len(each)], notes)


class _Receipt:
    """Clock of receipt, which restarts if a bag follows the time of a simulator that is reset.

    Args:
        buffers: Topics so far; the row of each restart is added to each topic's buffer.
    """

    def __init__(self, buffers: Mapping[Topic, Buffer]) -> None:
        self._buffers = buffers
        self._latest: dict[Topic, float] = {}
        self._behind = 0
        self._rows: dict[Topic, int] = {}
        self._count = 0

    def see(self, topic: Topic, received: float) -> None:
        """Record when a topic's next message was received, and note whether the logger's clock restarted.

        The clock restarts if many messages in a row lie behind earlier ones of their own topics.  A single
        such message is late.  Topics written one after another fall only relative to each other.

        Args:
            topic: Topic of the message.
            received: Time of receipt [s].
        """
        latest = self._latest.get(topic, -np.inf)
        if received >= latest - RESTART_FALL:
            self._latest[topic] = max(latest, received)
            self._behind = 0 if np.isfinite(latest) else self._behind
            return
        if not self._behind:
            self._rows = {own: len(each) for own, each in self._buffers.items()}
        self._behind += 1
        if self._behind == LATE_MESSAGES:
            self._count += 1
            for own, each in self._buffers.items():
                each.again += [0] * (self._count - 1 - len(each.again))
                each.again.append(self._rows.get(own, 0))
            self._latest, self._behind = {topic: received}, 0

    def finish(self) -> None:
        """Add restarts of the clock to those topics whose first message came after a restart."""
        for each in self._buffers.values():
            each.again[:0] = [0] * (self._count - len(each.again))


def unfit(error: Exception) -> str:
    """Return a sentence on why a topic is not read: its messages do not fit their declared type."""
    reason = shown((str(error) or type(error).__name__).splitlines()[0][:120])
    return f"its messages do not fit the definition of their type ({reason}): give another with --msg DIR"
