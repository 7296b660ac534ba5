"""Structured model: passive for any weights, by construction."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from sim.trained import trained
from strategies import velocities

from hydro.core.effects import inertia_matrix
from hydro.core.residual.network import Network
from hydro.core.vehicle.frames import rotation
from hydro.core.vehicle.rigid_body import coriolis_matrix, mass_matrix
from hydro.io import vehicle as vehicle_file
from hydro.sim.bridge.water import residual
from hydro.sim.residual.control import Control
from hydro.sim.student import Physics, Student


def drawn(seed: int, size: float):
    """Return the torch network and the artefact with random normal weights of the given size."""
    network, model = trained("structured", seed=seed)
    rng = np.random.default_rng(seed)
    for tensor in model.tensors.values():
        tensor[:] = size * rng.normal(size=tensor.shape)  # shared with the network
    model.tensors["inertia"] /= 10.0
    return network.double(), model


def parts(network, nu: np.ndarray):
    """Return the Coriolis and the dissipative wrench (N, 6) of velocities (N, 6)."""
    with torch.no_grad():
        velocity = torch.from_numpy(nu)
        return network.coriolis(velocity).numpy(), network.dissipation(velocity).numpy()


@given(nu=velocities(), seed=st.integers(0, 10_000), size=st.floats(1e-3, 1e3))
@settings(max_examples=60, deadline=None)
def test_whatever_the_weights_dissipation_takes_power_and_coriolis_none(nu, seed, size):
    network, _ = drawn(seed, size)
    coriolis, dissipation = (part[0] for part in parts(network, nu[None]))
    rounding = 1e-12 * np.abs(nu)
    assert nu @ dissipation >= -rounding @ np.abs(dissipation)
    assert abs(nu @ coriolis) <= rounding @ np.abs(coriolis) + 1e-12 * size


@given(nu=velocities(), seed=st.integers(0, 10_000), size=st.floats(1e-2, 1e2))
@settings(max_examples=40, deadline=None)
def test_the_compiled_wrench_takes_power_too(nu, seed, size):
    _, model = drawn(seed, size)
    wrench = Network.of(model).wrench(np.concatenate([nu, np.zeros(6)]))[0]
    assert nu @ wrench >= -1e-5 * np.abs(nu) @ np.abs(wrench)


def test_at_rest_there_is_no_wrench_and_the_acceleration_changes_nothing():
    network, model = drawn(3, 1.0)
    assert not any(part.any() for part in parts(network, np.zeros((1, 6))))
    states = np.random.default_rng(0).normal(size=(5, 12))
    again = states.copy()
    again[:, 6:] = 0.0
    np.testing.assert_array_equal(Network.of(model).wrench(states), Network.of(model).wrench(again))


def test_coriolis_is_fossen_s_of_the_learned_inertia():
    network, _ = drawn(4, 1.0)
    root = network.root().numpy()
    learned = network.inertia.detach().numpy()
    inertia = 5.0 * (learned + learned.T) * np.outer(root, root)
    for nu in np.random.default_rng(1).normal(size=(5, 6)):
        expected = coriolis_matrix(inertia, nu) @ nu
        np.testing.assert_allclose(parts(network, nu[None])[0][0], expected, rtol=1e-9)


def test_drag_grows_as_the_square_of_the_speed_beyond_all_data():
    network, _ = drawn(5, 0.3)
    direction = np.array([[1.0, 0.4, -0.3, 0.2, 0.1, -0.5]])
    slow, fast = (parts(network, speed * direction)[1] for speed in (1e6, 2e6))
    np.testing.assert_allclose(fast, 4.0 * slow, atol=0.02 * abs(fast).max())


@pytest.mark.parametrize("seed", range(4))
def test_a_flight_without_thrust_never_gains_energy(datasets, seed):
    craft = vehicle_file.read(datasets / "vehicles" / "auv151.toml")[0]
    _, model = drawn(seed, 0.15)
    model.scalers |= {
        "input_scale": np.array([0.5, 0.4, 0.4, 0.3, 0.3, 0.4, *np.ones(6)]),
        "output_scale": np.array([60.0, 90.0, 100.0, 3.0, 6.0, 8.0]),
    }
    rng = np.random.default_rng(seed)
    count = 6
    nu = rng.uniform(-1, 1, (count, 6)) * [3.0, 3.0, 3.0, 2.0, 2.0, 2.0]
    eta = np.hstack([rng.normal(size=(count, 3)), rng.uniform(-1.2, 1.2, (count, 3))])
    student = Student(
        craft,
        residual(craft, Control(Network.of(model))),
        count=count,
        physics=Physics(integrator="rk4"),
    )
    student.start(eta, nu)
    flown = student.fly(np.zeros((count, 500, 8)), 20)  # 20 s, a row per control step
    energies = np.array([[energy(craft, row) for row in rows] for rows in flown])
    before = np.array([energy(craft, row) for row in np.hstack([eta, nu])])
    assert np.isfinite(flown).all()
    assert (energies.max(axis=1) <= before + 0.01 * abs(before) + 0.1).all()


def energy(craft, state: np.ndarray) -> float:
    """Return the kinetic energy with added mass plus the potential energy of weight and buoyancy [J]."""
    eta, nu = state[:6], state[6:]
    inertia = mass_matrix(craft) + inertia_matrix(craft)
    R = rotation(*eta[3:])
    weight = craft.rigid_body.mass * craft.environment.gravity
    depth_of_weight = (eta[:3] + R @ craft.rigid_body.center_of_gravity)[2]
    depth_of_buoyancy = (eta[:3] + R @ craft.buoyancy.center)[2]
    return 0.5 * nu @ inertia @ nu - weight * depth_of_weight + craft.buoyancy.force * depth_of_buoyancy
