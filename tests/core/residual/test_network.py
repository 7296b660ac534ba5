"""The compiled forward pass against torch."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from sim.trained import trained

from hydro.core.distillation.features import features
from hydro.core.errors import DataError
from hydro.core.residual.layers import TO, WEIGHTS, exponential
from hydro.core.residual.lowering import LINE
from hydro.core.residual.network import Network
from hydro.learn.networks import ARCHITECTURES


def torch_says(network, model, states, past=None):
    """The wrench of the torch network, from features made in float64 as everywhere."""
    window = model.architecture.get("window", 1)
    before = np.tile(states[:, :6], window - 1) if past is None else past
    columns = np.hstack([features(states, model.architecture["features"]), before])
    with torch.no_grad():
        return network(torch.from_numpy(columns.astype(np.float32))).numpy()


@pytest.mark.parametrize("name", list(ARCHITECTURES))
def test_every_model_is_equal_to_torch(name):
    network, model = trained(name)
    states = np.random.default_rng(1).normal(size=(50, 12)) * 1.5
    expected = torch_says(network, model, states)
    ours = Network.of(model).wrench(states)
    np.testing.assert_allclose(ours, expected, atol=1e-5 * abs(expected).max(), rtol=1e-5)
    assert abs(expected).std() > 0.1, "the test sees something"


@pytest.mark.parametrize("name", ["mlp", "resmlp", "multihead", "moe"])
def test_every_activation_is_torch_s(name):
    for activation in ("relu", "tanh"):
        network, model = trained(name, activation=activation)
        states = np.random.default_rng(1).normal(size=(20, 12)) * 1.5
        expected = torch_says(network, model, states)
        np.testing.assert_allclose(
            Network.of(model).wrench(states), expected, atol=1e-5 * abs(expected).max(), rtol=1e-5
        )


def test_the_past_is_an_input_like_any_other():
    network, model = trained("temporal")
    rng = np.random.default_rng(5)
    states, past = rng.normal(size=(20, 12)), rng.normal(size=(20, 42))
    ours = Network.of(model).wrench(states, past)
    np.testing.assert_allclose(ours, torch_says(network, model, states, past), rtol=1e-4, atol=1e-3)
    assert abs(ours - Network.of(model).wrench(states)).max() > 0.1
    with pytest.raises(DataError, match=r"expected shape \(20, 42\)"):
        Network.of(model).wrench(states, past[:, :6])


@pytest.mark.parametrize("size", [1e3, 1e6])
def test_saturated_functions_stay_finite(size):
    for name in ARCHITECTURES:
        _, model = trained(name)
        assert np.isfinite(Network.of(model).wrench(np.full((1, 12), size))).all(), name


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
        (lambda m: m.architecture.pop("layers"), "has no 'layers'"),
        (lambda m: m.architecture.update(model="transformer"), "unknown architecture 'transformer'"),
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


def test_exp_is_exp_to_a_rounding_and_keeps_nan():
    x = np.linspace(-86.9, 87.9, 5001, dtype=np.float32)
    ours = np.array([exponential(each) for each in x])
    np.testing.assert_allclose(ours, np.exp(x.astype(float)), rtol=1.2e-7)
    beyond = [exponential(np.float32(each)) for each in (-np.inf, -200.0, 200.0, np.inf, np.nan)]
    assert 0.0 < beyond[0] == beyond[1] < 1e-37
    assert 1e38 < beyond[2] == beyond[3] < np.inf
    assert np.isnan(beyond[4])


def test_layers_begin_on_cache_lines():
    network = Network.of(trained("physfeat")[1])
    assert not (network.program[:, [TO, WEIGHTS]] % LINE).any()
    assert network.room == network.program[-1, TO] + 6
