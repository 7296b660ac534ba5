"""Networks: architecture as described, with standardisation included."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
import torch

from hydro.core.distillation.features import names
from hydro.core.errors import DataError, UsageError
from hydro.io.model import Model
from hydro.learn import networks
from hydro.learn.networks import ARCHITECTURES, architecture, build, load, parameter_count

COUNTS = {
    "mlp": 68_358,
    "resmlp": 129_542,
    "multihead": 114_390,
    "moe": 76_892,
    "physfeat": 72_582,
    "structured": 71_624,
    "temporal": 73_734,
    "gp": 60_520,
}


@pytest.mark.parametrize("name", list(ARCHITECTURES))
def test_counts_are_those_of_the_table(name):
    assert parameter_count(build(architecture(name))) == COUNTS[name]
    assert f"{COUNTS[name]:,}" in (networks.__doc__ or "")


@pytest.mark.parametrize(
    ("name", "paper"), [("resmlp", 130), ("multihead", 114), ("moe", 77), ("physfeat", 73)]
)
def test_counts_are_the_paper_s_to_a_thousand(name, paper):
    assert round(COUNTS[name] / 1000) == paper


@pytest.mark.parametrize("name", sorted(ARCHITECTURES))
def test_every_architecture_leads_from_its_features_to_six_axes(name):
    description = architecture(name)
    network = build(description)
    assert description["model"] == name
    assert network.features == description["features"]
    assert network.inputs == len(networks.inputs(description))
    assert network(torch.zeros(3, network.inputs)).shape == (3, 6)


def test_a_description_may_be_changed_without_changing_the_default():
    changed = architecture("mlp")
    changed["layers"][1] = 7
    assert architecture("mlp")["layers"][1] == 128
    assert parameter_count(build(changed)) == 12 * 7 + 7 + 7 * 256 + 256 + 256 * 128 + 128 + 128 * 6 + 6


def described(activation: str = "silu", layers=(12, 5, 4, 6)) -> Model:
    """Return a small model with random weights and scalers."""
    rng = np.random.default_rng(3)
    tensors = {}
    for i, (wide, next_wide) in enumerate(pairwise(layers)):
        tensors[f"layers.{i}.weight"] = rng.normal(size=(next_wide, wide)).astype(np.float32)
        tensors[f"layers.{i}.bias"] = rng.normal(size=next_wide).astype(np.float32)
    return Model(
        name="mlp",
        architecture={"model": "mlp", "features": "raw", "layers": list(layers), "activation": activation},
        tensors=tensors,
        features="raw",
        scalers={
            "input_mean": rng.normal(size=12),
            "input_scale": rng.uniform(0.5, 2.0, 12),
            "output_mean": rng.normal(size=6),
            "output_scale": rng.uniform(10.0, 100.0, 6),
        },
        inputs=names("raw"),
        outputs=("X_res", "Y_res", "Z_res", "K_res", "M_res", "N_res"),
        units={},
    )


@pytest.mark.parametrize(
    ("activation", "function"),
    [("silu", lambda x: x / (1.0 + np.exp(-x))), ("relu", lambda x: np.maximum(x, 0.0))],
)
def test_forward_pass_is_the_textbook_formula_in_physical_units(activation, function):
    model = described(activation)
    states = np.random.default_rng(4).normal(size=(20, 12))
    hidden = (states - model.scalers["input_mean"]) / model.scalers["input_scale"]
    for i in range(2):
        hidden = function(hidden @ model.tensors[f"layers.{i}.weight"].T + model.tensors[f"layers.{i}.bias"])
    standardised = hidden @ model.tensors["layers.2.weight"].T + model.tensors["layers.2.bias"]
    expected = model.scalers["output_mean"] + model.scalers["output_scale"] * standardised
    with torch.inference_mode():
        wrench = load(model)(torch.from_numpy(states.astype(np.float32))).numpy()
    np.testing.assert_allclose(wrench, expected, rtol=1e-4, atol=1e-3)


def test_unknown_model_lists_those_there_are():
    with pytest.raises(UsageError, match=r"'resnet'.*mlp, resmlp.*physfeat"):
        architecture("resnet")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "resnet"}, "unknown model 'resnet'"),
        ({"activation": "gelu"}, "activation 'gelu' is none of relu, silu"),
        ({"layers": [12, 8]}, "must end in 6"),
        ({"layers": [12, -1, 6]}, "does not fit"),
        ({"depth": 3}, "depth"),
    ],
)
def test_a_description_that_does_not_fit_is_refused_in_one_line(change, message):
    with pytest.raises(DataError, match=message) as caught:
        build(architecture("mlp") | change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("moe", {"gate": [12, 64, 3]}, "gate"),
        ("multihead", {"trunk": [12]}, "two widths"),
        ("resmlp", {"features": "none"}, "feature set 'none'"),
        ("structured", {"features": "physfeat"}, "must lead from 7 numbers"),
        ("structured", {"layers": [6, 8, 6]}, "must lead from 7 numbers"),
        ("temporal", {"window": 4}, "must begin with 30"),
        ("temporal", {"period": 0.0}, "two at least"),
    ],
)
def test_every_description_is_checked(name, change, message):
    with pytest.raises(DataError, match=message) as caught:
        build(architecture(name) | change)
    assert "\n" not in str(caught.value)


def test_the_gate_s_shares_add_up_to_one():
    network = build(architecture("moe"))
    with torch.no_grad():
        shares = network.shares(torch.randn(7, 12))
    np.testing.assert_allclose(shares.sum(dim=1), 1.0, rtol=1e-6)
    assert shares.shape == (7, 4)


def test_with_its_other_experts_shut_out_a_mixture_is_one_network():
    network = build(architecture("moe"))
    x = torch.randn(9, 12)
    with torch.no_grad():
        network.gate[-1].weight.zero_()
        network.gate[-1].bias.copy_(torch.tensor([-1e4, -1e4, 1e4, -1e4]))
        alone = x
        for layer in network.experts:
            alone = alone @ layer.weight[2].T + layer.bias[2]
            alone = alone if layer is network.experts[-1] else torch.nn.functional.silu(alone)
        np.testing.assert_allclose(network.standardised(x), alone, rtol=1e-4, atol=1e-5)


def test_a_head_moves_its_own_axis_alone():
    network = build(architecture("multihead"))
    x = torch.randn(5, 12)
    with torch.no_grad():
        before = network.standardised(x)
        network.out[3] += 1.0
        changed = (network.standardised(x) - before).abs().amax(dim=0)
    assert changed[3] > 0.0
    assert not changed[[0, 1, 2, 4, 5]].any()


@pytest.mark.parametrize("fault", ["missing", "shape", "extra"])
def test_tensors_that_do_not_fit_the_architecture_are_refused_in_one_line(fault):
    model = described()
    tensors = dict(model.tensors)
    if fault == "missing":
        del tensors["layers.1.bias"]
    elif fault == "shape":
        tensors["layers.1.bias"] = np.zeros(9, dtype=np.float32)
    else:
        tensors["layers.9.bias"] = np.zeros(9, dtype=np.float32)
    with pytest.raises(DataError, match=r"model mlp: tensor layers\.[19]\.bias") as caught:
        load(dataclasses.replace(model, tensors=tensors))
    assert "\n" not in str(caught.value)
