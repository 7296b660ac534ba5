"""Compiled forward pass of a trained residual network, shared by shots and simulation.

The steps are features, a program of layers (`core.residual.layers`, written by `core.residual.lowering`), and
scaling to physical units.  The caller supplies past velocities for networks with memory
(`sim.residual.control` keeps them among MuJoCo's activations).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array, Array32
from hydro.core.compiled import jit, kernel
from hydro.core.distillation import history
from hydro.core.distillation.features import names, physfeat_kernel
from hydro.core.errors import DataError
from hydro.core.residual import layers
from hydro.core.residual.lowering import TrainedModel, lower
from hydro.core.residual.mirrors import SCRATCH

_STATES, _AXES = 12, 6
_SCALERS = ("input_mean", "input_scale", "output_mean", "output_scale")


@dataclass(frozen=True)
class Network:
    """Compiled residual network: (nu, nu_dot) and past nu -> features -> layers -> tau_res.

    Attributes:
        program: Steps of `core.residual.layers`.
        weights: Weights of all steps, concatenated.
        room: Size of the workspace in values: the inputs first, the wrench last.
        physfeat: Whether the features are the 45 of `distillation.features`; otherwise the twelve states.
        memory: Number of past velocity components in the input, 6 per past time.
        period: Time between past velocities [s]; None for a model without memory.
        scalers: Input means and scales, output means and scales, concatenated.
        passive: For a passive model, the index of A in the workspace and the offset of its weights, as in
            `lowering.Writer`; None for other models.
    """

    program: Array
    weights: Array32
    room: int
    physfeat: bool
    memory: int
    period: float | None
    scalers: Array
    passive: tuple[int, int] | None = None

    @property
    def inputs(self) -> int:
        """Number of features and past velocities together."""
        return (len(self.scalers) - 2 * _AXES) // 2

    @staticmethod
    def of(model: TrainedModel) -> Network:
        """Return the compiled network of a trained model.

        Raises:
            DataError: The architecture is unknown, or its tensors do not fit it.
        """
        description = model.architecture
        feature_set = description.get("features", "")
        memory = history.memory_size(description.get("window", 1))
        inputs = len(names(feature_set)) + memory
        scalers = {key: np.asarray(model.scalers[key], dtype=np.float64).ravel() for key in _SCALERS}
        if (found := [values.size for values in scalers.values()]) != [inputs, inputs, _AXES, _AXES]:
            raise DataError(
                f"model {model.name}: its scalers have {found[0]} inputs and {found[2]} outputs, but its "
                f"architecture has {inputs} and {_AXES}; train the model again"
            )
        written = lower(model, inputs)
        if written.physical:  # its wrench is in N and N m already, with no mean added
            scalers |= {"output_mean": np.zeros(_AXES), "output_scale": np.ones(_AXES)}
        return Network(
            program=written.program(),
            weights=written.weights(),
            room=written.room,
            physfeat=feature_set == "physfeat",
            memory=memory,
            period=float(description["period"]) if memory else None,
            scalers=np.concatenate(list(scalers.values())),
            passive=written.passive,
        )

    def wrench(self, states: ArrayLike, past: ArrayLike | None = None) -> Array:
        """Return the residual wrench tau_res of N states.

        Args:
            states: Velocity and acceleration (nu, nu_dot), FRD, (N, 12) [m/s, rad/s, m/s^2, rad/s^2].
            past: Past velocities, newest first, (N, memory) [m/s, rad/s]; by default the present velocity.

        Returns:
            tau_res about CO (N, 6) [N, N m], FRD, on the left-hand side of the equation of motion.

        Raises:
            DataError: The past velocities have the wrong shape.
        """
        x = np.ascontiguousarray(states, dtype=np.float64).reshape(-1, _STATES)
        before = np.tile(x[:, :_AXES], self.memory // _AXES) if past is None else np.asarray(past, float)
        if before.shape != (len(x), self.memory):
            raise DataError(f"past velocities: expected shape {(len(x), self.memory)}, got {before.shape}")
        out = np.empty((len(x), _AXES))
        network = Weights(self.program, self.weights, self.physfeat, self.scalers)
        work, scratch = np.empty(self.room, np.float32), np.empty(self.inputs + SCRATCH)
        _network_columns(network, x, np.ascontiguousarray(before), work, scratch, out)
        return out


class Weights(NamedTuple):
    """Network data for the compiled kernel: the fields of `Network` of the same names."""

    program: Array
    weights: Array32
    physfeat: bool
    scalers: Array


@kernel
def network_kernel(
    network: Weights, state: Array, memory: Array, work: Array32, scratch: Array, out: Array
) -> None:
    """Write the residual wrench tau_res of one state to `out`.

    Args:
        network: Network data.
        state: nu and nu_dot, (12,).
        memory: Past velocities, (`Network.memory`,).
        work: Workspace, (`Network.room`,).
        scratch: Workspace in float64, (inputs + `mirrors.SCRATCH`,).
        out: Output: tau_res, (6,) [N, N m].
    """
    scalers = network.scalers
    inputs = (scalers.size - 2 * out.size) // 2
    own = inputs - memory.size
    features = scratch[:inputs]
    if network.physfeat:
        physfeat_kernel(state, features[:own])
    else:
        for j in range(own):
            features[j] = state[j]
    for j in range(memory.size):
        features[own + j] = memory[j]
    for j in range(inputs):
        work[j] = np.float32((features[j] - scalers[j]) / scalers[inputs + j])
    layers.run(network.program, network.weights, state[:6], work, scratch[inputs:])
    last = work.size - out.size
    for j in range(out.size):
        out[j] = scalers[2 * inputs + j] + scalers[2 * inputs + out.size + j] * work[last + j]


@jit
def _network_columns(
    network: Weights, states: Array, past: Array, work: Array32, scratch: Array, out: Array
) -> None:
    """Write tau_res of many states (N, 12) to `out` (N, 6)."""
    for k in range(states.shape[0]):
        network_kernel(network, states[k], past[k], work, scratch, out[k])
