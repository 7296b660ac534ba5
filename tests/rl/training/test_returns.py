"""Multi-step returns, compared with TorchRL and with explicit sums."""

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st
from tensordict import TensorDict
from torchrl.data.postprocs import MultiStep

from hydro.rl.training.returns import Horizon, Transition

DISCOUNT = 0.9


def flight(length, count, seed):
    """Return steps of vehicles whose episodes end at random; an observation is its time index."""
    rng = np.random.default_rng(seed)
    for k in range(length):
        now = np.full((count, 1), k, dtype=np.float32)
        terminated, truncated = rng.random(count) < 0.15, rng.random(count) < 0.1
        rewards = rng.standard_normal(count).astype(np.float32)
        once = np.ones(count, dtype=np.int64)
        yield Transition(now, -now, rewards, terminated, terminated | truncated, now + 1.0, once)


def ahead(steps, horizon):
    window = Horizon(horizon, DISCOUNT)
    return [made for made in map(window.add, steps) if made is not None]


@given(st.integers(1, 6), st.integers(0, 1000))
def test_a_window_is_torchrls_multi_step(horizon, seed):
    length, count = 20, 3
    steps = list(flight(length, count, seed))
    made = ahead(steps, horizon)

    def table(name):
        return torch.from_numpy(np.stack([getattr(step, name) for step in steps], 1)).reshape(
            count, length, -1
        )

    after = {"observation": table("following"), "reward": table("rewards"), "done": table("ended")}
    after |= {"terminated": table("terminated")}
    expected = MultiStep(DISCOUNT, horizon)(
        TensorDict(
            {"observation": table("observations"), "next": TensorDict(after, (count, length))},
            (count, length),
        )
    )
    for k, each in enumerate(made):
        np.testing.assert_allclose(each.rewards, expected["next", "reward"][:, k, 0], rtol=1e-5, atol=1e-6)
        np.testing.assert_array_equal(each.following, expected["next", "observation"][:, k])
        np.testing.assert_array_equal(each.steps, expected["steps_to_next_obs"][:, k].reshape(-1))
    assert len(made) == length - horizon + 1


def test_a_window_of_one_step_is_the_step():
    steps = list(flight(10, 2, 0))
    for made, step in zip(ahead(steps, 1), steps, strict=True):
        for one, other in zip(made, step, strict=True):
            np.testing.assert_array_equal(one, other)


def test_nothing_beyond_the_end_of_an_episode_counts():
    steps = [step._replace(rewards=np.ones(1, np.float32)) for step in flight(6, 1, 0)]
    never = np.zeros(1, bool)
    steps = [step._replace(terminated=never, ended=never) for step in steps]
    steps[1] = steps[1]._replace(terminated=~never, ended=~never)
    first, second, third = ahead(steps, 4)
    assert (first.rewards[0], first.steps[0], first.terminated[0]) == (np.float32(1.9), 2, True)
    assert (second.rewards[0], second.steps[0], second.following[0, 0]) == (1.0, 1, 2.0)
    assert (third.steps[0], third.terminated[0], third.following[0, 0]) == (4, False, 6.0)


def test_a_window_goes_on_from_its_state():
    steps = list(flight(12, 2, 3))
    window, other = Horizon(4, DISCOUNT), Horizon(4, DISCOUNT)
    for step in steps[:6]:
        window.add(step)
    other.restore(window.state())
    for step in steps[6:]:
        for one, two in zip(window.add(step), other.add(step), strict=True):
            np.testing.assert_array_equal(one, two)
