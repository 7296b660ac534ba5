"""Lines of a map in words: what is printed is read back, and what is no line is refused by name."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.core.guessing.aliases import guess
from hydro.core.guessing.map_lines import KINDS, block_of, text_of

NAMES = [
    *("time_ms", "east_m", "north_m", "depth_m", "dvl_x", "dvl_y", "dvl_z"),
    *(f"servo{number}_raw" for number in range(1, 9)),
    *(f"/rov/thrusters.data[{number}]" for number in range(6)),
    *("vel x", "vel y", "vel z", "it's", "roll", "pitch", "yaw", "m"),
    *(f"/imu.orientation.{axis}" for axis in "xyzw"),
]
COMMANDS = [f"servo{number}_raw" for number in range(1, 9)]


@pytest.mark.parametrize(
    ("name", "block", "text"),
    [
        ("time", {"column": "time_ms", "unit": "ms"}, "time_ms ms"),
        (
            "position",
            {"columns": ["east_m", "north_m"], "world": "ENU", "depth": "depth_m"},
            "east_m north_m depth=depth_m ENU m",
        ),
        ("position", {"height": "depth_m", "unit": "cm"}, "height=depth_m cm"),
        (
            "position",
            {"depth": {"column": "depth_m", "scale": -1.0, "offset": 2.5}, "unit": "m"},
            "depth=depth_m*-1+2.5 m",
        ),
        (
            "attitude",
            {"quaternion": [f"/imu.orientation.{axis}" for axis in "xyzw"], "layout": "xyzw", "world": "ENU"},
            "/imu.orientation.{x,y,z,w} xyzw ENU FRD",
        ),
        ("attitude", {"columns": ["roll", "pitch", "yaw"], "unit": "deg"}, "roll pitch yaw deg NED FRD"),
        ("velocity", {"columns": ["dvl_x", "dvl_y", "dvl_z"], "frame": "FLU"}, "dvl_{x,y,z} FLU m/s"),
        ("velocity", {"columns": ["vel x", "vel y", "vel z"]}, "'vel {x,y,z}' FRD m/s"),
        (
            "velocity",
            {"columns": ["dvl_x", "it's", {"column": "dvl_z", "scale": -1.0}]},
            """dvl_x 'it'"'"'s' dvl_z*-1 FRD m/s""",
        ),
        ("rates", {"from": "attitude"}, "from=attitude"),
        ("commands", {"columns": COMMANDS, "unit": "pwm"}, "servo{1..8}_raw pwm"),
        (
            "commands",
            {"columns": [f"/rov/thrusters.data[{number}]" for number in range(6)]},
            "/rov/thrusters.data[0..5] 1",
        ),
        (
            "commands",
            {"columns": ["dvl_x", {"column": "dvl_y", "reverse": True}, {"column": "dvl_z", "scale": 0.01}]},
            "dvl_x dvl_y*-1 dvl_z*0.01 1",
        ),
    ],
)
def test_a_line_says_a_block_and_is_read_back(name: str, block: dict[str, Any], text: str) -> None:
    assert text_of(name, block) == text
    found = block_of(name, text, NAMES)
    assert found is not None
    assert found.items() >= block.items()
    assert text_of(name, found) == text


def test_none_is_no_block() -> None:
    for name in KINDS:
        assert block_of(name, text_of(name, None), NAMES) is None


def test_words_may_be_ends_of_columns_and_count() -> None:
    whole = [f"/rov/thrusters.data[{number}]" for number in range(6)]
    for text in ("thrusters.data[0..5]", "/rov/thrusters.data[{0..5}]", "thrusters.data[{0,1,2,3,4,5}]"):
        assert block_of("commands", text, NAMES) == {"columns": whole}


@pytest.mark.parametrize(("text", "unit"), [("roll pitch m unit=cm", "cm"), ("roll pitch m m", "m")])
def test_a_setting_stands_at_the_end_where_a_column_has_its_name(text: str, unit: str) -> None:
    assert block_of("position", text, NAMES) == {"columns": ["roll", "pitch", "m"], "unit": unit}


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("velocity", "dvl_x dvl_y dvl_q", "no column is called dvl_q: did you mean dvl_z?"),
        ("velocity", "dvl_x dvl_y", "velocity: expected 3 columns, got 2"),
        ("rates", "dvl_{x,y,z} ENU", "no column is called ENU"),
        ("position", "east_m depth=depth_m", "position: expected 0 or 2 columns, got 1"),
        ("position", "east_m north_m depth=deep", "no column is called deep"),
        ("attitude", "roll", "attitude: expected 3 or 4 columns, got 1"),
        ("time", "", "time: give one column"),
        ("commands", "pwm", "commands: give a column for each thruster"),
        ("commands", "'open", "No closing quotation"),
    ],
)
def test_what_is_no_line_is_refused(name: str, text: str, told: str) -> None:
    with pytest.raises(DataError, match=r"^[^\n]+$") as error:
        block_of(name, text, NAMES)
    assert told in str(error.value)


def test_an_end_of_several_columns_is_refused() -> None:
    with pytest.raises(DataError, match="2 columns have this ending"):
        block_of("time", "stamp", ["/a.stamp", "/b.stamp"])


@given(st.lists(st.text("abxyz019_ .[]{}*'\"", min_size=1, max_size=8), min_size=3, max_size=8, unique=True))
def test_columns_of_any_names_are_read_back(names: list[str]) -> None:
    block = {"columns": names, "unit": "pwm"}
    assert block_of("commands", text_of("commands", block), names) == block


def test_what_is_guessed_is_read_back() -> None:
    blocks = guess([*NAMES, "p", "q", "r"])
    assert set(blocks) >= {"time", "position", "attitude", "rates", "commands"}
    for name in set(blocks) & set(KINDS):
        found = block_of(name, text_of(name, blocks[name]), [*NAMES, "p", "q", "r"])
        assert found is not None
        assert found.items() >= blocks[name].items()
