"""A residual network inside the simulation, evaluated at the control step and held in between (paper III-B).

At every control step: a Kalman filter for nu_dot, the network, the conditioning of its wrench.  The wrench
stands on the left-hand side of the balance, as the label does.  All that is remembered from one control step
to the next lies in MuJoCo's activations, so that it is saved, copied, reset and rolled out with the rest of
the state.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro.core.compiled import jit
from hydro.core.conditioning import COUNTS, OFF, PARAMETERS, Conditioning, condition_kernel
from hydro.core.smoothing import Design, filter_step, gains
from hydro.sim.network import Network, network_kernel

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

NOISELESS = 1e6
"""q dt^3 / R of a filter that trusts every sample: a simulated velocity carries no noise."""

# The state of one vehicle's control.
TICK = 0  # control steps begun; 0 before the first
HELD = 1  # wrench held, 6
FILTER = 7  # nu and nu_dot of each axis, 12
LOW_PASS = 19  # 6
COUNTED = 25  # how often the conditioning acted, 8
STATES = COUNTED + COUNTS

# The block of parameters.
AT_PERIOD, AT_GAINS, AT_GAIN_ROWS, AT_WIDTHS, AT_WIDTH_COUNT = range(5)
AT_ACTIVATION, AT_PHYSFEAT, AT_SCALERS, AT_WEIGHTS, AT_WEIGHT_COUNT, AT_CONDITIONING = range(5, 11)
HEADER = 12


@dataclass(frozen=True)
class Control:
    """A residual network and how it is run.

    Attributes:
        network: The network.
        period: Control step [s].
        design: Filter for nu_dot, at any sample time; by default one that trusts every sample.
        conditioning: Conditioning of the network's wrench.
    """

    network: Network
    period: float = 0.04
    design: Design | None = None
    conditioning: Conditioning = OFF

    def encode(self) -> Array:
        """The block of parameters; weights are packed two float32 to a double."""
        design = self.design or Design(self.period, (NOISELESS,) * 6, (0.0,) * 6)
        forward = gains(design.at(self.period)).forward
        network = self.network
        odd = np.zeros(len(network.weights) % 2, dtype=np.float32)
        weights = np.concatenate([network.weights, odd]).view(np.float64)
        header = np.zeros(HEADER)
        header[[AT_PERIOD, AT_GAIN_ROWS]] = self.period, len(forward)
        header[[AT_WIDTH_COUNT, AT_WEIGHT_COUNT]] = len(network.widths), len(network.weights)
        header[[AT_ACTIVATION, AT_PHYSFEAT]] = network.activation, network.physfeat
        blocks = [header]
        for entry, block in (
            (AT_GAINS, forward.ravel()),
            (AT_WIDTHS, network.widths.astype(np.float64)),
            (AT_SCALERS, network.scalers),
            (AT_CONDITIONING, self.conditioning.parameters()),
            (AT_WEIGHTS, weights),
        ):
            header[entry] = sum(map(len, blocks))
            blocks.append(block)
        return np.concatenate(blocks)


@jit
def due(block: Array, states: Array, time: float) -> bool:
    """Whether a control step has begun that is not yet counted."""
    return bool(np.floor(time / block[AT_PERIOD] + 1e-6) + 1.0 > states[TICK])


@jit
def control_kernel(block: Array, weights: Array32, states: Array, time: float, nu: Array) -> None:
    """Begin a control step: renew the held wrench from the velocity nu (6,), and count the step."""
    first = states[TICK] == 0.0
    filters = states[FILTER : FILTER + 12].reshape(6, 2)
    if first:
        for i in range(6):
            filters[i, 0] = nu[i]
            filters[i, 1] = 0.0
    else:
        row = min(int(states[TICK]), int(block[AT_GAIN_ROWS]) - 1)
        begin = int(block[AT_GAINS]) + 12 * row
        filter_step(filters, nu, block[begin : begin + 12].reshape(6, 2), block[AT_PERIOD])
    states[TICK] = np.floor(time / block[AT_PERIOD] + 1e-6) + 1.0

    count, begin = int(block[AT_WIDTH_COUNT]), int(block[AT_WIDTHS])
    widths = np.empty(count, np.int64)
    widest = 0
    for i in range(count):
        widths[i] = int(block[begin + i])
        widest = max(widest, widths[i])
    state, wrench = np.empty(12), np.empty(6)
    for i in range(6):
        state[i] = nu[i]
        state[6 + i] = filters[i, 1]
    begin = int(block[AT_SCALERS])
    network_kernel(
        widths,
        weights,
        int(block[AT_ACTIVATION]),
        block[AT_PHYSFEAT] > 0.0,
        block[begin : begin + 2 * widths[0] + 12],
        state,
        np.empty(widths[0]),
        np.empty((2, widest), np.float32),
        wrench,
    )
    begin = int(block[AT_CONDITIONING])
    condition_kernel(
        wrench,
        nu,
        block[begin : begin + PARAMETERS],
        states[LOW_PASS : LOW_PASS + 6],
        states[COUNTED : COUNTED + COUNTS],
        states[HELD : HELD + 6],
    )
