"""The MuJoCo student against exact equations of motion: frames, signs, added mass, contacts."""

from __future__ import annotations

import subprocess
import sys

import msgspec
import mujoco
import numpy as np
import pytest
from mujoco import batch, rollout
from sim.models import GRAVITY, MASS, exact, model, thruster, vehicle

from hydro.core.effects import assemble
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Buoyancy, RigidBody
from hydro.core.vehicle.frames import rotation_from_quaternion
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.core.vehicle.thrusters import configuration_matrix
from hydro.sim.bridge import mjcf, native, states
from hydro.sim.bridge.water import Water

ETA = np.array([1.0, -2.0, 5.0, 0.4, -0.3, 2.0])
NU = np.array([0.8, -0.5, 0.3, 0.7, -0.4, 0.9])
OFFSET = (0.03, -0.02, 0.05)


def added_mass(ratio: float) -> np.ndarray:
    """A full, symmetric and positive definite M_A whose surge entry is `ratio` times the mass."""
    draw = np.random.default_rng(4).normal(size=(6, 6))
    shape = np.diag([1.0, 1.4, 1.8, 0.05, 0.09, 0.08]) + 0.01 * (draw + draw.T)
    return ratio * MASS * shape


def fly(compiled, seconds, eta=ETA, nu=NU, ctrl=None):
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qvel[:] = states.to_mujoco(eta, nu)
    if ctrl is not None:
        data.ctrl[:] = ctrl
    mujoco.mj_step(compiled, data, round(seconds / compiled.opt.timestep))
    assert sum(warning.number for warning in data.warning) == 0
    return data


def error(data, solution) -> float:
    """Largest difference in position, velocity and orientation (as a matrix)."""
    eta, nu = states.from_mujoco(data.qpos, data.qvel)
    from hydro.core.vehicle.frames import rotation

    turn = rotation(*eta[3:]) - rotation_from_quaternion(solution[3:7] / np.linalg.norm(solution[3:7]))
    return max(abs(eta[:3] - solution[:3]).max(), abs(nu - solution[7:]).max(), abs(turn).max())


def test_torque_free_tumbling_follows_eulers_equations():
    craft = vehicle()
    nu = np.array([0.0, 0.0, 0.0, 1.5, -2.0, 0.7])
    data = fly(model(craft, integrator="rk4"), 5.0, nu=nu)
    assert error(data, exact(craft, ETA, nu, 5.0)) < 1e-6
    _, after = states.from_mujoco(data.qpos, data.qvel)
    momentum = [np.linalg.norm(mass_matrix(craft)[3:, 3:] @ rates[3:]) for rates in (nu, after)]
    assert momentum[1] == pytest.approx(momentum[0], rel=1e-8)


def test_pendulum_swings_at_the_frequency_of_its_restoring_moment():
    # A neutral vehicle hung from its centre of buoyancy: for small angles I angle'' = -B h (phi, theta, 0).
    height = 0.1
    craft = vehicle(center_of_buoyancy=(0.0, 0.0, -height))
    stiffness = np.diag([1.0, 1.0, 0.0]) * MASS * GRAVITY * height
    squares, modes = np.linalg.eig(np.linalg.solve(np.array(craft.rigid_body.inertia), stiffness))
    for mode in np.flatnonzero(squares > 1.0):
        period = 2 * np.pi / np.sqrt(squares[mode])
        swing = 1e-4 * modes[:, mode]
        eta = np.concatenate([[0, 0, 5], swing])
        compiled = model(craft, integrator="rk4", timestep=period / 1000)
        for part, left in ((0.25, 0.0), (0.5, -1.0), (1.0, 1.0)):
            data = fly(compiled, part * period, eta=eta, nu=np.zeros(6))
            np.testing.assert_allclose(
                states.from_mujoco(data.qpos, data.qvel)[0][3:], left * swing, atol=3e-8
            )


@pytest.mark.parametrize("integrator", ["rk4", "euler", "implicitfast"])
@pytest.mark.parametrize("ratio", [0.0, 1.3, 6.0])
def test_added_mass_follows_the_exact_motion(ratio, integrator):
    craft = vehicle(
        center_of_gravity=OFFSET, center_of_buoyancy=(-0.02, 0.03, -0.06), buoyancy=1.02 * MASS * GRAVITY
    )
    inertia = added_mass(ratio)
    solution = exact(craft, ETA, NU, 2.0, inertia=inertia, coriolis=inertia)
    if integrator == "rk4":
        data = fly(model(craft, inertia=inertia, coriolis=inertia, integrator="rk4"), 2.0)
        assert error(data, solution) < 1e-8
        return
    steps = [0.004, 0.002, 0.001]
    errors = [
        error(
            fly(model(craft, inertia=inertia, coriolis=inertia, integrator=integrator, timestep=h), 2.0),
            solution,
        )
        for h in steps
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.1)


def test_residual_wrench_replaces_the_coriolis_terms_and_is_held_in_the_body():
    # M nu_dot + g + tau_ML = tau_prop, with no Coriolis of MuJoCo's own left.
    craft = vehicle(center_of_gravity=OFFSET)
    inertia, tau = added_mass(1.3), np.array([5.0, -3.0, 4.0, 0.5, -0.8, 0.3])
    compiled = model(craft, inertia=inertia, cancelled=mass_matrix(craft), held=True, integrator="rk4")
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qvel[:] = states.to_mujoco(ETA, NU)
    data.userdata[:] = tau
    mujoco.mj_step(compiled, data, 1000)
    solution = exact(craft, ETA, NU, 2.0, inertia=inertia, coriolis=-mass_matrix(craft), wrench=-tau)
    assert error(data, solution) < 1e-8


def test_each_thruster_pushes_as_the_allocation_says():
    craft = vehicle(
        center_of_gravity=OFFSET,
        thrusters=(
            thruster("a", (0.4, 0.3, -0.1), (0.6, -0.8, 0.0)),
            thruster("b", (-0.2, 0.1, 0.2), (0.0, 0.0, 1.0)),
            thruster("c", (0.1, -0.5, 0.0), (0.0, 0.6, -0.8)),
        ),
    )
    columns = configuration_matrix(craft)
    compiled = model(craft)
    eta = np.array([0.0, 0.0, 5.0, 0.3, -0.2, 1.0])
    for i in range(3):
        thrust = np.zeros(3)
        thrust[i] = 0.3
        still, pushed = (fly(compiled, 0.0, eta=eta, nu=np.zeros(6), ctrl=c) for c in (np.zeros(3), thrust))
        for data in (still, pushed):
            mujoco.mj_forward(compiled, data)
        # At rest nu_dot is the turned qacc, and M_RB nu_dot the wrench.
        _, nu_dot = states.from_mujoco(still.qpos, pushed.qacc - still.qacc)
        np.testing.assert_allclose(mass_matrix(craft) @ nu_dot, 30.0 * columns[:, i], atol=1e-9)


def test_thrust_step_reaches_the_speed_of_its_impulse():
    craft = vehicle(thrusters=(thruster(),))
    inertia = np.diag([60.0, 0, 0, 0, 0, 0])
    data = fly(
        model(craft, inertia=inertia, coriolis=inertia), 1.0, eta=np.zeros(6), nu=np.zeros(6), ctrl=[0.5]
    )
    _, nu = states.from_mujoco(data.qpos, data.qvel)
    np.testing.assert_allclose(nu, [50.0 / (MASS + 60.0), 0, 0, 0, 0, 0], atol=1e-9)


WALL = {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": [0.1, 5, 5], "name": "wall"}


def test_contacts_feel_added_mass_as_a_heavier_body_would():
    # Isotropic added mass at CO = CG is a heavier rigid body, which MuJoCo alone can also fly into a wall.
    extra = 2.5 * MASS
    light = msgspec.structs.replace(
        vehicle(thrusters=(thruster(),)), rigid_body=RigidBody(MASS, (0.0, 0.0, 0.0), sphere(3.0))
    )
    heavy = msgspec.structs.replace(
        light,
        rigid_body=RigidBody(MASS + extra, (0.0, 0.0, 0.0), sphere(5.0)),
        buoyancy=Buoyancy((MASS + extra) * GRAVITY, (0.0, 0.0, 0.0)),
    )
    inertia = np.diag([extra] * 3 + [2.0] * 3)
    paths = []
    for craft, added in ((light, inertia), (heavy, None)):
        spec = mjcf.scene(craft, Water(assemble(craft), inertia=added, coriolis=added))
        spec.worldbody.add_geom(pos=[1.0, 0.05, 0.0], euler=[0, 0, 10], **WALL)
        compiled = native.prepare(spec.compile())
        data = mujoco.MjData(compiled)
        data.qvel[0], data.ctrl[0] = 1.0, 0.6
        path = []
        for _ in range(600):
            mujoco.mj_step(compiled, data)
            path.append(np.concatenate([data.qpos, data.qvel]))
        touched = data.ncon > 0 or abs(data.qvel[3:]).max() > 0.01
        assert touched
        paths.append(path)
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-6)


def test_a_wall_holds_the_thrust_that_leans_on_it():
    craft = vehicle(thrusters=(thruster(),))
    inertia = np.diag([6 * MASS, MASS, MASS, 1.0, 1.0, 1.0])
    spec = mjcf.scene(craft, Water(assemble(craft), inertia=inertia, coriolis=inertia))
    spec.worldbody.add_geom(pos=[0.6, 0, 0], **WALL)
    compiled = native.prepare(spec.compile())
    data = mujoco.MjData(compiled)
    data.ctrl[0] = 0.9
    mujoco.mj_step(compiled, data, 2000)
    force = np.zeros(6)
    mujoco.mj_contactForce(compiled, data, 0, force)
    assert data.ncon == 1
    assert force[0] == pytest.approx(90.0, rel=1e-4)
    assert abs(data.qvel).max() < 1e-4


@pytest.mark.parametrize("rotation_alone", [False, True])
def test_repeating_the_velocity_stage_adds_no_second_mass(rotation_alone):
    inertia = np.diag([0, 0, 0, 1.0, 2.0, 3.0]) if rotation_alone else added_mass(1.3)
    compiled = model(vehicle(), inertia=inertia)
    data = fly(compiled, 0.1)
    mujoco.mj_forward(compiled, data)
    first = data.qacc.copy()
    for _ in range(2):
        mujoco.mj_forwardSkip(compiled, data, mujoco.mjtStage.mjSTAGE_POS, 0)
        np.testing.assert_array_equal(data.qacc, first)


def test_a_model_without_vehicles_is_untouched():
    xml = """
    <mujoco>
      <custom><numeric name="numbers" data="{numbers}"/></custom>
      <worldbody>
        <body><freejoint/><geom type="ellipsoid" size="0.3 0.2 0.1"/><site name="s"/></body>
      </worldbody>
      <actuator>
        <general site="s" gear="1 2 3 0.1 0.2 0.3" dyntype="user" biastype="user" actdim="1"/>
        <motor site="s" gear="0 0 5 0 0 0"/>
      </actuator>
      <sensor><user dim="1" needstage="pos"/></sensor>
    </mujoco>""".format(numbers=" ".join(map(str, range(40))))
    before = """
import mujoco, sys
model = mujoco.MjModel.from_xml_string(sys.stdin.read())
data = mujoco.MjData(model)
data.qvel[:], data.ctrl[:] = 0.5, 0.7
mujoco.mj_step(model, data, 500)
print(*(x.hex() for x in [*data.qpos, *data.qvel, *model.body_invweight0.ravel()]))
"""
    apart = subprocess.run(
        [sys.executable, "-c", before], input=xml, text=True, capture_output=True, check=True
    )
    native.install()
    plain = native.prepare(mujoco.MjModel.from_xml_string(xml))
    data = mujoco.MjData(plain)
    data.qvel[:], data.ctrl[:] = 0.5, 0.7
    mujoco.mj_step(plain, data, 500)
    here = [x.hex() for x in [*data.qpos, *data.qvel, *plain.body_invweight0.ravel()]]
    assert here == apart.stdout.split()


def test_two_vehicles_in_one_scene_do_not_disturb_each_other():
    light, heavy = vehicle(center_of_gravity=OFFSET), vehicle(center_of_gravity=(0.0, 0.01, 0.02))
    inertias = added_mass(1.3), added_mass(3.0)
    light_water, heavy_water = (
        Water(assemble(craft), inertia=inertia, coriolis=inertia)
        for craft, inertia in zip((light, heavy), inertias, strict=True)
    )
    spec = mjcf.scene(light, light_water)
    mjcf.add_vehicle(spec, heavy, heavy_water, name="other")
    both = native.prepare(spec.compile())
    data = mujoco.MjData(both)
    far = ETA + np.array([50.0, 0, 0, 0, 0, 0])
    (data.qpos[:7], data.qvel[:6]), (data.qpos[7:], data.qvel[6:]) = (
        states.to_mujoco(ETA, NU),
        states.to_mujoco(far, -NU),
    )
    mujoco.mj_step(both, data, 500)
    alone = fly(model(light, inertia=inertias[0], coriolis=inertias[0]), 1.0)
    other = fly(model(heavy, inertia=inertias[1], coriolis=inertias[1]), 1.0, eta=far, nu=-NU)
    np.testing.assert_allclose(data.qpos, np.concatenate([alone.qpos, other.qpos]), atol=1e-9)
    np.testing.assert_allclose(data.qvel, np.concatenate([alone.qvel, other.qvel]), atol=1e-9)


def test_batch_is_a_loop_at_any_thread_count_and_rollout_repeats():
    craft = vehicle(center_of_gravity=OFFSET, thrusters=(thruster(),))
    inertia = added_mass(1.3)
    compiled = model(craft, inertia=inertia, coriolis=inertia)
    rng = np.random.default_rng(0)
    starts = rng.normal(size=(6, 6))
    ends = []
    for threads in (1, 2):
        many = batch.Batch(compiled, 6, nthread=threads)
        many.qpos[:], many.qvel[:] = states.to_mujoco(ETA + 0 * starts, starts)
        many.ctrl[:] = 0.25
        many.step(nstep=200)
        ends.append(np.hstack([many.qpos, many.qvel]))
    np.testing.assert_array_equal(ends[0], ends[1])
    for k in range(6):
        data = fly(compiled, 0.4, nu=starts[k], ctrl=[0.25])
        np.testing.assert_array_equal(ends[0][k], np.concatenate([data.qpos, data.qvel]))

    size = mujoco.mj_stateSize(compiled, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    initial = np.zeros((6, size))
    for k in range(6):
        data = mujoco.MjData(compiled)
        data.qpos[:], data.qvel[:] = states.to_mujoco(ETA, starts[k])
        mujoco.mj_getState(compiled, data, initial[k], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    control = np.full((6, 200, 1), 0.25)
    used = [mujoco.MjData(compiled), fly(compiled, 0.2)]
    rolls = [
        rollout.rollout(compiled, data, initial, control)[0][:, -1, 1:14]
        for data in (used, used[:1], used[1:])
    ]
    for roll in rolls:
        np.testing.assert_array_equal(roll, ends[0])


def test_settings_that_would_silence_the_water_are_refused():
    for change, message in (
        (lambda option: setattr(option, "solver", mujoco.mjtSolver.mjSOL_PGS), "Newton"),
        (lambda option: setattr(option, "disableflags", 0x60), "springs and dampers"),
        (lambda option: setattr(option, "disableflags", int(mujoco.mjtDisableBit.mjDSBL_SENSOR)), "sensors"),
    ):
        spec = mjcf.scene(vehicle())
        change(spec.option)
        with pytest.raises(DataError, match=message):
            native.prepare(spec.compile())


def test_a_model_that_was_never_prepared_does_not_fly():
    native.install()
    compiled = mjcf.scene(vehicle()).compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_step(compiled, data)
    assert data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number == 1


def sphere(moment: float):
    return ((moment, 0.0, 0.0), (0.0, moment, 0.0), (0.0, 0.0, moment))
