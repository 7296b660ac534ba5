"""What two vehicle files differ in, part by part."""

from __future__ import annotations

import json

import msgspec
import pytest
from sim.effects import preset

from hydro.cli import main
from hydro.core.difference.ahead import ERROR
from hydro.core.difference.changes import EVERYTHING, NOTHING, changes, table


@pytest.fixture(scope="module")
def craft(datasets):
    return preset(datasets, "remus100")


def replaced(vehicle, part, **values):
    return msgspec.structs.replace(
        vehicle, **{part: msgspec.structs.replace(getattr(vehicle, part), **values)}
    )


def with_effects(vehicle, *tables):
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def test_the_same_file_has_no_changes(craft):
    assert changes(craft, craft) == []
    assert table(craft, craft).is_empty()
    fitted = tuple(one | {"standard_error": {"x": 1.0}, "known": True} for one in craft.effect)
    assert changes(craft, with_effects(craft, *fitted)) == []


def test_numbers_have_units_and_places(craft):
    heavy = replaced(craft, "rigid_body", mass=31.0, center_of_gravity=(0.0, 0.0, 0.03))
    (change,) = changes(craft, heavy)
    assert change.part == "rigid_body"
    assert change.words == "mass 30.48 -> 31 kg, center_of_gravity[2] 0.0196 -> 0.03 m"
    assert change.undone == craft


def test_what_differs_by_little_shows_its_digits(craft):
    (change,) = changes(craft, replaced(craft, "rigid_body", mass=30.480001))
    assert change.words == "mass 30.48 -> 30.480001 kg"
    full = {"name": "linear_damping", "diagonal": [1.0] * 6}
    form = {"name": "linear_damping", "matrix": [[1.0] + [0.0] * 5] * 6}
    (change,) = changes(*(with_effects(craft, one) for one in (full, form)))
    assert change.words.startswith("diagonal [1, 1, 1, 1, 1, 1] -> none, matrix none -> [[1, 0,")


def test_thrusters_that_change_alike_stand_together(craft):
    slow = [msgspec.structs.replace(one, delay=0.1) for one in craft.thruster]
    slow[0] = msgspec.structs.replace(slow[0], curve="linear")
    found = changes(craft, msgspec.structs.replace(craft, thruster=tuple(slow)))
    assert [(one.part, one.words) for one in found] == [
        ("thruster main", "curve quadratic -> linear, delay 0 -> 0.1 s"),
        ("thruster bow_lateral, bow_vertical, stern_lateral, stern_vertical", "delay 0 -> 0.1 s"),
    ]
    assert found[0].undone.thruster == (craft.thruster[0], *slow[1:])
    fewer = msgspec.structs.replace(craft, thruster=craft.thruster[:3])
    (found,) = changes(craft, fewer)
    assert found.words.startswith("5 -> 3: the files do not share commands")
    assert table(craft, fewer)[ERROR].to_list() == [None] * 3


def test_effects_come_go_and_change(craft):
    drag, drift = craft.effects("quadratic_damping")[0], {"name": "ocean_current", "v_N": 0.2}
    others = [one for one in craft.effect if one["name"] not in ("quadratic_damping", "body_lift")]
    new = with_effects(craft, *others, drag | {"diagonal": [2.0, *drag["diagonal"][1:]]}, drift)
    found = {one.part: one for one in changes(craft, new)}
    assert list(found) == ["effect quadratic_damping", "effect body_lift", "effect ocean_current"]
    assert found["effect quadratic_damping"].words == "diagonal[0] 1.62 -> 2 N s^2/m^2"
    assert found["effect ocean_current"].words == "new: v_N 0.2 m/s"
    assert found["effect body_lift"].words.startswith("gone: L11 28.6 kg/m, L15 -6.15 kg")
    assert len(found["effect body_lift"].undone.effect) == len(new.effect) + 1
    assert found["effect quadratic_damping"].undone.effects("quadratic_damping") == (drag,)


def test_several_of_one_effect_are_counted(craft):
    cables = [{"name": "tether", "k": 1.0, "anchor": [x, 0.0, 0.0]} for x in (0.0, 5.0)]
    one, two = (with_effects(craft, *craft.effect, *cables[:n]) for n in (1, 2))
    (change,) = changes(one, two)
    assert change.words == "2: new: k 1 N/m, anchor [5, 0, 0] m"
    assert change.undone == one


def test_each_difference_is_weighed_where_the_second_file_is_the_truth(craft):
    drag = craft.effects("quadratic_damping")[0]
    others = [one for one in craft.effect if one is not drag]
    more = drag | {"diagonal": [4.0, *drag["diagonal"][1:]]}
    other = replaced(with_effects(craft, *others, more), "buoyancy", force=craft.buoyancy.force + 0.1)
    found = table(craft, other)
    assert found["undone"].to_list() == [NOTHING, "buoyancy", "effect quadratic_damping", EVERYTHING]
    own, lift, friction, both = found[ERROR]
    assert own < 1e-3 < min(lift, friction)
    assert both == pytest.approx((lift**2 + friction**2) ** 0.5, rel=0.2)


def test_the_command_says_it_in_words_and_as_json(datasets, tmp_path, capfd):
    file, other = datasets / "vehicles" / "remus100.toml", tmp_path / "other.toml"
    other.write_text(file.read_text().replace("mass = 30.48", "mass = 31.0"))
    assert main(["diff", str(file), str(other)]) == 0
    assert "mass 30.48 -> 31 kg" in " ".join(capfd.readouterr().out.split())
    assert main(["diff", str(file), str(other), "--json"]) == 0
    rows = json.loads(capfd.readouterr().out)["changes"]
    assert [row["undone"] for row in rows] == [NOTHING, "rigid_body", EVERYTHING]
    assert main(["diff", str(file), str(file)]) == 0
    assert "say the same" in capfd.readouterr().out
    assert main(["diff", str(file), "none.toml"]) == 1
