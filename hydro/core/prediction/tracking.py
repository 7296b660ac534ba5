"""Model-based state estimate for recordings whose samples do not show the whole motion.

Positions alone do not show the attitude; attitude and depth alone do not show surge or sway.  But the
commands are known, and a model's response to them is accurate for a while.  An extended Kalman filter
processes each segment in windows of half a second; each window is predicted by the model and corrected by its
samples.  A Rauch-Tung-Striebel smoother runs backwards (Sarkka 2013, ch. 5 and 9).  If no sample shows the
heading, several initial headings are tried.

The size of the model error is unknown in advance.  Within a window it adds to the noise of the samples; from
window to window it adds to the predicted state.  Both sizes are multiples of the smallest error assumed for
any model, and are selected by maximum likelihood.  So a wrong model gets a small weight, and the channels
that it fills have a large uncertainty.

The result fills the channels that a segment never measured.  No likelihood includes these channels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array, Mask, Rows
from hydro.core.prediction.candidate import Candidate, candidate, memories, rotor_states
from hydro.core.prediction.multiple_shooting import (
    LONGEST_STEP,
    Answers,
    InitialStates,
    Places,
    deviate,
    displaced,
    shoot,
)
from hydro.core.recording.arrays import Recording, noise
from hydro.core.recording.filling import unshown
from hydro.core.recording.shots import CHANNELS, SHOT_SECONDS
from hydro.core.simulation.dynamics import BODY
from hydro.core.simulation.simulate import steps_of_row
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import body_states, euler_from_quaternion, quaternion_from_euler

BLIND_SECONDS = 5.0
"""Length of a shot whose samples do not show the whole motion [s].

It is longer than usual, since errors of unmeasured initial states decay.
"""
LEAST_ROOM = 4.0
"""Minimum length of the longest segment for shots of BLIND_SECONDS, in such shots."""
WINDOW = 0.5
"""Length of a window [s]."""
AT_FIRST = np.repeat([0.5, 0.3, 0.5, 0.3], 3)
"""Standard deviation of the state at the beginning of a segment [m, rad, m/s, rad/s]."""
ASTRAY = np.repeat([1e-3, 1e-3, 0.1, 0.2], 3)
"""Random-walk error of a good model in one second [m, rad, m/s, rad/s]."""
LEAST = np.repeat([0.01, 0.01, 0.02, 0.02], 3)
"""Minimum noise of a sample in the filter [m, rad, m/s, rad/s]: a good model has errors of this size."""
COARSER = 3.0
"""Factor between consecutive candidates for the multiples of both model errors."""
MOST_COARSE = 5
"""Maximum number of factors COARSER: a model with 243 times the error holds no information."""
TELLING = 60.0
"""Length of data after the first command used to estimate the model error [s]."""
CORRECTIONS = 3
"""Gauss-Newton iterations of a window."""
HEADINGS = 12  # number of initial headings that are tried
TRIAL = 20.0
"""Length of data with which each initial heading is tried [s]."""
PSI = 5  # channel of the heading
WILD = 1e3
"""Size of a state above which a prediction counts as diverged."""


class _Window(NamedTuple):
    """Window of the filter.

    Attributes:
        first: First row of the window in the recording.
        state: State at the start of the window, given its samples, (13,).
        spread: Covariance of `state`, (12, 12).
        answer: Response of the state at the end to the state at the start, (12, 12).
        ahead: State at the end of the window, (13,).
        ahead_spread: Covariance of `ahead`, (12, 12).
    """

    first: int
    state: Array
    spread: Array
    answer: Array
    ahead: Array
    ahead_spread: Array


class _Errs(NamedTuple):
    """Model error as multiples of the smallest error assumed for any model.

    Attributes:
        within: Multiple of the samples' noise (at least LEAST), within windows.
        between: Multiple of ASTRAY, between windows.
    """

    within: float = 1.0
    between: float = 1.0


DOUBTED = _Errs(within=9.0, between=9.0)
"""Model error assumed while the heading is searched."""


@dataclass(frozen=True)
class _Segment:
    """Segment of a recording to filter.

    Attributes:
        model: The vehicle.
        record: The recording of N rows.
        number: Number of the segment.
        logged: Measured states, (N, 13).
        seen: Which channels have a sample, (N, 12).
        sigma: Noise of the channels, (12,).
        rotors: Lag states of the thrusters at every row, (N, n).
        memory: Internal states of the effects, (N, states).
    """

    model: Candidate
    record: Recording
    number: int
    logged: Array
    seen: Mask
    sigma: Array
    rotors: Array
    memory: Array

    @property
    def bounds(self) -> Rows:
        """First row of the segment, and the row after its last, (2,)."""
        bounds: Rows = self.record.segments[self.number]
        return bounds

    def predicted(self, state: Array, row: int, rows: int) -> tuple[Array, Array]:
        """Return predicted states, (rows, 13), and their derivatives by the first state, (rows, 12, 12).

        Args:
            state: State at the first row: position, quaternion and nu, (13,).
            row: First row.
            rows: Number of rows.
        """
        part = slice(self.number, self.number + 1)
        places = Places(
            self.record.commands,
            self.record.t,
            self.record.segments[part],
            self.record.after_gap[part],
            np.array([row]),
            steps_of_row(self.record.dt, 1.0 / LONGEST_STEP),
        )
        begin = InitialStates(state[None], self.rotors[row : row + 1], self.memory[row : row + 1])
        states, answers = np.empty((1, rows, BODY)), Answers.to_beginnings(begin.memory, rows)
        shoot(self.model.program.flat, places, begin, states, answers)
        return states[0], np.ascontiguousarray(answers.out[0])


def tracked(vehicle: Vehicle, record: Recording) -> Recording:
    """Return a recording in which a model has estimated the channels without samples in a segment.

    The recording is returned unchanged if every channel was measured, or if the model diverges.

    Args:
        vehicle: The model.
        record: The recording.
    """
    if record.seen is None:
        return record
    never = np.array([unshown(record.seen[a:b]) for a, b in record.segments])
    if not never.any():
        return record
    model = candidate(vehicle)
    logged = body_states(record.eta, record.nu)
    sigma = np.maximum(noise(record), LEAST)
    rotors, memory = rotor_states(model, record), memories(model, record, record.eta, record.nu)
    motion, variances = np.hstack([record.eta, record.nu]), [AT_FIRST**2]
    for number, (start, stop) in enumerate(record.segments):
        if never[number].any():
            here = _Segment(model, record, number, logged, record.seen, sigma, rotors, memory)
            if (followed := _followed(here, never[number])) is not None:
                states, variance = followed
                variances.append(variance)
                angles = euler_from_quaternion(states[:, 3:7])
                found = np.hstack([states[:, :3], angles, states[:, 7:]])
                motion[start:stop, never[number]] = found[:, never[number]]
    eta, nu = np.ascontiguousarray(motion[:, :6]), np.ascontiguousarray(motion[:, 6:])
    return replace(record, eta=eta, nu=nu, doubt=np.sqrt(np.mean(variances[1:] or variances, axis=0)))


def shot_seconds(record: Recording) -> float:
    """Return the length of the shots, the short predictions, into which a recording should be cut [s].

    Shots are longer if the sensors determine their initial states poorly.  Position is ignored for this,
    because hardly any force depends on it.
    """
    if record.seen is None:
        return SHOT_SECONDS
    blind = any(unshown(record.seen[a:b])[3:].any() for a, b in record.segments)
    room = float(np.diff(record.segments).max()) * record.dt
    return BLIND_SECONDS if blind and room >= LEAST_ROOM * BLIND_SECONDS else SHOT_SECONDS


def _followed(here: _Segment, never: Mask) -> tuple[Array, Array] | None:
    """Return the states of a segment's rows, (n, 13), and their mean variance, (12,); None if it diverges.

    Args:
        here: The segment.
        never: Mask of the channels without a sample, (12,).
    """
    start, stop = here.bounds
    begin = here.logged[start].copy()
    spread = np.diag(AT_FIRST**2)
    if never[PSI]:
        until = min(start + round(TRIAL / here.record.dt), stop)
        psi = np.linspace(-np.pi, np.pi, HEADINGS, endpoint=False)
        spread[PSI, PSI] = (np.pi / HEADINGS) ** 2
        starts = np.repeat(begin[None], HEADINGS, axis=0)
        starts[:, 3:7] = quaternion_from_euler(np.zeros(HEADINGS), np.zeros(HEADINGS), psi)
        tried = [_filtered(here, each, spread, until, DOUBTED).cost for each in starts]
        begin = starts[int(np.argmin(tried))]
    errs = _likeliest(here, begin, spread, _telling(here))
    found = _filtered(here, begin, spread, stop, errs)
    return _smoothed(here, found.windows) if np.isfinite(found.cost) else None


def _telling(here: _Segment) -> int:
    """Return the row at which the data for the model error end: TELLING seconds after the first command."""
    start, stop = here.bounds
    commanded = np.flatnonzero(here.record.commands[start:stop].any(axis=1))
    first = int(commanded[0]) if len(commanded) else 0
    return int(min(start + first + round(TELLING / here.record.dt), stop))


class _Filtered(NamedTuple):
    """Forward pass of the filter over a segment.

    Attributes:
        windows: Windows from the start of the segment.
        cost: Minus twice the log-likelihood of the samples, up to a constant.
    """

    windows: list[_Window]
    cost: float


def _likeliest(here: _Segment, state: Array, spread: Array, stop: int) -> _Errs:
    """Return the model error of maximum likelihood, by a search upwards in factors of COARSER.

    Args:
        here: The segment.
        state: Initial state, (13,).
        spread: Covariance of the initial state, (12, 12).
        stop: Row after the last of the data.
    """

    def cost(errs: _Errs) -> float:
        return _filtered(here, state, spread, stop, errs).cost

    best, least = _Errs(), cost(_Errs())
    for _ in range(MOST_COARSE):
        steps = [
            best._replace(within=COARSER * best.within),
            best._replace(between=COARSER * best.between),
            _Errs(COARSER * best.within, COARSER * best.between),
        ]
        costs = list(map(cost, steps))
        if min(costs) >= least and np.isfinite(least):
            break
        least = min(costs)
        best = steps[costs.index(least)]
    return best


def _filtered(here: _Segment, state: Array, spread: Array, stop: int, errs: _Errs) -> _Filtered:
    """Filter a segment from its start to row `stop`.

    Args:
        here: The segment.
        state: Initial state, (13,).
        spread: Covariance of the initial state, (12, 12).
        stop: Row after the last.
        errs: Model error.
    """
    start, rows = int(here.bounds[0]), max(round(WINDOW / here.record.dt), 1)
    windows, total = list[_Window](), 0.0
    for first in range(start, stop, rows):
        count = min(rows, stop - first)
        corrected = _corrected(here, state, spread, first, count, errs)
        if corrected is None:
            return _Filtered(windows, np.inf)
        window, cost = corrected
        windows.append(window)
        state, spread, total = window.ahead, window.ahead_spread, total + cost
    return _Filtered(windows, total)


def _corrected(
    here: _Segment, expected: Array, spread: Array, first: int, count: int, errs: _Errs
) -> tuple[_Window, float] | None:
    """Correct a window by its samples; return the window and its cost, or None if the motion diverges.

    The initial state of the window is the most likely state given prediction and samples.

    Args:
        here: The segment.
        expected: Predicted state at the start of the window, (13,).
        spread: Covariance of `expected`, (12, 12).
        first: First row of the window.
        count: Number of rows.
        errs: Model error.
    """
    known, sigma = np.linalg.inv(spread), errs.within * here.sigma
    seen, length = here.seen[first : first + count], min(count + 1, int(here.bounds[1]) - first)
    state = expected
    for _ in range(CORRECTIONS):
        states, answers = here.predicted(state, first, length)
        if not (np.abs(states) < WILD).all():
            return None
        error = np.empty((1, count, CHANNELS))
        deviate(states[None, :count], here.logged[None, first : first + count], 0, 1.0 / sigma, error)
        columns = (answers[:count] / sigma[:, None])[seen]
        information = known + columns.T @ columns
        away = _apart(state, expected)
        step = np.linalg.solve(information, columns.T @ error[0][seen] - known @ away)
        cost = float((error[0][seen] ** 2).sum() + away @ known @ away)
        state = displaced(state[None], step[None])[0]
    cost += 2.0 * np.log(errs.within) * np.count_nonzero(seen)
    cost += float(np.linalg.slogdet(information)[1] + np.linalg.slogdet(spread)[1])
    states, answers = here.predicted(state, first, length)
    if not (np.abs(states) < WILD).all():
        return None
    after = np.asarray(np.linalg.inv(information), np.float64)
    ahead = (
        answers[-1] @ after @ answers[-1].T + np.diag((errs.between * ASTRAY) ** 2) * count * here.record.dt
    )
    return _Window(first, state, after, answers[-1], states[-1], 0.5 * (ahead + ahead.T)), cost


def _apart(state: Array, other: Array) -> Array:
    """Return the difference from `other` to `state`: position, small rotation (body), nu, (12,)."""
    out = np.empty((1, 1, CHANNELS))
    deviate(other[None, None], state[None, None], 0, np.ones(CHANNELS), out)
    return np.asarray(out[0, 0])


def _smoothed(here: _Segment, windows: list[_Window]) -> tuple[Array, Array]:
    """Return the smoothed states of every row of a segment, (n, 13), and their mean variance, (12,)."""
    start, stop = here.bounds
    out, variances = np.empty((stop - start, BODY)), []
    behind: tuple[Array, Array] | None = None
    for window in reversed(windows):
        state, spread = window.state, window.spread
        if behind is not None:
            gain = np.linalg.solve(window.ahead_spread, window.answer @ window.spread).T
            step = gain @ _apart(behind[0], window.ahead)
            state = displaced(state[None], step[None])[0]
            spread = spread + gain @ (behind[1] - window.ahead_spread) @ gain.T
        variances.append(np.diag(spread))
        rows = min(max(round(WINDOW / here.record.dt), 1), stop - window.first)
        states, _ = here.predicted(state, window.first, rows)
        tame = (np.abs(states) < WILD).all()
        out[window.first - start : window.first - start + rows] = states if tame else window.state
        behind = state, spread
    return out, np.maximum(np.mean(variances, axis=0), 0.0)
