"""What is known of a vehicle, and the rigid-body physics that follows from it."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    """A name that was here when this package was a module; with a warning."""
    from hydro._moved import attribute

    return attribute(__name__, name)
