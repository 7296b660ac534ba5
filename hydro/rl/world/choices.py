"""Settings in nested dataclasses, read and changed by dotted name, such as `task.steps`."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any, TypeVar

import msgspec

from hydro.core.errors import UsageError

T = TypeVar("T")


def flat(config: Any) -> dict[str, str]:
    """Return all settings of a dataclass as JSON texts by dotted name, such as `{"task.steps": "500"}`."""
    return dict(_flat(msgspec.to_builtins(config)))


def built(kind: type[T], choices: Mapping[str, str]) -> T:
    """Return a new dataclass of type `kind` with the settings in `choices`.

    Args:
        kind: Dataclass, possibly with nested dataclasses.
        choices: JSON texts by dotted name, one for each of its settings.

    Raises:
        msgspec.MsgspecError: A value is not JSON, or has the wrong type.
        UsageError: A value is out of its range.
    """
    nested: dict[str, Any] = {}
    for name, value in choices.items():
        *groups, last = name.split(".")
        place = nested
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = msgspec.json.decode(value)
    return msgspec.convert(nested, kind)


def changed(config: T, choices: Mapping[str, str]) -> T:
    """Return a copy of a config in which the settings in `choices`, given as JSON texts, are replaced.

    Args:
        config: Dataclass, possibly with nested dataclasses.
        choices: JSON texts by dotted name, such as `{"task.steps": "200"}`.

    Raises:
        UsageError: A name is unknown, or its value is invalid.
    """
    known = flat(config)
    if unknown := [name for name in choices if name not in known]:
        near = [name for name in known if name.endswith(unknown[0])]
        meant = near or get_close_matches(unknown[0], known) or list(known)
        raise UsageError(f"no choice is called {unknown[0]!r}: choose one of {', '.join(meant)}")
    try:
        return built(type(config), known | dict(choices))
    except (msgspec.MsgspecError, RecursionError) as error:
        names = ", ".join(f"{name}={value}" for name, value in choices.items())
        raise UsageError(f"{names}: not a value for this choice ({error})") from error


def merged(config: T, choices: Mapping[str, Any]) -> T:
    """Return a copy of a config in which the settings in `choices`, given as Python values, are replaced.

    Args:
        config: Dataclass, possibly with nested dataclasses.
        choices: Python values by name, either nested, `{"task": {"steps": 200}}`, or dotted, `{"task.steps":
            200}`.

    Raises:
        UsageError: A name is unknown, or its value is invalid.
    """
    try:
        given = dict(_flat(msgspec.to_builtins(choices)))
    except (TypeError, ValueError) as error:
        raise UsageError(f"settings: expected numbers, texts and nested mappings ({error})") from error
    return changed(config, given)


def _flat(nested: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Flatten nested settings to pairs of dotted name and JSON text; `prefix` precedes every name."""
    found: list[tuple[str, str]] = []
    for name, value in nested.items():
        if isinstance(value, Mapping):
            found += _flat(value, f"{prefix}{name}.")
        else:
            found.append((f"{prefix}{name}", msgspec.json.encode(value).decode()))
    return found
