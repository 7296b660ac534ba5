"""The compiled forward pass against torch."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from sim.trained import trained

from hydro.core.errors import DataError
from hydro.core.features import features
from hydro.sim.network import Network


@pytest.mark.parametrize("activation", ["silu", "relu"])
@pytest.mark.parametrize("name", ["mlp", "physfeat"])
def test_equal_to_torch(name, activation):
    network, model = trained(name, activation=activation)
    states = np.random.default_rng(1).normal(size=(50, 12)) * 1.5
    with torch.no_grad():
        columns = features(states, model.architecture["features"]).astype(np.float32)
        expected = network(torch.from_numpy(columns)).numpy()
    ours = Network.of(model).wrench(states)
    np.testing.assert_allclose(ours, expected, atol=1e-5 * model.scalers["output_scale"].max(), rtol=1e-5)


def test_widths_that_are_no_multiple_of_four():
    network, model = trained("mlp", layers=[12, 7, 13, 6])
    states = np.random.default_rng(2).normal(size=(5, 12))
    with torch.no_grad():
        expected = network(torch.from_numpy(states.astype(np.float32))).numpy()
    np.testing.assert_allclose(Network.of(model).wrench(states), expected, rtol=1e-4, atol=1e-4)


def test_one_state_or_many_give_the_same_bits():
    _, model = trained("physfeat")
    network = Network.of(model)
    states = np.random.default_rng(3).normal(size=(9, 12))
    together = network.wrench(states)
    alone = np.vstack([network.wrench(state) for state in states])
    np.testing.assert_array_equal(together, alone)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda m: m.architecture.pop("layers"), "plain feedforward"),
        (lambda m: m.architecture.update(activation="gelu"), "activation 'gelu'"),
        (lambda m: m.architecture.update(layers=[45, 8, 6]), "do not lead from features raw"),
        (lambda m: m.tensors.pop("layers.1.bias"), r"layers\.1\.bias is missing"),
        (lambda m: m.tensors.update({"layers.0.weight": np.zeros((2, 2))}), "has shape"),
    ],
)
def test_a_model_that_does_not_fit_is_refused_in_one_line(spoil, message):
    _, model = trained("mlp")
    spoil(model)
    with pytest.raises(DataError, match=message) as caught:
        Network.of(model)
    assert "\n" not in str(caught.value)
