"""Response of predicted shots to an additional wrench that is a known function of time.

Small deviations delta of position (NED), rotation, velocity and rates (body) obey delta' = J delta + b along
a motion (`simulation.variational_equation`), with b = [0; M^-1 w] for a wrench w and the mass matrix M.  The
Jacobian J is that of the file's forces along the measured motion.  So the transition A_k from row k to the
next, at the sample time dt, is computed once for all wrenches:

    delta_k+1 = A_k (delta_k + dt/2 b_k) + dt/2 b_k+1,

which is of second order in dt.  It equals Phi_k int Phi_j^-1 b dt, with Phi the product of the A, but needs
no inverse.  Internal states of the file's effects are assumed not to respond.

A delayed or misaligned DVL transforms the deviation as it transforms the motion, except for its bias.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask, Rows
from hydro.core.effects import sensor
from hydro.core.effects.layout import INVERSE_MASS_MATRIX
from hydro.core.effects.program import constants_of
from hydro.core.prediction.candidate import Candidate, memories, rotor_states, true_velocity
from hydro.core.prediction.multiple_shooting import (
    LONGEST_STEP,
    SHOTS_TOGETHER,
    Answers,
    InitialStates,
    Places,
    displaced,
    shoot,
)
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.simulation.dynamics import BODY
from hydro.core.simulation.simulate import steps_of_row
from hydro.core.vehicle.frames import body_states


@dataclass(frozen=True)
class Transitions:
    """State transitions of small deviations from row to row, in the S shots of a recording.

    Attributes:
        model: The vehicle whose forces define the transitions.
        shots: The shots.
        each: Transition from every row of a shot to the next, (S, length - 1, 12, 12).
    """

    model: Candidate
    shots: Shots
    each: Array

    @classmethod
    def of(cls, model: Candidate, shots: Shots) -> Transitions:
        """Return the transitions along the smoothed measured motion of each shot.

        Args:
            model: The vehicle whose forces define the transitions.
            shots: The shots.
        """
        record = shots.record
        nu = true_velocity(model, record, shots.nu)
        states = body_states(shots.eta, nu)
        rotors, memory = rotor_states(model, record), memories(model, record, shots.eta, nu)
        rows = shots.starts[:, None] + np.arange(shots.length - 1)
        each = np.empty((*rows.shape, CHANNELS, CHANNELS))
        for m, (at, segment) in enumerate(zip(rows, shots.segment, strict=True)):
            begun = InitialStates(states[at], rotors[at], memory[at])
            each[m] = _one_row(model, shots, at, int(segment), begun)
        return cls(model, shots, each)

    def over(self, kept: NDArray[np.bool_]) -> Transitions:
        """Return the transitions of those shots that a mask (S,) keeps."""
        return replace(self, shots=self.shots.of(kept), each=self.each[kept])

    @property
    def accelerated(self) -> Array:
        """Inverse mass matrix M^-1 of the vehicle with all its effects, (6, 6)."""
        begin = INVERSE_MASS_MATRIX
        inverse: Array = constants_of(self.model.program.flat)[begin : begin + 36].reshape(6, 6)
        return inverse

    def answers(self, part: slice, wrenches: Array, begun: Array | None = None) -> Array:
        """Return how additional wrenches and initial deviations change the logged channels, row by row.

        Args:
            part: Slice of s shots.
            wrenches: Q wrenches on the vehicle about CO at each row, (s, length, 6, Q) [N, N m].
            begun: Deviations at the first row, (12, Q); 0 by default.

        Returns:
            Deviations of position [m], small rotation about the body's axes [rad], velocity [m/s] and rates
            [rad/s], (s, length, 12, Q).
        """
        each, half = self.each[part], 0.5 * self.shots.record.dt
        push = half * np.einsum("ij,skjq->skiq", self.accelerated, wrenches)
        out = np.zeros((*push.shape[:2], CHANNELS, push.shape[3]))
        if begun is not None:
            out[:, 0] = begun
        for k in range(out.shape[1] - 1):
            now = out[:, k].copy()
            now[:, 6:] += push[:, k]
            np.matmul(each[:, k], now, out=out[:, k + 1])
            out[:, k + 1, 6:] += push[:, k + 1]
        return self._logged(out, self.shots.measured[part][..., 3:7])

    def _logged(self, deviations: Array, attitude: Array) -> Array:
        """Return deviations of the motion as deviations of the log, by the errors of the model's DVL.

        The bias of the DVL is constant, so it does not count.

        Args:
            deviations: Deviations of the motion, (s, length, 12, Q); overwritten.
            attitude: Logged quaternions, (s, length, 4).
        """
        log = self.model.log
        if not log.any():
            return deviations
        unbiased = log.copy()
        unbiased[sensor.BIAS] = 0.0
        if log[sensor.POINT].any():
            deviations[:, :, :3] = sensor.logged_shift(log, attitude, deviations)
        clock = np.arange(deviations.shape[1]) * self.shots.record.dt
        motion = deviations[:, :, 6:].transpose(0, 3, 1, 2)
        deviations[:, :, 6:] = sensor.measured(unbiased, clock, motion).transpose(0, 2, 3, 1)
        return deviations

    def corrected(self, wrench: Array) -> Shots:
        """Return the shots with the response to a residual wrench subtracted from the measurements.

        Args:
            wrench: Wrench on the vehicle about CO at every row of the recording, (N, 6) [N, N m].
        """
        shots = self.shots
        measured = shots.measured.copy()
        for begin in range(0, len(shots.starts), SHOTS_TOGETHER):
            part = slice(begin, begin + SHOTS_TOGETHER)
            answer = self.answers(part, wrench[rows_of(shots, part)][..., None])[..., 0]
            logged = measured[part].reshape(-1, BODY)
            measured[part] = displaced(logged, -answer.reshape(-1, CHANNELS)).reshape(measured[part].shape)
        return replace(shots, measured=measured)


def rows_of(shots: Shots, part: slice = slice(None)) -> Rows:
    """Return the row numbers, in the recording, of each of s shots of a slice, (s, length)."""
    rows: Rows = shots.starts[part, None] + np.arange(shots.length)
    return rows


def covered(shots: Shots) -> Mask:
    """Return which rows of the recording lie in any shot, (N,)."""
    inside = np.zeros(shots.record.rows, np.bool_)
    inside[rows_of(shots)] = True
    return inside


def _one_row(model: Candidate, shots: Shots, rows: Rows, segment: int, begun: InitialStates) -> Array:
    """Return the transitions from K rows of a segment to the next rows, (K, 12, 12).

    Args:
        model: The vehicle.
        shots: Shots of the recording.
        rows: The rows, (K,).
        segment: Number of the segment.
        begun: States of the motion at the rows.
    """
    record, count = shots.record, rows.size
    places = Places(
        record.commands,
        record.t,
        np.repeat(record.segments[segment : segment + 1], count, axis=0),
        np.repeat(record.after_gap[segment : segment + 1], count),
        rows,
        steps_of_row(record.dt, 1.0 / LONGEST_STEP),
    )
    states, answers = np.empty((count, 2, BODY)), Answers.to_beginnings(begun.memory, 2)
    shoot(model.program.flat, places, begun, states, answers)
    return np.ascontiguousarray(answers.out[:, 1])
