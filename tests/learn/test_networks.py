"""Networks are what their descriptions say, and carry their standardising with them."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
import torch

from hydro.core.errors import DataError, UsageError
from hydro.core.features import names
from hydro.io.model import Model
from hydro.learn.networks import ARCHITECTURES, architecture, build, load, parameter_count


@pytest.mark.parametrize(("name", "parameters"), [("mlp", 68_358), ("physfeat", 72_582)])
def test_widths_of_the_paper_give_these_counts(name, parameters):
    assert parameter_count(build(architecture(name))) == parameters


@pytest.mark.parametrize("name", sorted(ARCHITECTURES))
def test_every_architecture_leads_from_its_features_to_six_axes(name):
    description = architecture(name)
    network = build(description)
    assert description["model"] == name
    assert network.features == description["features"]
    assert network.inputs == len(names(description["features"]))
    assert network(torch.zeros(3, network.inputs)).shape == (3, 6)


def test_a_description_may_be_changed_without_changing_the_default():
    changed = architecture("mlp")
    changed["layers"][1] = 7
    assert architecture("mlp")["layers"][1] == 128
    assert parameter_count(build(changed)) == 12 * 7 + 7 + 7 * 256 + 256 + 256 * 128 + 128 + 128 * 6 + 6


def described(activation: str = "silu", layers=(12, 5, 4, 6)) -> Model:
    """A small model with drawn weights and scalers."""
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
    with pytest.raises(UsageError, match=r"'resnet'.*mlp, physfeat"):
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
