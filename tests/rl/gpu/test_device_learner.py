"""Learner that keeps all data on the environment's device, here the processor."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hydro.rl.environment.environments import FleetConfig, make_fleet
from hydro.rl.environment.observation import encoding
from hydro.rl.environment.torch_env import FleetEnv
from hydro.rl.gpu import returns as tensors
from hydro.rl.gpu.learner import DeviceLearner
from hydro.rl.training import returns as arrays
from hydro.rl.training.config import SACConfig
from hydro.rl.world.config import Settings

SMALL = SACConfig(layers=(32, 32), norm=True, batch=32, random=40, updates=2, horizon=3, capacity=1_000)


def learner(seed=0):
    return DeviceLearner(
        FleetEnv(make_fleet(FleetConfig(), count=8, seed=seed)), encoding(Settings()), SMALL, seed
    )


@given(st.integers(0, 2**32), st.integers(1, 6), st.floats(0.0, 0.6))
def test_rewards_of_several_steps_are_those_of_the_other_window(seed, horizon, share):
    rng = np.random.default_rng(seed)
    ours, theirs = tensors.Horizon(horizon, 0.97), arrays.Horizon(horizon, 0.97)
    for _ in range(9):
        terminated = rng.random(5) < share
        step = arrays.Transition(
            rng.standard_normal((5, 4)).astype(np.float32), rng.random((5, 2)).astype(np.float32),
            rng.standard_normal(5).astype(np.float32), terminated, terminated | (rng.random(5) < share),
            rng.standard_normal((5, 4)).astype(np.float32), np.ones(5, dtype=np.int64),
        )  # fmt: skip
        got, wanted = ours.add(tensors.Transition(*map(torch.from_numpy, step))), theirs.add(step)
        assert (got is None) == (wanted is None)
        for one, other in zip(got or (), wanted or (), strict=True):
            np.testing.assert_allclose(one.numpy(), other, rtol=1e-5, atol=1e-6)


def test_it_learns_from_what_it_does_and_the_policy_kept_is_the_average():
    one = learner()
    for _ in range(20):
        one.advance()
    assert one.steps == 160
    assert one.updates == 2 * (20 - 5), "none while it explores"
    assert len(one._replay) == 8 * (20 - SMALL.horizon + 1)
    policy = one.policy({"steps": one.steps})
    seen = one._now["observation"]
    with torch.no_grad():
        wanted = one._average(one.encoded(seen))[0].tanh().numpy()
    np.testing.assert_allclose(policy(seen.numpy()), wanted, rtol=1e-5, atol=1e-6)
    assert any(
        (a != b).any() for a, b in zip(one._average.parameters(), one.network.parameters(), strict=True)
    )


def test_the_same_seed_learns_the_same():
    torch.set_num_threads(1)
    first, second, other = learner(), learner(), learner(1)
    for each in (first, second, other):
        for _ in range(10):
            each.advance()
    weights = [torch.cat([w.flatten() for w in each.network.parameters()]) for each in (first, second, other)]
    assert (weights[0] == weights[1]).all()
    assert not (weights[0] == weights[2]).all()


@pytest.mark.parametrize("arrives", [True, False])
def test_a_success_is_one_of_the_first_episode(monkeypatch, arrives):
    """An arrival after a collision is not a success."""
    one, exam = learner(), FleetEnv(make_fleet(FleetConfig(), count=4, seed=9))
    calls = iter(range(100))

    def step(tensordict):
        k = next(calls)
        after = tensordict.clone()
        names = ("success", "done") if arrives else ("done",)
        for name in ("success", "done"):
            after[name] = torch.full((4, 1), k == 2 and name in names)
        if not arrives and k == 5:
            after["success"] = after["done"] = torch.ones(4, 1, dtype=torch.bool)
        return {"next": after}

    monkeypatch.setattr(exam, "step", step)
    assert one.success(exam, 10) == float(arrives)
