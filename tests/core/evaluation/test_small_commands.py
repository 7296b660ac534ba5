"""Small commands of held-out data that the training data lack."""

from __future__ import annotations

from functools import cache

import numpy as np
import polars as pl
import pytest
import synthetic

from hydro.core.columns import VELOCITY
from hydro.core.evaluation.small_commands import SMALL, unseen_small_commands
from hydro.core.recording.arrays import Recording, recording
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.thrusters import configuration_matrix
from hydro.report.yardsticks import unlearnt

DT, ROWS = 0.1, 400
YAW = configuration_matrix(synthetic.vehicle())[5]
TURNING = np.sign(np.where(np.abs(YAW) > 1e-6, YAW, 0.0))


@cache
def turning(size: float, share: float) -> Recording:
    """A recording of yaw commands of a size in a share of the time, and at rest otherwise."""
    t = np.arange(ROWS) * DT
    pulses = np.where(np.arange(ROWS) % 20 < 20 * share, size * np.sign(np.sin(0.3 * t)), 0.0)
    columns = {"session": ["a"] * ROWS, "t": t}
    columns |= {f"cmd_{i + 1}": way * pulses for i, way in enumerate(TURNING)}
    vehicle = synthetic.vehicle()
    return recording(vehicle, simulate(vehicle, pl.DataFrame(columns)))


def found(training: Recording, held_out: Recording):
    return list(unseen_small_commands(synthetic.vehicle(), training, held_out))


@pytest.fixture(scope="module")
def small() -> float:
    """A command whose wrench is small, whatever the thrust curve."""
    tried = np.geomspace(0.02, 0.3, 6).tolist()
    return next(size for size in tried if found(turning(0.9, 0.2), turning(size, 0.8)))


def test_small_commands_of_the_held_out_data_alone_are_found(small):
    (one,) = found(turning(0.9, 0.2), turning(small, 0.8))
    assert one.axis == "r"
    assert one.training == 0.0
    assert one.held_out == pytest.approx(0.8, abs=0.05)
    assert one.high == pytest.approx(one.low * SMALL[1] / SMALL[0])


def test_they_are_no_news_where_the_training_data_have_them(small):
    assert not found(turning(small, 0.8), turning(small, 0.8))
    assert not found(turning(small, 0.4), turning(small, 0.8))


def test_rest_and_large_commands_are_not_small(small):
    assert not found(turning(0.9, 0.2), turning(0.9, 0.8))
    assert not found(turning(0.9, 0.2), turning(0.0, 0.8))
    assert not found(turning(0.9, 0.2), turning(small, 0.1))


def errors(model: float) -> pl.DataFrame:
    rows = [
        {
            "axis": axis,
            "horizon": 5.0,
            "unit": "",
            "predictor": "zero velocity",
            "model": model,
            "simple": 0.1,
        }
        for axis in VELOCITY
    ]
    return pl.DataFrame(rows)


def test_explain_says_so_only_where_the_model_loses(small):
    both = turning(0.9, 0.2), turning(small, 0.8)
    (line,) = unlearnt(errors(0.2), synthetic.vehicle(), *both)
    assert line.startswith("On r ")
    assert "dead band" in line
    assert "N m" in line
    assert not unlearnt(errors(0.05), synthetic.vehicle(), *both)
