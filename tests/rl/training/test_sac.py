"""Soft actor-critic, compared with TorchRL's loss, closed forms, and itself after an interruption."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from learners import ENCODING, SMALL, feed, learner
from scipy import integrate
from torchrl.objectives import SACLoss

from hydro.core.errors import DataError, UsageError
from hydro.rl.environment.action import ACTIONS
from hydro.rl.environment.encoding import Encoding
from hydro.rl.training.config import SACConfig
from hydro.rl.training.expert_labels import SPREAD
from hydro.rl.training.memory import unpack
from hydro.rl.training.policy import Policy
from hydro.rl.training.returns import Transition
from hydro.rl.training.sac import Learner, twin


def test_the_entropy_asked_for_is_a_nat_less_for_each_action():
    """The target entropy is that of Haarnoja et al. 2018, appendix D."""
    assert SACConfig().target_entropy == -ACTIONS


def plain(count):
    """Encoding that does not change observations."""
    return Encoding(np.ones(count, np.float32), np.zeros(count, np.bool_))


def transitions(made):
    return unpack(made.state()["memories"]["done"][0])


@pytest.mark.parametrize("norm", [False, True])
def test_losses_and_gradients_are_torchrls_own(norm):
    made = learner(replace(SMALL, norm=norm))
    made.loss._generator = None  # both then draw from the global stream
    batch = made._batch()
    batch["next", "done"] = batch["next", "terminated"]

    def gradients(values):
        made.loss.zero_grad()
        sum(values).backward()
        return [each.grad.clone() for each in made.loss.parameters()]

    torch.manual_seed(5)
    ours = made.loss(batch)
    torch.manual_seed(5)
    theirs = SACLoss.forward(made.loss, batch)
    for name, other in (("critic", "loss_qvalue"), ("actor", "loss_actor"), ("temperature", "loss_alpha")):
        torch.testing.assert_close(getattr(ours, name), theirs[other])
    torch.testing.assert_close(ours.entropy, theirs["entropy"])
    found = gradients([ours.critic, ours.actor, ours.temperature])
    expected = gradients([theirs["loss_qvalue"], theirs["loss_actor"], theirs["loss_alpha"]])
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-6)


def test_both_critics_at_once_are_each_by_itself():
    torch.manual_seed(0)
    shapes = [(16, 7), (16,), (16, 16), (16,), (1, 16), (1,)]
    weights = [torch.randn(2, *shape) for shape in shapes]
    observations, actions = torch.randn(9, 5), torch.randn(9, 2)
    both = twin(weights, observations, actions)
    for k in range(2):
        layer = torch.cat([observations, actions], 1)
        for i in (0, 2, 4):
            layer = layer @ weights[i][k].T + weights[i + 1][k]
            layer = layer.relu() if i < 4 else layer
        torch.testing.assert_close(both[k], layer.squeeze(-1))


def test_the_density_of_actions_integrates_to_one():
    """Integrate the log density of `sample` over the actions."""
    made = Learner(ENCODING, 1, SMALL, seed=3)
    observation = torch.zeros(20_000, 5)
    with torch.no_grad():
        actions, log_density = made.loss.sample(observation)
    order = actions[:, 0].argsort()
    a, density = actions[order, 0].double().numpy(), log_density[order].exp().double().numpy()
    assert integrate.trapezoid(density, a) == pytest.approx(1.0, abs=0.01)


def test_an_episode_that_time_ended_is_worth_what_would_follow_and_a_terminated_one_is_not():
    made = learner()
    batch = made._batch()
    batch["next", "reward"] = torch.zeros_like(batch["next", "reward"])
    batch["steps_to_next_obs"] = torch.full_like(batch["steps_to_next_obs"], 2)
    with torch.no_grad():
        for target in made.loss._targets[:-1]:
            target.zero_()
        made.loss._targets[-1].fill_(10.0)
        made.loss._critics[-2].zero_()
        made.loss._critics[-1].zero_()
        made.loss.log_alpha.fill_(-30.0)
        for terminated, worth in ((True, 0.0), (False, 0.99**2 * 10.0)):
            batch["next", "terminated"] = torch.full_like(batch["next", "terminated"], terminated)
            assert made.loss(batch).critic.item() == pytest.approx(2.0 * worth**2, rel=1e-5)


def shown(count, learn):
    """Return `count` steps of 8 vehicles under a pilot with a law of its observations."""
    rng = np.random.default_rng(7)
    for _ in range(count):
        seen, after = (rng.standard_normal((8, 5)).astype(np.float32) for _ in range(2))
        rest = np.zeros(8, np.float32), np.zeros(8, bool), np.zeros(8, bool), after, np.ones(8, np.int64)
        yield Transition(seen, learn(seen), *rest)


OPEN = ("point_to_point", 0)


def law(seen):
    return np.tanh(seen[:, :2] - 0.5 * seen[:, 2:4]).astype(np.float32)


def test_a_clone_does_as_was_shown():
    made = Learner(plain(5), 2, replace(SMALL, layers=(32, 32)), 0)
    made.add_demonstrations(shown(300, law), OPEN)
    observations = np.random.default_rng(1).standard_normal((500, 5)).astype(np.float32)
    before = np.abs(made.best(observations) - law(observations)).mean()
    made.clone(1500)
    assert np.abs(made.best(observations) - law(observations)).mean() < 0.2 * before
    spread = made.network(torch.from_numpy(observations))[1]
    assert spread.mean().item() == pytest.approx(SPREAD, rel=0.1)


def test_a_share_of_every_batch_is_of_what_was_shown():
    """Demonstrated actions have a distinctive size; without own steps, the whole batch is demonstrations."""
    made = Learner(ENCODING, 2, replace(SMALL, demonstrated=0.25), 0)
    made.add_demonstrations(shown(50, lambda seen: np.full((8, 2), 0.999, np.float32)), OPEN)
    assert (made._batch()["action"] == 0.999).all()
    feed(made, 200)
    batch = made._batch()
    assert (batch["action"] == 0.999).all(1).sum() == 8
    assert batch.batch_size == (32,)


def test_what_was_shown_is_in_the_state():
    made, other = (Learner(ENCODING, 2, SMALL, seed) for seed in (0, 1))
    made.add_demonstrations(shown(30, law), OPEN)
    feed(made, 80)
    made.update()
    other.restore(copy.deepcopy(made.state()))
    for each in (made, other):
        each.clone(3)
    assert [made.update() for _ in range(4)] == [other.update() for _ in range(4)]


def test_critics_begin_apart_and_their_targets_with_them():
    made = learner()
    for critic, target in zip(made.loss._critics, made.loss._targets, strict=True):
        assert critic[0].numel() == 1 or not torch.equal(critic[0], critic[1])
        torch.testing.assert_close(critic, target, check_stride=False)


def test_targets_follow_by_tau():
    made = learner()
    before = [each.clone() for each in made.loss._targets]
    made.update()
    for old, new, critic in zip(before, made.loss._targets, made.loss._critics, strict=True):
        torch.testing.assert_close(new, old + SMALL.tau * (critic.detach() - old))


def test_the_temperature_rises_while_entropy_is_below_its_target():
    for target, sign in ((100.0, 1.0), (-100.0, -1.0)):
        made = learner(SACConfig(layers=(16,), batch=32, capacity=500, target_entropy=target))
        assert made.loss.log_alpha.item() == pytest.approx(math.log(0.05))
        made.update()
        assert math.copysign(1.0, made.loss.log_alpha.item() - math.log(0.05)) == sign


@pytest.mark.parametrize("rows", [160, 1200], ids=["filling", "overwriting"])
def test_a_learner_goes_on_from_its_state_bit_for_bit(rows):
    made = learner(rows=rows)
    for _ in range(3):
        made.update()
    kept = copy.deepcopy(made.state())
    other = learner(seed=9, rows=40)
    other.restore(kept)
    losses = []
    for each in (made, other):
        feed(each, 64, seed=4)
        losses.append([each.update() for _ in range(5)])
    assert losses[0] == losses[1]
    again, there = other.state(), made.state()
    torch.testing.assert_close(again["loss"], there["loss"], rtol=0, atol=0)
    torch.testing.assert_close(transitions(other), transitions(made), rtol=0, atol=0)
    assert again["updates"] == there["updates"] == 8
    observations = np.ones((3, 5), dtype=np.float32)
    np.testing.assert_array_equal(made.act(observations), other.act(observations))


@pytest.mark.parametrize("rows", [160, 1200], ids=["filling", "overwriting"])
def test_a_state_holds_what_the_memory_does_and_nothing_behind_it(rows):
    """A saved view would store its whole storage, with rows that were never written."""
    made = learner(rows=rows)
    packed = made.state()["memories"]["done"][0]
    for part in (packed["columns"], packed["alone"]):
        assert part.untyped_storage().nbytes() == part.nbytes
    assert len(transitions(made)["action"]) == len(made._memories["done"])


def test_memory_keeps_the_last_transitions_scaled():
    made = learner(replace(SMALL, horizon=1), rows=0)
    feed(made, 1200)
    kept = transitions(made)
    assert len(kept["action"]) == SMALL.capacity
    raw = np.zeros((8, 5), dtype=np.float32) + 4.0
    made.remember(
        raw, np.zeros((8, 2), np.float32), np.zeros(8, np.float32), np.zeros(8, bool), np.zeros(8, bool), raw
    )
    found = (transitions(made)["observation"] == torch.from_numpy(ENCODING(raw[0]))).all(1)
    assert found.sum() == 8


def test_seeds_are_apart_and_the_global_stream_is_left_alone():
    torch.manual_seed(1)
    expected = torch.rand(3)
    torch.manual_seed(1)
    first, second, third = (Learner(ENCODING, 2, SMALL, seed) for seed in (0, 1, 0))
    torch.testing.assert_close(torch.rand(3), expected)
    observations = np.ones((4, 5), dtype=np.float32)
    assert not np.array_equal(first.best(observations), second.best(observations))
    np.testing.assert_array_equal(first.act(observations), third.act(observations))
    assert (abs(first.explore(1000)) <= 1.0).all()


def test_a_policy_by_itself_acts_as_its_learner():
    made = learner()
    observations = np.random.default_rng(0).standard_normal((6, 5)).astype(np.float32)
    policy = made.policy({"steps": 8})
    np.testing.assert_array_equal(policy(observations), made.best(observations))
    made.update()
    assert not np.array_equal(policy(observations), made.best(observations))


def test_what_is_kept_is_the_average_of_the_policies():
    """The average equals the policy after the first update, then follows with its rate."""
    made = learner(replace(SMALL, average=0.25))
    expected = None
    for _ in range(5):
        made.update()
        now = {name: each.clone() for name, each in made.network.state_dict().items()}
        expected = {name: 0.75 * expected[name] + 0.25 * now[name] for name in now} if expected else now
    for name, kept in made.policy({}).weights.items():
        torch.testing.assert_close(torch.from_numpy(kept), expected[name])
        assert not torch.equal(torch.from_numpy(kept), now[name])


def test_tensors_of_other_layers_make_no_policy():
    policy = learner().policy({})
    with pytest.raises(DataError, match="do not fit layers"):
        Policy((8,), policy.encoding, policy.weights)
    with pytest.raises(DataError, match="do not fit layers"):
        Policy((16, 16), policy.encoding, {})


def test_a_simple_task_is_learnt():
    """The reward of one step is -(a - a*)^2 with a* = 0.5 sign of the first observation."""
    choices = SACConfig(layers=(32, 32), batch=64, rate=3e-3, target_entropy=-3.0, horizon=1, average=0.05)
    made = Learner(plain(2), 1, choices, 0)
    rng = np.random.default_rng(0)
    observations = rng.choice([-1.0, 1.0], (2000, 2)).astype(np.float32)
    actions = rng.uniform(-1, 1, (2000, 1)).astype(np.float32)
    rewards = -10.0 * (actions[:, 0] - 0.5 * observations[:, 0]) ** 2
    ends = np.ones(2000, bool), np.zeros(2000, bool)
    made.remember(observations, actions, rewards, *ends, observations)
    for _ in range(300):
        made.update()
    np.testing.assert_allclose(made.best(observations)[:, 0], 0.5 * observations[:, 0], atol=0.25)


def test_a_constant_error_of_the_values_dies_out_faster_with_a_longer_horizon():
    """A constant reward of 1 has the value 1 / (1 - gamma) = 100; critics start at 0."""
    still, never = np.zeros((64, 2), np.float32), np.zeros(64, bool)
    worth = []
    for horizon in (1, 10):
        choices = SACConfig(layers=(16,), batch=32, rate=3e-2, temperature=1e-6, horizon=horizon)
        made = Learner(plain(2), 1, choices, 0)
        for _ in range(20):
            made.remember(still, still[:, :1], np.ones(64, np.float32), never, never, still)
        for _ in range(400):
            losses = made.update()
        worth.append(losses.value.item())
    assert 5.0 * worth[0] < worth[1] < 100.0


def test_a_horizon_is_of_a_step_at_least():
    with pytest.raises(UsageError, match="give a share above 0"):
        SACConfig(average=0.0)
    with pytest.raises(UsageError, match="give 1 or more"):
        SACConfig(horizon=0)
