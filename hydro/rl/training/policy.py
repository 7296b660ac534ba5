"""Trained policy: the result of a training, and the actor of evaluations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from tensordict.nn import NormalParamExtractor
from torch import Tensor, nn
from torchrl.modules import MLP

from hydro.core.columns import Array32
from hydro.core.errors import DataError
from hydro.rl.environment.encoding import Encoding


def layers(inputs: int, outputs: int, widths: tuple[int, ...], *, norm: bool = False) -> nn.Module:
    """Return a new multilayer perceptron with ReLU, and with layer normalisation if `norm` is true.

    Args:
        inputs: Number of inputs.
        outputs: Number of outputs.
        widths: Widths of the hidden layers.
        norm: Whether to normalise the hidden layers.
    """
    shapes = [{"normalized_shape": width} for width in widths]
    normed = {"norm_class": nn.LayerNorm, "norm_kwargs": shapes} if norm else {}
    made: nn.Module = MLP(
        in_features=inputs, out_features=outputs, num_cells=list(widths), activation_class=nn.ReLU, **normed
    )
    return made


def network(observations: int, actions: int, widths: tuple[int, ...]) -> nn.Sequential:
    """Return a new policy network from encoded observations (..., O) to mean and standard deviation (..., A).

    The two outputs describe the normal distribution of the A action components before the tanh.

    Args:
        observations: Number O of observations.
        actions: Number A of action components.
        widths: Widths of the hidden layers.
    """
    return nn.Sequential(layers(observations, 2 * actions, widths), NormalParamExtractor())


@dataclass(frozen=True)
class Policy:
    """Trained policy; a call with observations returns actions without exploration.

    Attributes:
        widths: Widths of the hidden layers.
        encoding: Encoding of observations (O,) for the network.
        weights: Tensors of the module that `network` makes, by name.
        training: Description of the training; JSON values.
    """

    widths: tuple[int, ...]
    encoding: Encoding
    weights: Mapping[str, Array32]
    training: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Build the network.

        Raises:
            DataError: The tensors do not fit the layers.
        """
        tensors = {name: torch.from_numpy(np.array(each)) for name, each in self.weights.items()}
        actions = len(next(reversed(tensors.values()))) // 2 if tensors else 0
        built = network(len(self.encoding), actions, self.widths)
        try:
            built.load_state_dict(tensors)
        except RuntimeError as error:
            raise DataError(f"policy: its tensors do not fit layers {list(self.widths)}") from error
        object.__setattr__(self, "_network", built)

    @torch.no_grad()
    def __call__(self, observations: Array32) -> Array32:
        """Return actions (N, A) at observations (N, O) in SI units: the median of the distribution."""
        return median(self._network, self.encoding(observations))  # type: ignore[attr-defined]


def encoded(observations: Tensor, scale: Tensor, fades: Tensor) -> Tensor:
    """Return observations scaled to network input (..., O): x / scale, or exp(-x / scale) for ranges.

    Args:
        observations: Observations x in SI units (..., O).
        scale: Typical size of each observation (O,).
        fades: Mask of the observations that are ranges (O,).
    """
    given = observations / scale
    return torch.where(fades, torch.exp(-given), given)


class EncodedPolicy(nn.Module):
    """Policy as one torch module that takes observations in SI units (N, O) and returns actions (N, A).

    Attributes:
        scale: Typical size of each observation, in the unit of the observation, (O,).
        fades: Mask of the ranges, whose inputs are exp(-x/scale); all other observations are divided by their
            scale, (O,).
    """

    scale: Tensor
    fades: Tensor

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.layers: nn.Module = policy._network[0]  # type: ignore[attr-defined]
        self.register_buffer("scale", torch.from_numpy(policy.encoding.scale.copy()))
        self.register_buffer("fades", torch.from_numpy(policy.encoding.fades.copy()))

    def forward(self, observations: Tensor) -> Tensor:
        """Return actions (N, A) without exploration, the median of the policy's distribution.

        Args:
            observations: Observations in SI units (N, O).
        """
        mean, _ = self.layers(encoded(observations, self.scale, self.fades)).chunk(2, dim=-1)
        actions: Tensor = mean.tanh()
        return actions


@torch.no_grad()
def median(network: nn.Module, encoded: Array32) -> Array32:
    """Return the policy's median actions (N, A) at encoded observations (N, O)."""
    actions: Array32 = network(torch.from_numpy(encoded))[0].tanh().numpy()
    return actions
