"""The questions of `hydro start`: from a guessed map and the vehicles that are known, at most eight.

Each function is a generator: it yields a question, is sent the answer, and returns what the answers say.  So
questions depend on earlier answers, and nothing here knows a terminal.
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
"""Greatest number of questions: of the map one and five lines, or six lines; of the vehicle two."""
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
    """One question.

    Attributes:
        key: What it is about: `lines`, a line of the map, `vehicle` or `hull`.
        text: The question.
        default: The answer that Enter gives; empty where there is none.
        option: How the answer is given on a command line.
        check: Raises DataError for an answer that is none.
    """

    key: str
    text: str
    default: str
    option: str
    check: Callable[[str], object]


def lacking(blocks: Mapping[str, Block]) -> list[str]:
    """Return what a map needs and these blocks do not have."""
    missing = [name for name in ("time", "commands") if name not in blocks]
    return missing if any(name in blocks for name in BLOCKS) else [*missing, listed(BLOCKS, "or")]


def about_map(
    columns: Sequence[str], blocks: Mapping[str, Block]
) -> Generator[Question, str, dict[str, Block]]:
    """Ask what the columns of a log mean: where a guess is whole, which of its lines are wrong; else all.

    Args:
        columns: All columns of the log.
        blocks: The guessed blocks of a map.

    Returns:
        The blocks after the answers.
    """
    found = dict(blocks)
    asked = list(KINDS)
    if not lacking(blocks):
        lines = [name for name in KINDS if name != "time"]
        text = f"Which lines are wrong, or lack something the log has? {', '.join(lines)}"
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
    """Ask which vehicle it is, and for its mass and box where it is no known one.

    Args:
        fleet: The presets.
        thrusters: How many commands the log has.
        footer: Name of the file in the recording's footer, the default; empty without one.
    """
    known = suited(fleet, thrusters)
    names = {one.name for one in fleet}
    layouts = [name for name in LAYOUTS if layouts_thrusters(name) == thrusters and name not in names]
    beside = f"; or a layout, to be asked for mass and box: {listed(layouts, 'or')}" if layouts else ""
    text = yield Question(
        "vehicle",
        f"Vehicle with {thrusters} thrusters: {presets_named(fleet, thrusters)}; a vehicle file{beside}",
        footer or (known.name if known is not None else ""),
        "--preset NAME, --vehicle FILE, or --mass KG --box L W H",
        lambda text: chosen(text, fleet, thrusters),
    )
    choice = chosen(text, fleet, thrusters)
    if choice.layout is None or choice.hull is not None:
        return choice
    text = yield Question(
        "hull",
        "Dry mass [kg], length, width and height [m]; of thrusters that are no T200s the greatest thrust [N]",
        known.hull.text if known is not None else "",
        "--mass KG --box L W H",
        hull_of,
    )
    return Choice(layout=choice.layout, hull=hull_of(text))


def by_options(
    fleet: Sequence[Preset], thrusters: int, name: str | None, layout: str | None, hull: Mapping[str, float]
) -> Choice:
    """Return the vehicle that options say.

    Args:
        fleet: The presets.
        thrusters: How many commands the log has.
        name: Of a preset.
        layout: Of the thrusters.
        hull: What was given of `mass`, `length`, `width`, `height` and `thrust`.

    Raises:
        DataError: They contradict each other or the log, or do not suffice.
    """
    word = name or layout or layout_for(thrusters)
    if word is None:
        raise DataError(
            f"no layout has {thrusters} thrusters: write a vehicle file (`hydro vehicle new --thruster ...`) "
            "and give it with --vehicle FILE"
        )
    choice = chosen(word, fleet if name else (), thrusters)
    if choice.file is not None:
        raise DataError(
            f"no preset is called {word}: choose {presets_named(fleet, thrusters)}, or --vehicle FILE"
        )
    if choice.preset is not None:
        if hull:
            raise DataError(
                f"{word} has a file of its own: leave --mass, --box and --thrust out, or give --layout"
            )
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
    """Return the lines of an answer.

    Raises:
        DataError: There is no such line, or the clock is among them, which stands.
    """
    words = text.replace(",", " ").split()
    lines = [name for name in KINDS if name != "time"]
    if words in ([], [NONE]):
        return []
    if unknown := [word for word in words if word not in lines]:
        raise DataError(f"{unknown[0]!r} is none of the lines {', '.join(lines)}; Enter: all are right")
    return [name for name in lines if name in words]


def _line(name: str, text: str, columns: Sequence[str]) -> Block | None:
    """Return the block of an answer.

    Raises:
        DataError: It is none, or missing where a map needs it.
    """
    found = block_of(name, text, columns)
    if found is None and name in ("time", "commands"):
        raise DataError(f"{name}: a recording needs it: give columns, such as {EXAMPLES[name]}")
    return found
