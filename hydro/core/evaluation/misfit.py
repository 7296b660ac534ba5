"""What a model leaves unexplained of a recording, beside what noise alone would leave.

Force.  The measured velocity less the integral of the model's acceleration along the smoothed motion
changes only where the model's forces are wrong; its smoothed derivative times M is the wrench that is
missing.  The smoother thus never blurs what the model knows, such as the jump of a thrust, and of a true
model noise alone is left.  What changes faster than FASTEST is nearly all noise in any log: it counts among
the bands of frequency only.

Replay.  Predictions of a few seconds begin again and again along the recording, at the smoothed motion; and
one prediction runs from the first row of every session to its last.

Noise floor.  The recording is disturbed by noise of the size that it has already, and the beginning of each
prediction by the uncertainty of the smoothed motion, often enough that chance does not show: the change is
what noise does to the errors.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.fft import dct, idct

from hydro.core.columns import (
    POSE,
    POSE_UNITS,
    VELOCITY,
    VELOCITY_UNITS,
    WRENCH,
    WRENCH_UNITS,
    Array,
    Mask,
    Rows,
)
from hydro.core.effects.layout import MASS_MATRIX
from hydro.core.effects.program import constants_of
from hydro.core.evaluation.regimes import Family, Pieces
from hydro.core.evaluation.weights import Weights
from hydro.core.identification.candidate import Candidate, accelerations, true_velocity
from hydro.core.identification.multiple_shooting import (
    CHANNELS,
    Prepared,
    Shots,
    corrected_first,
    displaced,
    prepare,
    residuals,
)
from hydro.core.recording import smoothing
from hydro.core.recording.arrays import LEAST_NOISE, Recording, noise
from hydro.core.recording.filling import slope_noise, unshown
from hydro.core.simulation.dynamics import BODY
from hydro.core.vehicle.frames import quaternion_from_euler

HORIZONS = (1.0, 5.0, 20.0)
"""How far ahead predictions look [s]."""
FASTEST = 2.0
"""Frequency of the fastest change of force that counts [Hz]."""
BANDS = (
    ("in motions slower than 10 s", 0.0, 0.1),
    ("in motions of 2 to 10 s", 0.1, 0.5),
    ("in motions of 0.5 to 2 s", 0.5, FASTEST),
    ("in motions faster than 0.5 s", FASTEST, np.inf),
)
"""Bands of frequency [Hz], by the time that a motion takes."""
SLOW_BAND = ("", 0.0, FASTEST)
BEYOND = np.repeat([1e3, np.pi, 1e2, 1e2], 3)
"""Errors count no more than this [m, rad, m/s, rad/s]: where a predicted motion diverges."""
PREDICTIONS_TOGETHER = 64  # predictions of one piece of work
DRAWS = (3, 16)  # of the uncertain beginning of a prediction, until they settle what noise does
SETTLED = 0.2
"""Standard error to which they do, over the squares of all predictions: a tenth of the errors."""
IMPULSE_REACH = 1000  # rows on each side of the impulse that the smoother's own weight is read from


@dataclass(frozen=True)
class Misfit:
    """Squared errors of one kind, piece by piece.

    Attributes:
        level: `force` or `replay`.
        horizon: Of the replay [s]; None for forces and for the whole run.
        axes: Names of the A axes, and of all of them together.
        units: Their units.
        weight: What a square on each axis counts for beside the others, (A,): see `evaluation.weights`.
        rows: Rows compared in each piece, (P,).
        counts: Samples compared in each piece, (P, A); None where every row has one of every axis.
        squares: Sums of squared errors, (P, A).
        noise: The same of what noise alone does, (P, A).
        block: Block of each piece, (P,).
        end: Root mean square error at the end of the predictions, (A,); None for forces.
    """

    level: str
    horizon: float | None
    axes: tuple[str, ...]
    units: tuple[str, ...]
    weight: Array
    rows: Array
    squares: Array
    noise: Array
    block: Rows
    end: Array | None = None
    counts: Array | None = None

    @property
    def numbers(self) -> Array:
        """Samples of each piece and axis, (P, A)."""
        if self.counts is not None:
            return self.counts
        return np.repeat(self.rows[:, None], len(self.units), axis=1)


@dataclass(frozen=True)
class Motion:
    """The smoothed motion of a recording.

    Attributes:
        eta: Pose with unwrapped angles, (N, 6).
        nu: Velocity as logged, (N, 6).
        nu_dot: Its derivative, (N, 6).
        sigma: Noise of the twelve channels; 0 of one without samples.
        uncertainty: Standard deviation of the smoothed channels in the first row of a segment and far from
            its ends, (2, 12).
        pose: Smoother of the pose.
        velocity: Smoother of the velocity.
    """

    eta: Array
    nu: Array
    nu_dot: Array
    sigma: Array
    uncertainty: Array
    pose: smoothing.Design
    velocity: smoothing.Design

    @classmethod
    def of(cls, record: Recording) -> Motion:
        """Smooth a recording, its noise found from it.

        Raises:
            DataError: A segment has a single row, or none has eight.
        """
        sigma = noise(record)
        never = np.zeros(CHANNELS, bool) if record.seen is None else ~record.seen.any(axis=0)
        doubt = _doubt(record, sigma)
        sigma[never] = LEAST_NOISE
        angles = record.eta.copy()
        for start, stop in record.segments:
            angles[start:stop, 3:] = np.unwrap(angles[start:stop, 3:], axis=0)
        pose = smoothing.estimate(angles, record.segments, record.dt, sigma[:6].tolist())
        velocity = smoothing.estimate(record.nu, record.segments, record.dt, sigma[6:].tolist())
        eta = smoothing.smooth(angles, record.segments, pose)[:, :, 0]
        nu, nu_dot = np.moveaxis(smoothing.smooth(record.nu, record.segments, velocity), 2, 0)
        left = np.hstack([angles - eta, record.nu - nu]).var(axis=0)
        uncertainty = _uncertainty(np.stack([_weights(pose), _weights(velocity)]), sigma, left)
        sigma[never] = 0.0
        uncertainty[:, never] = doubt[never]
        return cls(
            eta=np.ascontiguousarray(eta),
            nu=np.ascontiguousarray(nu),
            nu_dot=np.ascontiguousarray(nu_dot),
            sigma=sigma,
            uncertainty=uncertainty,
            pose=pose,
            velocity=velocity,
        )


def force(
    model: Candidate,
    record: Recording,
    motion: Motion,
    pieces: Pieces,
    seed: int,
    weights: Weights | None = None,
) -> tuple[Misfit, Misfit, Family]:
    """The wrench ON the vehicle that the model leaves out.

    Args:
        model: The model.
        record: The recording.
        motion: Its smoothed motion.
        pieces: What to sum over.
        seed: Of the noise.
        weights: Of the axes; by default by the model's own inertia.

    Returns:
        Squares of the wrench below FASTEST [N, N m]; squares of its part in each of BANDS, one band after
        the other; and the family that tells the bands apart.
    """
    rng = np.random.default_rng(seed)
    found = missing_wrench(model, record, motion.eta, motion.nu, motion.velocity)
    # The smoothers are linear: what they make of noise is added to what they made of the recording.
    extra = drawn_between(rng.standard_normal((record.rows, CHANNELS)) * motion.sigma, record)
    pose = motion.eta + smoothing.smooth(extra[:, :6], record.segments, motion.pose)[:, :, 0]
    nu = motion.nu + smoothing.smooth(extra[:, 6:], record.segments, motion.velocity)[:, :, 0]
    noisy = replace(record, nu=record.nu + extra[:, 6:])
    floor = missing_wrench(model, noisy, pose, np.ascontiguousarray(nu), motion.velocity) - found
    rows = pieces.total(np.ones(record.rows))
    shown = None if record.seen is None else record.seen[:, 6:]
    whole = Misfit(
        "force",
        None,
        (*WRENCH, "all"),
        WRENCH_UNITS,
        (weights or Weights.of(model)).force,
        rows,
        pieces.total(_counted(next(_bands(found, record, [SLOW_BAND])) ** 2, shown)),
        pieces.total(_counted(next(_bands(floor, record, [SLOW_BAND])) ** 2, shown)),
        pieces.block,
        counts=None if shown is None else pieces.total(shown.astype(float)),
    )
    count = len(BANDS)
    banded = replace(
        whole,
        rows=np.tile(rows, count),
        squares=np.concatenate([pieces.total(_counted(b**2, shown)) for b in _bands(found, record, BANDS)]),
        noise=np.concatenate([pieces.total(_counted(b**2, shown)) for b in _bands(floor, record, BANDS)]),
        block=np.tile(pieces.block, count),
        counts=None if whole.counts is None else np.tile(whole.counts, (count, 1)),
    )
    code = np.repeat(np.arange(count), len(rows))
    return whole, banded, Family("frequency", tuple(words for words, _, _ in BANDS), code, doing=False)


def replay(
    model: Candidate,
    record: Recording,
    motion: Motion,
    pieces: Pieces,
    horizon: float | None,
    seed: int,
    weights: Weights | None = None,
) -> tuple[Misfit, Misfit] | None:
    """Errors of predictions, root mean square over the horizon: of velocity, and of position and attitude.

    Args:
        model: The model.
        record: The recording.
        motion: Its smoothed motion, at which every prediction begins.
        pieces: What to sum over.
        horizon: Length of a prediction [s]; None for whole segments.
        seed: Of the noise.
        weights: Of the axes; by default by the model's own inertia.

    Returns:
        Squares of the velocity's errors, and of the errors of x, y, z in NED and of the rotation from the
        predicted to the measured attitude about the body's axes, as `phi`, `theta`, `psi`; None where no
        segment is as long as the horizon.
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


class _Predictions(NamedTuple):
    """Errors of all predictions of one horizon, row by row of the recording.

    Attributes:
        compared: 1 where a prediction was compared with the row, (N,).
        squares: Its squared errors, pose and then velocity, (N, 12).
        noise: The same of what noise alone does.
        end: Root mean square errors in the last row of the predictions, or of their last samples, (12,); NaN
            of a channel without samples.
        counted: Which rows are samples of each channel, (N, 12); None where all are.
    """

    compared: Array
    squares: Array
    noise: Array
    end: Array
    counted: Mask | None


def _predictions(
    model: Candidate, record: Recording, motion: Motion, horizon: float | None, seed: int
) -> _Predictions | None:
    """Predict end to end along the recording; None where no segment is as long as the horizon."""
    starts, segment, lengths = laid(record, horizon)
    if not starts.size:
        return None
    logged, calm = _states(record.eta, record.nu), _states(motion.eta, motion.nu)
    nothing = np.empty((len(starts), 0, BODY))
    unit = np.ones(CHANNELS)
    every = Shots(record, starts, segment, 0, 0, calm[starts], nothing, unit, motion.eta, motion.nu)
    every = corrected_first(every, model)
    prepared = prepare(model, every)
    compared = np.zeros(record.rows)
    errors, floor = np.zeros((record.rows, CHANNELS)), np.zeros((record.rows, CHANNELS))
    sums, typical = np.zeros((len(starts), DRAWS[-1], CHANNELS)), np.zeros((len(starts), CHANNELS))

    def shots_of(part: Rows) -> tuple[Prepared, Shots, Rows]:
        """Some predictions of one length, and their rows."""
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
            change = (_bounded(residuals(there, _begun_elsewhere(shots, motion, rng))) - errors[rows]) ** 2
            floor[rows] += change
            sums[part, draw] = change.sum(axis=1)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        ends = list(pool.map(predict, _batches(lengths)))
        open_, done = np.ones(len(starts), bool), 0
        for most in DRAWS:
            parts = [part[open_[part]] for part in _batches(lengths) if open_[part].any()]
            list(pool.map(disturb, parts, itertools.repeat(range(done, most))))
            open_, done = _settle(sums[:, :most], motion.sigma**2 * lengths.sum(), open_, typical), most
    scale = typical / np.maximum(sums.sum(axis=1), 1e-300)
    floor[compared > 0.0] *= np.repeat(scale, lengths, axis=0)
    floor[compared > 0.0] += motion.sigma**2
    counted = None if record.seen is None else record.seen & (compared > 0.0)[:, None]
    end = root_mean_square(np.concatenate(ends))
    return _Predictions(compared, _counted(errors**2, counted), _counted(floor, counted), end, counted)


def last_samples(errors: Array, seen: Mask | None) -> Array:
    """Errors (S, K, C) of S predictions at their last rows, or at their last samples; NaN without any."""
    if seen is None:
        return np.asarray(errors[:, -1])
    last = seen.shape[1] - 1 - seen[:, ::-1].argmax(axis=1)
    found = np.take_along_axis(errors, last[:, None], axis=1)[:, 0]
    return np.where(seen.any(axis=1), found, np.nan)


def root_mean_square(errors: Array) -> Array:
    """Of each column of (S, C), NaN left out; NaN where there is nothing else."""
    there = np.isfinite(errors)
    squares, count = np.where(there, errors, 0.0) ** 2, there.sum(axis=0)
    return np.where(count > 0, np.sqrt(squares.sum(axis=0) / np.maximum(count, 1)), np.nan)


def _doubt(record: Recording, sigma: Array) -> Array:
    """Standard deviation of what fills channels without samples, (12,): of slopes by noise of the pose."""
    pose = np.repeat([sigma[:3].max(), sigma[3:6].max()], 3)
    doubt = np.concatenate([sigma[:6], pose * slope_noise(record.dt)])
    if record.seen is None or record.doubt is None:
        return doubt
    dark = np.any([unshown(record.seen[a:b]) for a, b in record.segments], axis=0)
    return np.where(dark, record.doubt, doubt)


def _counted(values: Array, seen: Mask | None) -> Array:
    """Values (N, C) where there is a sample, 0 elsewhere."""
    return values if seen is None else values * seen


def drawn_between(noise: Array, record: Recording) -> Array:
    """Noise of samples (N, 12) as rows without one have it: on lines between those beside them."""
    if record.seen is None:
        return noise
    out = np.zeros_like(noise)
    for start, stop in record.segments:
        rows = np.arange(start, stop)
        for i, seen in enumerate(record.seen[start:stop].T):
            if seen.any():
                out[start:stop, i] = np.interp(rows, rows[seen], noise[start:stop, i][seen])
    return out


def _settle(sums: Array, known: Array, open_: Mask, typical: Array) -> Mask:
    """Write what noise does to the predictions that are open, (S,), and say which remain so.

    It is the mean of the draws where they settle it, and the median where they do not: a few draws in which a
    prediction diverges do not say what noise does to a recording.

    Args:
        sums: Squares by uncertain beginnings, of each prediction in each draw, (S, D, C).
        known: What else noise adds to the squares of all predictions, (C,).
        open_: Which predictions the draws are of.
        typical: Written: what noise does to each, (S, C).
    """
    mean = np.where(open_[:, None], sums.mean(axis=1), typical)
    error = np.std(sums, axis=1, ddof=1) / np.sqrt(sums.shape[1])
    settled = error <= SETTLED * (mean.sum(axis=0) + known) / np.sqrt(len(sums))
    typical[open_] = np.where(settled, mean, np.median(sums, axis=1))[open_]
    still: Mask = open_ & ~settled.all(axis=1)
    return still


def _states(eta: Array, nu: Array) -> Array:
    """Position, attitude as a quaternion and velocity, (N, 13)."""
    return np.hstack([eta[:, :3], quaternion_from_euler(*eta[:, 3:].T), nu])


def missing_wrench(
    model: Candidate, record: Recording, eta: Array, nu: Array, design: smoothing.Design
) -> Array:
    """The wrench ON the vehicle about CO that a model leaves out, row by row, (N, 6) [N, N m].

    M times the smoothed derivative of measured less modelled velocity; the model accounts for its thrusters,
    weight and buoyancy, effects and C(nu) of its whole mass matrix.
    """
    known = accelerations(model, record, eta, true_velocity(model, record, nu))
    left = true_velocity(model, record, record.nu).copy()
    for start, stop in record.segments:
        within = known[start:stop]
        left[start + 1 : stop] -= np.cumsum(0.5 * record.dt * (within[1:] + within[:-1]), axis=0)
    missing = smoothing.smooth(left, record.segments, design)[:, :, 1]
    mass = constants_of(model.program.flat)[MASS_MATRIX : MASS_MATRIX + 36].reshape(6, 6)
    wrench: Array = missing @ mass.T
    return wrench


def _bands(wrench: Array, record: Recording, bands: Sequence[tuple[str, float, float]]) -> Iterator[Array]:
    """Parts of a wrench (N, 6) in each band; segment by segment, as if each were followed by its mirror."""
    spectra = [dct(wrench[a:b], axis=0, norm="ortho") for a, b in record.segments]
    for _, low, high in bands:
        out = np.empty_like(wrench)
        for (a, b), spectrum in zip(record.segments, spectra, strict=True):
            frequency = np.arange(b - a) / (2.0 * (b - a) * record.dt)
            inside = (frequency >= low) & (frequency < high)
            out[a:b] = idct(spectrum * inside[:, None], axis=0, norm="ortho")
        yield out


def laid(record: Recording, horizon: float | None) -> tuple[Rows, Rows, Rows]:
    """First row, segment and rows of predictions: end to end over all segments, or one for each of them."""
    if horizon is None:
        begin, end = record.segments.T
        return begin, np.arange(len(begin)), end - begin
    length = round(horizon / record.dt) + 1
    starts = [np.arange(a, b - length + 1, length, dtype=np.int64) for a, b in record.segments]
    segment = np.repeat(np.arange(len(starts)), [part.size for part in starts])
    return np.concatenate(starts), segment, np.full(len(segment), length)


def _batches(lengths: Rows) -> list[Rows]:
    """Runs of at most PREDICTIONS_TOGETHER predictions of one length."""
    edges = [*np.flatnonzero(np.diff(lengths, prepend=-1)).tolist(), len(lengths)]
    return [
        np.arange(at, min(at + PREDICTIONS_TOGETHER, end))
        for begin, end in itertools.pairwise(edges)
        for at in range(begin, end, PREDICTIONS_TOGETHER)
    ]


def _begun_elsewhere(shots: Shots, motion: Motion, rng: np.random.Generator) -> Shots:
    """The shots with beginnings as uncertain as the smoothed motion is."""
    at_edge = shots.starts == shots.record.segments[shots.segment, 0]
    shift = rng.standard_normal((len(shots.starts), CHANNELS)) * motion.uncertainty[np.where(at_edge, 0, 1)]
    return replace(shots, first=displaced(shots.first, shift))


def _bounded(error: Array) -> Array:
    """Errors within BEYOND, the attitude's as a rotation vector, not twice a quaternion's vector part."""
    out = np.nan_to_num(error, nan=np.inf)
    half = np.clip(0.5 * np.linalg.norm(out[..., 3:6], axis=-1, keepdims=True), 0.0, 1.0)
    out[..., 3:6] *= np.where(half > 1e-9, np.arcsin(half) / np.maximum(half, 1e-9), 1.0)
    bounded: Array = np.clip(out, -BEYOND, BEYOND)
    return bounded


def _weights(design: smoothing.Design) -> Array:
    """Of a row's smoothed value: weight of its own measurement and sum of the squares of all weights.

    In the first row of a segment, and far from its ends; (2, 2, 6).
    """
    impulse = np.zeros((2, 2 * IMPULSE_REACH + 1, 6))
    impulse[0, 0] = impulse[1, IMPULSE_REACH] = 1.0
    bounds = [[0, 2 * IMPULSE_REACH + 1]]
    first, inner = (smoothing.smooth(one, bounds, design)[:, :, 0] for one in impulse)
    squares = [(one**2).sum(axis=0) for one in (first, inner)]
    return np.stack([np.stack([first[0], inner[IMPULSE_REACH]]), np.stack(squares)])


def _uncertainty(weights: Array, sigma: Array, left: Array) -> Array:
    """Standard deviation of the smoothed channels in the first row and in the middle, (2, 12).

    Noise passes with the sum of squared weights.  What smoothing took away beyond its share of the noise was
    motion, and is missing from the smoothed value.

    Args:
        weights: Of pose and velocity as `_weights` gives them, (2, 2, 2, 6).
        sigma: Noise of the channels, (12,).
        left: Variance of measured less smoothed, (12,).
    """
    own, passed = np.concatenate([weights[0], weights[1]], axis=2)
    blurred = np.maximum(left - sigma**2 * (1.0 - 2.0 * own[1] + passed[1]), 0.0)
    spread: Array = np.sqrt(sigma**2 * passed + blurred)
    return spread
