"""Fins that follow commands move the preset alike in all simulators and exports, or an export says no."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from export.flown import (
    DT,
    apart,
    class_of,
    commanded,
    given,
    motion_of_class,
    motion_of_functions,
    vehicle,
)

from hydro.core.columns import MOTION
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.frames import euler_from_quaternion
from hydro.export import gazebo
from hydro.export.casadi_function import functions
from hydro.sim.kernel_plant import KernelPlant
from hydro.sim.student import Physics, Student

SECONDS = 4.0


@pytest.fixture(scope="module")
def craft(datasets):
    return vehicle(datasets, "remus100_fins")


@pytest.fixture(scope="module")
def commands(craft):
    table = commanded(len(craft.thruster), seconds=SECONDS)
    turned = pl.when(pl.col("t") < 0.6 * SECONDS).then(0.9).otherwise(-0.6)
    return table.with_columns(cmd_1=pl.lit(1.0), cmd_2=turned, cmd_3=-turned)


@pytest.fixture(scope="module")
def motion(craft, commands):
    found = simulate(craft, commands).select(MOTION).to_numpy()
    without = simulate(craft, commands.with_columns(cmd_2=0.0, cmd_3=0.0)).select(MOTION).to_numpy()
    assert apart(found, without) > 0.02, "the fins matter in this motion"
    return found


def test_the_mujoco_model_has_the_fins(craft, commands, motion):
    student = Student(craft, physics=Physics(timestep=0.002, integrator="rk4"))
    student.start(np.zeros((1, 6)), np.zeros((1, 6)))
    flown = student.fly(given(commands)[None, :-1], round(DT / 0.002))[0]
    assert apart(flown, motion[1:]) < 1e-6


def test_the_kernel_plant_has_the_fins(craft, commands, motion):
    plant = KernelPlant(craft, period=DT, timestep=0.002)
    pose = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])
    plant.reset(np.ones(1, bool), pose, np.zeros((1, 6)))
    for row in given(commands)[:-1]:
        plant.step(row[None])
    end = [*plant.pose[0, :3], *euler_from_quaternion(plant.pose[0, 3:]), *plant.velocity[0]]
    assert apart(np.array([end]), motion[-1:]) < 1e-6


def test_the_python_class_has_the_fins(craft, commands, motion):
    assert apart(motion_of_class(class_of(craft), given(commands)), motion) < 1e-6


def test_the_casadi_functions_have_the_fins(craft, commands, motion):
    pytest.importorskip("casadi", reason="the extra casadi is not installed")
    assert apart(motion_of_functions(functions(craft), given(commands)), motion) < 1e-6


def test_gazebo_names_the_fins_that_it_loses(craft):
    lost = {one.what: one.why for one in gazebo.lacks(craft)}
    for fin in ("control_surface:rudder", "control_surface:stern_planes"):
        assert "no sum of products" in lost[fin]
    assert gazebo.to_sdf(craft).startswith(b"<?xml")
