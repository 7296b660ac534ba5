"""Shots: stretches of a few seconds from many places of a recording, each with its own beginning.

What a model predicts from there is compared with what was logged: `prediction.multiple_shooting`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask, Rows
from hydro.core.errors import DataError
from hydro.core.recording.arrays import Recording, noise, smoothed
from hydro.core.vehicle.frames import body_states

SHOT_SECONDS = 2.0
"""Length of a shot: long enough for forces to show in the velocity, too short to diverge."""
CHANNELS = 12  # position, attitude, velocity, rates: three each
TRUST = np.repeat([0.1, 0.1, 0.3, 0.3], 3)  # of the initial state at sight [m, rad, m/s, rad/s]
UNSEEN_TRUST = 5.0  # times that, of what no sample of the shot shows
UNKNOWN = 0.5  # s, after a gap, in which thrusters still obey commands that it swallowed
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0
LEAST_SWELL = 1e-12  # square of what a sea makes of a shot, in that of the noise: less is nothing


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
        seen: Which of the measured values are samples, (S, length, 12); None where all are.
        swell: What one standard deviation of each harmonic of a sea makes of what is compared,
            (S, length - lead, 12, Q); None of a calm one (`output_error.in_waves`).
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

    @property
    def session(self) -> Rows:
        """Session of the recording that each shot lies in, (S,)."""
        found: Rows = self.record.session[self.segment]
        return found

    @property
    def seconds(self) -> float:
        """From the first to the last row that is compared of a shot [s]."""
        return (self.length - self.lead - 1) * self.record.dt

    @property
    def residuals(self) -> int:
        """Numbers compared in one shot where all channels have a sample in every row."""
        return (self.length - self.lead) * CHANNELS

    @property
    def trust(self) -> Array:
        """How well the initial state is known at sight, (12,) or (S, 12): less of what is not seen."""
        if self.seen is None:
            return TRUST
        return np.asarray(TRUST * np.where(self.seen.any(axis=1), 1.0, UNSEEN_TRUST))

    def weights(self, part: slice) -> NDArray[np.bool_] | None:
        """Which numbers of some shots count, (s, length - lead, 12); None where all do."""
        return None if self.seen is None else self.seen[part, self.lead :]

    @cached_property
    def hidden(self) -> Array | None:
        """B of 1 - B B^T = (1 + X X^T)^(-1/2), X the `swell` in units of the noise, (S, residuals, Q)."""
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
        """Columns (s, residuals, C) of some shots, weighed by what a sea hides of them."""
        if self.hidden is None:
            return columns
        basis = self.hidden[part]
        return np.asarray(columns - basis @ (basis.transpose(0, 2, 1) @ columns))

    def of(self, kept: NDArray[np.bool_]) -> Shots:
        """The shots that a mask (S,) keeps."""
        there = tuple(name for name in ("seen", "swell") if getattr(self, name) is not None)
        parts = ("starts", "segment", "first", "measured", *there)
        return replace(self, **{name: getattr(self, name)[kept] for name in parts})

    def begun_at(self, record: Recording) -> Shots:
        """The same shots, begun where the smoothed motion of another filling of their recording has them."""
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


def room(record: Recording, seconds: float) -> int:
    """Return the number of shots of a length [s] that a recording has room for."""
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
    """The same as a mask, (count,), see `evenly`."""
    kept = np.zeros(count, np.bool_)
    kept[evenly(count, most)] = True
    return kept


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
