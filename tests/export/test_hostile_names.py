"""Hostile names of vehicles and thrusters: none executes code, ends a comment or breaks an exported file."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ET
from pathlib import Path

import msgspec
import pytest
from export.flown import vehicle

from hydro import cli
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.names import ALLOWED
from hydro.export.gazebo import to_sdf
from hydro.export.mujoco_model import to_mjcf
from hydro.export.python_class import to_python
from hydro.sim.stonefish.scenario import scenario
from hydro.sim.teacher import surface_of

CODE = '"""; raise SystemExit("run"); """'
HOSTILE = (
    CODE,
    "\"'''\" \\",
    "a\\",
    "two\nlines",
    "return\rhere",
    "line\u2028separator",
    'a --><model name="other"/><!-- b',
    'a" other="b',
    "control\x01character",
    "right\u202eto left",
    "rov/buoyancy",
    "{version}",
    "; rm -rf .",
    "n" * 5000,
)


def named(name: str, datasets: Path, thruster: str | None = None) -> Vehicle:
    """Return a vehicle with names for itself and its first thruster that bypass the checks."""
    craft = vehicle(datasets, "auv151")
    first = craft.thruster[0]
    if thruster is not None:
        first = msgspec.structs.replace(first, name=thruster)
    return msgspec.structs.replace(craft, name=name, thruster=(first, *craft.thruster[1:]))


def outline(source: bytes) -> list[str]:
    """Return the kinds of statements of a module and of its last class, without function bodies."""
    tree = ast.parse(source)
    *_, last = tree.body
    assert isinstance(last, ast.ClassDef)
    return [type(one).__name__ for one in (*tree.body, *last.body)]


@pytest.mark.parametrize("name", HOSTILE)
def test_a_name_in_python_is_text_and_nothing_else(name, datasets):
    craft = named(name, datasets, thruster=name)
    source = to_python(craft)
    assert outline(source) == outline(to_python(vehicle(datasets, "auv151")))
    namespace: dict = {}
    exec(compile(source, "exported", "exec"), namespace)
    made = list(namespace.values())[-1]
    assert (made.name, made.controls[0]) == (name, name)
    assert made.__doc__ == f"{name}."


@pytest.mark.parametrize("name", ["none", "True", "model", "commands", "BODY", "craft"])
def test_a_vehicle_may_be_called_as_something_in_the_file(name, datasets):
    namespace: dict = {}
    exec(compile(to_python(named(name, datasets)), "exported", "exec"), namespace)
    made = list(namespace.values())[-1]()
    assert made.name == name
    nu, _ = made.dynamics([0.0] * 6, made.nu, made.u_actual, [0.5] * 8, 0.02)
    assert any(nu)


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("write", [to_sdf, to_mjcf, lambda craft: scenario(craft, surface_of(craft, None))])
def test_xml_is_refused_a_name_that_it_cannot_hold(write, name, datasets):
    with pytest.raises(DataError, match=r"^name: must be letters, digits") as caught:
        write(named(name, datasets))
    assert "\n" not in str(caught.value)
    with pytest.raises(DataError, match=r"^thruster\[0\]\.name: must be letters, digits"):
        write(named("auv", datasets, thruster=name))


def test_allowed_names_stand_in_every_format_as_they_are(datasets):
    name = 'Sjøtroll\'s 2 ("heavy")_v1.0+b-c'
    craft = named(name, datasets, thruster="bow lateral (1)")
    for text in (to_sdf(craft), to_mjcf(craft)):
        found = {value for one in ET.fromstring(text).iter() for value in one.attrib.values()}
        assert name in found
        assert any("bow lateral (1)" in one for one in found)
    assert ET.fromstring(to_sdf(craft)).find("world").attrib["name"] == f"{name} in water"


def test_a_vehicle_file_with_such_a_name_is_one_line(datasets, tmp_path, capsys):
    text, path = (datasets / "vehicles" / "auv151.toml").read_text(), tmp_path / "auv.toml"
    for name in HOSTILE:
        written = msgspec.json.encode(name).decode()
        for old, where in (('"auv151"', "name"), ('"T1"', "thruster[0].name")):
            path.write_text(text.replace(f"name = {old}", f"name = {written}", 1))
            for command in (["check"], ["export", "--to", "python", "-o", str(tmp_path / "auv.py")]):
                assert cli.main([command[0], str(path), *command[1:]]) == 1
                told = capsys.readouterr().err
                assert told.startswith(f"hydro: {path}: {where}: must be {ALLOWED}, got ")
                assert told.count("\n") == 1
                assert len(told) < 400 + len(str(path))
    assert not (tmp_path / "auv.py").exists()
