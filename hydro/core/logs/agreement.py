"""The two kinematic identities of a log, window by window, under any reading of its columns.

Whatever forces act, the body origin moves as d(position)/dt = R v, and the body turns as dR/dt = R S(omega)
(Fossen 2011, sec. 2.2).  Both are integrated over windows of a second, so that noise averages out: the change
of the position against the mean of R v, the turn of R against the mean of omega.  A wrong frame, unit or sign
breaks them by as much as the vehicle moves.  Of a log that lacks a sensor, or the horizontal position, only
those rows of the identities are looked at that it has both sides of.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from itertools import pairwise

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from hydro.core.columns import Array, Mask
from hydro.core.logs import conventions
from hydro.core.logs.alternatives import BODIES
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.logmap import Attitude, LogMap, Position, Rates, Velocity
from hydro.core.recording.segments import GAP

COMPARED_SECONDS = 1.0
"""Length of a window [s]."""
MOST_WINDOWS = 300
"""Windows taken, evenly spread over the log."""
FEW = 60
"""Windows that choose what all are asked about."""
CLEARLY = 0.3
"""How far above the surface nothing under water is [m]."""
SETTLED = 0.01
"""Share that an identity is said to leave unexplained where the log has not both of its sides."""
UNFRAMED = {name: getattr(Attitude(), name) for name in ("world", "body")}
"""Frames make no difference to what a block's own columns say."""
RESOLUTION: Array = np.array([1e-4, 1e-5])
"""Differences of velocity [m/s] and rate [rad/s] that do not matter."""
LEAST_MOTION = 0.01
"""Root mean square rate of a pose at rest at most [m/s, rad/s]: drift of a filter or of a fix."""
MOVING = 2.0
"""Multiple of what noise makes of it from which a rate is motion; 1 of noise alone."""


def windows(times: Sequence[Array], dt: float) -> list[Array]:
    """Times of the rows of each window, per session (W, m + 1): end to end, none across a gap."""
    steps = max(1, round(COMPARED_SECONDS / dt))
    starts = []
    for number, t in enumerate(times):
        edges = np.r_[0, np.flatnonzero(np.diff(t) > GAP * dt) + 1, len(t)]
        for start, stop in pairwise(edges):
            starts += [(number, k) for k in range(start, stop - steps, steps)]
    chosen = np.unique(np.linspace(0, len(starts) - 1, min(MOST_WINDOWS, len(starts))).round().astype(int))
    taken = [starts[i] for i in chosen]
    return [
        np.array([t[k : k + steps + 1] for session, k in taken if session == number]).reshape(-1, steps + 1)
        for number, t in enumerate(times)
    ]


def testable(given: LogMap) -> Mask:
    """Which components of translation and rotation a log has both sides of, (6,)."""
    placed, turned = given.position, given.attitude is not None
    level = placed is not None and bool(placed.columns)
    moves = turned and given.velocity is not None and placed is not None
    spins = turned and given.rates is not None
    return np.array([moves and level, moves and level, moves, spins, spins, spins])


def tested(given: LogMap) -> tuple[bool, bool]:
    """Whether a log has both sides of some row of translation, and of rotation."""
    both = testable(given)
    return bool(both[:3].any()), bool(both[3:].any())


class Evidence:
    """The windows of a log, and what each reading of a block makes of them, computed once.

    Args:
        logs: The sessions.
        windows: Times of their windows, of `windows`.
    """

    def __init__(self, logs: Sequence[SessionLog], windows: Sequence[Array]) -> None:
        present = [(log, t) for log, t in zip(logs, windows, strict=True) if len(t)]
        self._logs, self._windows = logs, windows
        self.t: Array = np.concatenate([t for _, t in present])
        self.length = float(np.median(self.t[:, -1] - self.t[:, 0]))
        count, rows = self.t.shape
        before, after = np.r_[np.ones(rows - 1), 0.0], np.r_[0.0, np.ones(rows - 1)]
        self.rules = {"trapezoid": 0.5 * (before + after), "left": before, "right": after}

        def gather(reading: Callable[[SessionLog, Array], Array]) -> Array:
            parts = [reading(log, t.ravel()) for log, t in present]
            return np.concatenate(parts).reshape(count, rows, *parts[0].shape[1:])

        @cache
        def placed(block: Position) -> Array:
            return gather(lambda log, at: conventions.position(log, block, at))

        @cache
        def own_attitude(unframed: Attitude) -> Array:
            return gather(lambda log, at: conventions.own_attitude(log, unframed, at))

        @cache
        def attitude(block: Attitude) -> Array:
            unframed = msgspec.structs.replace(block, **UNFRAMED)
            return conventions.in_frames(block, own_attitude(unframed))

        @cache
        def turning(block: Attitude) -> Array:
            R = attitude(block)
            step = np.swapaxes(R[:, :-1], -1, -2) @ R[:, 1:]
            turns = Rotation.from_matrix(step.reshape(-1, 3, 3)).as_rotvec().reshape(count, rows - 1, 3)
            return np.asarray(turns.sum(axis=1) / self.length)

        @cache
        def velocity(block: Velocity) -> Array:
            def as_given(log: SessionLog, at: Array) -> Array:  # along world axes where the block says so
                return conventions.velocity(log, block, at, np.broadcast_to(np.eye(3), (len(at), 3, 3)))

            return gather(as_given)

        @cache
        def moving(attitude_block: Attitude, block: Velocity, rule: str) -> Array:
            given = velocity(block)
            if block.frame in BODIES:
                given = np.einsum("wkij,wkj->wki", attitude(attitude_block), given)
            return self.mean(given, rule)

        @cache
        def spinning(block: Rates) -> Array:
            return gather(lambda log, at: conventions.rates(log, block, at))

        @cache
        def travel(block: Position) -> Array:
            x = placed(block)
            return np.asarray((x[:, -1] - x[:, 0]) / self.length)

        @cache
        def travelled(block: Position) -> float:
            return _rms(travel(block) * _levels(block))

        @cache
        def turned(block: Attitude) -> float:
            return _rms(turning(block))

        @cache
        def rotation_error(attitude_block: Attitude, block: Rates, rule: str) -> float:
            return _rms(turning(attitude_block) - self.mean(spinning(block), rule))

        self.placed, self.travel, self.travelled = placed, travel, travelled
        self.attitude, self.turning, self.turned = attitude, turning, turned
        self.velocity, self.moving, self.spinning = velocity, moving, spinning
        self.rotation_error = rotation_error

    @cached_property
    def few(self) -> Evidence:
        """The evidence of at most FEW of the windows, spread evenly; itself where it has no more."""
        every = -(-len(self.t) // FEW)
        return self if every == 1 else Evidence(self._logs, [t[::every] for t in self._windows])

    def mean(self, values: Array, rule: str) -> Array:
        """Mean over each window by a rule of integration, (W, 3) of (W, m + 1, 3)."""
        weights = self.rules[rule]
        return np.asarray(np.einsum("wki,k->wi", values, weights / weights.sum()))

    def translation(self, given: LogMap, rule: str) -> Array:
        """Return the residual of the first identity in each window, (W, 3) [m/s]; 0 without both sides."""
        if given.position is None or given.attitude is None or given.velocity is None:
            return np.zeros((len(self.t), 3))
        moving = self.moving(given.attitude, given.velocity, rule)
        return np.asarray((self.travel(given.position) - moving) * _levels(given.position))

    def residuals(self, given: LogMap, rule: str = "trapezoid") -> Array:
        """What the two identities leave in each window, (W, 6): translation [m/s], rotation [rad/s].

        0 where the log lacks one side.
        """
        rotation = np.zeros((len(self.t), 3))
        if given.attitude is not None and given.rates is not None:
            rotation = self.turning(given.attitude) - self.mean(self.spinning(given.rates), rule)
        return np.hstack([self.translation(given, rule), rotation])

    def errors(self, given: LogMap, rule: str = "trapezoid") -> Array:
        """RMS of the residuals, (2,): [m/s] and [rad/s]."""
        both = given.attitude is not None and given.rates is not None
        rotation = self.rotation_error(given.attitude, given.rates, rule) if both else 0.0
        return np.array([_rms(self.translation(given, rule)), rotation])

    def shares(self, given: LogMap) -> Array:
        """The errors as shares of what there is to explain, (2,).

        Shares, for a log read in millimetres throughout has small errors too.
        """
        shares = np.hypot(self.errors(given), RESOLUTION) / np.hypot(self.motion(given), RESOLUTION)
        return np.where(tested(given), shares, SETTLED)

    def motion(self, given: LogMap) -> Array:
        """RMS of what there is to explain: the rates of position and attitude, (2,): [m/s] and [rad/s]."""
        placed = given.position is not None and tested(given)[0]
        travelled = self.travelled(given.position) if placed else 0.0
        return np.array([travelled, 0.0 if given.attitude is None else self.turned(given.attitude)])

    def moves(self, given: LogMap) -> Mask:
        """Return whether position and attitude, or the logged velocities, move beyond their noise, (2,)."""
        placed = given.position is not None and given.attitude is not None and given.velocity is not None
        found = [True, True]
        if placed:
            assert given.position is not None
            assert given.velocity is not None
            pose = np.diff(self.placed(given.position), axis=1)
            if not given.position.columns:
                pose = pose[..., 2:]
            found[0] = self._beyond_noise(pose, self.velocity(given.velocity))
        if given.attitude is not None and given.rates is not None:
            R = self.attitude(given.attitude)
            step = np.swapaxes(R[:, :-1], -1, -2) @ R[:, 1:]
            turns = Rotation.from_matrix(step.reshape(-1, 3, 3)).as_rotvec().reshape(*step.shape[:2], 3)
            found[1] = self._beyond_noise(turns, self.spinning(given.rates))
        return np.array(found)

    def _beyond_noise(self, steps: Array, rates: Array) -> bool:
        """Return whether steps of a pose (W, m, 3), or mean rates of (W, m + 1, 3), are more than noise."""
        change = np.sqrt(np.mean((steps.sum(axis=1) / self.length) ** 2, axis=0))
        mean = np.std(rates.mean(axis=1), axis=0)
        least = np.sqrt(2.0) / self.length * _white(np.diff(steps, 3, axis=1), 70.0)
        noise = _white(np.diff(rates, 4, axis=1), 70.0) / np.sqrt(rates.shape[1])
        beyond = (change > np.maximum(LEAST_MOTION, MOVING * least)).any()
        return bool(beyond or (mean > np.maximum(LEAST_MOTION, MOVING * noise)).any())

    def misfit(self, given: LogMap) -> float:
        """One figure for both identities, the mean logarithm of their shares."""
        return float(np.log(self.shares(given)).mean())

    def upright(self, block: Attitude | None) -> bool:
        """Whether the vehicle's down axis mostly points down, for all that is known."""
        return block is None or bool(self.attitude(block)[..., 2, 2].mean() > 0.0)

    def above_water(self, block: Position | None) -> float:
        """Share of the rows in which the body origin is clearly above the surface; 0 where it is unknown."""
        if block is None:
            return 0.0
        return float((self.placed(block)[..., 2] < -CLEARLY).mean())


def _levels(block: Position) -> Mask:
    """Return which components of the travel a log of this position tells of, (3,): of a depth, down alone."""
    return np.array([bool(block.columns), bool(block.columns), True])


def _rms(vectors: Array) -> float:
    """Return the root mean square length of vectors (W, 3)."""
    return float(np.sqrt((vectors**2).sum() / len(vectors)))


def _white(differences: Array, power: float) -> Array:
    """Return the standard deviation of white noise of which differences have `power` times the variance.

    By their median size, along the last axis; 0 of too few rows for a difference.
    """
    if not differences.size:
        return np.zeros(differences.shape[-1])
    sizes = np.median(np.abs(differences.reshape(-1, differences.shape[-1])), axis=0)
    return np.asarray(sizes / (0.6745 * np.sqrt(power)))
