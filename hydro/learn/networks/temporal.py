"""Temporal model: a causal convolution over past velocities (future work in Wu et al., section VI).

Water has memory: a wake builds up, and vortices are shed.  The wrench is a feedforward function of the
present (nu, nu_dot) and of nu at previous control steps.  The window is the whole memory, so a simulation
carries only these velocities from step to step.  Unlike a recurrent state, a finite window cannot drift.
"""

from __future__ import annotations

from collections.abc import Sequence

from hydro.core.distillation.features import names
from hydro.core.distillation.history import memory_size
from hydro.learn.networks.mlp import MLP


class Temporal(MLP):
    """Multilayer perceptron on the features and on past velocities, which follow the features, newest first.

    Attributes:
        window: number of velocities, including the present one.
        period: time between them [s], which must equal the control step of a simulation.
    """

    def __init__(
        self, *, features: str, layers: Sequence[int], activation: str, window: int, period: float
    ) -> None:
        wanted = len(names(features)) + memory_size(window)
        if window < 2 or period <= 0.0 or layers[0] != wanted:
            raise ValueError(
                f"layers {list(layers)} must begin with {wanted} for a window of {window} velocities, "
                f"two at least, {period} s apart"
            )
        super().__init__(features=features, layers=layers, activation=activation)
        self.window = window
        self.period = period
