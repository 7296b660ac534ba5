"""Residual network inside the simulation, compared with the same parts combined outside."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from mujoco import batch, rollout
from sim.trained import trained

from hydro.core.distillation import history
from hydro.core.errors import UsageError
from hydro.core.recording.smoothing import Design, smooth
from hydro.core.residual.network import Network
from hydro.core.vehicle.rigid_body import coriolis_matrix
from hydro.io import vehicle as vehicle_file
from hydro.sim.bridge import mjcf, native, states
from hydro.sim.bridge.water import AT_CONTROL, PREFIX, residual
from hydro.sim.residual import control
from hydro.sim.residual.conditioning import COUNTS, Conditioning, condition
from hydro.sim.residual.control import Control
from hydro.sim.student import control_states

ETA = np.array([0.0, 0.0, 5.0, 0.1, -0.2, 1.0])
NU = np.array([0.5, -0.2, 0.1, 0.1, -0.1, 0.2])
TICKS, STEPS = 40, 20
DESIGN = Design(0.02, (10.0,) * 6, (0.01,) * 6)
CONDITIONING = Conditioning(
    beta=0.7, limits=(8.0, 8.0, 8.0, 2.0, 2.0, 2.0), linear_deadband=0.8, angular_deadband=0.8
)


@pytest.fixture(scope="module")
def craft(datasets):
    return vehicle_file.read(datasets / "vehicles" / "auv151.toml")[0]


def controlled(name):
    _, artefact = trained(name)
    artefact.scalers = artefact.scalers | {"output_mean": np.full(6, 2.0), "output_scale": np.full(6, 9.0)}
    return Control(Network.of(artefact), 0.04, DESIGN, CONDITIONING)


@pytest.fixture(scope="module", params=["physfeat", "temporal"])
def held_control(request):
    return controlled(request.param)


@pytest.fixture(scope="module", params=["physfeat", "temporal", "structured"])
def residual_control(request):
    return controlled(request.param)


def compiled(craft, control=None, integrator="implicitfast"):
    return native.prepare(mjcf.scene(craft, residual(craft, control), integrator=integrator).compile())


def started(model, nu=NU):
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = states.to_mujoco(ETA, nu)
    data.ctrl[:] = 0.3
    return data


@pytest.mark.parametrize("integrator", ["implicitfast", "rk4"])
def test_every_control_step_is_filter_network_and_conditioning(craft, held_control, integrator):
    inside, outside = compiled(craft, held_control, integrator), compiled(craft, None, integrator)
    first = control_states(inside, craft.name)
    data, twin = started(inside), started(outside)
    nus, held, counted = [], [], None
    for _ in range(TICKS):
        nus.append(states.from_mujoco(data.qpos, data.qvel)[1])
        mujoco.mj_step(inside, data, STEPS)
        held.append(data.act[first + control.HELD : first + control.HELD + 6].copy())
        counted = data.act[first + control.COUNTED : first + control.COUNTED + COUNTS].copy()
        # A host that holds these wrenches flies the same motion, to the bit.
        twin.userdata[:] = held[-1]
        mujoco.mj_step(outside, twin, STEPS)
        np.testing.assert_array_equal(data.qpos, twin.qpos)

    nus = np.array(nus)
    filtered = smooth(nus, [[0, TICKS]], DESIGN.at(0.04), "kalman")
    network = held_control.network
    ahead = nus + 0.5 * 0.04 * filtered[:, :, 1]
    past = history.past(ahead, [(0, TICKS)], 1 + network.memory // 6, 1)
    wrenches = network.wrench(np.hstack([ahead, filtered[:, :, 1]]), past)
    expected, counts = condition(wrenches, nus, CONDITIONING)
    np.testing.assert_allclose(held, expected, atol=1e-9)
    assert tuple(counted) == (counts.steps, *counts.clipped, counts.held_back)
    assert counts.steps == TICKS
    assert max(counts.clipped) > 0
    assert counts.held_back > 0


def test_half_a_control_step_ahead_a_held_wrench_acts_as_one_that_is_always_renewed(craft):
    """Linear damping from a network: the lead removes most of the error of the held wrench."""
    _, model = trained("mlp", layers=[12, 6])
    weight = np.zeros((6, 12), np.float32)
    weight[:, :6] = np.diag([300.0, 400.0, 400.0, 20.0, 60.0, 60.0])
    model.tensors = {"layers.0.weight": weight, "layers.0.bias": np.zeros(6, np.float32)}
    model.scalers = {f"{side}_mean": np.zeros(n) for side, n in (("input", 12), ("output", 6))}
    model.scalers |= {f"{side}_scale": np.ones(n) for side, n in (("input", 12), ("output", 6))}
    network, ends = Network.of(model), {}
    for period, lead in ((0.002, 0.5), (0.04, 0.5), (0.04, 0.0)):
        water = compiled(craft, Control(network, period, lead=lead))
        data = started(water)
        mujoco.mj_step(water, data, 250)
        ends[period, lead] = states.from_mujoco(data.qpos, data.qvel)[1]
    exact = ends[0.002, 0.5]
    led, held = (np.linalg.norm(ends[0.04, lead] - exact) for lead in (0.5, 0.0))
    assert held > 1e-3
    assert led < 0.1 * held


def test_the_wrench_of_a_control_step_is_renewed_once(craft, residual_control):
    model = compiled(craft, residual_control)
    data = started(model)
    first = control_states(model, craft.name)
    mujoco.mj_step(model, data, STEPS)
    for _ in range(3):
        mujoco.mj_forward(model, data)
    assert data.act[first + control.TICK] == 2
    mujoco.mj_resetData(model, data)
    assert not data.act.any()


def test_batch_threads_and_rollout_give_the_same_bits(craft, residual_control):
    model = compiled(craft, residual_control)
    nus = NU * np.linspace(-1, 1, 5)[:, None]
    qpos, qvel = states.to_mujoco(np.tile(ETA, (5, 1)), nus)
    ends = []
    for threads in (1, 2):
        many = batch.Batch(model, 5, nthread=threads)
        many.qpos[:], many.qvel[:], many.ctrl[:] = qpos, qvel, 0.3
        many.step(nstep=205)
        ends.append(np.hstack([many.qpos, many.qvel, many.act]))
    np.testing.assert_array_equal(*ends)

    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    rows = np.zeros((5, mujoco.mj_stateSize(model, full)))
    for k in range(5):
        data = started(model, nus[k])
        mujoco.mj_getState(model, data, rows[k], full)
        mujoco.mj_step(model, data, 205)
        np.testing.assert_array_equal(ends[0][k], np.concatenate([data.qpos, data.qvel, data.act]))
    used = started(model)
    mujoco.mj_step(model, used, 33)
    rolled = rollout.rollout(model, used, rows, np.full((5, 205, 8), 0.3))[0]
    np.testing.assert_array_equal(rolled[:, -1, 1:], ends[0])


def test_a_saved_model_keeps_its_network(craft, residual_control, tmp_path):
    model = compiled(craft, residual_control)
    mujoco.mj_saveModel(model, str(tmp_path / "model.mjb"), None)
    loaded = native.prepare(mujoco.MjModel.from_binary_path(str(tmp_path / "model.mjb")))
    data, again = started(model), started(loaded)
    mujoco.mj_step(model, data, 100)
    mujoco.mj_step(loaded, again, 100)
    np.testing.assert_array_equal(data.qpos, again.qpos)


def test_a_network_that_remembers_keeps_its_control_step():
    network = Network.of(trained("temporal")[1])
    assert Control(network).states == control.UNCONDITIONED + 42
    with pytest.raises(UsageError, match=r"0\.04 s apart: its control step cannot be 0\.02 s"):
        Control(network, 0.02)


def test_a_passive_model_goes_on_from_its_held_wrench_with_the_present_velocity(craft):
    """Between control steps, D of the last step multiplies the present velocity."""
    passive = controlled("structured")
    free = Control(passive.network, 0.04, DESIGN)
    network, model = passive.network, compiled(craft, free)
    first = control_states(model, craft.name)
    data = started(model)
    mujoco.mj_step(model, data, STEPS)
    mujoco.mj_step(model, data, 7)
    block = data.act[first : first + free.states]
    D = block[free.past : free.past + 36].reshape(6, 6)
    np.testing.assert_allclose(D, D.T, rtol=1e-12)
    assert np.linalg.eigvalsh(D).min() > 0.0
    nu = states.from_mujoco(data.qpos, data.qvel)[1]
    inertia = network.weights[network.passive[1] :][:36].reshape(6, 6).astype(float)
    wanted = D @ nu + coriolis_matrix(inertia, nu) @ nu
    felt = np.zeros(6)
    control.exert(free.encode(), block, nu, np.zeros(6), felt)
    np.testing.assert_allclose(-felt, wanted, rtol=1e-4, atol=1e-4)


def test_a_passive_wrench_at_a_control_step_is_the_network_s(craft):
    free = Control(controlled("structured").network, 0.04, DESIGN)
    model = compiled(craft, free)
    data = started(model)
    mujoco.mj_step(model, data, 1)
    first = control_states(model, craft.name)
    block = data.act[first : first + free.states].copy()
    expected = free.network.wrench(np.concatenate([NU, np.zeros(6)]))[0]
    np.testing.assert_allclose(block[control.HELD : control.HELD + 6], expected, rtol=1e-12)
    felt = np.zeros(6)
    control.exert(free.encode(), block, NU, np.zeros(6), felt)
    np.testing.assert_allclose(-felt, expected, rtol=1e-6)


def test_weights_begin_on_a_cache_line(craft, residual_control):
    model = compiled(craft, residual_control)
    field = model.numeric(PREFIX + craft.name).data
    block = field[int(field[AT_CONTROL]) :]
    assert block[int(block[control.AT_WEIGHTS]) :].ctypes.data % 64 == 0


def test_control_steps_are_counted_from_where_a_flight_began():
    states_ = np.zeros((4, control.UNCONDITIONED))
    states_[:, control.TICK] = 10.0, 2511.0, 2511.0, 0.0
    begun = np.array([0.0, 100.0, 100.02, 100.0])
    assert control.steps_since(states_, begun, 0.04).tolist() == [10.0, 11.0, 11.0, 0.0]
