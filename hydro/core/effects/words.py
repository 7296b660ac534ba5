"""Texts shared by records of effects: motions that separate similar effects, and artefacts of the log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

HEADINGS = (
    "hold one thrust and turn slowly through all headings: a current stays in the north and east, a "
    "tether pulls toward its anchor, a bias turns with the vehicle"
)
CHIRP = (
    "a chirp on surge, sway and yaw from 0.05 to 2 Hz: lag, delay and added mass part in how they grow "
    "with frequency"
)
DRIFT = "straight runs at several drift angles, at half and at full speed, then turns on the spot"
TILTS = "hold still at tilts of 10 to 20 degrees in roll and pitch, both ways, at two depths"
DEPTHS = "hold one thrust and heading at several depths, as far apart as the vehicle may dive"
PASSES = "run the same legs at the beginning and at the end of a long session, in the same headings"
DISTANCES = "straight runs ahead and sideways, there and back, over distances known from the pose"
COASTING = "a powered step from rest to full speed with the thrusters in turn, then coast down without thrust"

ONE_SAMPLE = 1.05  # samples below which a delay counts as a convention of the log
ALONE = 3.0  # ratio of a DVL's yaw to its roll and pitch above which it may be a heading error


def a_sample_late(parameters: Mapping[str, Any], dt: float) -> str | None:
    """Return a remark if a fitted delay is at most one sample: it may be a convention of the log; else None.

    Args:
        parameters: Parameters of the finding, with the delay `d` [s].
        dt: Sample time [s].
    """
    if abs(float(parameters["d"])) > ONE_SAMPLE * dt:
        return None
    return (
        "no more than one sample: most likely a convention of the log (whether a command is logged "
        "before or after it acts), not the vehicle; settle it in the log before believing lag or delay"
    )


def a_heading_off(parameters: Mapping[str, Any], dt: float) -> str | None:
    """Return a remark if a DVL is rotated in yaw alone, which a wrong heading explains as well; else None.

    A log cannot separate a DVL that is turned by an angle in yaw from a heading that is off by minus that
    angle.

    Args:
        parameters: Parameters of the finding, with the angles `alpha` of the DVL, (3,) [rad].
        dt: Sample time [s]; not used.
    """
    roll, pitch, yaw = (float(angle) for angle in parameters["alpha"])
    if abs(yaw) < ALONE * max(abs(roll), abs(pitch)):
        return None
    return (
        f"the DVL is rotated by {yaw:.3g} rad in yaw, or the heading is off by {-yaw:.3g} rad (compass, "
        "declination): both give the same data; correct the wrong one, or add it with `hydro add`"
    )
