"""Questions of `hydro start` about a guessed map and about the vehicle: at most eight.

Each function is a generator. It yields a question, receives the answer and returns the result. A question can
depend on earlier answers. The module is independent of the terminal.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass

from hydro.core.errors import DataError, listed
from hydro.core.geometry.layouts import LAYOUTS
from hydro.core.guessing.map_lines import EXAMPLES, KINDS, NONE, Block, block_of, text_of
from hydro.core.guessing.vehicle_choice import (
    Choice,
    Hull,
    Preset,
    chosen,
    hull_of,
    layout_for,
    layouts_thrusters,
    presets_named,
    suited,
)
from hydro.core.logs.logmap import BLOCKS

MOST = 8
"""Maximum number of questions: one and five lines of the map, or six lines; two about the vehicle."""
MEANINGS = {
    "time": "Clock: column and unit",
    "position": "Position or depth: columns, world axes, unit",
    "attitude": "Attitude: roll, pitch, yaw or a quaternion; unit, world and body axes",
    "velocity": "Velocity over ground (DVL): columns, axes, unit",
    "rates": "Angular velocity (gyroscope): columns, axes, unit",
    "commands": "Thruster commands in the thrusters' order: columns, unit (1 is -1 to 1, percent, pwm)",
}


@dataclass(frozen=True)
class Question:
    """One question of `hydro start` to its user.

    Attributes:
        key: Subject: `lines`, a line of the map, `vehicle` or `hull`.
        text: The question.
        default: Answer that Enter gives; empty without a default.
        option: Option that gives the answer on the command line.
        check: Function of an answer that raises DataError if the answer is invalid.
    """

    key: str
    text: str
    default: str
    option: str
    check: Callable[[str], object]


def lacking(blocks: Mapping[str, Block]) -> list[str]:
    """Return the names of required blocks that a map lacks.

    Required are `time`, `commands`, and one of the measured quantities, named together as `a, b or c`.

    Args:
        blocks: Blocks of the map by name; a block says which columns hold one quantity.
    """
    missing = [name for name in ("time", "commands") if name not in blocks]
    return missing if any(name in blocks for name in BLOCKS) else [*missing, listed(BLOCKS, "or")]


def about_map(
    columns: Sequence[str], blocks: Mapping[str, Block]
) -> Generator[Question, str, dict[str, Block]]:
    """Ask for the columns of a log: for lines to correct if the guess is complete, otherwise for every line.

    This is a generator: it yields questions, and `send` gives it the answer to each as text.

    Args:
        columns: All columns of the log.
        blocks: Guessed blocks of a map by name; a block says which columns hold one quantity.

    Returns:
        A new dict of the blocks after the answers.
    """
    found = dict(blocks)
    asked = list(KINDS)
    if not lacking(blocks):
        lines = [name for name in KINDS if name != "time"]
        text = f"Lines to correct ({', '.join(lines)})"
        asked = _named((yield Question("lines", text, NONE, "--velocity, --commands, ...", _named)))
    for name in asked:
        before = text_of(name, found.get(name))

        def check(text: str, name: str = name) -> object:
            return _line(name, text, columns)

        text = yield Question(name, f"{MEANINGS[name]}, such as {EXAMPLES[name]}", before, f"--{name}", check)
        if text == before:
            continue
        found.pop(name, None)
        if (block := _line(name, text, columns)) is not None:
            found[name] = block
    return found


def about_vehicle(
    fleet: Sequence[Preset], thrusters: int, footer: str = ""
) -> Generator[Question, str, Choice]:
    """Ask for the vehicle; for a layout of thrusters also for mass and box of the hull.

    This is a generator: it yields questions, `send` gives it the answer to each, and it returns the choice.

    Args:
        fleet: Vehicles that can be chosen by name.
        thrusters: Number of commands in the log.
        footer: Default answer if the recording has a vehicle file in its footer; otherwise empty.
    """
    known = suited(fleet, thrusters)
    names = {one.name for one in fleet}
    layouts = [name for name in LAYOUTS if layouts_thrusters(name) == thrusters and name not in names]
    more = f"; or the layout {listed(layouts, 'or')}, with mass and box" if layouts else ""
    text = yield Question(
        "vehicle",
        f"Vehicle with {thrusters} thrusters: preset {presets_named(fleet, thrusters)}; a vehicle file{more}",
        footer or (known.name if known is not None else ""),
        "--preset NAME, --vehicle FILE, or --mass KG --box L W H",
        lambda text: chosen(text, fleet, thrusters),
    )
    choice = chosen(text, fleet, thrusters)
    if choice.layout is None or choice.hull is not None:
        return choice
    text = yield Question(
        "hull",
        "Dry mass [kg], length, width, height [m]; also the maximum thrust [N] of thrusters other than T200",
        known.hull.text if known is not None else "",
        "--mass KG --box L W H",
        hull_of,
    )
    return Choice(layout=choice.layout, hull=hull_of(text))


def by_options(
    fleet: Sequence[Preset], thrusters: int, name: str | None, layout: str | None, hull: Mapping[str, float]
) -> Choice:
    """Return the vehicle that command-line options select; without a name, a layout for the thrusters.

    Args:
        fleet: Vehicles that can be chosen by name.
        thrusters: Number of commands in the log.
        name: Name of a preset (a vehicle of `fleet`); None if not given.
        layout: Name of a layout of thrusters; None if not given.
        hull: The given ones of `mass` [kg], `length`, `width`, `height` [m] and `thrust` [N], by these names.

    Raises:
        DataError: The options contradict each other or the log, or are incomplete.
    """
    word = name or layout or layout_for(thrusters)
    if word is None:
        raise DataError(
            f"no layout has {thrusters} thrusters: write a vehicle file (`hydro vehicle new --thruster ...`) "
            "and give it with --vehicle FILE"
        )
    choice = chosen(word, fleet if name else (), thrusters)
    if choice.file is not None:
        raise DataError(f"unknown preset {word}: choose {presets_named(fleet, thrusters)}, or --vehicle FILE")
    if choice.preset is not None:
        if hull:
            raise DataError(f"the preset {word} defines mass and box: leave them out, or give --layout")
        return choice
    known = choice.hull or Hull(0.0, (0.0, 0.0, 0.0))
    sides = zip(("length", "width", "height"), known.sides, strict=True)
    length, width, height = (hull.get(key, side) for key, side in sides)
    made = Hull(hull.get("mass", known.mass), (length, width, height), hull.get("thrust", known.thrust))
    if not (made.mass and all(made.sides)):
        missing = [*([] if made.mass else ["--mass KG"]), *([] if all(made.sides) else ["--box L W H"])]
        raise DataError(f"the layout {word} needs {listed(missing)}")
    return Choice(layout=choice.layout, hull=hull_of(made.text))


def _named(text: str) -> list[str]:
    """Return the lines that an answer names.

    Raises:
        DataError: An unknown line, or the clock, which is not asked again.
    """
    words = text.replace(",", " ").split()
    lines = [name for name in KINDS if name != "time"]
    if words in ([], [NONE]):
        return []
    if unknown := [word for word in words if word not in lines]:
        raise DataError(
            f"{unknown[0]!r} is not a line: name some of {', '.join(lines)}, or press Enter if all are right"
        )
    return [name for name in lines if name in words]


def _line(name: str, text: str, columns: Sequence[str]) -> Block | None:
    """Return the block that an answer describes; None for `none`.

    Raises:
        DataError: The answer is invalid, or `none` for a required line.
    """
    found = block_of(name, text, columns)
    if found is None and name in ("time", "commands"):
        raise DataError(f"{name}: required: name its columns, such as {EXAMPLES[name]}")
    return found
