"""Common parts of the readers of message logs: topics, selected columns, numbers in messages.

A column is named `topic.field.subfield[index]`.  Messages are objects with attributes (ROS, MAVLink) or
mappings (JSON); the same paths read numbers from both.
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
"""Maximum length of an array that becomes columns; a longer one is an image, a point cloud or a buffer."""
DEEPEST = 12
"""Maximum nesting of a message; deeper fields are not measurements."""
_TOKEN = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


@dataclass(frozen=True)
class Selection:
    """Columns to read from a log, `topic.field` each; `columns` None means all."""

    columns: frozenset[str] | None = None

    def paths(self, topic: str) -> list[str] | None:
        """Return the paths of the fields to read from messages of a topic; None for all fields."""
        if self.columns is None:
            return None
        begin = f"{topic}."
        return sorted(name[len(begin) :] for name in self.columns if name.startswith(begin))

    def takes(self, topic: str) -> bool:
        """Return whether any field of a topic is to be read."""
        return self.columns is None or any(name.startswith(f"{topic}.") for name in self.columns)

    def takes_type(self, name: str) -> bool:
        """Return whether a message type is to be read, by its name or as an instance such as `name[1]`."""
        return self.takes(name) or any(each.startswith(f"{name}[") for each in self.columns or ())


@dataclass
class Options:
    """Options and notes of a reader.

    Attributes:
        name: Name of the file in error messages.
        definitions: Folder with `.msg` files for ROS messages that the log does not describe.
        progress: Called with the share of the file that has been read, from 0 to 1.
        notes: Notes of the reader about the file, a line each.
    """

    name: str
    definitions: Path | None = None
    progress: Callable[[float], None] = lambda share: None
    notes: list[str] = field(default_factory=list)


@dataclass(eq=False)
class Topic:
    """Series of messages of one type, which become columns with a common prefix.

    Attributes:
        name: Prefix of the columns.
        kind: Type of the messages.
        decode: Function that decodes a stored message; None if messages cannot be decoded.
        stamp: Function that returns the time of measurement in a message [s]; None or 0 without a time.
        wraps: Period after which the stamp wraps to 0 [s]; 0 if it does not wrap.
        unread: Reason why messages cannot be read, in words; empty if they can.
    """

    name: str
    kind: str
    decode: Callable[[Any], Any] | None
    stamp: Callable[[Any], float | None] = lambda message: None
    wraps: float = 0.0
    unread: str = ""


Item = tuple[Topic, float, Any]
"""Topic, time of receipt [s], and stored message."""
Stream = Callable[[Path, Selection, Options], Iterator[Item]]
"""Reader of messages; it yields those of wanted topics, in any order."""


def number(value: Any) -> float | None:
    """Return a field's value as a float; a ROS time gives seconds; None for text and other types."""
    if isinstance(value, int | float | np.number | np.bool_):
        return float(value)
    seconds, rest = getattr(value, "sec", None), getattr(value, "nanosec", None)
    return (seconds * 10**9 + rest) / 1e9 if seconds is not None and rest is not None else None


def leaves(value: Any, path: str = "", depth: int = 0) -> Iterator[tuple[str, float | None]]:
    """Yield every field in a message as a pair of its path and its number, None for text and the like.

    Args:
        value: Message, or a part of a message.
        path: Path of that part in the message.
        depth: Number of levels above that part.
    """
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
    """Return the names of a message object's fields."""
    if hasattr(message, "get_fieldnames"):
        return tuple(message.get_fieldnames())
    found = dataclasses.fields(message) if dataclasses.is_dataclass(message) else ()
    return [each.name for each in found if not each.name.startswith("__")]


def picker(paths: Sequence[str], example: Any) -> Callable[[Any], Sequence[Any]]:
    """Return a function that takes a message of one type and returns its values at the given paths.

    Args:
        paths: Paths within a message, such as `pose.position.x` or `channels[3]`.
        example: A message of this type.  If all paths are attributes, one call fetches them all, otherwise
            each path is followed step by step.
    """
    plain = not isinstance(example, Mapping) and not any("[" in path for path in paths)
    if plain and all(follow(example, tokens(path)) is not None for path in paths):
        get = attrgetter(*paths)
        return (lambda message: (get(message),)) if len(paths) == 1 else get
    steps = [tokens(path) for path in paths]
    return lambda message: [follow(message, each) for each in steps]


def tokens(path: str) -> list[str | int]:
    """Return a path such as `channels[3]` as a list of names and indices, `["channels", 3]`."""
    return [int(index) if index else name for name, index in _TOKEN.findall(path)]


def follow(message: Any, steps: Sequence[str | int]) -> Any:
    """Return the value at a path inside a message.

    Args:
        message: Message, as an object with attributes or as a mapping.
        steps: Path as names and indices, see `tokens`.

    Returns:
        The value; None if the message has no such path.
    """
    for step in steps:
        try:
            if isinstance(step, int) or isinstance(message, Mapping):
                message = message[step]
            else:
                message = getattr(message, step)
        except (LookupError, TypeError, AttributeError):
            return None
    return message
