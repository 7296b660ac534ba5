"""Mixture of experts: feedforward networks that a gate weighs by the motion (Wu et al., III-C)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from hydro.learn.networks.residual import AXES, Residual, chain, function


class Experts(nn.Module):
    """One layer of E experts, affine maps: `weight` (E, out, in) and `bias` (E, out), as in nn.Linear."""

    def __init__(self, experts: int, wide: int, next_wide: int) -> None:
        super().__init__()
        reach = wide**-0.5
        self.weight = nn.Parameter(torch.empty(experts, next_wide, wide).uniform_(-reach, reach))
        self.bias = nn.Parameter(torch.empty(experts, next_wide).uniform_(-reach, reach))

    def forward(self, x: Tensor) -> Tensor:
        """Return the outputs of the E experts (E, N, out) for their inputs (E, N, in)."""
        return torch.baddbmm(self.bias.unsqueeze(1), x, self.weight.transpose(1, 2))


class MixtureOfExperts(Residual):
    """Network whose wrench is the mean of the experts' wrenches, weighted by the softmax of a gate.

    Tensors `experts.<i>.*` (see `Experts`) and `gate.<i>.*`.
    """

    def __init__(
        self, *, features: str, experts: int, layers: Sequence[int], gate: Sequence[int], activation: str
    ) -> None:
        if layers[-1] != AXES or gate[0] != layers[0] or gate[-1] != experts:
            raise ValueError(
                f"layers {list(layers)} must end in {AXES} and gate {list(gate)} lead from "
                f"{layers[0]} to {experts}"
            )
        super().__init__(inputs=layers[0], features=features)
        self.activation = function(activation)
        self.experts = nn.ModuleList(Experts(experts, wide, narrow) for wide, narrow in pairwise(layers))
        self.gate = chain(gate)
        self.count = experts

    def standardised(self, inputs: Tensor) -> Tensor:
        """Return the standardised wrench (N, 6), a mean of experts, for standardised features (N, k)."""
        *hidden_layers, last = self.experts
        x = inputs.unsqueeze(0).expand(self.count, -1, -1)
        for layer in hidden_layers:
            x = self.activation(layer(x))
        share = self.shares(inputs).transpose(0, 1).unsqueeze(2)
        wrench: Tensor = (last(x) * share).sum(dim=0)
        return wrench

    def shares(self, inputs: Tensor) -> Tensor:
        """Return the gate's weights of the experts (N, E), which sum to 1, from standardised features."""
        *hidden_layers, last = self.gate
        x = inputs
        for layer in hidden_layers:
            x = self.activation(layer(x))
        return torch.softmax(last(x), dim=1)
