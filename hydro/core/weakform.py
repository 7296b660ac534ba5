"""Equation error over windows: the balance of a vehicle, moved off the noise by a smooth test function.

    int phi nu_dot - int phi a(eta, nu, f) = -int phi' nu - int phi a = 0,      phi(s) = (1 - s^2)^3

a is the acceleration that the vehicle's program gives along the smoothed motion, so no measured acceleration
is needed (weak form, Messenger and Bortz 2021).  The kinematics stand beside it, d(x, y, z)/dt = R v, where
the errors of a velocity log show and no force can.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro.core.candidate import Candidate, accelerations, candidate, true_velocity
from hydro.core.errors import DataError
from hydro.core.frames import rotation
from hydro.core.normal import Normal
from hydro.core.recording import Array, Recording, noise, smoothed
from hydro.core.vehicle import Vehicle

Rows = NDArray[np.int64]

SECONDS = 2.0
"""Length of a window; neighbours overlap by half."""
FREEDOM = 5  # independent equations in a window: neighbours share about half


@dataclass(frozen=True)
class Windows:
    """Equation error of a recording.

    Attributes:
        record: The recording.
        eta: Smoothed pose, (N, 6).
        nu: Smoothed velocity as logged, (N, 6).
        starts: First row of each window, (W,).
        test: phi at the rows of a window, times dt, (L,).
        slope: phi' likewise, (L,).
        whitener: W with W^T W the inverse covariance of a window's residuals, (9, 9).
    """

    record: Recording
    eta: Array
    nu: Array
    starts: Rows
    test: Array
    slope: Array
    whitener: Array

    @classmethod
    def of(cls, record: Recording, sigma: Array | None = None) -> Windows:
        """Lay windows over a recording whose channels have noise `sigma` (12,), found from it by default.

        Raises:
            DataError: No segment is as long as a window.
        """
        length = max(round(SECONDS / record.dt), 8) + 1
        starts = np.concatenate(
            [np.arange(a, b - length + 1, length // 2, dtype=np.int64) for a, b in record.segments]
        )
        if not starts.size:
            raise DataError(
                f"no session has {length} rows ({length * record.dt:g} s) without a gap; record longer ones"
            )
        s = np.linspace(-1.0, 1.0, length)
        test = (1.0 - s**2) ** 3 * record.dt
        slope = -6.0 * s * (1.0 - s**2) ** 2 / (0.5 * (length - 1))
        known = noise(record) if sigma is None else np.asarray(sigma, float)
        spread = np.concatenate([known[6:], known[:3]]) * np.linalg.norm(slope)
        eta, nu = smoothed(record)
        return cls(record, eta, nu, starts, test, slope, np.diag(1.0 / np.maximum(spread, 1e-6)))

    def residuals(self, vehicle: Vehicle) -> Array:
        """Whitened residuals of a vehicle, (W, 9)."""
        return self._residuals(candidate(vehicle))

    def _residuals(self, model: Candidate) -> Array:
        record = self.record
        nu = true_velocity(model, record, self.nu)
        moving = np.einsum("kij,kj->ki", rotation(*self.eta[:, 3:].T), nu[:, :3])
        rates = np.hstack([accelerations(model, record, self.eta, nu), moving])
        states = np.hstack([true_velocity(model, record, record.nu), record.eta[:, :3]])
        window = self.starts[:, None] + np.arange(self.test.size)
        error = -np.einsum("l,wli->wi", self.slope, states[window]) - np.einsum(
            "l,wli->wi", self.test, rates[window]
        )
        whitened: Array = error @ self.whitener.T
        return whitened

    def linearise(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Normal:
        """The least-squares problem about a vehicle; the residual counts as measured less predicted."""
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            error, *others = pool.map(self.residuals, [base, *moved])
        columns = np.empty((*error.shape, len(moved) + 1))
        columns[..., -1] = error
        for i, (other, step) in enumerate(zip(others, steps, strict=True)):
            columns[..., i] = (error - other) / step
        gram = columns.transpose(0, 2, 1) @ columns
        return Normal(gram, FREEDOM, error**2, np.zeros((len(error), 0, len(moved) + 1)))

    def cost(self, vehicle: Vehicle, step: Array, normal: Normal) -> tuple[float, Windows]:
        """Sum of squares."""
        total = float((self.residuals(vehicle) ** 2).sum())
        return (total if np.isfinite(total) else np.inf), self

    def reweighted(self, normal: Normal) -> tuple[Windows, bool]:
        """Weights from what is left."""
        rms = np.sqrt(normal.channels.mean(axis=0))
        if (rms < 1.15).all():
            return self, False
        return replace(self, whitener=np.diag(1.0 / np.maximum(rms, 1.0)) @ self.whitener), True
