"""A network flown with a changed vehicle file: what adds to it acts, what does not is refused."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
from sim.trained import trained

from hydro.core.columns import POSE, VELOCITY
from hydro.core.errors import DataError
from hydro.core.simulation.simulate import simulate
from hydro.io import vehicle as vehicle_file
from hydro.sim.replay import Setup, replay, variants
from hydro.sim.residual.beside import beside
from hydro.sim.student import Physics

CHANGES = [
    {"name": "payload", "w": 12.0, "x": 0.3, "y": -0.1, "z": 0.1, "mass": 5.0},
    {"name": "net_buoyancy", "dB": 8.0},
    {"name": "buoyancy_offset", "dx": 0.01, "dy": -0.005, "dz": 0.0},
    {"name": "tether", "k": 3.0, "slack": 0.5, "anchor": [3.0, 0.0, 0.0], "attachment": [0.2, 0.0, 0.0]},
]


@pytest.fixture(scope="module")
def craft(datasets):
    """With its centre of gravity at CO, and the effect of its added mass alone."""
    known = vehicle_file.read(datasets / "vehicles" / "auv151.toml")[0]
    body = msgspec.structs.replace(known.rigid_body, center_of_gravity=(0.0, 0.0, 0.0))
    kept = tuple(effect for effect in known.effect if effect["name"] == "added_mass")
    return msgspec.structs.replace(known, rigid_body=body, effect=kept)


def changed(craft, *effects):
    return msgspec.structs.replace(craft, effect=(*craft.effect, *effects))


def silent():
    """A network that says nothing."""
    _, model = trained("mlp")
    model.tensors = {name: np.zeros_like(value) for name, value in model.tensors.items()}
    model.scalers = model.scalers | {"output_mean": np.zeros(6)}
    return model


def drifting(vehicle, rows=25):
    """A vehicle let go of at rest, without thrust: slow, so that nothing goes with the square of velocity."""
    columns = {"session": ["a"] * rows, "t": np.arange(rows) * 0.02}
    columns |= {f"cmd_{i + 1}": np.zeros(rows) for i in range(8)}
    start = dict.fromkeys((*POSE, *VELOCITY), 0.0) | {"z": 5.0, "psi": 0.3}
    columns |= {name: [value] * rows for name, value in start.items()}
    return simulate(vehicle, pl.DataFrame(columns))


@pytest.mark.parametrize("effect", CHANGES, ids=lambda effect: effect["name"])
def test_what_is_hung_on_the_vehicle_acts_beside_the_network(craft, effect):
    vehicle = changed(craft, effect)
    raw = drifting(vehicle)
    flown = variants([silent()], ["MJ1"], [craft])
    series, _ = replay(vehicle, raw, flown, setup=Setup(physics=Physics(integrator="rk4")))
    names = [*POSE, *VELOCITY]
    motion = series.filter(variant="MJ1").select(names).to_numpy()
    true, bare = (table.select(names).to_numpy() for table in (raw, drifting(craft)))
    moved = np.abs(true - bare).max()
    assert moved > 0.005
    assert np.abs(motion - true).max() < 0.05 * moved


@pytest.mark.parametrize(
    "effect",
    [{"name": "ocean_current", "v_N": 0.3}, {"name": "linear_damping", "diagonal": [9.0] * 6}],
    ids=lambda effect: effect["name"],
)
def test_what_cannot_act_beside_it_is_refused_by_name(craft, effect):
    for now, then in ((changed(craft, effect), craft), (craft, changed(craft, effect))):
        with pytest.raises(DataError, match=rf"^{effect['name']} of .* cannot act beside it"):
            beside(now, then)
    assert beside(changed(craft, effect), changed(craft, effect)) == ()


def test_what_the_network_learnt_from_is_not_added_once_more(craft):
    payload, buoyancy = CHANGES[:2]
    loaded = changed(craft, payload)
    assert beside(loaded, loaded) == ()
    assert beside(changed(craft, payload, buoyancy), loaded) == (buoyancy,)
    noted = changed(craft, payload | {"standard_error": {"w": 0.1}})
    assert beside(noted, loaded) == ()
    with pytest.raises(DataError, match=r"^payload"):
        beside(changed(craft, payload | {"w": 20.0}), loaded)


def test_thrusters_and_sensors_are_the_file_s_with_any_network(craft):
    worn = changed(
        craft, {"name": "thruster_gain", "g": [-0.5] + [0.0] * 7}, {"name": "sensor_delay", "d": 0.1}
    )
    assert beside(worn, craft) == beside(craft, worn) == ()
