"""MuJoCo model of a vehicle file: inertia, restoring forces, hull and names."""

from __future__ import annotations

import msgspec
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim.models import thruster, vehicle

from hydro.core.errors import DataError
from hydro.core.vehicle.description import RigidBody
from hydro.core.vehicle.frames import FRD_FLU
from hydro.core.vehicle.rigid_body import mass_matrix, restoring
from hydro.io import vehicle as vehicle_file
from hydro.sim.bridge import mjcf, native, states, water

CRAFT = vehicle(
    center_of_gravity=(0.03, -0.02, 0.05),
    center_of_buoyancy=(-0.02, 0.03, -0.06),
    buoyancy=410.0,
    thrusters=(thruster("port"), thruster("starboard")),
)
angle = st.floats(-np.pi, np.pi)


def forces(compiled, eta, nu=(0.0,) * 6):
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qvel[:] = states.to_mujoco(eta, nu)
    mujoco.mj_forward(compiled, data)
    return data


def test_the_mass_matrix_is_that_of_the_rigid_body():
    compiled = native.prepare(mjcf.scene(CRAFT, water.dry(CRAFT)).compile())
    data, mass = forces(compiled, np.zeros(6)), np.zeros((6, 6))
    mujoco.mj_fullM(compiled, data, mass)
    np.testing.assert_allclose(mass * np.outer(FRD_FLU, FRD_FLU), mass_matrix(CRAFT), atol=1e-12)


@given(phi=angle, theta=st.floats(-1.5, 1.5), psi=angle)
def test_weight_and_buoyancy_act_at_their_centres_at_any_attitude(phi, theta, psi):
    compiled = native.prepare(mjcf.scene(CRAFT, water.dry(CRAFT)).compile())
    data = forces(compiled, [0, 0, 5, phi, theta, psi])
    _, wrench = states.from_mujoco(data.qpos, data.qfrc_passive - data.qfrc_bias)
    np.testing.assert_allclose(wrench, restoring(CRAFT, phi, theta), atol=1e-9)


@given(
    eta=st.tuples(*[st.floats(-50, 50)] * 3, angle, st.floats(-1.5, 1.5), angle),
    nu=st.tuples(*[st.floats(-5, 5)] * 6),
)
def test_states_return_from_mujoco(eta, nu):
    back, moving = states.from_mujoco(*states.to_mujoco(eta, nu))
    np.testing.assert_allclose(np.exp(1j * (back - eta)), 1.0, atol=1e-7)
    np.testing.assert_allclose(moving, nu, atol=1e-12)


def test_a_vehicle_ahead_down_and_to_starboard_is_where_mujoco_shows_it():
    qpos, qvel = states.to_mujoco([1, 2, 3, 0, 0, np.pi / 2], [1, 0, 0, 0, 0, 0.5])
    np.testing.assert_allclose(qpos[:3], [1, -2, -3])
    np.testing.assert_allclose(qvel, [0, -1, 0, 0, 0, -0.5], atol=1e-15)  # heading east; yaw to starboard


def test_names_and_controls():
    compiled = mjcf.scene(CRAFT).compile()
    assert [compiled.actuator(i).name for i in range(compiled.nu)] == ["probe/port", "probe/starboard"]
    assert compiled.site("probe/port").bodyid == compiled.body("probe").id
    np.testing.assert_array_equal(compiled.actuator_ctrlrange, [[-1, 1], [-1, 1]])


def test_the_hull_mesh_is_turned_from_frd(datasets):
    folder = datasets / "stonefish"
    craft = vehicle_file.read(folder / "vehicle.toml")[0]
    craft = msgspec.structs.replace(craft, hull=msgspec.structs.replace(craft.hull, mesh="hull.obj"))
    compiled = mjcf.scene(craft, folder=folder).compile()
    data = mujoco.MjData(compiled)
    mujoco.mj_kinematics(compiled, data)
    geom = compiled.geom(f"{craft.name}/hull")
    corners = compiled.mesh_vert @ data.geom_xmat[geom.id].reshape(3, 3).T + data.geom_xpos[geom.id]
    written = np.array(
        [
            line.split()[1:4]
            for line in (folder / "hull.obj").read_text().splitlines()
            if line.startswith("v ")
        ],
        float,
    )
    np.testing.assert_allclose(corners.min(axis=0), (written * [1, -1, -1]).min(axis=0), atol=1e-5)
    np.testing.assert_allclose(corners.max(axis=0), (written * [1, -1, -1]).max(axis=0), atol=1e-5)
    with pytest.raises(DataError, match=r"hull\.obj: the hull mesh"):
        mjcf.scene(craft, folder=datasets)


def test_an_inertia_that_no_body_has_is_refused():
    body = RigidBody(40.0, (0.0, 0.0, 0.0), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 3.0)))
    with pytest.raises(DataError, match="principal moments") as caught:
        mjcf.scene(msgspec.structs.replace(CRAFT, rigid_body=body))
    assert "\n" not in str(caught.value)


def test_a_copied_state_flies_on_alike():
    compiled = native.prepare(mjcf.scene(CRAFT).compile())
    data = forces(compiled, [0, 0, 5, 0.3, 0.2, 0.1], [1.0, 0.2, 0.1, 0.3, 0.2, 0.1])
    mujoco.mj_step(compiled, data, 50)
    twin = mujoco.MjData(compiled)
    mujoco.mj_copyData(twin, compiled, data)
    mujoco.mj_step(compiled, data, 50)
    mujoco.mj_step(compiled, twin, 50)
    np.testing.assert_array_equal(data.qpos, twin.qpos)
