"""The forward pass of a trained residual network in compiled code, for use inside the simulation.

Weights are float32 as torch trained them, transposed so that the inner loop runs along a row, and laid end to
end. Every sum has a fixed order, so a wrench does not depend on how many vehicles are computed together or on
which thread; it agrees with torch to a few float32 roundings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydro.core.compiled import jit
from hydro.core.errors import DataError
from hydro.core.features import names, physfeat_kernel

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

ACTIVATIONS = {"relu": 0, "silu": 1}
_STATES, _AXES = 12, 6


class TrainedModel(Protocol):
    """What of a model artefact a simulation needs (see `hydro.io.model.Model`)."""

    @property
    def name(self) -> str:
        """Name of the model."""

    @property
    def architecture(self) -> Mapping[str, Any]:
        """Description of its layers."""

    @property
    def tensors(self) -> Mapping[str, NDArray[Any]]:
        """Weights by name."""

    @property
    def scalers(self) -> Mapping[str, NDArray[Any]]:
        """Means and scales of features and outputs."""

    @property
    def subtract(self) -> str:
        """Which effects its labels left out: `inertia`, or all `effects`."""


@dataclass(frozen=True)
class Network:
    """A feedforward residual network: (nu, nu_dot) -> features -> layers -> tau_res.

    Attributes:
        widths: Numbers of units from the features to the six outputs, (L + 1,).
        weights: For each layer the transposed matrix (in, out) row by row, then the bias, end to end.
        activation: A value of `ACTIVATIONS`, used after every layer but the last.
        physfeat: Whether the features are the 45 of `core.features`; otherwise the twelve states.
        scalers: Input means and scales, output means and scales, end to end.
    """

    widths: NDArray[np.int64]
    weights: Array32
    activation: int
    physfeat: bool
    scalers: Array

    @staticmethod
    def of(model: TrainedModel) -> Network:
        """The compiled form of a model artefact.

        Raises:
            DataError: The architecture is not a plain feedforward network, or its tensors do not fit it.
        """
        description = model.architecture
        try:
            widths = [int(width) for width in description["layers"]]
            activation, features = description["activation"], description["features"]
        except KeyError as missing:
            raise DataError(
                f"model {model.name}: the simulation runs plain feedforward networks only, and this one's "
                f"architecture has no {missing}"
            ) from None
        if activation not in ACTIVATIONS:
            known = ", ".join(ACTIVATIONS)
            raise DataError(
                f"model {model.name}: activation {activation!r} is not known here; known are {known}"
            )
        if widths[0] != len(names(features)) or widths[-1] != _AXES:
            raise DataError(
                f"model {model.name}: layers {widths} do not lead from features {features} to 6 axes"
            )
        parts = []
        for i, (wide, next_wide) in enumerate(pairwise(widths)):
            weight = _tensor(model, f"layers.{i}.weight", (next_wide, wide))
            parts += [weight.T.ravel(), _tensor(model, f"layers.{i}.bias", (next_wide,))]
        scalers = [
            np.asarray(model.scalers[key], dtype=np.float64).reshape(length)
            for key, length in (
                ("input_mean", widths[0]),
                ("input_scale", widths[0]),
                ("output_mean", _AXES),
                ("output_scale", _AXES),
            )
        ]
        return Network(
            widths=np.array(widths, dtype=np.int64),
            weights=np.concatenate(parts).astype(np.float32),
            activation=ACTIVATIONS[activation],
            physfeat=features == "physfeat",
            scalers=np.concatenate(scalers),
        )

    def wrench(self, states: ArrayLike) -> Array:
        """The wrench tau_res (N, 6) [N, N m], FRD, on the left-hand side, of states (nu, nu_dot) (N, 12)."""
        x = np.ascontiguousarray(states, dtype=np.float64).reshape(-1, _STATES)
        out = np.empty((len(x), _AXES))
        _network_columns(self.widths, self.weights, self.activation, self.physfeat, self.scalers, x, out)
        return out


def _tensor(model: TrainedModel, name: str, shape: tuple[int, ...]) -> Array32:
    """A tensor of the model as float32, checked for its shape."""
    if name not in model.tensors:
        raise DataError(f"model {model.name}: tensor {name} is missing; train the model again")
    tensor = np.asarray(model.tensors[name], dtype=np.float32)
    if tensor.shape != shape:
        raise DataError(
            f"model {model.name}: tensor {name} has shape {tensor.shape}, its layers ask for {shape}"
        )
    return tensor


@jit
def _affine(weights: Array32, start: int, wide: int, x: Array32, out: Array32) -> None:
    """Write W^T x + b to `out`, four inputs per pass over it."""
    length = out.size
    bias = weights[start + wide * length : start + (wide + 1) * length]
    for j in range(length):
        out[j] = bias[j]
    fours = wide - wide % 4
    for i in range(0, fours, 4):
        at = start + i * length
        a, b, c, d = x[i], x[i + 1], x[i + 2], x[i + 3]
        first, second = weights[at : at + length], weights[at + length : at + 2 * length]
        third, fourth = weights[at + 2 * length : at + 3 * length], weights[at + 3 * length : at + 4 * length]
        for j in range(length):
            out[j] += (a * first[j] + b * second[j]) + (c * third[j] + d * fourth[j])
    for i in range(fours, wide):
        row = weights[start + i * length : start + (i + 1) * length]
        for j in range(length):
            out[j] += x[i] * row[j]


@jit
def _activate(activation: int, x: Array32) -> None:
    """Apply the activation in place."""
    one = np.float32(1.0)
    if activation == 1:
        for j in range(x.size):
            x[j] = x[j] / (one + np.exp(-x[j]))
    else:
        for j in range(x.size):
            x[j] = max(x[j], np.float32(0.0))


@jit
def network_kernel(
    widths: NDArray[np.int64],
    weights: Array32,
    activation: int,
    physfeat: bool,
    scalers: Array,
    state: Array,
    features: Array,
    work: Array32,
    out: Array,
) -> None:
    """Write tau_res (6,) of one state (12,) to `out`.

    `features` (widths[0],) float64 and `work` (2, max(widths)) float32 are scratch.
    """
    inputs, layers = widths[0], widths.size - 1
    if physfeat:
        physfeat_kernel(state, features)
    else:
        for j in range(inputs):
            features[j] = state[j]
    for j in range(inputs):
        work[0, j] = np.float32((features[j] - scalers[j]) / scalers[inputs + j])
    start = 0
    for layer in range(layers):
        wide, next_wide = widths[layer], widths[layer + 1]
        hidden = work[(layer + 1) % 2, :next_wide]
        _affine(weights, start, wide, work[layer % 2], hidden)
        if layer + 1 < layers:
            _activate(activation, hidden)
        start += (wide + 1) * next_wide
    for j in range(out.size):
        out[j] = scalers[2 * inputs + j] + scalers[2 * inputs + out.size + j] * work[layers % 2, j]


@jit
def _network_columns(
    widths: NDArray[np.int64],
    weights: Array32,
    activation: int,
    physfeat: bool,
    scalers: Array,
    states: Array,
    out: Array,
) -> None:
    features, work = np.empty(widths[0]), np.empty((2, widths.max()), np.float32)
    for k in range(states.shape[0]):
        network_kernel(widths, weights, activation, physfeat, scalers, states[k], features, work, out[k])
