"""Residual networks: feature columns in, the residual wrench tau_res out, both in physical units.

Every network is described by a plain dict, which the model artefact stores, and is made from it by `build`.
A network carries the means and scales of its inputs and outputs as buffers, so that standardising (paper
IV-C) is its own affair and nobody else's: callers hand over features as `hydro.core.features` makes them and
receive newtons and newton metres.

To add a model: write a `Residual`, enter it in `NETWORKS` and describe its default in `ARCHITECTURES`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from hydro.core.errors import DataError, UsageError
from hydro.io.model import SCALERS, Model

AXES = 6
ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "relu": nn.functional.relu,
    "silu": nn.functional.silu,
}


class Residual(nn.Module):
    """A network between standardised features and the standardised wrench, dressed in physical units.

    Subclasses implement `standardised`. Until `standardise` is called, means are 0 and scales 1.
    """

    input_mean: Tensor
    input_scale: Tensor
    output_mean: Tensor
    output_scale: Tensor

    def __init__(self, inputs: int, features: str) -> None:
        super().__init__()
        self.inputs = inputs
        self.features = features
        for side, length in (("input", inputs), ("output", AXES)):
            self.register_buffer(f"{side}_mean", torch.zeros(length), persistent=False)
            self.register_buffer(f"{side}_scale", torch.ones(length), persistent=False)

    def standardise(self, scalers: Mapping[str, np.ndarray]) -> None:
        """Take over `input_mean`, `input_scale` (k,) and `output_mean`, `output_scale` (6,)."""
        for name in SCALERS:
            self.get_buffer(name).copy_(torch.from_numpy(np.asarray(scalers[name], dtype=np.float32)))

    def standardised(self, inputs: Tensor) -> Tensor:
        """Map standardised features (N, k) to the standardised wrench (N, 6)."""
        raise NotImplementedError

    def forward(self, features: Tensor) -> Tensor:
        """Map features (N, k) to tau_res (N, 6) [N and N m], body FRD, order X Y Z K M N."""
        inputs = (features - self.input_mean) / self.input_scale
        return self.output_mean + self.output_scale * self.standardised(inputs)


class MLP(Residual):
    """A feedforward network: the paper's Baseline MLP and, on its features, PhysicsFeature-MLP (III-C).

    Tensors `layers.<i>.weight` (out, in) and `layers.<i>.bias` (out,); the activation follows every layer but
    the last.
    """

    def __init__(self, *, features: str, layers: Sequence[int], activation: str) -> None:
        if activation not in ACTIVATIONS:
            raise ValueError(f"activation '{activation}' is none of {', '.join(ACTIVATIONS)}")
        if len(layers) < 2 or layers[-1] != AXES:
            raise ValueError(f"layers {list(layers)} must end in {AXES}")
        super().__init__(inputs=layers[0], features=features)
        self.activation = ACTIVATIONS[activation]
        self.layers = nn.ModuleList(nn.Linear(wide, next_wide) for wide, next_wide in pairwise(layers))

    def standardised(self, inputs: Tensor) -> Tensor:
        """Alternate affine maps and the activation."""
        *hidden_layers, last = self.layers
        hidden = inputs
        for layer in hidden_layers:
            hidden = self.activation(layer(hidden))
        wrench: Tensor = last(hidden)
        return wrench


NETWORKS: dict[str, type[Residual]] = {"mlp": MLP, "physfeat": MLP}

ARCHITECTURES: dict[str, dict[str, Any]] = {
    "mlp": {
        "model": "mlp",
        "features": "raw",
        "layers": [12, 128, 256, 128, AXES],
        "activation": "silu",
    },
    "physfeat": {
        "model": "physfeat",
        "features": "physfeat",
        "layers": [45, 128, 256, 128, AXES],
        "activation": "silu",
    },
}


def architecture(name: str) -> dict[str, Any]:
    """Return the default description of the model `name`, free to be changed.

    Raises:
        UsageError: If there is no such model; the message lists those there are.
    """
    if name not in ARCHITECTURES:
        raise UsageError(f"no model is called '{name}': choose one of {', '.join(sorted(ARCHITECTURES))}")
    return deepcopy(ARCHITECTURES[name])


def build(architecture: Mapping[str, Any]) -> Residual:
    """Build the untrained network of a description such as `ARCHITECTURES['physfeat']`.

    Weights come from torch's global generator: seed it first.

    Raises:
        DataError: If the description names an unknown model or does not fit its constructor.
    """
    options = dict(architecture)
    name = options.pop("model", None)
    if name not in NETWORKS:
        known = ", ".join(sorted(NETWORKS))
        raise DataError(f"model architecture: unknown model '{name}': known are {known}")
    try:
        return NETWORKS[name](**options)
    except (TypeError, ValueError, RuntimeError) as error:
        raise DataError(f"model architecture: the description of '{name}' does not fit: {error}") from None


def load(model: Model) -> Residual:
    """Build the network of a model artefact, with its weights and scalers, ready to predict.

    Raises:
        DataError: If the tensors are not those that the architecture asks for.
    """
    network = build(model.architecture)
    wanted = {name: tuple(tensor.shape) for name, tensor in network.state_dict().items()}
    found = {name: tensor.shape for name, tensor in model.tensors.items()}
    for name in sorted(wanted.keys() | found.keys()):
        shape, asked = found.get(name, "missing"), wanted.get(name, "none")
        if shape != asked:
            raise DataError(
                f"model {model.name}: tensor {name} is {shape}, the architecture asks for {asked}: "
                "train the model again"
            )
    network.load_state_dict({name: torch.from_numpy(tensor.copy()) for name, tensor in model.tensors.items()})
    network.standardise(model.scalers)
    return network.eval()


def parameter_count(network: nn.Module) -> int:
    """Count the trainable numbers of a network."""
    return sum(parameter.numel() for parameter in network.parameters())
