"""Several effects of one name in a vehicle file: what each is called, and where its values go."""

from __future__ import annotations

import tomllib
from pathlib import Path

import msgspec
import pytest

from hydro.core.errors import DataError
from hydro.core.prediction.parameters import free
from hydro.core.vehicle.description import Vehicle, as_written
from hydro.io import rewrite, vehicle

CAMERA, LAMP = {"name": "payload", "mass": 1.0, "w": 4.0}, {"name": "payload", "mass": 0.5, "w": 2.0}


@pytest.fixture(scope="module")
def text(datasets: Path) -> str:
    plain = (datasets / "vehicles" / "auv151.toml").read_text()
    return vehicle.append_effect(vehicle.append_effect(plain, CAMERA), LAMP)


def names(text: str) -> list[str]:
    return [table["name"] for table in vehicle.parse(text).effects("payload")]


def labelled(text: str, *labels: str) -> str:
    """The text with labels on its payloads, the last first."""
    for label in labels:
        before, _, after = text.rpartition('name = "payload"\nm')
        text = f'{before}name = "payload" \nlabel = {label}\nm{after}'
    return text


def test_each_has_a_name_of_its_own(text: str) -> None:
    assert names(text) == ["payload:1", "payload:2"]
    assert names(labelled(text, '"lamp"')) == ["payload:1", "payload:lamp"]
    assert names(labelled(text, '"lamp"', '"camera"')) == ["payload:camera", "payload:lamp"]


def test_a_single_one_keeps_its_name_and_one_with_a_label_is_called_by_it(datasets: Path) -> None:
    plain = (datasets / "vehicles" / "auv151.toml").read_text()
    assert names(vehicle.append_effect(plain, LAMP)) == ["payload"]
    assert names(vehicle.append_effect(plain, LAMP | {"label": "lamp"})) == ["payload:lamp"]


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (('"a.b"',), r"effect\[\d+\]\.label: must be letters, digits, - and _, got 'a\.b'"),
        (('""',), r"label: must be letters"),
        (("3",), r"label: must be letters, digits, - and _, got 3"),
        (('"x"', '"x"'), r"payload:x is effect\[\d+\] too: give each a label of its own"),
    ],
)
def test_labels_that_tell_nothing_apart_are_refused(text: str, labels: tuple[str, ...], message: str) -> None:
    with pytest.raises(DataError, match=message):
        vehicle.parse(labelled(text, *labels))


def test_an_effect_of_which_there_is_one_takes_no_label(text: str) -> None:
    with pytest.raises(DataError, match=r"\.label: leave it out \(only .* several times\)"):
        vehicle.parse(text.replace('name = "added_mass"', 'name = "added_mass"\nlabel = "x"', 1))


def test_a_label_is_not_written_into_the_name(text: str) -> None:
    with pytest.raises(DataError, match='write name = "payload" and label = "x"'):
        vehicle.parse(text.replace('name = "payload"', 'name = "payload:x"', 1))


def test_names_in_memory_make_no_difference_to_the_hash(text: str) -> None:
    """Files of the version before keep their hash."""
    apart = vehicle.parse(text)
    raw = msgspec.convert(tomllib.loads(text), Vehicle)
    assert as_written(apart) == raw
    assert vehicle.vehicle_hash(apart) == vehicle.vehicle_hash(raw)
    assert vehicle.vehicle_hash(vehicle.parse(labelled(text, '"lamp"'))) != vehicle.vehicle_hash(raw)


def test_values_go_into_the_table_that_is_meant(text: str) -> None:
    done = tomllib.loads(vehicle.set_effect(text, {"name": "payload:2", "w": 9.0}))
    assert [(one["name"], one["w"]) for one in done["effect"] if one["name"] == "payload"] == [
        ("payload", 4.0),
        ("payload", 9.0),
    ]
    with pytest.raises(DataError, match="2 are named payload: say which of payload:1, payload:2"):
        vehicle.set_effect(text, {"name": "payload", "w": 9.0})


def test_what_is_known_is_known_of_all_or_of_the_one_that_is_named(text: str) -> None:
    both = vehicle.parse(vehicle.hold_known(text, ["payload.mass"]))
    assert [table.get("known") for table in both.effects("payload")] == [["mass"], ["mass"]]
    one = vehicle.parse(vehicle.hold_known(text, ["payload:2"]))
    assert [table.get("known") for table in one.effects("payload")] == [None, True]
    with pytest.raises(DataError, match="known: the vehicle has no effect payload:3"):
        vehicle.hold_known(text, ["payload:3"])


def test_a_vehicle_from_memory_is_written_as_files_are(text: str) -> None:
    lamp = labelled(text, '"lamp"')
    known = vehicle.parse(lamp)
    written = tomllib.loads(rewrite.rewritten(known))["effect"]
    assert [table["name"] for table in written if table["name"].startswith("payload")] == ["payload"] * 2
    assert vehicle.parse(rewrite.rewritten(known)) == known
    assert rewrite.rewritten(known, lamp) == lamp


def test_a_fit_means_all_of_a_name_or_one(text: str) -> None:
    known = vehicle.parse(text)
    assert {entry.effect for entry in free(known, ["payload"]).entries} == {"payload:1", "payload:2"}
    unknown = free(known, ["payload:2"])
    assert {entry.effect for entry in unknown.entries} == {"payload:2"}
    entry = next(i for i, one in enumerate(unknown.entries) if one.parameter == "w")
    values = unknown.starts[0].copy()
    values[entry] = 7.0
    assert [table["w"] for table in unknown.at(values).effects("payload")] == [4.0, 7.0]
    with pytest.raises(DataError, match="effect payload:3: auv151 has payload:1, payload:2"):
        free(known, ["payload:3"])
    with pytest.raises(DataError, match="effect tether:sea: auv151 has no tether"):
        free(known, ["tether:sea"])
