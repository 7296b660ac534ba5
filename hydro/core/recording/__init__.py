"""A recording as arrays, its segments, its smoothed motion and its sensors' faults."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """A name that was here when this package was a module; with a warning."""
    from hydro._moved import attribute

    return attribute(__name__, name)
