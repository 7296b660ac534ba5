"""Vehicle files: what they may say, what the error names, and what rewriting leaves alone."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.io import vehicle

TEXT = """\
# The boat of the test pool.
format = "hydro-vehicle/1"
name = "pool"

[environment]
water_density = 1000.0   # fresh water

[rigid_body]
mass = 20
center_of_gravity = [0.0, 0.0, 0.01]
inertia = [[0.5, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.0]]

[buoyancy]
force = 196.2
center = [0.0, 0.0, 0.0]

[hull]
length = 0.8
width = 0.4
height = 0.3

[[thruster]]
name = "T1"
position = [0.0, 0.2, 0.0]
direction = [1.0, 0.0, 0.0]
max_thrust = 40.0
max_reverse_thrust = 30.0
time_constant = 0.1

[[thruster]]
name = "heave"
wrench = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
max_thrust = 40.0
max_reverse_thrust = 40.0

[[effect]]
name = "added_mass"
diagonal = [5.0, 10.0, 12.0, 0.1, 0.2, 0.2]   # by strip theory
"""
THRUSTER = 'name = "T1"'


def refused(text: str) -> str:
    """The line by which a text is refused."""
    with pytest.raises(DataError) as caught:
        vehicle.parse(text, "auv.toml")
    assert "\n" not in str(caught.value)
    return str(caught.value)


def changed(old: str, new: str) -> str:
    assert TEXT.count(old) >= 1
    return TEXT.replace(old, new, 1)


def test_a_vehicle_is_read_as_it_stands(tmp_path: Path) -> None:
    path = tmp_path / "pool.toml"
    path.write_text(TEXT)
    boat, text = vehicle.read(path)
    assert text == TEXT
    assert boat.name == "pool"
    assert boat.rigid_body.mass == 20.0
    assert boat.environment.gravity == 9.81
    assert boat.thruster[1].wrench == (0, 0, 1, 0, 0, 0)
    assert boat.effects("added_mass")[0]["diagonal"] == [5.0, 10.0, 12.0, 0.1, 0.2, 0.2]


def test_the_bundled_vehicles_are_sound(datasets: Path) -> None:
    paths = [path for path in datasets.rglob("*.toml") if "hydro-vehicle" in path.read_text()]
    assert len(paths) >= 4
    for path in paths:
        assert vehicle.read(path)[0].thruster


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("mass = 20", "mass = -3", "rigid_body.mass: expected float > 0, got -3"),
        ("mass = 20", "mass = 0", "rigid_body.mass: expected float > 0, got 0"),
        ("mass = 20", "mass = '20'", "rigid_body.mass: expected float, got str"),
        ("mass = 20", "mass = true", "rigid_body.mass: expected float, got bool"),
        ("mass = 20", "mass = inf", "rigid_body.mass: must be finite, got inf"),
        ("mass = 20", "", "rigid_body.mass: missing: add it"),
        ("mass = 20", "mas = 20\nmass = 20", "rigid_body.mas: unknown key: did you mean mass?"),
        ("mass = 20", "mass = 20\ncolour = 'red'", "rigid_body.colour: unknown key: remove it"),
        ("[hull]", "[hul]", "hul: unknown key: did you mean hull?"),
        ("vehicle/1", "vehicle/2", "format: expected hydro-vehicle/1, got hydro-vehicle/2"),
        ("mass = 20", "mass 20", "not valid TOML: Expected '=' after a key"),
        (
            "[0.0, 0.0, 0.01]",
            "[0.0, 0.01]",
            "rigid_body.center_of_gravity: expected array of length 3, got 2",
        ),
        ("[0.0, 0.0, 0.01]", "[0.0, 0.0, nan]", "rigid_body.center_of_gravity[2]: must be finite, got nan"),
        (
            "[[0.5, 0.0",
            "[[0.5, 0.1",
            "rigid_body.inertia: must be symmetric, but [0][1] is 0.1 and [1][0] is 0",
        ),
        (
            "[[0.5",
            "[[-0.5",
            "rigid_body.inertia: must be positive definite, but its principal moments are -0.5",
        ),
        ("[[0.5", "[[0.0", "rigid_body.inertia: must be positive definite"),
        ("[[0.5", "[[0.05", "rigid_body.inertia: no body has principal moments 0.05, 0.9, 1:"),
        ("[1.0, 0.0, 0.0]", "[1.0, 1.0, 0.0]", "thruster[0].direction: must have length 1, but it is 1.4142"),
        ("[1.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "thruster[0].direction: must have length 1, but it is 0:"),
        (
            "[1.0, 0.0, 0.0]",
            "[0.0, 3.0, -4.0]",
            "thruster[0].direction: must have length 1, but it is 5: write [0.0, 0.6, -0.8]",
        ),
        (
            "time_constant",
            "curve = 'cubic'\ntime_constant",
            "thruster[0].curve: expected linear or quadratic or t200 or none, got cubic",
        ),
        ("time_constant", "deadband = 1\ntime_constant", "thruster[0].deadband: expected float < 1, got 1"),
        (
            "time_constant",
            "lag_step = 0.1\ntime_constant",
            "thruster[0].lag_step: must be below time_constant = 0.1",
        ),
        ("position = [0.0, 0.2, 0.0]\n", "", "thruster[0]: give either position and direction, or wrench"),
        (
            "wrench",
            "position = [0, 0, 0]\nwrench",
            "thruster[1]: give either position and direction, or wrench",
        ),
        ("wrench = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]", "", "thruster[1]: give either position and direction"),
        ("[5.0, ", "[nan, ", "effect[0].diagonal[0]: must be finite, got nan"),
        ("[5.0, ", "['x', ", "effect[0]"),
        ("added_mass", "aded_mass", "effect[0].name: "),
        ("[[effect]]", "[effect]", "effect: expected array, got object"),
    ],
)
def test_what_is_wrong_is_named_by_its_path(old: str, new: str, line: str) -> None:
    assert refused(changed(old, new)).startswith(f"auv.toml: {line}")


def test_a_direction_is_checked_to_a_millionth_and_the_unit_vector_offered() -> None:
    vehicle.parse(changed("[1.0, 0.0, 0.0]", "[0.707107, 0.707107, 0.0]"))
    assert refused(changed("[1.0, 0.0, 0.0]", "[0.7071, 0.7071, 0.0]")).endswith(
        "write [0.707106781, 0.707106781, 0.0]"
    )


def test_rounding_of_an_inertia_is_let_pass_and_kept() -> None:
    text = changed("[[0.5, 0.0, 0.0]", "[[0.5, 1e-10, 0.0]")
    assert vehicle.parse(text).rigid_body.inertia[0][1] == 1e-10
    flat = changed("[[0.5", "[[0.1")  # a plate: one moment is the sum of the others
    assert vehicle.parse(flat).rigid_body.inertia[0][0] == 0.1


def test_names_are_there_and_thrusters_are_told_apart_by_theirs() -> None:
    assert "name: empty: give the vehicle a name" in refused(changed('name = "pool"', 'name = " "'))
    assert "thruster[0].name: empty" in refused(changed(THRUSTER, 'name = ""'))
    told = refused(changed('name = "heave"', THRUSTER))
    assert told == "auv.toml: thruster[1].name: T1 is thruster[0].name too: give each its own name"


def test_files_that_are_no_vehicles(tmp_path: Path) -> None:
    path = tmp_path / "auv.toml"
    path.write_bytes(b"name = '\xff'")
    with pytest.raises(DataError, match="not UTF-8 text: save the file as UTF-8"):
        vehicle.read(path)
    with pytest.raises(DataError, match="no such file"):
        vehicle.read(tmp_path / "none.toml")
    assert "not valid TOML" in refused("PAR1\0")
    assert "rigid_body: missing: add it" in refused("name = 'x'")


def test_a_mark_of_the_byte_order_is_no_part_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "vehicle.toml"
    path.write_bytes(b"\xef\xbb\xbf" + TEXT.encode())
    assert vehicle.read(path) == (vehicle.parse(TEXT), TEXT)


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(max_size=3) | st.integers(),
        lambda inner: st.lists(inner, max_size=3),
        max_leaves=5,
    ),
    st.sampled_from(
        [("rigid_body", "mass"), ("rigid_body", "inertia"), ("hull", "mesh"), ("thruster",), ("effect",)]
    ),
)
def test_whatever_stands_in_a_file_is_read_or_refused_in_one_line(value: Any, place: tuple[str, ...]) -> None:
    import tomlkit

    document = tomllib.loads(TEXT)
    *parents, key = place
    part = document
    for parent in parents:
        part = part[parent]
    if value is None:
        part.pop(key, None)
    else:
        part[key] = value
    try:
        text = tomlkit.dumps(document)
    except ValueError:
        return
    line = "auv.toml: "
    try:
        vehicle.parse(text, "auv.toml")
    except DataError as error:
        line = str(error)
    assert line.startswith("auv.toml: ")
    assert "\n" not in line


# Hashes


def test_the_hash_is_of_what_the_file_says() -> None:
    expected = vehicle.vehicle_hash(vehicle.parse(TEXT))
    for same in (
        changed("# The boat of the test pool.\n", ""),
        changed("mass = 20", "mass   =   20.0"),
        changed("[environment]", "[environment]\ngravity = 9.81"),
        changed("time_constant", "curve = 'linear'\ndelay = 0\ntime_constant"),
        changed("[0.0, 0.2, 0.0]", "[-0.0, 0.2, 0]"),
        changed("[5.0, 10.0", "[5, 10"),
    ):
        assert vehicle.vehicle_hash(vehicle.parse(same)) == expected
    for other in (
        changed("mass = 20", "mass = 20.000001"),
        changed("5.0, 10.0", "5.1, 10.0"),
        changed('"pool"', '"p"'),
    ):
        assert vehicle.vehicle_hash(vehicle.parse(other)) != expected


# Rewriting

FITTED: dict[str, Any] = {
    "name": "linear_damping",
    "diagonal": np.arange(1.0, 7.0),
    "fit": {"content": "sha256:ab", "standard_error": [0.1] * 6},
}


def plain(effect: dict[str, Any]) -> dict[str, Any]:
    return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in effect.items()}


def test_an_effect_is_added_at_the_end_and_nothing_else_is_touched() -> None:
    text = vehicle.append_effect(TEXT, FITTED)
    assert text.startswith(TEXT)
    assert tomllib.loads(text)["effect"] == [*tomllib.loads(TEXT)["effect"], plain(FITTED)]
    assert vehicle.parse(text).effects("linear_damping")
    twice = vehicle.append_effect(text, {"name": "added_mass", "matrix": np.eye(6)})
    assert tomllib.loads(twice)["effect"][-1]["matrix"] == np.eye(6).tolist()
    assert "\n    [1.0, 0.0" in twice, "a matrix takes a line per row"


def test_the_first_effect_of_a_file() -> None:
    bare = TEXT[: TEXT.index("[[effect]]")]
    assert tomllib.loads(vehicle.append_effect(bare, FITTED))["effect"] == [plain(FITTED)]


def test_effects_in_a_form_that_cannot_be_added_to() -> None:
    inline = 'effect = [{name = "added_mass"}]\n' + TEXT[: TEXT.index("[[effect]]")]
    with pytest.raises(DataError, match=r"write the effects as \[\[effect\]\] tables"):
        vehicle.append_effect(inline, FITTED)


def test_an_effect_is_set_where_it_stands_and_comments_stay() -> None:
    text = vehicle.append_effect(TEXT, FITTED)
    new = {"name": "added_mass", "diagonal": np.full(6, 2.0), "fit": {"content": "sha256:cd"}}
    done = vehicle.set_effect(text, new)
    assert tomllib.loads(done)["effect"] == [plain(new), plain(FITTED)]
    assert "# by strip theory" in done
    assert done.startswith(TEXT[: TEXT.index("diagonal")])
    assert vehicle.parse(done).effects("added_mass")[0]["diagonal"] == [2.0] * 6


def test_an_effect_that_is_not_there_is_added_and_an_unclear_one_refused() -> None:
    assert vehicle.set_effect(TEXT, FITTED) == vehicle.append_effect(TEXT, FITTED)
    twice = vehicle.append_effect(vehicle.append_effect(TEXT, FITTED), FITTED)
    with pytest.raises(DataError, match="2 are named linear_damping: say which of linear_damping:1, "):
        vehicle.set_effect(twice, FITTED)


def test_only_sound_vehicles_are_written(tmp_path: Path) -> None:
    path = tmp_path / "auv.toml"
    vehicle.write(TEXT, path)
    assert path.read_text() == TEXT
    with pytest.raises(DataError, match="mass"):
        vehicle.write(changed("mass = 20", "mass = -1"), path)
    assert path.read_text() == TEXT
