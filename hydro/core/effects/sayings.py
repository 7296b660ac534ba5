"""What a fitted effect means where it is not the vehicle's but the log's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ONE_SAMPLE = 1.05  # samples below which a delay is taken for a convention of the log


def a_sample_late(parameters: Mapping[str, Any], dt: float) -> str | None:
    """A delay `d` [s] of up to one sample `dt` [s] is none of the vehicle's."""
    if abs(float(parameters["d"])) > ONE_SAMPLE * dt:
        return None
    return (
        "no more than one sample: most likely a convention of the log (whether a command is logged "
        "before or after it acts), not the vehicle; settle it in the log before believing lag or delay"
    )
