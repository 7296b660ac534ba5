"""A comparison with a recording of few samples: errors at these, and at nothing that was filled in."""

from __future__ import annotations

import dataclasses

import numpy as np
import polars as pl
import pytest
from recordings import damped, moved, noisy

from hydro.core.columns import POSE, VELOCITY, WRENCH
from hydro.core.evaluation.compare import compare
from hydro.core.evaluation.regimes import Pieces
from hydro.core.evaluation.replay_error import replay
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import recording

EVERY, FIRST = 10, 3


@pytest.fixture(scope="module")
def flown() -> pl.DataFrame:
    return noisy(moved(damped({"name": "ocean_current", "v_N": 0.2}), rows=2500), 0)


@pytest.fixture(scope="module")
def kept(flown) -> pl.DataFrame:
    sample = pl.int_range(pl.len()) % EVERY == FIRST
    return flown.with_columns(pl.when(sample).then(pl.col(name)).alias(name) for name in VELOCITY[:3])


def test_errors_are_those_at_the_samples_that_were_kept(flown, kept):
    """The predictions are the same: only what they are held against differs."""
    record = recording(damped(), flown)
    fewer = dataclasses.replace(record, seen=recording(damped(), kept).seen)
    motion, pieces, model = Motion.of(record), Pieces.of(record), candidate(damped())
    whole, some = (replay(model, one, motion, pieces, 5.0, 0)[0] for one in (record, fewer))
    predicted, rows = 2510 // 251 - 1, 251
    samples = np.arange(predicted * rows) % EVERY == FIRST
    assert some.counts[:, 0].sum() == samples.sum()
    assert some.counts[:, 3].sum() == whole.rows.sum()
    np.testing.assert_array_equal(some.squares[:, 3:], whole.squares[:, 3:])
    held = dataclasses.replace(record, nu=np.where(fewer.seen[:, 6:], record.nu, 1e3))
    other = replay(model, dataclasses.replace(held, seen=fewer.seen), motion, pieces, 5.0, 0)[0]
    np.testing.assert_array_equal(other.squares, some.squares)


def test_a_comparison_of_samples_agrees_with_that_of_every_row(flown, kept):
    whole, some = (
        compare(damped(), raw).filter(level="replay", by="all", horizon=5.0) for raw in (flown, kept)
    )
    assert whole["axis"].to_list() == some["axis"].to_list()
    for name in VELOCITY[:3]:
        a, b = (table.row(by_predicate=pl.col("axis") == name, named=True) for table in (whole, some))
        assert b["rows"] == pytest.approx(a["rows"] / EVERY, abs=2)
        assert b["rmse"] == pytest.approx(a["rmse"], rel=0.1)
        assert b["noise_floor"] == pytest.approx(a["noise_floor"], rel=0.3)


def test_an_axis_without_samples_has_no_row(flown):
    rare = flown.with_columns(pl.lit(None, pl.Float64).alias(name) for name in ("x", "y", *VELOCITY))
    found = compare(damped(), rare)
    axes = set(found.filter(pl.col("level").is_in(["force", "replay", "yardstick"]))["axis"])
    assert axes == {*POSE[2:], "pose"}
    assert not axes & {*WRENCH, *VELOCITY}
    assert found.filter(level="recording", by="all")["axis"].to_list() == list(POSE[2:])
    again = compare(damped(), rare, against=found)
    assert again.filter(level="replay")["before"].null_count() == 0
