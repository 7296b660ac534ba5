"""Registry of export targets: supported effects, omissions and their cost."""

from __future__ import annotations

import msgspec
import pytest
from export.flown import vehicle
from sim.effects import with_effect

from hydro.cli import main
from hydro.core.difference.ahead import flights
from hydro.core.errors import UsageError
from hydro.export.cost import ALL, of_lacks
from hydro.export.targets import Lack, all_left_out, choose, targets


@pytest.fixture(scope="module")
def craft(datasets):
    return vehicle(datasets, "remus100")


def test_every_target_is_in_the_help_and_in_the_docs(capsys, datasets):
    assert main(["export", "--help"]) == 0
    shown = capsys.readouterr().out
    page = (datasets.parent / "docs" / "export.md").read_text()
    for name, target in targets().items():
        assert f"{name} " in shown
        assert target.suffix in shown
        assert f"--to {name}" in page or f".{name}" in page, f"docs/export.md knows no {name}"


def test_a_target_is_known_by_its_name_its_suffix_or_as_the_only_one():
    assert choose("python", "vehicle", "-").name == "python"
    assert choose(None, "vehicle", "rov.py").name == "python"
    assert choose(None, "model", "-").name == "onnx"
    with pytest.raises(UsageError, match="there is no such target; there are python, "):
        choose("simulink", "vehicle", "-")
    with pytest.raises(UsageError, match=r"a network or a policy .*; a vehicle file goes to python, "):
        choose("onnx", "vehicle", "-")
    with pytest.raises(UsageError, match="--to: choose one of python, "):
        choose(None, "vehicle", "rov.toml")
    with pytest.raises(UsageError, match=r"--to python: takes a vehicle file .*goes to onnx"):
        choose("python", "model", "-")


def test_leaving_out_costs_what_predictions_of_the_vehicles_own_flights_say(craft):
    drag = Lack("drag", "for a test", craft.without("quadratic_damping"))
    lift = Lack("lift", "for a test", craft.without("body_lift"))
    log = Lack("log", "nothing moves by it")
    table = of_lacks(craft, [drag, lift, log])
    assert table["left out"].to_list() == ["nothing", "drag", "lift", "log", ALL]
    own, no_drag, no_lift, no_log, both = table["error 5 s ahead [m/s]"]
    assert own < 1e-3 < min(no_drag, no_lift)
    assert both > 0.5 * max(no_drag, no_lift)
    assert no_log is None
    assert of_lacks(craft, [log])["error 5 s ahead [m/s]"].to_list() == [None]


def test_on_a_recording_the_costs_stand_beside_the_files_own_error(craft):
    raw = flights(with_effect(craft, "net_buoyancy")).head(4500)
    table = of_lacks(craft, [Lack("lift", "for a test", craft.without("body_lift"))], raw)
    own, without = table["error 5 s ahead [m/s]"]
    assert own > 0.01
    assert without != own


def test_all_that_is_left_out_goes_together(datasets):
    craft = with_effect(with_effect(vehicle(datasets, "auv151"), "fluid_memory"), "tether")
    quick = tuple(msgspec.structs.replace(one, time_constant=0.0) for one in craft.thruster)
    lacks = [
        Lack("a", "", craft.without("tether")),
        Lack("b", "", msgspec.structs.replace(craft, thruster=quick)),
        Lack("c", "", craft.without("fluid_memory")),
        Lack("d", ""),
    ]
    left = all_left_out(craft, lacks)
    assert left == msgspec.structs.replace(vehicle(datasets, "auv151"), thruster=quick)


def test_the_command_writes_and_says_what_is_left_out(datasets, tmp_path, capfd):
    file = tmp_path / "rov.toml"
    text = (datasets / "vehicles" / "remus100.toml").read_text()
    bias = '\n[[effect]]\nname = "sensor_bias"\nb = [0.05, 0.0, 0.0]\n'
    file.write_text(text + bias)
    out = tmp_path / "rov.py"
    code = main(["export", str(file), "-o", str(out)])
    said = capfd.readouterr().err
    assert code == 0, said
    assert "sensor_bias" in said
    assert "error of the DVL" in said
    assert "class Remus100(Craft)" in out.read_text()
    assert main(["export", str(datasets / "vehicles" / "auv151.toml"), "-o", str(out)]) == 0
    assert "python holds all that the file says" in capfd.readouterr().err


def test_wrong_use_is_said_in_one_line(datasets, tmp_path, capfd):
    file = str(datasets / "vehicles" / "remus100.toml")
    for line, words in (
        (["export", file, "--to", "simulink"], "there is no such target"),
        (["export", "none.toml", "--to", "python"], "none.toml"),
        (["export", "none.parquet", "--on", file], "nothing is left out of a network"),
    ):
        assert main(line) != 0
        said = capfd.readouterr().err
        assert words in said
        assert said.count("\n") == 1
