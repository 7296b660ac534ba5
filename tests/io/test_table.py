"""Parquet tables: same table, same bytes; and everything that can be wrong with a file told in one line."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tables import raw, tables

from hydro.core.errors import DataError
from hydro.io import provenance, schema, table, vehicle
from hydro.io.provenance import Input
from hydro.io.table import Artefact

EXAMPLES = 12
"""Tables of each kind; all kinds share their code, and there are some thirty."""
VEHICLE = """
name = "ball"
[rigid_body]
mass = 10.0
center_of_gravity = [0.0, 0.0, 0.02]
inertia = [[0.4, 0.0, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.4]]
[buoyancy]
force = 98.1
center = [0.0, 0.0, 0.0]
[hull]
length = 0.4
width = 0.4
height = 0.4
"""


def bytes_of(artefact: Artefact) -> bytes:
    stream = io.BytesIO()
    table.write(artefact, stream)
    return stream.getvalue()


def refused(content: bytes, kind: str | None = "raw") -> str:
    """The line by which bytes are refused."""
    with pytest.raises(DataError) as caught:
        table.read(io.BytesIO(content), kind)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def parquet(arrow: pa.Table | pl.DataFrame, **options: object) -> bytes:
    """A Parquet file that hydro did not write."""
    arrow = arrow.to_arrow(compat_level=pl.CompatLevel.oldest()) if isinstance(arrow, pl.DataFrame) else arrow
    stream = io.BytesIO()
    pq.write_table(arrow, stream, **options)
    return stream.getvalue()


# Sound tables


@pytest.mark.parametrize("kind", schema.KINDS)
@settings(max_examples=EXAMPLES)
@given(data=st.data())
def test_what_is_written_is_read(kind: str, data: st.DataObject) -> None:
    frame = data.draw(tables(kind))
    made = table.make(kind, frame, stage="test", parameters={"a": [1, "ü", None]}, seed=5)
    content = bytes_of(made)
    back = table.read(io.BytesIO(content))
    assert back.frame.equals(frame.select(back.frame.columns))
    assert back.frame.schema == made.frame.schema
    assert back.provenance == made.provenance
    assert bytes_of(back) == content


@pytest.mark.parametrize("kind", schema.KINDS)
@settings(max_examples=EXAMPLES)
@given(data=st.data())
def test_plain_columns_become_the_schemas(kind: str, data: st.DataObject) -> None:
    """Any order, columns without a value typed as null or left out, whole numbers for floats."""
    frame = data.draw(tables(kind))
    fields = schema.load(kind).columns(frame.columns)
    blank = [name for name, field in fields.items() if not field.constraints.required]
    frame = frame.with_columns(pl.lit(None, frame.schema[name]).alias(name) for name in blank)
    single = [name for name in blank if name in {field.name for field in schema.load(kind).fields}]
    left_out = set(data.draw(st.lists(st.sampled_from(single)))) if single else set()
    plain = frame.with_columns(pl.lit(None).alias(name) for name in blank if frame.height)
    plain = plain.select(name for name in reversed(frame.columns) if name not in left_out)
    made = table.conform(kind, plain)
    assert made.columns == [name for name in fields if name not in left_out or not fields[name].optional]
    assert made.equals(frame.select(made.columns))
    assert (
        table.read(io.BytesIO(bytes_of(table.make(kind, plain, stage="x"))), kind).frame.schema == made.schema
    )
    assert table.conform(kind, made).equals(made)


@pytest.mark.parametrize("kind", schema.KINDS)
def test_a_table_without_rows_has_all_columns_in_their_types(kind: str) -> None:
    rules = schema.load(kind)
    wanted = {
        field.name.replace("{n}", "1"): field.arrow_type[-1] for field in rules.fields if not field.optional
    }
    for frame in (pl.DataFrame(), pl.DataFrame(schema=dict.fromkeys(reversed(wanted), pl.Null))):
        found = table.conform(kind, frame)
        assert {name: schema.storage_type(dtype) for name, dtype in found.schema.items()} == wanted
        assert found.columns == list(wanted)
        assert found.height == 0


def test_no_value_is_changed_to_fit_a_schema() -> None:
    frame = raw().with_columns(pl.col("x").cast(pl.Int32), pl.lit("a").alias("y"), depth=pl.lit(1.0))
    found = table.conform("raw", frame)
    assert found.schema["x"] == pl.Float64
    assert found["x"].to_list() == frame["x"].to_list()
    assert found.select("y", "depth").equals(frame.select("y", "depth"))
    with pytest.raises(DataError, match="depth is not part of a raw table"):
        table.make("raw", frame, stage="x")
    with pytest.raises(DataError, match=r"y \[m\] must be float32 or float64, but is string"):
        table.make("raw", frame.drop("depth"), stage="x")


def test_the_bytes_do_not_depend_on_how_the_table_lies_in_memory(tmp_path: Path) -> None:
    frame = raw(3000)
    expected = bytes_of(table.make("raw", frame, stage="import"))
    padded = pl.concat([frame[-7:].with_columns(t=pl.col("t") - 1e3), frame])
    for same in (
        pl.concat([frame[:11], frame[11:1800], frame[1800:]], rechunk=False),
        padded[7:],
        frame.select(reversed(frame.columns)),
        frame.with_columns(pl.col("session").cast(pl.Categorical)),
        table.read(io.BytesIO(parquet(frame, row_group_size=17)), "raw").frame,
    ):
        assert bytes_of(table.make("raw", same, stage="import")) == expected
    table.write(table.make("raw", frame, stage="import"), tmp_path / "a.parquet")
    assert (tmp_path / "a.parquet").read_bytes() == expected


def test_columns_are_read_in_one_piece() -> None:
    content = parquet(raw(3000), row_group_size=100)
    assert table.read(io.BytesIO(content), "raw").frame.n_chunks("all") == [1] * 17


def test_polars_and_arrow_read_what_hydro_wrote(tmp_path: Path) -> None:
    path = tmp_path / "raw.parquet"
    table.write(table.make("raw", raw(), stage="import", vehicle_text=VEHICLE), path)
    assert pl.read_parquet(path).equals(raw())
    assert pq.read_table(path).num_rows == 40
    assert provenance.from_json(pl.read_parquet_metadata(path)["hydro"].encode(), "x").vehicle == VEHICLE


def test_a_table_from_elsewhere_has_no_history(tmp_path: Path) -> None:
    path = tmp_path / "raw.parquet"
    raw().write_parquet(path)
    for kind in (None, "raw", ("split", "raw")):
        artefact = table.read(path, kind)
        assert artefact.kind == "raw"
        assert artefact.provenance.stage is None
        assert artefact.provenance.content == provenance.content_hash(raw())


@given(data=st.data(), kind=st.sampled_from(["raw", "labels", "split", "metrics", "replay", "blocks"]))
def test_the_kind_of_a_table_from_elsewhere_shows_in_its_columns(data: st.DataObject, kind: str) -> None:
    frame = data.draw(tables(kind))
    assert table.read(io.BytesIO(parquet(frame))).kind == kind


def test_recordings_of_stonefish_are_raw_tables(datasets: Path) -> None:
    for path in sorted((datasets / "stonefish").glob("*.parquet")):
        artefact = table.read(path, "raw")
        assert artefact.frame.height > 1000
        carried = artefact.provenance.vehicle
        assert carried is not None
        known = Input("vehicle", vehicle.vehicle_hash(vehicle.parse(carried)))
        assert artefact.provenance.inputs == (known,), (
            "the hash of a vehicle has changed: see datasets/make.py"
        )


# History


def test_the_vehicle_and_the_lineage_travel_down_the_line() -> None:
    first = table.make("raw", raw(), stage="collect", seed=1, vehicle_text=VEHICLE)
    ball = Input("vehicle", vehicle.vehicle_hash(vehicle.parse(VEHICLE)))
    assert first.provenance.inputs == (ball,)
    motion = raw().drop("cmd_1", "cmd_2", "cmd_3").with_columns(variant=pl.lit("measured"))
    second = table.make("replay", motion, stage="replay", parameters={"beta": 0.9}, inputs=[first])
    assert second.provenance.vehicle == VEHICLE
    assert second.provenance.inputs == (Input("raw", first.provenance.content, "collect", {}, (ball,)),)


def test_two_vehicles_are_none() -> None:
    one = table.make("raw", raw(), stage="collect", vehicle_text=VEHICLE)
    other = table.make("raw", raw(), stage="collect", vehicle_text=VEHICLE.replace("ball", "bowl"))
    assert table.make("raw", raw(), stage="x", inputs=[one, other]).provenance.vehicle is None
    again = table.make("raw", raw(), stage="x", inputs=[one, other], vehicle_text=VEHICLE)
    assert again.provenance.vehicle == VEHICLE


def test_a_table_changed_behind_its_footer_is_found_out() -> None:
    record = table.make("raw", raw(), stage="collect").provenance
    changed = raw().with_columns(pl.col("x") + 1).to_arrow(compat_level=pl.CompatLevel.oldest())
    content = parquet(changed.replace_schema_metadata({provenance.FOOTER_KEY: record.to_json()}))
    assert "its rows do not match the hash in its footer: make the file again" in refused(content)


# Recordings with nulls


def test_a_recording_with_nulls_is_of_the_second_version_and_read_back() -> None:
    sparse = raw().with_columns(
        pl.when(pl.int_range(pl.len()) % 10 == 0).then("u").alias("u"), x=pl.lit(None), y=pl.lit(None)
    )
    made = table.make("raw", sparse, stage="import")
    back = table.read(io.BytesIO(bytes_of(made)), "raw")
    assert back.frame.equals(made.frame)
    assert back.provenance == made.provenance
    assert made.frame.schema["x"] == pl.Float64
    assert made.frame["u"].null_count() == 36
    assert table.read(io.BytesIO(parquet(made.frame)), "raw").kind == "raw"


def test_a_recording_without_nulls_stays_of_the_first_version() -> None:
    first, second = schema.load("raw"), schema.load("raw", 2)
    assert table.make("raw", raw(), stage="import").provenance.schema == first.digest
    assert table.make("raw", raw().with_columns(z=pl.lit(None)), stage="x").provenance.schema == second.digest


@pytest.mark.parametrize("name", ["session", "t", "cmd_1"])
def test_what_a_recording_never_lacks(name: str) -> None:
    with pytest.raises(DataError, match="must be present: 40 of 40 rows are not"):
        table.make("raw", raw().with_columns(pl.lit(None).alias(name), x=pl.lit(None)), stage="x")


# Wrong tables


def test_a_wrong_table_is_neither_made_nor_written(tmp_path: Path) -> None:
    broken = raw().with_columns(u=pl.lit(np.nan))
    with pytest.raises(DataError, match=r"^raw: u \[m/s\] must be finite: 40 of 40"):
        table.make("raw", broken, stage="x")
    forged = replace(table.make("raw", raw(), stage="x"), frame=broken)
    with pytest.raises(DataError, match=r"out.parquet: u \[m/s\] must be finite"):
        table.write(forged, tmp_path / "out.parquet")
    assert os.listdir(tmp_path) == []


def test_the_wrong_kind_of_table() -> None:
    content = bytes_of(table.make("raw", raw(), stage="collect"))
    with pytest.raises(DataError, match="stdin: a raw table, but this needs labels or split"):
        table.read(io.BytesIO(content), ("labels", "split"))
    assert "column u_s" not in refused(parquet(raw()), "blocks")
    assert "columns block, part are missing" in refused(parquet(raw()), "blocks")


SESSION = raw()["session"].to_list()
NOT_UTF8 = pa.Array.from_buffers(
    pa.string(), 40, [None, pa.array(np.arange(41, dtype=np.int32)).buffers()[1], pa.py_buffer(b"\xff" * 40)]
)
COLUMNS: dict[str, tuple[str, pa.Array, str]] = {
    "whole numbers": ("u", pa.array(range(40)), "u [m/s] must be float32 or float64, but is int64"),
    "half precision": ("u", pa.array(np.zeros(40, np.float16)), "but is float16"),
    "texts": ("u", pa.array(["1.0"] * 40), "but is string"),
    "nothing at all": ("u", pa.nulls(40), "but is null"),
    "a missing value": ("t", pa.array([None, *[0.0] * 39]), "t [s] must be present: 1 of 40 rows is not"),
    "a map": ("u", pa.array([[("a", 1)]] * 40, pa.map_(pa.string(), pa.int32())), "but is map<string, int32"),
    "moments": ("t", pa.array(range(40)).cast(pa.timestamp("us")), "t [s] must be float32 or float64"),
    "bytes for names": ("session", pa.array([b"a"] * 40), "session must be string, but is binary"),
    "numbers for names": ("session", pa.array([1] * 40), "session must be string, but is int64"),
    "names that are not UTF-8": ("session", NOT_UTF8, "session contains text that is not UTF-8"),
}


@pytest.mark.parametrize("case", COLUMNS)
def test_a_column_that_is_not_what_it_should_be(case: str) -> None:
    name, values, line = COLUMNS[case]
    arrow = raw().to_arrow(compat_level=pl.CompatLevel.oldest())
    broken = arrow.set_column(arrow.column_names.index(name), name, values)
    assert line in refused(parquet(broken))


def test_a_dictionary_of_names_is_read_as_names() -> None:
    arrow = raw().to_arrow(compat_level=pl.CompatLevel.oldest())
    coded = arrow.set_column(0, "session", arrow["session"].combine_chunks().dictionary_encode())
    assert table.read(io.BytesIO(parquet(coded)), "raw").frame.equals(raw())


def test_a_column_given_twice() -> None:
    arrow = raw().to_arrow(compat_level=pl.CompatLevel.oldest())
    twice = pa.table([*arrow.columns, arrow["u"]], names=[*arrow.column_names, "u"])
    assert refused(parquet(twice)) == "stdin: column u appears twice: leave one out"


def test_column_names_that_are_not_utf8() -> None:
    content = parquet(raw().rename({"x": "xxxxx"}), store_schema=False).replace(b"xxxxx", b"\xff\xfe\xfdab")
    assert "column names must be UTF-8" in refused(content)


@pytest.mark.parametrize("frame", [raw().clear(), pl.DataFrame()])
def test_a_table_without_rows_or_columns(frame: pl.DataFrame) -> None:
    assert "no rows" in refused(parquet(frame)) or "missing" in refused(parquet(frame))


# Wrong files


FILES: dict[str, tuple[bytes, str]] = {
    "a text": (
        b"session,t,x\na,0.0,1.0\n",
        "not a Parquet file: convert it, with the columns of a raw table",
    ),
    "noise": (bytes(range(256)), "not a Parquet file"),
    "the first four bytes": (b"PAR1", "this Parquet file is cut short: write or copy it again"),
    "no footer": (b"PAR1" + bytes(100) + b"PAR1", "this Parquet file is damaged"),
    "nothing": (b"", "empty file"),
}


@pytest.mark.parametrize("case", FILES)
def test_a_file_that_is_not_parquet(case: str, tmp_path: Path) -> None:
    content, line = FILES[case]
    path = tmp_path / "raw.parquet"
    path.write_bytes(content)
    with pytest.raises(DataError) as caught:
        table.read(path, "raw")
    assert str(caught.value).startswith(f"{path}: {line}")
    assert line in refused(content)


WHOLE = bytes_of(table.make("raw", raw(), stage="collect", vehicle_text=VEHICLE))


@given(st.integers(0, len(WHOLE) - 1))
def test_a_truncated_file_is_refused(length: int) -> None:
    line = refused(WHOLE[:length])
    assert "cut short" in line or "empty" in line or "not a Parquet file" in line


@given(st.lists(st.tuples(st.integers(0, len(WHOLE) - 1), st.integers(0, 255)), min_size=1, max_size=4))
def test_a_damaged_file_is_refused_or_still_holds_the_same(damage: list[tuple[int, int]]) -> None:
    content = bytearray(WHOLE)
    for place, value in damage:
        content[place] = value
    try:
        artefact = table.read(io.BytesIO(bytes(content)), "raw")
    except DataError:
        return
    assert artefact.provenance.stage is None or artefact.frame.equals(raw())


def test_a_footer_of_another_version() -> None:
    arrow = raw().to_arrow(compat_level=pl.CompatLevel.oldest())
    content = parquet(arrow.replace_schema_metadata({"hydro": '{"kind": "raw"}'}))
    assert "its `hydro` footer cannot be read" in refused(content)


def test_a_folder_and_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="this is a folder: name a file in it"):
        table.read(tmp_path)
    with pytest.raises(DataError, match="no such file or folder: check the path"):
        table.read(tmp_path / "none.parquet")


# Cost


def seconds(call: Callable[[], object], times: int = 3) -> float:
    """The shortest of a few runs."""
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        spent.append(time.perf_counter() - start)
    return min(spent)


def test_checking_and_hashing_cost_less_than_writing(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    frame = raw(60_000, thrusters=8)
    frame = frame.with_columns(
        pl.Series(name, rng.standard_normal(frame.height).astype(np.float32))
        for name in schema.load("labels").columns([f"cmd_{i + 1}" for i in range(8)])
        if name not in frame.columns
    )
    arrow = frame.to_arrow(compat_level=pl.CompatLevel.oldest())
    made = table.make("labels", frame, stage="labels")
    plain = seconds(lambda: pq.write_table(arrow, tmp_path / "plain.parquet", compression="zstd"))
    ours = seconds(lambda: table.write(made, tmp_path / "ours.parquet"))
    extra = seconds(lambda: table.make("labels", frame, stage="labels"))
    assert extra < plain
    assert ours < 2 * plain
