"""Limit on how deeply the content of a file is nested, because much of what reads it is recursive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

DEEPEST = 64
"""Most tables and lists inside one another; hydro's own files have at most 8, and recursion ends near 300."""


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
