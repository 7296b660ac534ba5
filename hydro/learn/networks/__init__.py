"""Residual networks: from features to the residual wrench tau_res, both in physical units.

A plain dict describes every network; the model artefact stores it, and `build` makes the network from it.
The means and scales of inputs and outputs are buffers of the network, which standardises internally (paper
IV-C).  Callers pass features from `hydro.core.distillation.features` and receive newtons and newton metres.

The paper gives the number of weights of its models (Table I), but not all widths.  Widths that it omits are
chosen here to match the number as closely as possible:

| name       | network                                  | weights | the paper |
|------------|------------------------------------------|---------|-----------|
| mlp        | 12-128-256-128-6                         | 68,358  | "42K"     |
| resmlp     | 192 wide, 4 blocks of 80, layer norms    | 129,542 | "130K"    |
| multihead  | 12-128-256-128 and 6 heads of 60         | 114,390 | "114K"    |
| moe        | 4 experts 12-128-128-6, gate 12-64-4     | 76,892  | "77K"     |
| physfeat   | 45-128-256-128-6 on 45 features          | 72,582  | "73K"     |
| structured | C and D >= 0, D from 7-128-256-128-36     | 71,624  | -         |
| temporal   | 54-128-256-128-6 on 8 velocities         | 73,734  | -         |
| gp         | a Gaussian process, kept on 512 points   | 60,520  | -         |

The paper's widths of its baseline MLP do not give the number that it states.

To add a model: write a `Residual` in its own file, add it to `NETWORKS`, describe its default in
`ARCHITECTURES`, and define its simulation in `core.residual.lowering`.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import torch
from torch import nn

from hydro.core.distillation import history
from hydro.core.distillation.features import names
from hydro.core.errors import DataError, UsageError
from hydro.io.model import Model
from hydro.learn.networks.gaussian_process import GaussianProcess
from hydro.learn.networks.mlp import MLP
from hydro.learn.networks.moe import MixtureOfExperts
from hydro.learn.networks.multihead import MultiHead
from hydro.learn.networks.residual import AXES, Residual
from hydro.learn.networks.resmlp import ResMLP
from hydro.learn.networks.structured import Structured
from hydro.learn.networks.temporal import Temporal

NETWORKS: dict[str, type[Residual]] = {
    "mlp": MLP,
    "resmlp": ResMLP,
    "multihead": MultiHead,
    "moe": MixtureOfExperts,
    "physfeat": MLP,
    "structured": Structured,
    "temporal": Temporal,
    "gp": GaussianProcess,
}

ARCHITECTURES: dict[str, dict[str, Any]] = {
    "mlp": {"features": "raw", "layers": [12, 128, 256, 128, AXES], "activation": "silu"},
    "resmlp": {"features": "raw", "width": 192, "hidden": 80, "blocks": 4, "activation": "silu"},
    "multihead": {"features": "raw", "trunk": [12, 128, 256, 128], "head": 60, "activation": "silu"},
    "moe": {
        "features": "raw",
        "experts": 4,
        "layers": [12, 128, 128, AXES],
        "gate": [12, 64, 4],
        "activation": "silu",
    },
    "physfeat": {"features": "physfeat", "layers": [45, 128, 256, 128, AXES], "activation": "silu"},
    "structured": {"features": "raw", "layers": [7, 128, 256, 128, AXES * AXES]},
    "temporal": {
        "features": "raw",
        "layers": [54, 128, 256, 128, AXES],
        "activation": "silu",
        "window": 8,
        "period": 0.04,
    },
    "gp": {"features": "raw", "points": 512},
}


def architecture(name: str) -> dict[str, Any]:
    """Return a copy of the default description (layers, features) of the network `name`, such as `physfeat`.

    Raises:
        UsageError: If the model is unknown; the message lists the known ones.
    """
    if name not in ARCHITECTURES:
        raise UsageError(f"no model is called '{name}': choose one of {', '.join(ARCHITECTURES)}")
    return {"model": name} | deepcopy(ARCHITECTURES[name])


def inputs(architecture: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of a network's inputs, in order: its features, then past velocities, if any.

    Args:
        architecture: Description of the network, as `architecture` returns it.
    """
    return names(architecture["features"]) + history.names(architecture.get("window", 1))


def build(architecture: Mapping[str, Any]) -> Residual:
    """Return the untrained network of a description such as `architecture('physfeat')`.

    Initial weights come from torch's global generator; seed it first.

    Raises:
        DataError: If the model is unknown or the description does not fit its constructor.
    """
    options = dict(architecture)
    name = options.pop("model", None)
    if name not in NETWORKS:
        raise DataError(f"model architecture: unknown model {name!r}: known are {', '.join(NETWORKS)}")
    try:
        return NETWORKS[name](**options)
    except (TypeError, ValueError, RuntimeError, IndexError) as error:
        reason = " ".join(str(error).split())
        raise DataError(f"model architecture: the description of '{name}' does not fit: {reason}") from None


def load(model: Model) -> Residual:
    """Return the network of a stored model, with its weights and scalers, ready to predict.

    Raises:
        DataError: If the tensors do not fit the architecture.
    """
    with torch.device("meta"):  # shapes without memory: a broken footer may describe a huge network
        shapes = build(model.architecture)
    wanted = {name: tuple(tensor.shape) for name, tensor in shapes.state_dict().items()}
    found = {name: tensor.shape for name, tensor in model.tensors.items()}
    for name in sorted(wanted.keys() | found.keys()):
        shape, required = found.get(name, "missing"), wanted.get(name, "none")
        if shape != required:
            raise DataError(
                f"model {model.name}: tensor {name} is {shape}, the architecture requires {required}: "
                "train the model again"
            )
    network = build(model.architecture)
    network.load_state_dict({name: torch.from_numpy(tensor.copy()) for name, tensor in model.tensors.items()})
    network.standardise(model.scalers)
    return network.eval()


def parameter_count(network: nn.Module) -> int:
    """Return the number of trainable parameters of a network."""
    return sum(parameter.numel() for parameter in network.parameters())
