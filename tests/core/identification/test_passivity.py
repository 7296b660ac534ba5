"""The nearest values that a passive hull can have, against Higham's closed form and as the best there are."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hydro.core.effects import validate
from hydro.core.effects.catalogue import added_mass_matrix
from hydro.core.effects.sums import damping_in_sum
from hydro.core.identification.passivity import possible
from hydro.core.prediction.parameters import free
from hydro.io import vehicle as files

seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module")
def craft(datasets):
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


@settings(max_examples=20)
@given(seed=seeds)
def test_the_nearest_damping_in_plain_distance_keeps_the_positive_eigenvalues(craft, seed):
    """Higham (1988): of the symmetric part the negative eigenvalues become 0, the rest stays."""
    unknown = free(craft, ["linear_damping.matrix"])
    values = np.random.default_rng(seed).normal(scale=20.0, size=36)
    given_ = values.reshape(6, 6)
    level, direction = np.linalg.eigh(0.5 * (given_ + given_.T))
    nearest = 0.5 * (given_ - given_.T) + (direction * np.maximum(level, 0.0)) @ direction.T
    found = possible(unknown, values, np.diag(unknown.scales**2)).reshape(6, 6)
    np.testing.assert_allclose(found, nearest, atol=1e-3 * abs(values).max())


@settings(max_examples=20)
@given(seed=seeds)
def test_in_any_metric_no_possible_values_are_better(craft, seed):
    """The way out is no shorter toward any other point of a convex set than straight to the nearest."""
    rng = np.random.default_rng(seed)
    wanted = ["added_mass_coupling", "coupled_damping", "linear_damping", "thruster_gain"]
    unknown = free(craft, wanted)
    count = len(unknown.entries)
    values = unknown.within(3.0 * unknown.scales * rng.normal(size=count))
    root = rng.normal(size=(count + 5, count)) * 10.0 ** rng.uniform(-1, 1, count)
    information = root.T @ root
    found = possible(unknown, values, information)
    validate(unknown.at(found))
    assert np.array_equal(unknown.within(found), found)
    away = information @ ((values - found) / unknown.scales)
    for _ in range(50):
        other = unknown.within(unknown.starts[0] + 0.3 * unknown.scales * rng.normal(size=count))
        if semidefinite(unknown.at(other)):
            step = (other - found) / unknown.scales
            assert away @ step <= 1e-3 * np.sqrt(away @ away * (step @ step))


def semidefinite(vehicle):
    sums = added_mass_matrix(vehicle), damping_in_sum(vehicle)[0]
    return all(np.linalg.eigvalsh(0.5 * (one + one.T))[0] >= 0.0 for one in sums)


def test_possible_values_stay_as_they_are(craft):
    unknown = free(craft, ["linear_damping.matrix", "added_mass"])
    assert possible(unknown, unknown.starts[0], np.eye(42)) is unknown.starts[0]


def test_values_that_bear_on_no_sum_stay_where_the_rest_of_the_vehicle_is_not_possible(craft):
    wrong = {"name": "added_mass_coupling", "M15": 1e4, "M24": 0.0, "M04": 0.0, "M13": 0.0, "M02": 0.0}
    unknown = free(msgspec.structs.replace(craft, effect=(*craft.effect, wrong)), ["thruster_gain"])
    values = np.full(len(unknown.entries), -0.3)
    assert np.array_equal(possible(unknown, values, np.eye(len(values))), values)


def test_where_no_coupling_can_be_it_is_drawn_back_to_none(craft):
    """Beside damping that is 0 and stays so a coupling is never passive."""
    still = msgspec.structs.replace(craft, effect=())
    unknown = free(still, ["coupled_damping", "net_buoyancy"])
    found = possible(unknown, np.array([3.0, 0, 0, 0, 0, 0, 7.0]), np.eye(7))
    np.testing.assert_allclose(found, [0, 0, 0, 0, 0, 0, 7.0], atol=1e-5)


def test_a_fit_that_begins_where_no_passive_hull_is_ends_where_one_is(craft):
    """As from the values of a diagnosis: without damping no coupling is left, and the rest stays."""
    bare = craft.without("linear_damping")
    begun = {"name": "coupled_damping", "D15": 9.6, "D51": 3.9, "D13": 8.8, "D31": 6.0}
    unknown = free(bare, [begun, "quadratic_damping"])
    values = 1.1 * unknown.starts[0]
    found = possible(unknown, values, np.eye(len(values)))
    validate(unknown.at(found))
    other = np.array([entry.effect == "quadratic_damping" for entry in unknown.entries])
    np.testing.assert_allclose(found[~other], 0.0, atol=1e-4)
    np.testing.assert_allclose(found[other], values[other], rtol=1e-6)
