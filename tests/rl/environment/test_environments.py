"""Public interfaces of the environments: Gymnasium, its vector interface, TorchRL, Stable-Baselines3."""

import os
import pickle
import subprocess
import sys
import warnings

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from stable_baselines3 import SAC
from stable_baselines3.common.env_checker import check_env as check_for_sb3
from torchrl.envs.utils import check_env_specs

import hydro.rl
from hydro.core.errors import DataError, HydroNotice, UsageError
from hydro.rl.environment.action import ACTIONS
from hydro.rl.environment.environments import Encoded, FleetConfig, Single, make_fleet, single_spaces
from hydro.rl.environment.observation import ENCODING
from hydro.rl.environment.torch_env import FleetEnv
from hydro.rl.world.config import Episode, Settings

SHORT = Settings(task=Episode(steps=20))


def test_actions_are_demands_of_either_sign_up_to_their_limit():
    actions = single_spaces(SHORT)[1]
    np.testing.assert_array_equal([actions.low, actions.high], [[-1.0] * ACTIONS, [1.0] * ACTIONS])


@pytest.mark.parametrize("name", hydro.rl.IDS)
def test_gymnasiums_checker_is_content(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", HydroNotice)  # the first use of a kernel compiles it
        check_env(gymnasium.make(f"hydro/{name}").unwrapped, skip_render_check=True)


def test_an_episode_through_gymnasium():
    env = gymnasium.make("hydro/PillarRow-v0", level=3, settings=SHORT, condition="R_0")
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
    envs = gymnasium.make_vec("hydro/PointToPoint-v0", num_envs=3, settings=SHORT, autoreset_mode="SameStep")
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


def test_ids_are_found_without_an_import():
    """Gymnasium imports the module named before a colon."""
    code = "import gymnasium; gymnasium.make('hydro.rl:hydro/PointToPoint-v0').reset(seed=1)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def flown(envs, steps=25):
    """Return the observations of a vector of vehicles at rest, step by step."""
    envs.reset(seed=1)
    return [envs.step(np.zeros((2, 6))) for _ in range(steps)]


def test_the_next_episode_begins_in_the_next_step():
    next_step = flown(vectors("NextStep"))
    ends = [bool(truncated.all()) for _, _, _, truncated, _ in next_step]
    assert ends == [step == 19 for step in range(25)]
    last, first = next_step[19], next_step[20]
    assert (last[0][:, :3] != first[0][:, :3]).any()  # another goal
    assert (first[1] == 0.0).all()
    assert (next_step[21][4]["episode_length"] == 1).all()
    assert "final_obs" not in last[4]


def test_without_autoreset_an_episode_waits_for_its_reset():
    envs = vectors("Disabled")
    ended = flown(envs, 20)[-1]
    assert ended[3].all()
    seen, _ = envs.reset(options={"reset_mask": np.array([True, False])})
    np.testing.assert_array_equal(seen[1], ended[0][1])
    assert (seen[0, :3] != ended[0][0, :3]).any()


def vectors(mode):
    envs = gymnasium.make_vec("hydro/PointToPoint-v0", num_envs=2, settings=SHORT, autoreset_mode=mode)
    assert envs.metadata["autoreset_mode"] == AutoresetMode(mode)
    return envs


def test_a_pickled_environment_goes_on_with_the_same_bits():
    env = gymnasium.make("hydro/Forest-v0", level=8, condition="R_0").unwrapped
    many = gymnasium.make_vec("hydro/PointToPoint-v0", num_envs=2, settings=SHORT).unwrapped
    env.reset(seed=3)
    many.reset(seed=3)
    for _ in range(5):
        env.step(np.full(6, 0.3))
        many.step(np.full((2, 6), 0.3))
    for one, actions in ((env, np.full(6, 0.2)), (many, np.full((2, 6), 0.2))):
        other = pickle.loads(pickle.dumps(one))
        for _ in range(20):
            seen, again = one.step(actions), other.step(actions)
            np.testing.assert_array_equal(seen[0], again[0])
            np.testing.assert_array_equal(seen[1], again[1])
        np.testing.assert_array_equal(one.reset()[0], other.reset()[0])


def test_observations_may_be_encoded_as_the_policies_are_given_them():
    env = Encoded(gymnasium.make("hydro/Slalom-v1", level=3))
    plain = gymnasium.make("hydro/Slalom-v1", level=3)
    seen, raw = env.reset(seed=2)[0], plain.reset(seed=2)[0]
    assert env.observation_space.contains(seen)
    np.testing.assert_array_equal(seen, ENCODING(raw))
    for _ in range(30):
        seen, *_ = env.step(env.action_space.sample())
        assert env.observation_space.contains(seen)


@pytest.mark.skipif("MUJOCO_GL" not in os.environ, reason="pictures need MUJOCO_GL")
def test_a_picture_shows_the_vehicle():
    env = gymnasium.make("hydro/Slalom-v1", render_mode="rgb_array")
    env.reset(seed=1)
    picture = env.render()
    assert picture.shape == (360, 640, 3)
    red, green, blue = picture[180, 320].astype(int)
    assert min(red, green) > 2 * blue, "the middle of the picture is the yellow hull"
    env.close()


def test_another_way_to_render_is_refused():
    with pytest.raises(UsageError, match="rgb_array"):
        Single(render_mode="human")


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
    env = Encoded(gymnasium.make("hydro/PointToPoint-v0"))
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
        ({"condition": "R_MLP"}, UsageError, "kind mlp, but none"),
        ({"task": "slalom", "level": 12}, UsageError, "level 12"),
        ({"task": "salom"}, UsageError, "no task 'salom': choose one of slalom"),
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


@pytest.mark.parametrize(
    "make",
    [
        lambda: gymnasium.make_vec("hydro/PointToPoint-v0", num_envs=2),
        lambda: gymnasium.make("hydro/PointToPoint-v0").unwrapped,
    ],
)
def test_a_step_before_the_first_reset_is_refused(make):
    env = make()
    count = (2, 6) if hasattr(env, "num_envs") else 6
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"reset\(\) before step\(\)"):
        env.step(np.zeros(count, np.float32))
    env.reset(seed=0)
    assert np.isfinite(env.step(np.zeros(count, np.float32))[1]).all()
