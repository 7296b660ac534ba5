"""Hull-force coefficients that follow a recording after a change as well as the one before it.

The earlier recording determines a coefficient only where it excites it.  A vehicle that is held level shows
nothing of its inertia in roll; with a weak thruster it rolls.  With the coefficients held fixed, the change
would absorb their error.  So they are free in the fit of the changes: a normal distribution about their
values, with the information of the earlier recording, takes its part.  Both recordings count in units of the
same mean squared residual, the floor of the hull-force model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array
from hydro.core.prediction.multiple_shooting import ENDLESS
from hydro.core.recording.shots import CHANNELS
from hydro.core.residual.hull import Hull
from hydro.core.residual.library import sizes
from hydro.core.residual.regression import Regression, answers, thinning
from hydro.core.residual.response import Transitions
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class FreeLaw:
    """Responses of the S shots of a recording to the Q coefficients of a hull-force model.

    Rows are thinned to K values per shot, in units of the floor, with the initial states eliminated.

    Attributes:
        thin: Number of rows from one compared row to the next.
        begun: Orthonormal responses to the initial states, (S, K, 12).
        columns: Responses to the coefficients in units of their prior standard deviations, (S, K, Q).
        known: Information of the earlier recording on the coefficients, (Q, Q).
        whole: Information of both recordings, (Q, Q).
    """

    thin: int
    begun: Array
    columns: Array
    known: Array
    whole: Array

    @classmethod
    def of(cls, hull: Hull, vehicle: Vehicle, transitions: Transitions) -> FreeLaw | None:
        """Return the responses of shots to the coefficients; None for a law without any, such as a network.

        Args:
            hull: Hull-force model.
            vehicle: Vehicle, whose hull and density are the units of the coefficients.
            transitions: Shots of the recording after the change, in units of the floor.
        """
        law, shots = hull.law, transitions.shots
        if not isinstance(law, Regression):
            return None
        prior, begun, found = sizes(vehicle).ravel(), list[Array](), list[Array]()
        for _, both in answers(transitions, law.terms(transitions.model, shots), prior):
            flat = both.reshape(len(both), -1, both.shape[-1])
            flat[~(np.abs(flat) < ENDLESS).all(axis=(1, 2))] = 0.0
            begun.append(np.linalg.qr(flat[..., :CHANNELS])[0])
            found.append(without(begun[-1], flat[..., CHANNELS:]).astype(np.float32))
        columns, thin = np.concatenate(found), thinning(shots)
        rows = columns.reshape(-1, prior.size)
        known = law.information / float((hull.floor**2).mean())
        return cls(thin, np.concatenate(begun), columns, known, known + thin * (rows.T @ rows))

    def eliminated(self, flat: Array) -> Array:
        """Return [X, e]^T [X, e] of each shot with the coefficients eliminated, (S, P + 1, P + 1).

        Args:
            flat: Columns X of P parameters and the residual e in units of the floor, with the initial states
                eliminated, (S, rows * 12, P + 1).
        """
        count = flat.shape[-1]
        rows = flat.reshape(len(flat), -1, CHANNELS, count)[:, :: self.thin]
        left = without(self.begun, rows.reshape(len(flat), -1, count))
        across = self.thin * np.tensordot(self.columns, left.astype(np.float32), axes=((0, 1), (0, 1)))
        follow = np.linalg.solve(self.whole, across)
        left = left - self.columns @ follow.astype(np.float32)
        shared = follow.T @ self.known @ follow / len(flat)
        return np.asarray(self.thin * np.einsum("ski,skj->sij", left, left) + shared)


def without(begun: Array, columns: Array) -> Array:
    """Return the part of columns (S, K, C) that orthonormal columns `begun` (S, K, 12) do not span."""
    return np.asarray(columns - begun @ (begun.transpose(0, 2, 1) @ columns))
