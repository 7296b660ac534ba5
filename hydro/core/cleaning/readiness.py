"""Test of whether a recording can answer any question about the vehicle.

The thrusters must have run, or the vehicle must have sunk or risen freely.  The vehicle must have moved
beyond the noise of its sensors, and under water.  Its commands must be sampled faster than the vehicle
responds.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.recording.arrays import Recording, channels, noise
from hydro.core.recording.filling import unshown
from hydro.core.recording.jumps import is_sparse

LEAST_COMMAND = 0.02
"""Largest command of a stopped thruster, as a share of full command: the offset of a neutral pulse."""
WINDOW = 1.0
"""Window over which velocities and poses are averaged before they are compared with their noise [s]."""
MOVES = 0.02
"""Minimum velocity that counts as motion, root mean square [m/s, rad/s]; a resting sensor drifts less."""
ABOVE_NOISE = 3.0
"""Minimum ratio of windowed mean velocities to their noise that counts as motion."""
BEYOND_NOISE = 1.5
"""Minimum ratio of the depth's standard deviation to its noise in a changing depth; noise alone gives 1."""
TRAVEL = 0.3
"""Change of position or attitude that counts as motion however slow it is [m, rad]."""
SURFACE = 0.3
"""Maximum depth of a vehicle that floats at the surface [m]: half the height of a small vehicle."""
MOSTLY = 0.95
"""Minimum share of depth samples within SURFACE of a vehicle that floats."""
SLOW_COMMANDS = 1.0
"""Longest sample time of commands [s]: a small vehicle reaches its speed within one second."""
LEVELS, LEAST_TICKS = 20, 10
"""Minimum numbers of distinct values and of changes in a command column that samples a continuous curve."""
EVEN = 0.9
"""Minimum share of command changes at multiples of the commands' sample time."""
SMOOTH = 0.5
"""Correlation of successive command values above which they sample a curve rather than a pilot's steps."""
NOTHING = "nothing can be concluded about the vehicle"


def unready(record: Recording) -> str:
    """Return the reason, in words, why a recording shows nothing about the vehicle; empty if it is usable."""
    runs, still, floats = ran(record.commands), not moved(record), at_surface(record)
    if not runs and still:
        return f"the thrusters never ran and the vehicle did not move: {NOTHING}; record it under way"
    if still:
        return (
            "the vehicle did not move beyond the noise of its sensors, although thrusters were commanded: "
            f"{NOTHING}; check that it was armed, in the water and free to move"
        )
    if not runs and (floats or not _depth_known(record)):
        where = "stayed at the surface" if floats else "has no depth"
        return (
            f"the thrusters never ran and the vehicle {where}: {NOTHING}; run the thrusters, or let it sink "
            "or rise freely with a depth sensor"
        )
    if floats and _heaves(record):
        return (
            f"the depth stayed within {SURFACE:g} m of the surface, where waves and air act that no effect "
            f"describes: {NOTHING}; record it under water"
        )
    if (step := command_step(record)) > SLOW_COMMANDS:
        return (
            f"the commands are sampled every {step:.2g} s, slower than the vehicle responds: {NOTHING}; log "
            "them at 5 Hz or more"
        )
    return ""


def require_ready(record: Recording) -> None:
    """Raise an error if a recording shows nothing about the vehicle.

    Raises:
        DataError: The recording is not usable; the message gives the reason and what to do.
    """
    if why := unready(record):
        raise DataError(why)


def ran(commands: Array) -> bool:
    """Return whether any thruster ran; True without thrusters.

    Args:
        commands: Commands of n thrusters in N rows, (N, n); NaN where there is none.
    """
    return not commands.shape[1] or bool((np.abs(commands) > LEAST_COMMAND).any())


def moved(record: Recording) -> bool:
    """Return whether the vehicle moved: whether velocity or pose on any axis changes beyond sensor noise."""
    sigma, every = noise(record), list(channels(record))
    blind = np.zeros(12, bool)
    if record.seen is not None:
        blind = np.all([unshown(record.seen[a:b]) for a, b in record.segments], axis=0)
    if any(_moves(record, i, every[6 + i], sigma) for i in range(6) if not blind[6 + i]):
        return True
    return any(_travels(record, i, every[i], sigma[i]) for i in range(6))


def at_surface(record: Recording) -> bool:
    """Return whether the depth was measured and nearly always less than SURFACE [m] from zero."""
    z = _depth(record)
    return bool(z.size) and float(np.mean(np.abs(z) <= SURFACE)) >= MOSTLY


def command_step(record: Recording) -> float:
    """Return the sample time of the commands [s].

    Commands that a pilot changes in steps have no own sample time; the result is then the sample time of the
    recording.
    """
    steps = [_held(record, column) for column in record.commands.T]
    return max(steps, default=0.0) or record.dt


def _depth(record: Recording) -> Array:
    """Return the measured depths [m], without filled values."""
    return record.eta[:, 2] if record.seen is None else record.eta[record.seen[:, 2], 2]


def _depth_known(record: Recording) -> bool:
    """Return whether the depth was measured."""
    return bool(_depth(record).size)


def _heaves(record: Recording) -> bool:
    """Return whether the depth varies by more than its noise."""
    z = _depth(record)
    return bool(np.std(z) > BEYOND_NOISE * noise(record)[2])


def _moves(record: Recording, axis: int, parts: list[Array], sigma: Array) -> bool:
    """Return whether the mean velocities of windows exceed their noise.

    Between sparse samples noise and motion cannot be separated, so the pose alone decides.

    Args:
        record: The recording.
        axis: Velocity component, 0 to 5 for u v w p q r.
        parts: The component by segments, (n,) each; slope of the pose where it was not measured.
        sigma: Noise of all channels, (12,).
    """
    rows = max(round(WINDOW / record.dt), 1)
    measured = record.seen is None or bool(record.seen[:, 6 + axis].any())
    if is_sparse(record.dt) and measured:
        return False
    means = np.array([piece.mean() for part in parts for piece in _pieces(part, rows)])
    if not means.size:
        return False
    if measured and means.size == 1:  # one window cannot separate motion from a bias
        return True
    if measured:  # a sensor's bias is not motion
        share = 1.0 if record.seen is None else float(record.seen[:, 6 + axis].mean())
        size, least = float(np.std(means)), sigma[6 + axis] / np.sqrt(max(rows * share, 1.0))
    else:  # the slope of the pose
        pose = sigma[:3].max() if axis < 3 else sigma[3:6].max()
        size, least = float(np.sqrt(np.mean(means**2))), np.sqrt(2.0) * pose / WINDOW
    return bool(size > max(MOVES, ABOVE_NOISE * least))


def _travels(record: Recording, channel: int, parts: list[Array], sigma: float) -> bool:
    """Return whether a pose channel changes within a segment by more than TRAVEL and more than its noise."""
    if record.seen is not None and not record.seen[:, channel].any():
        return False
    rows = max(round(WINDOW / record.dt), 1)
    means = [np.array([piece.mean() for piece in _pieces(part, rows)]) for part in parts]
    widest = max((float(np.ptp(part)) for part in means if part.size), default=0.0)
    return bool(widest > max(TRAVEL, 2.0 * ABOVE_NOISE * sigma))


def _pieces(part: Array, rows: int) -> Iterator[Array]:
    """Yield contiguous pieces of `rows` rows; a shorter part as a whole."""
    for start in range(0, max(len(part) - rows + 1, min(len(part), 1)), rows):
        yield part[start : start + rows]


def _held(record: Recording, column: Array) -> float:
    """Return the time for which a command column holds each sample [s]; 0 for a pilot's steps."""
    changes = np.flatnonzero(np.diff(column) != 0.0)
    if len(changes) < LEAST_TICKS or len(np.unique(column)) < LEVELS:
        return 0.0
    gaps = np.diff(changes)
    step = int(np.median(gaps))
    values = column[changes]
    even = np.mean(np.abs(gaps / step - np.round(gaps / step)) * step <= 1.0)
    if even < EVEN or not np.std(values) > 0.0:
        return 0.0
    smooth = np.corrcoef(values[1:], values[:-1])[0, 1]
    return step * record.dt if smooth > SMOOTH else 0.0
