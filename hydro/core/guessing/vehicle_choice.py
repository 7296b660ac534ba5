"""Vehicle of a log: a preset, a vehicle file, or a layout of thrusters with mass and box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hydro.core.errors import DataError, listed
from hydro.core.geometry.layouts import LAYOUTS, PLACES, Layout
from hydro.core.vehicle.description import Vector3


@dataclass(frozen=True)
class Hull:
    """Mass, box and thrust of a vehicle, from which its file is estimated with a layout of thrusters.

    Attributes:
        mass: Dry mass [kg].
        sides: Length, width, height [m] of the hull's box.
        thrust: Greatest thrust of each thruster [N]; None for thrusters of the type T200.
    """

    mass: float
    sides: Vector3
    thrust: float | None = None

    @property
    def text(self) -> str:
        """Mass, sides and, if given, thrust as text, separated by spaces."""
        numbers = [self.mass, *self.sides, *([] if self.thrust is None else [self.thrust])]
        return " ".join(f"{number:.9g}" for number in numbers)


@dataclass(frozen=True)
class Preset:
    """Known vehicle that can be chosen by its name.

    Attributes:
        name: Name of the vehicle.
        thrusters: Number of thrusters.
        hull: Mass and box.
        layout: Layout of thrusters, for the estimate of its file; None if it has a bundled file.
        servos: Whether some of its commands drive servos of fins.
    """

    name: str
    thrusters: int
    hull: Hull
    layout: Layout | None = None
    servos: bool = False


BLUEROV2 = Preset("bluerov2", 6, Hull(11.5, (0.457, 0.338, 0.254)), "bluerov2")
"""BlueROV2 with six T200s: 457 x 338 x 254 mm, 11 to 12 kg with ballast (Blue Robotics, datasheet)."""


@dataclass(frozen=True)
class Choice:
    """Chosen vehicle: one of preset, layout and file is set.

    Attributes:
        preset: Name of a preset with a bundled file.
        layout: Layout of thrusters.
        file: Path of a vehicle file.
        hull: Mass and box for the layout; None if they are still unknown.
    """

    preset: str | None = None
    layout: Layout | None = None
    file: str | None = None
    hull: Hull | None = None


def suited(fleet: Sequence[Preset], thrusters: int) -> Preset | None:
    """Return the lightest known vehicle with a number of thrusters, because most vehicles are small.

    A vehicle with fins is never guessed: the number of commands does not show which of them drive servos.

    Args:
        fleet: Vehicles that can be chosen by name.
        thrusters: Number of thrusters.

    Returns:
        The vehicle; None if no vehicle has that number.
    """
    alike = (one for one in fleet if one.thrusters == thrusters and not one.servos)
    return min(alike, key=lambda one: one.hull.mass, default=None)


def layout_for(thrusters: int) -> Layout | None:
    """Return the name of the last of LAYOUTS with a number of thrusters; None without one."""
    return next((layout for layout in reversed(LAYOUTS) if layouts_thrusters(layout) == thrusters), None)


def layouts_thrusters(layout: Layout) -> int:
    """Return the number of thrusters of a layout."""
    return len(PLACES[layout])


def chosen(text: str, fleet: Sequence[Preset], thrusters: int) -> Choice:
    """Return the vehicle that an answer names: a preset, a layout of thrusters, or the path of a file.

    Args:
        text: The answer.
        fleet: Vehicles that can be chosen by name (presets).
        thrusters: Number of commands in the log.

    Raises:
        DataError: The answer is empty, or its number of thrusters differs from that of the commands.
    """
    text = text.strip()
    if not text:
        raise DataError(f"name a preset, a layout or a vehicle file with {thrusters} thrusters")
    preset = next((one for one in fleet if one.name == text), None)
    layout = next((one for one in LAYOUTS if one == text), None)
    if preset is not None:
        count = preset.thrusters
    elif layout is not None:
        count = layouts_thrusters(layout)
    else:
        return Choice(file=text)
    if count != thrusters:
        raise DataError(
            f"{text} has {count} thrusters, but the log has {thrusters} commands: choose one with "
            f"{thrusters}, or name the columns of {count} thrusters (--commands)"
        )
    if preset is None:
        return Choice(layout=layout)
    return Choice(layout=preset.layout, hull=preset.hull) if preset.layout else Choice(preset=preset.name)


def hull_of(text: str) -> Hull:
    """Return the hull that a text describes: mass [kg], length, width, height [m], and perhaps thrust [N].

    Args:
        text: Four or five numbers in this order, separated by blanks or commas: "11.5 0.46 0.34 0.25".

    Raises:
        DataError: The text is not four or five numbers above 0.
    """
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) not in (4, 5) or not all(0.0 < number < float("inf") for number in numbers):
        raise DataError(
            f"{text!r}: give four numbers above 0: mass [kg], length, width and height [m], such as 11.5 "
            "0.46 0.34 0.25; a fifth is the greatest thrust of each thruster [N]"
        )
    mass, length, width, height, *thrust = numbers
    return Hull(mass, (length, width, height), thrust[0] if thrust else None)


def command_line(layout: Layout, hull: Hull, output: str) -> tuple[str, ...]:
    """Return the words of the command, after `hydro`, that writes an estimated vehicle file.

    Args:
        layout: Layout of the thrusters, also the name of the vehicle.
        hull: Mass, box and thrust of the vehicle.
        output: Path of the file to write.
    """
    sides = [
        word
        for name, side in zip(("length", "width", "height"), hull.sides, strict=True)
        for word in (f"--{name}", f"{side:g}")
    ]
    thrust = ["--curve", "t200"] if hull.thrust is None else ["--thrust", f"{hull.thrust:g}"]
    given = ["--name", layout, "--mass", f"{hull.mass:g}", *sides, "--layout", layout, *thrust]
    return ("vehicle", "new", *given, "--force", "-o", output)


def presets_named(fleet: Sequence[Preset], thrusters: int) -> str:
    """Return the names of vehicles with a number of thrusters, or of all if none fits, as `a, b or c`."""
    return listed(
        [one.name for one in fleet if one.thrusters == thrusters] or [one.name for one in fleet], "or"
    )
