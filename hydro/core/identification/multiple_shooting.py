"""Output error over short shots: predict a few seconds from many places of a recording, and compare.

A long replay of a vehicle that is unstable on its own (the Munk moment makes most of them so) says little of
its parameters; two seconds do, provided that each shot begins where the vehicle was.  The twelve numbers of
that beginning are free, and eliminated shot by shot (multiple shooting, Bock 1983; variable projection, Golub
and Pereyra 1973).  Forces, thrusters, currents and sensors all act on the prediction, so that every effect of
the catalogue is judged in one unit: standard deviations of the measurement noise.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Rows
from hydro.core.compiled import jit
from hydro.core.effects import sensor
from hydro.core.effects.layout import MOTION
from hydro.core.effects.program import STATE_COUNT, thrusters_of
from hydro.core.errors import DataError
from hydro.core.identification.candidate import Candidate, memories, rotor_states, true_velocity
from hydro.core.recording.arrays import Recording, noise, smoothed
from hydro.core.simulation.dynamics import observe
from hydro.core.simulation.integrate import BODY, NO_HULL, advance, resume
from hydro.core.vehicle.frames import quaternion_from_euler
from hydro.core.vehicle.thrusters import same_states

SECONDS = 2.0
"""Length of a shot: long enough for forces to show in the velocity, too short to diverge."""
CHANNELS = 12  # position, attitude, velocity, rates: three each
NUDGE = np.full(CHANNELS, 1e-3)  # of the initial state, for its derivatives [m, rad, m/s, rad/s]
TRUST = np.repeat([0.1, 0.1, 0.3, 0.3], 3)  # of the initial state at sight [m, rad, m/s, rad/s]
UNKNOWN = 0.5  # s, after a gap, in which thrusters still obey commands that it swallowed
LONGEST_STEP = 0.02  # s; the classical Runge-Kutta method is good to 1e-6 there on a vehicle's time scales
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
WILD = 20.0
"""Error of a velocity [m/s] or rate [rad/s] beyond which a prediction is lost, not wrong."""
ENDLESS = 1e9
"""Residual or derivative [standard deviations] of a prediction that knows no bounds: sums still hold it."""
TOGETHER = 16  # shots of one piece of work: their derivatives stay within some tens of MB


@dataclass(frozen=True)
class Shots:
    """Short stretches of a recording, each predicted from its own beginning.

    Attributes:
        record: The recording.
        starts: First row of each, (S,).
        segment: Segment of the recording that each lies in, (S,).
        length: Rows of each.
        lead: Rows at the beginning that are predicted but not compared: what a late sensor looks back on.
        first: State at the beginning of each, (S, 13): position, quaternion, nu.
        measured: What was logged, (S, length, 13).
        sigma: Standard deviation of position, attitude (small rotations about the body's axes), velocity and
            rates, (12,).
        eta: Smoothed pose and
        nu: velocity of the whole recording, (N, 6) each.
        share: Of all shots that the recording has room for.
    """

    record: Recording
    starts: Rows
    segment: Rows
    length: int
    lead: int
    first: Array
    measured: Array
    sigma: Array
    eta: Array
    nu: Array
    share: float = 1.0

    @property
    def residuals(self) -> int:
        """Numbers compared in one shot."""
        return (self.length - self.lead) * CHANNELS


def aim(
    record: Recording,
    *,
    seconds: float = SECONDS,
    lead: float = 0.0,
    sigma: Array | None = None,
    most: int | None = None,
) -> Shots:
    """Lay shots end to end over a recording, or spread some of them evenly over it.

    Behind a gap they begin half a second later where there is room: what the thrusters did is not known.

    Args:
        record: The recording.
        seconds: Length of what is compared of each [s].
        lead: Predicted before it [s]; at least the greatest delay of a sensor that is to be tried.
        sigma: Noise of the twelve channels; by default found from the recording.
        most: Shots to keep of a long recording, see `evenly`; by default all.

    Raises:
        DataError: No segment is as long as one shot.
    """
    ahead = int(np.ceil(lead / record.dt - 1e-9)) if lead > 0.0 else 0
    compared = max(round(seconds / record.dt), 6)
    length = ahead + compared
    unknown = np.where(record.after_gap, round(UNKNOWN / record.dt), 0)
    starts = [
        np.arange(a + min(lost, max(b - a - length, 0)), b - length + 1, compared, dtype=np.int64)
        for (a, b), lost in zip(record.segments, unknown, strict=True)
    ]
    if not sum(part.size for part in starts):
        raise DataError(
            f"no session has {length} rows ({length * record.dt:g} s) without a gap; record longer sessions"
        )
    room = sum(part.size for part in starts)
    kept = evenly(room, most)
    at = np.concatenate(starts)[kept]
    rows = at[:, None] + np.arange(length)
    eta, nu = smoothed(record)
    quaternion = quaternion_from_euler(*record.eta[:, 3:].T)
    logged = np.hstack([record.eta[:, :3], quaternion, record.nu])
    calm = np.hstack([eta[:, :3], quaternion_from_euler(*eta[:, 3:].T), nu])
    return Shots(
        record=record,
        starts=at,
        segment=np.repeat(np.arange(len(starts)), [part.size for part in starts])[kept],
        length=length,
        lead=ahead,
        first=calm[at],
        measured=logged[rows],
        sigma=noise(record) if sigma is None else np.asarray(sigma, float),
        eta=eta,
        nu=nu,
        share=len(kept) / room,
    )


def evenly(count: int, most: int | None) -> Rows:
    """Which of `count` shots in order to keep so that there are at most `most`, rising.

    One of each of `most` equal stretches, at a place within it that the golden ratio moves on from stretch to
    stretch: no rhythm of sessions or of manoeuvres is met, and the same shots are kept every time.
    """
    if most is None or count <= most:
        return np.arange(count, dtype=np.int64)
    edges = np.arange(most + 1) * count // most
    places = np.arange(most) * GOLDEN % 1.0
    chosen: Rows = edges[:-1] + (places * np.diff(edges)).astype(np.int64)
    return chosen


def bounded(loaded: Loaded, shots: Shots) -> NDArray[np.bool_]:
    """Which shots a candidate predicts without leaving all bounds, (S,)."""
    nu = predict(loaded, shots)[..., 7:]
    with np.errstate(invalid="ignore"):
        tame = np.abs(nu - shots.measured[..., 7:]) < WILD
    return np.asarray(tame.all(axis=(1, 2)))


def some(shots: Shots, kept: NDArray[np.bool_]) -> Shots:
    """The shots that a mask (S,) keeps."""
    parts = ("starts", "segment", "first", "measured")
    return replace(shots, **{name: getattr(shots, name)[kept] for name in parts})


def corrected_first(shots: Shots, model: Candidate) -> Shots:
    """The same shots, begun with the velocity that the candidate's log would have misread as it did."""
    first = shots.first.copy()
    first[:, 7:] = true_velocity(model, shots.record, shots.nu)[shots.starts]
    return replace(shots, first=first)


@dataclass(frozen=True)
class Loaded:
    """A candidate with what it brings to the beginning of every shot: rotors (S, n), memories (S, states)."""

    model: Candidate
    rotors: Array
    memory: Array

    def of(self, kept: NDArray[np.bool_]) -> Loaded:
        """The same for the shots that a mask (S,) keeps."""
        return Loaded(self.model, self.rotors[kept], self.memory[kept])


def load(model: Candidate, shots: Shots, like: Loaded | None = None) -> Loaded:
    """Work out a candidate's states at the beginning of every shot; `like` has perhaps the same thrusters."""
    if like is not None and same_states(like.model.thrusters, model.thrusters):
        rotors = like.rotors
    else:
        rotors = rotor_states(model, shots.record)[shots.starts]
    memory = np.zeros((len(shots.starts), 0))
    if model.program.states:
        nu = true_velocity(model, shots.record, shots.nu)
        memory = memories(model, shots.record, shots.eta, nu)[shots.starts]
    return Loaded(model, rotors, memory)


def predict(
    loaded: Loaded,
    shots: Shots,
    first: Array | None = None,
    part: slice = slice(None),
) -> Array:
    """What would have been logged, shot by shot.

    Args:
        loaded: The candidate.
        shots: The shots.
        first: Other beginnings, (S, 13).
        part: Which shots.

    Returns:
        Position, quaternion, nu of every row, (s, length, 13); not finite where a motion knows no bounds.
    """
    record, begin = shots.record, shots.first if first is None else first
    starts = np.ascontiguousarray(shots.starts[part])
    out = np.empty((starts.size, shots.length, BODY))
    _shoot(
        loaded.model.program.flat,
        record.commands,
        record.t,
        record.segments[shots.segment[part]],
        record.after_gap[shots.segment[part]],
        starts,
        substeps(record),
        np.ascontiguousarray(begin[part]),
        loaded.rotors[part],
        loaded.memory[part],
        out,
    )
    if loaded.model.log.any():
        clock = np.arange(shots.length) * record.dt
        finite = np.nan_to_num(out[..., 7:], nan=1e6, posinf=1e6, neginf=-1e6)
        out[..., 7:] = sensor.measured(loaded.model.log, clock, finite)
    return out


def substeps(record: Recording) -> int:
    """Integration steps of one row of a recording."""
    return max(1, int(np.ceil(record.dt / LONGEST_STEP * (1.0 - 1e-9))))


def residuals(
    loaded: Loaded,
    shots: Shots,
    first: Array | None = None,
    part: slice = slice(None),
) -> Array:
    """Measured less predicted in standard deviations of the noise, (s, length - lead, 12).

    The attitude's is the small rotation from the predicted to the measured one, about the predicted axes.
    """
    predicted = predict(loaded, shots, first, part)
    out = np.empty((predicted.shape[0], shots.length - shots.lead, CHANNELS))
    deviate(predicted[:, shots.lead :], shots.measured[part][:, shots.lead :], 1.0 / shots.sigma, out)
    return out


def costs(loaded: Loaded, shots: Shots, *, threads: int | None = None) -> Array:
    """Sum of squared residuals of each shot, (S,); infinite where a motion knows no bounds."""

    def work(begin: int) -> Array:
        error = residuals(loaded, shots, None, slice(begin, begin + TOGETHER))
        squares: Array = np.einsum("mki,mki->m", error, error)
        return squares

    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        each = np.concatenate(list(pool.map(work, range(0, len(shots.starts), TOGETHER))))
    each[~(each < ENDLESS**2)] = np.inf
    return each


def cost(loaded: Loaded, shots: Shots) -> float:
    """Sum of squared residuals over all shots; infinite where a motion knows no bounds."""
    return float(costs(loaded, shots).sum())


def displaced(first: Array, shift: Array) -> Array:
    """Beginnings (S, 13) moved by (S, 12): position, small rotation about the body's axes, nu."""
    half = 0.5 * shift[:, 3:6]
    w = np.ones(len(first)) * np.sqrt(np.maximum(1.0 - (half**2).sum(axis=1), 0.0))
    a, b, c = half[:, 0], half[:, 1], half[:, 2]
    q0, q1, q2, q3 = first[:, 3:7].T
    out = np.empty((len(first), BODY))
    out[:, :3] = first[:, :3] + shift[:, :3]
    out[:, 3] = q0 * w - q1 * a - q2 * b - q3 * c
    out[:, 4] = q0 * a + q1 * w + q2 * c - q3 * b
    out[:, 5] = q0 * b - q1 * c + q2 * w + q3 * a
    out[:, 6] = q0 * c + q1 * b - q2 * a + q3 * w
    out[:, 7:] = first[:, 7:] + shift[:, 6:]
    return out


@jit
def deviate(predicted: Array, measured: Array, weight: Array, out: Array) -> None:
    """Weighted differences; of the attitude, twice the vector part of q_predicted^* q_measured."""
    for m in range(predicted.shape[0]):
        for k in range(predicted.shape[1]):
            a, b, e = predicted[m, k], measured[m, k], out[m, k]
            for i in range(3):
                e[i] = (b[i] - a[i]) * weight[i]
            scalar = a[3] * b[3] + a[4] * b[4] + a[5] * b[5] + a[6] * b[6]
            twice = 2.0 if scalar >= 0.0 else -2.0
            e[3] = twice * (a[3] * b[4] - a[4] * b[3] - a[5] * b[6] + a[6] * b[5]) * weight[3]
            e[4] = twice * (a[3] * b[5] + a[4] * b[6] - a[5] * b[3] - a[6] * b[4]) * weight[4]
            e[5] = twice * (a[3] * b[6] - a[4] * b[5] + a[5] * b[4] - a[6] * b[3]) * weight[5]
            for i in range(6, 12):
                e[i] = (b[i + 1] - a[i + 1]) * weight[i]


@jit
def _shoot(
    flat: Array,
    commands: Array,
    t: Array,
    bounds: Rows,
    resumed: NDArray[np.bool_],
    starts: Rows,
    substeps: int,
    first: Array,
    rotor: Array,
    memory: Array,
    out: Array,
) -> None:
    """Predict each shot; commands of its own segment alone are felt, from before its beginning too."""
    table = thrusters_of(flat)
    count = table.shape[0]
    y, s = np.zeros(BODY + int(flat[STATE_COUNT])), np.zeros(MOTION)
    target, upcoming, decay = np.zeros(count), np.zeros(count, np.int64), np.ones(count)
    rotors, work = np.zeros((3, count)), np.zeros((4, max(y.size, 6)))
    for m in range(starts.size):
        begin, end = bounds[m, 0], bounds[m, 1]
        clock, demand, at = t[begin:end], commands[begin:end], starts[m] - begin
        y[:BODY] = first[m]
        y[BODY:] = memory[m]
        observe(flat, y[:3], y[3:7], y[7:BODY], s)
        rotors[2] = rotor[m]
        due = resume(table, demand, clock, at, resumed[m], target, upcoming)
        for k in range(out.shape[1]):
            out[m, k] = y[:BODY]
            if k + 1 == out.shape[1]:
                break
            h = (clock[at + k + 1] - clock[at + k]) / substeps
            for j in range(substeps):
                now, stop = clock[at + k] + j * h, clock[at + k] + (j + 1) * h
                due = advance(
                    flat,
                    NO_HULL,
                    table,
                    demand,
                    clock,
                    now,
                    stop,
                    due,
                    target,
                    upcoming,
                    decay,
                    rotors,
                    y,
                    s,
                    work,
                )
