"""Compiler from a trained model, layers and tensors, to a program for `core.residual.layers`.

Each architecture has a function that writes its steps; the last six values of the workspace are the wrench.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Array32
from hydro.core.errors import DataError
from hydro.core.residual import layers, mirrors
from hydro.core.vehicle.description import Vehicle

AXES = 6
LINE = 16
"""Float32 values per cache line; aligned blocks avoid vector loads across two lines."""
PACE = 10.0  # s, time scale of the structured model's inertia


class TrainedModel(Protocol):
    """Protocol of the parts of a trained model that a simulation needs (see `hydro.io.model.Model`)."""

    @property
    def name(self) -> str:
        """Name of the model."""

    @property
    def architecture(self) -> Mapping[str, Any]:
        """Description of the layers: `model` (kind), widths, activation and other options."""

    @property
    def tensors(self) -> Mapping[str, NDArray[Any]]:
        """Weights by name."""

    @property
    def scalers(self) -> Mapping[str, NDArray[Any]]:
        """Means and standard deviations by which features and outputs are normalised, by name."""

    @property
    def subtract(self) -> str:
        """Effects subtracted from the labels: `inertia` only, or all `effects` of the vehicle."""

    @property
    def labelled(self) -> Vehicle | None:
        """Vehicle with which the labels were made; None if unknown."""


class Place(NamedTuple):
    """Block of consecutive values in the workspace of a network.

    Attributes:
        at: Index of the first value.
        length: Number of values.
    """

    at: int
    length: int

    def part(self, start: int, length: int) -> Place:
        """Return the part of the block with `length` values from index `start` of the block on."""
        return Place(self.at + start, length)


class Writer:
    """Writer of a network's program: the list of layer operations, and all weights in one vector.

    The operations read and write one workspace, a vector of float32 values.

    Attributes:
        model: Trained model that is compiled.
        inputs: Block of the workspace with the standardised inputs.
        room: Number of values reserved in the workspace so far.
        passive: Only for a model that is passive by construction: start of the block with A, where A A^T is
            its damping matrix, and start of its weights.  None for any other model.
        physical: Whether the wrench is already in N and N m, so that no scaler follows.
    """

    def __init__(self, model: TrainedModel, inputs: int) -> None:
        self.model = model
        self.inputs = Place(0, inputs)
        self.room = inputs
        self.passive: tuple[int, int] | None = None
        self.physical = False
        self._steps: list[list[float]] = []
        self._weights: list[Array32] = []

    def program(self) -> Array:
        """Return the operations of the network, one per row, (operations, layers.COLUMNS)."""
        return np.array(self._steps, dtype=np.float64).reshape(-1, layers.COLUMNS)

    def weights(self) -> Array32:
        """Return the weights of all operations in one vector, in the order in which they were added."""
        return np.concatenate(self._weights)

    def option(self, name: str) -> Any:
        """Return an entry of the architecture by name.

        Raises:
            DataError: The entry is missing.
        """
        if name not in self.model.architecture:
            raise DataError(
                f"model {self.model.name}: its architecture has no {name!r}; train the model again"
            )
        return self.model.architecture[name]

    def tensor(self, name: str, shape: tuple[int, ...]) -> Array32:
        """Return a tensor of the model by name as float32, with its shape checked.

        Raises:
            DataError: The tensor is missing or has another shape.
        """
        if name not in self.model.tensors:
            raise DataError(f"model {self.model.name}: tensor {name} is missing; train the model again")
        tensor = np.asarray(self.model.tensors[name], dtype=np.float32)
        if tensor.shape != shape:
            raise DataError(
                f"model {self.model.name}: tensor {name} has shape {tensor.shape}, its layers need {shape}"
            )
        return tensor

    def place(self, length: int) -> Place:
        """Reserve `length` values of the workspace at the start of a cache line, and return their place."""
        found = Place(_line_after(self.room), length)
        self.room = found.at + length
        return found

    def dense(self, x: Place, name: str, length: int) -> Place:
        """Append a dense layer W x + b with tensors `name.weight` (length, len x) and `name.bias` (length,).

        Args:
            x: Input block.
            name: Name of the layer.
            length: Number of outputs.

        Returns:
            Output block.

        Raises:
            DataError: A tensor is missing or has another shape.
        """
        weight = self.tensor(f"{name}.weight", (length, x.length))
        return self.affine(x, weight, self.tensor(f"{name}.bias", (length,)), self.place(length))

    def affine(self, x: Place, weight: Array32, bias: Array32, to: Place) -> Place:
        """Append a dense layer W x + b with given weights; return its output block.

        Args:
            x: Input block.
            weight: W, (outputs, inputs).
            bias: b, (outputs,).
            to: Output block.

        Raises:
            DataError: The number of columns of W differs from the length of x.
        """
        if weight.shape[1] != x.length:
            raise DataError(
                f"model {self.model.name}: a layer of {weight.shape[1]} inputs receives {x.length}; "
                "train the model again"
            )
        at = self._keep(weight.T.ravel(), bias)
        return self._step(layers.DENSE, x, to, weights=at)

    def activate(self, function: str, x: Place) -> Place:
        """Append an activation function that changes a block in place; return the block.

        Args:
            function: Key of `layers.FUNCTIONS`.
            x: The block.

        Raises:
            DataError: The function is unknown.
        """
        if function not in layers.FUNCTIONS:
            known = ", ".join(layers.FUNCTIONS)
            raise DataError(f"model {self.model.name}: unknown activation {function!r}; known are {known}")
        return self._step(layers.ACTIVATE, x, x, argument=layers.FUNCTIONS[function])

    def chain(self, x: Place, name: str, widths: Sequence[int], function: str) -> Place:
        """Append dense layers `name.0`, `name.1`, …, with an activation after all but the last.

        Args:
            x: Input block.
            name: Common part of the names of the layers.
            widths: Number of inputs, then the number of outputs of each layer.
            function: Key of `layers.FUNCTIONS`.

        Returns:
            Output block.
        """
        for i, width in enumerate(widths[1:]):
            x = self.dense(x, f"{name}.{i}", width)
            if i + 2 < len(widths):
                self.activate(function, x)
        return x

    def norm(self, x: Place, name: str) -> Place:
        """Append a layer norm of block `x` with tensors `name.weight` and `name.bias`; return its output."""
        parts = (self.tensor(f"{name}.{part}", (x.length,)) for part in ("weight", "bias"))
        return self._step(layers.NORM, x, self.place(x.length), weights=self._keep(*parts))

    def add(self, x: Place, to: Place) -> Place:
        """Append the addition of block x to block `to`, which changes in place; return `to`."""
        return self._step(layers.ADD, x, to)

    def mix(self, shares: Place, vectors: Place, length: int) -> Place:
        """Append a weighted sum of vectors; return its output block.

        Args:
            shares: Block with one weight for each vector.
            vectors: Block with all vectors, one after another.
            length: Length of a vector.
        """
        source = Place(vectors.at, shares.length)
        return self._step(layers.MIX, source, self.place(length), argument=shares.at)

    def direction(self, scale: Array) -> Place:
        """Append the seven features of the direction and size of motion; return their output block.

        Args:
            scale: Velocities by which those of the six axes are divided, (6,) [m/s, rad/s].
        """
        return self._step(layers.DIRECTION, self.inputs, self.place(AXES + 1), weights=self._keep(scale))

    def dissipate(self, A: Place, inertia: Array, root: Array, scale: Array) -> Place:
        """Append the wrench C(nu) nu + D(nu) nu of a passive model; return its output block of six values.

        The wrench is in N and N m, so no scaler follows.

        Args:
            A: Block of the 36 numbers of A, in D = (1 + |nu|) R A A^T R.
            inertia: Symmetric inertia matrix that defines C, (6, 6).
            root: Diagonal r of R, (6,).
            scale: Velocity scales v, (6,) [m/s, rad/s].
        """
        at = self._keep(inertia.ravel(), root, 1.0 / (AXES * scale**2))
        self.passive = A.at, at
        self.physical = True
        return self._step(layers.PASSIVE, A, self.place(AXES), weights=at)

    def mirrored(self, weights: Sequence[Array32], points: int) -> Place:
        """Append the wrench of radial basis functions with mirror symmetry; return its block of six values.

        The wrench is in N and N m, so no scaler follows.

        Args:
            weights: Vectors of weights that together have the order of `core.residual.mirrors`.
            points: Number of centres of radial basis functions.
        """
        self.physical = True
        to, at = self.place(AXES), self._keep(*weights)
        return self._step(layers.MIRRORED, self.inputs, to, weights=at, argument=points)

    def _step(self, operation: int, x: Place, to: Place, *, weights: int = 0, argument: int = 0) -> Place:
        """Append an operation to the program; return its output block `to`."""
        self._steps.append([operation, x.at, x.length, to.at, to.length, weights, argument])
        return to

    def _keep(self, *parts: NDArray[Any]) -> int:
        """Store weights at the start of a cache line; return their offset."""
        before = sum(map(len, self._weights))
        at = _line_after(before)
        own = [np.asarray(part, dtype=np.float32).ravel() for part in parts]
        self._weights += [np.zeros(at - before, dtype=np.float32), *own]
        return at


def _line_after(count: int) -> int:
    """Return the first index of a cache line that is not below `count`."""
    return -(-count // LINE) * LINE


def _feedforward(writer: Writer) -> None:
    """Write a chain of dense layers."""
    widths = [int(width) for width in writer.option("layers")]
    function = writer.option("activation")
    if widths[0] != writer.inputs.length or widths[-1] != AXES:
        raise DataError(
            f"model {writer.model.name}: layers {widths} do not lead from features "
            f"{writer.option('features')} to 6 axes"
        )
    writer.chain(writer.inputs, "layers", widths, function)


def _residual_blocks(writer: Writer) -> None:
    """Write a projection, residual blocks with layer norms, and an output layer."""
    width, hidden = writer.option("width"), writer.option("hidden")
    function = writer.option("activation")
    x = writer.dense(writer.inputs, "project", width)
    for i in range(writer.option("blocks")):
        inner = writer.dense(writer.norm(x, f"blocks.{i}.norm"), f"blocks.{i}.up", hidden)
        writer.add(writer.dense(writer.activate(function, inner), f"blocks.{i}.down", width), x)
    writer.dense(writer.norm(x, "norm"), "out", AXES)


def _heads(writer: Writer) -> None:
    """Write a common trunk and a hidden layer and an output for each axis."""
    trunk, head = writer.option("trunk"), writer.option("head")
    function = writer.option("activation")
    x = writer.activate(function, writer.chain(writer.inputs, "trunk", trunk, function))
    hidden = writer.activate(function, writer.dense(x, "hidden", AXES * head))
    out, bias = writer.tensor("out", (AXES, head)), writer.tensor("out_bias", (AXES,))
    wrench = writer.place(AXES)
    for axis in range(AXES):
        own = hidden.part(head * axis, head)
        writer.affine(own, out[axis : axis + 1], bias[axis : axis + 1], wrench.part(axis, 1))


def _experts(writer: Writer) -> None:
    """Write several chains of dense layers, and their mean by the weights of a gate network."""
    count, widths = writer.option("experts"), writer.option("layers")
    function = writer.option("activation")
    gate = writer.chain(writer.inputs, "gate", writer.option("gate"), function)
    shares = writer.activate("softmax", gate)
    maps = [
        (
            writer.tensor(f"experts.{i}.weight", (count, narrow, wide)),
            writer.tensor(f"experts.{i}.bias", (count, narrow)),
        )
        for i, (wide, narrow) in enumerate(pairwise(widths))
    ]
    opinions = writer.place(count * AXES)
    for expert in range(count):
        x = writer.inputs
        for weight, bias in maps[:-1]:
            to = writer.place(weight.shape[1])
            x = writer.activate(function, writer.affine(x, weight[expert], bias[expert], to))
        weight, bias = maps[-1]
        writer.affine(x, weight[expert], bias[expert], opinions.part(AXES * expert, AXES))
    writer.mix(shares, opinions, AXES)


def _structured(writer: Writer) -> None:
    """Write a passive model: inertia and a damping matrix that depends on the direction of motion."""
    velocity = np.asarray(writer.model.scalers["input_scale"], dtype=np.float64)[:AXES]
    root = np.sqrt(np.asarray(writer.model.scalers["output_scale"], dtype=np.float64) / velocity)
    inertia = writer.tensor("inertia", (AXES, AXES)).astype(np.float64)
    inertia = 0.5 * PACE * (inertia + inertia.T) * np.outer(root, root)
    A = writer.chain(writer.direction(velocity), "layers", writer.option("layers"), "silu")
    writer.dissipate(A, inertia, root, velocity)


def _gp(writer: Writer) -> None:
    """Write a model of radial basis functions with mirror symmetry."""
    count, tensor = writer.option("points"), writer.tensor
    stages, sums, powers = mirrors.STAGES, mirrors.SUMS, mirrors.POWERS
    shapes = {
        "centre": (3,),
        "scale": (AXES,),
        "top": (1,),
        "steering": (AXES, 3),
        "linear": (stages, AXES, AXES),
        "library": (stages, powers, mirrors.PRODUCTS, AXES),
    }
    own = tensor("weights", (count, stages, sums, powers, AXES)).reshape(count, -1)
    points = np.hstack([tensor("points", (count, AXES)), own])
    writer.mirrored([*(tensor(name, shape) for name, shape in shapes.items()), points], count)


WRITERS: dict[str, Callable[[Writer], None]] = {
    "mlp": _feedforward,
    "physfeat": _feedforward,
    "temporal": _feedforward,
    "resmlp": _residual_blocks,
    "multihead": _heads,
    "moe": _experts,
    "structured": _structured,
    "gp": _gp,
}


def lower(model: TrainedModel, inputs: int) -> Writer:
    """Compile a trained model; return the writer that holds its program and its weights.

    Args:
        model: The trained model.
        inputs: Number of inputs of the network.

    Raises:
        DataError: The architecture is unknown, or its tensors do not fit it.
    """
    kind = model.architecture.get("model")
    if kind not in WRITERS:
        raise DataError(
            f"model {model.name}: unknown architecture {kind!r} for the simulation; "
            f"known are {', '.join(WRITERS)}"
        )
    writer = Writer(model, inputs)
    WRITERS[kind](writer)
    return writer
