"""Feedback is told from plans, whose false alarms are counted, on motions made by a recursion."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.recording.arrays import Recording
from hydro.core.recording.feedback import MATERIAL, _robust, feedback
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Thruster, Vehicle

DT, ROWS = 0.05, 2400
NOISE = np.array([0.02, 0.01])  # m and m/s


def block() -> Vehicle:
    """Two thrusters, one ahead and one to starboard."""
    return Vehicle(
        name="block",
        rigid_body=RigidBody(50.0, (0.0, 0.0, 0.0), ((5.0, 0, 0), (0, 5.0, 0), (0, 0, 5.0))),
        buoyancy=Buoyancy(50.0 * 9.81, (0.0, 0.0, 0.0)),
        hull=Hull(1.0, 0.3, 0.3),
        thruster=(
            Thruster("A", 20.0, 20.0, wrench=(1.0, 0, 0, 0, 0, 0)),
            Thruster("S", 20.0, 20.0, wrench=(0, 1.0, 0, 0, 0, 0)),
        ),
    )


def logged(plan: np.ndarray, gains: np.ndarray, rng: np.random.Generator, push: float = 0.0) -> Recording:
    """A damped mass on two axes under a plan (N, 2) and gains (2, 2) on the noisy position and velocity."""
    x, v = np.zeros(2), np.zeros(2)
    eta, nu, commands = np.zeros((ROWS, 6)), np.zeros((ROWS, 6)), np.zeros((ROWS, 2))
    for k in range(ROWS):
        seen = np.stack([x, v]) + NOISE[:, None] * rng.standard_normal((2, 2))
        eta[k, :2], nu[k, :2] = seen
        commands[k] = np.clip(plan[k] - gains[0] * seen[0] - gains[1] * seen[1], -1.0, 1.0)
        v = v + DT * (20.0 * commands[k] + push - 30.0 * v) / 50.0
        x = x + DT * v
    return Recording(
        t=np.arange(ROWS) * DT,
        eta=eta,
        nu=nu,
        commands=commands,
        segments=np.array([[0, ROWS]]),
        after_gap=np.zeros(1, bool),
        session=np.zeros(1, np.int64),
        dt=DT,
    )


def steps(rng: np.random.Generator) -> np.ndarray:
    return np.repeat(rng.uniform(-0.8, 0.8, (ROWS // 60, 2)), 60, axis=0)


def sines(rng: np.random.Generator) -> np.ndarray:
    t, rates = np.arange(ROWS)[:, None] * DT, rng.uniform(0.05, 2.0, (4, 1, 2))
    return 0.2 * np.sin(rates * t + rng.uniform(0.0, 6.0, (4, 1, 2))).sum(axis=0)


def walk(rng: np.random.Generator) -> np.ndarray:
    out = np.zeros((ROWS, 2))
    for k in range(1, ROWS):
        out[k] = 0.97 * out[k - 1] + 0.1 * rng.standard_normal(2)
    return out


@pytest.mark.parametrize("plan", [steps, sines, walk])
def test_plans_are_hardly_ever_called_feedback(plan):
    called = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        called += feedback(block(), logged(plan(rng), np.zeros((2, 2)), rng)).closed
    assert called == 0


def test_a_station_keeper_is_told_by_the_axes_that_it_holds():
    rng, gains = np.random.default_rng(1), np.array([[0.6, 0.0], [1.0, 0.0]])
    found = feedback(block(), logged(walk(rng) * [0.05, 1.0], gains, rng, push=3.0))
    assert found.closed
    assert found.axes == (0,)
    assert found.by_axis[0] > 0.5
    assert found.by_axis[1] < 0.1
    assert found.words() == f"surge to x and u ({found.by_axis[0]:.0%})"


def test_a_light_hold_beside_an_excitation_is_no_chance_and_yet_not_material(monkeypatch):
    rng = np.random.default_rng(2)
    record = logged(steps(rng), np.array([[0.02, 0.02], [0.05, 0.05]]), rng)
    found = feedback(block(), record)
    assert found.by_axis.max() < MATERIAL
    assert not found.closed
    monkeypatch.setattr("hydro.core.recording.feedback.MATERIAL", 0.0)  # chance is not asked about otherwise
    assert feedback(block(), record).p_values.min() < 1e-6


@pytest.mark.parametrize(("size", "outlier"), [(1.5, False), (3.0, True)])
def test_errors_beyond_two_robust_deviations_pull_less_at_a_law(size, outlier):
    """A tenth of all rows lie so many deviations to one side; all others err evenly by less than two."""
    rng = np.random.default_rng(4)
    X = np.column_stack([np.ones(2000), rng.standard_normal(2000)])
    error = np.linspace(-1.4826, 1.4826, 2000)  # of which the median size is 0.7413
    jumps = rng.random(2000) < 0.1
    y = X @ [0.5, 2.0] + np.where(jumps, 0.7413 * 1.4826 * size, rng.permutation(error))
    law, _ = _robust(X, y)
    squares = np.linalg.lstsq(X, y, rcond=None)[0]
    if outlier:
        assert abs(law[0] - 0.5) < 0.9 * abs(squares[0] - 0.5)
    else:
        np.testing.assert_allclose(law, squares, atol=1e-8)


def test_a_short_recording_tells_nothing():
    rng = np.random.default_rng(3)
    whole = logged(walk(rng), np.ones((2, 2)), rng)
    short = Recording(
        whole.t[:200],
        whole.eta[:200],
        whole.nu[:200],
        whole.commands[:200],
        np.array([[0, 200]]),
        whole.after_gap,
        whole.session,
        DT,
    )
    assert not feedback(block(), short).closed
