"""Curves and errors of a vehicle that is being changed, computed again at every change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro.app.opening import Opened
from hydro.core.columns import Array, Rows
from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import HORIZONS
from hydro.core.evaluation.velocity_errors import Squares, squares_ahead
from hydro.core.evaluation.window import Windows
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.shots import Shots, kept_evenly
from hydro.core.vehicle.description import Vehicle

FEW = 60
"""Number of predictions whose error is shown at every change: few enough for 200 ms, spread over the log."""
LEAST_ROWS = 10
"""Minimum rows of a segment that is predicted as a whole."""
SESSION_GAP = 2.0
"""Space between two sessions on the time axis of the page [s]."""
MOST_POINTS = 4000
"""Maximum number of points of a curve that is sent to the page."""


@dataclass(frozen=True)
class Errors:
    """Errors of predicted velocities, root mean square.

    Attributes:
        all: Root mean square over all axes, weighted by inertia [m/s]; NaN without samples.
        axes: Root mean square of u v w [m/s] and p q r [rad/s], (6,).
        predictions: Number of predictions.
    """

    all: float
    axes: Array
    predictions: int


class Live:
    """Open recording, prepared for fast predictions while the vehicle changes.

    Attributes:
        opened: The recording.
        record: Cleaned recording of N rows.
        windows: Predictions of parts of the recording.
        clock: Time of each row on the page's axis [s], (N,): sessions one after the other.
    """

    def __init__(self, opened: Opened) -> None:
        """Lay the sessions on one axis of time."""
        self.opened, self.record = opened, opened.log.record
        self.windows = Windows(self.record)
        self.clock = _clock(self.record.t, self.record.segments, self.record.session, self.record.dt)
        self._shots = dict[tuple[float | None, bool], list[Shots]]()

    @property
    def horizons(self) -> tuple[float, ...]:
        """Prediction horizons for which the recording is long enough [s]."""
        return tuple(one for one in HORIZONS if self._of(one, every=False))

    def errors(self, vehicle: Vehicle, horizon: float | None, *, every: bool = False) -> Errors:
        """Return the errors of a vehicle's predicted velocities on the recording.

        Args:
            vehicle: The vehicle.
            horizon: Length of a prediction [s]; None for whole segments.
            every: Use all predictions of the recording; by default at most FEW of them.

        Raises:
            DataError: An effect is not valid.
        """
        sums, counts, number = np.zeros(6), np.zeros(6), 0
        for shots in self._of(horizon, every=every):
            found = squares_ahead(vehicle, shots)
            sums, counts = sums + found.sums.sum(axis=0), counts + found.counts.sum(axis=0)
            number += len(shots.starts)
        if not counts.any():
            return Errors(np.nan, np.full(6, np.nan), 0)
        together = Squares(sums[None], counts[None])
        with np.errstate(invalid="ignore"):
            axes = np.where(counts > 0.0, np.sqrt(together.mean), np.nan)
        return Errors(together.error(self.opened.weights), axes, number)

    def predicted(self, vehicle: Vehicle, horizon: float | None, begin: int, end: int) -> Array:
        """Return the predicted pose and velocity of the rows from `begin` to before `end`, (rows, 12).

        Args:
            vehicle: The vehicle.
            horizon: Length of a prediction [s]; None for whole segments.
            begin: First row.
            end: Row after the last.
        """
        return self.windows.predicted(candidate(vehicle), horizon, begin, end)

    def rows(self, low: float, high: float) -> tuple[int, int]:
        """Return the range of rows between two times: first row, and row after the last; at least two rows.

        Args:
            low: Begin on the page's axis [s].
            high: End on the page's axis [s].
        """
        begin, end = np.searchsorted(self.clock, [low, high])
        begin = min(int(begin), self.record.rows - 2)
        return begin, max(int(end), begin + 2)

    def _of(self, horizon: float | None, *, every: bool) -> list[Shots]:
        """Return the predictions of a horizon, grouped by length; empty if the recording is too short.

        Args:
            horizon: Length of a prediction [s]; None for whole segments.
            every: Use all predictions; otherwise at most FEW of them.
        """
        key = (horizon, every)
        if key not in self._shots:
            self._shots[key] = self._made(horizon, every=every)
        return self._shots[key]

    def _made(self, horizon: float | None, *, every: bool) -> list[Shots]:
        log = self.opened.log
        if horizon is None:
            lengths = np.diff(self.record.segments)[:, 0]
            numbers = [np.flatnonzero(lengths == one) for one in np.unique(lengths[lengths >= LEAST_ROWS])]
            first = self.record.segments[:, 0]
            return [self.windows.shots(first[one], one, int(lengths[one[0]])) for one in numbers]
        try:
            shots = log.shots(horizon)
        except DataError:
            return []
        return [shots if every else shots.of(kept_evenly(len(shots.starts), FEW))]


def _clock(t: Array, segments: Rows, session: Rows, dt: float) -> Array:
    """Return the time of each of N rows on one axis [s], (N,): gaps stay, sessions follow each other.

    Args:
        t: Time of each row [s], (N,).
        segments: First row, and row after the last, of each gap-free segment (K, 2).
        session: Session of each segment (K,).
        dt: Sample time [s].
    """
    out, end = np.empty_like(t), -SESSION_GAP
    for number, (first, last) in enumerate(segments.tolist()):
        same = number > 0 and session[number] == session[number - 1]
        begin = end + (max(t[first] - t[first - 1], dt) if same else SESSION_GAP)
        out[first:last] = begin + t[first:last] - t[first]
        end = float(out[last - 1])
    return out


def decimated(x: Array, y: Array, points: int) -> tuple[Array, Array]:
    """Return a curve with at most `points` points, which keeps the least and greatest value of each stretch.

    A gap in the curve (NaN) stays a gap.

    Args:
        x: Abscissae, (N,).
        y: Ordinates, (N,).
        points: Maximum number of points; at most MOST_POINTS.

    Returns:
        Abscissae and ordinates of the points.
    """
    points = min(points, MOST_POINTS)
    if len(y) <= points:
        return x, y
    count = max(points // 3, 1)
    edges = np.arange(count + 1) * len(y) // count
    finite = np.isfinite(y)
    least = np.where(finite, y, np.inf)
    most = np.where(finite, y, -np.inf)
    size = int(np.diff(edges).max())
    rows = np.minimum(edges[:-1, None] + np.arange(size), edges[1:, None] - 1)
    low, high = (
        rows[np.arange(count), least[rows].argmin(axis=1)],
        rows[np.arange(count), most[rows].argmax(axis=1)],
    )
    empty = ~finite[rows].all(axis=1)
    broken = rows[np.arange(count), finite[rows].argmin(axis=1)]
    chosen = np.unique(np.concatenate([low, high, broken[empty]]))
    return x[chosen], y[chosen]
