"""Compiled MuJoCo model, compared with `simulation.simulate`: every preset, effect and integrator."""

from __future__ import annotations

from functools import cache

import msgspec
import mujoco
import numpy as np
import pytest
from mujoco import batch, rollout
from sim.effects import DT, EFFECTS, ETA, NU, ROWS, commands, preset, with_effect

from hydro.core.effects import CATALOGUE, assemble
from hydro.core.simulation.simulate import steps_of_row, trajectory
from hydro.sim.bridge import mjcf, native, states
from hydro.sim.bridge.water import wet
from hydro.sim.student import Physics, Student

PRESETS = ("auv151", "bluerov2_heavy", "remus100", "stonefish")
SEGMENTS = 12  # of 5 s
FEWER, SHORTER = 2, 150
"""Segments of a flight with one effect, astern and ahead, and rows of each; presets fly the whole minute."""

FIRST_ORDER = ("euler", "implicitfast")
COARSE = (0.005, 0.0025)
"""Time steps [s] of a flight with one effect; presets fly with half the shorter one too."""

STEPS = {"thruster_inflow": 0.0005}
"""Where RK4 needs shorter steps: this loss goes with the root of the thrust, whose slope is endless at 0."""


CARRIED = ("stonefish", "ocean_current")
"""Without damping, and of one added mass in all directions: to a steady current, still water is as good."""


STARTS = (np.linspace(1.0, 0.1, SEGMENTS) * np.tile([-1.0, 1.0], SEGMENTS // 2))[:, None] * NU
"""Velocities at the starts of the segments: astern and ahead in turn, ever slower."""


def minute(vehicle, segments=SEGMENTS, rows=ROWS):
    """Return commands (segments, rows, n) of 60 s in short segments: rounding grows in unstable motion."""
    return np.stack([commands(len(vehicle.thruster), rows, seed) for seed in range(segments)])


def fly(vehicle, held, *, timestep=0.002, integrator="rk4"):
    """Return the motion (segments, rows, 12) at the end of every row of the commands."""
    physics = Physics(timestep=timestep, integrator=integrator)
    student = Student(vehicle, count=len(held), physics=physics)
    student.start(np.tile(ETA, (len(held), 1)), STARTS[: len(held)])
    return student.fly(held, round(DT / timestep))


def reference(vehicle, held, *, timestep=0.002):
    t = np.arange(held.shape[1] + 1) * DT
    program = assemble(vehicle)
    return np.stack(
        [
            trajectory(
                program,
                np.vstack([segment, segment[-1:]]),
                t,
                eta=ETA,
                nu=nu,
                steps=steps_of_row(DT, 1.0 / timestep),
            )[1:]
            for segment, nu in zip(held, STARTS, strict=False)
        ]
    )


def apart(one, other):
    """Return the differences, with wrapped angles."""
    difference = np.abs(one - other)
    difference[..., 3:6] = np.abs(np.angle(np.exp(1j * (one - other)[..., 3:6])))
    return difference


def orders(vehicle, held, truth, integrator, steps=(0.005, 0.0025, 0.00125)):
    """Return the convergence order of the error from each time step [s] to the next, half as long."""
    errors = [
        np.sqrt(np.mean(apart(fly(vehicle, held, timestep=h, integrator=integrator), truth)[..., 6:] ** 2))
        for h in steps
    ]
    return np.log2(np.array(errors[:-1]) / errors[1:])


@cache
def without(folder, name, effect):
    """Return the reference motion of a preset without an effect."""
    vehicle = preset(folder, name).without(effect)
    return reference(vehicle, minute(vehicle, FEWER, SHORTER))


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_flies_as_simulated_at_the_order_of_the_integrator(datasets, name):
    vehicle = preset(datasets, name)
    held = minute(vehicle)
    truth = reference(vehicle, held)
    assert apart(fly(vehicle, held), truth).max() < 1e-6
    for integrator in FIRST_ORDER:
        found = orders(vehicle, held, truth, integrator)
        np.testing.assert_allclose(found, 1.0, atol=0.1, err_msg=integrator)


@pytest.mark.parametrize("effect", EFFECTS)
@pytest.mark.parametrize("name", PRESETS)
def test_an_effect_acts_as_simulated_at_the_order_of_the_integrator(datasets, name, effect):
    vehicle, timestep = with_effect(preset(datasets, name), effect), STEPS.get(effect, 0.002)
    held = minute(vehicle, FEWER, SHORTER)
    truth = reference(vehicle, held, timestep=timestep)
    motion = fly(vehicle, held, timestep=timestep)
    assert apart(motion, truth).max() < 1e-6
    known = effect if preset(datasets, name).effects(effect) else ""
    acts = apart(motion, without(datasets, name, known)).max() > 1e-5
    assert acts or (name, effect) == CARRIED, "without it the motion is another"
    for integrator in FIRST_ORDER:
        found = orders(vehicle, held, truth, integrator, COARSE)
        np.testing.assert_allclose(found, 1.0, atol=0.1, err_msg=integrator)


def test_every_effect_on_the_motion_is_tried():
    moving = {name for name, one in CATALOGUE.items() if one.kind != "sensor" and not one.is_random}
    assert set(EFFECTS) == moving


def test_a_sea_moves_a_vehicle_in_mujoco_as_in_the_simulation(datasets):
    vehicle = preset(datasets, "auv151")
    waves = {"name": "ocean_waves", "height": 0.6, "period": 4.0, "direction": 0.7, "peak": 2.3}
    vehicle = msgspec.structs.replace(vehicle, effect=(*vehicle.effect, waves))
    held, t = minute(vehicle)[:1], np.arange(ROWS + 1) * DT
    student = Student(vehicle, wet(vehicle, sea=(7,)), physics=Physics(integrator="rk4"))
    student.start(ETA[None], STARTS[:1])
    found = student.fly(held, round(DT / 0.002))[0]
    commands = np.vstack([held[0], held[0, -1:]])
    seas = [
        trajectory(assemble(vehicle, sea=sea), commands, t, eta=ETA, nu=STARTS[0]) for sea in ((7,), None)
    ]
    assert np.abs(found - seas[0][1:])[:, 6:].max() < 1e-6
    assert np.abs(found - seas[1][1:])[:, 6:].max() > 0.05


@pytest.mark.parametrize("name", PRESETS)
def test_all_effects_at_once(datasets, name):
    vehicle = preset(datasets, name)
    for effect in EFFECTS:
        if effect != "added_mass":
            vehicle = with_effect(vehicle, effect)
    held = minute(vehicle)
    assert apart(fly(vehicle, held), reference(vehicle, held)).max() < 1e-6


def test_internal_states_need_no_thruster(datasets):
    vehicle = msgspec.structs.replace(with_effect(preset(datasets, "auv151"), "fluid_memory"), thruster=())
    held = np.zeros((3, 100, 0))
    assert apart(fly(vehicle, held), reference(vehicle, held)).max() < 1e-6


def test_batch_and_rollout_carry_all_states(datasets):
    vehicle = with_effect(with_effect(preset(datasets, "auv151"), "fluid_memory"), "command_delay")
    compiled = native.prepare(mjcf.scene(vehicle).compile())
    held = np.repeat(commands(8, rows=50), 10, axis=0)[None].repeat(4, axis=0)
    qpos, qvel = states.to_mujoco(np.tile(ETA, (4, 1)), NU * np.arange(4)[:, None])
    ends = []
    for threads in (1, 2):
        many = batch.Batch(compiled, 4, nthread=threads)
        many.qpos[:], many.qvel[:] = qpos, qvel
        many.rollout(nstep=500, control=held)
        ends.append(np.array(many.state))
    np.testing.assert_array_equal(*ends)

    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    starts = np.zeros((4, mujoco.mj_stateSize(compiled, full)))
    for k in range(4):
        data = mujoco.MjData(compiled)
        data.qpos[:], data.qvel[:] = qpos[k], qvel[k]
        mujoco.mj_getState(compiled, data, starts[k], full)
    data = mujoco.MjData(compiled)
    first = rollout.rollout(compiled, data, starts, held)[0]
    again = rollout.rollout(compiled, data, starts, held)[0]
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[:, -1, 1 : 1 + compiled.nq], ends[0][:, 1 : 1 + compiled.nq])
