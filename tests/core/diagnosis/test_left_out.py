"""Left-out sessions against least squares that was never shown them."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.diagnosis.left_out import Fitted, folds, left_out_costs, scores
from hydro.core.errors import DataError
from hydro.core.identification.normal_equations import Normal

SHOTS, ROWS = 60, 40
SESSION = np.repeat([0, 1, 2, 3], 15)


def drawn(seed: int = 0, columns: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Columns (S, ROWS, P) and white noise (S, ROWS)."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal((SHOTS, ROWS, columns)), rng.standard_normal((SHOTS, ROWS))


def fitted(columns: np.ndarray, error: np.ndarray) -> Fitted:
    """A linear model at its least-squares fit, which began from nothing."""
    P = columns.shape[-1]
    amounts = np.linalg.lstsq(columns.reshape(-1, P), error.ravel())[0] if P else np.zeros(0)
    both = np.concatenate([columns, (error - columns @ amounts)[..., None]], axis=-1)
    gram = both.transpose(0, 2, 1) @ both
    return Fitted(Normal(gram, ROWS, gram[:, -1:, -1], np.zeros((SHOTS, 0, P + 1))), amounts)


def test_costs_are_those_of_fits_without_the_session():
    columns, noise = drawn()
    error = columns @ [0.5, -0.3, 0.0] + noise
    found = left_out_costs(fitted(columns, error), SESSION)
    for number in range(4):
        out = number == SESSION
        known = np.linalg.lstsq(columns[~out].reshape(-1, 3), error[~out].ravel())[0]
        expected = ((error[out] - columns[out] @ known) ** 2).sum(axis=1)
        np.testing.assert_allclose(found[out], expected, rtol=1e-4)


def test_an_effect_that_is_there_explains_every_session():
    columns, noise = drawn()
    error = columns @ [1.5, 0.0, 0.0] + noise
    nothing = fitted(np.zeros((SHOTS, ROWS, 0)), error)
    found = scores(
        nothing, {"not": fitted(columns[..., 2:], error), "there": fitted(columns[..., :1], error)}, SESSION
    )
    assert list(found) == ["there", "not"]
    there = found["there"]
    assert 0.9 < there.low <= there.share <= there.high <= 1.0
    assert there.by_fold.shape == (4,)
    assert (there.by_fold > 0.8).all()
    assert found["not"].share < 0.05


def test_many_parameters_gain_nothing_where_they_were_not_fitted():
    columns, noise = drawn(columns=80)
    error = 1.1 * noise
    many = fitted(columns, error)
    nothing = fitted(columns[..., :0], error)
    assert many.normal.cost < nothing.normal.cost
    assert scores(nothing, {"many": many}, SESSION)["many"].share == 0.0


def test_what_one_session_alone_tells_explains_no_session_left_out():
    columns, noise = drawn(columns=1)
    columns[SESSION != 2] = 0.0
    error = columns @ [2.0] + noise
    found = scores(fitted(columns[..., :0], error), {"once": fitted(columns, error)}, SESSION)["once"]
    assert found.share < 0.01
    assert found.by_fold[2] == pytest.approx(0.0, abs=0.01)


def test_stretches_where_sessions_are_few():
    np.testing.assert_array_equal(folds([4, 4, 7, 7, 9]), [0, 0, 1, 1, 2])
    stretches = folds(np.repeat([0, 1], 30))
    np.testing.assert_array_equal(np.bincount(stretches), [10] * 6)
    assert (np.diff(stretches) >= 0).all()
    np.testing.assert_array_equal(folds([0, 0]), [0, 1])
    with pytest.raises(DataError, match="record a longer session"):
        folds([0])


def test_shots_that_left_all_bounds_count_for_nobody():
    columns, noise = drawn()
    model = fitted(columns, columns @ [0.5, 0.0, 0.0] + noise)
    model.normal.gram[7] = 0.0
    model.normal.gram[7, -1, -1] = np.inf
    costs = left_out_costs(model, SESSION)
    assert np.isinf(costs[7])
    assert np.isfinite(np.delete(costs, 7)).all()
    nothing = fitted(columns[..., :0], columns @ [0.5, 0.0, 0.0] + noise)
    assert scores(nothing, {"there": model}, SESSION)["there"].share > 0.9
