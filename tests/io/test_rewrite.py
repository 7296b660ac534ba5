"""Vehicles as text: what is written is what is read, and an earlier file's comments stay."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
import synthetic
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.core.vehicle.description import Environment, Vehicle
from hydro.io.rewrite import rewritten
from hydro.io.vehicle import parse

FILES = sorted(
    path
    for path in (Path(__file__).resolve().parents[2] / "datasets").rglob("*.toml")
    if "hydro-vehicle/1" in path.read_text()
)
EFFECTS = {
    "linear_damping": {"diagonal": [30.0, 40.0, 50.0, 5.0, 6.0, 7.0]},
    "quadratic_damping": {"diagonal": [95.0, 260.0, 380.0, 10.0, 40.0, 30.0]},
    "added_mass": {"diagonal": [35.0, 120.0, 160.0, 3.0, 12.0, 10.0]},
    "ocean_current": {"v_N": 0.2, "v_E": -0.1, "fit": {"method": "output", "chi2": 1.02}},
}


def comments(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.startswith("#")]


def changed(vehicle: Vehicle, names: list[str], gone: int, density: float) -> Vehicle:
    """The vehicle in other water, with some effects in some order and without its first thrusters."""
    return msgspec.structs.replace(
        vehicle,
        environment=Environment(water_density=density, gravity=vehicle.environment.gravity),
        thruster=vehicle.thruster[gone:],
        effect=tuple({"name": name, **EFFECTS[name]} for name in names),
    )


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.parent.name + "-" + path.stem)
def test_an_unchanged_vehicle_is_the_same_text(path: Path) -> None:
    text = path.read_text()
    vehicle = parse(text)
    assert rewritten(vehicle, text) == text
    assert parse(rewritten(vehicle)) == vehicle


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(FILES),
    st.lists(st.sampled_from(sorted(EFFECTS)), unique=True),
    st.integers(0, 4),
    st.sampled_from([998.0, 1025.0]),
)
def test_whatever_changes_is_read_back_and_comments_stay(
    path: Path, names: list[str], gone: int, density: float
) -> None:
    text = path.read_text()
    wanted = changed(parse(text), names, gone, density)
    made = rewritten(wanted, text)
    assert parse(made) == wanted
    assert rewritten(wanted, made) == made
    head = text.partition("[[thruster]]")[0]  # what is above whatever may go
    assert comments(made)[: len(comments(head))] == comments(head)


def test_one_changed_number_changes_one_line() -> None:
    text = rewritten(synthetic.vehicle()).replace("mass = 151.0", "mass = 151.0   # weighed in air")
    vehicle = parse(text)
    heavier = msgspec.structs.replace(vehicle.rigid_body, mass=160.0)
    made = rewritten(msgspec.structs.replace(vehicle, rigid_body=heavier), text)
    differing = [
        (before, after)
        for before, after in zip(text.splitlines(), made.splitlines(), strict=True)
        if before != after
    ]
    assert differing == [("mass = 151.0   # weighed in air", "mass = 160.0   # weighed in air")]


def test_arrays_are_written_and_a_wrong_vehicle_is_refused() -> None:
    vehicle = synthetic.vehicle()
    fitted = {"name": "linear_damping", "diagonal": np.arange(1.0, 7.0), "standard_error": None}
    made = parse(rewritten(msgspec.structs.replace(vehicle, effect=(fitted,))))
    assert made.effect == ({"name": "linear_damping", "diagonal": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]},)
    massless = msgspec.structs.replace(vehicle.rigid_body, mass=-1.0)
    with pytest.raises(DataError, match="mass"):
        rewritten(msgspec.structs.replace(vehicle, rigid_body=massless))
