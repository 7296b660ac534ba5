"""Limit of the nesting of a file's content, because many of its readers are recursive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

DEEPEST = 64
"""Greatest number of nested tables and lists; hydro's own files have at most 8, recursion ends near 300."""


def too_deep(content: Any) -> bool:
    """Return whether mappings and sequences in `content` are nested more than `DEEPEST` levels.

    Args:
        content: Decoded TOML or JSON.
    """
    waiting = [(content, 0)]
    while waiting:
        value, depth = waiting.pop()
        if isinstance(value, Mapping):
            inner = [*value.values()]
        elif isinstance(value, list | tuple):
            inner = [*value]
        else:
            continue
        if depth == DEEPEST:
            return True
        waiting += [(one, depth + 1) for one in inner if isinstance(one, Mapping | list | tuple)]
    return False
