"""Excitation: demanded wrenches that move a vehicle so that the recording shows its physics.

The method is that of Deep Hydro-Sim (Wu et al., section IV-A).  A collection is a list of sessions, each of
one kind: single-axis sine sweeps in surge, sway, heave and yaw; coupled manoeuvres (circles, corkscrews,
drift turns); Ornstein-Uhlenbeck walks on all axes; and the nine-segment, 90 s sequence of that paper's
replay.  A demand is a share of the maximum wrench of the thrusters on that axis alone, so it fits any
vehicle; `vehicle.control_allocation` converts demands to commands.

All random numbers depend on the seed and the session's number only, not on the order of the work.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.leaky_sum import leaky_sum

SURGE, SWAY, HEAVE, ROLL, PITCH, YAW = range(6)
SWEEPS = {"sweep_surge": SURGE, "sweep_sway": SWAY, "sweep_heave": HEAVE, "sweep_yaw": YAW}
LOG_RATE = 50.0
"""Rate of rows and commands [Hz]."""
REPLAY = "replay90"
REPLAY_SECONDS = 90.0  # duration of the sequence of the paper [s]
DECKS: dict[str, tuple[str, ...]] = {
    "hybrid": (*SWEEPS, "coupled", "coupled", "coupled", "walk", "walk", "walk"),
    "sweeps": tuple(SWEEPS),
    "coupled": ("coupled",),
    "walks": ("walk",),
    REPLAY: (REPLAY,),
}
"""Kinds of session of each excitation, drawn like cards: each once in random order, then again."""

SHORTEST, LONGEST = 6_000, 29_000
"""Minimum and maximum number of rows of a session in a large collection."""
LEAST_ROWS = 250
"""Minimum number of rows of a session in a small collection, which has about one session of each kind."""


@dataclass(frozen=True)
class Session:
    """Planned session of a collection (a simulated recording of many sessions).

    Attributes:
        name: Name, such as `003_walk`.
        kind: Kind of excitation, an entry of `DECKS`.
        rows: Number of rows.
        number: Position in the collection, from 0; part of the seed of its random numbers.
    """

    name: str
    kind: str
    rows: int
    number: int


def plan(
    rows: int, seed: int, axes: Sequence[int] = range(6), *, excitation: str = "hybrid"
) -> tuple[Session, ...]:
    """Return the planned sessions of a collection, a simulated recording; their rows sum to exactly `rows`.

    Args:
        rows: Total number of rows.
        seed: Seed of the order of kinds and of the lengths.
        axes: Axes that the vehicle's thrusters can actuate, 0 to 5; sweeps of all other axes are omitted.
        excitation: Key of `DECKS`, which lists kinds of excitation.

    Returns:
        Sessions of 6,000 to 29,000 rows if `rows` suffices for one of each kind; else sessions that are
        shorter in proportion.

    Raises:
        DataError: An unknown excitation, fewer than one row, or no axis to excite.
    """
    if excitation not in DECKS:
        raise DataError(f"excitation {excitation!r} is not known; there are {', '.join(DECKS)}")
    if rows < 1:
        raise DataError(f"a collection needs at least one row, not {rows}")
    deck = [kind for kind in DECKS[excitation] if SWEEPS.get(kind, axes[0] if axes else -1) in axes]
    if not deck:
        raise DataError(
            "the vehicle's thrusters produce no axis that this excitation uses: give it thrusters"
        )
    if excitation == REPLAY:
        return (Session(REPLAY, REPLAY, rows, 0),)
    rng = np.random.default_rng(seed)
    lengths = _lengths(rows, len(deck), rng)
    kinds: list[str] = []
    while len(kinds) < len(lengths):
        kinds += [deck[i] for i in rng.permutation(len(deck))]
    return tuple(
        Session(f"{number:03d}_{kind}", kind, length, number)
        for number, (kind, length) in enumerate(zip(kinds, lengths, strict=False))
    )


def demands(session: Session, seed: int, dt: float) -> Array:
    """Return the demanded wrench of a session in every row, as fractions of the authority of each axis.

    The authority is the maximum wrench of the thrusters on that axis alone.

    Args:
        session: Session from `plan`.
        seed: Seed of the collection.
        dt: Time between rows [s].

    Returns:
        (rows, 6) in [-1, 1]; row k is held on [t_k, t_k+1).
    """
    # Numbers start at 1: a trailing 0 would repeat the random stream of `plan`.
    rng = np.random.default_rng([seed, session.number + 1])
    if session.kind in SWEEPS:
        out = np.zeros((session.rows, 6))
        out[:, SWEEPS[session.kind]] = _sweep(session.rows, dt, rng)
        return out
    if session.kind == "walk":
        return _walk(session.rows, dt, rng)
    segments = _replay_segments() if session.kind == REPLAY else _coupled_segments(session.rows * dt, rng)
    return _smooth(np.clip(_drawn(segments, session.rows, dt), -1.0, 1.0), dt)


def holds_heading(kind: str) -> bool:
    """Return whether the pilot holds the heading in sessions of a kind: in single-axis sweeps except in yaw.

    Args:
        kind: Kind of excitation, an entry of `DECKS`.
    """
    return kind in SWEEPS and kind != "sweep_yaw"


def _lengths(rows: int, deck: int, rng: np.random.Generator) -> list[int]:
    """Return random session lengths that sum to `rows`, for a deck of `deck` kinds of session."""
    shrink = min(1.0, rows / (deck * 0.5 * (SHORTEST + LONGEST)))
    low, high = max(LEAST_ROWS, int(SHORTEST * shrink)), max(4 * LEAST_ROWS, int(LONGEST * shrink))
    lengths: list[int] = []
    left = rows
    while left > high:
        # The remainder must not be shorter than the shortest session.
        lengths.append(int(rng.integers(low, min(high, left - low) + 1)))
        left -= lengths[-1]
    return [*lengths, left]


def _sweep(rows: int, dt: float, rng: np.random.Generator) -> Array:
    """Return one sine sweep after another, each of 40 to 80 s, about 0.03 to 0.5 Hz, in [-1, 1], (rows,)."""
    parts: list[Array] = []
    count = 0
    while count < rows:
        seconds = rng.uniform(40.0, 80.0)
        amplitude, low, high = rng.uniform(0.25, 1.0), rng.uniform(0.02, 0.05), rng.uniform(0.3, 0.8)
        time = np.arange(round(seconds / dt)) * dt
        growth = math.log(high / low) / seconds
        phase = 2.0 * np.pi * low * np.expm1(growth * time) / growth
        parts.append(rng.choice([-1.0, 1.0]) * amplitude * np.sin(phase))
        count += time.size
    return _smooth(np.concatenate(parts)[:rows, None], dt)[:, 0]


def _walk(rows: int, dt: float, rng: np.random.Generator) -> Array:
    """Return Ornstein-Uhlenbeck walks on six axes, dx = -x/T dt + sigma sqrt(2/T) dW, (rows, 6).

    T and sigma are random for each axis, and W is a Wiener process.  Initial values are drawn from the
    stationary distribution.
    """
    constant = rng.uniform(1.0, 6.0, size=6)
    sigma = rng.uniform([0.3, 0.3, 0.3, 0.1, 0.1, 0.15], [0.7, 0.7, 0.7, 0.3, 0.3, 0.4])
    keep = np.exp(-dt / constant)
    kicks = rng.standard_normal((rows, 6)) * np.sqrt(1.0 - keep**2)
    start = rng.standard_normal(6)
    kicks[0] += keep * start
    walk = np.column_stack([leaky_sum(kicks[:, [i]], keep[i]) for i in range(6)])
    clipped: Array = np.clip(sigma * walk, -1.0, 1.0)
    return clipped


@dataclass(frozen=True)
class _Segment:
    """Segment of a session: a constant demand plus a sine on each axis.

    Attributes:
        seconds: Duration [s].
        steady: Constant part, (6,).
        swing: Amplitude of the sine, (6,).
        frequency: Frequency of the sine [Hz].
    """

    seconds: float
    steady: Array
    swing: Array
    frequency: float


def _demand(**axes: float) -> Array:
    """Return six shares from shares by name: `_demand(surge=0.5, yaw=0.2)`."""
    names = ("surge", "sway", "heave", "roll", "pitch", "yaw")
    return np.array([axes.get(name, 0.0) for name in names])


def _coupled_segments(seconds: float, rng: np.random.Generator) -> list[_Segment]:
    """Return circles, corkscrews and drift turns in random order, 15 to 45 s each, for at least `seconds`."""
    segments: list[_Segment] = []
    while seconds > 0.0:
        length = rng.uniform(15.0, 45.0)
        ahead = rng.uniform(0.3, 0.9) * rng.choice([1.0, 1.0, 1.0, -1.0])
        turn = rng.uniform(0.1, 0.5) * rng.choice([-1.0, 1.0])
        size, frequency = rng.uniform(0.2, 0.7), rng.uniform(0.04, 0.2)
        steady, swing = {
            "circle": (_demand(surge=ahead, yaw=turn), _demand(surge=0.3 * size)),
            "corkscrew": (_demand(surge=ahead, yaw=turn), _demand(heave=size, roll=0.2 * size)),
            "drift turn": (
                _demand(surge=0.6 * ahead, sway=-math.copysign(size, turn), yaw=turn),
                _demand(yaw=0.3 * size),
            ),
        }[str(rng.choice(["circle", "corkscrew", "drift turn"]))]
        segments.append(_Segment(length, steady, swing, frequency))
        seconds -= length
    return segments


def _replay_segments() -> list[_Segment]:
    """Return nine segments of 10 s: sines in surge, heave, yaw, then circles and drift turns."""
    rest = np.zeros(6)
    each = REPLAY_SECONDS / 9.0
    return [
        _Segment(each, rest, _demand(surge=0.8), 0.2),
        _Segment(each, rest, _demand(heave=0.6), 0.2),
        _Segment(each, rest, _demand(yaw=0.4), 0.3),
        _Segment(each, rest, _demand(surge=0.6, heave=0.4, yaw=0.3), 0.25),
        _Segment(each, _demand(surge=0.7, yaw=0.25), rest, 0.0),
        _Segment(each, _demand(surge=0.6, yaw=-0.3), _demand(heave=0.4), 0.2),
        _Segment(each, _demand(surge=0.4, sway=-0.5, yaw=0.3), rest, 0.0),
        _Segment(each, _demand(surge=0.4, sway=0.5, yaw=-0.3), rest, 0.0),
        _Segment(each, _demand(surge=-0.4, sway=0.3), _demand(heave=0.3, yaw=0.3), 0.2),
    ]


def _drawn(segments: Sequence[_Segment], rows: int, dt: float) -> Array:
    """Return the demands of consecutive segments, (rows, 6); the list repeats if it is too short."""
    out = np.zeros((rows, 6))
    start, index = 0.0, 0
    while round(start / dt) < rows:
        segment = segments[index % len(segments)]
        first, last = round(start / dt), min(round((start + segment.seconds) / dt), rows)
        time = (np.arange(first, last) * dt - start)[:, None]
        out[first:last] = segment.steady + segment.swing * np.sin(2.0 * np.pi * segment.frequency * time)
        start, index = start + segment.seconds, index + 1
    return out


def _smooth(demand: Array, dt: float, constant: float = 0.25) -> Array:
    """Low-pass a demand (rows, 6) from rest with a time constant [s], so that it never jumps."""
    keep = math.exp(-dt / constant)
    return leaky_sum((1.0 - keep) * demand, keep)
