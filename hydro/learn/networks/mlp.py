"""Feedforward network: Baseline MLP of Wu et al. (III-C) and, with its features, PhysicsFeature-MLP."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from hydro.learn.networks.residual import AXES, Residual, chain, function


class MLP(Residual):
    """Multilayer perceptron: affine maps with an activation after every one except the last.

    Tensors `layers.<i>.weight` (out, in) and `layers.<i>.bias` (out,).
    """

    def __init__(self, *, features: str, layers: Sequence[int], activation: str) -> None:
        if len(layers) < 2 or layers[-1] != AXES:
            raise ValueError(f"layers {list(layers)} must end in {AXES}")
        super().__init__(inputs=layers[0], features=features)
        self.activation = function(activation)
        self.layers = chain(layers)

    def standardised(self, inputs: Tensor) -> Tensor:
        """Return the standardised wrench (N, 6) for standardised features (N, k)."""
        *hidden_layers, last = self.layers
        hidden = inputs
        for layer in hidden_layers:
            hidden = self.activation(layer(hidden))
        wrench: Tensor = last(hidden)
        return wrench
