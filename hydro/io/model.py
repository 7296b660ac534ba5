"""Trained network as a table of tensors, written by `train` and read without torch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, TypedDict, TypeVar

import msgspec
import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.io import table, vehicle
from hydro.io.table import Artefact

Struct = TypeVar("Struct", bound=msgspec.Struct)

SCALERS = ("input_mean", "input_scale", "output_mean", "output_scale")
"""Names of the scalers: inputs are (x - mean) / scale, outputs mean + scale * network."""


Width = Annotated[int, msgspec.Meta(ge=1, le=16384)]
"""Width or number of units of a layer; the limit rejects footers that would exhaust the memory."""
Widths = Annotated[list[Width], msgspec.Meta(min_length=2, max_length=64)]
Several = Annotated[int, msgspec.Meta(ge=1, le=1024)]


class Architecture(TypedDict, total=False):
    """Architecture of a residual network in its file: a dict whose keys depend on the model.

    Attributes:
        model: Name of the architecture, such as `physfeat`.
        features: Name of the feature set, `raw` or `physfeat`.
        layers: Widths of the hidden layers.
        trunk: Widths of the layers that all heads share.
        gate: Widths of the layers that choose among experts.
        width: Width of a residual block.
        hidden: Width of the layer inside a residual block.
        head: Width of the layer of each head.
        blocks: Number of residual blocks.
        experts: Number of experts.
        activation: Name of the activation function.
        window: Number of velocities in the input, the present one included.
        period: Time between these velocities [s].
    """

    model: str
    features: str
    layers: Widths
    trunk: Widths
    gate: Widths
    width: Width
    hidden: Width
    head: Width
    blocks: Several
    experts: Several
    activation: str
    window: Several
    period: Annotated[float, msgspec.Meta(gt=0.0)]


class Described(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Description of a network in the footer of the table of its tensors.

    Attributes:
        name: Name of the network.
        architecture: Names and sizes of its layers.
        features: Name of the feature set.
        inputs: Names of the inputs.
        outputs: Names of the outputs.
        units: Units of inputs and outputs by name.
        scalers: Means and scales of inputs and outputs by name.
        training: Description of the training.
        subtract: Effects that the labels excluded: `inertia` or `effects`.
    """

    name: str
    architecture: Architecture
    features: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str]
    scalers: dict[str, tuple[float, ...]]
    training: dict[str, Any]
    subtract: Literal["inertia", "effects"] = "inertia"


@dataclass(frozen=True)
class Model:
    """Residual network: tau_res as a function of (nu, nu_dot).

    Attributes:
        name: Name of the model, such as `physfeat`.
        architecture: Description from which the layers are built; JSON values.
        tensors: Weights by name in the order of the layers, all float32 or all float64.
        features: Name of the feature set, see `distillation.features`.
        scalers: Means and scales of inputs and outputs, named as in `SCALERS`, float64, shapes (n_in,) and
            (n_out,), fitted to the training part.
        inputs: Names of the features in order, (n_in,).
        outputs: Names of the outputs in order, (n_out,).
        units: Unit of every input and output by name.
        training: Summary of the training; JSON values.
        subtract: Effects that the labels exclude, so that a simulation must add them: `inertia`, or all
            `effects`.
        labelled: Vehicle for which the labels were computed; None if the file does not state it.
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
        """Number of weights."""
        return sum(tensor.size for tensor in self.tensors.values())


def to_artefact(
    model: Model,
    *,
    stage: str = "train",
    parameters: Mapping[str, Any] | None = None,
    seed: int | None = None,
    inputs: Sequence[Artefact] = (),
) -> Artefact:
    """Return a network as a table of tensors with provenance; the same network gives the same bytes.

    Args:
        model: The network.
        stage: Name of the command that made the network.
        parameters: Parameters of that command, besides inputs and seed; JSON values.
        seed: Seed of the training.
        inputs: Tables from which the network was made.

    Raises:
        DataError: A tensor is not finite, or not of a floating-point type.
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
    """Return the network that a table of tensors (an artefact of kind `model`) contains.

    Raises:
        DataError: The footer does not describe a model, or a tensor does not fit its shape.
    """
    said, text = described(artefact, Described, "write it with `hydro train`"), artefact.provenance.vehicle
    scalers = {name: np.array(values, dtype=np.float64) for name, values in said.scalers.items()}
    counts = {name: len(said.inputs if name.startswith("input") else said.outputs) for name in SCALERS}
    if {name: values.size for name, values in scalers.items()} != counts:
        raise DataError("model: the footer's scalers do not fit its inputs and outputs: train it again")
    if not all((values > 0.0).all() for name, values in scalers.items() if name.endswith("_scale")):
        raise DataError("model: the footer's scales must be above 0: train it again")
    if said.architecture.get("window", 1) > 1 and "period" not in said.architecture:
        raise DataError("model: the footer's architecture has a window without its period: train it again")
    return Model(
        name=said.name,
        architecture=(artefact.provenance.model or {})["architecture"],  # including keys of other networks
        tensors=tensors(artefact),
        features=said.features,
        scalers=scalers,
        inputs=said.inputs,
        outputs=said.outputs,
        units=said.units,
        training=said.training,
        subtract=said.subtract,
        labelled=None if text is None else vehicle.parse(text),
    )


def described(artefact: Artefact, kind: type[Struct], remedy: str) -> Struct:
    """Return the description of a network from the footer of its table, as a checked struct.

    Args:
        artefact: Table of tensors.
        kind: Struct type that the footer must match.
        remedy: Remedy in the error message.

    Raises:
        DataError: A key is missing, unknown or of the wrong type.
    """
    try:
        return msgspec.convert(artefact.provenance.model or {}, kind)
    except msgspec.ValidationError as error:
        raise DataError(f"{artefact.kind}: its footer does not describe one ({error}): {remedy}") from error


def tensors(artefact: Artefact) -> dict[str, NDArray[Any]]:
    """Return the tensors of a network's table by name, in the order of its layers.

    Raises:
        DataError: A tensor does not fit its shape.
    """
    dtype = np.float32 if artefact.frame.schema["data"] == pl.List(pl.Float32) else np.float64
    found: dict[str, NDArray[Any]] = {}
    for name, shape, data in artefact.frame.select("tensor", "shape", "data").iter_rows():
        if min(shape, default=0) < 0 or np.prod(shape, dtype=np.int64) != len(data):
            raise DataError(
                f"{artefact.kind}: tensor {name} has {len(data)} numbers, which do not fit its shape {shape}"
            )
        found[name] = np.array(data, dtype=dtype).reshape(shape)
    return found
