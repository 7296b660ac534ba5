"""Waves: against Airy's potential, spectra by quadrature, and balances of momentum in the world frame."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import polars as pl
import pytest
from bench import DAMPED, R, equipped, neutral
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.spatial.transform import Rotation

from hydro.core.columns import Array
from hydro.core.effects import assemble, effect_forces
from hydro.core.effects.layout import MOTION, POSITION, TIME
from hydro.core.effects.program import in_sea
from hydro.core.effects.waves import BAND, drawn, elevation_spectrum, harmonics, orbits
from hydro.core.errors import DataError
from hydro.core.identification.fit import fit
from hydro.core.identification.suspects import suspects
from hydro.core.simulation.simulate import simulate, trajectory

SEA: dict[str, Any] = {"name": "ocean_waves", "height": 0.8, "period": 6.0, "direction": 0.7, "peak": 2.3}
P = np.array([0.8, 6.0, 0.7, 2.3])
G = 9.81
WAVE = np.array([1.1, 1.1**2 / G, 0.3, -0.2, math.cos(2.1), math.sin(2.1)])
"""One harmonic."""


def potential(x: float, z: float, t: float) -> float:
    """Airy's velocity potential of WAVE, x along it and z down, in deep water."""
    omega, k, cosine, sine = WAVE[:4]
    phase = k * x - omega * t
    return math.exp(-k * z) / k * (cosine * math.sin(phase) + sine * math.cos(phase))


def met(sea: Array, z: float, t: float) -> tuple[Array, Array, Array]:
    """Velocity of the water, its rate and its growth with depth."""
    s = np.zeros(MOTION)
    s[POSITION + 2], s[TIME] = z, t
    velocity = np.array(orbits(sea.ravel(), s))
    return velocity, s[25:28].copy(), s[28:31].copy()


@given(st.floats(0.1, 20.0), st.floats(0.0, 60.0))
def test_water_moves_as_the_gradient_of_airys_potential(z: float, t: float) -> None:
    e = 1e-5
    along = (potential(e, z, t) - potential(-e, z, t)) / (2 * e)
    down = (potential(0.0, z + e, t) - potential(0.0, z - e, t)) / (2 * e)
    velocity, rate, growth = met(WAVE, z, t)
    np.testing.assert_allclose(velocity, [along * WAVE[4], along * WAVE[5], down], atol=1e-8)
    later, deeper = met(WAVE, z, t + e)[0], met(WAVE, z + e, t)[0]
    np.testing.assert_allclose(rate, (later - velocity) / e, atol=1e-5)
    np.testing.assert_allclose(growth, (deeper - velocity) / e, atol=1e-5)


@given(st.floats(0.05, 5.0), st.floats(2.0, 20.0), st.floats(0.0, 20.0))
@settings(max_examples=20)
def test_the_spectrum_has_the_energy_of_the_significant_height(
    height: float, period: float, peak: float
) -> None:
    top = 2.0 * math.pi / period
    at = [top * x for x in (0.9, 1.0, 1.1)]
    energy, _ = quad(
        lambda w: float(elevation_spectrum(w, height, period, peak)), BAND[0] * top, BAND[1] * top, points=at
    )
    assert 4.0 * math.sqrt(energy) == pytest.approx(height, rel=1e-4)
    fine = np.linspace(*BAND, 2001) * top
    assert fine[elevation_spectrum(fine, height, period, peak).argmax()] == pytest.approx(top, rel=0.005)


def test_without_a_peak_it_is_that_of_pierson_and_moskowitz() -> None:
    omega, top = np.linspace(0.8, 3.0, 50), 2.0 * math.pi / 6.0
    expected = 5.0 / 16.0 * 0.8**2 * top**4 * omega**-5.0 * np.exp(-1.25 * (top / omega) ** 4)
    np.testing.assert_allclose(elevation_spectrum(omega, 0.8, 6.0, 0.0), expected, rtol=0.01)


@pytest.mark.parametrize("z", [0.0, 4.0])
def test_seas_have_the_mean_square_velocity_of_their_spectrum(z: float) -> None:
    """Over many seas, along and down alike: the integral of omega^2 S exp(-2 k z)."""
    squares = []
    for seed in range(300):
        rows = drawn(partial(harmonics, P, G), np.random.default_rng(seed))
        velocity, _, _ = met(rows, z, 17.0)
        squares.append([velocity[0] ** 2 + velocity[1] ** 2, velocity[2] ** 2])
    top = 2.0 * math.pi / P[1]

    def power(w: float) -> float:
        return w**2 * float(elevation_spectrum(w, P[0], P[1], P[3])) * math.exp(-2.0 * w**2 / G * z)

    expected, _ = quad(power, BAND[0] * top, BAND[1] * top, points=[top], limit=200)
    error = np.std(squares, axis=0) / math.sqrt(len(squares))
    assert (np.abs(np.mean(squares, axis=0) - expected) < 4.0 * error).all()


def test_a_neutral_body_of_any_shape_that_moves_with_the_water_stays_with_it() -> None:
    added = (np.diag([20.0, 60, 70, 2, 8, 9]) + 0.8 * np.ones((6, 6))).tolist()
    hull = neutral(50.0, (3.0, 3.0, 3.0))
    program = assemble(equipped(SEA, {"name": "added_mass", "matrix": added}, *DAMPED, bare=hull), sea=(3,))
    sea = program.flat[int(program.flat[5]) :]
    t = np.arange(1500) * 0.02
    begun = [*met(sea, 3.0, 0.0)[0], 0.0, 0.0, 0.0]
    motion = trajectory(program, np.zeros((t.size, 1)), t, eta=[0, 0, 3, 0, 0, 0], nu=begun)
    water = np.array([met(sea, z, now)[0] for z, now in zip(motion[:, 2], t, strict=True)])
    assert np.abs(water).max() > 0.2
    np.testing.assert_allclose(motion[:, 6:9], water, atol=1e-8)
    np.testing.assert_allclose(motion[:, 9:], 0.0, atol=1e-8)


def test_a_heavy_sphere_in_waves_moves_as_newton_says_in_the_world() -> None:
    """(m + m_A) a = W + d (v_w - v) + m_A dv_w/dt along its path + rho V times that along the water's."""
    mass, added, drag, heavy = 50.0, 27.0, 18.0, 15.0
    vehicle = equipped(
        {"name": "added_mass", "diagonal": [added] * 3 + [0.0] * 3},
        {"name": "linear_damping", "diagonal": [drag] * 3 + [0.0] * 3},
        {"name": "net_buoyancy", "dB": -heavy},
        SEA,
        bare=neutral(mass, (3.0, 3.0, 3.0)),
    )
    eta, nu = np.array([0.0, 0, 4.0, 0.4, -0.3, 1.1]), np.array([0.5, -0.2, 0.1, 0.3, 0.2, -0.4])
    t = np.linspace(0, 10, 501)

    def rate(now: float, y: Array) -> Array:
        water, local, growth = met(WAVE, y[2], now)
        force = np.array([0.0, 0.0, heavy]) + drag * (water - y[3:])
        force += added * (local + y[5] * growth) + mass * (local + water[2] * growth)
        return np.concatenate([y[3:], force / (mass + added)])

    first = np.concatenate([eta[:3], R(eta) @ nu[:3]])
    expected = solve_ivp(rate, (0.0, 10.0), first, t_eval=t, rtol=1e-10, atol=1e-12).y.T
    program = in_sea(assemble(vehicle), WAVE[None])
    found = trajectory(program, np.zeros((t.size, 1)), t, eta=eta, nu=nu)
    world = Rotation.from_euler("ZYX", found[:, [5, 4, 3]]).apply(found[:, 6:9])
    np.testing.assert_allclose(np.hstack([found[:, :3], world]), expected, atol=1e-7)


def test_in_every_prediction_the_sea_is_calm() -> None:
    still, waves = equipped(*DAMPED), equipped(*DAMPED, SEA)
    t = np.arange(200) * 0.02
    commands = np.tile([0.5, -0.2], (t.size, 1))
    a, b = (trajectory(assemble(one), commands, t, eta=[0, 0, 3, 0, 0, 0]) for one in (still, waves))
    np.testing.assert_array_equal(a, b)
    a, b = (effect_forces(one, a[:, :6], a[:, 6:], [[0, 200]], t) for one in (still, waves))
    np.testing.assert_array_equal(a, b)


def test_every_session_has_a_sea_of_its_own_and_a_seed_brings_it_back() -> None:
    rows = 100
    columns = {f"cmd_{i + 1}": np.zeros(2 * rows) for i in range(2)}
    table = pl.DataFrame(
        {"session": ["a"] * rows + ["b"] * rows, "t": np.tile(np.arange(rows) * 0.05, 2)} | columns
    )
    vehicle = equipped(*DAMPED, SEA)
    one, again, other = (simulate(vehicle, table, sea=seed) for seed in (1, 1, 2))
    assert one.equals(again)
    assert not one.equals(other)
    first, second = one["u"].to_numpy()[:rows], one["u"].to_numpy()[rows:]
    assert np.abs(first - second).max() > 0.01
    assert simulate(vehicle, table).equals(simulate(equipped(*DAMPED), table))


def test_no_fit_and_no_search_of_predictions_takes_waves() -> None:
    assert "ocean_waves" not in {one.effect for one in suspects(equipped(*DAMPED, SEA))}
    with pytest.raises(DataError, match="acts by chance"):
        fit(equipped(*DAMPED), recorded(), ["ocean_waves"])


def recorded() -> pl.DataFrame:
    """A short recording of the bare vehicle."""
    rng, rows = np.random.default_rng(0), 400
    table = pl.DataFrame(
        {"session": ["a"] * rows, "t": np.arange(rows) * 0.05}
        | {f"cmd_{i + 1}": np.repeat(rng.uniform(-0.5, 0.5, rows // 40), 40) for i in range(2)}
    )
    return simulate(equipped(*DAMPED), table)
