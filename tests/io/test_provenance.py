"""The content hash against a plain second implementation; the record in the footer; lineage."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Callable

import msgspec
import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tables import raw, tables

from hydro.core.errors import DataError
from hydro.io import schema
from hydro.io.__main__ import generated
from hydro.io.provenance import Input, Provenance, content_hash, from_json, lineage, parameters_of

MIXED = pl.DataFrame(
    {
        "name": ["a", None, "bé", ""],
        "value": [1.5, -0.25, None, 3.0],
        "count": pl.Series([1, -2, 3, 4], dtype=pl.Int32),
        "shape": [[1, 2], [], None, [3]],
        "data": [[0.5], [], [1.0, 2.0], [4.0]],
    }
)


def plainly(frame: pl.DataFrame) -> str:
    """The content hash once more, value by value."""

    def missing(values: list) -> bytes:
        bits = [value is None for value in values]
        return struct.pack("<q", len(values)) + (np.packbits(bits).tobytes() if any(bits) else b"")

    def column(values: list, dtype: pl.DataType) -> bytes:
        if isinstance(dtype, pl.List):
            lengths = b"".join(struct.pack("<q", len(value or [])) for value in values)
            inner = column([item for value in values if value is not None for item in value], dtype.inner)
            content = b"list" + missing(values) + lengths + inner
        elif dtype == pl.String:
            texts = [(value or "").encode() for value in values]
            content = b"string" + missing(values) + b"".join(struct.pack("<q", len(text)) for text in texts)
            content += b"".join(texts)
        else:
            logical, code = ("float64", "<d") if dtype.is_float() else ("int64", "<q")
            content = logical.encode() + missing(values)
            content += b"".join(struct.pack(code, 0 if value is None else value) for value in values)
        return hashlib.sha256(content).digest()

    whole = hashlib.sha256()
    for name in sorted(frame.columns):
        whole.update(struct.pack("<q", len(name.encode())) + name.encode())
        whole.update(column(frame[name].to_list(), frame.schema[name]))
    return f"sha256:{whole.hexdigest()}"


@pytest.mark.parametrize("kind", ["raw", "split", "metrics", "model"])
@given(data=st.data())
def test_the_hash_is_what_its_description_says(kind: str, data: st.DataObject) -> None:
    frame = data.draw(tables(kind))
    assert content_hash(frame) == plainly(frame)


def test_the_hash_with_missing_values_and_lists() -> None:
    assert content_hash(MIXED) == plainly(MIXED)


def test_the_hash_never_changes() -> None:
    """Recorded once: a file written today must still be known tomorrow."""
    frame = pl.DataFrame({"session": ["a", "b"], "t": [0.0, 0.5]})
    assert content_hash(frame) == "sha256:a077ac0ebe861fa13da6ac03c2335c14218db1237f72b5cb8d37005de3187b75"


@given(data=st.data())
def test_storage_does_not_matter(data: st.DataObject) -> None:
    frame = data.draw(tables("raw"))
    expected = content_hash(frame)
    cut = data.draw(st.integers(0, frame.height))
    floats = pl.col(pl.Float32)
    assert content_hash(pl.concat([frame[:cut], frame[cut:]], rechunk=False)) == expected
    assert content_hash(frame.with_columns(floats.cast(pl.Float64))) == expected
    assert content_hash(frame.select(data.draw(st.permutations(frame.columns)))) == expected
    assert content_hash(frame.with_columns(pl.col("session").cast(pl.Categorical))) == expected


@pytest.mark.parametrize(
    "change",
    [
        pl.col("x").sort(),
        pl.col("x") + 1e-6,
        pl.col("x").cast(pl.Float64) * (1 + 2**-50),
        pl.when(pl.int_range(pl.len()) == 7).then(-pl.col("x")).otherwise("x").alias("x"),
        pl.when(pl.int_range(pl.len()) == 7).then(None).otherwise("x").alias("x"),
        pl.col("session") + " ",
        pl.col("x").alias("x2"),
    ],
)
def test_any_change_of_content_changes_the_hash(change: pl.Expr) -> None:
    assert content_hash(raw().with_columns(change)) != content_hash(raw())


def test_texts_are_told_apart_by_their_lengths() -> None:
    assert content_hash(pl.DataFrame({"a": ["ab", "c"]})) != content_hash(pl.DataFrame({"a": ["a", "bc"]}))
    assert content_hash(pl.DataFrame({"a": ["", None]})) != content_hash(pl.DataFrame({"a": [None, ""]}))
    assert content_hash(pl.DataFrame({"ab": [1.0]})) != content_hash(pl.DataFrame({"a": [1.0]}))


RECORD = Provenance(
    kind="split",
    schema="sha256:1",
    content="sha256:2",
    stage="split",
    parameters={"test": 0.2, "block": 150, "salt": "ü"},
    seed=3,
    package="0.1.0",
    inputs=(Input("labels", "sha256:3", "labels", {"acceleration": "rts"}, (Input("raw", "sha256:4"),)),),
    vehicle="name = 'x'",
)


def test_the_record_survives_its_json() -> None:
    assert from_json(RECORD.to_json(), "x") == RECORD
    assert json.loads(RECORD.to_json())["inputs"][0]["inputs"] == [{"kind": "raw", "content": "sha256:4"}]


def test_the_same_record_is_the_same_json() -> None:
    reordered = dict(reversed(RECORD.parameters.items()))
    assert msgspec.structs.replace(RECORD, parameters=reordered).to_json() == RECORD.to_json()


@pytest.mark.parametrize("text", [b"{", b"[]", b'{"kind": "raw"}', b"\xff", b'{"kind": 1}'])
def test_a_record_that_cannot_be_read(text: bytes) -> None:
    with pytest.raises(DataError, match="its `hydro` footer cannot be read") as caught:
        from_json(text, "x.parquet")
    assert str(caught.value).startswith("x.parquet: ")
    assert "\n" not in str(caught.value)


def deep_parameters(levels: int) -> str:
    inner = '{"a": ' * levels + "1" + "}" * levels
    return f'{{"kind": "raw", "schema": "s", "content": "c", "parameters": {inner}}}'


def deep_lineage(levels: int) -> str:
    inner = '{"kind": "raw", "content": "c", "inputs": [' * levels + "]}" * levels
    return f'{{"kind": "raw", "schema": "s", "content": "c", "inputs": [{inner}]}}'


@pytest.mark.parametrize("levels", [100, 300, 20_000])
@pytest.mark.parametrize("text", [deep_parameters, deep_lineage])
def test_a_record_that_is_nested_too_deeply_is_one_line(text: Callable[[int], str], levels: int) -> None:
    assert from_json(text(5).encode(), "x").kind == "raw"
    with pytest.raises(DataError, match=r"x.parquet: its `hydro` footer cannot be read \(.*\)") as caught:
        from_json(text(levels).encode(), "x.parquet")
    assert "\n" not in str(caught.value)


def test_lineage_goes_back_to_the_recording() -> None:
    assert [(depth, node.kind, node.stage) for depth, node in lineage(RECORD)] == [
        (0, "split", "split"),
        (1, "labels", "labels"),
        (2, "raw", None),
    ]


@pytest.mark.parametrize("name", ["vehicle.schema.json", "map.schema.json", "footer.schema.json"])
def test_generated_schema_files_are_up_to_date(name: str) -> None:
    stored = (schema.FOLDER / name).read_bytes()
    assert stored == generated()[name], "run `python -m hydro.io` to write it anew"


def test_the_record_has_no_place_for_a_clock_or_a_host() -> None:
    described = json.loads(generated()["footer.schema.json"])["$defs"]["Provenance"]["properties"]
    words = {
        "kind",
        "schema",
        "content",
        "stage",
        "parameters",
        "seed",
        "package",
        "inputs",
        "vehicle",
        "model",
    }
    assert set(described) == words | {"format", "check"}


def test_parameters_of_a_stage_are_found_in_the_lineage() -> None:
    old = Input("labels", "sha256:1", "labels", {"subtract": "inertia"})
    split = Input("split", "sha256:2", "split", {"block": 150}, (old,))
    record = Provenance("model", "s", "sha256:3", "train", {"epochs": 2}, inputs=(split,))
    assert parameters_of(record, "labels") == {"subtract": "inertia"}
    assert parameters_of(record, "train") == {"epochs": 2}
    assert parameters_of(record, "collect") == {}
    newer = Input("labels", "sha256:4", "labels", {"subtract": "effects"})
    both = msgspec.structs.replace(record, inputs=(split, newer))
    assert parameters_of(both, "labels") == {"subtract": "effects"}


@pytest.mark.parametrize(
    ("stage", "parameters", "where"),
    [
        ("diagnose", {"chi2": 3}, "`array`, got `int` - at `$.chi2`"),
        ("explain", {"chi2": [1.0, "x"]}, "`float`, got `str` - at `$.chi2[1]`"),
        ("compare", {"before": []}, "`object`, got `array` - at `$.before`"),
        ("compare", {"before": {"recording": "a", "given": 1.0}}, "missing required field `left`"),
        ("compare", {"before": {"recording": "a", "given": "x", "left": 1.0}}, "`$.before.given`"),
        ("labels", {"noise": [0.1]}, "length >= 6"),
        ("labels", {"subtract": 1}, "`$.subtract`"),
        ("split", {"block": "x"}, "`int`, got `str` - at `$.block`"),
    ],
)
def test_parameters_that_are_read_again_have_their_types(stage: str, parameters: dict, where: str) -> None:
    """In the record itself, and in what its table was made from."""
    made = {"kind": "labels", "content": "b", "stage": stage, "parameters": parameters}
    for said in ({**made, "schema": "s"}, {"kind": "raw", "schema": "s", "content": "c", "inputs": [made]}):
        with pytest.raises(DataError) as refused:
            from_json(json.dumps(said).encode(), "a.parquet")
        assert where in str(refused.value)
        assert "write the file again" in str(refused.value)


def test_other_parameters_are_free() -> None:
    said = {"kind": "raw", "schema": "s", "content": "c", "stage": "collect", "parameters": {"noise": "dvl"}}
    assert from_json(json.dumps(said).encode(), "a.parquet").parameters == {"noise": "dvl"}
