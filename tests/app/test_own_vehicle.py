"""A vehicle file that the workbench makes from mass, size and thrusters."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("nicegui")

from hydro.app import own_vehicle
from hydro.core.errors import DataError
from hydro.core.guessing.vehicle_choice import hull_of
from hydro.io import vehicle as vehicles


def test_a_layout_of_t200_thrusters_and_thrusters_one_by_one(tmp_path: Path) -> None:
    hull = own_vehicle.usual_hull(6)
    assert hull is not None
    assert own_vehicle.usual_hull(5) is None
    assert own_vehicle.layouts_with(6)[-1] == "bluerov2"
    assert "none" not in own_vehicle.layouts_with(7)
    made, _ = vehicles.read(own_vehicle.write_estimated(tmp_path / "rov.toml", hull, "bluerov2"))
    assert [one.curve for one in made.thruster] == ["t200"] * 6
    assert made.battery is not None
    assert made.rigid_body.mass == hull.mass
    two = ["-0.5,0.2,0,1,0,0,40", "-0.5,-0.2,0,1,0,0,40"]
    made, _ = vehicles.read(
        own_vehicle.write_estimated(tmp_path / "two.toml", hull_of("30 1.2 0.4 0.3"), "none", two)
    )
    assert [one.max_thrust for one in made.thruster] == [40.0, 40.0]
    assert made.battery is None


def test_a_file_is_never_replaced_and_a_wrong_thruster_is_named(tmp_path: Path) -> None:
    there = tmp_path / "rov.toml"
    there.write_text("mine")
    with pytest.raises(DataError, match="exists already: choose another name"):
        own_vehicle.write_estimated(there, hull_of("30 1.2 0.4 0.3 50"), "vectored6")
    assert there.read_text() == "mine"
    with pytest.raises(DataError, match="thruster 1"):
        own_vehicle.write_estimated(tmp_path / "new.toml", hull_of("30 1.2 0.4 0.3"), "none", ["1,2"])
    assert not (tmp_path / "new.toml").exists()
