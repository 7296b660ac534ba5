"""Parsing of TOML to a checked struct, with the path of errors in the file; plain content as TOML."""

from __future__ import annotations

import difflib
import os
import re
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from hydro.core import toml_text
from hydro.core.errors import DataError
from hydro.io.files import read_bytes

if TYPE_CHECKING:
    from tomlkit.items import Table

Struct = TypeVar("Struct", bound=msgspec.Struct)


def read(path: str | Path) -> str:
    """Return the text of a TOML file, without a byte order mark.

    Raises:
        DataError: The file cannot be read, or is not text.
    """
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{os.fspath(path)}: not UTF-8 text: save the file as UTF-8") from error


def parse(text: str, kind: type[Struct], name: str, check: Callable[[Struct], None]) -> Struct:
    """Return the content of a TOML text as a struct, checked and not changed.

    Args:
        text: TOML.
        kind: Struct type of the file's root.
        name: Name of the file in error messages.
        check: Function that raises `DataError`, with the path in the file, for rules that types cannot
            express.

    Raises:
        DataError: The text is not TOML, a key is missing, unknown or of the wrong type, or `check` fails; the
            message has the path in the file.
    """
    try:
        content = toml_text.content(text)
    except DataError as error:
        raise DataError(f"{name}: {error}") from error
    try:
        found = msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        raise DataError(f"{name}: {_message(str(error), content, kind)}") from error
    try:
        check(found)
    except DataError as error:
        raise DataError(f"{name}: {error}") from error
    return found


def joined(path: str, key: str) -> str:
    """Return the dotted path of a key: `path.key`, or `key` alone for the root (an empty `path`)."""
    return f"{path}.{key}" if path else key


def numbers(value: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield every float in nested mappings and lists, as a pair of its path in the file and the number.

    Args:
        value: Content of a TOML file, or a part of it.
        path: Path of that part.
    """
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from numbers(inner, joined(path, key))
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from numbers(inner, f"{path}[{index}]")
    elif isinstance(value, float):
        yield path, value


def table(content: Mapping[str, Any]) -> Table:
    """Return a mapping as a tomlkit table, without keys that are None.

    Matrices have a line per row, mappings become sub-tables.
    """
    import tomlkit

    made = tomlkit.table()
    for key, value in content.items():
        if value is None:
            continue
        if isinstance(value, Mapping):
            made.add(key, table(value))
            continue
        value = np.asarray(value).tolist()
        item = tomlkit.item(value)
        if isinstance(value, list) and value and isinstance(value[0], list):
            item.multiline(True)
        made.add(key, item)
    return made


def _message(message: str, content: Mapping[str, Any], kind: type[msgspec.Struct]) -> str:
    """Rewrite a message of msgspec as `rigid_body.mass: expected float > 0, got -3`."""
    what, _, where = message.partition(" - at `$")
    what = re.sub(r"(\d)\.0\b", r"\1", what.replace("`", ""))
    path = where.removesuffix("`").removeprefix(".")
    if match := re.fullmatch(r"Object missing required field (\w+)", what):
        return f"{joined(path, match[1])}: missing: add it"
    if match := re.fullmatch(r"Object contains unknown field (.+)", what):
        near = difflib.get_close_matches(match[1], sorted(_keys(kind)), 1)
        return f"{joined(path, match[1])}: unknown key: " + (
            f"did you mean {near[0]}?" if near else "remove it"
        )
    value: Any = content
    hints: set[Any] = {kind}
    for key, index in re.findall(r"([^.\[\]]+)|\[(\d+)\]", path):
        value = value[key] if key else value[int(index)]
        hints = {
            hint for outer in hints for hint in (_hints_under(outer, key) if key else _alternatives(outer))
        }
    if what.startswith("Invalid enum value"):
        choices = [choice for hint in hints if get_origin(hint) is Literal for choice in get_args(hint)]
        what = f"expected {' or '.join(map(str, choices))}"
    told = " ".join(str(value).split())  # in one line
    shown = f", got {told:.40}" if isinstance(value, str | int | float) and "got" not in what else ""
    return f"{path or 'file'}: {what[0].lower()}{what[1:]}{shown}"


def _keys(kind: Any) -> set[str]:
    """Return every key that a file described by the struct `kind` may have, at any depth."""
    if not _is_struct(kind):
        return set().union(*(_keys(part) for part in get_args(kind)))
    hints = get_type_hints(kind)
    return set(hints).union(*(_keys(hint) for hint in hints.values()))


def _hints_under(hint: Any, key: str) -> set[Any]:
    """Return the structs and literals that the type `hint` allows for its entry `key`."""
    known = [get_type_hints(part) for part in _alternatives(hint) if _is_struct(part)]
    return set().union(*(_alternatives(hints[key]) for hints in known if key in hints))


def _alternatives(hint: Any) -> set[Any]:
    """Return the structs and literals that a type consists of."""
    if get_origin(hint) in (Union, types.UnionType, tuple):
        return set().union(*(_alternatives(part) for part in get_args(hint)))
    return {hint}


def _is_struct(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, msgspec.Struct)
