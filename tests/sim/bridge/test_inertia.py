"""Added mass in MuJoCo's mass matrix: same factorisation as MuJoCo's."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from sim.models import MASS, vehicle

from hydro.core.effects import assemble
from hydro.sim.bridge import mjcf, native, states
from hydro.sim.bridge.inertia import ENTRIES, factor
from hydro.sim.bridge.water import AT_ALONE, PREFIX, Water

ETA = np.array([1.0, -2.0, 5.0, 0.4, -0.3, 2.0])
NU = np.array([0.8, -0.5, 0.3, 0.7, -0.4, 0.9])


def added_mass() -> np.ndarray:
    draw = np.random.default_rng(4).normal(size=(6, 6))
    return MASS * (np.diag([1.0, 1.4, 1.8, 0.05, 0.09, 0.08]) + 0.01 * (draw + draw.T))


def test_what_floats_apart_on_joints_of_its_own_hangs_on_no_vehicle():
    spec = mjcf.scene(vehicle(), Water(assemble(vehicle()), inertia=added_mass(), coriolis=added_mass()))
    body = spec.worldbody.add_body(pos=[3.0, 0.0, 0.0])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0], mass=2.0)
    arm = spec.worldbody.add_body(pos=[5.0, 0.0, 0.0])
    for axis in np.eye(3)[:2]:
        arm.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    arm.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0], mass=2.0, pos=[0.3, 0, 0])
    model = native.prepare(spec.compile())
    assert model.numeric(PREFIX + "probe").data[AT_ALONE] == 1.0


def armed(*, arm: bool) -> mujoco.MjModel:
    """Return a vehicle in a scene with another body, attached to it or free."""
    craft = vehicle(center_of_gravity=(0.03, -0.02, 0.05))
    inertia = added_mass()
    spec = mjcf.scene(craft, Water(assemble(craft), inertia=inertia, coriolis=inertia))
    owner = spec.body(craft.name) if arm else spec.worldbody
    body = owner.add_body(pos=[0.4, 0.1, -0.2])
    body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 1.0, 0.0])
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0], mass=2.0, pos=[0.3, 0, 0])
    return native.prepare(spec.compile())


@pytest.mark.parametrize("arm", [False, True])
def test_m_is_factored_as_mujoco_does_it(arm):
    model = armed(arm=arm)
    assert model.numeric(PREFIX + "probe").data[AT_ALONE] == (not arm)
    data = mujoco.MjData(model)
    data.qpos[:7], data.qvel[:6] = states.to_mujoco(ETA, NU)
    mujoco.mj_forward(model, data)
    found = data.qLD.copy(), data.qLDiagInv.copy()
    mujoco.mj_factorM(model, data)
    np.testing.assert_array_equal(found[0], data.qLD)
    np.testing.assert_array_equal(found[1], data.qLDiagInv)


def test_what_is_no_mass_matrix_is_left_to_mujoco():
    M = np.zeros(ENTRIES)
    assert not factor(M, np.zeros(ENTRIES), np.zeros(6))
    M[[0, 2, 5, 9, 14, 20]] = 1.0, 2.0, 4.0, 5.0, np.nan, 1.0
    assert not factor(M, np.zeros(ENTRIES), np.zeros(6))
    M[14] = 8.0
    L, inverse = np.zeros(ENTRIES), np.zeros(6)
    assert factor(M, L, inverse)
    np.testing.assert_array_equal(inverse, 1.0 / np.array([1.0, 2.0, 4.0, 5.0, 8.0, 1.0]))
