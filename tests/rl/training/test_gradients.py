"""Gradients of soft actor-critic in closed form, compared with automatic differentiation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from learners import ENCODING, SMALL, feed, learner

from hydro.core.errors import UsageError
from hydro.rl.training.config import SACConfig
from hydro.rl.training.sac import Learner


@pytest.mark.parametrize("norm", [False, True], ids=["plain", "normalised"])
@pytest.mark.parametrize("layers", [(16,), (16, 8, 12)], ids=["one layer", "three layers"])
def test_losses_and_gradients_are_those_of_automatic_differentiation(norm, layers):
    made = learner(replace(SMALL, norm=norm, layers=layers))
    made.loss._generator = made._gradients._generator = None  # both then draw from the global stream
    batch = made._batch()
    torch.manual_seed(5)
    ours = made._gradients(batch)
    found = [each.grad.clone() for each in made.loss.parameters()]
    for each in made.loss.parameters():
        each.grad = None
    torch.manual_seed(5)
    losses = made.loss(batch)
    (losses.critic + losses.actor + losses.temperature).backward()
    for one, other in zip(ours, losses, strict=True):
        torch.testing.assert_close(one.reshape(()), other.detach().reshape(()))
    for one, each in zip(found, made.loss.parameters(), strict=True):
        torch.testing.assert_close(one, each.grad, rtol=1e-4, atol=1e-6)


def test_an_update_without_the_actor_leaves_policy_and_temperature_unchanged():
    made = learner(replace(SMALL, delay=2))
    losses = [made.update()]
    before = [each.detach().clone() for each in (*made.network.parameters(), made.loss.log_alpha)]
    critics = [each.detach().clone() for each in made.loss._critics]
    losses.append(made.update())
    now = (*made.network.parameters(), made.loss.log_alpha)
    assert all(torch.equal(one, other) for one, other in zip(before, now, strict=True))
    assert not any(torch.equal(one, other) for one, other in zip(critics, made.loss._critics, strict=True))
    losses.append(made.update())
    assert not any(torch.equal(one, other) for one, other in zip(before, now, strict=True))
    assert [math.isnan(each.actor) for each in losses] == [False, True, False]
    assert not any(math.isnan(each.critic) for each in losses)


def test_exploration_noise_has_the_correlation_and_the_variance_asked_for():
    made = Learner(ENCODING, 2, replace(SMALL, correlation=0.9), 0)
    observations = np.zeros((400, 5), dtype=np.float32)
    mean, scale = (each.detach().numpy() for each in made.network(torch.zeros(400, 5)))
    drawn = [(np.arctanh(made.act(observations)) - mean) / scale for _ in range(30)]
    noise = np.array(drawn, dtype=np.float64)
    assert noise.std() == pytest.approx(1.0, abs=0.05)
    assert (noise[1:] * noise[:-1]).mean() == pytest.approx(0.9, abs=0.05)
    assert (noise[20:] * noise[:-20]).mean() == pytest.approx(0.9**20, abs=0.1)


def test_correlated_noise_goes_on_from_a_state():
    choices = replace(SMALL, correlation=0.9, delay=2)
    made, other = learner(choices), learner(choices, seed=9, rows=40)
    observations = np.ones((3, 5), dtype=np.float32)
    made.act(observations)
    made.update()
    other.restore(made.state())
    for each in (made, other):
        feed(each, 64, seed=4)
    np.testing.assert_array_equal(made.act(observations), other.act(observations))
    assert math.isnan(made.update().actor)
    assert math.isnan(other.update().actor)


@pytest.mark.parametrize("wrong", [{"delay": 0}, {"correlation": 1.0}, {"correlation": -0.1}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(UsageError, match=f"sac.{next(iter(wrong))} is"):
        SACConfig(**wrong)
