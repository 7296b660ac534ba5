"""MultiHead network: a common trunk and one small head per axis of the wrench (Wu et al., III-C)."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from hydro.learn.networks.residual import AXES, Residual, chain, function


class MultiHead(Residual):
    """Network with a trunk as wide as the Baseline MLP, and a head with one hidden layer for each axis.

    Tensors: `trunk.<i>.*`; `hidden.weight` (6 head, in) and `hidden.bias`, the hidden layers of the heads of
    X, Y, Z, K, M, N in this order; `out` (6, head) and `out_bias` (6,), their output layers.
    """

    def __init__(self, *, features: str, trunk: Sequence[int], head: int, activation: str) -> None:
        super().__init__(inputs=trunk[0], features=features)
        self.activation = function(activation)
        self.trunk = chain(trunk)
        self.hidden = nn.Linear(trunk[-1], AXES * head)
        reach = head**-0.5
        self.out = nn.Parameter(torch.empty(AXES, head).uniform_(-reach, reach))
        self.out_bias = nn.Parameter(torch.empty(AXES).uniform_(-reach, reach))

    def standardised(self, inputs: Tensor) -> Tensor:
        """Return the standardised wrench (N, 6), from one head per axis, for standardised features (N, k)."""
        x = inputs
        for layer in (*self.trunk, self.hidden):
            x = self.activation(layer(x))
        wrench: Tensor = (x.reshape(-1, *self.out.shape) * self.out).sum(dim=2) + self.out_bias
        return wrench
