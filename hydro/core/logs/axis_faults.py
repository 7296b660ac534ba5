"""Detection of mislabelled columns of a raw table: reversed, exchanged, in degrees, in other frames.

The columns of a raw table have a defined meaning, so `logs.convention_check` tests the table like a log with
its map: d(position)/dt = R v and dR/dt = R S(omega), whatever forces act (see `logs.agreement`).  If exactly
one meaning of the columns fits the kinematics, the table is corrected.  If two meanings fit equally well, or
a velocity was not measured, only the author of the log can decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
import polars as pl

from hydro.core.columns import POSE, VELOCITY, Array, Mask, Rows
from hydro.core.errors import DataError
from hydro.core.logs.agreement import Evidence, testable, windows
from hydro.core.logs.alternatives import Change, difference
from hydro.core.logs.convention_check import LEAST_WINDOWS, MOSTLY, check, contradiction, rivals
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.importing import motion
from hydro.core.logs.logmap import BLOCKS, Attitude, Commands, LogMap, Position, Rates, Time, Velocity
from hydro.core.recording.arrays import Recording, noise
from hydro.core.recording.sensor_faults import Fault

AS_CALLED = LogMap(
    time=Time("t"),
    position=Position(POSE[:3]),
    attitude=Attitude(POSE[3:]),
    velocity=Velocity(VELOCITY[:3]),
    rates=Rates(VELOCITY[3:]),
    commands=Commands(()),
)
"""Map of a raw table: NED, FRD and SI."""
COLUMNS = {"position": POSE[:3], "attitude": POSE[3:], "velocity": VELOCITY[:3], "rates": VELOCITY[3:]}
MOVES: Array = np.full(6, 0.03)
"""Motion along or about an axis [m/s, rad/s] that contradicts a constant velocity."""
ABOVE_NOISE = 5.0
"""Minimum ratio of such motion to the noise of the pose."""


@dataclass(frozen=True)
class AxisFaults:
    """Mislabelled columns of a raw table, and their true meaning.

    Attributes:
        follows: Map with the meaning of the columns that the data show.
        wrong: Faults, one of each kind, with advice how to import the log.
    """

    follows: LogMap
    wrong: tuple[Fault, ...]

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The faults with messages for a corrected table, which say that the correction is assumed."""
        return tuple(
            replace(one, message=f"{one.message}; all else here is reported as if it were so")
            for one in self.wrong
        )

    def put_right(self, raw: pl.DataFrame) -> pl.DataFrame:
        """Return a copy of a raw table with values corrected, so that the columns' names are right."""
        return read_as(raw, self.follows)


def axis_faults(raw: pl.DataFrame, record: Recording) -> AxisFaults | None:
    """Return the mislabelled columns of a raw table, found by kinematics; None if there are none.

    A quantity of pose or velocity without samples in some session is not tested.

    Args:
        raw: Raw table.
        record: The table as arrays.

    Raises:
        DataError: A velocity is constant although the vehicle moves along its axis, or one of several columns
            is wrong and the recording does not show which.
    """
    logs = [_session(part) for part in raw.partition_by("session", maintain_order=True)]
    times = [log.t for log in logs]
    taken, called = windows(times, record.dt), _sampled(logs)
    if sum(map(len, taken)) < LEAST_WINDOWS:
        return None
    still = np.flatnonzero((np.ptp(record.nu, axis=0) == 0.0) & _judged(called))
    if still.size:
        _require_measured(still, Evidence(logs, taken), called, record)
    follows = check(logs, times, record.dt, called).follows
    if follows == called:
        return None
    evidence = Evidence(logs, taken)
    changes = difference(called, follows)
    if len(changes) == 1:  # with several changes the others decide
        follows = _only(evidence, called, follows)
        changes = difference(called, follows)
    return AxisFaults(follows, tuple(_fault(evidence, called, follows, change) for change in changes))


def _sampled(logs: Sequence[SessionLog]) -> LogMap:
    """Return the map of a raw table, without blocks that lack samples in some session."""
    least = {name: min(len(log.channel(name).t) for log in logs) for name in (*POSE, *VELOCITY)}
    lacking = [block for block, names in COLUMNS.items() if not all(least[name] for name in names)]
    called = _without(AS_CALLED, lacking)
    if "position" in lacking and least[POSE[2]]:
        return msgspec.structs.replace(called, position=Position(depth=POSE[2]))
    return called


def _judged(called: LogMap) -> Mask:
    """Return which of the six velocities can be tested against a sampled pose, (6,)."""
    whole = testable(called)
    return np.concatenate([np.full(3, whole[:3].all()), whole[3:]])


def read_as(raw: pl.DataFrame, given: LogMap) -> pl.DataFrame:
    """Return a copy of a raw table, converted to NED, FRD and SI from the true meaning of its columns.

    Args:
        raw: Raw table; it is not changed.
        given: Map with the true meaning; quantities that it lacks stay unchanged.
    """
    called = _without(AS_CALLED, [name for name in BLOCKS if getattr(given, name) is None])
    changed = {change.block for change in difference(called, given)}
    names = [name for block in sorted(changed) for name in COLUMNS[block]]
    parts = []
    for part in raw.partition_by("session", maintain_order=True):
        log = _session(part)
        read = dict(zip((*POSE, *VELOCITY), motion(log, log.t, given).T, strict=True))
        columns = [
            pl.when(part[name].is_not_null()).then(pl.Series(read[name])).alias(name) for name in names
        ]
        parts.append(part.with_columns(columns))
    return pl.concat(parts)


def _without(given: LogMap, names: Sequence[str]) -> LogMap:
    return msgspec.structs.replace(given, **dict.fromkeys(names))


def _session(part: pl.DataFrame) -> SessionLog:
    """Return the rows of one session as a log."""
    columns = {name: part[name].cast(pl.Float64).to_numpy() for name in (*POSE, *VELOCITY)}
    return SessionLog(str(part["session"][0]), part["t"].cast(pl.Float64).to_numpy(), columns)


def _require_measured(still: Rows, evidence: Evidence, called: LogMap, record: Recording) -> None:
    """Refuse constant velocities where the pose shows motion along or about their axes.

    Args:
        still: Numbers of the constant velocities, from 0 to 5.
        evidence: Windows of the log.
        called: Map of the raw table.
        record: The table as arrays.

    Raises:
        DataError: The pose shows motion along such an axis.
    """
    moves = np.zeros(6)
    if called.attitude is not None:
        moves[3:] = np.std(evidence.turning(called.attitude), axis=0)
        if called.position is not None:
            middle = evidence.attitude(called.attitude)[:, evidence.t.shape[1] // 2]
            moves[:3] = np.std(np.einsum("wij,wi->wj", middle, evidence.travel(called.position)), axis=0)
    pose = noise(record)[:6]
    least = np.repeat([pose[:3].max(), pose[3:].max()], 3) * np.sqrt(2.0) / evidence.length
    for axis in still:
        if moves[axis] > max(MOVES[axis], ABOVE_NOISE * least[axis]):
            name, unit = VELOCITY[axis], "m/s" if axis < 3 else "rad/s"
            raise DataError(
                f"{name} is {record.nu[0, axis]:g} {unit} in every row, while the pose changes along that "
                f"axis by {moves[axis]:.2g} {unit}: it was not measured, or another column was taken for it; "
                f"import the log with the column of {name}"
            )


def _only(evidence: Evidence, called: LogMap, found: LogMap) -> LogMap:
    """Return the only reading that explains the motion.

    If two readings explain it, such as z or w reversed of a level vehicle, the one under water is returned.

    Args:
        evidence: Windows of the log.
        called: Map of the raw table.
        found: Map with one change that the data follow.

    Raises:
        DataError: Several readings remain that depth does not separate.
    """
    options = [found, *rivals(evidence, called, found)]
    dry = [evidence.above_water(option.position) > MOSTLY for option in options]
    wet = [option for option, above in zip(options, dry, strict=True) if not above]
    if (len(wet) == 1 and len(wet) < len(options)) or len(options) == 1:
        return (wet or options)[0]
    changes = [difference(called, option)[0] for option in options]
    claims = ", or ".join(change.claim(called) for change in changes)
    advice = ", or ".join(change.advice(called) for change in changes)
    raise DataError(
        f"the velocities contradict the pose: {claims}; the recording does not show which: import it with "
        f"the right one ({advice})"
    )


def _fault(evidence: Evidence, called: LogMap, follows: LogMap, change: Change) -> Fault:
    """Return the fault of one column or block: its meaning, the evidence, and advice for the import."""
    message = f"{contradiction(evidence, called, follows, change)} when importing the log"
    return Fault(change.columns(called), message)
