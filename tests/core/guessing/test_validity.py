"""Columns that say which samples count, by their names."""

from __future__ import annotations

import pytest

from hydro.core.guessing.validity import validity


@pytest.mark.parametrize(
    ("columns", "beside"),
    [
        ([f"/dvl/data.velocity.{axis}" for axis in "xyz"], "/dvl/data.velocity_valid"),
        ([f"/dvl/data.velocity.{axis}" for axis in "xyz"], "/dvl/data.valid"),
        ([f"/dvl.twist.linear.{axis}" for axis in "xyz"], "/dvl.velocity_valid"),
        ([f"dvl_{axis}" for axis in "xyz"], "dvl_valid"),
    ],
)
def test_a_column_beside_a_sensor_is_found(columns: list[str], beside: str) -> None:
    blocks = {"velocity": {"columns": columns}, "position": {"depth": "depth"}}
    assert validity([*columns, "depth", beside], blocks) == {"velocity": beside}
    assert validity([*columns, "depth", "/gps.valid", "valid"], blocks) == {}
    given = {"velocity": {"columns": columns, "valid": "mine"}}
    assert validity([*columns, beside], given) == {}
