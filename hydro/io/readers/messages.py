"""What the readers of message logs have in common: topics, the columns wanted of them, numbers in messages.

A column is called `topic.field.subfield[index]`.  Messages are objects with attributes (ROS, MAVLink) or
mappings (JSON); numbers are read from both by the same paths.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

LONGEST = 64
"""Elements of an array that are columns; a longer one is an image, a cloud or a buffer."""
DEEPEST = 12
"""Levels of a message; what is nested deeper is no measurement."""
_TOKEN = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


@dataclass(frozen=True)
class Selection:
    """Which columns of a log are wanted; `columns` None means all."""

    columns: frozenset[str] | None = None

    def paths(self, topic: str) -> list[str] | None:
        """The fields wanted of a topic; None means all."""
        if self.columns is None:
            return None
        begin = f"{topic}."
        return sorted(name[len(begin) :] for name in self.columns if name.startswith(begin))

    def takes(self, topic: str) -> bool:
        """Whether any field of a topic is wanted."""
        return self.columns is None or any(name.startswith(f"{topic}.") for name in self.columns)

    def takes_type(self, name: str) -> bool:
        """Whether a message type is wanted, by itself or as one of several instances."""
        return self.takes(name) or any(each.startswith(f"{name}[") for each in self.columns or ())


@dataclass
class Options:
    """What a reader is told besides the file.

    Attributes:
        name: What error lines call the file.
        definitions: Folder with `.msg` files for ROS messages whose log does not describe them.
        progress: Called with the share of the file that is read, from 0 to 1.
        notes: What readers have to say about the file, a line each.
    """

    name: str
    definitions: Path | None = None
    progress: Callable[[float], None] = lambda share: None
    notes: list[str] = field(default_factory=list)


@dataclass(eq=False)
class Topic:
    """A sequence of messages with the same fields.

    Attributes:
        name: What columns begin with.
        kind: Type of the messages.
        decode: A message of its stored form; None where this cannot be read.
        stamp: When the message says it was measured [s]; None or 0 where it does not.
        wraps: The stamp begins again at 0 after so many seconds; 0 where it never does.
        unread: Why messages are not read, for people; empty where they are.
    """

    name: str
    kind: str
    decode: Callable[[Any], Any] | None
    stamp: Callable[[Any], float | None] = lambda message: None
    wraps: float = 0.0
    unread: str = ""


Item = tuple[Topic, float, Any]
"""A topic, when its message was received [s], and the message as it is stored."""
Stream = Callable[[Path, Selection, Options], Iterator[Item]]
"""A reader of messages: those of wanted topics, in any order."""


def number(value: Any) -> float | None:
    """A value as a number: a ROS time in seconds, None for what is no number."""
    if isinstance(value, int | float | np.number | np.bool_):
        return float(value)
    seconds, rest = getattr(value, "sec", None), getattr(value, "nanosec", None)
    return (seconds * 10**9 + rest) / 1e9 if seconds is not None and rest is not None else None


def leaves(value: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, float | None]]:
    """Every field of a message with its number, None for a field of another kind."""
    if (found := number(value)) is not None:
        yield path, found
    elif depth > DEEPEST or value is None or isinstance(value, str | bytes):
        yield path, None
    elif isinstance(value, Mapping):
        for name, part in value.items():
            yield from leaves(part, f"{path}.{name}" if path else str(name), depth + 1)
    elif isinstance(value, Sequence | np.ndarray):
        if len(value) > LONGEST:
            yield path, None
        else:
            for place, part in enumerate(value):
                yield from leaves(part, f"{path}[{place}]", depth + 1)
    else:
        for name in fields(value):
            yield from leaves(getattr(value, name), f"{path}.{name}" if path else name, depth + 1)


def fields(message: Any) -> Sequence[str]:
    """The names of a message object's fields."""
    if hasattr(message, "get_fieldnames"):
        return tuple(message.get_fieldnames())
    found = dataclasses.fields(message) if dataclasses.is_dataclass(message) else ()
    return [each.name for each in found if not each.name.startswith("__")]


def picker(paths: Sequence[str], example: Any) -> Callable[[Any], Sequence[Any]]:
    """What takes the values at some paths out of messages like an example.

    Plain attributes are fetched in one call; whatever else a path may hold is followed step by step.
    """
    plain = not isinstance(example, Mapping) and not any("[" in path for path in paths)
    if plain and all(follow(example, tokens(path)) is not None for path in paths):
        get = attrgetter(*paths)
        return (lambda message: (get(message),)) if len(paths) == 1 else get
    steps = [tokens(path) for path in paths]
    return lambda message: [follow(message, each) for each in steps]


def tokens(path: str) -> list[str | int]:
    """The names and indices of a path such as `channels[3]`."""
    return [int(index) if index else name for name, index in _TOKEN.findall(path)]


def follow(message: Any, steps: Sequence[str | int]) -> Any:
    """The value at a path; None where there is none."""
    for step in steps:
        try:
            if isinstance(step, int) or isinstance(message, Mapping):
                message = message[step]
            else:
                message = getattr(message, step)
        except (LookupError, TypeError, AttributeError):
            return None
    return message
