"""Squared errors of predicted velocities over stretches of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.evaluation.replay_error import BEYOND
from hydro.core.prediction import multiple_shooting
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import Recording
from hydro.core.recording.shots import Shots
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation_from_quaternion


@dataclass(frozen=True)
class Squares:
    """Squared prediction errors of the velocities over S stretches of a recording.

    Attributes:
        sums: Sum over each stretch, (S, 6) [m^2/s^2, rad^2/s^2].
        counts: Number of samples in each stretch, (S, 6).
    """

    sums: Array
    counts: Array

    @property
    def mean(self) -> Array:
        """Mean squared error on each axis, (6,) [m^2/s^2, rad^2/s^2]."""
        average: Array = self.sums.sum(axis=0) / np.maximum(self.counts.sum(axis=0), 1.0)
        return average

    def error(self, weights: Array) -> float:
        """Return the root mean square error over all axes [m/s].

        Args:
            weights: Weight of a square on each axis, (6,), from `evaluation.weights`.
        """
        return float(np.sqrt(weights @ self.mean))


def squares_ahead(vehicle: Vehicle, ahead: Shots) -> Squares:
    """Return the squared errors of the velocities that a vehicle predicts, summed over each shot.

    Args:
        vehicle: Vehicle.
        ahead: Shots, short stretches of a recording, to predict; predictions start at the logged motion.
    """
    count = len(ahead.starts)
    if not count:
        return Squares(np.zeros((0, 6)), np.zeros((0, 6)))
    model = candidate(vehicle)
    shots = multiple_shooting.corrected_first(ahead, model)
    return _squares(multiple_shooting.predict(multiple_shooting.prepare(model, shots), shots), shots)


def squares_at_rest(ahead: Shots) -> Squares:
    """Return the squared velocity errors of the prediction that the vehicle stands still, for each shot.

    Args:
        ahead: Shots, short stretches of a recording, to predict.
    """
    states = np.repeat(ahead.first[:, None], ahead.measured.shape[1], axis=1)
    states[..., 7:] = 0.0
    return _squares(states, ahead)


def _squares(predicted: Array, shots: Shots) -> Squares:
    """Return the squared errors of predicted states, (S, T, 13), over S shots.

    A velocity without samples is judged by the distance covered in a shot, divided by its duration, if the
    position along the same axis has samples.
    """
    error = predicted[..., 7:] - shots.measured[..., 7:]
    seen = np.ones(error.shape, bool) if shots.seen is None else shots.seen[..., 6:].copy()
    if shots.seen is not None and (axes := axes_by_distance(shots.record)).size:
        way = (predicted[..., :3] - shots.measured[..., :3]) * shots.seen[..., :3]
        body = np.einsum("sij,sti->stj", rotation_from_quaternion(shots.first[:, 3:7]), way)
        error[..., axes] = body[..., axes] / (error.shape[1] * shots.record.dt)
        seen[..., axes] = shots.seen[..., axes]
    error, seen = error[:, shots.lead :], seen[:, shots.lead :]
    squares = np.clip(np.nan_to_num(error, nan=np.inf), -BEYOND[6:], BEYOND[6:]) ** 2
    return Squares((squares * seen).sum(axis=1), seen.sum(axis=1).astype(np.float64))


def axes_by_distance(record: Recording) -> Rows:
    """Return the linear axes (0 to 2 for x, y, z) that have samples of position but none of velocity."""
    if record.seen is None:
        return np.zeros(0, np.int64)
    shown = np.asarray(record.seen.any(axis=0), bool)
    return np.asarray(np.flatnonzero(shown[:3] & ~shown[6:9]), np.int64)
