"""Vehicle file and the rigid-body physics that follows from it."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """Return a name that moved to another module when this module became a package, with a warning."""
    from hydro._moved import attribute

    return attribute(__name__, name)
