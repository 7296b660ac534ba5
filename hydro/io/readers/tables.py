"""Numbers of a log of messages: each topic in its own rows, on disk until they are needed.

One table of all topics would have a row for each message and mostly nulls.  An import with a map does not
need it; `Tables.wide` makes it for other uses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
import polars as pl

from hydro.core.columns import Array, Mask, Rows
from hydro.core.errors import HydroError
from hydro.io.readers.clocks import Stamps, one_clock
from hydro.io.readers.messages import Topic, number, picker
from hydro.io.readers.spill import Columns, Spill

TIME, RECEIVED = "time", "receive_time"
CLOCKS = (TIME, RECEIVED)
"""Columns that every log of messages has in addition to those of its topics [s]."""


class Undecoded(Exception):
    """Error for a message that does not fit the definition of its type."""


class Buffer:
    """Selected fields of one topic: one number per field and message.

    Attributes:
        again: Rows at which the clock of receipt restarts.
    """

    def __init__(self, topic: Topic, paths: Sequence[str], spill: Spill) -> None:
        self.topic, self.paths = topic, paths
        self.again: list[int] = []
        self._numbers = Columns(len(CLOCKS) + len(paths), spill)
        self._received, self._stamped, *self._values = self._numbers.open
        self._there = [False] * len(paths)
        self._pick: Callable[[object], Sequence[object]] | None = None

    def __len__(self) -> int:
        return self._numbers.rows

    def add(self, received: float, raw: object) -> None:
        """Add a row with the numbers of one message.

        Args:
            received: Time of receipt [s].
            raw: The stored message.

        Raises:
            Undecoded: The message cannot be decoded; the buffer stays as it was.
            DataError: The message expands beyond the limit of its file.
        """
        assert self.topic.decode is not None
        try:
            message = self.topic.decode(raw)
        except HydroError:
            raise
        except Exception as error:
            raise Undecoded(str(error) or type(error).__name__) from error
        if self._pick is None:
            self._pick = picker(self.paths, message)
        self._received.append(received)
        self._stamped.append(self.topic.stamp(message) or np.nan)
        for place, (column, value) in enumerate(zip(self._values, self._pick(message), strict=True)):
            try:
                column.append(value)
                self._there[place] = True
            except TypeError:
                found = number(value)
                column.append(np.nan if found is None else found)
                self._there[place] |= found is not None
        self._numbers.advance()

    @property
    def received(self) -> Array:
        """Times of receipt of the messages [s]."""
        return self._numbers.column(0)

    def stamps(self) -> Stamps:
        """Return the times of receipt and of measurement of the messages."""
        received, stamped = self.received, self._numbers.column(1)
        return Stamps(self.topic.name, received, stamped, self.topic.wraps, tuple(self.again))

    @property
    def columns(self) -> dict[str, int]:
        """Index of each column that has at least one number, as a dict by the column's name `topic.field`."""
        held = ((place, path) for place, path in enumerate(self.paths) if self._there[place])
        return {f"{self.topic.name}.{path}": place for place, path in held}

    def values(self, place: int, start: int = 0, stop: int | None = None) -> Array:
        """Return the numbers of a column in rows `start` to `stop` (excluded), NaN where a message has none.

        Args:
            place: Index of the column, see `columns`.
            start: First row.
            stop: Row after the last; None for all.
        """
        return self._numbers.column(len(CLOCKS) + place, start, stop)


class Table:
    """Table of the messages of several topics, with rows in order of time.

    Attributes:
        time: Times of the rows [s], (n,), not decreasing.

    Args:
        buffers: Topics; rows of equal time keep their order.
        times: Times of the messages of each topic [s].
    """

    def __init__(self, buffers: Sequence[Buffer], times: Sequence[Array]) -> None:
        self._buffers = buffers
        self.time: Array = np.concatenate([np.empty(0), *times]) if len(times) != 1 else times[0]
        self._places: list[Rows] | None = None
        if len(times) > 1 or (np.diff(self.time) < 0.0).any():
            order = np.argsort(self.time, kind="stable")
            self.time = self.time[order]
            places = np.empty(len(order), np.int64)
            places[order] = np.arange(len(order))
            self._places = np.split(places, np.cumsum([len(each) for each in times])[:-1])

    @property
    def names(self) -> list[str]:
        """Names of the columns, without the columns of clocks."""
        return list(dict.fromkeys(name for each in self._buffers for name in each.columns))

    def column(self, name: str, start: int = 0, stop: int | None = None) -> Array:
        """Return one column in rows `start` to `stop` (excluded), by default all.

        NaN where a row has no value.

        Args:
            name: Name of the column.
            start: First row.
            stop: Row after the last; None for all.
        """
        if self._places is None:
            (buffer,) = self._buffers
            return buffer.values(buffer.columns[name], start, stop)
        found = ((each, each.columns.get(name)) for each in self._buffers)
        return self._placed(None if place is None else each.values(place) for each, place in found)[
            start:stop
        ]

    def unset(self, name: str, start: int = 0, stop: int | None = None) -> Mask:
        """Return a mask of the rows in which a message states NaN for a column, (n,).

        Missing fields do not count.

        Args:
            name: Name of the column.
            start: First row.
            stop: Row after the last; None for all.
        """
        if self._places is None:
            own = np.ones(len(self.time), bool)
        else:
            own = np.zeros(len(self.time), bool)
            for rows, each in zip(self._places, self._buffers, strict=True):
                if name in each.columns:
                    own[rows] = True
        return np.asarray(own[start:stop] & np.isnan(self.column(name, start, stop)))

    def wide(self) -> pl.DataFrame:
        """Return the clocks and all columns as one polars table."""
        received = self._placed(each.received for each in self._buffers)
        table = [pl.Series(TIME, self.time), pl.Series(RECEIVED, received)]
        table += [pl.Series(name, self.column(name), nan_to_null=True) for name in self.names]
        return pl.DataFrame(table)

    def _placed(self, parts: Iterable[Array | None]) -> Array:
        """Place the numbers of each topic in the rows of all messages; NaN for topics without numbers."""
        if self._places is None:
            (whole,) = parts
            assert whole is not None
            return whole
        out = np.full(len(self.time), np.nan)
        for rows, values in zip(self._places, parts, strict=True):
            if values is not None:
                out[rows] = values
        return out


class Tables:
    """Topics of a log, each with its own rows, all on one clock.

    Attributes:
        notes: Corrections of the topics' clocks, a line each.
        begins: Times at which a clock restarts, and a session with it [s], increasing.

    Args:
        buffers: Topics with messages, in the order of the log.
        notes: Notes on their messages, a line each.
    """

    def __init__(self, buffers: Sequence[Buffer], notes: Sequence[str] = ()) -> None:
        self._buffers = buffers
        self._times, moved, self.begins = one_clock([each.stamps() for each in buffers])
        self.notes = [*notes, *moved]

    @property
    def height(self) -> int:
        """Number of messages."""
        return sum(map(len, self._buffers))

    @property
    def columns(self) -> list[str]:
        """Names of all columns: clocks first, then the fields of all message types, each once."""
        return list(dict.fromkeys((*CLOCKS, *(name for each in self._buffers for name in each.columns))))

    def values(self, name: str) -> Array:
        """Return the numbers of one column in the order of its messages, (n,), over all its topics."""
        parts = [each.values(each.columns[name]) for each in self._buffers if name in each.columns]
        return np.concatenate([np.empty(0), *parts])

    def times(self) -> Array:
        """Return the times of all messages [s], sorted."""
        return np.sort(np.concatenate([np.empty(0), *self._times]), kind="stable")

    def travel(self) -> dict[str, float]:
        """Return the mean time from stamp to receipt of a topic's messages [s], by topic.

        0 without stamps.
        """
        return {
            each.topic.name: _mean_travel(each.received, t)
            for each, t in zip(self._buffers, self._times, strict=True)
            if len(t)
        }

    def wide(self) -> pl.DataFrame:
        """Return one table with a row for each message, with nulls in the columns of other topics."""
        if not self._buffers:
            return pl.DataFrame(schema=dict.fromkeys(CLOCKS, pl.Float64))
        return Table(self._buffers, self._times).wide()

    def together(self, wanted: Sequence[Sequence[str]]) -> Iterator[tuple[Table, list[str]]]:
        """Yield pairs of a table and its columns, such that each group of columns lies in one table.

        Topics that no group links stay in separate tables.

        Args:
            wanted: Groups of columns, each of which must share rows.
        """
        of: dict[str, set[str]] = {}
        for each in self._buffers:
            for name in each.columns:
                of.setdefault(name, set()).add(each.topic.name)
        linked: list[tuple[set[str], dict[str, None]]] = []
        for group in wanted:
            topics, names = set().union(*(of[name] for name in group)), dict.fromkeys(group)
            for other in [each for each in linked if each[0] & topics]:
                linked.remove(other)
                topics, names = topics | other[0], other[1] | names
            linked.append((topics, names))
        for topics, names in linked:
            chosen = [k for k, each in enumerate(self._buffers) if each.topic.name in topics]
            yield (
                Table([self._buffers[k] for k in chosen], [self._times[k] for k in chosen]),
                list(names),
            )


def _mean_travel(received: Array, sent: Array) -> float:
    """Return the mean time from sending to receipt [s], without messages that came over a step late.

    Args:
        received: Times of receipt (n,) [s].
        sent: Times of sending (n,) [s].
    """
    late = received - sent
    usual = float(np.median(late))
    step = float(np.median(np.diff(np.sort(sent)))) if len(sent) > 1 else np.inf
    return float(late[late - usual <= step].mean())


class Numbers(Mapping[str, Array]):
    """Mapping from column names to numbers, read on demand from ranges of rows; infinite values give NaN.

    Args:
        tables: For each column, its table and the range of rows, the last excluded.
    """

    def __init__(self, tables: Mapping[str, tuple[Table, int, int]]) -> None:
        self._tables = tables

    def __getitem__(self, name: str) -> Array:
        table, start, stop = self._tables[name]
        values = table.column(name, start, stop)
        finite = np.isfinite(values)
        return values if finite.all() else np.where(finite, values, np.nan)

    def __iter__(self) -> Iterator[str]:
        return iter(self._tables)

    def __len__(self) -> int:
        return len(self._tables)
