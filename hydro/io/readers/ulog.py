"""PX4's ULog, by `pyulog`: every topic is an array of messages on the autopilot's clock."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.io.readers.ardupilot import CUT_SHORT, quiet
from hydro.io.readers.damage import Bounded
from hydro.io.readers.expansion import Expansion
from hydro.io.readers.messages import Item, Options, Selection, Topic, tokens

MAGIC = b"ULog\x01\x12\x35"
_HEADER = 16
"""Bytes before the first message: magic bytes, version, start time."""
_MICRO = 1e6
_EVERY = 4096
"""Number of messages between two reports of progress."""
_FIELD = 256
"""Memory of a field of a topic in the library [bytes]: an object, its name, and its place in a type."""

Tree = dict[Any, Any]
"""Fields by name: arrays with a row for each message, or lists and mappings of these."""


def ulog(path: Path, selection: Selection, options: Options) -> Iterator[Item]:
    """Yield the messages of a ULog in order of time, each with its topic and time [s].

    A topic with several instances is called `name` for the first, then `name[1]` and so on.  Several
    subscriptions to a topic, each for a part of the log, are one topic.
    """
    with quiet(io.StringIO()), Bounded(path) as file:
        log = _bounded(Expansion.of(options.name, path))(file, _types(selection))
    parts: dict[tuple[str, int], list[Any]] = {}
    for each in log.data_list:
        parts.setdefault((each.name, each.multi_id), []).append(each.data)
    if not parts and selection.columns is None:
        raise DataError(f"{options.name}: no message with data in this ULog: was the vehicle's logger on?")
    found: list[tuple[Topic, Array]] = []
    for (name, instance), slices in parts.items():
        called = f"{name}[{instance}]" if instance else name
        if selection.takes(called):
            found.append(_topic(called, name, slices))
    yield from _merged(found, options)
    if log.dropouts:
        lost = sum(each.duration for each in log.dropouts) / 1e3
        options.notes.append(f"the logger lost data {len(log.dropouts):,} times, {lost:.3g} s in all")
    if log.file_corruption:
        options.notes.append("the log is damaged in places, which are skipped")
    elif _cut_short(path):
        options.notes.append(CUT_SHORT)


def _bounded(expansion: Expansion) -> type[Any]:
    """Return the library's reader, changed to count the fields of each topic before it lists them.

    Types consist of types, so a few of them can have more fields than fit in memory.
    """
    from pyulog import ULog

    class Subscribed(ULog._MessageAddLogged):  # type: ignore[misc]
        def _parse_format(self, formats: Mapping[str, Any]) -> None:
            expansion.add(_FIELD * _fields(self.message_name, formats, {}))
            super()._parse_format(formats)

    class Counted(ULog):  # type: ignore[misc]
        _MessageAddLogged = Subscribed

    return Counted


def _fields(kind: str, formats: Mapping[str, Any], known: dict[str, int]) -> int:
    """Return the number of fields of a type, including its parts; `known` caches other types."""
    if kind not in formats:
        return 1
    if kind not in known:
        parts = formats[kind].fields
        known[kind] = sum(max(size, 1) * _fields(part, formats, known) for part, size, _ in parts)
    return known[kind]


def _types(selection: Selection) -> list[str] | None:
    """Return the topics of the wanted columns; None if all are wanted."""
    if selection.columns is None:
        return None
    return sorted({name.partition(".")[0].partition("[")[0] for name in selection.columns})


def _topic(called: str, kind: str, slices: Sequence[Mapping[str, Any]]) -> tuple[Topic, Array]:
    """Return a topic whose messages are rows of its arrays, and their times [s]."""
    columns = {
        name: np.concatenate([np.asarray(each[name]) for each in slices])
        for name in slices[0]
        if all(name in each for each in slices)
    }
    return Topic(called, kind, partial(_row, _tree(columns))), columns["timestamp"] / _MICRO


def _merged(topics: Sequence[tuple[Topic, Array]], options: Options) -> Iterator[Item]:
    """Yield the messages of all topics in order of time."""
    if not topics:
        return
    times = np.concatenate([t for _, t in topics])
    whose = np.repeat(np.arange(len(topics)), [len(t) for _, t in topics])
    place = np.concatenate([np.arange(len(t)) for _, t in topics])
    for done, at in enumerate(np.argsort(times, kind="stable").tolist()):
        yield topics[whose[at]][0], float(times[at]), int(place[at])
        if done % _EVERY == 0:
            options.progress(done / len(times))


def _tree(columns: Mapping[str, Any]) -> Tree:
    """Return columns such as `esc[0].rpm` as nested mappings."""
    root: Tree = {}
    for name, values in columns.items():
        steps = tokens(name)
        at: Tree = root
        for step in steps[:-1]:
            at = at.setdefault(step, {})
        at[steps[-1]] = values
    found: Tree = _listed(root)
    return found


def _listed(tree: Any) -> Any:
    """Return nested mappings in which those with the keys 0, 1, 2 and so on became lists."""
    if not isinstance(tree, dict):
        return tree
    parts = {name: _listed(part) for name, part in tree.items()}
    return [parts[place] for place in range(len(parts))] if set(parts) == set(range(len(parts))) else parts


def _row(tree: Any, place: int) -> Any:
    """Return the message in row `place` of nested arrays."""
    if isinstance(tree, dict):
        return {name: _row(part, place) for name, part in tree.items()}
    if isinstance(tree, list):
        return [_row(part, place) for part in tree]
    return tree[place].item()


def _cut_short(path: Path) -> bool:
    """Check whether the last message of a log is incomplete."""
    content = memoryview(path.read_bytes())
    place = _HEADER
    while place + 3 <= len(content):
        (size,) = struct.unpack_from("<H", content, place)
        place += 3 + size
    return place != len(content)
