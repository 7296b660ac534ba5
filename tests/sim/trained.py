"""Model artefacts with random weights, and the corresponding torch networks."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import torch

from hydro.learn import networks


def trained(name, seed=0, **changes):
    """Return the content of a model artefact with random weights and scalers, and its torch network."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    architecture = networks.architecture(name) | changes
    network = networks.build(architecture)
    inputs = network.inputs
    scalers = {
        "input_mean": rng.normal(size=inputs),
        "input_scale": rng.uniform(0.5, 3.0, inputs),
        "output_mean": rng.normal(size=6),
        "output_scale": rng.uniform(5.0, 50.0, 6),
    }
    network.standardise(scalers)
    tensors = {name: value.numpy() for name, value in network.state_dict().items()}
    return network, SimpleNamespace(
        name=name,
        architecture=architecture,
        tensors=tensors,
        scalers=scalers,
        subtract="inertia",
        labelled=None,
    )
