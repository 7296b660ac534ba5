"""Weights of the axes, and three simple predictors that a model should beat.

The predictors start where the model starts.  "Zero velocity" stands still.  "Constant velocity" keeps its
first velocity.  "Least squares" has damping, cross terms and delayed, scaled thrust on each axis i: nu_i' = a
nu_i + b |nu_i| nu_i + c tau_i(t - d) + e + sum_j k_j nu_j with a, b <= 0 <= c, where tau_i is the wrench of
the thrusters by the vehicle file.  Bounded least squares fits a, b, c, d, e and k_j to training sessions
only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import polars as pl
import scipy

from hydro.core.columns import VELOCITY, Array, Rows
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
"""Level of the predictors' rows in a comparison."""
PLAIN = 5
"""Number of regressors without cross terms: two for damping, thrust, and the steady force of either sign."""
DELAYS = np.linspace(0.0, 1.0, 11)
"""Delays of the thrust that are tried [s]."""
WINDOW = 1.0
"""Time over which changes of velocity are fitted [s]."""
RIDGE = 0.001
"""Weight of the ridge on cross terms, as a share of each regressor's sum of squares.

The ridge matters only where axes move together; a tenth or ten times of it changes an error 5 s ahead by less
than 1 %.
"""
FOLDS = 5
"""Number of groups of sessions, or of blocks of time of a single session, that are each held out once.

More cost time and change little.
"""
LOST = 1.02
"""Ratio of a model's error to that of a simple predictor above which the model counts as worse."""
JUDGED = 5.0
"""Prediction horizon at which a model and the simple predictors are compared [s]."""


class Damped(NamedTuple):
    """Coefficients of one axis of the least-squares predictor.

    The predicted acceleration is a v + b |v| v + c tau(t - d) + e + sum_j k_j nu_j, with the velocity v on
    the axis, the wrench tau and the velocities nu_j on all axes.

    Attributes:
        linear: Linear damping a [1/s], at most 0.
        quadratic: Quadratic damping b [1/m, 1/rad], at most 0.
        thrust: Acceleration c for a unit of the axis' wrench [1/kg, 1/(kg m^2)], at least 0.
        steady: Constant acceleration e [m/s^2, rad/s^2].
        delay: Delay d of the thrust [s].
        cross: Acceleration k_j for a unit of the velocity on each of the six axes, 0 on the own axis; empty
            without cross terms.
    """

    linear: float
    quadratic: float
    thrust: float
    steady: float
    delay: float
    cross: tuple[float, ...] = ()


@dataclass(frozen=True)
class Yardstick:
    """Weights of the axes and simple predictors, by which one vehicle file and its corrections are judged.

    Attributes:
        vehicle: Vehicle file, whose thrusters turn commands into wrenches.
        weights: Weights of the axes, from the inertia of the vehicle.
        damped: Least-squares predictor of each of six axes, fitted to the whole training recording.
        left_out: Predictors fitted without each fold (part) of the training recording, for predictions of
            that fold.
        fold: Number of the fold of each of N rows of the training recording, (N,); empty without folds.
    """

    vehicle: Vehicle
    weights: Weights
    damped: tuple[Damped, ...]
    left_out: tuple[tuple[Damped, ...], ...] = ()
    fold: Rows = field(default_factory=lambda: np.zeros(0, np.int64))

    @classmethod
    def of(cls, vehicle: Vehicle, raw: pl.DataFrame) -> Yardstick:
        """Return the simple predictors fitted to a training recording, with the weights of a vehicle file.

        Args:
            vehicle: Vehicle file.
            raw: Raw table of the training recording, never of the held-out recording.

        Raises:
            DataError: The recording does not fit the vehicle.
        """
        return cls.fitted(vehicle, tracked(vehicle, recording(vehicle, raw)))

    @classmethod
    def fitted(cls, vehicle: Vehicle, record: Recording) -> Yardstick:
        """Return the simple predictors fitted to a training recording, with the weights of a vehicle file.

        Args:
            vehicle: Vehicle file.
            record: Training recording as arrays.
        """
        return cls(vehicle, Weights.of(candidate(vehicle)), _fitted(record, _wrench(vehicle, record)))

    @classmethod
    def crossed(cls, vehicle: Vehicle, record: Recording) -> Yardstick:
        """Return the simple predictors, fitted by cross-validation to the recording that they predict.

        Each group of sessions, or each block of a single session, is predicted by a fit to all others.  For
        another recording, use `of_others` of the result.

        Args:
            vehicle: Vehicle file, which gives the weights and the wrenches of the thrusters.
            record: Recording as arrays.
        """
        tau, fold = _wrench(vehicle, record), _folds(record)
        parts = [_without(record, fold, number) for number in range(int(fold.max()) + 1)]
        left_out = tuple(_fitted(part, tau) for part in parts)
        return cls(vehicle, Weights.of(candidate(vehicle)), _fitted(record, tau), left_out, fold)

    @property
    def of_others(self) -> Yardstick:
        """A copy for predictions of another recording, with the fit to the whole training recording alone."""
        return replace(self, left_out=(), fold=np.zeros(0, np.int64))

    def misfits(
        self, record: Recording, motion: Motion, pieces: Pieces, horizon: float, velocity: Misfit
    ) -> list[tuple[str, Misfit]]:
        """Return the errors of the three simple predictors over the same predictions as those of a model.

        Args:
            record: Recording.
            motion: Smoothed motion of the recording.
            pieces: Pieces of time over which squares are summed.
            horizon: Length of a prediction [s].
            velocity: Velocity errors of the model at the same horizon; the result repeats their weights,
                counts and errors due to noise.

        Returns:
            A list with the name and the errors of each predictor.
        """
        starts, _, lengths = laid(record, horizon)
        rows = starts[:, None] + np.arange(lengths[0])
        first = motion.nu[starts]
        tau = _wrench(self.vehicle, record)
        predicted = {
            ZERO: np.zeros((*rows.shape, 6)),
            CONSTANT: np.broadcast_to(first[:, None], (*rows.shape, 6)),
            LEAST_SQUARES: self._by_least_squares(record, starts, rows, first, tau),
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

    def _by_least_squares(
        self, record: Recording, starts: Rows, rows: Rows, first: Array, tau: Array
    ) -> Array:
        """Return velocities predicted by least squares, each with a fit without its fold, (S, K, 6).

        Args:
            record: Recording.
            starts: First row of each prediction, (S,).
            rows: Rows of the predictions, (S, K).
            first: Velocity at each start, (S, 6).
            tau: Wrench of the thrusters in every row, (N, 6).
        """
        fits = self.left_out or (self.damped,)
        fold = self.fold[starts] if self.left_out else np.zeros(len(starts), np.int64)
        out = np.empty((*rows.shape, 6))
        for number, damped in enumerate(fits):
            here = fold == number
            delayed = np.stack([_delayed(tau[:, i], record, one.delay) for i, one in enumerate(damped)], 1)
            out[here] = march(damped, first[here], delayed[rows[here]], record.dt)
        return out


def reason(yardstick: Yardstick, record: Recording, axis: int) -> str:
    """Return words for the part of the least-squares predictor of an axis that reduces its residual most.

    Each part is removed in turn and all other parts are refitted: cross terms, the delay, the command scale
    (set to the file's inertia) and the damping.

    Args:
        yardstick: Predictors fitted to the recording.
        record: Training recording.
        axis: Number of the axis, 0 to 5.
    """
    fit, nu = yardstick.damped[axis], record.nu[:, axis]
    inertia = yardstick.weights.velocity[axis] * yardstick.vehicle.rigid_body.mass
    tau, steady = _wrench(yardstick.vehicle, record)[:, axis], np.ones(record.rows)
    late = _delayed(tau, record, fit.delay)
    beside = np.delete(record.nu, axis, axis=1) if fit.cross else np.zeros((record.rows, 0))

    def left(damping: bool, thrust: Array | None, cross: Array, known: Array) -> float:
        """Return the squared residual of a fit of some parts, to changes of velocity beyond `known`."""
        own = np.stack([-nu, -np.abs(nu) * nu], axis=1) * damping
        force = np.zeros(record.rows) if thrust is None else thrust
        windows = _over_windows(np.column_stack([own, force, steady, -steady, cross, -cross, nu]), record)
        windows[:, -1] -= _over_windows(np.column_stack([known, nu]), record)[:, 0]
        values = _bounded(windows)[1]
        return float(((windows @ np.append(values, -1.0)) ** 2).sum())

    nothing, none = np.zeros(record.rows), np.zeros((record.rows, 0))
    with_others = ", ".join(VELOCITY[j] for j in np.flatnonzero(fit.cross)) if fit.cross else ""
    without = {
        "its damping": left(False, late, beside, nothing),
        f"its command scale of {fit.thrust * inertia:.2f}": left(True, None, beside, late / inertia),
    }
    if fit.delay > 0.0:
        without[f"its delay of {fit.delay:.1f} s"] = left(True, tau, beside, nothing)
    if fit.cross:
        without[f"its cross terms with {with_others}"] = left(True, late, none, nothing)
    return max(without, key=lambda words: without[words])


def column(predictor: str) -> str:
    """Return the name of a simple predictor's column of errors in the table of `hydro explain`.

    Args:
        predictor: Name of the predictor, such as "zero velocity"; the column is `zero_velocity`.
    """
    return predictor.replace(" ", "_")


def march(damped: Sequence[Damped], first: Array, tau: Array, dt: float) -> Array:
    """Return the velocities that the least-squares predictor gives under thrust.

    The damping is constant over each step, with its value at the start.

    Args:
        damped: Coefficients of A axes.
        first: Velocities at the start of S predictions, (S, A).
        tau: Wrenches in K rows, already delayed, (S, K, A).
        dt: Time from row to row [s].

    Returns:
        Velocities, (S, K, A); the first row is the start.
    """
    linear, quadratic, thrust, steady = np.array([one[:4] for one in damped]).T
    cross = _matrix(damped)
    out = np.empty(tau.shape)
    out[:, 0] = first
    for k in range(tau.shape[1] - 1):
        rate = linear + quadratic * np.abs(out[:, k])
        force = thrust * tau[:, k] + steady + out[:, k] @ cross.T
        held = np.where(rate < -1e-9, np.expm1(rate * dt) / np.minimum(rate, -1e-9), dt)
        out[:, k + 1] = out[:, k] * np.exp(rate * dt) + force * held
    return out


def lost(errors: pl.DataFrame) -> list[tuple[str, str]]:
    """Return the axes on which a model predicts clearly worse than a simple predictor.

    Args:
        errors: Table with `axis`, `predictor`, and the root mean square errors `model` and `simple`, JUDGED
            seconds ahead.

    Returns:
        For each such axis, one of `u` to `r`, its name and the name of the best simple predictor.
    """
    behind = errors.filter(pl.col("axis").is_in(VELOCITY), pl.col("model") > LOST * pl.col("simple"))
    first = behind.sort("simple").unique("axis", keep="first", maintain_order=True)
    best = dict(first.select("axis", "predictor").iter_rows())
    return [(axis, best[axis]) for axis in VELOCITY if axis in best]


def _wrench(vehicle: Vehicle, record: Recording) -> Array:
    """Return the wrench of the thrusters in every row, from the commands and the vehicle file, (N, 6)."""
    table = candidate(vehicle).thrusters
    force = thrusts(table, record.commands, record.t, record.segments, after_gap=record.after_gap)
    wrench: Array = force @ table[:, UNIT_WRENCH]
    return wrench


def _delayed(values: Array, record: Recording, delay: float) -> Array:
    """Return a series (N,) delayed by a time [s]; each segment starts with its first value."""
    late, out = round(delay / record.dt), values.copy()
    for start, stop in record.segments:
        by = min(late, stop - start)
        out[start + by : stop] = values[start : stop - by]
        out[start : start + by] = values[start]
    return out


def _matrix(damped: Sequence[Damped]) -> Array:
    """Return the cross terms of A axes as a matrix (A, A), zero on its diagonal."""
    return np.array([one.cross or np.zeros(len(damped)) for one in damped], float).reshape(len(damped), -1)


def _fitted(record: Recording, tau: Array) -> tuple[Damped, ...]:
    """Fit every axis; halve the cross terms until slow motion without thrust does not grow.

    Args:
        record: Training recording.
        tau: Wrench of the thrusters in every row, (N, 6).
    """
    fold = _folds(record)[_window_starts(record)]
    damped = [_least_squares(record, tau, axis, fold) for axis in range(6)]
    while _grows(damped):
        damped = [one._replace(cross=tuple(0.5 * k for k in one.cross)) for one in damped]
    return tuple(damped)


def _grows(damped: Sequence[Damped]) -> bool:
    """Return whether slow motion grows without thrust: whether the linear part has an unstable eigenvalue."""
    cross = _matrix(damped)
    if np.abs(cross).max() < 1e-6:
        return False
    linear = np.diag([one.linear for one in damped])
    return bool(np.linalg.eigvals(linear + cross).real.max() > 1e-3)


def _folds(record: Recording) -> Rows:
    """Return the fold of each row: groups of sessions, or blocks of time of a single session, (N,).

    Sessions are distributed by their mean square velocity.  Their order in the list then does not matter, and
    each group has slow and fast sessions.
    """
    names = np.unique(record.session)
    parts = [
        np.concatenate([np.arange(*record.segments[i]) for i in np.flatnonzero(record.session == name)])
        for name in names
    ]
    if len(parts) == 1:
        parts = np.array_split(parts[0], FOLDS)
    else:
        parts.sort(key=lambda rows: float(np.mean(record.nu[rows] ** 2)))
    fold = np.full(record.rows, -1, np.int64)
    for number, rows in enumerate(parts):
        fold[rows] = number % FOLDS
    return fold


def _without(record: Recording, fold: Rows, number: int) -> Recording:
    """Return the recording without the rows of one fold; segments are cut at its edges."""
    parts, cuts = [], np.flatnonzero(np.diff(fold)) + 1
    for segment, (start, stop) in enumerate(record.segments):
        inner = cuts[(cuts > start) & (cuts < stop)]
        edges = [int(start), *map(int, inner), int(stop)]
        parts += [(a, b, segment) for a, b in pairwise(edges) if fold[a] != number]
    kept = np.array([segment for *_, segment in parts])
    return replace(
        record,
        segments=np.array([part[:2] for part in parts], np.int64),
        session=record.session[kept],
        after_gap=record.after_gap[kept],
    )


def _least_squares(record: Recording, tau: Array, axis: int, fold: Rows) -> Damped:
    """Fit damping, thrust, delay and cross terms of one axis to its changes of velocity over WINDOW.

    Integrals need no derivative of noisy samples.  Cross terms are kept if they lower the error of windows
    that were held out.

    Args:
        record: Training recording.
        tau: Wrench of the thrusters in every row, (N, 6).
        axis: Number of the axis.
        fold: Fold of each window, (W,).
    """
    nu, steady = record.nu[:, axis], np.ones(record.rows)
    others = np.delete(np.arange(6), axis)
    same = _over_windows(np.stack([-nu, -np.abs(nu) * nu, steady, -steady, nu], axis=1), record)
    found: list[tuple[float, float, Array]] = []
    for delay in DELAYS:
        thrust = _over_windows(np.stack([_delayed(tau[:, axis], record, delay), nu], axis=1), record)
        left, values = _bounded(_triangle(np.column_stack([same[:, :2], thrust[:, 0], same[:, 2:]])))
        found.append((left, float(delay), values))
    _, delay, values = min(found, key=lambda one: one[0])
    plain = Damped(-values[0], -values[1], values[2], values[3] - values[4], delay)
    thrust = _delayed(tau[:, axis], record, delay)
    beside = record.nu[:, others]
    rates = np.column_stack([-nu, -np.abs(nu) * nu, thrust, steady, -steady, beside, -beside, nu])
    windows = _over_windows(rates, record)
    folds = [_triangle(windows[fold == number]) for number in np.unique(fold)]
    if not _improves_with_cross_terms(folds):
        return plain
    values = _bounded(np.vstack(folds))[1]
    cross = np.insert(values[PLAIN : PLAIN + 5] - values[PLAIN + 5 :], axis, 0.0)
    return Damped(-values[0], -values[1], values[2], values[3] - values[4], delay, tuple(map(float, cross)))


def _improves_with_cross_terms(folds: Sequence[Array]) -> bool:
    """Return whether cross terms lower the squared error of held-out folds, each a `_triangle`.

    One fold alone leaves nothing to fit: the answer is then False.
    """
    if len(folds) < 2:
        return False
    lost = np.zeros(2)
    for number, held_out in enumerate(folds):
        rest = np.vstack([*folds[:number], *folds[number + 1 :]])
        for which, columns in enumerate((np.r_[:PLAIN, -1], np.r_[: rest.shape[1]])):
            values = _bounded(rest[:, columns])[1]
            lost[which] += ((held_out[:, columns] @ np.append(values, -1.0)) ** 2).sum()
    return bool(lost[1] < lost[0])


def _triangle(windows: Array) -> Array:
    """Return a triangular matrix with the same products of columns as regressors and changes (W, K + 1).

    It replaces the windows in a fit, since squared residuals are equal; it has at most K + 1 rows.  Triangles
    of several parts of a recording, one below another, replace all of these parts.
    """
    return np.asarray(np.linalg.qr(windows, mode="r"))


def _bounded(windows: Array) -> tuple[float, Array]:
    """Fit nonnegative parameters by least squares, with a ridge on cross terms.

    Args:
        windows: K regressors and the change of velocity, (W, K + 1), or their `_triangle`; regressors beyond
            PLAIN are cross terms.

    Returns:
        Squared residual, up to a constant, and the parameters, (K,).
    """
    columns, change = windows[:, :-1], windows[:, -1:]
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    ridge = np.diag(np.where(np.arange(len(size)) < PLAIN, 0.0, np.sqrt(RIDGE)))
    whole = np.block([[columns / size, change], [ridge, np.zeros((len(size), 1))]])
    triangle = _triangle(whole)[: len(size)]
    inside = triangle[:, -1]
    scaled, left = scipy.optimize.nnls(triangle[:, :-1], inside)
    return float(left**2 - inside @ inside), scaled / size


def _over_windows(rates: Array, record: Recording) -> Array:
    """Return integrals of series (N, K) over all windows, and of the last series its change, (W, K)."""
    rows, parts = _window_rows(record), []
    for start, stop in record.segments:
        within = rates[start:stop]
        sums = np.zeros_like(within)
        sums[1:] = np.cumsum(0.5 * record.dt * (within[1:] + within[:-1]), axis=0)
        sums[:, -1] = within[:, -1]
        parts.append(sums[rows:] - sums[:-rows])
    return np.concatenate(parts)


def _window_rows(record: Recording) -> int:
    """Return the number of steps in a window: WINDOW, or the longest segment if it is shorter."""
    longest = int(np.diff(record.segments).max())
    return max(min(round(WINDOW / record.dt), longest - 1), 1)


def _window_starts(record: Recording) -> Rows:
    """Return the first row of each window of `_over_windows`, (W,)."""
    rows = _window_rows(record)
    return np.concatenate([np.arange(start, max(stop - rows, start)) for start, stop in record.segments])
