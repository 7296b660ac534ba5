"""Hull-force coefficients that are free in the fit of a change, against closed forms of numpy."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import damped

from hydro.core.residual.free_law import FreeLaw
from hydro.core.residual.library import RESTING, UNEVEN, precision, sizes

SHOTS, ROWS, COEFFICIENTS = 12, 20, 5


@pytest.fixture(scope="module")
def columns():
    return np.random.default_rng(1).normal(size=(SHOTS, ROWS * 12, COEFFICIENTS))


def freedom(columns, known):
    """Return the freedom of coefficients without initial states, with the information `known` on them."""
    flat = columns.reshape(-1, COEFFICIENTS)
    begun = np.zeros((SHOTS, ROWS * 12, 12))
    return FreeLaw(1, begun, columns.astype(np.float32), known, known + flat.T @ flat)


def test_the_sum_over_shots_is_the_schur_complement(columns):
    rng = np.random.default_rng(2)
    flat, root = rng.normal(size=(SHOTS, ROWS * 12, 3)), rng.normal(size=(COEFFICIENTS, COEFFICIENTS))
    known = 50.0 * root @ root.T
    x, y = columns.reshape(-1, COEFFICIENTS), flat.reshape(-1, 3)
    schur = y.T @ y - y.T @ x @ np.linalg.solve(x.T @ x + known, x.T @ y)
    assert freedom(columns, known).eliminated(flat).sum(axis=0) == pytest.approx(schur, rel=1e-5)


def test_coefficients_that_the_earlier_recording_determines_are_held(columns):
    flat = np.random.default_rng(3).normal(size=(SHOTS, ROWS * 12, 2))
    held = freedom(columns, 1e12 * np.eye(COEFFICIENTS)).eliminated(flat)
    assert held == pytest.approx(np.einsum("ski,skj->sij", flat, flat), rel=1e-5)


def test_a_change_does_not_absorb_the_error_of_a_coefficient_that_only_it_excites(columns):
    """The earlier recording shows nothing of the first coefficient, which is off by 1."""
    rng = np.random.default_rng(4)
    change = 0.7 * columns[..., 0] + rng.normal(size=columns.shape[:2])
    error = 0.3 * change + columns[..., 0]
    known = np.diag([1e-3, *[1e9] * (COEFFICIENTS - 1)])
    flat = np.stack([change, error], axis=-1)
    gram = freedom(columns, known).eliminated(flat).sum(axis=0)
    assert gram[0, 1] / gram[0, 0] == pytest.approx(0.3, abs=1e-3)
    assert (change * error).sum() / (change**2).sum() > 0.7  # with the coefficient held


def costs(first, second):
    """Return the prior's cost of two coefficients of the library, both 1, and of 1 and -1."""
    prior = precision(sizes(damped()).size)
    equal, apart = np.zeros((2, len(prior)))
    equal[[first, second]], apart[[first, second]] = 1.0, [1.0, -1.0]
    return equal @ prior @ equal, apart @ prior @ apart


def test_the_prior_keeps_coefficients_of_accelerations_symmetric():
    """A sway force of roll acceleration costs as much alone as apart from the roll moment of sway's."""
    sway, roll = (6 + 3) * 6 + 1, (6 + 1) * 6 + 3  # coefficients of p_dot in Y and of v_dot in K
    assert costs(sway, roll) == (pytest.approx(2.0), pytest.approx(2.0 + 4.0 * UNEVEN**-2))
    size = sizes(damped()).size
    assert (precision(size)[:36] == np.eye(size)[:36]).all()


def test_weight_and_buoyancy_exert_one_force_and_the_moment_of_one_lever():
    """No other wrench depends on the direction of gravity, such as a heave force of pitch."""
    size, each = sizes(damped()), np.eye(3)
    prior = precision(size.size)[-RESTING * 6 : -6, -RESTING * 6 : -6] - np.eye(18)
    restoring = np.hstack([2.0 * each, [np.cross([0.3, -0.2, 0.5], one) for one in each]])
    possible = size[-RESTING:-1] > 0.0
    assert (possible == (restoring != 0.0)).all()
    amounts = np.where(possible, restoring / np.where(possible, size[-RESTING:-1], 1.0), 0.0)
    assert amounts.ravel() @ prior @ amounts.ravel() == pytest.approx(0.0, abs=1e-9)
    for other in np.argwhere(possible):
        away = amounts.copy()
        away[tuple(other)] += 1.0
        assert away.ravel() @ prior @ away.ravel() >= 0.99 * UNEVEN**-2
