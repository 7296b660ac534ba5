"""The temporal model: a causal convolution over the past velocities (the paper's future work, section VI).

Water remembers: a wake builds up, vortices are shed. The wrench is a feedforward function of (nu, nu_dot) now
and of nu at the control steps before, so its window is the whole memory, and the state that a simulation
carries from step to step is just those velocities. A finite window cannot drift away, as a recurrent state
can.
"""

from __future__ import annotations

from collections.abc import Sequence

from hydro.core.distillation.features import names
from hydro.core.distillation.history import remembered
from hydro.learn.networks.mlp import MLP


class Temporal(MLP):
    """An MLP on the features followed by past velocities, newest first (`distillation.history`).

    Attributes:
        window: velocities in all, the present one among them.
        period: time between them [s], the control step that a simulation must keep.
    """

    def __init__(
        self, *, features: str, layers: Sequence[int], activation: str, window: int, period: float
    ) -> None:
        wanted = len(names(features)) + remembered(window)
        if window < 2 or period <= 0.0 or layers[0] != wanted:
            raise ValueError(
                f"layers {list(layers)} must begin with {wanted} for a window of {window} velocities, "
                f"two at least, {period} s apart"
            )
        super().__init__(features=features, layers=layers, activation=activation)
        self.window = window
        self.period = period
