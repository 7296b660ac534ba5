"""Text of a vehicle file that keeps the comments and layout of an earlier text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from hydro.core.vehicle.description import Vehicle, as_written
from hydro.io import toml
from hydro.io.vehicle import parse


def rewritten(vehicle: Vehicle, text: str = "") -> str:
    """Return the text of a vehicle file for `vehicle`, with as much of `text` as possible.

    Args:
        vehicle: The vehicle.
        text: Earlier file, empty by default.  Comments, layout and unchanged numbers are kept.  Tables of
            effects and thrusters are matched by name.

    Raises:
        DataError: `text` is not a vehicle, or `vehicle` breaks a rule of vehicle files.
    """
    import tomlkit

    document, vehicle = tomlkit.parse(text), as_written(vehicle)
    if text:
        _merge(document, as_written(parse(text, "source")), vehicle)
    else:
        content = {"format": vehicle.format, **_stated(vehicle)}
        for key in sorted(content, key=lambda key: isinstance(content[key], dict | list)):  # tables last
            _set(document, key, content[key])
    made = _spaced(tomlkit.dumps(document), text)
    parse(made, vehicle.name)
    return made


def _stated(value: Any) -> Any:
    """Return nested structs as tables, lists and scalars, without None and without default values."""
    if isinstance(value, msgspec.Struct):
        fields = ((field, getattr(value, field.name)) for field in msgspec.structs.fields(value))
        return {field.name: _stated(inner) for field, inner in fields if inner != field.default}
    if isinstance(value, Mapping):
        return {key: _stated(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, list | tuple):
        return [_stated(inner) for inner in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _items(value: Any) -> dict[str, Any]:
    """Return the entries of a struct or table other than None; defaults are included."""
    if isinstance(value, msgspec.Struct):
        value = {name: getattr(value, name) for name in value.__struct_fields__}
    return {key: inner for key, inner in value.items() if inner is not None}


def _merge(table: Any, old: Any, new: Any) -> None:
    """Change a TOML table from the content of `old` to that of `new`; keep unchanged parts as written."""
    from tomlkit.items import AoT

    before, after = _items(old), _items(new)
    for key in [key for key in table if key not in after]:
        table.remove(key)
    for key, value in after.items():
        stated, earlier = _stated(value), before.get(key)
        if stated == _stated(earlier) and (key in table or earlier is not None):
            continue
        if isinstance(stated, dict) and isinstance(table.get(key), Mapping):
            _merge(table[key], earlier, value)
        elif isinstance(table.get(key), AoT) and all(isinstance(entry, dict) for entry in stated):
            _merge_tables(table[key], list(earlier or ()), value)
        else:
            _set(table, key, stated)


def _merge_tables(tables: Any, old: list[Any], new: Sequence[Any]) -> None:
    """Change an array of named TOML tables from `old` to `new`: remove missing names, insert new ones."""
    for index, entry in enumerate(new):
        names = [_items(one).get("name") for one in old[index:]]
        name = _items(entry).get("name")
        if name in names:
            for _ in range(names.index(name)):
                del tables[index], old[index]
            _merge(tables[index], old[index], entry)
        else:
            tables.insert(index, toml.table(_stated(entry)))
            old.insert(index, entry)
    del tables[len(new) :]


def _set(table: Any, key: str, value: Any) -> None:
    """Set a key to plain content; lists of tables become `[[key]]`."""
    import tomlkit

    if _are_tables(value):
        table[key] = tomlkit.aot()
        for entry in value:
            table[key].append(toml.table(entry))
    else:
        table[key] = toml.table({key: value})[key]


def _are_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, Mapping) for entry in value)


def _spaced(made: str, text: str) -> str:
    """Return the text `made` with an empty line before each header, except where `text` has none there."""
    lines: list[str] = []
    for line in made.splitlines(keepends=True):
        last = lines[-1] if lines else "\n"
        if line.startswith("[") and last.strip() and not last.startswith("#") and last + line not in text:
            lines.append("\n")
        lines.append(line)
    return "".join(lines)
