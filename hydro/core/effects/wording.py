"""Plain words for numbers: values with standard errors, compass headings, places on the body, lists."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Names of the six degrees of freedom (SNAME)."""
POINTS = ("N", "NNE", "NE", "ENE", "E", "ESE", "SE", "SSE", "S", "SSW", "SW", "WSW", "W", "WNW", "NW", "NNW")
"""Points of the compass, clockwise from north."""
MOST_DIGITS = 3
"""Maximum significant digits of a value, for any standard error: two fits of one log differ in the fourth."""
CLOSE_DIGITS = 4
"""Maximum significant digits of a value that is compared with a close one: three would hide the change."""
UNCERTAINTY = re.compile(r" \([^()]*(?:±|\bwas )[^()]*\)")
"""Pattern of a standard error or of the file's value in parentheses."""
PLAIN_DIGITS = 3
"""Significant digits of a value without a standard error."""
LEAST_PLACE, PLACE_DECIMALS = 0.005, 2
"""Smallest written coordinate of a place [m], and its decimals: the resolution of a tape."""
LEAST_PART = 0.05
"""Smallest share of the largest coordinate that is written; smaller ones are negligible."""
LARGEST_DOUBT = 0.1
"""Standard error [m] above which a coordinate near 0 does not mean the origin."""
MOST_PIECES = 6
"""Maximum numbers of thrusters in a list; longer lists become a count."""


def known(error: float) -> bool:
    """Return whether a standard error is usable: finite and above 0."""
    return math.isfinite(error) and error > 0.0


def superscript(unit: str) -> str:
    """Return a unit with its exponents as superscripts: `N s²/m²` for `N s^2/m^2`; an empty text for `1`."""
    return "" if unit == "1" else unit.replace("^2", "²").replace("^3", "³")


def decimals(value: float, error: float = math.nan, most: int = MOST_DIGITS) -> int:
    """Return the number of decimals for a value: one digit of its error, or three digits of the value.

    Args:
        value: Value.
        error: Its standard error; NaN, 0 and infinity mean unknown.
        most: Maximum number of significant digits.
    """
    size = math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0
    if not known(error):
        return max(PLAIN_DIGITS, most) - 1 - size
    last = -int(f"{error:.0e}".partition("e")[2])
    return min(last, most - 1 - size) if abs(value) > error else last


def plain(value: float, places: int) -> str:
    """Return a number as text with `places` decimals; very large and small numbers with a power of ten."""
    if value and (abs(value) >= 1e6 or (abs(value) < 1e-3 and places > 5)):
        mantissa, _, power = f"{value:.1e}".partition("e")
        return f"{mantissa}e{int(power)}"
    text = f"{round(value, places):.{max(places, 0)}f}"
    return text.removeprefix("-") if not float(text) else text


def number(value: float, error: float = math.nan, most: int = MOST_DIGITS) -> str:
    """Return a value as text, rounded to its standard error, or to `most` digits if the error is unknown.

    Args:
        value: The value.
        error: Its standard error; NaN, 0 and infinity mean unknown.
        most: Maximum number of significant digits.
    """
    text = plain(value, decimals(value, error, most))
    return text.rstrip("0").rstrip(".") if "." in text and "e" not in text and not known(error) else text


def uncertainty(value: float, error: float, most: int = MOST_DIGITS) -> str:
    """Return a standard error as text, rounded up to the last digit that its value shows.

    Args:
        value: The value.
        error: Its standard error; the text is empty if the error is unknown (NaN, 0 or infinite).
        most: Maximum number of significant digits of the value.
    """
    if not known(error):
        return ""
    places = decimals(value, error, most)
    return plain(max(round(error, places), 10.0**-places), places)


def quantity(value: float, error: float = math.nan, unit: str = "") -> str:
    """Return a value with unit and standard error as text: `0.25 m/s (±0.01)`, `65 % (±2)`, `3.0° (±0.2)`.

    Args:
        value: The value, in `unit`.
        error: Its standard error; NaN, 0 and infinity mean unknown.
        unit: Unit as in the catalogue (`N s^2/m^2`), `%` or `°`.
    """
    written, doubt = superscript(unit), uncertainty(value, error)
    gap = "" if written in ("", "°") else " "
    return f"{number(value, error)}{gap}{written}" + (f" (±{doubt})" if doubt else "")


def without_uncertainty(text: str) -> str:
    """Return a sentence without the brackets that hold standard errors and the values of the file."""
    return UNCERTAINTY.sub("", text)


def capital(text: str) -> str:
    """Return `text` with its first letter as a capital."""
    return text[:1].upper() + text[1:]


def listed(words: Sequence[str]) -> str:
    """Return words as one text, joined by commas and, before the last word, by `and`."""
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def group(numbers: Iterable[int], noun: str = "thruster") -> str:
    """Return words for numbered things, such as `thruster 3`, `thrusters 1, 2 and 5` or `thrusters 1 to 4`.

    More than MOST_PIECES separate pieces are only counted: `9 thrusters`.
    """
    runs = list[list[int]]()
    every = sorted(set(numbers))
    for one in every:
        if runs and one == runs[-1][-1] + 1:
            runs[-1].append(one)
        else:
            runs.append([one])
    pieces = list[str]()
    for run in runs:
        pieces += [f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run)
    if len(pieces) > MOST_PIECES:
        return f"{len(every)} {noun}s"
    return f"{noun}{'s' * (len(every) > 1)} {listed(pieces)}"


def compass(north: float, east: float) -> str:
    """Return a direction as heading and compass point, one of sixteen: `323° (NW)`.

    Args:
        north: Component toward north, in any unit.
        east: Component toward east, in the same unit.
    """
    heading = math.degrees(math.atan2(east, north)) % 360.0
    return f"{round(heading) % 360}° ({POINTS[round(heading / 22.5) % 16]})"


def sides(x: float, y: float, z: float) -> tuple[str, str, str]:
    """Return words for the side of each component of a body vector, such as `forward`, `to port`, `below`.

    Args:
        x: Component forward; only its sign counts.
        y: Component to starboard.
        z: Component downward.
    """
    return (
        "forward" if x > 0.0 else "aft",
        "to starboard" if y > 0.0 else "to port",
        "below" if z > 0.0 else "above",
    )


def place(
    point: Sequence[float], errors: Sequence[float] = (math.nan,) * 3, origin: str = "the origin"
) -> str:
    """Return words for the place of a point of the body: `0.22 m forward, 0.10 m below the origin`.

    Args:
        point: x y z from the body origin [m], FRD.
        errors: Standard errors [m].  Coordinates below their standard error are omitted, and negligible ones.
        origin: Name of the reference point.

    Returns:
        The place; the origin's name if no coordinate remains, or a note that the place is undetermined.
    """
    least = max(LEAST_PLACE, LEAST_PART * max(map(abs, point)))
    kept = [
        (value, error, side)
        for value, error, side in zip(point, errors, sides(*point), strict=True)
        if abs(value) >= max(least, error if known(error) else 0.0)
    ]
    if not kept:
        return "an undetermined place" if any(known(e) and e > LARGEST_DOUBT for e in errors) else origin
    pieces = []
    for value, error, side in kept:
        places = min(decimals(value, error) if known(error) else decimals(value) + 1, PLACE_DECIMALS)
        pieces.append(f"{plain(abs(value), places)} m {side}")
    below = kept[-1][2] in ("below", "above")
    return f"{', '.join(pieces)}{' ' if below else ' of '}{origin}"
