"""Tell degrees from radians: an angle in radians is within a turn of zero, or counts turns without jumps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro.core.columns import Array

TURN = 2.0 * np.pi * 1.01
"""A whole turn [rad], with a hundredth for noise."""


def in_degrees(angles: Sequence[Array]) -> bool:
    """Return whether roll, pitch and yaw cannot be radians.

    Roll and pitch in radians are never beyond a turn.  Yaw in radians may count turns: it begins within one
    and goes on in steps below half a turn.

    Args:
        angles: Roll, pitch and yaw, (n,) each; NaN where there is no number.
    """
    roll, pitch, yaw = (each[np.isfinite(each)] for each in angles)
    if max(np.abs(roll).max(initial=0.0), np.abs(pitch).max(initial=0.0)) > TURN:
        return True
    if np.abs(yaw).max(initial=0.0) <= TURN:
        return False
    return bool(abs(yaw[0]) > TURN or np.abs(np.diff(yaw)).max(initial=0.0) > np.pi)
