"""Errors of predictions of a recording, with the part that noise alone causes.

Predictions of a few seconds restart along the recording at the smoothed motion.  A further prediction covers
each segment from its first row to its last.
"""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import polars as pl

from hydro.core.columns import POSE, POSE_UNITS, VELOCITY, VELOCITY_UNITS, Array, Mask, Rows
from hydro.core.effects.waves import drawn
from hydro.core.errors import DataError
from hydro.core.evaluation.misfit import Misfit, counted
from hydro.core.evaluation.regimes import Pieces
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.evaluation.weights import Weights
from hydro.core.prediction.candidate import Candidate, candidate
from hydro.core.prediction.multiple_shooting import (
    Prepared,
    corrected_first,
    displaced,
    prepare,
    residuals,
)
from hydro.core.recording.arrays import Recording, recording
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.simulation.dynamics import BODY
from hydro.core.threads import available
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import body_states

HORIZONS = (1.0, 5.0, 20.0)
"""Prediction horizons [s]."""
AHEAD = 5.0
"""Prediction horizon at which vehicles are compared [s]."""
BEYOND = np.repeat([1e3, np.pi, 1e2, 1e2], 3)
"""Bound on errors where a predicted motion diverges [m, rad, m/s, rad/s]."""
PREDICTIONS_TOGETHER = 64
"""Maximum number of predictions in one unit of parallel work."""
DRAWS = (3, 16)
"""Noise draws per prediction: for all predictions, then for those with a still uncertain noise floor."""
SETTLED = 0.2
"""Relative standard error of the squared noise floor at which draws end: a tenth in the error itself."""


def replay(
    model: Candidate,
    record: Recording,
    motion: Motion,
    pieces: Pieces,
    horizon: float | None,
    seed: int,
    weights: Weights | None = None,
) -> tuple[Misfit, Misfit] | None:
    """Return squared errors of velocity and of pose in predictions over a horizon.

    Args:
        model: Compiled vehicle.
        record: Recording.
        motion: Smoothed motion of the recording, at which every prediction starts.
        pieces: Pieces of time over which squares are summed.
        horizon: Length of a prediction [s]; None for whole segments.
        seed: Seed of the noise from which the errors due to noise alone are computed.
        weights: Weights of the axes; by default from the model's inertia.

    Returns:
        Squares of the velocity errors; and squares of the pose errors: x, y, z in NED, and the rotation from
        the predicted to the measured attitude about the body axes, named `phi`, `theta` and `psi`.  None if
        no segment is as long as the horizon.
    """
    if (found := _predictions(model, record, motion, horizon, seed)) is None:
        return None
    weights = weights or Weights.of(model)
    rows, sums, floor = (pieces.total(part) for part in (found.compared, found.squares, found.noise))
    block = pieces.segment if horizon is None else pieces.block
    counts = None if found.counted is None else pieces.total(found.counted.astype(float))

    def misfit(axes: tuple[str, ...], units: tuple[str, ...], weight: Array, of: slice) -> Misfit:
        parts = (rows, sums[:, of], floor[:, of], block, found.end[of])
        return Misfit(
            "replay", horizon, axes, units, weight, *parts, None if counts is None else counts[:, of]
        )

    return (
        misfit((*VELOCITY, "all"), VELOCITY_UNITS, weights.velocity, slice(6, 12)),
        misfit((*POSE, "pose"), POSE_UNITS, weights.pose, slice(0, 6)),
    )


class Ahead:
    """Calculator of velocity errors in predictions of 5 s on one recording.

    Errors on the axes are weighted by the inertia of a first vehicle, so that vehicles can be compared.

    Attributes:
        floor: Error of the first vehicle due to noise alone [m/s].
    """

    def __init__(self, raw: pl.DataFrame, vehicle: Vehicle) -> None:
        """Smooth a recording, and take the weights of the axes from the first vehicle.

        Args:
            raw: Raw table of the measured motion and commands.
            vehicle: First vehicle.

        Raises:
            DataError: The recording does not fit the vehicle, or no session lasts AHEAD seconds without a
                gap.
        """
        self.record = record = recording(vehicle, raw)
        self.motion, self.pieces = Motion.of(record), Pieces.of(record)
        self.weight: Array | None = None
        self.floor = np.nan
        self.of(vehicle)

    def of(self, vehicle: Vehicle) -> float:
        """Return the root mean square velocity error of a vehicle in predictions of AHEAD seconds [m/s].

        The mean is over all rows of the predictions and over all axes, weighted by the inertia of the first
        vehicle.

        Raises:
            DataError: No session lasts AHEAD seconds without a gap.
        """
        both = replay(candidate(vehicle), self.record, self.motion, self.pieces, AHEAD, 0)
        if both is None:
            raise DataError(f"no session lasts {AHEAD:g} s without a gap; record longer sessions")
        velocity, _ = both
        if self.weight is None:
            self.weight = velocity.weight
            self.floor = float(np.sqrt((velocity.noise.sum(axis=0) @ self.weight) / velocity.rows.sum()))
        squares = velocity.squares.sum(axis=0) @ self.weight
        return float(np.sqrt(squares / velocity.rows.sum()))


class _Predictions(NamedTuple):
    """Errors of all predictions over one horizon, in every row of the recording.

    Attributes:
        compared: 1 where a prediction was compared with the row, else 0, (N,).
        squares: Squared errors, pose and then velocity, (N, 12).
        noise: Squared errors due to noise and to the waves of the file, (N, 12).
        end: Root mean square errors in the last row of the predictions, or at their last samples, (12,); NaN
            for a channel without samples.
        counted: Mask of the samples of each channel, (N, 12); None if every row has samples.
    """

    compared: Array
    squares: Array
    noise: Array
    end: Array
    counted: Mask | None


def _predictions(
    model: Candidate, record: Recording, motion: Motion, horizon: float | None, seed: int
) -> _Predictions | None:
    """Return the errors of predictions end to end along a recording; None if no segment is long enough."""
    starts, segment, lengths = laid(record, horizon)
    if not starts.size:
        return None
    logged, calm = body_states(record.eta, record.nu), body_states(motion.eta, motion.nu)
    nothing = np.empty((len(starts), 0, BODY))
    unit = np.ones(CHANNELS)
    every = Shots(record, starts, segment, 0, 0, calm[starts], nothing, unit, motion.eta, motion.nu)
    every = corrected_first(every, model)
    prepared = prepare(model, every)
    compared = np.zeros(record.rows)
    errors, floor = np.zeros((record.rows, CHANNELS)), np.zeros((record.rows, CHANNELS))
    sums, typical = np.zeros((len(starts), DRAWS[-1], CHANNELS)), np.zeros((len(starts), CHANNELS))

    def shots_of(part: Rows) -> tuple[Prepared, Shots, Rows]:
        """Return predictions of equal length as shots of a prepared candidate, and their rows."""
        rows = starts[part, None] + np.arange(lengths[part[0]])
        there = replace(
            every,
            starts=starts[part],
            segment=segment[part],
            length=rows.shape[1],
            first=every.first[part],
            measured=logged[rows],
        )
        return Prepared(model, prepared.rotors[part], prepared.memory[part]), there, rows

    def predict(part: Rows) -> Array:
        there, shots, rows = shots_of(part)
        errors[rows], compared[rows] = _bounded(residuals(there, shots)), 1.0
        return last_samples(errors[rows], None if record.seen is None else record.seen[rows])

    def disturb(part: Rows, draws: range) -> None:
        there, shots, rows = shots_of(part)
        rng = np.random.default_rng([seed, draws.start, part[0]])
        for draw in draws:
            if model.seas:
                waves = np.concatenate([drawn(sea, rng) for sea in model.seas])
                there = replace(there, model=model.in_sea(waves))
            change = (_bounded(residuals(there, _begun_elsewhere(shots, motion, rng))) - errors[rows]) ** 2
            floor[rows] += change
            sums[part, draw] = change.sum(axis=1)

    with ThreadPoolExecutor(available()) as pool:
        ends = list(pool.map(predict, _batches(lengths)))
        open_, done = np.ones(len(starts), bool), 0
        for most in DRAWS:
            parts = [part[open_[part]] for part in _batches(lengths) if open_[part].any()]
            list(pool.map(disturb, parts, itertools.repeat(range(done, most))))
            open_, done = _settle(sums[:, :most], motion.sigma**2 * lengths.sum(), open_, typical), most
    scale = typical / np.maximum(sums.sum(axis=1), 1e-300)
    floor[compared > 0.0] *= np.repeat(scale, lengths, axis=0)
    floor[compared > 0.0] += motion.sigma**2
    seen = None if record.seen is None else record.seen & (compared > 0.0)[:, None]
    end = root_mean_square(np.concatenate(ends))
    return _Predictions(compared, counted(errors**2, seen), counted(floor, seen), end, seen)


def last_samples(errors: Array, seen: Mask | None) -> Array:
    """Return the errors at the end of each of S predictions, (S, C).

    Args:
        errors: Errors of S predictions of K rows in C channels, (S, K, C).
        seen: Which errors belong to samples, (S, K, C); None if all do.  The last sample of a channel then
            counts instead of the last row, and a channel without samples gives NaN.
    """
    if seen is None:
        return np.asarray(errors[:, -1])
    last = seen.shape[1] - 1 - seen[:, ::-1].argmax(axis=1)
    found = np.take_along_axis(errors, last[:, None], axis=1)[:, 0]
    return np.where(seen.any(axis=1), found, np.nan)


def root_mean_square(errors: Array) -> Array:
    """Return the root mean square over S predictions of the error in each of C channels, (C,).

    NaN are left out; the result is NaN for a channel with no other value.

    Args:
        errors: Errors of S predictions, (S, C).
    """
    there = np.isfinite(errors)
    squares, count = np.where(there, errors, 0.0) ** 2, there.sum(axis=0)
    return np.where(count > 0, np.sqrt(squares.sum(axis=0) / np.maximum(count, 1)), np.nan)


def _settle(sums: Array, known: Array, open_: Mask, typical: Array) -> Mask:
    """Store the squared error due to noise of open predictions, and return which are still open, (S,).

    The stored value is the mean of the draws if their scatter is small enough, and the median otherwise: a
    few draws in which a prediction diverges are not representative of a recording.

    Args:
        sums: Squared errors due to uncertain starts, of each prediction in each draw, (S, D, C).
        known: Squared errors of all predictions due to other noise, (C,).
        open_: Mask of the predictions that were drawn, (S,).
        typical: Output: squared error due to noise of each prediction, (S, C).
    """
    mean = np.where(open_[:, None], sums.mean(axis=1), typical)
    error = np.std(sums, axis=1, ddof=1) / np.sqrt(sums.shape[1])
    settled = error <= SETTLED * (mean.sum(axis=0) + known) / np.sqrt(len(sums))
    typical[open_] = np.where(settled, mean, np.median(sums, axis=1))[open_]
    still: Mask = open_ & ~settled.all(axis=1)
    return still


def laid(record: Recording, horizon: float | None) -> tuple[Rows, Rows, Rows]:
    """Return first row, segment and number of rows of each of S predictions, (S,) each.

    Args:
        record: Recording.
        horizon: Length of predictions [s], which lie end to end along each segment; None for one prediction
            over each segment.
    """
    if horizon is None:
        begin, end = record.segments.T
        return begin, np.arange(len(begin)), end - begin
    length = round(horizon / record.dt) + 1
    starts = [np.arange(a, b - length + 1, length, dtype=np.int64) for a, b in record.segments]
    segment = np.repeat(np.arange(len(starts)), [part.size for part in starts])
    return np.concatenate(starts), segment, np.full(len(segment), length)


def _batches(lengths: Rows) -> list[Rows]:
    """Return groups of at most PREDICTIONS_TOGETHER predictions of equal length, as arrays of numbers."""
    edges = [*np.flatnonzero(np.diff(lengths, prepend=-1)).tolist(), len(lengths)]
    return [
        np.arange(at, min(at + PREDICTIONS_TOGETHER, end))
        for begin, end in itertools.pairwise(edges)
        for at in range(begin, end, PREDICTIONS_TOGETHER)
    ]


def _begun_elsewhere(shots: Shots, motion: Motion, rng: np.random.Generator) -> Shots:
    """Return shots whose starts are disturbed at random by the uncertainty of the smoothed motion."""
    at_edge = shots.starts == shots.record.segments[shots.segment, 0]
    shift = rng.standard_normal((len(shots.starts), CHANNELS)) * motion.uncertainty[np.where(at_edge, 0, 1)]
    return replace(shots, first=displaced(shots.first, shift))


def _bounded(error: Array) -> Array:
    """Return errors clipped to BEYOND, with the attitude as a rotation vector [rad].

    On entry the attitude is twice the vector part of a quaternion.
    """
    out = np.nan_to_num(error, nan=np.inf, posinf=np.inf, neginf=-np.inf)
    half = np.clip(0.5 * np.linalg.norm(out[..., 3:6], axis=-1, keepdims=True), 0.0, 1.0)
    out[..., 3:6] *= np.where(half > 1e-9, np.arcsin(half) / np.maximum(half, 1e-9), 1.0)
    bounded: Array = np.clip(out, -BEYOND, BEYOND)
    return bounded
