"""Schema files and the checks made from them."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tables import raw, tables

from hydro.core.distillation import features
from hydro.core.distillation.labels_of_samples import DEVIATIONS
from hydro.core.errors import DataError
from hydro.io import schema
from hydro.io.schema import KINDS, load

BODY = ["u", "v", "w", "p", "q", "r"]
WRENCH = ["X", "Y", "Z", "K", "M", "N"]
RAW = ["session", "t", "x", "y", "z", "phi", "theta", "psi", *BODY, "cmd_1", "cmd_2"]
LABELS = [
    *RAW,
    *(f"{name}_s" for name in BODY),
    *(f"{name}_dot" for name in BODY),
    "f_1",
    "f_2",
    *(f"{name}_prop" for name in WRENCH),
    *(f"{name}_res" for name in WRENCH),
]


def refused(frame: pl.DataFrame, kind: str = "raw") -> str:
    """The line by which a table is refused."""
    with pytest.raises(DataError) as caught:
        load(kind).check(frame, f"{kind}.parquet")
    assert "\n" not in str(caught.value)
    return str(caught.value)


# The files themselves


def faults_of_field(field: dict[str, Any], fields: list[dict[str, Any]]) -> Iterator[str]:
    """Yield what a field of a schema file fails to say."""
    described = {"name", "type", "constraints", "arrowType", "unit", "frame", "source", "description"}
    if missing := described - field.keys():
        yield f"has no {', '.join(sorted(missing))}"
        return
    if field["type"] not in {"string", "number", "integer", "array", "boolean"}:
        yield f"has an unknown type {field['type']}"
    if not field["description"].endswith("."):
        yield "has a description without a full stop"
    if field["type"] == "number":
        if set(field["arrowType"]) != {"float32", "float64"}:
            yield "must take both float types"
        if not field["unit"] and not any(other["name"] == "unit" for other in fields):
            yield "has no unit, neither here nor in the column `unit`"


def test_every_field_says_all_it_must() -> None:
    contents = {kind: json.loads((schema.FOLDER / f"{kind}.json").read_text()) for kind in KINDS}
    assert {kind: content["name"] for kind, content in contents.items()} == {kind: kind for kind in KINDS}
    profiles = {content["$schema"] for content in contents.values()}
    assert profiles == {"https://datapackage.org/profiles/2.0/tableschema.json"}
    assert [
        f"{kind}: {field.get('name')} {fault}"
        for kind, content in contents.items()
        for field in content["fields"]
        for fault in faults_of_field(field, content["fields"])
    ] == []


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"type": "float"}, "unknown type"),
        ({"description": "Surge"}, "full stop"),
        ({"arrowType": ["float32"]}, "both float types"),
        ({"unit": ""}, "no unit"),
    ],
)
def test_a_field_that_says_too_little_is_seen(change: dict[str, Any], fault: str) -> None:
    fields = json.loads((schema.FOLDER / "raw.json").read_text())["fields"]
    speed = next(field for field in fields if field["name"] == "u")
    assert list(faults_of_field(speed, fields)) == []
    (found,) = faults_of_field(speed | change, fields)
    assert fault in found
    (found,) = faults_of_field({"name": "u"}, fields)
    assert found.startswith("has no arrowType, constraints")


def test_names_are_unique_and_keys_exist() -> None:
    names = {kind: [field.name for field in load(kind).fields] for kind in KINDS}
    assert [kind for kind, each in names.items() if len(each) != len(set(each))] == []
    keys = {kind: set(load(kind).primary_key) for kind in KINDS}
    for kind in KINDS:
        if series := load(kind).series:
            keys[kind] |= {*series.key, series.time}
    assert [(kind, keys[kind] - set(names[kind])) for kind in KINDS if keys[kind] - set(names[kind])] == []


def test_versions_of_a_schema_differ_in_what_may_be_null_alone() -> None:
    first, second = (json.loads((schema.FOLDER / f"{name}.json").read_text()) for name in ("raw", "raw-2"))
    free = []
    for old, new in zip(first["fields"], second["fields"], strict=True):
        if old.get("constraints") != new.get("constraints"):
            free.append(old["name"])
            new.setdefault("constraints", {})["required"] = True
        assert old == new
    assert free == [*"xyz", "phi", "theta", "psi", *BODY]
    assert first["name"] == second["name"] == "raw"


def test_labels_of_version_two_add_standard_deviations_and_may_be_null() -> None:
    first, second = load("labels"), load("labels", 2)
    names = [field.name for field in second.fields]
    added = [name for name in names if name.endswith("_sd")]
    assert names == [*(field.name for field in first.fields), *added]
    units = {field.name: field.unit for field in second.fields}
    assert all(units[name] == units[name.removesuffix("_sd")] for name in added)
    assert added == list(DEVIATIONS)
    raw = {field.name: field for field in load("raw", 2).fields}
    for field in second.fields:
        assert field == raw[field.name] if field.name in raw else not field.constraints.required
    assert [field.name for field in load("split", 2).fields] == [*names, "block", "part"]


def test_columns_are_those_of_the_stages() -> None:
    assert list(load("raw").columns(["cmd_1", "cmd_2"])) == RAW
    assert list(load("labels").columns(["cmd_1", "cmd_2"])) == LABELS
    assert list(load("split").columns(["cmd_1", "cmd_2"])) == [*LABELS, "block", "part"]
    assert set(features.INPUTS) | set(features.OUTPUTS) <= set(LABELS)
    every = ["block", "part", *features.names("physfeat")]
    assert list(load("features").columns(every)) == ["session", "t", *every, *features.OUTPUTS]
    plain = list(load("features").columns([]))
    assert plain == ["session", "t", *features.names("raw"), *features.OUTPUTS]


def test_an_unknown_kind_names_the_known() -> None:
    with pytest.raises(DataError, match="no such kind of table: the kinds are raw, labels"):
        load("rwa")


def test_an_unknown_rule_in_a_schema_file_is_an_error(tmp_path, monkeypatch) -> None:
    content = json.loads((schema.FOLDER / "raw.json").read_text())
    content["fields"][0]["constraints"]["maxLength"] = 3
    (tmp_path / "raw.json").write_text(json.dumps(content))
    monkeypatch.setattr(schema, "FOLDER", tmp_path)
    with pytest.raises(ValueError, match="maxLength"):
        load.__wrapped__("raw")


def test_the_digest_follows_the_rules_alone() -> None:
    digests = {load(kind).digest for kind in KINDS}
    assert len(digests) == len(KINDS)
    assert load("raw").digest == load.__wrapped__("raw").digest


# Columns


@given(st.integers(1, 12), st.integers(1, 12))
def test_repeated_fields_come_equally_often(commands: int, thrusts: int) -> None:
    names = [f"cmd_{i + 1}" for i in range(commands)] + [f"f_{i + 1}" for i in range(thrusts)]
    columns = load("labels").columns(names)
    most = max(commands, thrusts)
    for letter in ("cmd", "f"):
        assert [name for name in columns if name.startswith(f"{letter}_")] == [
            f"{letter}_{i + 1}" for i in range(most)
        ]


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_a_sound_table_passes_unchanged_in_any_order_of_columns(kind: str, data: st.DataObject) -> None:
    frame = data.draw(tables(kind))
    shuffled = frame.select(data.draw(st.permutations(frame.columns)))
    checked = load(kind).check(shuffled, "x.parquet")
    assert checked.equals(frame.select(checked.columns))
    assert checked.columns == list(load(kind).columns(frame.columns))


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data())
def test_a_missing_column_is_named(kind: str, data: st.DataObject) -> None:
    frame = data.draw(tables(kind))
    needed = [field.name for field in load(kind).fields if not field.optional and not field.repeat]
    name = data.draw(st.sampled_from(needed))
    assert f"column {name}" in refused(frame.drop(name), kind)


def test_columns_that_are_missing_too_many_or_of_the_wrong_type() -> None:
    frame = raw()
    assert refused(frame.drop("u")) == "raw.parquet: column u [m/s] is missing: a raw table needs it"
    assert refused(frame.drop("u", "psi")) == (
        "raw.parquet: columns psi [rad], u [m/s] are missing: a raw table needs them"
    )
    assert "column cmd_2 [1] is missing" in refused(frame.drop("cmd_2"))
    assert "column cmd_1 [1] is missing" in refused(frame.drop("cmd_1", "cmd_2", "cmd_3"))
    assert refused(frame.with_columns(depth=1.0, mode=2)) == (
        "raw.parquet: columns depth, mode are not part of a raw table: drop them"
    )
    assert "column 'a\\nb' is not part" in refused(frame.with_columns(pl.lit(1.0).alias("a\nb")))
    assert "and 12 more are" in refused(frame.with_columns(pl.lit(1.0).alias(f"k{i}") for i in range(20)))
    assert "cmd_01" in refused(frame.with_columns(cmd_01=0.0))


@pytest.mark.parametrize(
    ("dtype", "called"),
    [(pl.Int64, "int64"), (pl.String, "string"), (pl.Boolean, "boolean"), (pl.Datetime("us"), "datetime")],
)
def test_a_column_of_the_wrong_type(dtype: pl.DataType, called: str) -> None:
    line = refused(raw().with_columns(pl.lit(0).cast(dtype).alias("cmd_1")))
    assert line.startswith(f"raw.parquet: cmd_1 [1] must be float32 or float64, but is {called}")
    assert line.endswith("convert the column")


def test_categories_are_texts() -> None:
    frame = raw()
    checked = load("raw").check(frame.with_columns(pl.col("session").cast(pl.Categorical)), "x")
    assert checked.equals(frame)
    checked = load("raw").check(
        frame.with_columns(pl.col("session").cast(pl.Enum(["turn-1", "turn-2"]))), "x"
    )
    assert checked.equals(frame)


# Values


def test_the_line_of_the_contract() -> None:
    u = raw(15000, ("turn-1",))["u"].to_numpy().copy()
    u[[812, 900, 14999]] = np.nan, np.inf, -np.inf
    assert refused(raw(15000, ("turn-1",)).with_columns(u=u)) == (
        "raw.parquet: u [m/s] must be finite: 3 of 15000 rows are not (first: row 812, session turn-1)"
    )


@given(
    st.sets(st.integers(0, 39), min_size=1, max_size=8),
    st.sampled_from([np.nan, np.inf, -np.inf]),
    st.sampled_from(["t", "x", "u", "cmd_2"]),
    st.sampled_from([pl.Float32, pl.Float64]),
)
def test_whatever_is_not_finite_is_counted_and_placed(rows, value, name, dtype) -> None:
    numbers = raw()[name].to_numpy().astype(np.float64)
    numbers[list(rows)] = value
    line = refused(raw().with_columns(pl.Series(name, numbers).cast(dtype)))
    verb = "row" if len(rows) == 1 else "rows"
    assert f"{name} [" in line
    first = min(rows)
    assert f"must be finite: {len(rows)} of 40 rows {'is' if verb == 'row' else 'are'} not" in line
    assert line.endswith(f"(first: row {first}, session turn-{1 if first < 20 else 2})")


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("cmd_1", 1.001, "cmd_1 [1] must be at most 1"),
        ("cmd_1", -1.001, "cmd_1 [1] must be at least -1"),
        ("theta", 20.0, "theta [rad] must be at most 1.5708"),
        ("theta", -90.0, "theta [rad] must be at least -1.5708"),
        ("u", 51.0, "u [m/s] must be at most 50"),
        ("r", -51.0, "r [rad/s] must be at least -50"),
        ("u", None, "u [m/s] must be present"),
        ("session", None, "session must be present"),
        ("session", "", "session must be at least 1 character long"),
    ],
)
def test_a_value_out_of_bounds(name: str, value: float | str | None, rule: str) -> None:
    values = raw()[name].to_list()
    values[0] = value
    frame = raw().with_columns(pl.Series(name, values, dtype=raw().schema[name]))
    assert refused(frame).startswith(f"raw.parquet: {rule}: 1 of 40 rows is not (first: row 0, session ")


def test_bounds_are_inclusive() -> None:
    quarter = float(np.float32(np.pi / 2))
    load("raw").check(raw().with_columns(cmd_1=-1.0, cmd_2=1.0, theta=quarter), "x")
    load("raw").check(raw().with_columns(pl.lit(quarter, dtype=pl.Float32).alias("theta")), "x")


def test_finiteness_is_told_before_bounds() -> None:
    assert "must be finite" in refused(raw().with_columns(cmd_1=pl.lit(np.nan)))


def test_no_rows() -> None:
    assert refused(raw().clear()) == "raw.parquet: no rows: a raw table needs at least one"


# Order


def test_time_must_increase() -> None:
    frame = raw()
    backwards = frame.with_columns(t=pl.when(pl.int_range(pl.len()) == 30).then(0.01).otherwise("t"))
    assert refused(backwards) == (
        "raw.parquet: t [s] must be increasing within a session: 1 of 40 rows is not"
        " (first: row 30, session turn-2)"
    )
    assert "increasing within a session: 38 of 40" in refused(frame.sort("session", pl.col("t").neg()))


def test_repeated_columns_may_be_absent_where_they_are_optional() -> None:
    one = ["session", "variant", "t"]
    assert not [name for name in load("replay").columns(one) if name.startswith("cmd_")]
    assert list(load("replay").columns([*one, "cmd_1", "cmd_2"]))[-2:] == ["cmd_1", "cmd_2"]
    assert "cmd_1" in load("raw").columns(one)


def test_a_row_must_not_repeat() -> None:
    frame = raw()
    line = refused(pl.concat([frame[:11], frame[10:]]))
    assert line == (
        "raw.parquet: t [s] must be unique within a session: 1 of 41 rows is not"
        " (first: row 11, session turn-1)"
    )


def test_the_rows_of_a_session_must_be_together() -> None:
    frame = raw()
    assert refused(pl.concat([frame, frame])) == (
        "raw.parquet: rows of one session must be together: 2 of 80 rows are not"
        " (first: row 40, session turn-1)"
    )
    line = refused(pl.concat([frame[:10], frame[20:], frame[10:20]]))
    assert "together: 1 of 40 rows is not (first: row 30, session turn-1)" in line


def test_time_may_start_anew_in_every_session_and_jump() -> None:
    frame = raw().with_columns(t=pl.col("t") + pl.when(pl.int_range(pl.len()) > 5).then(9.0).otherwise(0))
    load("raw").check(frame, "x")


@given(st.permutations(range(6)))
def test_rows_pass_only_in_order(order: list[int]) -> None:
    frame = raw(6, ("only",))[order]
    if list(order) == sorted(order):
        load("raw").check(frame, "x")
    else:
        assert "increasing" in refused(frame)


def test_a_replay_is_one_series_per_variant_and_session() -> None:
    motion = raw().drop("cmd_1", "cmd_2", "cmd_3")
    both = pl.concat([motion.with_columns(variant=pl.lit(name)) for name in ("MJ0", "measured")])
    load("replay").check(both, "x")
    assert "rows of one session and variant must be together" in refused(both.sort("session", "t"), "replay")


def test_metrics_are_told_once() -> None:
    row = {"model": "MJ4", "variant": "off", "dataset": "d", "axis": "u", "metric": "rmse", "value": 0.01}
    frame = pl.DataFrame([row | {"low": None, "high": None, "unit": "m/s"}] * 2)
    frame = frame.with_columns(pl.col("low", "high").cast(pl.Float64))
    load("metrics").check(frame[:1], "x")
    assert refused(frame, "metrics") == (
        "metrics.parquet: model, variant, dataset, axis, metric must be unique: 1 of 2 rows is not"
        " (first: row 1)"
    )


def test_parts_and_blocks_have_their_words() -> None:
    frame = pl.DataFrame({"block": ["a" * 64, "b" * 64], "part": ["train", "test"]})
    assert "block must be like [0-9a-f]{64}: 1 of 2" in refused(
        frame.with_columns(block=pl.Series(["a" * 64, "b" * 65])), "blocks"
    )
    assert "part must be one of train, test: 1 of 2" in refused(
        frame.with_columns(part=pl.Series(["train", "tests"])), "blocks"
    )
    assert "block must be unique" in refused(frame.with_columns(block=pl.lit("a" * 64)), "blocks")


def test_the_numbers_of_a_tensor_must_be_finite() -> None:
    frame = pl.DataFrame({"tensor": ["a", "b"], "shape": [[2], [1]], "data": [[1.0, 2.0], [np.nan]]})
    assert refused(frame, "model").startswith("model.parquet: data [1] must be finite: 1 of 2 rows is not")


def test_the_check_is_quick() -> None:
    """100,000 rows of 54 columns; a loop over rows in Python would take many times as long."""
    rows = 100_000
    columns = load("labels").columns([f"cmd_{i + 1}" for i in range(8)])
    values = np.zeros(rows, dtype=np.float32)
    frame = pl.DataFrame(
        dict.fromkeys(columns, values) | {"session": np.repeat("s", rows), "t": np.arange(rows) * 0.02}
    )
    assert frame.width == 54
    best = np.inf
    for _ in range(3):
        start = time.perf_counter()
        load("labels").check(frame, "x")
        best = min(best, time.perf_counter() - start)
    assert best < 0.2
