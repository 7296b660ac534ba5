"""Tests share a preprocessed recording where vehicle and table are the same and nothing is replaced."""

from __future__ import annotations

import msgspec
import once
import polars as pl
import pytest
import synthetic

from hydro.core.diagnosis import log_faults, pipeline
from hydro.core.explanation import trials

VEHICLE, RAW = synthetic.vehicle(), pl.DataFrame({"t": [0.0, 0.1], "u": [0.0, 1.0]})


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch):
    """A function wrapped by `once`, and what it was called with."""
    calls: list[tuple] = []
    monkeypatch.setattr(once._Kept, "wanted", True)
    return once.once(lambda *given, **options: calls.append((given, options)) or len(calls)), calls


def test_the_same_recording_is_preprocessed_once(counted):
    function, calls = counted
    assert function(VEHICLE, RAW) == function(VEHICLE, RAW.clone()) == function(VEHICLE, RAW, None) == 1
    assert len(calls) == 1


def test_any_other_number_is_another_recording(counted):
    function, calls = counted
    for vehicle, raw in (
        (VEHICLE, RAW),
        (msgspec.structs.replace(VEHICLE, name="other"), RAW),
        (VEHICLE, RAW.with_columns(u=pl.Series([0.0, 1.0 + 1e-15]))),
        (VEHICLE, RAW.with_columns(u=pl.Series([0.0, None]))),
        (VEHICLE, RAW.cast(pl.Float32)),
        (VEHICLE, RAW.rename({"u": "v"})),
    ):
        function(vehicle, raw)
    assert len(calls) == 6


def test_a_hull_force_model_and_a_replaced_part_of_the_core_are_computed_again(counted, monkeypatch):
    function, calls = counted
    for _ in range(2):
        function(VEHICLE, RAW, hull="a model")
    monkeypatch.setattr(log_faults, "audit", log_faults.audit)
    for _ in range(2):
        function(VEHICLE, RAW)
    assert len(calls) == 4


def test_a_replaced_part_above_preprocessing_changes_no_recording(counted, monkeypatch):
    function, calls = counted
    monkeypatch.setattr(pipeline, "reported", pipeline.reported)
    monkeypatch.setattr(trials.Recordings, "left_out", trials.Recordings.left_out)
    monkeypatch.setattr("hydro.core.diagnosis.pipeline.predicted", pipeline.predicted)
    for _ in range(2):
        function(VEHICLE, RAW)
    assert len(calls) == 1


def test_preprocessing_is_wrapped_in_every_test():
    assert log_faults.preprocess.__wrapped__.__module__ == log_faults.__name__
