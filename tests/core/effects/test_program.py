"""The compiled form of a vehicle: what it holds, that it starts from disk and runs from C, and energy."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from typing import Any

import numba
import numpy as np
import pytest
from bench import ADDED, BARE, DAMPED, equipped
from hypothesis import given
from hypothesis import strategies as st
from numba import types
from strategies import numbers, spd_matrices, states, vectors, velocities

from hydro.core.effects import assemble, effect_wrenches, inertia_matrix, layout, validate
from hydro.core.effects.program import HEADER, rates, start, thrusters_of, wrench
from hydro.core.errors import DataError
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle import rigid_body

EVERYTHING = (
    ADDED,
    *DAMPED,
    {"name": "added_mass_coupling", "M15": 2.0, "M24": -3.0},
    {"name": "added_mass_coriolis", "kappa": -0.2},
    {"name": "coupled_damping", "D15": 1.0, "D51": 2.0},
    {"name": "crossflow_drag", "Cd_y": 0.6, "Cd_z": 0.7},
    {"name": "cross_axis_drag", "D01": 3.0, "D52": 2.0},
    {"name": "body_lift", "L11": 9.0, "L15": -2.0, "L51": -2.0, "L55": 1.0},
    {"name": "net_buoyancy", "dB": 4.0},
    {"name": "buoyancy_offset", "dx": 0.01},
    {"name": "payload", "w": 5.0, "x": 0.3, "mass": 2.0},
    {"name": "ocean_current", "v_N": 0.3, "v_E": -0.1},
    {"name": "current_shear", "g_N": 0.02, "g_E": 0.03, "z_0": 2.0},
    {"name": "current_trend", "a_N": 0.004, "a_E": -0.002, "t_0": 7.0},
    {"name": "drifting_ballast", "S": [0.4, 0.2], "tilt": 0.2, "T": 1.5},
    {"name": "tether", "k": 3.0, "slack": 1.0, "anchor": [2.0, 1.0, 0.0]},
    {"name": "surface_suction", "A": 8.0, "decay": 0.7},
    {"name": "fluid_memory", "K": [[3.0] * 6, [1.0] * 6], "rates": [1.0, 6.0]},
    {"name": "thruster_gain", "g": [0.1, -0.1]},
)


def motion_of(seed=0):
    """Some state of motion `s`."""
    s = np.random.default_rng(seed).normal(size=layout.MOTION)
    s[layout.ROTATION : layout.ROTATION + 9] = np.linalg.qr(s[12:21].reshape(3, 3))[0].ravel()
    return s


def run(flat, states, s):
    """Start the effects and add up their wrench."""
    x, dx, tau = np.zeros(states), np.zeros(states), np.zeros(6)
    start(flat, s, x)
    wrench(flat, s, x + 0.1, dx, tau)
    return np.concatenate([tau, x, dx])


def test_a_program_holds_the_vehicle():
    vehicle = equipped(*EVERYTHING)
    program = assemble(vehicle)
    c = program.flat[HEADER : HEADER + layout.CONSTANTS]
    mass = rigid_body.mass_matrix(vehicle) + inertia_matrix(vehicle)
    np.testing.assert_array_equal(c[layout.MASS_MATRIX : layout.MASS_MATRIX + 36], mass.ravel())
    inverse = c[layout.INVERSE_MASS_MATRIX : layout.INVERSE_MASS_MATRIX + 36].reshape(6, 6)
    np.testing.assert_allclose(inverse @ mass, np.eye(6), atol=1e-9)
    np.testing.assert_allclose(c[layout.CURRENT : layout.CURRENT + 3], [0.232, -0.146, 0.0])
    assert program.states == 14
    assert program.effects[0] == "linear_damping"
    assert thrusters_of(program.flat).shape[0] == program.thrusters == 2


def test_effects_add_up_in_any_order():
    s, forward, backward = motion_of(), equipped(*EVERYTHING), equipped(*EVERYTHING[::-1])
    one, other = (run(p.flat, p.states, s) for p in (assemble(forward), assemble(backward)))
    np.testing.assert_allclose(one[:6], other[:6], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.sort(one[6:]), np.sort(other[6:]), rtol=1e-9, atol=1e-9)


def test_a_vehicle_that_cannot_be_accelerated_is_refused():
    massless = {"name": "added_mass", "diagonal": [-1e9] * 6}
    with pytest.raises(DataError):
        validate(equipped(massless))


def test_a_second_process_starts_from_disk():
    run(assemble(equipped(*EVERYTHING)).flat, 14, motion_of())
    trajectory(assemble(BARE), np.zeros((2, 2)), [0.0, 0.02])
    child = (
        "import numpy as np\n"
        "from hydro.core.effects import program\n"
        "from hydro.core.simulation import simulate\n"
        "from bench import BARE\n"
        "p = program.assemble(BARE)\n"
        "program.wrench(p.flat, np.zeros(25), np.zeros(0), np.zeros(0), np.zeros(6))\n"
        "simulate.trajectory(p, np.zeros((2, 2)), [0.0, 0.02])\n"
        "for f in (program.wrench, simulate._follow):\n"
        "    assert f.stats.cache_hits and not f.stats.cache_misses, f\n"
    )
    where = os.pathsep.join([os.path.dirname(__file__), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", child], env=os.environ | {"PYTHONPATH": where}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_a_native_callback_runs_it_from_plain_memory():
    """As in MuJoCo: one block of doubles holds the program, the state of motion and room for results."""
    program, s = assemble(equipped(*EVERYTHING)), motion_of()
    size, n, MOTION = program.flat.size, program.states, layout.MOTION

    @numba.cfunc(types.void(types.CPointer(types.float64)))
    def callback(memory):
        block = numba.carray(memory, size + MOTION + 2 * n + 6)
        flat, motion = block[:size], block[size : size + MOTION]
        x, dx = block[size + MOTION : size + MOTION + n], block[size + MOTION + n : size + MOTION + 2 * n]
        wrench(flat, motion, x, dx, block[size + MOTION + 2 * n :])

    block = np.concatenate([program.flat, s, np.full(n, 0.1), np.zeros(n + 6)])
    callback.ctypes(block.ctypes.data_as(callback.ctypes.argtypes[0]))
    dx, tau = np.zeros(n), np.zeros(6)
    wrench(program.flat, s, np.full(n, 0.1), dx, tau)
    np.testing.assert_array_equal(block[-6 - n :], np.concatenate([dx, tau]))


@st.composite
def dissipative(draw):
    """Damping of every kind that cannot drive the vehicle."""
    skew = draw(vectors(36, 20.0)).reshape(6, 6)
    linear = draw(spd_matrices(scale=20.0)) + skew - skew.T
    fin, x = draw(numbers(0.0, 30.0)), draw(numbers(-0.8, 0.8))
    return (
        {"name": "linear_damping", "matrix": linear.tolist()},
        {"name": "quadratic_damping", "diagonal": np.abs(draw(vectors(6, 100.0))).tolist()},
        {"name": "crossflow_drag", "Cd_y": draw(numbers(0.0, 2.0)), "Cd_z": draw(numbers(0.0, 2.0))},
        {"name": "body_lift", "L11": fin, "L15": fin * x, "L51": fin * x, "L55": fin * x * x},
    )


@given(dissipative(), velocities())
def test_dissipative_effects_take_power(effects, nu):
    validate(equipped(*effects))
    tau = effect_wrenches(equipped(*effects), np.zeros((1, 6)), [nu], [[0, 1]], [0.0])[0]
    assert nu @ tau <= 1e-9 * (1.0 + np.abs(tau) @ np.abs(nu))


@given(vectors(6, 10.0).map(np.abs), numbers(0.1, 20.0), st.integers(0, 1000))
def test_fluid_memory_gives_back_no_more_than_it_took(strength, rate, seed):
    """From rest, the work done on the water is never negative: the memory is passive."""
    t = np.arange(300) * 0.01
    phase, speed = np.random.default_rng(seed).uniform(0.5, 6.0, (2, 6))
    nu = np.sin(np.outer(t, speed)) * np.sin(np.outer(t, phase))
    effect = {"name": "fluid_memory", "K": [strength.tolist()], "rates": [rate]}
    tau = effect_wrenches(equipped(effect), np.zeros((300, 6)), nu, [[0, 300]], 0.01 * np.arange(300))
    work = np.cumsum(0.5 * ((nu * tau)[1:] + (nu * tau)[:-1]).sum(axis=1)) * 0.01
    assert (work <= 1e-3 * (1.0 + strength.sum())).all()


@given(dissipative(), states(), spd_matrices(scale=40.0))
def test_energy_never_rises_without_thrust(effects, state, added):
    """Kinetic energy with added mass, weight, buoyancy, and a tether: falls whatever the damping."""
    eta, nu = state
    tether = {"name": "tether", "k": 4.0, "slack": 2.0, "anchor": (eta[:3] + 3.0).tolist()}
    vehicle = equipped(*effects, {"name": "added_mass", "matrix": added.tolist()}, tether)
    t = np.arange(100) * 0.02
    motion = trajectory(assemble(vehicle), np.zeros((100, 2)), t, eta=eta, nu=0.5 * nu)
    mass = rigid_body.mass_matrix(vehicle) + inertia_matrix(vehicle)
    stretch = np.maximum(0.0, np.linalg.norm(motion[:, :3] - eta[:3] - 3.0, axis=1) - 2.0)
    energy = (
        0.5 * np.einsum("ki,ij,kj->k", motion[:, 6:], mass, motion[:, 6:])
        + rigid_body.potential(vehicle, motion[:, 2], motion[:, 3], motion[:, 4])
        + 0.5 * 4.0 * stretch**2
    )
    assert np.diff(energy).max() <= 1e-7 * (1.0 + 0.5 * nu @ mass @ nu)


@pytest.mark.parametrize("loop", [wrench, rates, start])
def test_generated_code_has_no_lines_of_its_file(loop: Any) -> None:
    """Numba asks for them to keep compiled code; from Python 3.13 on, lines of other code are an error."""
    with pytest.raises(OSError, match=r"lineno|source"):
        inspect.getsourcelines(getattr(loop, "py_func", loop))
