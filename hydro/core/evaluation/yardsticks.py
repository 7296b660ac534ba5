"""What a model's predictions are measured by: the weights of the axes, and three simple predictors beside it.

The predictors begin where the model begins, and each axis goes its own way: it stands still; it goes on as it
went; or it obeys damping and delayed thrust fitted by bounded least squares,
nu' = a nu + b |nu| nu + c tau(t - d) + e with a, b <= 0 <= c.  A model of the whole vehicle that predicts
worse than one of them has lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import polars as pl
from scipy.optimize import nnls

from hydro.core.columns import VELOCITY, Array
from hydro.core.evaluation.misfit import Misfit
from hydro.core.evaluation.regimes import Pieces
from hydro.core.evaluation.replay_error import BEYOND, laid, last_samples, root_mean_square
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.evaluation.weights import Weights
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.tracking import tracked
from hydro.core.recording.arrays import Recording, recording
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import UNIT_WRENCH, thrusts

ZERO, CONSTANT, LEAST_SQUARES = PREDICTORS = ("zero velocity", "constant velocity", "least squares")
LEVEL = "yardstick"
"""What the rows of the predictors are called in a comparison."""
DELAYS = np.linspace(0.0, 1.0, 11)
"""Delays of the thrust that are tried [s]."""
WINDOW = 1.0
"""Time over which changes of velocity are fitted [s]."""
LOST = 1.02
"""Error over that of a simple predictor from which a model has lost to it: less is a draw."""
JUDGED = 5.0
"""Horizon at which it has [s]."""


class Damped(NamedTuple):
    """One axis that obeys damping and delayed thrust.

    Attributes:
        linear: a [1/s], at most 0.
        quadratic: b [1/m, 1/rad], at most 0.
        thrust: c, acceleration for a unit of the axis' wrench [1/kg, 1/(kg m^2)], at least 0.
        steady: e [m/s^2, rad/s^2].
        delay: d [s].
    """

    linear: float
    quadratic: float
    thrust: float
    steady: float
    delay: float


@dataclass(frozen=True)
class Yardstick:
    """What the predictions of one vehicle file, and of all that are made from it, are measured by.

    Attributes:
        vehicle: The file, whose thrusters make wrenches of the commands.
        weights: Of the axes, by its inertia.
        damped: Each axis by least squares, (6,).
    """

    vehicle: Vehicle
    weights: Weights
    damped: tuple[Damped, ...]

    @classmethod
    def of(cls, vehicle: Vehicle, raw: pl.DataFrame) -> Yardstick:
        """By a vehicle file, and fitted to a recording.

        Args:
            vehicle: The vehicle file.
            raw: Raw table: never the one that is held out.

        Raises:
            DataError: They do not fit each other.
        """
        return cls.fitted(vehicle, tracked(vehicle, recording(vehicle, raw)))

    @classmethod
    def fitted(cls, vehicle: Vehicle, record: Recording) -> Yardstick:
        """The same of a recording that has been read."""
        tau = _wrench(vehicle, record)
        damped = tuple(_least_squares(record, tau, axis) for axis in range(6))
        return cls(vehicle, Weights.of(candidate(vehicle)), damped)

    def misfits(
        self, record: Recording, motion: Motion, pieces: Pieces, horizon: float, velocity: Misfit
    ) -> list[tuple[str, Misfit]]:
        """Errors of the simple predictors.

        Args:
            record: The recording.
            motion: Its smoothed motion.
            pieces: What to sum over.
            horizon: Length of a prediction [s].
            velocity: Errors of the model's predictions at the same horizon.

        Returns:
            Each predictor's name and its errors, on the same predictions.
        """
        starts, _, lengths = laid(record, horizon)
        rows = starts[:, None] + np.arange(lengths[0])
        first = motion.nu[starts]
        tau = _wrench(self.vehicle, record)
        delayed = np.stack([_delayed(tau[:, i], record, one.delay) for i, one in enumerate(self.damped)], 1)
        predicted = {
            ZERO: np.zeros((*rows.shape, 6)),
            CONSTANT: np.broadcast_to(first[:, None], (*rows.shape, 6)),
            LEAST_SQUARES: march(self.damped, first, delayed[rows], record.dt),
        }
        found = []
        for name, there in predicted.items():
            error = np.clip(there - record.nu[rows], -BEYOND[6:], BEYOND[6:])
            squares, seen = np.zeros((record.rows, 6)), None
            if record.seen is not None:
                seen = record.seen[rows][..., 6:]
            squares[rows] = error**2 if seen is None else error**2 * seen
            end = root_mean_square(last_samples(error, seen))
            found.append((name, replace(velocity, level=LEVEL, squares=pieces.total(squares), end=end)))
        return found


def column(predictor: str) -> str:
    """Column of a ladder that holds the errors of a simple predictor."""
    return predictor.replace(" ", "_")


def march(damped: Sequence[Damped], first: Array, tau: Array, dt: float) -> Array:
    """Velocities that damped axes reach under thrust, each step with the damping of its beginning.

    Args:
        damped: The A axes.
        first: Velocities at the beginning, (S, A).
        tau: Wrenches, already delayed, (S, K, A).
        dt: From row to row [s].

    Returns:
        Velocities, (S, K, A); the first row is the beginning.
    """
    linear, quadratic, thrust, steady, _ = np.array(damped).T
    out = np.empty(tau.shape)
    out[:, 0] = first
    for k in range(tau.shape[1] - 1):
        rate = linear + quadratic * np.abs(out[:, k])
        force = thrust * tau[:, k] + steady
        held = np.where(rate < -1e-9, np.expm1(rate * dt) / np.minimum(rate, -1e-9), dt)
        out[:, k + 1] = out[:, k] * np.exp(rate * dt) + force * held
    return out


def lost(errors: pl.DataFrame) -> list[tuple[str, str]]:
    """Axes on which a model predicts worse than a simple predictor, and the best of these.

    Args:
        errors: `axis`, `predictor`, and the root mean square errors `model` and `simple`, JUDGED ahead.
    """
    behind = errors.filter(pl.col("axis").is_in(VELOCITY), pl.col("model") > LOST * pl.col("simple"))
    first = behind.sort("simple").unique("axis", keep="first", maintain_order=True)
    best = dict(first.select("axis", "predictor").iter_rows())
    return [(axis, best[axis]) for axis in VELOCITY if axis in best]


def _wrench(vehicle: Vehicle, record: Recording) -> Array:
    """Wrench of the thrusters, as the file makes it of the commands, in every row, (N, 6)."""
    table = candidate(vehicle).thrusters
    force = thrusts(table, record.commands, record.t, record.segments, after_gap=record.after_gap)
    wrench: Array = force @ table[:, UNIT_WRENCH]
    return wrench


def _delayed(values: Array, record: Recording, delay: float) -> Array:
    """A series (N,) later by a delay [s]; each segment begins with its first value."""
    late, out = round(delay / record.dt), values.copy()
    for start, stop in record.segments:
        by = min(late, stop - start)
        out[start + by : stop] = values[start : stop - by]
        out[start : start + by] = values[start]
    return out


def _least_squares(record: Recording, tau: Array, axis: int) -> Damped:
    """The damping, thrust and delay of one axis that leave the least of its changes of velocity over WINDOW.

    Integrals need no derivative of what is noisy.
    """
    nu, steady = record.nu[:, axis], np.ones(record.rows)
    found: list[tuple[float, Damped]] = []
    for delay in DELAYS:
        thrust = _delayed(tau[:, axis], record, delay)
        rates = np.stack([-nu, -np.abs(nu) * nu, thrust, steady, -steady, nu], axis=1)
        *columns, change = _over_windows(rates, record).T
        size = np.maximum(np.linalg.norm(columns, axis=1), 1e-12)
        basis, triangle = np.linalg.qr(np.transpose(columns) / size)
        inside = basis.T @ change
        scaled, left = nnls(triangle, inside)
        a, b, c, up, down = scaled / size
        found.append((left**2 - inside @ inside, Damped(-a, -b, c, up - down, float(delay))))
    return min(found, key=lambda one: one[0])[1]


def _over_windows(rates: Array, record: Recording) -> Array:
    """Integrals of series (N, K) over windows of every segment, but of the last one its change, (W, K)."""
    longest = int(np.diff(record.segments).max())
    rows = max(min(round(WINDOW / record.dt), longest - 1), 1)
    parts = []
    for start, stop in record.segments:
        within = rates[start:stop]
        sums = np.zeros_like(within)
        sums[1:] = np.cumsum(0.5 * record.dt * (within[1:] + within[:-1]), axis=0)
        sums[:, -1] = within[:, -1]
        parts.append(sums[rows:] - sums[:-rows])
    return np.concatenate(parts)
