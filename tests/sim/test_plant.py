"""Plants: MuJoCo, kernels and reference simulator by control steps, against continuous simulation."""

import msgspec
import numpy as np
import pytest

from hydro.core.vehicle.frames import euler_from_quaternion, quaternion_from_euler, rotation
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.sim.kernel_plant import KernelPlant
from hydro.sim.plant import StudentPlant
from hydro.sim.student import Student
from hydro.sim.teacher import fly, teacher
from hydro.sim.teacher_plant import TeacherPlant

ALL = np.ones(1, dtype=bool)
ETA, NU = np.array([3.0, 4.0, 5.0, 0.3, -0.4, 2.5]), np.array([0.5, -0.3, 0.2, 0.1, -0.2, 0.3])


def craft(**changes):
    known = files.read(bundled("vehicles") / "auv151.toml")[0]
    thrusters = tuple(msgspec.structs.replace(one, **changes) for one in known.thruster)
    return msgspec.structs.replace(known, thruster=thrusters)


def pose(eta):
    return np.concatenate([eta[:3], quaternion_from_euler(*eta[3:])])[None]


def eta(row):
    return np.concatenate([row[:3], euler_from_quaternion(row[3:])])


def commands(rows, seed=0):
    return np.random.default_rng(seed).uniform(-0.8, 0.8, (rows, 8))


def test_the_student_flies_as_it_does_at_length():
    plant, held = StudentPlant(craft()), commands(20)
    plant.reset(ALL, pose(ETA), NU[None])
    np.testing.assert_allclose(eta(plant.pose[0]), ETA, atol=1e-12)
    np.testing.assert_allclose(plant.velocity[0], NU, atol=1e-12)
    student = Student(craft())
    student.start(ETA[None], NU[None])
    wanted = student.fly(held[None], 20)[0]
    for row, told in zip(held, wanted, strict=True):
        plant.step(row[None])
        np.testing.assert_allclose(eta(plant.pose[0]), told[:6], atol=1e-12)
        np.testing.assert_allclose(plant.velocity[0], told[6:], atol=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_the_teacher_flies_as_it_does_at_length(delay):
    known = craft(delay=delay)
    demand = np.random.default_rng(1).uniform(-0.5, 0.5, (40, 6))
    motion, held = fly(teacher(known), demand, depth=5.0, heading=0.7, nu=NU)
    plant = TeacherPlant(known, period=0.02)
    plant.reset(ALL, pose(motion[0, :6]), NU[None])
    for row, told in zip(held[:-1], motion[1:], strict=True):
        plant.step(row[None])
        np.testing.assert_allclose(eta(plant.pose[0]), told[:6], atol=1e-9)
        np.testing.assert_allclose(plant.velocity[0], told[6:], atol=1e-9)


def test_time_goes_on_from_step_to_step_and_begins_anew_with_a_reset():
    """One of two vehicles in a varying current is reset on the way."""
    known, turning = craft(), {"name": "current_trend", "a_N": 0.3, "a_E": -0.2, "t_0": 0.1}
    demand = np.random.default_rng(1).uniform(-0.5, 0.5, (30, 6))
    motion, held = fly(teacher(known, hidden=[turning]), demand, depth=5.0, heading=0.7, nu=NU)
    first, both = np.repeat(pose(motion[0, :6]), 2, axis=0), np.ones(2, dtype=bool)
    plant = TeacherPlant(known, period=0.02, hidden=[turning], count=2)
    plant.reset(both, first, np.repeat(NU[None], 2, axis=0))
    for k in range(20):
        plant.step(np.stack([held[k], held[k - 10]]))
        if k == 9:
            plant.reset(~both | [False, True], first, np.repeat(NU[None], 2, axis=0))
            kept = plant.snapshot()
    np.testing.assert_allclose(plant.velocity, motion[[20, 10], 6:], atol=1e-9)
    plant.restore(kept)
    for k in range(10, 20):
        plant.step(np.stack([held[k], held[k - 10]]))
    np.testing.assert_allclose(plant.velocity, motion[[20, 10], 6:], atol=1e-9)


@pytest.mark.parametrize("make", [StudentPlant, KernelPlant, TeacherPlant])
def test_specific_force_is_acceleration_without_gravity(make):
    plant = make(craft(), period=0.002)
    plant.reset(ALL, pose(ETA), NU[None])
    speeds, felt, attitudes = [], [], []
    for row in np.repeat(commands(3), 10, axis=0):
        plant.step(row[None])
        speeds.append(plant.velocity[0].copy())
        felt.append(plant.specific_force[0].copy())
        attitudes.append(eta(plant.pose[0])[3:])
    for k in (5, 15, 25):
        change = (speeds[k + 1][:3] - speeds[k - 1][:3]) / 0.004
        down = rotation(*attitudes[k])[2]
        wanted = change + np.cross(speeds[k][3:], speeds[k][:3]) - 9.81 * down
        np.testing.assert_allclose(felt[k], wanted, atol=0.02)


@pytest.mark.parametrize("make", [StudentPlant, KernelPlant, TeacherPlant])
def test_a_reset_of_some_leaves_the_others_alone(make):
    one, two = make(craft(), count=2), make(craft(), count=2)
    both, held = np.ones(2, dtype=bool), commands(12).reshape(6, 2, 8)
    for plant in (one, two):
        plant.reset(both, np.repeat(pose(ETA), 2, axis=0), np.repeat(NU[None], 2, axis=0))
    for number, row in enumerate(held):
        one.step(row)
        two.step(row)
        if number == 2:
            one.reset(np.array([True, False]), np.tile([0.0, 0, 3, 1, 0, 0, 0], (2, 1)), np.zeros((2, 6)))
            assert (one.thrust[0] == 0.0).all()
            np.testing.assert_array_equal(one.pose[0], [0, 0, 3, 1, 0, 0, 0])
    np.testing.assert_array_equal(one.velocity[1], two.velocity[1])
    assert (one.velocity[0] != two.velocity[0]).any()


@pytest.mark.parametrize("make", [StudentPlant, KernelPlant, TeacherPlant])
def test_a_snapshot_brings_everything_back(make):
    plant, held = make(craft(), count=2), commands(20).reshape(10, 2, 8)
    plant.reset(np.ones(2, dtype=bool), np.repeat(pose(ETA), 2, axis=0), np.repeat(NU[None], 2, axis=0))
    for row in held[:4]:
        plant.step(row)
    kept, ends = plant.snapshot(), []
    for _ in range(2):
        for row in held[4:]:
            plant.step(row)
        ends.append(plant.pose.copy())
        plant.restore(kept)
        np.testing.assert_array_equal(plant.pose, kept["pose"])
    np.testing.assert_array_equal(*ends)


def test_thrust_is_what_the_thrusters_make_in_both():
    student, tutor = StudentPlant(craft()), TeacherPlant(craft())
    for plant in (student, tutor):
        plant.reset(ALL, pose(ETA), np.zeros((1, 6)))
        for _ in range(3):
            plant.step(np.full((1, 8), 0.5))
    settled = 0.5 * 155.0
    # MuJoCo's is of the beginning of the last physics step.
    np.testing.assert_allclose(tutor.thrust, settled * (1.0 - np.exp(-0.12 / 0.15)), rtol=1e-9)
    np.testing.assert_allclose(student.thrust, settled * (1.0 - np.exp(-0.118 / 0.15)), rtol=1e-9)


def test_a_teacher_beyond_all_numbers_is_told():
    plant = TeacherPlant(craft())
    plant.reset(ALL, pose(ETA), np.full((1, 6), 1e200))
    plant.step(np.zeros((1, 8)))
    assert plant.diverged[0]
    assert np.isfinite(plant.pose).all()
    plant.reset(ALL, pose(ETA), NU[None])
    assert not plant.diverged[0]


@pytest.mark.parametrize("kind", [StudentPlant, KernelPlant, TeacherPlant])
def test_who_rests_stays_and_changes_nothing_for_the_others(kind):
    first, all_, held = pose(ETA).repeat(3, axis=0), np.ones(3, dtype=bool), commands(3)
    plants = [kind(craft(), count=3) for _ in range(2)]
    for plant, flying in zip(plants, (None, np.array([True, False, True])), strict=True):
        plant.reset(all_, first, NU[None].repeat(3, axis=0))
        for _ in range(3):
            plant.step(held, flying)
    whole, some = (np.hstack([plant.pose, plant.velocity, plant.thrust]) for plant in plants)
    np.testing.assert_array_equal(some[[0, 2]], whole[[0, 2]])
    np.testing.assert_allclose(some[1, :7], first[1])
    assert not np.allclose(whole[1, :7], first[1])
