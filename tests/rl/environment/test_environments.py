"""The environments as their users know them: Gymnasium, its vector interface, TorchRL, Stable-Baselines3."""

import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from stable_baselines3 import SAC
from stable_baselines3.common.env_checker import check_env as check_for_sb3
from torchrl.envs.utils import check_env_specs

import hydro.rl  # noqa: F401  registers the environments
from hydro.core.errors import DataError, UsageError
from hydro.rl.environment.config import Settings, Task
from hydro.rl.environment.environments import FleetConfig, make_fleet
from hydro.rl.environment.torch_env import FleetEnv

SHORT = Settings(task=Task(steps=20))


@pytest.mark.parametrize("name", ["hydro/PointToPoint-v0", "hydro/Slalom-v0", "hydro/Guided-v0"])
def test_gymnasiums_checker_is_content(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(name).unwrapped, skip_render_check=True)


def test_an_episode_through_gymnasium():
    env = gymnasium.make("hydro/Slalom-v0", level=3, settings=SHORT, condition="R_0")
    first, info = env.reset(seed=4)
    assert info == {}
    for step in range(20):
        seen, reward, terminated, truncated, info = env.step(np.zeros(6, dtype=np.float32))
        assert env.observation_space.contains(seen)
        assert isinstance(reward, float)
        assert (terminated, truncated) == (False, step == 19)
    assert info["episode_length"] == 20
    second, _ = env.reset()
    again, _ = env.reset(seed=4)
    assert (second != first).any()
    np.testing.assert_array_equal(again, first)


def test_a_vector_of_vehicles():
    envs = gymnasium.make_vec("hydro/PointToPoint-v0", num_envs=3, settings=SHORT)
    first, _ = envs.reset(seed=1)
    assert envs.observation_space.contains(first)
    for _ in range(19):
        *_, info = envs.step(envs.action_space.sample() * 0)
        assert "final_obs" not in info
    seen, _, terminated, truncated, info = envs.step(np.zeros((3, 6)))
    assert truncated.all()
    assert not terminated.any()
    assert info["_final_obs"].all()
    assert (info["final_obs"] != seen).any()
    assert (info["final_info"]["episode_length"] == 20).all()
    again, _ = envs.reset(seed=1)
    np.testing.assert_array_equal(again, first)
    part, _ = envs.reset(options={"reset_mask": np.array([False, True, False])})
    np.testing.assert_array_equal(part[[0, 2]], first[[0, 2]])
    assert (part[1] != first[1]).any()
    with pytest.raises(UsageError, match="one seed"):
        envs.reset(seed=[1, 2, 3])


def test_torchrls_checker_is_content():
    check_env_specs(FleetEnv(make_fleet(FleetConfig(settings=SHORT), count=3)))


def test_torchrl_resets_the_vehicles_whose_episode_has_ended():
    env = FleetEnv(make_fleet(FleetConfig(settings=SHORT), count=3))
    env.set_seed(0)
    went = env.rollout(45, break_when_any_done=False)
    ended = went["next", "done"].squeeze(-1)
    assert (ended.sum(1) >= 2).all()
    before, after = went["next", "observation"][:, :-1], went["observation"][:, 1:]
    changed = (before != after).any(-1)
    assert torch.equal(changed, ended[:, :-1])
    env.set_seed(0)
    assert torch.equal(env.rollout(1)["observation"], went["observation"][:, :1])


def test_stable_baselines3_trains_on_it():
    env = gymnasium.make("hydro/PointToPoint-v0")
    check_for_sb3(env, skip_render_check=True)
    agent = SAC(
        "MlpPolicy",
        env,
        learning_starts=200,
        train_freq=8,
        batch_size=64,
        seed=0,
        policy_kwargs={"net_arch": [32]},
    )
    before = [p.clone() for p in agent.actor.parameters()]
    agent.learn(2000)
    assert agent.num_timesteps == 2000
    assert len(agent.ep_info_buffer) > 0
    assert all(torch.isfinite(p).all() for p in agent.actor.parameters())
    assert any((p != q).any() for p, q in zip(agent.actor.parameters(), before, strict=True))


@pytest.mark.parametrize(
    ("choices", "error", "word"),
    [
        ({"vehicle": "no-such"}, DataError, "no-such"),
        ({"condition": "R_1"}, UsageError, "R_1.*R_PhysFeat"),
        ({"condition": "R_MLP"}, UsageError, "kind mlp, and none"),
        ({"stage": 2, "level": 12}, UsageError, "level 12"),
    ],
)
def test_bad_choices_are_refused_in_one_line(choices, error, word):
    with pytest.raises(error, match=word) as told:
        make_fleet(FleetConfig(**choices))
    assert "\n" not in str(told.value)


def test_registration_loads_nothing_heavy():
    heavy = {"torch", "mujoco", "numba", "torchrl"}
    code = f"import hydro.rl, sys; sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
