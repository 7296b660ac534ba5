"""Thrusters from user input: seven numbers each, or a usual layout within the hull's box."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, get_args

import msgspec

from hydro.core.errors import DataError
from hydro.core.vehicle.description import Thruster

Layout = Literal["none", "single", "tunnel5", "vectored6", "vectored8", "bluerov2", "bluerov2_heavy"]
LAYOUTS: tuple[Layout, ...] = get_args(Layout)
GUESSED_LAG = 0.1
"""Default time constant of a thruster [s]; small electric thrusters have 0.03 to 0.2 s."""

AHEAD, ASIDE, DOWN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
TO_PORT, TO_STARBOARD = (math.sqrt(0.5), -math.sqrt(0.5), 0.0), (math.sqrt(0.5), math.sqrt(0.5), 0.0)
Placed = tuple[tuple[float, float, float], tuple[float, float, float]]
HORIZONTAL: tuple[Placed, ...] = (
    ((1 / 3, 1 / 3, 0.0), TO_PORT),
    ((1 / 3, -1 / 3, 0.0), TO_STARBOARD),
    ((-1 / 3, 1 / 3, 0.0), TO_STARBOARD),
    ((-1 / 3, -1 / 3, 0.0), TO_PORT),
)
"""Four horizontal thrusters at 45 degrees in the corners of the box; a positive command pushes ahead."""
TO_PORT_ASTERN, TO_STARBOARD_ASTERN = (
    (-math.sqrt(0.5), -math.sqrt(0.5), 0.0),
    (-math.sqrt(0.5), math.sqrt(0.5), 0.0),
)


def _ardusub_horizontal(x: float, y: float) -> tuple[Placed, ...]:
    """Return motors 1 to 4 of ArduSub's vectored frames: front right, front left, rear right, rear left.

    The directions are those of a positive output with MOT_n_DIRECTION = 1, by the signs of the mixer
    (AP_Motors6DOF, setup_motors): motors 1 and 2 push astern, 3 and 4 ahead, and the vertical motors down.

    Args:
        x: Distance of the motors from the middle along x, relative to the hull's length.
        y: Distance of the motors from the middle along y, relative to the hull's width.
    """
    return (
        ((x, y, 0.0), TO_STARBOARD_ASTERN),
        ((x, -y, 0.0), TO_PORT_ASTERN),
        ((-x, y, 0.0), TO_STARBOARD),
        ((-x, -y, 0.0), TO_PORT),
    )


PLACES: dict[Layout, tuple[Placed, ...]] = {
    "none": (),
    "single": (((-0.5, 0.0, 0.0), AHEAD),),
    "tunnel5": (
        ((-0.5, 0.0, 0.0), AHEAD),
        *(((x, 0.0, 0.0), direction) for x in (1 / 3, -1 / 3) for direction in (ASIDE, DOWN)),
    ),
    "vectored6": (*HORIZONTAL, ((0.0, 1 / 3, 0.0), DOWN), ((0.0, -1 / 3, 0.0), DOWN)),
    "vectored8": (*HORIZONTAL, *(((x, y, 0.0), DOWN) for x in (1 / 4, -1 / 4) for y in (1 / 3, -1 / 3))),
    "bluerov2": (*_ardusub_horizontal(1 / 3, 1 / 3), ((0.0, 1 / 3, 0.0), DOWN), ((0.0, -1 / 3, 0.0), DOWN)),
    "bluerov2_heavy": (
        *_ardusub_horizontal(1 / 3, 1 / 5),
        *(((x, y, 0.0), DOWN) for x in (1 / 4, -1 / 4) for y in (3 / 8, -3 / 8)),
    ),
}
"""Position from the box's centre, relative to the box's sides, and direction of thrust, for each thruster."""


def laid_out(
    layout: Layout, thrust: float, sides: Sequence[float], middle: Sequence[float] = (0.0, 0.0, 0.0)
) -> tuple[Thruster, ...]:
    """Return the thrusters of a usual layout in a hull's box.

    Args:
        layout: Name of the layout, one of LAYOUTS.
        thrust: Maximum thrust of each thruster [N], in both directions.
        sides: Length, width, height of the hull's box [m].
        middle: Centre of the box [m] from CO, FRD.

    Raises:
        DataError: The layout is unknown, or the thrust is not a positive number.
    """
    if layout not in PLACES:
        raise DataError(f"layout: expected {', '.join(LAYOUTS)}, got {layout}")
    placed = []
    for share, direction in PLACES[layout]:
        at = [middle[i] + share[i] * sides[i] for i in range(3)]
        placed.append([*at, *direction, thrust])
    return tuple(_made(index, numbers, f"layout {layout}") for index, numbers in enumerate(placed, start=1))


def parsed(texts: Sequence[str]) -> tuple[Thruster, ...]:
    """Return the thrusters that texts such as `0.2,0.1,0,1,0,0,40` describe, one per text.

    The numbers are position x, y, z [m] from CO (FRD), direction of thrust (of any length), and maximum
    thrust [N].  An optional eighth number is the maximum thrust astern [N].

    Raises:
        DataError: A text is not seven or eight numbers, has no direction or no positive thrust.
    """
    return tuple(
        _made(
            index, numbers_of(text, f"thruster {index}", (7, 8), "x,y,z,dx,dy,dz,max"), f"thruster {text!r}"
        )
        for index, text in enumerate(texts, start=1)
    )


def numbers_of(text: str, what: str, counts: Sequence[int], example: str) -> list[float]:
    """Return the finite numbers in a text with commas.

    Args:
        text: The text.
        what: Name of the input in an error message.
        counts: Allowed counts of numbers, such as 7 and 8.
        example: Expected form in an error message.

    Raises:
        DataError: The text is invalid; the message shows the expected form.
    """
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if len(found) not in counts or not all(math.isfinite(value) for value in found):
        raise DataError(
            f"{what}: {text!r} is not {example}: {' or '.join(map(str, counts))} numbers with commas"
        )
    return found


def driven(
    thrusters: Sequence[Thruster],
    curve: Literal["linear", "quadratic", "t200"] | None,
    time_constant: float | None,
) -> tuple[Thruster, ...]:
    """Return copies of thrusters with another thrust curve and time constant.

    Args:
        thrusters: The thrusters.
        curve: Thrust curve; None keeps each thruster's curve.  `t200` has its own maximum thrusts.
        time_constant: Time constant of the lag between command and thrust [s]; None keeps each thruster's.

    Raises:
        DataError: The time constant is negative or not finite.
    """
    changes: dict[str, Any] = {} if curve is None else {"curve": curve}
    if curve == "t200":
        changes |= {"max_thrust": None, "max_reverse_thrust": None}
    if time_constant is not None:
        if not 0.0 <= time_constant < math.inf:
            raise DataError(f"time constant: must be 0 s or more, got {time_constant:g}")
        changes["time_constant"] = time_constant
    return tuple(msgspec.structs.replace(thruster, **changes) for thruster in thrusters)


def _made(index: int, numbers: Sequence[float], what: str) -> Thruster:
    """Return a thruster from position, direction of any length, and maximum thrust ahead and astern."""
    x, y, z, dx, dy, dz, ahead, *rest = numbers
    astern = rest[0] if rest else ahead
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    if length == 0.0:
        raise DataError(
            f"{what}: its direction is 0,0,0: give the direction of its thrust, as 1,0,0 for ahead"
        )
    if not (math.isfinite(ahead) and math.isfinite(astern)) or min(ahead, astern) <= 0.0:
        raise DataError(f"{what}: the greatest thrust must be above 0 N, got {min(ahead, astern):g}")
    return Thruster(
        name=f"T{index}",
        position=(x, y, z),
        direction=(dx / length, dy / length, dz / length),
        max_thrust=ahead,
        max_reverse_thrust=astern,
        time_constant=GUESSED_LAG,
    )
