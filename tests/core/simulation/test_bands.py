"""Prediction bands against the closed form of surge with linear damping; how often they hold the truth."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest
from scipy.stats import norm

from hydro.core.errors import DataError
from hydro.core.simulation.bands import MOTION, bands, spread
from hydro.core.simulation.estimates import Estimate, Estimates
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Thruster, Vehicle
from hydro.io import schema

MASS, FORCE, DAMPING, ERROR = 50.0, 20.0, 15.0, 2.0
T = np.arange(0.0, 8.0, 0.1)


def surging(damping: float = DAMPING, thrust: float = 2.0 * FORCE) -> Vehicle:
    """A neutrally buoyant vehicle with linear damping in surge alone."""
    return Vehicle(
        "surging",
        RigidBody(MASS, (0.0, 0.0, 0.0), ((1.5, 0.0, 0.0), (0.0, 5.0, 0.0), (0.0, 0.0, 5.5))),
        Buoyancy(MASS * 9.81, (0.0, 0.0, 0.0)),
        Hull(1.6, 0.4, 0.3),
        thruster=(Thruster("ahead", thrust, thrust, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),),
        effect=({"name": "linear_damping", "diagonal": [damping, 0.0, 0.0, 0.0, 0.0, 0.0]},),
    )


def speed(damping, force=FORCE):
    """u(t) of M u' = F - d u from rest."""
    damping = np.asarray(damping, float)[..., None]
    return force / damping * (1.0 - np.exp(-damping * T / MASS))


def damping(value: float = DAMPING, error: float = ERROR) -> Estimates:
    entry = Estimate("linear_damping", "diagonal", (0,), "N s/m", value)
    return Estimates((entry,), np.array([[error**2]]))


COMMANDS = pl.DataFrame({"session": ["a"] * len(T), "t": T, "cmd_1": [0.5] * len(T)})


def test_the_band_of_one_parameter_is_between_its_quantiles():
    """u falls as d grows, so that the band of u is that of d: u(t; d +- 1.96 s)."""
    table = bands(surging(), damping(), COMMANDS, draws=200, seed=3)
    schema.load("bands").check(schema.load("bands").conform(table), "bands")
    np.testing.assert_allclose(table["u"], speed(DAMPING), rtol=1e-6)
    slow, fast = (speed(DAMPING + sign * norm.ppf(0.975) * ERROR) for sign in (1.0, -1.0))
    width = fast - slow
    assert (np.abs(table["u_low"].to_numpy() - slow) <= 0.15 * width).all()
    assert (np.abs(table["u_high"].to_numpy() - fast) <= 0.15 * width).all()
    assert (table["v_high"] - table["v_low"]).abs().max() < 1e-12


def test_small_errors_propagate_by_the_derivative():
    """x(t) to first order: s dx/dd, from the closed form by differences."""
    error = 1e-3
    table = bands(surging(), damping(error=error), COMMANDS, draws=200, seed=1)
    slope = (speed(DAMPING + 1e-4) - speed(DAMPING - 1e-4)) / 2e-4
    half = 0.5 * (table["u_high"] - table["u_low"]).to_numpy()
    np.testing.assert_allclose(half[1:], norm.ppf(0.975) * error * np.abs(slope[1:]), rtol=0.15)


def test_the_same_seed_gives_the_same_band():
    one, same, other = (bands(surging(), damping(), COMMANDS[:20], draws=40, seed=k) for k in (0, 0, 1))
    assert one.equals(same)
    assert not one.equals(other)


def test_bands_hold_the_truth_as_often_as_they_say():
    """Damping and gain estimated with correlated errors, many times: 95 % at every moment of u."""
    rng, truth = np.random.default_rng(0), np.array([DAMPING, 0.1])
    covariance = np.array([[4.0, 0.16], [0.16, 0.01]])
    root, held = np.linalg.cholesky(covariance), []

    def predicted(vehicle: Vehicle):
        drag, gain = vehicle.effect[0]["diagonal"][0], vehicle.effect[1]["g"][0]
        motion = np.zeros((len(T), 12))
        motion[:, 6] = speed(drag, FORCE * (1.0 + gain))
        return motion

    for repeat in range(60):
        drag, gain = truth + root @ rng.standard_normal(2)
        entries = (
            Estimate("linear_damping", "diagonal", (0,), "N s/m", drag),
            Estimate("thruster_gain", "g", (0,), "1", gain),
        )
        found = surging(drag)
        found = msgspec.structs.replace(
            found, effect=(*found.effect, {"name": "thruster_gain", "g": [float(gain)]})
        )
        low, high = spread(found, Estimates(entries, covariance), predicted, draws=60, seed=repeat)
        true = speed(truth[0], FORCE * (1.0 + truth[1]))[1:]
        held.append((low[1:, 6] <= true) & (true <= high[1:, 6]))
    assert 0.87 <= np.mean(held) <= 0.99


def test_draws_stay_plausible():
    """Damping that is hardly known: no draw drives the vehicle, nor drags it as no hull does."""
    drawn = list(damping(error=1e4).drawn(surging(), 200, 0))
    values = np.array([one.effect[0]["diagonal"][0] for one in drawn])
    assert values.min() == 0.0
    assert values.max() == pytest.approx(0.5 * 2.5 * 1025.0 * 0.4 * 0.3)


def test_too_many_diverging_draws_are_refused():
    def predicted(vehicle: Vehicle):
        if vehicle.effect[0]["diagonal"][0] != DAMPING:
            raise DataError("diverges")
        return np.zeros((3, 12))

    with pytest.raises(DataError, match="the motion of 40 of 40 vehicles"):
        spread(surging(), damping(), predicted, draws=40)


def test_a_heading_beyond_half_a_turn_has_a_narrow_band():
    """Draws at 3.1 and -3.1 rad lie 0.08 rad apart, not six."""
    headings = iter([3.1, *np.tile([3.1, -3.1], 20)])

    def predicted(vehicle: Vehicle):
        motion = np.zeros((1, 12))
        motion[0, 5] = next(headings)
        return motion

    low, high = spread(surging(), damping(), predicted, draws=40)
    assert MOTION[5] == "psi"
    assert high[0, 5] - low[0, 5] == pytest.approx(2.0 * np.pi - 6.2, abs=1e-3)
