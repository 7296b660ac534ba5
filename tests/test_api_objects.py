"""Results of real calls: they say what the command line says, and lead to a vehicle that predicts better."""

from __future__ import annotations

import inspect
import json
import pickle
import re
from pathlib import Path
from typing import Any

import pytest
from recordings import WEAK, damped, moved, noisy

import hydro
from hydro import cli
from hydro.core.vehicle.description import Vehicle

THEIRS = {"DataFrame", "Pair", "None"}
"""Names in annotations that belong to polars and MuJoCo."""


@pytest.fixture(scope="module")
def known() -> Vehicle:
    return damped()


@pytest.fixture(scope="module")
def recorded() -> dict[str, Any]:
    """A recording of 34 s with a weak thruster, and another one."""
    return {
        "raw": noisy(moved(damped(WEAK), rows=1700), 0),
        "holdout": noisy(moved(damped(WEAK), rows=1200, seed=1), 1),
    }


@pytest.fixture(scope="module")
def study(known: Vehicle, recorded: dict[str, Any]) -> tuple[hydro.Study, list[hydro.Step]]:
    """A study, and the steps that it told as it made them."""
    told: list[hydro.Step] = []
    return hydro.explain(known, **recorded, on_step=told.append), told


def printed(capsys: pytest.CaptureFixture[str], *line: str) -> dict[str, Any]:
    assert cli.main([*line, "--json"]) == 0
    said: dict[str, Any] = json.loads(capsys.readouterr().out)
    return said


@pytest.mark.parametrize("name", ["compare", "diagnose"])
def test_json_is_that_of_the_command_line(
    name: str, known: Vehicle, recorded: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(tmp_path / one) for one in ("vehicle.toml", "raw.parquet")]
    hydro.write_vehicle(known, files[0])
    hydro.write(recorded["raw"], files[1], "raw")
    said = printed(capsys, name, *files)
    found = json.loads(getattr(hydro, name)(known, recorded["raw"]).to_json())
    assert said
    assert {key: found[key] for key in said} == said
    assert set(found) - set(said) <= {"headline"}


def test_a_study_has_its_steps_and_the_vehicle_that_predicts_best(
    study: tuple[hydro.Study, list[hydro.Step]], known: Vehicle
) -> None:
    found, told = study
    assert list(found) == told
    assert [step.number for step in found] == list(range(len(found)))
    assert found[0].vehicle == known
    assert found[1].added == ("thruster_gain",)
    assert found[1].stated
    assert found.vehicle == found.best.vehicle
    before, after = (step.error("holdout") for step in (found[0], found.best))
    assert before is not None
    assert after is not None
    assert after < 0.5 * before
    assert found.headline.startswith("The model needs 1 correction: Thruster 2 delivers 70 %")
    assert found.ending in repr(found)
    assert found.diagnosis.headline.startswith("Nothing is missing")


def test_each_step_has_its_answers(study: tuple[hydro.Study, list[hydro.Step]], known: Vehicle) -> None:
    first = study[0][0]
    assert isinstance(first.comparison, hydro.Comparison)
    assert isinstance(first.diagnosis, hydro.Diagnosis)
    assert first.diagnosis.headline.startswith("The model needs 1 correction: Thruster 2 delivers 70 %")
    assert first.diagnosis.vehicle == hydro.add(known, first.diagnosis)
    assert study[0].comparison.filter(level="replay", by="all", horizon=5.0, axis="all")["rmse"].item() == (
        study[0].best.error("fit")
    )


def test_a_diagnosis_leads_to_the_vehicle_that_a_comparison_confirms(
    known: Vehicle, recorded: dict[str, Any]
) -> None:
    found = hydro.diagnose(known, recorded["raw"])
    assert found.status.kind == "stated"
    assert "Thruster 2 delivers 70 %" in repr(found)
    before = hydro.compare(known, recorded["holdout"])
    after = hydro.compare(found.vehicle, recorded["holdout"], against=before)
    errors = after.summary().filter(axis="all")
    assert errors["error"].item() < 0.5 * errors["before"].item()
    assert errors["before"].item() == before.summary().filter(axis="all")["error"].item()
    for one in (found, before, after):
        assert pickle.loads(pickle.dumps(one)) == one
    assert found.estimates is not None
    assert len(found.estimates.values) == len(found.estimates.covariance)


def test_a_fit_says_its_values_in_sentences(known: Vehicle, recorded: dict[str, Any]) -> None:
    found = hydro.fit(known, recorded["raw"], ["thruster_gain"], method="equation")
    assert found.headline.startswith("1 effect fitted: Thruster 2 delivers ")
    assert found.values[1] == pytest.approx(-0.3, abs=0.05)
    assert found.table["value"].to_list() == found.values.tolist()
    assert pickle.loads(pickle.dumps(found)) == found
    assert hydro.add(known, found).effects("thruster_gain")


def test_every_class_that_functions_return_or_raise_is_public() -> None:
    functions = [getattr(hydro, name) for name in hydro.__all__ if name.islower()]
    assert len(functions) > 15
    returned = " ".join(str(inspect.signature(one).return_annotation) for one in functions)
    raised = " ".join(
        re.findall(r"hydro\.core\.errors\.(\w+)", " ".join(one.__doc__ or "" for one in functions))
    )
    named = set(re.findall(r"\b[A-Z]\w+", f"{returned} {raised}")) - THEIRS
    assert {"Diagnosis", "Comparison", "Study", "Fit", "Vehicle", "Model", "DataError"} <= named
    assert named <= set(hydro.__all__)


@pytest.mark.parametrize("name", [name for name in hydro.__all__ if not name.islower()])
def test_classes_are_there_and_described(name: str) -> None:
    found = getattr(hydro, name)
    assert inspect.isclass(found)
    assert found.__name__ == name
    assert found.__doc__
    assert name in dir(hydro)
