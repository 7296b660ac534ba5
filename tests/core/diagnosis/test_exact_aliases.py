"""What is an exact alias of effects in the model is told as one, and nothing else is."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from hydro.core.diagnosis.identifiability import aliases
from hydro.core.diagnosis.model import Model
from hydro.core.prediction.parameters import free
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files

LIFT = {"name": "net_buoyancy", "dB": 3.0}
TRIM = {"name": "buoyancy_offset", "dx": 0.01, "dy": 0.0, "dz": -0.005}
LOAD = {"name": "payload", "w": 5.0, "x": 0.2, "y": 0.1, "z": 0.3, "mass": 0.0}


@pytest.fixture(scope="module")
def known(datasets) -> Vehicle:
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


def found(known: Vehicle, *effects: dict) -> dict[str, tuple[str, ...]]:
    """Aliases of damping and these effects among all that the vehicle has not."""
    vehicle = msgspec.structs.replace(known, effect=(*known.effect, *effects))
    names = ["linear_damping", *(effect["name"] for effect in effects)]
    unknown = free(vehicle, names)
    return aliases(Model(unknown, 1.1 * unknown.starts[0], None, None), names)


def test_a_payload_is_an_alias_of_net_buoyancy_and_buoyancy_offset(known):
    assert {name: set(of) for name, of in found(known, LIFT, TRIM).items()} == {
        "payload": {"net_buoyancy", "buoyancy_offset"}
    }


def test_buoyancy_effects_are_aliases_of_a_payload(known):
    assert found(known, LOAD) == dict.fromkeys(("net_buoyancy", "buoyancy_offset"), ("payload",))


@pytest.mark.parametrize("effects", [(), (LIFT,), (TRIM,)])
def test_a_part_of_the_combination_is_not_an_alias(known, effects):
    assert found(known, *effects) == {}


def test_no_alias_without_free_effects(known):
    held = free(known, ["linear_damping"]).holding(np.ones(6), np.ones(6, bool))
    assert aliases(Model(held, np.zeros(0), None, None), []) == {}
