"""Text form of a block of a map, for questions and options: columns, frames and units in one line.

`dvl_{x,y,z} FLU m/s` is a velocity, `east north depth=depth_m ENU` a position.  Braces
list or count columns, as in a shell; so does `data[0..7]`, as `hydro import --topics` prints it.
"""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec

from hydro.core.errors import DataError, listed, shown
from hydro.core.logs.logmap import Attitude, Commands, Position, Rates, Time, Velocity

Block = dict[str, Any]
KINDS: Mapping[str, type[msgspec.Struct]] = {
    "time": Time,
    "position": Position,
    "attitude": Attitude,
    "velocity": Velocity,
    "rates": Rates,
    "commands": Commands,
}
"""Blocks with a text form, and the structure of each."""
NONE = "none"
"""Text of a missing block."""
KEYED = ("depth", "height", "latitude", "longitude")
"""Columns given with their key, as in `depth=COLUMN`."""
EXAMPLES = {
    "time": "stamp_ms ms",
    "position": "x y z ENU, or x y depth=d, or depth=d",
    "attitude": "roll pitch yaw deg, or qx qy qz qw xyzw ENU FLU",
    "velocity": "dvl_x dvl_y dvl_z FLU",
    "rates": "gyro_{x,y,z} FRD deg/s, or from=attitude",
    "commands": "motor{1..6} pwm",
}
SHORTEST = 2
"""Minimum length of the common beginning of columns that are abbreviated with braces."""
_SCALED = re.compile(r"(.+?)\*([-+]?[0-9.]+(?:[eE][-+]?\d+)?)([-+][0-9.]+(?:[eE][-+]?\d+)?)?")
_LIST = re.compile(r"\{([^{}]*,[^{}]*)\}")
_COUNT = re.compile(r"\{(\d+)\.\.(\d+)\}|(?<=\[)(\d+)\.\.(\d+)(?=\])")


def text_of(name: str, block: Mapping[str, Any] | None) -> str:
    """Return a block of a map as one line of text, such as `dvl_{x,y,z} FLU m/s`; `none` without a block.

    Args:
        name: Name of the block, one of KINDS, such as `velocity`.
        block: The block as a map file has it; None without a block.
    """
    if block is None:
        return NONE
    columns = block.get("columns") or block.get("quaternion") or ()
    single = [block["column"]] if "column" in block else []
    plain = [_column_text(source) for source in (*single, *columns)]
    words = [_word(word) for word in _compact(plain)]
    words += [_word(f"{key}={_column_text(block[key])}") for key in KEYED if key in block]
    if block.get("from") == "attitude":
        words.append("from=attitude")
    return " ".join([*words, *(str(block.get(key, default)) for key, default in _said(name, block))])


def block_of(name: str, text: str, columns: Sequence[str]) -> Block | None:
    """Return the block of a map that a line of text describes, as a map file has it; None for `none`.

    Args:
        name: Name of the block, one of KINDS, such as `velocity`.
        text: Columns, frames and units, such as `dvl_{x,y,z} FLU m/s`.
        columns: All columns of the log; a unique ending names a column.

    Raises:
        DataError: A word is neither a column nor a setting, or the number of columns is wrong.
    """
    try:
        words = [part for word in shlex.split(text) for part in expanded(word, columns)]
    except ValueError as error:
        raise DataError(f"{name}: {text!r}: {error}") from None
    if words == [NONE]:
        return None
    settings = _settings(name)
    found: Block = {}
    last = True  # among the trailing words, which are settings even if a column has such a name
    taken = list[Any]()
    for word in reversed(words):
        key, given, value = word.partition("=")
        if word in settings and settings[word] not in found and (last or word not in columns):
            found[settings[word]] = word
        elif given and settings.get(value) == key:
            found[key] = value
        elif given and key in KEYED and name == "position":
            found[key] = column_of(value, columns)
        elif word == "from=attitude" and name == "rates":
            found["from"] = "attitude"
        else:
            taken.insert(0, _known(name, word, columns, settings))
            last = False
    return _shaped(name, found, taken)


def _shaped(name: str, found: Block, taken: list[Any]) -> Block:
    """Add the columns to a block.

    Raises:
        DataError: The number of columns is wrong.
    """
    if name == "time":
        if len(taken) != 1:
            raise DataError(f"time: give one column, such as {EXAMPLES[name]}; got {len(taken)}")
        return {"column": taken[0], **found}
    if name == "commands":
        if not taken:
            raise DataError(f"commands: give a column for each thruster, such as {EXAMPLES[name]}")
        return {"columns": [_command(source) for source in taken], **found}
    vertical = sum(key in found for key in ("depth", "height"))
    wanted: tuple[int, ...] = (3,)
    if name == "position" and vertical:
        wanted = (0, 2)
    elif name == "attitude":
        wanted = (3, 4)
    elif found.get("from") == "attitude":
        wanted = (0,)
    if len(taken) not in wanted:
        needed = listed([str(count) for count in wanted], "or")
        raise DataError(
            f"{name}: expected {needed} columns, got {len(taken)}: give {EXAMPLES[name]}, or {NONE}"
        )
    if len(taken) == 4:
        return {"quaternion": taken, **found}
    return {"columns": taken, **found} if taken else found


def _command(source: Any) -> Any:
    """Return the column of a thruster: `*-1` reverses it in any unit."""
    if isinstance(source, dict) and source == {"column": source["column"], "scale": -1.0}:
        return {"column": source["column"], "reverse": True}
    return source


def column_of(word: str, columns: Sequence[str]) -> Any:
    """Return the entry of a map for the log's column that a word names by its name or a unique ending.

    The entry is the full name, or with `*SCALE+OFFSET` after the word a table of `column`, `scale` and
    `offset`.

    Args:
        word: Name or ending after a slash or dot, optionally followed by `*SCALE` and `+OFFSET`.
        columns: All columns of the log.

    Raises:
        DataError: No column or several columns match.
    """
    if word in columns:
        return word
    ending = [name for name in columns if name.endswith((f"/{word}", f".{word}"))]
    if len(ending) == 1:
        return ending[0]
    if len(ending) > 1:
        raise DataError(
            f"{shown(word)}: {len(ending)} columns have this ending: {listed(ending[:4])}; give the full name"
        )
    if match := _SCALED.fullmatch(word):
        found = {"column": column_of(match[1], columns), "scale": float(match[2])}
        return found | ({"offset": float(match[3])} if match[3] else {})
    near = difflib.get_close_matches(word, columns, 1)
    hint = f"did you mean {shown(near[0])}?" if near else "see the list of columns"
    raise DataError(f"no column is called {shown(word)}: {hint}")


def expanded(word: str, columns: Sequence[str]) -> Iterator[str]:
    """Yield the words that a word with braces or counts stands for, such as `m1`, `m2` for `m{1..2}`.

    The exact name of a column is not expanded.

    Args:
        word: Word of the text form of a block.
        columns: All columns of the log.
    """
    if word in columns:
        yield word
    elif match := _LIST.search(word):
        for part in match[1].split(","):
            yield from expanded(word[: match.start()] + part + word[match.end() :], columns)
    elif match := _COUNT.search(word):
        first, last = (int(number) for number in match.groups() if number is not None)
        for number in range(first, last + 1):
            yield from expanded(f"{word[: match.start()]}{number}{word[match.end() :]}", columns)
    else:
        yield word


def _known(name: str, word: str, columns: Sequence[str], settings: Mapping[str, str]) -> Any:
    """Find the column of a word.

    Raises:
        DataError: No column matches; the line lists the settings of the block.
    """
    try:
        return column_of(word, columns)
    except DataError as error:
        raise DataError(f"{name}: {error} (settings: {', '.join(settings)})") from None


@cache
def _settings(name: str) -> Mapping[str, str]:
    """Return the words for the settings of a block with their keys."""
    found: dict[str, str] = {}
    hints = get_type_hints(KINDS[name])
    for field in msgspec.structs.fields(KINDS[name]):
        if field.encode_name != "from" and get_origin(hints[field.name]) is Literal:
            found |= {word: field.encode_name for word in get_args(hints[field.name]) if " " not in word}
    return found


def _said(name: str, block: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the settings of the text form with their defaults: frames, units and changed settings."""
    usual = {"unit", "world", "body", "frame"}
    if "quaternion" in block:
        usual = {"layout", "world", "body"}
    if name == "position" and not block.get("columns"):
        usual = {"unit"}
    if block.get("from") == "attitude":
        usual = set()
    for field in msgspec.structs.fields(KINDS[name]):
        key = field.encode_name
        if key in _settings(name).values() and (
            key in usual or block.get(key, field.default) != field.default
        ):
            yield key, str(field.default)


def _word(text: str) -> str:
    """Quote a word of the text form if necessary."""
    try:
        return text if shlex.split(text) == [text] else shlex.quote(text)
    except ValueError:
        return shlex.quote(text)


def _column_text(source: Any) -> str:
    """Return the text of a column with its scale and offset."""
    if not isinstance(source, Mapping):
        return str(source)
    scale, offset = source.get("scale", 1.0), source.get("offset", 0.0)
    if source.get("reverse"):
        scale = -scale
    if scale == 1.0 and offset == 0.0:
        return str(source["column"])
    return f"{source['column']}*{scale:.9g}" + (f"{offset:+.9g}" if offset else "")


def _beginning(words: Sequence[str]) -> str:
    """Return the common beginning of all words."""
    shared = list[str]()
    for letters in zip(*words, strict=False):
        if len(set(letters)) > 1:
            break
        shared.append(letters[0])
    return "".join(shared)


def _compact(words: Sequence[str]) -> list[str]:
    """Abbreviate columns with a common beginning by braces."""
    start = _beginning(words).rstrip("0123456789")
    if len(words) < 2 or len(start) < SHORTEST or len(set(words)) < len(words):
        return list(words)
    ends = [word[len(start) :] for word in words]
    shared = _beginning([end[::-1] for end in ends])[::-1].lstrip("0123456789")
    parts = [end[: len(end) - len(shared)] for end in ends]
    if not all(parts) or any(mark in part for part in parts for mark in ",{}* "):
        return list(words)
    if all(part.isdecimal() and part == str(int(part)) for part in parts):
        numbers = [int(part) for part in parts]
        if numbers == list(range(numbers[0], numbers[0] + len(numbers))):
            counted = f"{numbers[0]}..{numbers[-1]}"
            bare = start.endswith("[") and shared.startswith("]")
            return [f"{start}{counted}{shared}" if bare else f"{start}{{{counted}}}{shared}"]
    return [f"{start}{{{','.join(parts)}}}{shared}"]
