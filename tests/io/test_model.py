"""Models as tables: every bit of every tensor comes back, and the same model is the same bytes."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from hydro.core.errors import DataError
from hydro.io import table
from hydro.io.model import SCALERS, Model, from_artefact, to_artefact
from hydro.io.table import Artefact


def model(tensors: dict[str, Any], seed: int = 3) -> Model:
    rng = np.random.default_rng(seed)
    return Model(
        name="physfeat",
        architecture={"layers": [2, 3, 1], "activation": "relu"},
        tensors=tensors,
        features="raw",
        scalers={name: rng.uniform(0.1, 9.0, 2 if name.startswith("input") else 1) for name in SCALERS},
        inputs=("u", "v"),
        outputs=("X_res",),
        units={"u": "m/s", "v": "m/s", "X_res": "N"},
        training={"epochs": 7, "loss": 0.1},
    )


TENSORS = {"w": np.arange(6, dtype=np.float32).reshape(2, 3), "b": np.zeros(3, np.float32)}


def bytes_of(artefact: Artefact) -> bytes:
    stream = io.BytesIO()
    table.write(artefact, stream)
    return stream.getvalue()


@given(st.data(), st.sampled_from([np.float32, np.float64]))
def test_every_bit_comes_back(data: st.DataObject, dtype: type) -> None:
    finite = st.floats(width=32, allow_nan=False, allow_infinity=False)
    tensor = array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=4).flatmap(
        lambda shape: arrays(dtype, shape, elements=finite)
    )
    names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=8)
    tensors = data.draw(st.dictionaries(names, tensor, min_size=1, max_size=4))
    written = model(tensors)
    content = bytes_of(to_artefact(written, seed=1))
    read = from_artefact(table.read(io.BytesIO(content), "model"))
    assert list(read.tensors) == list(tensors)
    for name, expected in tensors.items():
        assert read.tensors[name].dtype == dtype
        assert read.tensors[name].shape == expected.shape
        assert read.tensors[name].tobytes() == expected.tobytes()
    for name in SCALERS:
        assert read.scalers[name].tobytes() == written.scalers[name].tobytes()
    assert replace(read, tensors={}, scalers={}) == replace(written, tensors={}, scalers={})
    assert bytes_of(to_artefact(read, seed=1)) == content


def test_a_transposed_tensor_is_written_as_it_reads() -> None:
    turned = TENSORS["w"].T
    assert not turned.flags.c_contiguous
    read = from_artefact(to_artefact(model({"w": turned})))
    np.testing.assert_array_equal(read.tensors["w"], turned)


def test_the_content_follows_weights_and_the_lineage_the_data() -> None:
    one = to_artefact(model(TENSORS), seed=1)
    other = to_artefact(model(TENSORS | {"b": np.ones(3, np.float32)}), seed=1)
    assert one.provenance.content != other.provenance.content
    child = to_artefact(model(TENSORS), seed=1, inputs=[one], parameters={"epochs": 7})
    assert child.provenance.inputs[0].content == one.provenance.content
    assert child.provenance.stage == "train"


def test_the_number_of_parameters() -> None:
    assert model(TENSORS).parameters == 9


def test_weights_that_are_not_finite_are_not_written() -> None:
    broken = model({"w": np.array([1.0, np.nan])})
    with pytest.raises(DataError, match=r"data \[1\] must be finite: 1 of 1 rows is not"):
        to_artefact(broken)


def test_a_table_that_is_no_model() -> None:
    artefact = to_artefact(model(TENSORS))
    bare = replace(artefact, provenance=replace_model(artefact, None))
    with pytest.raises(DataError, match=r"its footer does not describe one .*: write it with `hydro train`"):
        from_artefact(bare)
    partial = replace(artefact, provenance=replace_model(artefact, {"name": "x"}))
    with pytest.raises(DataError, match="missing required field `architecture`"):
        from_artefact(partial)
    cut = artefact.frame.with_columns(pl.col("data").list.head(2))
    with pytest.raises(DataError, match="tensor w has 2 numbers, which do not fit its shape"):
        from_artefact(replace(artefact, frame=cut))


def replace_model(artefact: Artefact, described: dict[str, Any] | None) -> Any:
    import msgspec

    return msgspec.structs.replace(artefact.provenance, model=described)
