"""What a recording does not show stays as the file has it; what it shows is what it shows."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
import synthetic
from hypothesis import given as drawn
from hypothesis import strategies as st

from hydro.core.identification.prior import deviations, greatest_change, in_file, shrunk_to_prior
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.parameters import free

FILE = msgspec.structs.replace(
    synthetic.vehicle(),
    effect=(
        *synthetic.vehicle().effect,
        {"name": "quadratic_damping", "diagonal": [100.0, 200.0, 300.0, 10.0, 20.0, 30.0]},
    ),
)
UNKNOWN = free(FILE, ["quadratic_damping", "net_buoyancy"])
VALUES = np.array([120.0, 150.0, 0.0, 12.0, 15.0, 33.0, 4.0])


def estimated(errors) -> Normal:
    """A problem whose estimates have these standard errors in the entries' units, uncorrelated."""
    matrix = np.diag((UNKNOWN.scales / np.asarray(errors)) ** 2)
    gram = np.zeros((1, 8, 8))
    gram[0, :7, :7] = matrix
    return Normal(gram, 100, np.ones((1, 12)), np.zeros((1, 0, 8)))


def test_what_is_plain_stays_as_it_is_fitted():
    found = shrunk_to_prior(UNKNOWN, VALUES, estimated(np.maximum(np.abs(VALUES), 1.0) * 1e-3), FILE)
    np.testing.assert_allclose(found, VALUES, rtol=1e-5, atol=1e-3)


def test_what_is_not_shown_is_as_in_the_file():
    errors = np.full(7, 1e-3)
    errors[2] = 3000.0  # quadratic damping of heave, fitted to 0
    found = shrunk_to_prior(UNKNOWN, VALUES, estimated(errors), FILE)
    assert found[2] == pytest.approx(300.0, rel=0.05)
    np.testing.assert_allclose(np.delete(found, 2), np.delete(VALUES, 2), rtol=1e-5)


@drawn(st.floats(1e-3, 1e3), st.floats(0.0, 1e3))
def test_a_value_lies_between_the_file_and_the_fit(error, fitted):
    values = VALUES.copy()
    values[0] = fitted
    found = shrunk_to_prior(UNKNOWN, values, estimated(np.full(7, error)), FILE)[0]
    low, high = sorted((100.0, fitted))
    assert low - 1e-6 <= found <= high + 1e-6


def test_a_file_ten_times_wrong_is_mended():
    values = VALUES.copy()
    values[0] = 1000.0
    ten_errors_from_nothing = estimated(np.full(7, 100.0))
    found = shrunk_to_prior(UNKNOWN, values, ten_errors_from_nothing, FILE)
    assert found[0] == pytest.approx(1000.0, rel=0.02)


def test_new_effects_have_nothing_in_the_file():
    found = shrunk_to_prior(UNKNOWN, VALUES, estimated(np.full(7, 2.0)), FILE)
    assert found[6] == VALUES[6]
    np.testing.assert_array_equal(in_file(FILE, UNKNOWN.entries), [100, 200, 300, 10, 20, 30, 0])


def test_a_value_is_known_to_a_fifth_of_itself_or_of_its_scale_or_as_its_file_says():
    entries = UNKNOWN.entries[:6]
    given = np.array([100.0, 200.0, 300.0, 10.0, 20.0, 30.0])
    fifth = 0.2 * np.maximum(given, UNKNOWN.scales[:6])
    np.testing.assert_allclose(deviations(FILE, entries), fifth)
    stated = {"diagonal": [1.0, 0.0, 3.0, 4.0, 5.0, 6.0]}
    *others, damping = FILE.effect
    sure = msgspec.structs.replace(FILE, effect=(*others, damping | {"standard_error": stated}))
    np.testing.assert_allclose(deviations(sure, entries), [1.0, fifth[1], 3.0, 4.0, 5.0, 6.0])
    change = greatest_change(sure, entries, np.add(given, [0.0, 0.0, 27.0, 0.0, -40.0, 0.0]))
    assert (change.entry.name, change.deviations) == ("quadratic_damping.diagonal[2]", pytest.approx(9.0))
