"""Shots of a candidate whose current or velocity log the model of the hull is asked about as well.

A hull's wrench depends on the motion through the water, and that on what a candidate takes for current and
for errors of its velocity log: both change the correction of the shots, not the prediction alone.  Here
residuals are worked out anew for every candidate, and derivatives are differences of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import ENDLESS, SHOTS_TOGETHER, prepare, residuals
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.shots import CHANNELS
from hydro.core.residual.hull import Law
from hydro.core.residual.response import Transitions
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class AskedAnew:
    """A problem of `levenberg_marquardt` over shots as measured.

    Attributes:
        law: The hull's wrench beside the file's.
        transitions: How deviations go on in the shots, for all candidates.
        beginnings: What deviations of the first row make of the rows that are compared, in units of the
            noise, (S, K, 12), K numbers a shot, orthonormal.
    """

    law: Law
    transitions: Transitions
    beginnings: Array

    @classmethod
    def of(cls, law: Law, transitions: Transitions) -> AskedAnew:
        """Prepare the shots of some transitions."""
        shots, found = transitions.shots, list[Array]()
        for begin in range(0, len(shots.starts), SHOTS_TOGETHER):
            part = slice(begin, begin + SHOTS_TOGETHER)
            none = np.zeros((len(shots.starts[part]), shots.length, 6, CHANNELS))
            answers = transitions.answers(part, none, np.eye(CHANNELS))[:, shots.lead :]
            answers /= shots.sigma[:, None]
            if (counted := shots.weights(part)) is not None:
                answers[~counted] = 0.0
            found.append(np.linalg.qr(answers.reshape(len(answers), -1, CHANNELS))[0])
        return cls(law, transitions, np.concatenate(found))

    def linearise(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Normal:
        """The least-squares problem about a vehicle, by differences."""
        here = self._left(base)
        columns = [(here - self._left(other)) / step for other, step in zip(moved, steps, strict=True)]
        flat = np.stack([*columns, here], axis=-1)
        flat[~(np.abs(flat) < ENDLESS).all(axis=(1, 2))] = 0.0
        shots = self.transitions.shots
        channels = (here.reshape(len(here), -1, CHANNELS) ** 2).sum(axis=1)
        follow = np.zeros((len(here), CHANNELS, len(columns) + 1))
        compared = shots.residuals if shots.seen is None else shots.seen[:, shots.lead :].sum(axis=(1, 2))
        gram = np.einsum("ski,skj->sij", flat, flat)
        return Normal(gram, np.maximum(compared - CHANNELS, 1.0), channels, follow)

    def cost(self, vehicle: Vehicle, step: Array, normal: Normal) -> tuple[float, AskedAnew]:
        """Sum of squares of a vehicle; the beginnings have no values of their own."""
        return float((self._left(vehicle) ** 2).sum()), self

    def reweighted(self, normal: Normal) -> tuple[AskedAnew, bool]:
        """The weights stay."""
        return self, False

    def _left(self, vehicle: Vehicle) -> Array:
        """Residuals in units of the noise with the beginnings eliminated, (S, K)."""
        shots = self.transitions.shots
        corrected = OutputError(self.transitions.corrected(self.law.wrench(vehicle, shots)))
        begun = corrected.at_measured_states(vehicle).shots
        error = residuals(prepare(candidate(vehicle), begun), begun)
        flat = np.nan_to_num(error.reshape(len(error), -1), nan=ENDLESS, posinf=ENDLESS, neginf=-ENDLESS)
        own = np.einsum("skc,sk->sc", self.beginnings, flat)
        return np.asarray(flat - np.einsum("skc,sc->sk", self.beginnings, own))
