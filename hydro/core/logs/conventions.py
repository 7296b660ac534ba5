"""Conversion of frames, units and signs of a log to NED, FRD and SI.

Every function reads the columns of one block of a `LogMap` and returns their quantity at given times.  To
read the same columns with another meaning, pass another block.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from hydro.core.columns import Array, Mask
from hydro.core.errors import DataError
from hydro.core.logs.logmap import (
    Attitude,
    Command,
    Commands,
    Mixer,
    Mount,
    Number,
    Position,
    Rates,
    Velocity,
    Voltage,
    command,
    named,
)
from hydro.core.logs.mixer import mixed
from hydro.core.logs.resample import (
    HELD_EARLY,
    Channel,
    averaged,
    channel,
    held,
    interpolated,
    same_sign,
    unwrapped,
)
from hydro.core.vehicle.frames import HALF_TURN, rotation

AXES: dict[str, Array] = {
    "NED": np.eye(3),
    "ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "NWU": np.diag(HALF_TURN),
    "FRD": np.eye(3),
    "FLU": np.diag(HALF_TURN),
}
"""Matrices that turn a vector of each world into NED, and of each body into FRD."""

BODIES = ("FRD", "FLU")
UNITS = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "m/s": 1.0,
    "cm/s": 0.01,
    "mm/s": 0.001,
    "kn": 1852.0 / 3600.0,
    "rad": 1.0,
    "deg": np.pi / 180.0,
    "rad/s": 1.0,
    "deg/s": np.pi / 180.0,
}
"""Size of each unit of a map in SI."""

VOLTS = {"V": 1.0, "mV": 1e-3}
LEAST_VOLTS, MOST_VOLTS = 1.0, 1000.0
"""Plausible supply voltage of thrusters [V]; the median of a log's readings is above the minimum."""
TURN = 2.0 * np.pi * 1.01
"""One turn [rad], with a margin of one percent for noise."""
FAR_OUT = 2.0
"""Command magnitude above which the unit must be another one."""


@dataclass(frozen=True)
class SessionLog:
    """Session of a log with n rows.

    Attributes:
        name: Name of the session.
        t: Times since the start of the session [s], shape (n,), not falling.
        columns: Numbers as logged, (n,), by column; NaN where a cell is empty.
        clocks: Times of the rows of a column with a clock of its own [s], not falling, by column.
        unset: Masks of the rows in which the log contains NaN, (n,), by command column; an empty cell does
            not count.
        cut: Reason for the start of the session, if the clock of the log jumped there; else empty.
        repeated: Number of rows that were left out because they repeat the row before.
    """

    name: str
    t: Array
    columns: Mapping[str, Array]
    clocks: Mapping[str, Array] = field(default_factory=dict)
    unset: Mapping[str, Mask] = field(default_factory=dict)
    cut: str = ""
    repeated: int = 0

    def time_of(self, name: str) -> Array:
        """Return the times of a column's rows [s], from its own clock if it has one.

        Args:
            name: Name of the column.
        """
        return self.clocks.get(name, self.t)

    def channel(self, source: Number) -> Channel:
        """Return the samples of one column, scaled and offset as the map states, without empty cells.

        Args:
            source: Column of the map, or its name alone.
        """
        column = named(source)
        return channel(
            self.time_of(column.column), column.scale * self.columns[column.column] + column.offset
        )


def position(log: SessionLog, block: Position, at: Array) -> Array:
    """Return the position of the body origin, NED, (N, 3) [m], interpolated from the log.

    North and east are 0 if the log has a depth alone.

    Args:
        log: The session.
        block: Position block of the map.
        at: Times [s], (N,).
    """
    axes, unit = AXES[block.world], UNITS[block.unit]
    vertical = block.depth if block.depth is not None else block.height
    values = np.zeros((len(at), 3))
    for i, source in enumerate(block.columns):
        values[:, i] = unit * interpolated(log.channel(source), at)
    placed: Array = values @ axes.T
    if vertical is not None:
        down = 1.0 if block.depth is not None else -1.0
        placed[:, 2] = down * unit * interpolated(log.channel(vertical), at)
    return placed


def attitude(log: SessionLog, block: Attitude, at: Array) -> Array:
    """Return the rotation matrices from FRD to NED, (N, 3, 3), interpolated from the log.

    Args:
        log: The session.
        block: Attitude block of the map.
        at: Times [s], (N,).
    """
    return in_frames(block, own_attitude(log, block, at))


def own_attitude(log: SessionLog, block: Attitude, at: Array) -> Array:
    """Return the rotation matrices from the map's body axes to its world axes, (N, 3, 3).

    Args:
        log: The session.
        block: Attitude block of the map, which names these axes.
        at: Times [s], (N,).
    """
    return _quaternions(log, block, at) if block.quaternion is not None else _euler(log, block, at)


def in_frames(block: Attitude, turned: Array) -> Array:
    """Return the rotation matrices from FRD to NED, (..., 3, 3), for matrices between other axes.

    Args:
        block: Attitude block of the map, with the frames of body and world, and the sensor's mounting.
        turned: Rotation from the block's body frame to its world frame, shape (..., 3, 3).
    """
    R = np.asarray(AXES[block.world] @ turned @ AXES[block.body].T)
    return R if block.mount is None else np.asarray(R @ turn(block.mount).T)


def turn(mount: Mount) -> Array:
    """Return the rotation matrix from a mounted sensor's axes to the body's axes, (3, 3)."""
    if mount.matrix is not None:
        return np.array(mount.matrix, float)
    of_angles = scipy.spatial.transform.Rotation.from_euler
    return np.asarray(of_angles("ZYX", [mount.yaw, mount.pitch, mount.roll], degrees=True).as_matrix())


def velocity(log: SessionLog, block: Velocity, at: Array, R: Array) -> Array:
    """Return the velocity of the body origin over ground, FRD, (N, 3) [m/s], interpolated from the log.

    Args:
        log: The session.
        block: Velocity block of the map.
        at: Times [s], shape (N,).
        R: Rotation from FRD to NED at these times, (N, 3, 3); it converts a velocity along world axes.
    """
    moved = _vector(log, block, at)
    return moved if block.frame in BODIES else np.einsum("nji,nj->ni", R, moved)


def rates(log: SessionLog, block: Rates, at: Array) -> Array:
    """Return the angular velocity about FRD axes, (N, 3) [rad/s], interpolated from the log.

    Args:
        log: The session.
        block: Rates block of the map.
        at: Times [s], (N,).
    """
    return _vector(log, block, at)


def commands(
    log: SessionLog, block: Commands, at: Array, dt: float, mixer: Mixer | None = None
) -> tuple[Array, Mask]:
    """Return thruster commands in [-1, 1] for each row: the mean of the held commands until the next row.

    Args:
        log: Session of the log.
        block: Commands of the map.
        at: Times of the N rows [s], (N,).
        dt: Sample time [s].
        mixer: Mixer of the map, from demands to thrusters; None without one.

    Returns:
        Commands of the n thrusters, (N, n), and a mask of the commands that were beyond [-1, 1], after any
        mixer, and were clipped, (N, n).
    """
    values = np.empty((len(at), len(block.columns)))
    for i, source in enumerate(map(command, block.columns)):
        drive = _drive(log, source, block, at, dt)
        values[:, i] = -drive if source.reverse else drive
    if mixer is not None:
        values = mixed(mixer, np.clip(values, -1.0, 1.0))
    beyond = np.abs(values) > 1.0 + 1e-9
    return np.clip(values, -1.0, 1.0), beyond


def require_shares(log: SessionLog, block: Commands, at: Array, dt: float) -> None:
    """Raise an error if the size of commands shows that they are not fractions of full thrust.

    Args:
        log: Session of the log.
        block: Commands of the map.
        at: Times of the N rows [s], (N,).
        dt: Sample time [s].

    Raises:
        DataError: A command is so far beyond -1 to 1 that the declared unit must be wrong.
    """
    for i, source in enumerate(map(command, block.columns)):
        drive = _drive(log, source, block, at, dt)
        if np.abs(drive).max(initial=0.0) > FAR_OUT:
            raise DataError(
                f"column {source.column}, the command of thruster {i + 1}, reaches "
                f"{drive[np.abs(drive).argmax()]:g} times full thrust if commands.unit is {block.unit!r}; "
                "set it to '1', 'percent' or 'pwm' (with commands.pwm), or give the column a scale and offset"
            )


def in_degrees(angles: Sequence[Array]) -> bool:
    """Return whether roll, pitch and yaw are so large that they must be degrees.

    Roll and pitch in radians never exceed a turn.  Yaw in radians may count turns: it starts within one turn
    and continues in steps below half a turn.

    Args:
        angles: Roll, pitch and yaw, (n,) each; NaN for empty cells.
    """
    roll, pitch, yaw = (each[np.isfinite(each)] for each in angles)
    if max(np.abs(roll).max(initial=0.0), np.abs(pitch).max(initial=0.0)) > TURN:
        return True
    if np.abs(yaw).max(initial=0.0) <= TURN:
        return False
    return bool(abs(yaw[0]) > TURN or np.abs(np.diff(yaw)).max(initial=0.0) > np.pi)


def beyond_a_turn(log: SessionLog, block: Attitude) -> str:
    """Return an error message if a map declares radians and the angles are too large for radians.

    Args:
        log: The session.
        block: Attitude block of the map.

    Returns:
        The message; an empty string if the unit is plausible.
    """
    if block.columns is None or block.unit == "deg":
        return ""
    angles = [log.channel(source).values for source in block.columns]
    if not in_degrees(angles):
        return ""
    most = [float(np.abs(each).max(initial=0.0)) for each in angles]
    source = named(block.columns[int(np.argmax(most))])
    return (
        f"{source.column} reaches {max(most):.4g} rad if attitude.unit is right, more than a whole turn: "
        'set attitude.unit = "deg"'
    )


def _drive(log: SessionLog, source: Command, block: Commands, at: Array, dt: float) -> Array:
    """Return one column of commands as shares of full thrust, each the mean over a row, (N,).

    Args:
        log: Session of the log.
        source: Column of the map.
        block: Commands of the map, with their unit.
        at: Times of the N rows [s], (N,).
        dt: Sample time [s].
    """
    given = log.channel(source)
    return averaged(Channel(given.t, _normalised(given.values, block)), at, dt)


def voltage(log: SessionLog, block: Voltage, at: Array, dt: float) -> Array:
    """Return the supply voltage at each of N times: the last reading at or before the time, (N,) [V].

    The value is NaN before the first reading.

    Args:
        log: Session of the log.
        block: Voltage of the map.
        at: Times [s], (N,).
        dt: Sample time [s].

    Raises:
        DataError: A reading is implausible, so that the declared unit must be wrong.
    """
    given = log.channel(named(block.column))
    if not len(given.t):
        return np.full(len(at), np.nan)
    volts = VOLTS[block.unit] * given.values
    if volts.min() < 0.0 or volts.max() > MOST_VOLTS or not np.median(volts) > LEAST_VOLTS:
        other = "mV" if block.unit == "V" else "V"
        raise DataError(
            f"column {named(block.column).column}, the supply voltage, reads {volts.min():g} to "
            f"{volts.max():g} V if voltage.unit is {block.unit!r}; set it to {other!r}, or say in "
            "voltage.valid which readings count"
        )
    read = held(Channel(given.t, volts), at, dt)
    return np.where(at + HELD_EARLY * dt < given.t[0], np.nan, read)


def _normalised(values: Array, block: Commands) -> Array:
    """Return commands in the block's unit as shares of full thrust."""
    if block.unit == "percent":
        return values / 100.0
    if block.unit == "pwm":
        ahead, astern = block.pwm.max - block.pwm.neutral, block.pwm.neutral - block.pwm.min
        raised = values - block.pwm.neutral
        return raised / np.where(raised > 0.0, ahead, astern)
    return values


def _vector(log: SessionLog, block: Velocity | Rates, at: Array) -> Array:
    """Return three columns of a block in SI, in FRD or NED."""
    columns = [interpolated(log.channel(source), at) for source in block.columns]
    values: Array = UNITS[block.unit] * np.stack(columns, axis=1) @ AXES[block.frame].T
    return values


def _euler(log: SessionLog, block: Attitude, at: Array) -> Array:
    """Return the rotation from the block's body axes to its world axes, from Euler angles."""
    unit = UNITS[block.unit]
    turn = 2.0 * np.pi / unit
    about = {
        axis: unit * interpolated(unwrapped(log.channel(source), turn), at)
        for axis, source in zip("XYZ", block.columns or (), strict=True)
    }
    if block.order == "ZYX":
        return rotation(about["X"], about["Y"], about["Z"])
    angles = np.stack([about[axis] for axis in block.order], axis=1)
    return np.asarray(scipy.spatial.transform.Rotation.from_euler(block.order, angles).as_matrix())


def _quaternions(log: SessionLog, block: Attitude, at: Array) -> Array:
    """Return the rotation from the block's body axes to its world axes, from normalised quaternions."""
    assert block.quaternion is not None
    channels = same_sign([log.channel(source) for source in block.quaternion])
    q = np.stack([interpolated(each, at) for each in channels], axis=1)
    if block.layout == "wxyz":
        q = q[:, [1, 2, 3, 0]]
    if len(q) and not np.linalg.norm(q, axis=1).min() > 1e-6:
        raise DataError("attitude.quaternion: a quaternion of length 0 is no rotation; leave its cells empty")
    of_quaternion = scipy.spatial.transform.Rotation.from_quat
    matrices: Array = of_quaternion(q).as_matrix() if len(q) else np.empty((0, 3, 3))
    return matrices if block.turns == "body to world" else np.swapaxes(matrices, 1, 2)
