"""Lossless compression of a checkpoint's transitions to half of their size."""

import numpy as np
import pytest
import torch

from hydro.rl.training.memory import pack, unpack


def transitions(rows=400, vehicles=4, horizon=3, seed=0):
    """Return steps of several vehicles; next observations recur three steps later, except at the end."""
    rng = np.random.default_rng(seed)
    walks = rng.standard_normal((rows // vehicles + horizon, vehicles, 6)).astype(np.float32).cumsum(axis=0)
    seen, after = walks[:-horizon].reshape(-1, 6), walks[horizon:].reshape(-1, 6)
    given = {
        "observation": seen,
        "action": rng.uniform(-1, 1, (rows, 2)).astype(np.float32),
        "next.observation": after,
        "next.reward": rng.standard_normal((rows, 1)).astype(np.float32),
        "next.terminated": rng.random((rows, 1)) < 0.1,
        "steps_to_next_obs": rng.integers(1, 10, (rows, 1)),
    }
    return {name: torch.from_numpy(np.ascontiguousarray(each)) for name, each in given.items()}


def same(one, two):
    assert list(one) == list(two)
    for name, tensor in one.items():
        assert tensor.dtype == two[name].dtype
        assert torch.equal(tensor, two[name]), name


def test_what_is_packed_comes_back_bit_for_bit():
    given = transitions()
    same(unpack(pack(given)), given)


def test_what_nothing_follows_is_packed_likewise():
    given = transitions()
    given = {name: given[name] for name in ("observation", "action")}
    same(unpack(pack(given)), given)


def test_rows_that_nothing_links_and_numbers_that_are_none_come_back():
    given = transitions()
    given["next.observation"] += 100.0
    given["next.observation"][7, 2] = np.nan
    given["observation"][3] = -0.0
    packed = unpack(pack(given))
    for name, tensor in given.items():
        np.testing.assert_array_equal(packed[name].numpy().tobytes(), tensor.numpy().tobytes())


def test_nothing_is_packed_as_nothing():
    assert unpack(pack({})) == {}


def test_the_same_transitions_are_the_same_bytes_and_take_less_room():
    given = transitions(4000)
    one, two = pack(given), pack(transitions(4000))
    assert torch.equal(one["columns"], two["columns"])
    raw = sum(tensor.numel() * tensor.element_size() for tensor in given.values())
    assert one["columns"].numel() + one["alone"].numel() < 0.8 * raw


@pytest.mark.parametrize("rows", [4, 8])
def test_a_few_rows_are_enough(rows):
    given = transitions(rows)
    same(unpack(pack(given)), given)
