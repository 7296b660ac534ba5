"""Output error over short shots: predict a few seconds from many rows of a recording, and compare.

Many vehicles are unstable on their own because of the Munk moment.  A long replay of such a vehicle holds
little information on its parameters.  Two seconds do, if each shot (short prediction) starts from the true
state.  The twelve initial values are free, and eliminated shot by shot (multiple shooting, Bock 1983;
variable projection, Golub and Pereyra 1973).  Forces, thrusters, currents and sensors all act on the
prediction.  So every effect of the catalogue is judged in one unit: standard deviations of the measurement
noise.

With an anchor, the logged initial state counts as a sample, so that the initial state is no longer free.  The
lead of a shot is a number of rows at its start that are predicted but not compared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Rows
from hydro.core.compiled import copy_kernel, jit, kernel
from hydro.core.effects import sensor
from hydro.core.effects.program import same_memories
from hydro.core.prediction.candidate import Candidate, memories, rotor_states, true_velocity
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.simulation.dynamics import BODY, NO_HULL, afloat
from hydro.core.simulation.integrate import Course, at_rest, march, resume
from hydro.core.simulation.simulate import steps_of_row
from hydro.core.simulation.variational_equation import NO_CHANGES, Changes, deviations_of
from hydro.core.threads import available, spread
from hydro.core.vehicle.frames import body_states, quaternion_product
from hydro.core.vehicle.thrusters import same_states

NUDGE = np.full(CHANNELS, 1e-3)  # step of the initial state for derivatives [m, rad, m/s, rad/s]
LONGEST_STEP = 0.02  # s; the classical Runge-Kutta method is accurate to 1e-6 at a vehicle's time scales
WILD = 20.0
"""Error of a velocity [m/s] or rate [rad/s] above which a prediction counts as diverged."""
ENDLESS = 1e9
"""Limit of residuals and derivatives of a diverging prediction [standard deviations]; sums remain finite."""
SHOTS_TOGETHER, MOST_TOGETHER = 8, 24
"""Least and greatest number of shots per work item: derivatives need at most some tens of MB."""


class Places(NamedTuple):
    """Places of S shots (short predictions) in a recording of N rows and n thrusters.

    Attributes:
        commands: Effective commands of the recording, (N, n).
        t: Times of the rows [s], (N,).
        bounds: First row, and row after the last, of the uninterrupted segment that holds each shot, (S, 2).
        resumed: Whether that segment follows a gap, (S,).
        starts: First row of each shot, (S,).
        steps: Integration steps per row.
    """

    commands: Array
    t: Array
    bounds: Rows
    resumed: NDArray[np.bool_]
    starts: Rows
    steps: int


class InitialStates(NamedTuple):
    """Initial states of S shots.

    Attributes:
        first: States of the body: position, quaternion, nu, (S, 13).
        rotors: Lag states of n thrusters, (S, n).
        memory: Internal states of the effects, (S, states).
    """

    first: Array
    rotors: Array
    memory: Array


class Answers(NamedTuple):
    """Responses of S shots (short predictions) of K rows to changes of initial states and of P parameters.

    Attributes:
        changes: The parameters, as changes of the compiled vehicle.
        ahead: Change of the initial internal states per unit of each parameter, (S, states, P).
        own: Initial internal states of the effects that a change adds, (S, all).
        out: Output, filled by `shoot`: deviations of the 12 channels per unit of the initial state and of
            each parameter, in every row or in some rows, (S, J, 12, 12 + P).
        stride: Integration steps after which deviations advance.  If rows have one step each, the output is
            for every row whose number is a multiple of it, and the last row; otherwise for all K rows.
        wanted: Whether `shoot` computes the responses.
    """

    changes: Changes
    ahead: Array
    own: Array
    out: Array
    stride: int
    wanted: bool

    @classmethod
    def none(cls, memory: Array) -> Answers:
        """Return empty responses with the array types that `shoot` needs, so that numba compiles it once.

        Args:
            memory: Initial internal states, (S, states).
        """
        return cls.to_beginnings(memory, 1)._replace(
            wanted=False
        )  # a row, since numba sees none as contiguous

    @classmethod
    def to_beginnings(cls, memory: Array, rows: int) -> Answers:
        """Return memory for the responses of S shots to their initial states alone, without parameters.

        The array for the responses has the memory layout of `sensitivity.linearise`, so that numba compiles
        `shoot` only once.

        Args:
            memory: Initial internal states, (S, states).
            rows: Rows K of every shot.
        """
        columns = np.empty((len(memory), rows, CHANNELS, CHANNELS + 1))
        ahead, own = np.zeros((*memory.shape, 0)), np.zeros((len(memory), 0))
        return cls(NO_CHANGES, ahead, own, columns[..., :CHANNELS], 1, wanted=True)


def places_of(shots: Shots, part: slice) -> Places:
    """Return the places in the recording of a slice of its shots (short predictions).

    Args:
        shots: All shots.
        part: Slice of the shots.
    """
    record, segment = shots.record, shots.segment[part]
    return Places(
        commands=record.commands,
        t=record.t,
        bounds=record.segments[segment],
        resumed=record.after_gap[segment],
        starts=np.ascontiguousarray(shots.starts[part]),
        steps=shots.steps or most_steps(shots),
    )


def most_steps(shots: Shots) -> int:
    """Return the number of integration steps per row that suffices for residuals as small as the noise."""
    return steps_of_row(shots.record.dt, 1.0 / LONGEST_STEP)


def bounded(prepared: Prepared, shots: Shots) -> NDArray[np.bool_]:
    """Return a mask, (S,), of the shots (short predictions) in which a model's prediction does not diverge.

    Args:
        prepared: The model, prepared for the shots.
        shots: The S shots.
    """
    nu = predict(prepared, shots)[..., 7:]
    with np.errstate(invalid="ignore"):
        tame = np.abs(nu - shots.measured[..., 7:]) < WILD
    return np.asarray(tame.all(axis=(1, 2)))


def corrected_first(shots: Shots, model: Candidate) -> Shots:
    """Return a copy of the shots with initial states from the logged motion, corrected for DVL errors.

    Args:
        shots: The shots; their previous initial states are replaced.
        model: Compiled vehicle with the DVL errors to correct.
    """
    return replace(shots, first=logged_first(shots, model))


def logged_first(shots: Shots, model: Candidate) -> Array:
    """Return the logged motion at the start of each shot, corrected to CO for a vehicle's DVL errors.

    Args:
        shots: S shots, with the smoothed motion of the recording.
        model: Compiled vehicle with the DVL errors.

    Returns:
        Position, quaternion and nu, (S, 13).
    """
    logged = body_states(shots.eta[shots.starts], shots.nu[shots.starts])
    first = sensor.true_position(model.log, logged)
    first[:, 7:] = true_velocity(model, shots.record, shots.nu)[shots.starts]
    return first


def initial_residuals(model: Candidate, shots: Shots) -> Array:
    """Return logged minus present initial states, in standard deviations of the logged states, (S, 12).

    Args:
        model: Compiled vehicle, for whose DVL errors the logged states are corrected.
        shots: S shots with an `anchor`: one over the standard deviation of each logged initial state.
    """
    assert shots.anchor is not None
    out = np.empty((len(shots.starts), 1, CHANNELS))
    deviate(shots.first[:, None], logged_first(shots, model)[:, None], 0, np.ones(CHANNELS), out)
    return np.asarray(out[:, 0] * shots.anchor)


@dataclass(frozen=True)
class Prepared:
    """Compiled vehicle with its initial rotor states and internal states in each of S shots.

    Attributes:
        model: The compiled vehicle.
        rotors: Lag states of n thrusters, (S, n).
        memory: Internal states of the effects, (S, states).
    """

    model: Candidate
    rotors: Array
    memory: Array

    def of(self, kept: NDArray[np.bool_]) -> Prepared:
        """Return a copy for a part of the shots, with their initial states only.

        Args:
            kept: Mask of the shots to keep, (S,).
        """
        return Prepared(self.model, self.rotors[kept], self.memory[kept])

    def initial_states(self, first: Array, part: slice) -> InitialStates:
        """Return the initial states of body, rotors and effects for a slice of the shots.

        Args:
            first: States of the body in all S shots: position, quaternion, nu, (S, 13).
            part: Slice of the shots.
        """
        return InitialStates(np.ascontiguousarray(first[part]), self.rotors[part], self.memory[part])


def prepare(model: Candidate, shots: Shots, like: Prepared | None = None) -> Prepared:
    """Return a compiled vehicle together with its initial rotor and internal states in every shot.

    Args:
        model: The compiled vehicle.
        shots: The shots.
        like: Another vehicle prepared for the same shots.  Its states are reused if its thrusters, or its
            effects with internal states, are the same.
    """
    if like is not None and same_states(like.model.thrusters, model.thrusters):
        rotors = like.rotors
    else:
        rotors = rotor_states(model, shots.record)[shots.starts]
    if like is not None and _same_memories(like.model, model):
        memory = like.memory
    else:
        nu = true_velocity(model, shots.record, shots.nu)
        memory = memories(model, shots.record, shots.eta, nu)[shots.starts]
    return Prepared(model, rotors, memory)


def _same_memories(one: Candidate, other: Candidate) -> bool:
    """Return whether two candidates have the same internal states for a recording."""
    return np.array_equal(one.log, other.log) and same_memories(one.program.flat, other.program.flat)


def predict(
    prepared: Prepared,
    shots: Shots,
    first: Array | None = None,
    part: slice = slice(None),
) -> Array:
    """Predict what the sensors would log, shot by shot.

    Args:
        prepared: Compiled vehicle, prepared for the shots.
        shots: The S shots.
        first: Initial states of all shots, (S, 13); by default those of `shots`.
        part: Slice of the s shots to predict; by default all.

    Returns:
        Position, quaternion and nu in every row, (s, length, 13); not finite where a motion diverges.
    """
    places = places_of(shots, part)
    initial = prepared.initial_states(shots.first if first is None else first, part)
    out = np.empty((places.starts.size, shots.length, BODY))
    shoot(prepared.model.program.flat, places, initial, out, Answers.none(initial.memory))
    if prepared.model.log.any():
        clock = np.arange(shots.length) * shots.record.dt
        finite = np.nan_to_num(out[..., 7:], nan=1e6, posinf=1e6, neginf=-1e6)
        out = sensor.logged_position(prepared.model.log, out)
        out[..., 7:] = sensor.measured(prepared.model.log, clock, finite)
    return out


def residuals(
    prepared: Prepared,
    shots: Shots,
    first: Array | None = None,
    part: slice = slice(None),
    *,
    calmed: bool = True,
) -> Array:
    """Return measured minus predicted values in standard deviations of the noise, (s, length - lead, 12).

    The residual of the attitude is the small rotation from the predicted to the measured attitude, about the
    predicted body axes.  Residuals are 0 where nothing was measured.  The first `lead` rows of a shot are not
    compared.

    Args:
        prepared: Compiled vehicle, prepared for the shots.
        shots: The S shots.
        first: Initial states of all shots, (S, 13); by default those of `shots`.
        part: Slice of the s shots to predict; by default all.
        calmed: For shots in waves: whether to whiten the residuals, given the covariance due to the waves.
    """
    predicted = predict(prepared, shots, first, part)
    out = np.empty((predicted.shape[0], shots.length - shots.lead, CHANNELS))
    deviate(predicted, shots.measured[part], shots.lead, 1.0 / shots.sigma, out)
    if (counted := shots.weights(part)) is not None:
        out[~counted] = 0.0
    if not calmed or shots.swell is None:
        return out
    return shots.calmed(out.reshape(len(out), -1, 1), part).reshape(out.shape)


def parts(shots: int, threads: int | None = None) -> list[slice]:
    """Return slices of a number of shots, one for each work item; few large ones if few threads share them.

    Args:
        shots: Number of shots.
        threads: Number of threads; by default, the number of cores.
    """
    size = min(max(-(-shots // (threads or available())), SHOTS_TOGETHER), MOST_TOGETHER)
    return [slice(begin, begin + size) for begin in range(0, shots, size)]


def costs(prepared: Prepared, shots: Shots, *, threads: int | None = None) -> Array:
    """Return the sum of squared residuals of each of S shots, (S,), in units of the noise variance.

    Residuals of anchored initial states count too.  The sum is infinite for a shot that diverges.

    Args:
        prepared: Compiled vehicle, prepared for the shots.
        shots: The shots.
        threads: Number of threads; by default, the number of cores.
    """

    def work(part: slice) -> Array:
        error = residuals(prepared, shots, None, part)
        squares: Array = np.einsum("mki,mki->m", error, error)
        return squares

    each = np.concatenate(spread(work, parts(len(shots.starts), threads), threads))
    if shots.anchor is not None:
        each += (initial_residuals(prepared.model, shots) ** 2).sum(axis=1)
    each[~(each < ENDLESS**2)] = np.inf
    return each


def cost(prepared: Prepared, shots: Shots) -> float:
    """Return the sum of squared residuals over all shots, in units of the noise variance.

    Residuals of anchored initial states count too.  The sum is infinite if a motion diverges.

    Args:
        prepared: Compiled vehicle, prepared for the shots.
        shots: The shots.
    """
    return float(costs(prepared, shots).sum())


def displaced(first: Array, shift: Array) -> Array:
    """Return states of a body moved by small displacements, a new array (S, 13).

    Args:
        first: S states: position, quaternion and nu, (S, 13).
        shift: Displacement of position, small rotation about body axes, and nu, (S, 12) or (1, 12).
    """
    out, (a, b, c) = np.empty((len(first), BODY)), 0.5 * shift[:, 3:6].T
    w = np.sqrt(np.maximum(1.0 - (a * a + b * b + c * c), 0.0))
    out[:, :3] = first[:, :3] + shift[:, :3]
    out[:, 3:7] = quaternion_product(first[:, 3:7], w, a, b, c)
    out[:, 7:] = first[:, 7:] + shift[:, 6:]
    return out


@kernel
def deviate(predicted: Array, measured: Array, lead: int, weight: Array, out: Array) -> None:
    """Write weighted differences of measured minus predicted states to `out`.

    The difference of attitudes is twice the vector part of q_predicted^* q_measured: a small rotation.

    Args:
        predicted: Predicted states (position, quaternion, nu) of S shots of K rows, (S, K, 13).
        measured: Measured states of the same rows, (S, K, 13).
        lead: Rows at the beginning of a shot that are left out.
        weight: Weights of the differences of position, attitude and nu, (12,).
        out: Output: differences, (S, K - lead, 12).
    """
    for m in range(out.shape[0]):
        for k in range(out.shape[1]):
            a, b, e = predicted[m, lead + k], measured[m, lead + k], out[m, k]
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
def shoot(flat: Array, places: Places, initial: InitialStates, out: Array, answers: Answers) -> None:
    """Predict the motion in S shots; write it to `out`, and its derivatives to `answers`.

    Thrusters also respond to commands before a shot's start, in the same segment.

    Args:
        flat: Compiled vehicle (`effects.program`).
        places: Places of the S shots.
        initial: Initial states of the shots.
        out: Output: predicted state of the body in K rows of each shot, (S, K, 13); NaN after a row that is
            not finite.
        answers: Output: responses to changes of initial states and parameters, if `answers.wanted`.
    """
    motion, thrusters = afloat(flat, NO_HULL.copy()), at_rest(flat)  # copied: writable, as other hulls are
    for m in range(places.starts.size):
        begin, end = places.bounds[m, 0], places.bounds[m, 1]
        course = Course(places.commands[begin:end], places.t[begin:end], places.steps, 0.0)
        at = places.starts[m] - begin
        copy_kernel(initial.first[m], motion.y[:BODY])
        copy_kernel(initial.memory[m], motion.y[BODY:])
        resume(thrusters, course, at, places.resumed[m])
        copy_kernel(initial.rotors[m], thrusters.rotors[2])
        deviations = deviations_of(
            answers.changes,
            answers.stride,
            thrusters.table.shape[0],
            answers.ahead[m],
            answers.own[m],
            answers.out[m],
            answers.wanted,
        )
        march(motion, thrusters, course, at, out[m], None, deviations)
