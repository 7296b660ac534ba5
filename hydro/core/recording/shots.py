"""Shots: stretches of a few seconds of a recording, each with its own initial state.

`prediction.multiple_shooting` compares the predictions from these states with the log.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask, Rows
from hydro.core.errors import DataError
from hydro.core.recording.arrays import Recording, channels, noise, smoothed
from hydro.core.vehicle.frames import body_states

SHOT_SECONDS = 2.0
"""Length of a shot [s]: long enough for forces to show in the velocity, too short to diverge."""
CHANNELS = 12  # position, attitude, velocity, rates: three each
TRUST = np.repeat([0.1, 0.1, 0.3, 0.3], 3)
"""Prior standard deviation of a measured initial state [m, rad, m/s, rad/s]."""
UNSEEN_TRUST = 5.0  # factor for components without a sample in the shot
UNKNOWN = 0.5  # s, time after a gap in which thrusters still respond to commands lost in it
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
LEAST_SWELL = 1e-12  # negligible variance of waves in a shot, in units of the noise variance


@dataclass(frozen=True)
class Shots:
    """S short stretches of a recording, each predicted from its own initial state.

    Attributes:
        record: The recording, with N rows.
        starts: First row of each shot, (S,).
        segment: Segment of the recording that holds each shot, (S,).
        length: Number of rows of a shot.
        lead: Rows at the start of a shot that are predicted but not compared, for the delay of a late sensor.
        first: Initial state of each shot: position, quaternion, nu, (S, 13).
        measured: Logged position, quaternion and nu, (S, length, 13).
        sigma: Standard deviation of the noise of position, attitude (small rotations about the body's axes),
            velocity and rates, (12,).
        eta: Smoothed pose of the whole recording, (N, 6).
        nu: Smoothed velocity of the whole recording, (N, 6).
        share: Shots used, as a share of all shots that the recording has.
        seen: Mask of the measured values that are samples, (S, length, 12); None if all are.
        swell: Change of the compared channels by one standard deviation of each of Q harmonics of a sea, (S,
            length - lead, 12, Q); None for a calm sea (`output_error.in_waves`).
        anchor: Weight of the logged initial states in the cost, one over their standard deviation, (S, 12);
            None if initial states are free.
        steps: Integration steps per row of a prediction; None for as many as fits near the noise need.
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
    seen: NDArray[np.bool_] | None = None
    swell: Array | None = None
    anchor: Array | None = None
    steps: int | None = None

    @property
    def session(self) -> Rows:
        """Number of the session in which each shot lies, (S,)."""
        found: Rows = self.record.session[self.segment]
        return found

    @property
    def seconds(self) -> float:
        """Time from the first to the last compared row of a shot [s]."""
        return (self.length - self.lead - 1) * self.record.dt

    @property
    def residuals(self) -> int:
        """Number of compared values of one shot, 12 in each compared row, whether samples or not."""
        return (self.length - self.lead) * CHANNELS

    @property
    def trust(self) -> Array:
        """Prior standard deviation of the initial states, (12,) or (S, 12).

        It is of position [m], small rotation [rad], velocity [m/s] and rates [rad/s], and larger for channels
        without samples.
        """
        if self.seen is None:
            return TRUST
        return np.asarray(TRUST * np.where(self.seen.any(axis=1), 1.0, UNSEEN_TRUST))

    def weights(self, part: slice) -> NDArray[np.bool_] | None:
        """Return a mask of the values that are samples, among the compared values of a slice of the shots.

        Args:
            part: Slice of the shots, s of them.

        Returns:
            Shape (s, length - lead, 12); None if every value is a sample.
        """
        return None if self.seen is None else self.seen[part, self.lead :]

    @cached_property
    def hidden(self) -> Array | None:
        """Matrix B of each shot that whitens its residuals in waves, (S, residuals, Q); None for a calm sea.

        1 - B B^T equals (1 + X X^T)^(-1/2), the inverse root of the residuals' covariance, with X the `swell`
        in standard deviations of the noise.
        """
        if self.swell is None:
            return None
        x = self.swell / self.sigma[:, None]
        if self.seen is not None:
            x = x * self.seen[:, self.lead :, :, None]
        x = x.reshape(len(x), self.residuals, -1)
        size, ways = np.linalg.eigh(x.transpose(0, 2, 1) @ x)
        size = np.maximum(size, LEAST_SWELL)
        kept: Array = x @ (ways * np.sqrt((1.0 - (1.0 + size) ** -0.5) / size)[:, None, :])
        return kept

    def calmed(self, columns: Array, part: slice) -> Array:
        """Return columns of a least-squares problem, whitened for the covariance that waves cause.

        Args:
            columns: C columns for the s shots in `part`, (s, residuals, C); returned themselves for a calm
                sea.
            part: Slice of the shots.

        Returns:
            Whitened columns, (s, residuals, C).
        """
        if self.hidden is None:
            return columns
        basis = self.hidden[part]
        return np.asarray(columns - basis @ (basis.transpose(0, 2, 1) @ columns))

    def of(self, kept: NDArray[np.bool_]) -> Shots:
        """Return a new set with those of the shots for which the mask `kept`, (S,), is true."""
        there = tuple(name for name in ("seen", "swell", "anchor") if getattr(self, name) is not None)
        parts = ("starts", "segment", "first", "measured", *there)
        return replace(self, **{name: getattr(self, name)[kept] for name in parts})

    def first_part(self, seconds: float) -> Shots:
        """Return a copy of the shots cut after a compared time [s], or the shots themselves if not longer."""
        length = self.lead + max(round(seconds / self.record.dt), 1) + 1
        if length >= self.length:
            return self
        rows = {"measured": length, "seen": length, "swell": length - self.lead}
        there = {name: count for name, count in rows.items() if getattr(self, name) is not None}
        return replace(
            self, length=length, **{name: getattr(self, name)[:, :count] for name, count in there.items()}
        )

    def anchored(self) -> Shots:
        """Return a copy of the shots whose logged initial states count as samples (`anchor`).

        The standard deviation is that of `sigma`, or the error of the smoothed motion if larger.  The weight
        is 0 for a channel without samples in the shot.  It is also 0 in the first row of a segment, where
        smoothing is one-sided and the vehicle often starts to move.
        """
        error = np.maximum(smoothing_error(self.record, self.eta, self.nu), self.sigma)
        shown = (self.starts > self.record.segments[self.segment, 0])[:, None]
        if self.seen is not None:
            shown = shown & self.seen.any(axis=1)
        return replace(self, anchor=np.where(shown, 1.0 / error, 0.0))

    def begun_at(self, record: Recording) -> Shots:
        """Return a copy of the shots with initial states from the smoothed motion of another recording.

        Args:
            record: The same recording, but with other values in channels without samples.
        """
        eta, nu = smoothed(record)
        return replace(self, first=body_states(eta, nu)[self.starts], eta=eta, nu=nu)


def make_shots(
    record: Recording,
    *,
    seconds: float = SHOT_SECONDS,
    lead: float = 0.0,
    sigma: Array | None = None,
    most: int | None = None,
) -> Shots:
    """Return a recording cut into contiguous shots (short predictions).

    Keep some, evenly spread, if `most` limits them. After a gap, shots start half a second later if possible,
    since the thrust before is unknown.

    Args:
        record: The recording.
        seconds: Compared length of each shot [s].
        lead: Time predicted before the compared part [s]; at least the largest sensor delay that is tried.
        sigma: Standard deviation of the noise of the twelve channels, (12,); by default estimated from the
            recording.
        most: Maximum number of shots; by default all.

    Raises:
        DataError: No segment is as long as one shot.
    """
    ahead, length, starts = _laid(record, seconds, lead)
    if not (count := sum(part.size for part in starts)):
        raise DataError(
            f"no session has {length} rows ({length * record.dt:g} s) without a gap; record longer sessions"
        )
    kept = evenly(count, most)
    at = np.concatenate(starts)[kept]
    rows = at[:, None] + np.arange(length)
    eta, nu = smoothed(record)
    return Shots(
        record=record,
        starts=at,
        segment=np.repeat(np.arange(len(starts)), [part.size for part in starts])[kept],
        length=length,
        lead=ahead,
        first=body_states(eta, nu)[at],
        measured=body_states(record.eta, record.nu)[rows],
        sigma=noise(record) if sigma is None else np.asarray(sigma, float),
        eta=eta,
        nu=nu,
        share=len(kept) / count,
        seen=None if record.seen is None else record.seen[rows],
    )


def smoothing_error(record: Recording, eta: Array, nu: Array) -> Array:
    """Return the root mean square distance of the samples from the smoothed motion, by channel, (12,).

    The distance is an upper estimate of the error of a smoothed state.  It contains the noise of a whole
    sample, of which smoothing removes most, and the error of the smoothing where forces change fast.  A slow
    sensor's channel is filled between its samples; there, the distance of a sample from the line through its
    two neighbours counts if it is larger.

    Args:
        record: The recording.
        eta: Smoothed pose of every row, (N, 6).
        nu: Smoothed velocity of every row, (N, 6).

    Returns:
        Position [m], small rotation [rad], velocity [m/s] and rates [rad/s]; 0 for a channel without samples.
    """
    calm, logged = body_states(eta, nu), body_states(record.eta, record.nu)
    scalar, axis = np.split(calm[:, 3:7], [1], axis=1)
    turn = scalar * logged[:, 4:7] - logged[:, 3:4] * axis - np.cross(axis, logged[:, 4:7])
    away = np.hstack([logged[:, :3] - calm[:, :3], 2.0 * turn, logged[:, 7:] - calm[:, 7:]])
    if record.seen is None:
        return np.asarray(np.sqrt(np.mean(away**2, axis=0)))
    squares = np.where(record.seen, away**2, 0.0).sum(axis=0) / np.maximum(record.seen.sum(axis=0), 1)
    return np.asarray(np.sqrt(np.maximum(squares, _between_samples(record))))


def _between_samples(record: Recording) -> Array:
    """Return the mean squared distance of samples from the line through their neighbours, (12,).

    It is 0 for a channel with a sample in every row.
    """
    assert record.seen is not None
    found = np.zeros(CHANNELS)
    for i, parts in enumerate(channels(record)):
        errors = [np.zeros(0)]
        for part, (start, stop) in zip(parts, record.segments, strict=True):
            at = np.flatnonzero(record.seen[start:stop, i])
            if 2 < at.size < stop - start:
                share = (at[1:-1] - at[:-2]) / (at[2:] - at[:-2])
                x = part[at]
                errors.append(x[1:-1] - x[:-2] - share * (x[2:] - x[:-2]))
        if (every := np.concatenate(errors)).size:
            found[i] = np.mean(every**2)
    return found


def room(record: Recording, seconds: float) -> int:
    """Return the number of shots of `seconds` [s] that fit in a recording."""
    return sum(part.size for part in _laid(record, seconds, 0.0)[2])


def _laid(record: Recording, seconds: float, lead: float) -> tuple[int, int, list[Rows]]:
    """Return the rows of the lead, the rows of a shot, and the first rows of all shots in each segment."""
    ahead = int(np.ceil(lead / record.dt - 1e-9)) if lead > 0.0 else 0
    compared = max(round(seconds / record.dt), 6)
    length = ahead + compared
    unknown = np.where(record.after_gap, round(UNKNOWN / record.dt), 0)
    starts = [
        np.arange(a + min(lost, max(b - a - length, 0)), b - length + 1, compared, dtype=np.int64)
        for (a, b), lost in zip(record.segments, unknown, strict=True)
    ]
    return ahead, length, starts


def kept_evenly(count: int, most: int | None) -> Mask:
    """Return a mask, (count,), that keeps at most `most` of `count` shots, evenly spread.

    All if `most` is None.
    """
    kept = np.zeros(count, np.bool_)
    kept[evenly(count, most)] = True
    return kept


def evenly(count: int, most: int | None) -> Rows:
    """Return ascending indices of at most `most` of `count` shots; all if `most` is None.

    One shot is kept in each of `most` equal parts.  Its place in the part follows the golden ratio, so that
    it does not coincide with a rhythm of sessions or manoeuvres.  The selection is deterministic.
    """
    if most is None or count <= most:
        return np.arange(count, dtype=np.int64)
    edges = np.arange(most + 1) * count // most
    places = np.arange(most) * GOLDEN % 1.0
    chosen: Rows = edges[:-1] + (places * np.diff(edges)).astype(np.int64)
    return chosen
