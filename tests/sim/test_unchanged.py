"""MuJoCo's own functions and tools work with models and states of hydro's vehicles."""

from __future__ import annotations

import copy
import threading

import mujoco
import numpy as np
import pytest
from mujoco import batch, rollout
from sim.effects import ETA, NU, commands, preset, with_effect
from sim.trained import trained

from hydro.core.residual.network import Network
from hydro.sim.bridge import mjcf, native, states
from hydro.sim.bridge.water import residual, wet
from hydro.sim.residual.control import Control

STEPS = 150


@pytest.fixture(scope="module")
def crafts(datasets):
    """Return three different vehicles: with internal states and delays, with a network, with rotor lag."""
    memory = preset(datasets, "auv151")
    for effect in ("fluid_memory", "command_delay", "crossflow_drag", "thruster_inflow"):
        memory = with_effect(memory, effect)
    learned, plain = preset(datasets, "remus100"), preset(datasets, "stonefish")
    control = Control(Network.of(trained("physfeat")[1]), 0.04)
    return {"memory": (memory, wet(memory)), "learned": (learned, residual(learned, control)),
            "plain": (plain, wet(plain))}  # fmt: skip


@pytest.fixture(scope="module")
def models(crafts):
    return {name: compiled(*craft) for name, craft in crafts.items()}


def compiled(craft, water):
    return native.prepare(mjcf.scene(craft, water).compile())


def started(model):
    data = mujoco.MjData(model)
    put(data)
    return data


def put(data):
    data.qpos[:], data.qvel[:] = states.to_mujoco(ETA + np.array([0, 0, 20.0, 0, 0, 0]), NU)


def fly(model, data, first=0, steps=STEPS):
    """Advance the simulation with a new command at every step."""
    held = commands(model.nu, rows=2 * STEPS)
    for command in held[first : first + steps]:
        data.ctrl[:] = command
        mujoco.mj_step(model, data)
    return bits(data)


def bits(data):
    return np.concatenate([[data.time], data.qpos, data.qvel, data.act, data.history])


@pytest.mark.parametrize("name", ["memory", "learned", "plain"])
class TestOneVehicle:
    def test_reset_begins_anew(self, models, name):
        model, data = models[name], started(models[name])
        first = fly(model, data)
        mujoco.mj_resetData(model, data)
        put(data)
        np.testing.assert_array_equal(fly(model, data), first)

    def test_copies_fly_on_alike(self, models, name):
        model, data = models[name], started(models[name])
        fly(model, data)
        twin, shallow, deep = mujoco.MjData(model), copy.copy(data), copy.deepcopy(data)
        mujoco.mj_copyData(twin, model, data)
        other_model = copy.copy(model)
        expected = fly(model, data, first=STEPS)
        for again, its_model in ((twin, model), (shallow, other_model), (deep, copy.deepcopy(model))):
            np.testing.assert_array_equal(fly(its_model, again, first=STEPS), expected)

    def test_a_saved_state_brings_everything_back(self, models, name):
        model, data = models[name], started(models[name])
        fly(model, data)
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        saved = np.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, saved, kind)
        expected = fly(model, data, first=STEPS)
        mujoco.mj_setState(model, data, saved, kind)
        np.testing.assert_array_equal(fly(model, data, first=STEPS), expected)

    def test_a_binary_file_holds_all_of_it(self, models, name, tmp_path):
        path = str(tmp_path / "model.mjb")
        mujoco.mj_saveModel(models[name], path, None)
        loaded = mujoco.MjModel.from_binary_path(path)
        flown = fly(loaded, started(loaded))
        np.testing.assert_array_equal(flown, fly(models[name], started(models[name])))

    def test_batch_and_rollout_are_a_loop(self, models, name):
        model, full = models[name], mujoco.mjtState.mjSTATE_FULLPHYSICS
        held = np.stack([commands(model.nu, rows=STEPS)] * 3) * np.array([1.0, 0.5, -0.7])[:, None, None]
        data = started(model)
        starts = np.empty((3, mujoco.mj_stateSize(model, full)))
        expected = np.empty_like(starts)
        for k in range(3):
            mujoco.mj_resetData(model, data)
            put(data)
            mujoco.mj_getState(model, data, starts[k], full)
            for command in held[k]:
                data.ctrl[:] = command
                mujoco.mj_step(model, data)
            mujoco.mj_getState(model, data, expected[k], full)
        for threads in (1, 2):
            many = batch.Batch(model, 3, nthread=threads)
            many.qpos[:], many.qvel[:] = started(model).qpos, started(model).qvel
            end = many.rollout(nstep=STEPS, control=held, record=(full,))[full][:, -1]
            np.testing.assert_array_equal(end, expected)
        used = [started(model), started(model)]
        fly(model, used[0])
        for _ in range(2):
            rolled = rollout.rollout([model] * 3, used, starts, held)[0]
            np.testing.assert_array_equal(rolled[:, -1], expected)

    def test_a_viewer_beside_the_simulation_changes_nothing(self, models, name):
        """A thread does the work of a viewer without a window: copies, forward passes on them, a scene."""
        model = models[name]
        alone = fly(model, started(model))
        shown_model, data = copy.copy(model), started(model)
        shown, done, problems = mujoco.MjData(shown_model), threading.Event(), []
        lock = threading.Lock()

        def render():
            scene, drawn = mujoco.MjvScene(shown_model, maxgeom=100), 0
            while not done.is_set() or not drawn:
                with lock:
                    mujoco.mj_copyData(shown, shown_model, data)
                mujoco.mj_forward(shown_model, shown)
                mujoco.mjv_updateScene(
                    shown_model, shown, mujoco.MjvOption(), None, mujoco.MjvCamera(),
                    mujoco.mjtCatBit.mjCAT_ALL, scene,
                )  # fmt: skip
                drawn += 1
                if not np.isfinite(shown.qacc).all() or scene.ngeom == 0:
                    problems.append(shown.time)

        viewer = threading.Thread(target=render)
        viewer.start()
        for command in commands(model.nu, rows=2 * STEPS)[:STEPS]:
            with lock:
                data.ctrl[:] = command
                mujoco.mj_step(model, data)
        done.set()
        viewer.join()
        np.testing.assert_array_equal(bits(data), alone)
        assert not problems

    def test_looking_at_a_state_does_not_change_it(self, models, name):
        model, data = models[name], started(models[name])
        fly(model, data)
        expected = fly(model, copy.copy(data), first=STEPS)
        for _ in range(3):
            mujoco.mj_forward(model, data)
        np.testing.assert_array_equal(fly(model, data, first=STEPS), expected)


def test_different_vehicles_in_one_process_keep_to_themselves(models):
    alone = {name: fly(model, started(model)) for name, model in models.items()}
    flying = {name: started(model) for name, model in models.items()}
    for step in range(STEPS):
        for name, data in flying.items():
            fly(models[name], data, first=step, steps=1)
    for name, data in flying.items():
        np.testing.assert_array_equal(bits(data), alone[name])


def test_different_vehicles_in_one_scene_fly_as_alone(crafts, models):
    """Activations, controls and parameters of the vehicles follow one another in the arrays."""
    first, *others = crafts.values()
    spec = mjcf.scene(*first)
    for craft, water in others:
        mjcf.add_vehicle(spec, craft, water, name=f"{craft.name} too")
    model = native.prepare(spec.compile())
    data = mujoco.MjData(model)
    apart = np.zeros((3, 7))
    apart[:, 0] = 0.0, 30.0, 60.0  # m
    alone = [started(one) for one in models.values()]
    data.qpos[:] = (apart + [single.qpos for single in alone]).ravel()
    data.qvel[:] = np.concatenate([single.qvel for single in alone])
    held = np.hstack([commands(one.nu, rows=2 * STEPS) for one in models.values()])
    for command in held[:STEPS]:
        data.ctrl[:] = command
        mujoco.mj_step(model, data)
    for one, single in zip(models.values(), alone, strict=True):
        fly(one, single)
    flown = data.qpos.reshape(3, 7) - apart
    np.testing.assert_allclose(flown, [single.qpos for single in alone], atol=1e-9)
    np.testing.assert_allclose(data.qvel, np.concatenate([single.qvel for single in alone]), atol=1e-9)
