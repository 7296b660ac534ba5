"""A ladder in print, where velocities were measured and where they were not."""

from __future__ import annotations

from types import SimpleNamespace

import polars as pl
import pytest

from hydro.core.columns import POSE, VELOCITY
from hydro.report import ladder, study


def steps(axes: tuple[str, ...], unit: str) -> pl.DataFrame:
    """Two steps of a ladder, errors falling from 2 to 1."""
    return pl.DataFrame(
        [
            {
                **{"step": step, "effect": "payload" if step else "", "dataset": "fit", "axis": axis},
                **{"horizon": 5.0, "rmse": 2.0 - step, "noise_floor": 0.5, "unit": unit},
                **{"zero_velocity": 3.0 if axis in VELOCITY else None},
            }
            for step in (0, 1)
            for axis in axes
        ],
        schema_overrides={"zero_velocity": pl.Float64},
    )


@pytest.mark.parametrize(
    ("axes", "whole", "unit"), [((*VELOCITY, "all"), "all", "m/s"), ((*POSE[2:], "pose"), "pose", "m")]
)
def test_the_ladder_shows_errors_of_measured_axes_only(axes: tuple[str, ...], whole: str, unit: str) -> None:
    table = ladder.errors(steps(axes, unit), "fit")
    assert table.columns == ["step", *axes]
    assert table[whole].to_list()[:2] == [2.0, 1.0]
    assert ("zero velocity" in table["step"]) == (whole == "all"), "no line of nothing"
    assert f"{whole} [{unit}]" in ladder.title(steps(axes, unit), "fit")
    step = SimpleNamespace(ladder=steps(axes, unit).filter(step=1))
    assert study.deciding(step) == f"error 1.00 {unit} on the recording"
