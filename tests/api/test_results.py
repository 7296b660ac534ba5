"""Results pass on what their table gives, their copies are equal, and their JSON says the same."""

from __future__ import annotations

import copy
import inspect
import io
import json
import math
import pickle
from dataclasses import FrozenInstanceError, fields, replace
from typing import Any

import made_results as made
import numpy as np
import polars as pl
import pyarrow as pa
import pytest
import studies
from hypothesis import given
from hypothesis import strategies as st

import hydro
from hydro.api.result import Result, same
from hydro.core.errors import DataError
from hydro.io import table as tables

KINDS = ("diagnosis", "comparison", "fit", "study")
OWN = {"plot"}
"""What a result has of its own where a frame has something else."""


@pytest.fixture(params=KINDS)
def result(request: pytest.FixtureRequest) -> Any:
    return made.every()[request.param]


PUBLIC = [name for name in dir(pl.DataFrame) if not name.startswith("_") and name not in OWN]
NEEDS_MORE = {"style"}
"""What needs a library that hydro does without."""
PROPERTIES = [name for name in PUBLIC if isinstance(inspect.getattr_static(pl.DataFrame, name), property)]
READ = (
    *("clone", "count", "describe", "drop_nulls", "estimated_size", "head", "is_empty", "max", "mean", "min"),
    *("n_chunks", "n_unique", "null_count", "rechunk", "reverse", "rows", "tail", "to_arrow", "to_dicts"),
    *("to_numpy", "to_struct", "write_json"),
)
"""Methods of a frame without arguments."""


def alike(one: Any, other: Any) -> bool:
    if isinstance(one, pl.Series):
        return one.equals(other, check_dtypes=True, null_equal=True)
    if isinstance(one, np.ndarray):
        return repr(one.tolist()) == repr(other.tolist())
    return same(one, other)


def test_every_public_name_of_a_frame_is_there_and_in_completion(result: Any) -> None:
    assert [name for name in PUBLIC if name not in NEEDS_MORE and not hasattr(result, name)] == []
    assert set(PUBLIC) <= set(dir(result))
    assert {"headline", "summary", "to_json", "table"} <= set(dir(result))


@pytest.mark.parametrize("name", sorted({*PROPERTIES} - NEEDS_MORE))
def test_properties_are_the_tables(result: Any, name: str) -> None:
    found, expected = getattr(result, name), getattr(result.table, name)
    assert type(found) is type(expected)
    if isinstance(expected, int | list | tuple | dict | pl.Schema):
        assert found == expected


@pytest.mark.parametrize("name", READ)
def test_methods_are_the_tables(result: Any, name: str) -> None:
    assert alike(getattr(result, name)(), getattr(result.table, name)())


@given(data=st.data())
@pytest.mark.parametrize("kind", KINDS)
def test_filter_select_and_brackets_are_the_tables(kind: str, data: st.DataObject) -> None:
    found: Any = made.every()[kind]
    table: pl.DataFrame = found.table
    names = data.draw(st.lists(st.sampled_from(table.columns), min_size=1, unique=True))
    name = names[0]
    value = data.draw(st.sampled_from(table[name].to_list()))
    chosen = pl.col(name).eq_missing(pl.lit(value, table.schema[name]))
    assert found.filter(chosen).equals(table.filter(chosen))
    assert found.select(names).equals(table.select(names))
    assert found.select(pl.col(names)).equals(table.select(names))
    assert found[names].equals(table[names])
    assert found[name].equals(table[name])
    assert name in found
    assert f"{name} " not in found
    if kind != "study":
        rows = data.draw(st.slices(table.height))
        if (rows.step or 1) > 0:
            assert found[rows].equals(table[rows])
        assert len(found) == table.height
        assert all(one.equals(other) for one, other in zip(found, table, strict=True))


def test_constraints_by_name_filter_as_the_tables_do() -> None:
    found = made.comparison()
    expected = found.table.filter(level="replay", by="all", horizon=5.0)
    assert expected.height == 8
    assert found.filter(level="replay", by="all", horizon=5.0).equals(expected)


def test_other_libraries_take_it_for_its_table(result: Any) -> None:
    assert pl.DataFrame(result).equals(result.table)
    assert pa.table(result).num_rows == result.table.height
    assert result.equals(result)
    assert result.equals(other=result.table)
    if not isinstance(result, hydro.Study):  # whose length is that of its steps
        assert repr(np.asarray(result).tolist()) == repr(result.table.to_numpy().tolist())


def test_a_study_goes_over_its_steps() -> None:
    found = made.study()
    assert list(found) == [found[0], found[1]] == list(found.steps)
    assert found[-1] is found.steps[1]
    assert found[:1] == found.steps[:1]
    assert len(found) == 2
    assert found.height == found.table.height
    with pytest.raises(IndexError):
        found[2]
    assert [step.number for step in found] == [0, 1]
    assert [step.error("fit") for step in found] == [2.0, 0.2]
    assert [step.error("holdout") for step in found] == [1.8, 0.3]
    assert found[0].error("nothing") is None
    assert found[0].left_out is None
    assert found[0].chi2 == made.CHI2
    assert found.best == found[1]
    assert (found.vehicle, found.diagnosis, found.comparison) == (
        found[1].vehicle,
        found[1].diagnosis,
        found[1].comparison,
    )


def test_unknown_names_are_refused_as_by_a_frame(result: Any) -> None:
    with pytest.raises(AttributeError, match="no_such"):
        _ = result.no_such
    with pytest.raises(AttributeError, match="__no_such__"):
        _ = result.__no_such__


def test_results_are_frozen(result: Any) -> None:
    for each in fields(result):
        with pytest.raises(FrozenInstanceError):
            setattr(result, each.name, None)
    with pytest.raises(TypeError, match="unhashable"):
        hash(result)


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_copies_are_equal(result: Any, copied: Any) -> None:
    again = copied(result)
    assert type(again) is type(result)
    assert again == result
    assert repr(again) == repr(result)


def test_any_changed_value_makes_results_unequal(result: Any) -> None:
    others = {
        "table": result.table.reverse(),
        "status": replace(made.diagnosis().status, title="Another"),
        "vehicle": made.VEHICLE.without("linear_damping"),
        "chi2": (9.0, 4.0, 1.2),
        "prediction": None,
        "estimates": made.fit().estimates(),
        "changed": True,
        "outcome": replace(made.fit().outcome, values=made.fit().values + 1e-9),
        "sentences": ("Another.",),
        "corrections": ("Another.",),
        "steps": made.study().steps[:1],
        "best": made.study().steps[0],
        "ending": "another reason",
        "answer": "Another answer.",
    }
    for each in fields(result):
        assert replace(result, **{each.name: others[each.name]}) != result, each.name
    assert result != result.table
    assert result != 1


def test_missing_numbers_equal_one_another() -> None:
    nan = float("nan")
    assert same([nan, {"a": np.array([nan, 1.0])}], [float("nan"), {"a": np.array([nan, 1.0])}])
    assert not same([nan], [0.0])
    assert not same(1, 1.0)
    assert not same({"a": 1}, {"b": 1})
    assert not same([1], [1, 2])
    assert not same(pl.DataFrame({"a": [1]}), pl.DataFrame({"a": [1]}, schema={"a": pl.Int32}))


def finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def test_json_parses_and_has_the_rows_of_the_table(result: Any) -> None:
    names = {"diagnosis": "findings", "comparison": "comparison", "fit": "parameters", "study": "ladder"}
    said = json.loads(result.to_json())
    rows = said[names[type(result).__name__.lower()]]
    assert said["headline"] == result.headline
    apart = ("parameters", "standard_errors")
    kept = [
        {key: finite(value) for key, value in row.items() if key not in apart} for row in result.to_dicts()
    ]
    assert [{key: value for key, value in row.items() if key not in apart} for row in rows] == kept


def test_json_of_a_diagnosis_has_values_as_objects() -> None:
    said = json.loads(made.diagnosis().to_json())
    assert said["findings"][0]["parameters"] == made.CURRENT.parameters
    assert said["chi2"] == {"given": 9.0, "own_effects": 4.0, "found": 1.1}
    assert said["prediction"]["given"] == 0.121
    words = "add this correction to the vehicle file"
    assert said["next"] == {"action": "add", "words": words, "effects": []}
    assert "prediction" not in json.loads(made.diagnosis(prediction=None).to_json())


def test_json_of_a_study_names_the_step_to_use() -> None:
    said = json.loads(made.study().to_json())
    assert said["use"] == 1
    assert said["ending"] == "nothing more is found"
    assert [(one["step"], one["added"], one["stated"]) for one in said["steps"]] == [
        (0, [], False),
        (1, ["ocean_current"], True),
    ]
    assert said["findings"][0]["verdict"] == "nothing_missing"


def test_the_vehicle_of_a_diagnosis_is_what_add_gives() -> None:
    found = made.diagnosis()
    assert found.vehicle == hydro.add(made.VEHICLE, found)
    assert found.vehicle == hydro.add(made.VEHICLE, found.table)
    assert [one["name"] for one in found.vehicle.effect][-1] == "ocean_current"
    assert found.unseen == ("surface_suction",)


@pytest.mark.parametrize("findings", [(made.NOTHING,), (made.GAIN,), (made.UNSEEN,)])
def test_nothing_stated_leaves_the_vehicle_as_given(findings: Any) -> None:
    found = made.diagnosis(findings)
    assert found.vehicle is made.VEHICLE
    with pytest.raises(DataError):
        hydro.add(made.VEHICLE, found)


def test_the_numbers_of_a_fit_are_those_of_core() -> None:
    found = made.fit()
    names = ("vehicle", "values", "standard_errors", "covariance", "determined", "chi2", "method", "share")
    assert all(
        same(getattr(found, name), getattr(found.outcome, name)) for name in (*names, "changes", "warnings")
    )
    assert found.frame().equals(found.outcome.frame())
    assert found.tables() == found.outcome.tables()
    assert found.effect("linear_damping") == found.outcome.table("linear_damping")
    assert same(found.estimates(), found.outcome.estimates())
    better = hydro.add(made.VEHICLE, found)
    assert better.effects("linear_damping")[0]["standard_error"] == found.effect("linear_damping")[1]
    assert found.summary()["determined"].to_list() == sorted(found.table["determined"], reverse=True)


def test_a_written_diagnosis_keeps_its_headline_and_errors() -> None:
    stream, found = io.BytesIO(), made.diagnosis()
    hydro.write(found, stream, "diagnosis")
    stream.seek(0)
    kept = tables.read(stream, "diagnosis")
    assert kept.frame.equals(found.table)
    assert kept.provenance.parameters["headline"] == found.headline
    assert kept.provenance.parameters["prediction"]["added"] == 0.05
    assert kept.provenance.parameters["chi2"] == list(made.CHI2)


def test_other_results_are_written_as_their_tables() -> None:
    for kind, found in (("comparison", made.comparison()), ("ladder", made.study())):
        stream = io.BytesIO()
        hydro.write(found, stream, kind)
        stream.seek(0)
        assert hydro.read(stream, kind).equals(found.table)


def test_summaries_have_the_numbers_of_the_tables() -> None:
    errors = made.comparison().summary()
    assert errors["axis"].to_list() == [*"uvwpqr", "all"]
    assert errors["error"].to_list() == [2.0] * 7
    assert errors["least_squares"].to_list() == [4.0] * 7
    assert errors["zero_velocity"].to_list() == [6.0] * 7
    assert errors["unit"].to_list() == ["m/s"] * 3 + ["rad/s"] * 3 + ["m/s"]
    steps = made.study().summary()
    assert steps["error"].to_list() == [2.0, 0.2]
    assert steps["held_out"].to_list() == [1.8, 0.3]
    assert steps["use"].to_list() == [False, True]
    found = made.diagnosis().summary()
    assert found["effect"].to_list() == ["ocean_current", "thruster_gain"]
    assert found["share_of_error"].to_list() == [0.41, 0.2]
    assert found["error_added"].to_list() == [0.06, None]


def test_findings_that_do_not_lower_the_error_need_force() -> None:
    """As `hydro add` does: all together, and one that is named by itself."""
    better, worse = made.diagnosis(), made.diagnosis(prediction=replace(made.PREDICTION, added=0.12))
    assert hydro.add(made.VEHICLE, better) == better.vehicle
    with pytest.raises(DataError, match=r"does not lower the error 5 s ahead .*; force=True adds it"):
        hydro.add(made.VEHICLE, worse)
    assert hydro.add(made.VEHICLE, worse, force=True) == worse.vehicle
    assert hydro.add(made.VEHICLE, worse, ["ocean_current"]) == worse.vehicle
    alone = made.diagnosis([replace(made.CURRENT, error_added=0.2)])
    with pytest.raises(DataError, match="adding ocean_current does not lower the error"):
        hydro.add(made.VEHICLE, alone, ["ocean_current"])


def test_a_comparison_without_velocities_is_told_by_the_pose() -> None:
    table = made.comparison().table
    pose = table.filter(~pl.col("axis").is_in([*"uvwpqr", "all"]) | (pl.col("level") == "force"))
    found = hydro.Comparison(pose)
    assert found.summary()["axis"].to_list() == ["pose"]
    assert "pose" in repr(found)


def test_a_comparison_against_an_earlier_one_has_its_errors() -> None:
    table = made.comparison().table.with_columns(before=3.0 * pl.col("rmse"))
    found = hydro.Comparison(table)
    assert found.summary()["before"].to_list() == [6.0] * 7
    assert "before" in repr(found)


def test_a_diagnosis_of_core_without_its_answer_is_no_result() -> None:
    found = made.Found((made.NOTHING,), made.VEHICLE, made.CHI2)
    with pytest.raises(ValueError, match="status"):
        hydro.Diagnosis.of(found, made.VEHICLE, found.frame(), changed=False)


def test_results_say_what_is_abstract() -> None:
    with pytest.raises(TypeError, match="abstract"):
        Result(studies.nothing())  # type: ignore[abstract]
