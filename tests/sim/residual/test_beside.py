"""Network with a changed vehicle file: additional effects act, and incompatible changes are refused."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
from sim.trained import trained

from hydro.core.columns import POSE, VELOCITY
from hydro.core.distillation.features import features
from hydro.core.effects import inertia_matrix
from hydro.core.errors import DataError
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.rigid_body import coriolis_kernel, mass_matrix
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
    """Return a vehicle with its centre of gravity at CO, and added mass as its only effect."""
    known = vehicle_file.read(datasets / "vehicles" / "auv151.toml")[0]
    body = msgspec.structs.replace(known.rigid_body, center_of_gravity=(0.0, 0.0, 0.0))
    kept = tuple(effect for effect in known.effect if effect["name"] == "added_mass")
    return msgspec.structs.replace(known, rigid_body=body, effect=kept)


def changed(craft, *effects):
    return msgspec.structs.replace(craft, effect=(*craft.effect, *effects))


def silent(labelled):
    """Return a network with zero output."""
    _, model = trained("mlp")
    model.labelled = labelled
    model.tensors = {name: np.zeros_like(value) for name, value in model.tensors.items()}
    model.scalers = model.scalers | {"output_mean": np.zeros(6)}
    return model


def drifting(vehicle, rows=25):
    """Return a free vehicle without thrust, so slow that quadratic terms vanish."""
    columns = {"session": ["a"] * rows, "t": np.arange(rows) * 0.02}
    columns |= {f"cmd_{i + 1}": np.zeros(rows) for i in range(8)}
    start = dict.fromkeys((*POSE, *VELOCITY), 0.0) | {"z": 5.0, "psi": 0.3}
    columns |= {name: [value] * rows for name, value in start.items()}
    return simulate(vehicle, pl.DataFrame(columns))


@pytest.mark.parametrize("effect", CHANGES, ids=lambda effect: effect["name"])
def test_what_is_hung_on_the_vehicle_acts_beside_the_network(craft, effect):
    vehicle = changed(craft, effect)
    raw = drifting(vehicle)
    flown = variants([silent(craft)], ["MJ1"])
    series, _ = replay(vehicle, raw, flown, setup=Setup(physics=Physics(integrator="rk4")))
    names = [*POSE, *VELOCITY]
    motion = series.filter(variant="MJ1").select(names).to_numpy()
    true, bare = (table.select(names).to_numpy() for table in (raw, drifting(craft)))
    moved = np.abs(true - bare).max()
    assert moved > 0.005
    assert np.abs(motion - true).max() < 0.05 * moved


DAMPING = (
    {"name": "linear_damping", "diagonal": [40.0, 90.0, 120.0, 20.0, 30.0, 25.0]},
    {"name": "quadratic_damping", "diagonal": [95.0, 260.0, 380.0, 10.0, 40.0, 30.0]},
)
CURRENT = {"name": "ocean_current", "v_N": 0.4, "v_E": -0.25, "v_D": 0.05}


def exact(craft):
    """Return a network equal to C(nu) nu + D(nu) nu of a vehicle, which are linear in its features."""
    _, model = trained("physfeat", layers=[45, 6])
    nu = np.random.default_rng(1).normal(size=(500, 6))
    linear, quadratic = (np.array(effect["diagonal"]) for effect in DAMPING)
    wrench = (linear + quadratic * np.abs(nu)) * nu
    for state, out in zip(nu, wrench, strict=True):
        coriolis_kernel((mass_matrix(craft) + inertia_matrix(craft)).ravel(), state, out)
    x = features(np.hstack([nu, np.zeros((500, 6))]))
    weights = np.linalg.lstsq(x, wrench, rcond=None)[0]
    assert np.abs(x @ weights - wrench).max() < 1e-9
    model.tensors = {"layers.0.weight": weights.T, "layers.0.bias": np.zeros(6)}
    still = {"input_mean": np.zeros(45), "output_mean": np.zeros(6)}
    model.scalers = still | {"input_scale": np.ones(45), "output_scale": np.ones(6)}
    model.labelled = craft
    return model


def driven(vehicle, rows=400):
    """Return a vehicle under thrusts that rotate it about every axis."""
    t = np.arange(rows) * 0.02
    columns = {"session": ["a"] * rows, "t": t}
    columns |= {f"cmd_{i + 1}": 0.5 * np.sin((0.6 + 0.23 * i) * t + i) for i in range(8)}
    return simulate(vehicle, pl.DataFrame(columns))


def test_a_network_of_still_water_flies_in_a_current_as_the_vehicle_does(craft):
    """The reference integrates the balance in nu_r; the inertia of a load counts in either frame."""
    load = {"name": "payload", "w": 0.0, "x": 0.3, "y": -0.1, "z": 0.1, "mass": 15.0}
    setup = Setup(physics=Physics(integrator="rk4"), control_step=0.002)
    names, model = [*POSE, *VELOCITY], exact(craft)
    for more in ((), (CURRENT,), (CURRENT, load)):
        raw = driven(changed(craft, *DAMPING, *more))
        series, _ = replay(changed(craft, *more), raw, variants([model], ["MJ4"]), setup=setup)
        motion = series.filter(variant="MJ4").select(names).to_numpy()
        assert np.ptp(raw["psi"].to_numpy()) > 0.2
        np.testing.assert_allclose(motion, raw.select(names).to_numpy(), atol=1e-4)


def test_a_network_that_learnt_in_a_current_flies_in_no_other(craft):
    learnt = changed(craft, CURRENT)
    assert beside(learnt, learnt) == ()
    for now in (craft, changed(craft, CURRENT | {"v_N": 0.1}), changed(learnt, CURRENT | {"v_E": 0.2})):
        with pytest.raises(DataError, match=r"^ocean_current of .* cannot be added to it"):
            beside(now, learnt)
    sheared = changed(craft, {"name": "current_shear", "g_E": 0.1})
    with pytest.raises(DataError, match=r"^ocean_current of .* cannot be added to it"):
        beside(changed(sheared, CURRENT), sheared)


@pytest.mark.parametrize(
    "effect",
    [
        {"name": "linear_damping", "diagonal": [9.0] * 6},
        {"name": "current_shear", "g_N": 0.1},
        {"name": "current_trend", "a_E": 0.01},
    ],
    ids=lambda effect: effect["name"],
)
def test_what_cannot_act_beside_it_is_refused_by_name(craft, effect):
    for now, then in ((changed(craft, effect), craft), (craft, changed(craft, effect))):
        with pytest.raises(DataError, match=rf"^{effect['name']} of .* cannot be added to it"):
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
