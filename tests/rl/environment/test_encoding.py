"""Encoding of observations for networks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.errors import DataError
from hydro.rl.environment.encoding import Encoding
from hydro.rl.environment.observation import ENCODING, NAMES

RANGES = [i for i, name in enumerate(NAMES) if name.startswith("sonar_")]


@given(st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_the_nearer_something_is_the_more_a_network_is_given_of_it(one, other):
    near, far = sorted((one, other))
    rows = np.zeros((2, 36), dtype=np.float32)
    rows[0, RANGES], rows[1, RANGES] = near, far
    given_near, given_far = ENCODING(rows)[:, RANGES]
    assert (given_near >= given_far).all()
    assert (given_near <= 1.0).all()
    assert (given_far >= 0.0).all()
    np.testing.assert_allclose(given_near, np.exp(-np.float32(near) / 2.0), rtol=1e-6)


def test_all_else_is_divided_by_its_size_and_the_observations_are_left_alone():
    observations = np.random.default_rng(0).standard_normal((4, 36)).astype(np.float32)
    before = observations.copy()
    rest = [i for i in range(36) if i not in RANGES]
    np.testing.assert_array_equal(
        ENCODING(observations)[:, rest], observations[:, rest] / ENCODING.scale[rest]
    )
    np.testing.assert_array_equal(observations, before)
    assert ENCODING(observations).dtype == np.float32


def test_every_observation_needs_an_entry_of_each_kind():
    with pytest.raises(DataError, match="one of each for every observation"):
        Encoding(np.ones(3, np.float32), np.zeros(2, np.bool_))
