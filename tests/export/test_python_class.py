"""Exported Python class: motion equal to `simulate`, without hydro and numpy."""

from __future__ import annotations

import subprocess
import sys

import msgspec
import numpy as np
import polars as pl
import pytest
from export.flown import DT, VEHICLES, apart, commanded, flown, given, vehicle
from export.flown import class_of as made
from export.flown import motion_of_class as motion_of
from sim.effects import EFFECTS, ETA, NU, with_effect

from hydro.core.columns import MOTION, POSE, VELOCITY
from hydro.core.simulation.simulate import simulate
from hydro.export.python_class import class_name, lacks, to_python

RATES = {"bluerov2_heavy": 500.0, "stonefish": 500.0}
"""Integration steps per second where half as many are not enough: lags of 0.029 s, rotors with dead bands."""


SHORT = ("bluerov2_heavy", "stonefish")
"""Vehicles that fly 20 s instead of a minute: Python takes its time with their short steps."""


@pytest.mark.parametrize("name", VEHICLES)
def test_the_motion_is_that_of_simulate(datasets, name):
    commands, motion = (part[: 1000 if name in SHORT else None] for part in flown(datasets, name))
    exported = made(vehicle(datasets, name))
    assert exported.rate == 500.0
    exported.rate = RATES.get(name, 250.0)
    assert np.abs(motion[:, 6:]).max() > 0.3
    assert apart(motion_of(exported, commands), motion) < 1e-6


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_of_the_catalogue_is_held(datasets, effect):
    craft = with_effect(vehicle(datasets, "auv151"), effect)
    table = commanded(8, seconds=1.0)
    state = pl.DataFrame([[*ETA, *NU]] * table.height, schema=[*POSE, *VELOCITY], orient="row")
    raw = simulate(craft, pl.concat([table, state], how="horizontal")).select(MOTION).to_numpy()
    assert apart(motion_of(made(craft), given(table), ETA, NU), raw) < 1e-9
    assert lacks(craft) == []


def test_a_changing_current_knows_when_it_is(datasets):
    craft = with_effect(vehicle(datasets, "auv151"), "current_trend")
    early, late = made(craft), made(craft)
    late.reset(time=30.0)
    still = np.zeros((20, 8))
    assert abs(motion_of(early, still)[-1] - motion_of(late, still)[-1]).max() > 0.01


def test_a_delay_between_two_steps_is_kept(datasets):
    craft = vehicle(datasets, "auv151")
    late = msgspec.structs.replace(
        craft, thruster=tuple(msgspec.structs.replace(one, delay=0.0537) for one in craft.thruster)
    )
    table = commanded(8, seconds=2.0)
    raw = simulate(late, table).select(MOTION).to_numpy()
    assert apart(motion_of(made(late), given(table)), raw) < 1e-9
    assert apart(motion_of(made(late), given(table), steps=3), raw) < 1e-6


def test_the_simulators_loop_comes_to_the_same_as_its_steps_grow_short(datasets):
    """Fossen's main loop takes velocity from `dynamics` and integrates the pose by Euler's method."""
    craft, commands = made(vehicle(datasets, "remus100")), np.full((101, 5), 0.4)
    expected = motion_of(made(vehicle(datasets, "remus100")), commands)[-1]
    errors = []
    for steps in (1, 2, 4):
        craft.reset()
        eta, nu, u_actual = np.zeros(6), np.asarray(craft.nu), np.asarray(craft.u_actual)
        for row in commands[:-1]:
            for _ in range(steps):
                before = nu
                nu, u_actual = craft.dynamics(eta, nu, u_actual, row, DT / steps)
                assert isinstance(nu, np.ndarray)
                eta = eta + DT / steps * kinematics(eta, before)
        errors.append(np.abs(np.concatenate([eta, nu]) - expected).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.2)


def kinematics(eta, nu):
    """Return the rates of the pose, Fossen (2011) eqs. 2.18 and 2.28."""
    phi, theta, psi = eta[3:]
    c, s = np.cos, np.sin
    x = np.array([[1, 0, 0], [0, c(phi), -s(phi)], [0, s(phi), c(phi)]])
    y = np.array([[c(theta), 0, s(theta)], [0, 1, 0], [-s(theta), 0, c(theta)]])
    z = np.array([[c(psi), -s(psi), 0], [s(psi), c(psi), 0], [0, 0, 1]])
    T = np.array(
        [
            [1, s(phi) * np.tan(theta), c(phi) * np.tan(theta)],
            [0, c(phi), -s(phi)],
            [0, s(phi) / c(theta), c(phi) / c(theta)],
        ]
    )
    return np.concatenate([z @ y @ x @ np.asarray(nu)[:3], T @ np.asarray(nu)[3:]])


def test_it_runs_where_nothing_is_installed(datasets, tmp_path):
    place = tmp_path / "rov.py"
    place.write_bytes(to_python(vehicle(datasets, "bluerov2_heavy")))
    lines = (
        "import rov",
        "craft = rov.Bluerov2Heavy()",
        "assert craft.controls[0] == 'T1' and craft.dimU == 8",
        "nu, u = craft.dynamics([0.0] * 6, craft.nu, craft.u_actual, [0.5] * 8, 0.1)",
        "print(nu[2])",
    )
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", "import sys; sys.path.insert(0, '.'); " + "; ".join(lines)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(done.stdout) < 0.0, "T5 to T8 push up"


def test_a_name_that_is_no_name_of_a_class():
    assert class_name("3rd vehicle") == "Vehicle3rdVehicle"
    assert class_name("§") == "Vehicle"
