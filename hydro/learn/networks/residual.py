"""Base class of residual networks: standardisation and physical units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from hydro.io.model import SCALERS

AXES = 6  # components of a wrench
ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "relu": nn.functional.relu,
    "silu": nn.functional.silu,
    "tanh": torch.tanh,
}


class Residual(nn.Module):
    """Base class of networks from features to the wrench, both in physical units.

    A subclass implements `standardised`, the map between standardised numbers (mean 0, scale 1).

    Attributes:
        input_mean: Means of the k features, (k,); 0 before `standardise` is called.
        input_scale: Scales of the features, (k,); 1 before.
        output_mean: Means of the wrench, (6,); 0 before.
        output_scale: Scales of the wrench, (6,); 1 before.
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
        """Set the means and scales by which inputs and wrench are standardised.

        Args:
            scalers: Arrays by name: `input_mean` and `input_scale` of the k inputs, (k,), and `output_mean`
                and `output_scale` of the wrench, (6,).
        """
        for name in SCALERS:
            self.get_buffer(name).copy_(torch.from_numpy(np.asarray(scalers[name], dtype=np.float32)))

    def standardised(self, inputs: Tensor) -> Tensor:
        """Return the standardised wrench (N, 6) for standardised features (N, k)."""
        raise NotImplementedError

    def forward(self, features: Tensor) -> Tensor:
        """Return tau_res (N, 6) [N, N m], body FRD, order X Y Z K M N, for features (N, k)."""
        inputs = (features - self.input_mean) / self.input_scale
        return self.output_mean + self.output_scale * self.standardised(inputs)


def function(name: str) -> Callable[[Tensor], Tensor]:
    """Return an activation function of torch, such as ReLU, by its name.

    Raises:
        ValueError: If the name is unknown.
    """
    if name not in ACTIVATIONS:
        raise ValueError(f"activation '{name}' is none of {', '.join(ACTIVATIONS)}")
    return ACTIVATIONS[name]


def chain(widths: Sequence[int]) -> nn.ModuleList:
    """Return affine layers in sequence: the k-th maps widths[k] numbers to widths[k + 1] numbers.

    Args:
        widths: Number of inputs, widths of the hidden layers, and number of outputs.

    Raises:
        ValueError: If there are fewer than two widths.
    """
    if len(widths) < 2:
        raise ValueError(f"layers {list(widths)} need two widths or more")
    return nn.ModuleList(nn.Linear(wide, next_wide) for wide, next_wide in pairwise(widths))
