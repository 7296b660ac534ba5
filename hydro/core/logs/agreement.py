"""Residuals of the two kinematic identities of a log, window by window, for any meaning of its columns.

A reading is a map that states the frame, unit and sign of each column.  Whatever forces act, the body origin
moves as d(position)/dt = R v, and the body turns as dR/dt = R S(omega) (Fossen 2011, sec. 2.2).  R is the
rotation from body to world, v the velocity, and S(omega) the cross-product matrix of the angular velocity.

Both are integrated over windows of a second, which averages out noise.  The change of the position is
compared with the mean of R v, the turn of R with the mean of omega.  A wrong frame, unit or sign violates
them by as much as the vehicle moves.  If a log lacks a sensor or the horizontal position, only the components
with data on both sides are compared.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, cached_property
from itertools import pairwise

import msgspec
import numpy as np
import scipy

from hydro.core.columns import Array, Mask
from hydro.core.logs import conventions
from hydro.core.logs.alternatives import BODIES
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.logmap import Attitude, LogMap, Position, Rates, Velocity
from hydro.core.recording.segments import GAP

COMPARED_SECONDS = 1.0
"""Length of a window [s]."""
MOST_WINDOWS = 300
"""Maximum number of windows, spread evenly over the log."""
FEW = 60
"""Number of windows on which readings are preselected."""
CLEARLY = 0.3
"""Height above the surface that no vehicle under water reaches [m]."""
SETTLED = 0.01
"""Unexplained share assumed for an identity that the log cannot test."""
UNFRAMED = {name: getattr(Attitude(), name) for name in ("world", "body")}
"""Default frames; they do not affect the values in a block's own frame."""
RESOLUTION: Array = np.array([1e-4, 1e-5])
"""Negligible differences of velocity [m/s] and rate [rad/s]."""
LEAST_MOTION = 0.01
"""Maximum root mean square rate of a pose at rest [m/s, rad/s]: drift of a filter or of fixes."""
MOVING = 2.0
"""Ratio of a rate to its noise above which the vehicle moves."""


def windows(times: Sequence[Array], dt: float) -> list[Array]:
    """Return, for each session, the times of the rows of its windows; no window extends across a gap.

    Args:
        times: Times of the rows of each session [s].
        dt: Sample time [s].

    Returns:
        For each session, times of the m + 1 rows of each of W windows [s], (W, m + 1).
    """
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
    """Return a mask, (6,), of the components of pose whose meaning the log's kinematics can test.

    They are three of translation (along NED) and three of rotation (about FRD).

    Args:
        given: Map of the log.
    """
    moves, spins = tested(given)
    level = moves and given.position is not None and bool(given.position.columns)
    return np.array([level, level, moves, spins, spins, spins])


def tested(given: LogMap) -> tuple[bool, bool]:
    """Return two flags: whether a log can test any component of translation, and any of rotation.

    Args:
        given: Map of the log.
    """
    turned = given.attitude is not None
    moves = turned and given.velocity is not None and given.position is not None
    return moves, turned and given.rates is not None


class Evidence:
    """Windows of a log, from which the residuals of any map (declared meaning) of its columns are computed.

    Intermediate values of a block of the map are kept for the next call.  Methods that take a map return
    values of W windows with m + 1 rows each.

    Args:
        logs: Sessions of the log.
        windows: Times of the windows of each session, from `windows`.
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
        def own_turns(unframed: Attitude) -> Array:
            return _turns(own_attitude(unframed))

        def turns(block: Attitude) -> Array:
            # a fixed rotation of the world's axes changes no turn, and one of the body's rotates its vector
            own = own_turns(msgspec.structs.replace(block, **UNFRAMED)) @ conventions.AXES[block.body].T
            return own if block.mount is None else own @ conventions.turn(block.mount).T

        @cache
        def turning(block: Attitude) -> Array:
            return np.asarray(turns(block).sum(axis=1) / self.length)

        @cache
        def velocity(block: Velocity) -> Array:
            def as_given(log: SessionLog, at: Array) -> Array:  # along world axes where the block says so
                return conventions.velocity(log, block, at, np.broadcast_to(np.eye(3), (len(at), 3, 3)))

            return gather(as_given)

        @cache
        def moved(unframed: Attitude, body: str, block: Velocity, rule: str) -> Array:
            # along the attitude's own world axes, which a frame of the world then permutes without rounding
            given = velocity(block) @ conventions.AXES[body]
            return self.mean(np.einsum("wkij,wkj->wki", own_attitude(unframed), given), rule)

        @cache
        def moving(attitude_block: Attitude, block: Velocity, rule: str) -> Array:
            if block.frame not in BODIES:
                return self.mean(velocity(block), rule)
            unframed = msgspec.structs.replace(attitude_block, **UNFRAMED)
            along = moved(unframed, attitude_block.body, block, rule)
            return np.asarray(along @ conventions.AXES[attitude_block.world].T)

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
        self.attitude, self.turns, self.turning, self.turned = attitude, turns, turning, turned
        self.velocity, self.moving, self.spinning = velocity, moving, spinning
        self.rotation_error = rotation_error

    @cached_property
    def few(self) -> Evidence:
        """A smaller set with at most FEW of the windows, spread evenly.

        This set itself if it is small enough.
        """
        every = -(-len(self.t) // FEW)
        return self if every == 1 else Evidence(self._logs, [t[::every] for t in self._windows])

    def mean(self, values: Array, rule: str) -> Array:
        """Return the mean over each window, (W, 3), of values in its rows.

        Args:
            values: Values in the rows of each window, (W, m + 1, 3).
            rule: Rule of integration: `trapezoid`, `left` or `right`.
        """
        weights = self.rules[rule]
        return np.asarray(np.einsum("wki,k->wi", values, weights / weights.sum()))

    def translation(self, given: LogMap, rule: str) -> Array:
        """Return the residual of d(position)/dt = R v in each window, (W, 3) [m/s]; 0 if not testable.

        R is the rotation from FRD to NED, v the measured velocity.

        Args:
            given: Map that gives the meaning of the columns.
            rule: Rule of integration: `trapezoid`, `left` or `right`.
        """
        if given.position is None or given.attitude is None or given.velocity is None:
            return np.zeros((len(self.t), 3))
        moving = self.moving(given.attitude, given.velocity, rule)
        return np.asarray((self.travel(given.position) - moving) * _levels(given.position))

    def residuals(self, given: LogMap, rule: str = "trapezoid") -> Array:
        """Return the residuals of both kinematic identities in each window, (W, 6) [m/s, rad/s].

        A residual is the change of the pose over a window, divided by its duration, minus the mean of the
        measured velocity.  Columns 0-2: change of position minus mean of R v, along NED, with the rotation R
        from FRD to NED and the velocity v.  Columns 3-5: sum of the rotation vectors from row to row minus
        mean of the rates, about FRD.  A residual is 0 if the log lacks one side of its identity.  If the log
        has depth but no horizontal position, the residuals north and east are 0.

        Args:
            given: Map that gives the meaning of the columns.
            rule: Weights of the rows in the mean: `trapezoid` halves the first and the last, `left` leaves
                out the last, `right` the first.
        """
        rotation = np.zeros((len(self.t), 3))
        if given.attitude is not None and given.rates is not None:
            rotation = self.turning(given.attitude) - self.mean(self.spinning(given.rates), rule)
        return np.hstack([self.translation(given, rule), rotation])

    def errors(self, given: LogMap, rule: str = "trapezoid") -> Array:
        """Return the root mean square residuals of translation [m/s] and rotation [rad/s], (2,).

        Args:
            given: Map that gives the meaning of the columns.
            rule: Rule of integration: `trapezoid`, `left` or `right`.
        """
        both = given.attitude is not None and given.rates is not None
        rotation = self.rotation_error(given.attitude, given.rates, rule) if both else 0.0
        return np.array([_rms(self.translation(given, rule)), rotation])

    def shares(self, given: LogMap) -> Array:
        """Return the errors of translation and rotation relative to the size of the motion, (2,).

        Absolute errors cannot be compared between maps: a log whose millimetres are read as metres has errors
        a thousand times as large.

        Args:
            given: Map that gives the meaning of the columns.
        """
        shares = np.hypot(self.errors(given), RESOLUTION) / np.hypot(self.motion(given), RESOLUTION)
        return np.where(tested(given), shares, SETTLED)

    def motion(self, given: LogMap) -> Array:
        """Return the root mean square rates of change of position [m/s] and attitude [rad/s], (2,).

        Args:
            given: Map that gives the meaning of the columns; a rate that it cannot give is 0.
        """
        placed = given.position is not None and tested(given)[0]
        travelled = self.travelled(given.position) if placed else 0.0
        return np.array([travelled, 0.0 if given.attitude is None else self.turned(given.attitude)])

    def moves(self, given: LogMap) -> Mask:
        """Return two flags, (2,): whether translation, and whether rotation, exceeds the noise.

        A flag is True where the map lacks one of the sensors.

        Args:
            given: Map that gives the meaning of the columns.
        """
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
            found[1] = self._beyond_noise(self.turns(given.attitude), self.spinning(given.rates))
        return np.array(found)

    def _beyond_noise(self, steps: Array, rates: Array) -> bool:
        """Return whether motion exceeds the noise of its sensors.

        Args:
            steps: Steps of the pose from row to row of each window, (W, m, 3).
            rates: Velocities at the rows, (W, m + 1, 3).
        """
        change = np.sqrt(np.mean((steps.sum(axis=1) / self.length) ** 2, axis=0))
        mean = np.std(rates.mean(axis=1), axis=0)
        least = np.sqrt(2.0) / self.length * _white(np.diff(steps, 3, axis=1), 70.0)
        noise = _white(np.diff(rates, 4, axis=1), 70.0) / np.sqrt(rates.shape[1])
        beyond = (change > np.maximum(LEAST_MOTION, MOVING * least)).any()
        return bool(beyond or (mean > np.maximum(LEAST_MOTION, MOVING * noise)).any())

    def misfit(self, given: LogMap) -> float:
        """Return how badly a map fits the log: the mean logarithm of the two relative errors of `shares`."""
        return 0.5 * float(np.log(self.shares(given)).sum())

    def upright(self, block: Attitude | None) -> bool:
        """Return whether a map makes the vehicle's down axis point down on average.

        Args:
            block: Attitude block of the map; None without an attitude, for which the result is True.
        """
        return block is None or bool(self.attitude(block)[..., 2, 2].mean() > 0.0)

    def above_water(self, block: Position | None) -> float:
        """Return the fraction of rows in which the body origin is clearly above the surface, 0 to 1.

        Args:
            block: Position block of a map; None without a position, for which the result is 0.
        """
        if block is None:
            return 0.0
        return float((self.placed(block)[..., 2] < -CLEARLY).mean())


def _turns(attitudes: Array) -> Array:
    """Return the rotation vectors from each attitude of a window to the next, (W, m - 1, 3) [rad].

    Args:
        attitudes: Rotations of the m rows of each of W windows, (W, m, 3, 3).
    """
    step = np.swapaxes(attitudes[:, :-1], -1, -2) @ attitudes[:, 1:]
    axial = 0.5 * np.stack([step[..., i, k] - step[..., k, i] for i, k in ((2, 1), (0, 2), (1, 0))], axis=-1)
    cosine = 0.5 * (np.trace(step, axis1=-2, axis2=-1) - 1.0)
    sine = np.sqrt(np.einsum("...i,...i->...", axial, axial))
    angle = np.arctan2(sine, cosine)
    vectors = axial * (angle / np.where(sine > 0.0, sine, 1.0) + (sine == 0.0))[..., None]
    large = cosine < 0.0  # near a half turn, the axial vector does not determine the axis
    if large.any():
        vectors[large] = scipy.spatial.transform.Rotation.from_matrix(step[large]).as_rotvec()
    return np.asarray(vectors)


def _levels(block: Position) -> Mask:
    """Return which components of the travel a position block measures, (3,): only down for a depth."""
    return np.array([bool(block.columns), bool(block.columns), True])


def _rms(vectors: Array) -> float:
    """Return the root mean square length of vectors (W, 3)."""
    return float(np.sqrt((vectors**2).sum() / len(vectors)))


def _white(differences: Array, power: float) -> Array:
    """Return the standard deviation of the white noise of C channels, (C,).

    It follows from the median size of differences; it is 0 if there are too few rows for a difference.

    Args:
        differences: Differences of the samples along the rows, (..., C).
        power: Variance of a difference over that of a sample.
    """
    if not differences.size:
        return np.zeros(differences.shape[-1])
    sizes = np.median(np.abs(differences.reshape(-1, differences.shape[-1])), axis=0)
    return np.asarray(sizes / (0.6745 * np.sqrt(power)))
