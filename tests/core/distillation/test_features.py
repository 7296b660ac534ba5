from __future__ import annotations

from itertools import pairwise

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hydro.core.distillation import features
from hydro.core.errors import DataError

STATES = arrays(np.float64, (5, 12), elements=st.floats(-5, 5))
SINGLE = dict(zip("uvwpqr", range(6), strict=True))


def from_name(name: str, x: np.ndarray) -> np.ndarray:
    """A feature computed from nothing but its name."""
    if name.endswith("_dot"):
        return x[:, 6 + SINGLE[name[0]]]
    if name.startswith("|"):
        return np.abs(x[:, SINGLE[name[1]]]) * x[:, SINGLE[name[3]]]
    if name.endswith("|"):
        return x[:, SINGLE[name[0]]] * np.abs(x[:, SINGLE[name[2]]])
    return np.prod([x[:, SINGLE[letter]] for letter in name], axis=0)


@given(STATES)
def test_every_feature_is_what_its_name_says(x):
    columns = features.features(x)
    for k, name in enumerate(features.names("physfeat")):
        np.testing.assert_array_equal(columns[:, k], from_name(name, x), err_msg=name)


def test_the_paper_count_of_parameters():
    names = features.names("physfeat")
    widths = [len(names), 128, 256, 128, 6]
    assert len(set(names)) == 45
    assert sum(a * b + b for a, b in pairwise(widths)) == 72_582


@given(STATES)
def test_kernel_and_columns_agree(x):
    out = np.empty(45)
    for row, expected in zip(x, features.features(x), strict=True):
        features.physfeat_kernel(row, out)
        np.testing.assert_array_equal(out, expected)


@given(STATES)
def test_turning_back_in_time_tells_drag_from_coriolis(x):
    """nu -> -nu: drag terms are odd, Coriolis products are even."""
    back = x.copy()
    back[:, :6] *= -1
    there, again = features.features(x), features.features(back)
    np.testing.assert_array_equal(again[:, 12:18], -there[:, 12:18])
    np.testing.assert_array_equal(again[:, 18:33], there[:, 18:33])
    np.testing.assert_array_equal(again[:, 33:], -there[:, 33:])


def test_cross_terms_are_twelve_different_pairs():
    assert len({tuple(pair) for pair in features.CROSS}) == 12
    assert all(i != j for i, j in features.CROSS)


def test_raw_set_is_the_state_itself():
    x = np.arange(24.0).reshape(2, 12)
    np.testing.assert_array_equal(features.features(x, "raw"), x)
    assert features.names("raw") == ("u", "v", "w", "p", "q", "r", *(f"{a}_dot" for a in "uvwpqr"))


def labels_table(rows: int = 4) -> pl.DataFrame:
    rng = np.random.default_rng(1)
    columns = {
        name: rng.normal(size=rows).astype(np.float32) for name in (*features.INPUTS, *features.OUTPUTS)
    }
    return pl.DataFrame({"session": ["a"] * rows, "t": np.arange(rows) * 0.02, **columns})


def test_table_keeps_targets_and_part():
    labels = labels_table().with_columns(part=pl.lit("train"))
    made = features.table(labels)
    assert made.columns == ["session", "t", "part", *features.names("physfeat"), *features.OUTPUTS]
    assert made["uv"].dtype == pl.Float32
    np.testing.assert_allclose(made["uv"], labels["u_s"] * labels["v_s"], rtol=1e-6)
    assert made.select(features.OUTPUTS).equals(labels.select(features.OUTPUTS))


def test_a_table_without_labels_says_what_to_do():
    with pytest.raises(DataError, match="lacks u_s, Z_res; make it with `hydro labels`"):
        features.table(labels_table().drop("u_s", "Z_res"))


def test_unknown_set():
    with pytest.raises(DataError, match="'physfeats' is not known; choose one of raw, physfeat"):
        features.names("physfeats")
