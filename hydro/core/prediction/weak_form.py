"""Equation-error problem over windows: the equation of motion integrated with a smooth test function phi.

    int phi nu_dot - int phi a(eta, nu, f) = -int phi' nu - int phi a = 0,      phi(s) = (1 - s^2)^3.

Here s is -1 to 1 over the window, and a is the acceleration of the vehicle's program along the smoothed
motion with thrusts f.  So no measured acceleration is needed (weak form, Messenger and Bortz 2021).  The
kinematics d(x, y, z)/dt = R v are added as equations; they show errors of a DVL and are independent of
forces.

For a long recording, evenly spread windows suffice, and forces are computed at their rows alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from hydro.core.columns import Array, Mask, Rows
from hydro.core.errors import DataError
from hydro.core.prediction.candidate import (
    Candidate,
    accelerations_at,
    candidate,
    rotor_states_around,
    true_velocity,
)
from hydro.core.prediction.normal_equations import Normal
from hydro.core.recording.arrays import Recording, noise, smoothed
from hydro.core.recording.filling import unshown
from hydro.core.recording.shots import evenly
from hydro.core.threads import spread
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation

WINDOW_SECONDS = 2.0
"""Length of a window [s]; neighbours overlap by half."""
EQUATIONS = 9  # equations of a window
SHARED = 4  # equations that overlapping neighbours share


@dataclass(frozen=True)
class Windows:
    """Equation error of a recording over W windows of L rows.

    Each window has nine equations, six of motion and three of kinematics, integrated with a smooth test
    function phi.

    Attributes:
        record: The recording of N rows.
        eta: Smoothed pose, (N, 6).
        nu: Smoothed velocity as logged, (N, 6).
        rows: The K rows that windows cover, ascending, (K,).
        starts: Index in `rows` of the first row of each window, (W,).
        test: phi at the rows of a window, times dt, (L,).
        slope: phi' at these rows, (L,).
        sigma: Standard deviation of the white noise of a single row: velocity and rates, position, (9,).
        whitener: Matrix V with V^T V the inverse covariance of a window's residuals, (9, 9).
        freedom: Number of independent equations per window, one number or (W,).
        share: Windows used, as a share of all windows that the recording has.
        known: Weight of each equation, by the share of rows with samples, (W, 9); None if all rows have
            samples.
    """

    record: Recording
    eta: Array
    nu: Array
    rows: Rows
    starts: Rows
    test: Array
    slope: Array
    sigma: Array
    whitener: Array
    freedom: int | Array
    share: float
    known: Array | None = None

    @classmethod
    def of(
        cls,
        record: Recording,
        sigma: Array | None = None,
        most: int | None = None,
        *,
        seconds: float = WINDOW_SECONDS,
        run: int = 1,
    ) -> Windows:
        """Return the equation-error problem of a recording, cut into windows.

        Args:
            record: The recording.
            sigma: Standard deviation of the noise of the twelve channels, (12,); by default estimated from
                the recording.
            most: Maximum number of windows, spread evenly over a long recording; by default all.
            seconds: Length of a window [s]; at least nine rows.
            run: Number of consecutive windows that are kept or dropped together if `most` limits the number.

        Raises:
            DataError: No segment is as long as a window.
        """
        length = max(round(seconds / record.dt), 8) + 1
        step = length // 2
        room = np.concatenate(
            [np.arange(a, b - length + 1, step, dtype=np.int64) for a, b in record.segments]
        )
        if not room.size:
            raise DataError(
                f"no session has {length} rows ({length * record.dt:g} s) without a gap; record longer ones"
            )
        s = np.linspace(-1.0, 1.0, length)
        test = (1.0 - s**2) ** 3 * record.dt
        slope = -6.0 * s * (1.0 - s**2) ** 2 / (0.5 * (length - 1))
        known = noise(record) if sigma is None else np.asarray(sigma, float)
        known = np.concatenate([known[6:], known[:3]])
        spread = known * np.linalg.norm(slope)
        eta, nu = smoothed(record)
        first = room[_runs(room.size, most, run)]
        rows = np.unique(first[:, None] + np.arange(length))
        overlapping = float(np.mean(np.diff(first) == step)) if first.size > 1 else 0.0
        freedom = round(EQUATIONS - SHARED * overlapping)
        weights = None if record.seen is None else _known(record, first[:, None] + np.arange(length))
        return cls(
            record=record,
            eta=eta,
            nu=nu,
            rows=rows,
            starts=np.searchsorted(rows, first),
            test=test,
            slope=slope,
            sigma=known,
            whitener=np.diag(1.0 / np.maximum(spread, 1e-6)),
            freedom=freedom if weights is None else np.maximum(freedom * (weights > 0.0).mean(axis=1), 1.0),
            share=first.size / room.size,
            known=weights,
        )

    def residuals(self, vehicle: Vehicle) -> Array:
        """Return the residuals of a vehicle's equations over each window, in units of their noise, (W, 9)."""
        model = candidate(vehicle)
        return self._residuals(model, self._rotors(model))

    def _rotors(self, model: Candidate) -> Array:
        """Return the lag states of the thrusters at the rows of the windows, (K, n)."""
        return rotor_states_around(model, self.record)[self.rows]

    def _residuals(self, model: Candidate, rotors: Array) -> Array:
        """Return the residuals of a compiled vehicle, (W, 9), with lag states `rotors` (K, n)."""
        record, rows = self.record, self.rows
        nu = true_velocity(model, record, self.nu)
        moving = np.einsum("kij,kj->ki", rotation(*self.eta[rows, 3:].T), nu[rows, :3])
        rates = np.hstack([accelerations_at(rows, model, record, self.eta, nu, rotors), moving])
        states = np.hstack([true_velocity(model, record, record.nu)[rows], record.eta[rows, :3]])
        window = self.starts[:, None] + np.arange(self.test.size)
        error = self.changes(states) - np.einsum("l,wli->wi", self.test, rates[window])
        return self.counted(error @ self.whitener.T)

    @property
    def session(self) -> Rows:
        """Number of the session in which each window lies, (W,)."""
        segment = np.searchsorted(self.record.segments[:, 0], self.rows[self.starts], side="right") - 1
        return np.asarray(self.record.session[segment], np.int64)

    @property
    def consecutive(self) -> Mask:
        """Mask of the windows that start half a window after the window before, (W,)."""
        first, step = self.rows[self.starts], self.test.size // 2
        return np.asarray(np.diff(first, prepend=-1 - step) == step)

    def sums(self, values: Array) -> Array:
        """Return the integrals over W windows of k signals times the test function phi, (W, k).

        Args:
            values: Signals at the K rows of the windows, (K, k).
        """
        count, length = len(self.starts), self.test.size
        window = (self.starts[:, None] + np.arange(length)).ravel()
        weights = (np.tile(self.test, count), window, np.arange(count + 1) * length)
        found: Array = scipy.sparse.csr_array(weights, shape=(count, len(values))) @ values
        return found

    def changes(self, values: Array) -> Array:
        """Return the integrals over W windows of the time derivative of k signals times phi, (W, k).

        Integration by parts moves the derivative to the test function phi.

        Args:
            values: Signals at the K rows of the windows, (K, k).
        """
        window = self.starts[:, None] + np.arange(self.test.size)
        return np.asarray(-np.einsum("l,wli->wi", self.slope, values[window]))

    def noise(self, lags: int) -> Array:
        """Return the autocovariance that white velocity noise has over neighbouring windows, (lags + 1, 6).

        Args:
            lags: Greatest distance between two windows, in windows.
        """
        step, length = self.test.size // 2, self.test.size
        sums = [
            float(self.slope[: max(length - k * step, 0)] @ self.slope[k * step :]) for k in range(lags + 1)
        ]
        return np.outer(sums, self.sigma[:6] ** 2)

    def drifting(self, model: Candidate) -> Array:
        """Return the acceleration that a model gives without thrust, in the K rows of windows, (K, 6).

        Args:
            model: Compiled vehicle.
        """
        record, rows = self.record, self.rows
        at_rest = np.zeros((rows.size, record.commands.shape[1]))
        nu = true_velocity(model, record, self.nu)
        return np.asarray(accelerations_at(rows, model, record, self.eta, nu, at_rest))

    def moved(self, model: Candidate) -> Array:
        """Return the measured acceleration, integrated over each window with the test function phi, (W, 6).

        Args:
            model: Compiled vehicle whose DVL errors are corrected.
        """
        return self.changes(true_velocity(model, self.record, self.record.nu)[self.rows])

    @property
    def shown(self) -> Mask:
        """Mask of the equations of motion, X to N, with samples in at least one window, (6,)."""
        known = np.ones((1, EQUATIONS)) if self.known is None else self.known
        return np.asarray((known[:, :6] > 0.0).any(axis=0))

    def counted(self, whitened: Array) -> Array:
        """Return whitened residuals or derivatives times the weight `known` of each equation, (..., W, k).

        Args:
            whitened: Values of the first k of the nine equations in W windows, (..., W, k).
        """
        return whitened if self.known is None else whitened * self.known[:, : whitened.shape[-1]]

    def linearise(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Normal:
        """Return the least-squares problem of P parameters, linearised about a vehicle.

        The residual is measured minus predicted.

        Args:
            base: The vehicle.
            moved: P copies of the vehicle with one changed parameter each.
            steps: Size of each change, in the unit of the problem's parameters.
        """
        columns = self.columns(base, moved, steps)
        gram = columns.transpose(0, 2, 1) @ columns
        error = columns[..., -1]
        return Normal(gram, self.freedom, error**2, np.zeros((len(error), 0, len(moved) + 1)))

    def columns(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Array:
        """Return whitened derivatives of the nine equations of W windows by P parameters, and the residual.

        Args:
            base: The vehicle.
            moved: P copies of the vehicle with one changed parameter each.
            steps: Size of each change, in the unit of the problem's parameters.

        Returns:
            (W, 9, P + 1); the residual is last.
        """
        here = candidate(base)
        rotors = self._rotors(here)

        def residuals(vehicle: Vehicle) -> Array:
            model = candidate(vehicle)
            same = np.array_equal(model.thrusters, here.thrusters)
            return self._residuals(model, rotors if same else self._rotors(model))

        error, *others = spread(residuals, [base, *moved])
        columns = np.empty((*error.shape, len(moved) + 1))
        columns[..., -1] = error
        for i, (other, step) in enumerate(zip(others, steps, strict=True)):
            columns[..., i] = (error - other) / step
        return columns

    def cost(self, vehicle: Vehicle, step: Array, normal: Normal) -> tuple[float, Windows]:
        """Return the sum of squared residuals of a vehicle, and this problem, unchanged.

        The sum is infinite if a residual is not finite.  The problem has no initial states to update.

        Args:
            vehicle: The vehicle.
            step: Not used.
            normal: Not used.
        """
        total = float((self.residuals(vehicle) ** 2).sum())
        return (total if np.isfinite(total) else np.inf), self

    def reweighted(self, normal: Normal) -> tuple[Windows, bool]:
        """Return the problem with less weight for large residuals, and whether a weight changed.

        Args:
            normal: Problem linearised at the present estimate.

        Returns:
            A copy and True; the problem itself and False if no residual is clearly larger than its noise.
        """
        squares = normal.channels.sum(axis=0)
        counted = len(normal.channels) if self.known is None else (self.known**2).sum(axis=0)
        rms = np.sqrt(squares / np.maximum(counted, 1.0))
        if (rms < 1.15).all():
            return self, False
        return replace(self, whitener=np.diag(1.0 / np.maximum(rms, 1.0)) @ self.whitener), True


def _runs(count: int, most: int | None, run: int) -> Rows:
    """Return the indices of at most `most` windows to keep, in runs of `run` consecutive windows."""
    if most is None or count <= most or run == 1:
        return evenly(count, most)
    kept = evenly(count // run, most // run) * run
    found: Rows = (kept[:, None] + np.arange(run)).ravel()
    return found


def _known(record: Recording, rows: Rows) -> Array:
    """Return the weight of each equation of windows with rows (W, L), (W, 9).

    It is the root of the share of sampled rows, and 0 if a model filled a channel.  It is 0 for the
    kinematics if position or velocity is not sampled, since one of the two was then derived from the other.
    """
    assert record.seen is not None
    share = record.seen[rows].mean(axis=1)
    balance = share[:, 6:].copy()
    for start, stop in record.segments:
        here = (rows[:, 0] >= start) & (rows[:, 0] < stop)
        never, filled = ~record.seen[start:stop, 6:].any(axis=0), unshown(record.seen[start:stop])[6:]
        balance[np.ix_(here, never)] = 1.0 - filled[never]
    placed = share[:, :3] * share[:, 6:9].min(axis=1, keepdims=True)
    return np.asarray(np.sqrt(np.hstack([balance, placed])))
