"""Preparation of log samples: valid, new, at the time of measurement, and at the body origin."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import msgspec
import numpy as np

from hydro.core.columns import Array, Mask, Rows
from hydro.core.errors import DataError
from hydro.core.logs.clocks import bunched, evened
from hydro.core.logs.conventions import UNITS, SessionLog
from hydro.core.logs.geodesy import EAST, NORTH, metres
from hydro.core.logs.logmap import (
    Commands,
    LogMap,
    Rates,
    Sensor,
    Valid,
    columns_of,
    command,
    conditions,
    named,
    sensors_of,
)
from hydro.core.logs.missing_marks import refuse_marks
from hydro.core.logs.mounting import DERIVED, derived_rates, mounted_rates, mounted_velocity
from hydro.core.logs.stops import never, rest, stops

REPEATS = 0.1
"""Share of repeated readings of a velocity above which repeats are dropped."""
SAME = 1e-9  # relative


@dataclass(frozen=True)
class Prepared:
    """Sessions with prepared samples, and a record of the changes.

    Attributes:
        logs: Sessions with prepared samples.
        meaning: Map of these sessions: the log's map, with columns for rates that were derived from the
            attitude.
        notes: One line for each change.
        gated: For each session, the times of all readings of a block [s], by block, if readings were dropped
            as invalid or repeated.  A dropped reading is not a gap of the log.
    """

    logs: tuple[SessionLog, ...]
    meaning: LogMap
    notes: tuple[str, ...]
    gated: tuple[Mapping[str, Array], ...]


@dataclass
class _Work:
    """Session under preparation.

    Attributes:
        log: Session as logged.
        columns: Columns, changed so far.
        clocks: Times of columns with a clock of their own, changed so far [s].
        gated: Rows, later times [s], of all readings of blocks that lost some, by block.
        lost: Number of invalid samples, by block.
        repeats: Number of readings that repeat the last one, by block.
        even: Period and largest delay of a block whose receive times were evened [s], by block.
        stops: Rows of each command column that stop its thruster.
    """

    log: SessionLog
    columns: MutableMapping[str, Array]
    clocks: MutableMapping[str, Array]
    gated: dict[str, Array] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    repeats: dict[str, int] = field(default_factory=dict)
    even: dict[str, tuple[float, float]] = field(default_factory=dict)
    stops: dict[str, Mask] = field(default_factory=dict)

    def now(self) -> SessionLog:
        return replace(self.log, columns=self.columns, clocks=self.clocks)


def prepared(logs: Sequence[SessionLog], meaning: LogMap) -> Prepared:
    """Return new sessions with the samples that a map selects and corrects, at the time of measurement.

    The map's settings on validity, divisors, repeated readings, time stamps and mounts are applied.

    Args:
        logs: The sessions, as logged.
        meaning: The map of their columns.

    Raises:
        DataError: A column has two clocks, a topic declared as even is not periodic, a lever arm has no
            rates, or a sensor's samples contain a mark of missing values.
    """
    _check_shared(meaning)
    works = [_Work(log, _over(log.columns), _over(log.clocks)) for log in logs]
    for name, block in sensors_of(meaning).items():
        names = columns_of(block)
        if not names:
            continue
        for work in works:
            _gate(work, name, block, names)
            if isinstance(block, Commands):
                _stop(work, block)
        if not isinstance(block, Commands):
            refuse_marks(name, [work.columns for work in works], names)
        if getattr(block, "held", False) is not False:
            _unheld(works, name, names, demanded=block.held is True)  # type: ignore[union-attr]
        for work in works:
            _stamp(work, name, block, names)
    given, placed = _located(works, _mounted(works, meaning))
    return Prepared(
        logs=tuple(work.now() for work in works),
        meaning=given,
        notes=(*_notes(works, meaning), *placed),
        gated=tuple(work.gated for work in works),
    )


def _over(logged: Mapping[str, Array]) -> MutableMapping[str, Array]:
    """Return a writable overlay of the logged columns, which stay unchanged."""
    return ChainMap({}, cast("MutableMapping[str, Array]", logged))


def _check_shared(meaning: LogMap) -> None:
    """Refuse a column that two sensors use with different options for its samples.

    Raises:
        DataError: The options differ.
    """
    said: dict[str, tuple[str, tuple[object, ...]]] = {}
    for where, block in sensors_of(meaning).items():
        own = (block.valid, block.per, block.lag, block.even, getattr(block, "mount", None))
        for name in columns_of(block):
            other, theirs = said.setdefault(name, (where, own))
            if theirs != own:
                raise DataError(
                    f"column {name} is of {other} and of {where}, which say different things of its samples "
                    "(valid, per, lag, even, mount): say the same in both"
                )


def _gate(work: _Work, name: str, block: Sensor, names: Sequence[str]) -> None:
    """Empty the cells of invalid samples, and divide samples by the block's column `per`.

    Args:
        work: Session, which is changed.
        name: Name of the block.
        block: Block of the map.
        names: Columns of the block.
    """
    if block.valid != ():
        there = np.isfinite(np.stack([work.columns[each] for each in names])).any(axis=0)
        good = np.ones(len(work.log.time_of(names[0])), bool)
        for one in conditions(block.valid):
            good &= _holds(work.log, one, names)
        if (there & ~good).any():
            work.lost[name] = int((there & ~good).sum())
            work.gated[name] = np.flatnonzero(there).astype(float)
        for each in names:
            work.columns[each] = np.where(good, work.columns[each], np.nan)
    if block.per is not None:
        divisor = named(block.per)
        by = divisor.scale * work.log.columns[divisor.column] + divisor.offset
        by = _latest(by)
        for each in dict.fromkeys(names):
            quotient = np.divide(work.columns[each], by, out=np.full(len(by), np.nan), where=by != 0.0)
            work.columns[each] = quotient


def _stop(work: _Work, block: Commands) -> None:
    """Set zero thrust where a command turns its thruster off, unless the map excludes the sample.

    Args:
        work: Session, which is changed.
        block: Commands of the map.
    """
    for source in map(command, block.columns):
        name = source.column
        logged = work.log.columns[name]
        found = stops(work.log.time_of(name), logged, work.log.unset.get(name), source, block)
        found &= np.isfinite(work.columns[name]) | ~np.isfinite(logged)
        if found.any():
            work.stops[name] = found
            work.columns[name] = np.where(found, rest(source, block), work.columns[name])


def _holds(log: SessionLog, one: Valid, names: Sequence[str]) -> Mask:
    """Return in which of n rows a condition of the map holds, (n,).

    Args:
        log: Session as logged.
        one: Condition.
        names: Columns of the block, to which a condition without a column applies.
    """
    if one.column is not None:
        return _meets(_latest(log.columns[one.column]), one)
    held = [_meets(log.columns[each], one) | ~np.isfinite(log.columns[each]) for each in names]
    return np.asarray(np.logical_and.reduce(held))


def _meets(values: Array, one: Valid) -> Mask:
    with np.errstate(invalid="ignore"):
        good: Mask = np.isfinite(values)
        if one == Valid(one.column):
            good &= values != 0.0
        if one.equals is not None:
            good &= np.isclose(values, one.equals, rtol=SAME, atol=0.0)
        if one.differs is not None:
            good &= ~np.isclose(values, one.differs, rtol=SAME, atol=0.0)
        if one.above is not None:
            good &= values > one.above
        if one.below is not None:
            good &= values < one.below
    return good


def _latest(values: Array) -> Array:
    """Return the last number at or before each row; NaN before the first."""
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], np.nan)


def _unheld(works: Sequence[_Work], name: str, names: Sequence[str], *, demanded: bool) -> None:
    """Empty the cells of readings that repeat the last one, if there are many or the map demands it.

    Args:
        works: Sessions, which are changed.
        name: Name of the block.
        names: Columns of the block.
        demanded: Whether the map demands it (`held`).
    """
    found, readings, moving = [], 0, 0
    for work in works:
        values = np.stack([work.columns[each] for each in names], axis=1)
        rows = np.flatnonzero(np.isfinite(values).all(axis=1))
        same = np.r_[False, (np.diff(values[rows], axis=0) == 0.0).all(axis=1)][: len(rows)]
        same &= (values[rows] != 0.0).any(axis=1)
        found.append((rows, same))
        readings, moving = readings + len(rows), moving + int(same.sum())
    if not moving or not (demanded or moving > REPEATS * readings):
        return
    for work, (rows, same) in zip(works, found, strict=True):
        if same.any():
            work.repeats[name] = int(same.sum())
            work.gated.setdefault(name, rows.astype(float))
        for each in names:
            column = work.columns[each].copy()
            column[rows[same]] = np.nan
            work.columns[each] = column


def _stamp(work: _Work, name: str, block: Sensor, names: Sequence[str]) -> None:
    """Set the times of a block's samples: on an even clock if stamps are receive times, less the lag.

    Args:
        work: Session, which is changed.
        name: Name of the block.
        block: Block of the map.
        names: Columns of the block.

    Raises:
        DataError: The map declares an even clock that the stamps do not follow.
    """
    t = logged = work.log.time_of(names[0])
    said = [np.isfinite(work.log.columns[each]) | np.isfinite(work.columns[each]) for each in names]
    for rows in _together(said):
        if not (block.even or (block.even is None and bunched(t[rows]))):
            continue
        sent = evened(t[rows])
        if sent is not None:
            t = t.copy()
            t[rows] = sent.t
            work.even[name] = (sent.period, sent.latest)
        elif block.even:
            raise DataError(
                f"{name}.even: the stamps of session {work.log.name} are no receive times of a topic at even "
                "steps (messages lost, or not periodic); leave it out"
            )
    if block.lag or t is not logged:
        work.clocks.update(dict.fromkeys(names, t - block.lag))
    if name in work.gated:
        work.gated[name] = (t - block.lag)[work.gated[name].astype(int)]


def _together(there: Sequence[Mask]) -> list[Rows]:
    """Return the rows of each topic: columns that share a row belong to one topic."""
    topics: list[Mask] = []
    for one in there:
        shared = [each for each in topics if (each & one).any()]
        topics = [each for each in topics if not (each & one).any()]
        topics.append(np.logical_or.reduce([one, *shared]))
    return [np.flatnonzero(each) for each in topics]


def _mounted(works: Sequence[_Work], meaning: LogMap) -> LogMap:
    """Move readings of gyroscope and velocity sensor to the body origin and axes.

    Rates are derived from the attitude if the map demands it.

    Args:
        works: Sessions, which are changed.
        meaning: Map of the columns.

    Returns:
        The map that reads the changed columns.
    """
    rates, given = meaning.rates, meaning
    if rates is not None and rates.source == "attitude":
        given = msgspec.structs.replace(meaning, rates=Rates(DERIVED, lag=rates.lag))
        for work in works:
            _derive(work, meaning, rates)
    elif rates is not None and rates.mount is not None:
        for work in works:
            work.columns.update(mounted_rates(work.now(), rates))
    if meaning.velocity is not None and meaning.velocity.mount is not None:
        for work in works:
            work.columns.update(mounted_velocity(work.now(), meaning.velocity, given.rates, meaning.attitude))
    return given


def _located(works: Sequence[_Work], meaning: LogMap) -> tuple[LogMap, list[str]]:
    """Replace latitude and longitude by metres north and east of the first fix.

    Args:
        works: Sessions, which are changed.
        meaning: Map of the columns.

    Returns:
        The map that reads the new columns, and a note on the fix.
    """
    block = meaning.position
    if block is None or block.latitude is None or block.longitude is None:
        return meaning, []
    told = []
    for work in works:
        sources = named(block.latitude), named(block.longitude)
        degrees = [each.scale * work.columns[each.column] + each.offset for each in sources]
        clocks = [work.now().time_of(each.column) for each in sources]
        if np.array_equal(clocks[0], clocks[1]):
            none = (degrees[0] == 0.0) & (degrees[1] == 0.0)  # receivers write 0 without a fix
            degrees = [np.where(none, np.nan, each) for each in degrees]
        first = [float(each[np.isfinite(each)][0]) if np.isfinite(each).any() else np.nan for each in degrees]
        found = metres(degrees[0], degrees[1], (first[0], first[1]))
        for name, values, clock in zip((NORTH, EAST), found, clocks, strict=True):
            work.columns[name] = values / UNITS[block.unit]
            work.clocks[name] = clock
        told.append(f"{work.log.name} {first[0]:.7f}, {first[1]:.7f}")
    read = msgspec.structs.replace(block, columns=(NORTH, EAST), latitude=None, longitude=None)
    note = f"position: north and east of the first fix [deg] of {'; '.join(told[:4])}"
    return msgspec.structs.replace(meaning, position=read), [note]


def _derive(work: _Work, meaning: LogMap, rates: Rates) -> None:
    """Add rates from the attitude as columns with a clock of their own."""
    assert meaning.attitude is not None
    t, values = derived_rates(work.now(), meaning.attitude, rates.window)
    for name, part in zip(DERIVED, values.T, strict=True):
        work.columns[name] = part
        work.clocks[name] = t


def _notes(works: Sequence[_Work], meaning: LogMap) -> list[str]:
    """Describe the changes."""
    lines = []
    if again := sum(work.log.repeated for work in works):
        lines.append(f"{again:,} rows repeat the row before with its time and are left out")
    for name, block in sensors_of(meaning).items():
        if lost := sum(work.lost.get(name, 0) for work in works):
            lines.append(f"{name}: {lost:,} samples are not valid by the map and left out")
        if held := sum(work.repeats.get(name, 0) for work in works):
            why = "" if getattr(block, "held", None) else f" ({name}.held = false keeps them)"
            lines.append(f"{name}: {held:,} readings only repeat the last one and are left out{why}")
        if even := [work.even[name] for work in works if name in work.even]:
            period = float(np.median([each for each, _ in even]))
            latest = max(each for _, each in even)
            keep = "" if block.even else f"; {name}.even = false keeps the stamps"
            lines.append(
                f"{name}: received in bursts; put on an even clock of {1.0 / period:.4g} Hz below the times "
                f"of receipt, which are up to {latest:.2g} s later{keep}"
            )
    lines += _stop_notes(works, meaning.commands)
    if meaning.rates is not None and meaning.rates.source == "attitude":
        lines.append(
            "rates: derived from the attitude's samples, not measured: they say nothing of their own"
        )
    return lines


def _stop_notes(works: Sequence[_Work], block: Commands) -> list[str]:
    """Return notes on commands that turn a thruster off, and on thrusters that are never used."""
    names = [command(source).column for source in block.columns]
    idle = None
    for work in works:
        nothing = np.zeros(len(work.log.time_of(names[0])), bool)
        found = {}
        for name in names:
            logged = work.log.columns[name]
            found[name] = (
                logged,
                work.stops.get(name, nothing if len(nothing) == len(logged) else logged > np.inf),
            )
        own = set(never(found))
        idle = own if idle is None else idle & own
    lines = []
    if idle:
        listed = [name for name in names if name in idle]
        lines.append(
            f"commands: {', '.join(listed)} never drive a thruster (NaN or a pulse width of 0 in every row): "
            "leave them out of commands.columns if the vehicle has fewer thrusters"
        )
    counts = [
        int(work.stops[name].sum())
        for work in works
        for name in names
        if name in work.stops and name not in (idle or ())
    ]
    if counts:
        lines.append(
            f"commands: {sum(counts):,} samples of NaN or a pulse width of 0 are no thrust, as of a "
            'disarmed autopilot (commands.off = "hold" holds the thrust before them)'
        )
    return lines
