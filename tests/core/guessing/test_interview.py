"""Questions about a map and a vehicle: at most eight, each with a default, and what the answers make."""

from __future__ import annotations

from collections.abc import Generator
from itertools import combinations
from typing import Any

import pytest

from hydro.core.errors import DataError
from hydro.core.geometry.layouts import LAYOUTS
from hydro.core.guessing import interview
from hydro.core.guessing.aliases import guess
from hydro.core.guessing.interview import MOST, Question, about_map, about_vehicle, by_options
from hydro.core.guessing.map_lines import KINDS
from hydro.core.guessing.vehicle_choice import BLUEROV2, Choice, Hull, Preset, command_line, hull_of

NAMES = [*("t", "x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r", "a", "b", "c")]
NAMES += [f"cmd_{number}" for number in range(1, 7)]
WHOLE = guess(NAMES)
FLEET = [
    BLUEROV2,
    Preset("small", 8, Hull(13.5, (0.46, 0.58, 0.38))),
    Preset("large", 8, Hull(151.0, (1.4, 0.7, 0.5))),
]


def talked(questions: Generator[Question, str, Any], answers: dict[str, str]) -> tuple[Any, list[Question]]:
    """Answer questions by their keys, else by Enter; return what they say, and the questions."""
    asked = list[Question]()
    try:
        question = next(questions)
        while True:
            asked.append(question)
            answer = answers.get(question.key, question.default)
            question.check(answer)
            question = questions.send(answer)
    except StopIteration as end:
        return end.value, asked


def test_a_whole_guess_is_confirmed_by_one_question() -> None:
    blocks, asked = talked(about_map(NAMES, WHOLE), {})
    assert [one.key for one in asked] == ["lines"]
    assert blocks == WHOLE


def test_a_line_that_is_wrong_is_asked_and_changed_alone() -> None:
    blocks, asked = talked(
        about_map(NAMES, WHOLE), {"lines": "velocity rates", "velocity": "a b c FLU", "rates": "none"}
    )
    assert [one.key for one in asked] == ["lines", "velocity", "rates"]
    assert asked[1].default == "u v w FRD m/s"
    assert blocks["velocity"] == {"columns": ["a", "b", "c"], "frame": "FLU"}
    assert "rates" not in blocks
    assert all(blocks[name] == WHOLE[name] for name in ("time", "position", "attitude", "commands"))


def test_where_something_is_missing_every_line_is_asked() -> None:
    bare = {name: WHOLE[name] for name in ("time", "position")}
    assert interview.lacking(bare) == ["commands"]
    blocks, asked = talked(about_map(NAMES, bare), {"commands": "cmd_{1..6}"})
    assert [one.key for one in asked] == list(KINDS)
    assert blocks == {**bare, "commands": WHOLE["commands"]}


def test_there_are_never_more_than_eight_questions() -> None:
    lines = [name for name in KINDS if name != "time"]
    _, asked = talked(about_map(NAMES, WHOLE), {"lines": " ".join(lines)})
    most = len(asked)
    for count in range(len(KINDS)):
        for names in combinations(KINDS, count):
            known = {name: WHOLE[name] for name in names}
            given = {"time": "t", "position": "x y z", "commands": "cmd_{1..6}"}
            most = max(most, len(talked(about_map(NAMES, known), given)[1]))
    _, asked = talked(about_vehicle(FLEET, 6), {"vehicle": "vectored6"})
    assert most + len(asked) == MOST


@pytest.mark.parametrize("needed", ["time", "commands"])
def test_what_a_map_needs_cannot_be_none(needed: str) -> None:
    known = {name: block for name, block in WHOLE.items() if name != needed}
    with pytest.raises(DataError, match=f"{needed}: required"):
        talked(about_map(NAMES, known), {})


def test_a_line_that_is_none_is_refused() -> None:
    with pytest.raises(DataError, match="'speed' is not a line: name some of position, attitude"):
        talked(about_map(NAMES, WHOLE), {"lines": "speed"})


@pytest.mark.parametrize(
    ("thrusters", "answers", "keys", "choice"),
    [
        (8, {}, ["vehicle"], Choice(preset="small")),
        (8, {"vehicle": "large"}, ["vehicle"], Choice(preset="large")),
        (6, {}, ["vehicle"], Choice(layout="bluerov2", hull=BLUEROV2.hull)),
        (8, {"vehicle": "vectored8"}, ["vehicle", "hull"], Choice(layout="vectored8", hull=FLEET[1].hull)),
        (
            1,
            {"vehicle": "single", "hull": "30 1.2 0.2 0.2 60"},
            ["vehicle", "hull"],
            Choice(layout="single", hull=Hull(30.0, (1.2, 0.2, 0.2), 60.0)),
        ),
        (7, {"vehicle": "mine.toml"}, ["vehicle"], Choice(file="mine.toml")),
    ],
)
def test_the_vehicle(thrusters: int, answers: dict[str, str], keys: list[str], choice: Choice) -> None:
    found, asked = talked(about_vehicle(FLEET, thrusters), answers)
    assert [one.key for one in asked] == keys
    assert found == choice


def test_the_vehicle_in_the_footer_is_the_default() -> None:
    assert talked(about_vehicle(FLEET, 8, "footer"), {})[0] == Choice(file="footer")


@pytest.mark.parametrize("thrusters", [2, 7])
def test_a_vehicle_of_other_thrusters_has_no_default(thrusters: int) -> None:
    question = next(about_vehicle(FLEET, thrusters))
    assert question.default == ""
    for answer in ("", "bluerov2", "vectored8"):
        with pytest.raises(DataError, match=rf"\b{thrusters}\b"):
            question.check(answer)


@pytest.mark.parametrize(
    "text", ["", "11.5 0.4 0.3", "11.5 0.4 0.3 0", "a b c d", "1 2 3 4 5 6", "nan 1 1 1"]
)
def test_a_hull_that_is_none(text: str) -> None:
    with pytest.raises(DataError, match="four numbers above 0"):
        hull_of(text)


@pytest.mark.parametrize(
    ("thrusters", "name", "layout", "hull", "choice"),
    [
        (8, "small", None, {}, Choice(preset="small")),
        (
            6,
            "bluerov2",
            None,
            {"mass": 12.0},
            Choice(layout="bluerov2", hull=Hull(12.0, BLUEROV2.hull.sides)),
        ),
        (
            5,
            None,
            None,
            {"mass": 30.0, "length": 1.2, "width": 0.3, "height": 0.2, "thrust": 50.0},
            Choice(layout="tunnel5", hull=Hull(30.0, (1.2, 0.3, 0.2), 50.0)),
        ),
        (
            6,
            None,
            "vectored6",
            {"mass": 9.0, "length": 0.5, "width": 0.4, "height": 0.3},
            Choice(layout="vectored6", hull=Hull(9.0, (0.5, 0.4, 0.3))),
        ),
    ],
)
def test_a_vehicle_by_options(
    thrusters: int, name: str | None, layout: str | None, hull: dict[str, float], choice: Choice
) -> None:
    assert by_options(FLEET, thrusters, name, layout, hull) == choice


@pytest.mark.parametrize(
    ("thrusters", "name", "layout", "hull", "told"),
    [
        (6, "none such", None, {}, "unknown preset none such: choose bluerov2"),
        (6, "small", None, {}, "small has 8 thrusters, but the log has 6 commands"),
        (8, "small", None, {"mass": 3.0}, "the preset small defines mass and box"),
        (6, None, "vectored6", {"mass": 9.0}, "vectored6 needs --box L W H"),
        (6, None, None, {"length": 1.0, "width": 1.0, "height": 1.0}, "bluerov2 needs --mass KG"),
        (7, None, None, {"mass": 9.0}, "no layout has 7 thrusters"),
        (6, None, "vectored6", {"mass": -1.0, "length": 1.0, "width": 1.0, "height": 1.0}, "above 0"),
    ],
)
def test_options_that_make_no_vehicle(
    thrusters: int, name: str | None, layout: str | None, hull: dict[str, float], told: str
) -> None:
    with pytest.raises(DataError, match=r"^[^\n]+$") as error:
        by_options(FLEET, thrusters, name, layout, hull)
    assert told in str(error.value)


def test_every_layout_has_a_command_line() -> None:
    for layout in LAYOUTS:
        line = command_line(layout, Hull(9.0, (0.5, 0.4, 0.3), 30.0), "v.toml")
        assert line[:2] == ("vehicle", "new")
        assert {layout, "9", "0.5", "0.4", "0.3", "30", "v.toml"} <= set(line)
