"""A trained network as a table of tensors: what `train` writes and every other stage reads, without torch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.io import table, vehicle
from hydro.io.table import Artefact

SCALERS = ("input_mean", "input_scale", "output_mean", "output_scale")
"""Names of the scalers: inputs are (x - mean) / scale, outputs mean + scale * network."""


_DESCRIBED = {"name", "architecture", "features", "scalers", "inputs", "outputs", "units", "training"}


@dataclass(frozen=True)
class Model:
    """A residual network: tau_res as a function of (nu, nu_dot).

    Attributes:
        name: name of the model, such as `physfeat`.
        architecture: description that the layers are built from; JSON values.
        tensors: weights by name in the order of the layers, all float32 or all float64.
        features: name of the feature set, see `distillation.features`.
        scalers: `SCALERS` by name, float64, shapes (n_in,) and (n_out,), fitted on the training part.
        inputs: names of the features in order, (n_in,).
        outputs: names of the outputs in order, (n_out,).
        units: unit of every input and output by name.
        training: summary of the training; JSON values.
        subtract: which effects its labels left out and a simulation must bring: `inertia`, or all `effects`.
        labelled: the vehicle that its labels were made with; None where the file does not say.
    """

    name: str
    architecture: Mapping[str, Any]
    tensors: Mapping[str, NDArray[Any]]
    features: str
    scalers: Mapping[str, Array]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Mapping[str, str]
    training: Mapping[str, Any] = field(default_factory=dict)
    subtract: str = "inertia"
    labelled: Vehicle | None = None

    @property
    def parameters(self) -> int:
        """The number of weights."""
        return sum(tensor.size for tensor in self.tensors.values())


def to_artefact(
    model: Model,
    *,
    stage: str = "train",
    parameters: Mapping[str, Any] | None = None,
    seed: int | None = None,
    inputs: Sequence[Artefact] = (),
) -> Artefact:
    """The model as an artefact; the same model gives the same bytes.

    Raises:
        DataError: a tensor is not finite, or is not of floating point.
    """
    tensors = {name: np.asarray(tensor) for name, tensor in model.tensors.items()}
    dtype = np.result_type(np.float32, *tensors.values())
    frame = pl.DataFrame(
        {
            "tensor": list(tensors),
            "shape": [list(tensor.shape) for tensor in tensors.values()],
            "data": [tensor.ravel().astype(dtype) for tensor in tensors.values()],
        },
        schema_overrides={"data": pl.List(pl.Float32 if dtype == np.float32 else pl.Float64)},
    )
    described = {
        "name": model.name,
        "architecture": dict(model.architecture),
        "features": model.features,
        "inputs": list(model.inputs),
        "outputs": list(model.outputs),
        "units": dict(model.units),
        "scalers": {name: np.asarray(model.scalers[name]).tolist() for name in SCALERS},
        "training": dict(model.training),
        "subtract": model.subtract,
    }
    made = table.make("model", frame, stage=stage, parameters=parameters, seed=seed, inputs=inputs)
    return made.of_network(described)


def from_artefact(artefact: Artefact) -> Model:
    """The model in an artefact of kind `model`.

    Raises:
        DataError: the footer does not describe a model, or a tensor's shape is not that of its data.
    """
    described, text = artefact.provenance.model or {}, artefact.provenance.vehicle
    if not described.keys() >= _DESCRIBED:
        raise DataError("model: the file's footer lacks the architecture: write it with `hydro train`")
    return Model(
        name=described["name"],
        architecture=described["architecture"],
        tensors=tensors(artefact),
        features=described["features"],
        scalers={name: np.array(described["scalers"][name]) for name in SCALERS},
        inputs=tuple(described["inputs"]),
        outputs=tuple(described["outputs"]),
        units=described["units"],
        training=described["training"],
        subtract=described.get("subtract", "inertia"),
        labelled=None if text is None else vehicle.parse(text),
    )


def tensors(artefact: Artefact) -> dict[str, NDArray[Any]]:
    """The tensors of a network's table by name, in the order of its layers.

    Raises:
        DataError: a tensor's shape is not that of its data.
    """
    dtype = np.float32 if artefact.frame.schema["data"] == pl.List(pl.Float32) else np.float64
    found: dict[str, NDArray[Any]] = {}
    for name, shape, data in artefact.frame.select("tensor", "shape", "data").iter_rows():
        if np.prod(shape, dtype=np.int64) != len(data):
            raise DataError(
                f"{artefact.kind}: tensor {name} has {len(data)} numbers, which do not fit its shape {shape}"
            )
        found[name] = np.array(data, dtype=dtype).reshape(shape)
    return found
