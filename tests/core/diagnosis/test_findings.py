"""What a diagnosis adds to a vehicle, and what it cannot add."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from hydro.core.diagnosis.doubts import limited_confidence
from hydro.core.diagnosis.findings import (
    Diagnosis,
    Finding,
    Prediction,
    extended,
    prediction_of,
    tables,
)
from hydro.core.diagnosis.settings import DOUBTFUL
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files

CURRENT = {"name": "ocean_current", "v_N": 0.2, "v_E": -0.15}


def tied() -> Diagnosis:
    parameters, errors = {"v_N": 0.2, "v_E": -1e-7, "v_D": 0.0}, {"v_N": 0.01, "v_E": 0.01, "v_D": 0.01}
    members = ("ocean_current", "tether")
    one = Finding("cannot_tell_apart", members[0], members, 0.8, 0.7, 0.9, 0.6, 0.001, parameters, errors)
    return Diagnosis((one, Finding("not_excited", "body_lift", ("body_lift",))), Vehicle, (9.0, 5.0, 1.0))


def test_tables_return_values_and_standard_errors_of_stated_findings():
    (table,) = tables(tied().frame())
    assert table == {
        "name": "ocean_current",
        "v_N": 0.2,
        "v_E": -1e-7,
        "v_D": 0.0,
        "standard_error": {"v_N": 0.01, "v_E": 0.01, "v_D": 0.01},
    }


@pytest.mark.parametrize(
    ("wanted", "words"),
    [("tether", "tied with ocean_current"), ("payload", "no finding payload"), ("body_lift", "no finding")],
)
def test_tables_refuse_findings_without_values(wanted, words):
    with pytest.raises(DataError, match=words):
        tables(tied().frame(), [wanted])


def test_a_suspect_is_added_only_by_its_name():
    values = {"v_N": 0.2}
    sure = Finding("missing", "body_lift", ("body_lift",), 0.5, confidence=0.95, parameters=values)
    unsure = Finding("suspect", "ocean_current", ("ocean_current",), 0.8, confidence=0.62, parameters=values)
    both, alone = (
        Diagnosis(found, Vehicle, (9.0, 5.0, 1.0)).frame() for found in ((unsure, sure), (unsure,))
    )
    assert [one["name"] for one in tables(both)] == ["body_lift"]
    assert [one["name"] for one in tables(both, ["ocean_current"])] == ["ocean_current"]
    with pytest.raises(DataError, match=r"unconfirmed effects: ocean_current \(confidence 62%\).*--effect"):
        tables(alone)


def test_impossible_values_limit_the_confidence(datasets):
    vehicle = files.read(datasets / "vehicles" / "bluerov2_heavy.toml")[0]
    beyond = msgspec.structs.replace(vehicle, effect=({"name": "ocean_current", "v_N": -40.0},))
    assert limited_confidence(1.0, beyond, "ocean_current", {"v_N": 0.1}) == DOUBTFUL
    assert limited_confidence(0.2, beyond, "ocean_current", {"v_N": 0.1}) == 0.2
    assert limited_confidence(1.0, beyond, "ocean_current", {"v_N": 30.0}) == 1.0


def test_new_tables_replace_effects_of_the_same_name(datasets):
    known = files.read(datasets / "vehicles" / "auv151.toml")[0]
    matrix = np.eye(6).tolist()
    new = extended(known, [CURRENT, {"name": "linear_damping", "diagonal": None, "matrix": matrix}])
    assert new.effects("linear_damping") == ({"name": "linear_damping", "matrix": matrix},)
    assert new.effects("ocean_current") == (CURRENT,)
    assert msgspec.structs.replace(new, effect=known.effect) == known


STORED = {
    "horizon": 5.0,
    "given": 0.3,
    "added": 0.1,
    "spread": 0.01,
    "floor": None,
    "axes": {"u": [0.3, 0.1, 0.1]},
}


def test_prediction_errors_are_read_from_the_footer():
    assert prediction_of({}) is None
    assert prediction_of({"prediction": STORED}) == Prediction(**STORED)


@pytest.mark.parametrize(
    "wrong", [{"horizon": "5"}, {"axes": [0.3]}, {"axes": {"u": [0.3]}}, {"given": None}, {"spread": {}}]
)
def test_damaged_prediction_errors_are_refused(wrong):
    with pytest.raises(DataError, match="diagnose again"):
        prediction_of({"prediction": STORED | wrong})


def test_prediction_errors_that_are_no_table_are_refused():
    with pytest.raises(DataError, match="the footer's prediction"):
        prediction_of({"prediction": 0.3})
