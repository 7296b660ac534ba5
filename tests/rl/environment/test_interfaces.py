"""Environments as other tools expect them: settings by name, wrappers of Gymnasium, Stable-Baselines3."""

import importlib.util
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers.vector import NormalizeObservation, NormalizeReward, RecordEpisodeStatistics

import hydro.rl
from hydro.core.errors import UsageError
from hydro.rl.environment.environments import FleetConfig, Single, Vector, make_fleet
from hydro.rl.environment.reward import TERMS
from hydro.sim.kernel_plant import KernelPlant
from hydro.sim.plant import StudentPlant

needs_sb3 = pytest.mark.skipif(
    importlib.util.find_spec("stable_baselines3") is None, reason="Stable-Baselines3 is not installed"
)
SHORT = {"task": {"steps": 20}, "reward.success": 60.0}


def test_settings_are_given_by_name_nested_or_dotted():
    settings = FleetConfig(settings=SHORT).all_settings()
    assert (settings.task.steps, settings.reward.success, settings.period) == (20, 60.0, 0.04)


@pytest.mark.parametrize(
    ("choices", "kind", "integrator"),
    [
        ({}, KernelPlant, "implicitfast"),
        ({"integrator": "RK4"}, KernelPlant, "implicitfast"),
        ({"engine": "mujoco"}, StudentPlant, "implicitfast"),
        ({"settings": {"engine": "mujoco"}, "integrator": "RK4"}, StudentPlant, "rk4"),
    ],
)
def test_engine_and_integrator_are_chosen_by_keyword(choices, kind, integrator):
    fleet = make_fleet(FleetConfig.of(choices))
    assert isinstance(fleet.plant, kind)
    assert fleet.settings.physics.integrator == integrator


@pytest.mark.parametrize(
    ("choices", "said"),
    [
        ({"integrator": "euler"}, "the kernels have rk4 alone; choose engine='mujoco'"),
        ({"integrator": "RK5", "engine": "mujoco"}, "choose one of euler, implicitfast, implicit, rk4"),
        ({"engine": "drake"}, "settings.engine is 'drake'; choose one of kernels, mujoco"),
        ({"settings": {"step": 0.0}}, "settings.step is 0 s; give a number above 0"),
        ({"settings": {"steps": 20}}, "no choice is called 'steps': choose one of task.steps"),
        ({"settings": {"task": {"steps": "many"}}}, "task.steps=.*not a value for this choice"),
        ({"settings": {"task": object()}}, "settings: expected numbers"),
        ({"vehicles": 3}, "no keyword is called 'vehicles': choose one of task, "),
        ({"render_mode": "human"}, "render_mode 'human'"),
    ],
)
@pytest.mark.parametrize("make", [Single, Vector])
def test_bad_choices_are_refused_in_one_line(make, choices, said):
    with pytest.raises(UsageError, match=said) as told:
        make(**choices)
    assert "\n" not in str(told.value)


def test_the_terms_of_the_reward_add_up_to_it():
    one, many = gymnasium.make("hydro/PillarRow-v0", level=3), gymnasium.make_vec("hydro/PillarRow-v0", 3)
    one.reset(seed=1)
    many.reset(seed=1)
    for _ in range(5):
        _, reward, _, _, info = one.step(np.full(6, 0.5, np.float32))
        assert tuple(info["reward_terms"]) == TERMS
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, rel=1e-5)
        assert info["reward_terms"]["effort"] < 0.0 < info["reward_terms"]["posture"]
        _, rewards, _, _, infos = many.step(np.full((3, 6), 0.5))
        np.testing.assert_allclose(sum(infos["reward_terms"].values()), rewards, rtol=1e-5)


def test_gymnasiums_wrappers_take_a_vector_of_vehicles():
    envs = gymnasium.make_vec("hydro/PointToPoint-v0", num_envs=3, settings=SHORT)
    envs = NormalizeReward(NormalizeObservation(RecordEpisodeStatistics(envs)))
    envs.reset(seed=1)
    for _ in range(45):
        seen, rewards, *_, info = envs.step(np.full((3, 6), 0.3))
        if "episode" in info:
            np.testing.assert_array_equal(info["episode"]["l"], [20, 20, 20])
    assert np.abs(seen).max() < 20.0
    assert np.isfinite(rewards).all()
    assert envs.env.env.episode_count == 6


@needs_sb3
def test_a_vector_environment_for_stable_baselines3_flies_what_gymnasium_flies():
    envs = hydro.rl.StableBaselinesEnv(2, settings=SHORT, encoded=False, seed=5)
    fleet = make_fleet(FleetConfig(settings=SHORT), count=2, seed=5)
    np.testing.assert_array_equal(envs.reset(), fleet.reset())
    actions = np.full((2, 6), 0.3, np.float32)
    for step in range(22):
        seen, reward, done, infos = envs.step(actions)
        same = fleet.step(actions)
        np.testing.assert_array_equal(seen, same.obs)
        np.testing.assert_array_equal(reward, same.reward)
        assert done.all() == (step == 19)
        if step == 19:
            np.testing.assert_array_equal(infos[1]["terminal_observation"], same.final_obs[1])
            assert infos[1]["TimeLimit.truncated"]
            assert infos[1]["episode"]["l"] == 20
            assert infos[1]["episode"]["r"] == pytest.approx(same.info.episode_return[1])
            assert tuple(infos[1]["reward_terms"]) == TERMS
        else:
            assert infos == [{}, {}]
    envs.seed(5)
    np.testing.assert_array_equal(
        envs.reset(), make_fleet(FleetConfig(settings=SHORT), count=2, seed=5).reset()
    )


@needs_sb3
def test_ppo_learns_in_it_behind_its_own_normaliser():
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    envs = VecNormalize(hydro.rl.StableBaselinesEnv(8, settings=SHORT))
    agent = PPO("MlpPolicy", envs, n_steps=32, batch_size=64, n_epochs=2, seed=0)
    before = [p.detach().clone() for p in agent.policy.parameters()]
    agent.learn(512)
    assert agent.num_timesteps == 512
    assert len(agent.ep_info_buffer) == 24
    assert any((p != q).any() for p, q in zip(agent.policy.parameters(), before, strict=True))
    envs.reset()
    assert envs.venv.observation_space.contains(envs.get_original_obs()[0])
    assert envs.env_is_wrapped(gymnasium.Wrapper) == [False] * 8
    assert envs.get_attr("num_envs", [0, 1]) == [8, 8]


def test_without_stable_baselines3_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UsageError, match="pip install stable-baselines3") as told:
        hydro.rl.StableBaselinesEnv  # noqa: B018
    assert "\n" not in str(told.value)


def test_a_pickled_vector_of_mujoco_vehicles_stays_one():
    many = Vector(2, settings=SHORT, engine="mujoco", integrator="RK4")
    many.reset(seed=3)
    other = pickle.loads(pickle.dumps(many))
    np.testing.assert_array_equal(many.step(np.zeros((2, 6)))[0], other.step(np.zeros((2, 6)))[0])
