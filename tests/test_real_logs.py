"""The benchmark on real logs: verdicts by axis, and a kept table that is measured in parts."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.real_logs import JUDGED, judged, with_kept
from hydro.core.columns import VELOCITY
from hydro.core.evaluation.velocity_errors import Squares
from hydro.core.evaluation.yardsticks import LEAST_SQUARES, ZERO

STRETCHES = 60


def errors(**by_axis: float) -> Squares:
    """Squared errors over stretches; 1 m/s or rad/s on axes that are not given."""
    size = np.array([by_axis.get(axis, 1.0) for axis in VELOCITY])
    scatter = np.random.default_rng(0).uniform(0.9, 1.1, (STRETCHES, 6))
    return Squares(size**2 * scatter, np.ones((STRETCHES, 6)))


def test_an_axis_is_judged_against_both_simple_predictors():
    rows = list(judged({ZERO: errors(r=0.5), LEAST_SQUARES: errors(), "model": errors(u=0.5)}))
    assert [row["axis"] for row in rows] == [*JUDGED, "geometric mean"]
    assert [row.get("verdict") for row in rows] == ["not worse"] * 3 + ["worse than zero velocity", None]
    assert float(rows[-1]["model / least squares"]) == pytest.approx(0.5**0.25, abs=1e-3)


def test_new_rows_replace_kept_ones_of_the_same_split_and_vehicle():
    kept = [
        {"split": split, "vehicle": vehicle, "axis": "u", "model": "1"}
        for split in ("two sessions", "all sessions")
        for vehicle in ("vehicle.toml", "vehicle2.toml")
    ]
    new = [{"split": "two sessions", "vehicle": "vehicle2.toml", "axis": "u", "model": "2"}]
    found = with_kept(new, kept)
    assert [(row["split"], row["vehicle"]) for row in found] == [
        (row["split"], row["vehicle"]) for row in kept
    ]
    assert [row["model"] for row in found] == ["1", "2", "1", "1"]
