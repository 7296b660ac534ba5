"""Predictions over a window of a recording, for a page that draws them anew at every change of a vehicle.

Predictions of one length lie end to end along each segment and start from the smoothed measured motion, as in
`evaluation.replay_error`; the last prediction of a segment is shorter.  Only those that reach into the window
are computed.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.prediction.candidate import Candidate
from hydro.core.prediction.multiple_shooting import corrected_first, predict, prepare
from hydro.core.recording.arrays import Recording, smoothed
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.vehicle.frames import body_states, euler_from_quaternion


class Windows:
    """Calculator of predictions over windows (stretches of rows) of one recording of N rows.

    Attributes:
        record: The recording.
        eta: Smoothed pose, (N, 6) [m, rad].
        nu: Smoothed velocity, (N, 6) [m/s, rad/s].
        logged: Pose with unwrapped angles, and velocity, as logged, (N, 12).
    """

    def __init__(self, record: Recording) -> None:
        """Smooth the motion of a recording once for all windows."""
        self.record = record
        self.eta, self.nu = smoothed(record)
        self._first, self._states = body_states(self.eta, self.nu), body_states(record.eta, record.nu)
        self.logged = np.hstack([record.eta, record.nu])
        for start, stop in record.segments:
            self.logged[start:stop, 3:6] = np.unwrap(self.logged[start:stop, 3:6], axis=0)

    def predicted(self, model: Candidate, horizon: float | None, begin: int, end: int) -> Array:
        """Return a model's predictions of pose and velocity in the rows of a window.

        Args:
            model: Compiled vehicle.
            horizon: Length of a prediction [s]; None for one prediction of each segment.
            begin: First row of the window.
            end: Row after the last of the window.

        Returns:
            Pose in NED [m, rad] and velocity in the body frame [m/s, rad/s] of rows `begin` to `end`, (end -
            begin, 12).  NaN in the first row of a prediction, so that a line breaks there, and where a motion
            diverges.
        """
        starts, segment, lengths = self.laid(horizon, begin, end)
        out = np.full((end - begin, CHANNELS), np.nan)
        for length in np.unique(lengths):
            part = lengths == length
            shots = corrected_first(self.shots(starts[part], segment[part], int(length)), model)
            states = predict(prepare(model, shots), shots)
            for start, motion in zip(starts[part], states, strict=True):
                first, last = max(start + 1, begin), min(start + length, end)
                if first >= last:
                    continue
                rows = motion[first - start : last - start]
                angles = np.unwrap(euler_from_quaternion(rows[:, 3:7]), axis=0)
                turns = 2.0 * np.pi * np.round((self.logged[first, 3:6] - angles[0]) / (2.0 * np.pi))
                out[first - begin : last - begin] = np.hstack([rows[:, :3], angles + turns, rows[:, 7:]])
        return out

    def laid(self, horizon: float | None, begin: int, end: int) -> tuple[Rows, Rows, Rows]:
        """Return first row, segment and length in rows of the S predictions in a window, (S,) each.

        Args:
            horizon: Length of a prediction [s]; None for one prediction of each segment.
            begin: First row of the window.
            end: Row after the last of the window.
        """
        starts, segment, lengths = list[int](), list[int](), list[int]()
        for number, (first, last) in enumerate(self.record.segments.tolist()):
            length = last - first if horizon is None else round(horizon / self.record.dt) + 1
            for start in range(first, last - 1, length):
                stop = min(start + length, last)
                if start < end and stop > begin and stop - start > 1:
                    starts.append(start)
                    segment.append(number)
                    lengths.append(stop - start)
        return np.array(starts, np.int64), np.array(segment, np.int64), np.array(lengths, np.int64)

    def shots(self, starts: Rows, segment: Rows, length: int) -> Shots:
        """Return the set-up of S short predictions, each beginning at a measured state of the recording.

        The standard deviation of the sensors' noise is 1 in every channel, so that errors keep their units.

        Args:
            starts: Row of the recording at which each prediction begins, (S,).
            segment: Number of the gap-free segment of the recording that contains each prediction, (S,).
            length: Number of rows of each prediction.
        """
        rows = starts[:, None] + np.arange(length)
        return Shots(
            self.record,
            starts,
            segment,
            length,
            0,
            self._first[starts],
            self._states[rows],
            np.ones(CHANNELS),
            self.eta,
            self.nu,
            seen=None if self.record.seen is None else self.record.seen[rows],
        )
