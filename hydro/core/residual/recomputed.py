"""Shots whose hull-force correction is recomputed for every candidate vehicle.

The wrench of a hull depends on the motion through the water.  A candidate's current and its DVL errors change
that motion, so they change the correction of the shots as well as the prediction.  Residuals are computed
again for every candidate here, and derivatives are finite differences of residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array
from hydro.core.prediction.multiple_shooting import ENDLESS
from hydro.core.prediction.normal_equations import Normal
from hydro.core.recording.shots import CHANNELS
from hydro.core.residual.free_law import FreeLaw, without
from hydro.core.residual.hull import Hull
from hydro.core.residual.regression import answers
from hydro.core.residual.response import Transitions
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Recomputed:
    """Least-squares problem of `levenberg_marquardt` with the hull force recomputed for every candidate.

    Attributes:
        hull: The hull-force model.
        transitions: State transitions of deviations in the shots, for all candidates.
        beginnings: Orthonormal responses of the compared rows to the initial state, in units of the noise,
            (S, K, 12), K values per shot.
        free: Freedom of the coefficients of the hull-force model; None where they are held.
    """

    hull: Hull
    transitions: Transitions
    beginnings: Array
    free: FreeLaw | None = None

    @classmethod
    def of(cls, hull: Hull, transitions: Transitions) -> Recomputed:
        """Return the problem of fitting candidates to shots, with the hull-force model held fixed.

        Args:
            hull: The hull-force model.
            transitions: The shots, with the transitions of small deviations from row to row.
        """
        shots = transitions.shots
        no_terms = np.zeros((len(shots.starts), shots.length, 0))
        parts = answers(transitions, no_terms, np.zeros(0), every=1)
        begun = [np.linalg.qr(one.reshape(len(one), -1, CHANNELS))[0] for _, one in parts]
        return cls(hull, transitions, np.concatenate(begun))

    def with_free_law(self, vehicle: Vehicle) -> Recomputed:
        """Return the problem with free hull-force coefficients, known as the earlier recording shows them.

        Args:
            vehicle: Vehicle, whose hull and water density are the units of the coefficients.
        """
        return replace(self, free=FreeLaw.of(self.hull, vehicle, self.transitions))

    def linearise(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Normal:
        """Return the least-squares problem linearised about a vehicle, by finite differences.

        A shot whose prediction diverges has an infinite cost.  A derivative that diverges counts as zero.

        Args:
            base: The vehicle.
            moved: Copies of the vehicle with one changed parameter each.
            steps: Size of each change, in the unit of the problem's parameters.
        """
        here = self._left(base)
        columns = [(here - self._left(other)) / step for other, step in zip(moved, steps, strict=True)]
        flat = np.stack([*columns, here], axis=-1)
        wild = np.asarray(~(np.abs(flat) < ENDLESS).all(axis=1))
        lost = wild[:, -1]
        flat = np.where((wild | lost[:, None])[:, None, :], 0.0, flat)
        shots = self.transitions.shots
        channels = (here.reshape(len(here), -1, CHANNELS) ** 2).sum(axis=1)
        follow = np.zeros((len(here), CHANNELS, len(columns) + 1))
        compared = shots.residuals if shots.seen is None else shots.seen[:, shots.lead :].sum(axis=(1, 2))
        gram = np.einsum("ski,skj->sij", flat, flat) if self.free is None else self.free.eliminated(flat)
        gram[lost, -1, -1] = np.inf
        return Normal(gram, np.maximum(compared - CHANNELS, 1.0), channels, follow)

    def cost(self, vehicle: Vehicle, step: Array, normal: Normal) -> tuple[float, Recomputed]:
        """Return the sum of squared residuals of a vehicle, and this problem itself, which keeps no state.

        `step` and `normal` are not used: initial states are eliminated, so they need no update.
        """
        return self.linearise(vehicle, [], []).cost, self

    def reweighted(self, normal: Normal) -> tuple[Recomputed, bool]:
        """Return the problem unchanged, and False: its weights are fixed."""
        return self, False

    def _left(self, vehicle: Vehicle) -> Array:
        """Return residuals in units of the noise with the initial states eliminated, (S, K)."""
        error = self.hull.acting(vehicle, self.transitions).at_measured_states(vehicle).residuals(vehicle)
        flat = np.nan_to_num(error.reshape(len(error), -1), nan=ENDLESS, posinf=ENDLESS, neginf=-ENDLESS)
        return without(self.beginnings, flat[..., None])[..., 0]
