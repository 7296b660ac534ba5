"""Conversion of a log and its map to a raw table: one clock, gaps left open, in NED, FRD and SI."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from hydro.core.columns import MOTION, VOLTAGE, Array, Mask, command_column, command_columns
from hydro.core.errors import DataError
from hydro.core.logs import conventions
from hydro.core.logs.clocks import require_plausible
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.logmap import (
    BLOCKS,
    Block,
    LogMap,
    Velocity,
    blocks_of,
    command,
    measured,
    named,
    stretches,
)
from hydro.core.logs.resample import Channel, channel, common, rows, sample_time, spans
from hydro.core.logs.samples import prepared
from hydro.core.recording import extent
from hydro.core.recording.segments import GAP
from hydro.core.vehicle.frames import euler_from_rotation


@dataclass(frozen=True)
class Gap:
    """Missing rows within a session.

    Attributes:
        session: Name of the session.
        start: Time of the last row before the gap [s].
        stop: Time of the first row after the gap [s].
    """

    session: str
    start: float
    stop: float


@dataclass(frozen=True)
class Imported:
    """Result of an import.

    Attributes:
        frame: The raw table.
        meaning: The map that reads `logs`: the declared map, with columns for rates that were derived from
            the attitude.
        logs: The sessions that have rows.  Samples have their own times, and are converted to the body
            origin.
        times: Times of each session at which all channels have values, on a grid of `dt` [s].
        dt: Sample time [s].
        gaps: Missing rows within sessions.
        left_out: Sessions with fewer than two rows on which all channels have values.
        clipped: Number of commands beyond [-1, 1], by thruster.
        notes: Changes of the samples before the import, a line each.
    """

    frame: pl.DataFrame
    meaning: LogMap
    logs: tuple[SessionLog, ...]
    times: tuple[Array, ...]
    dt: float
    gaps: tuple[Gap, ...]
    left_out: tuple[str, ...]
    clipped: dict[str, int]
    notes: tuple[str, ...] = ()


ROUNDED = 1e-6  # rounding tolerance in sample times
PIECES, LEAST_ROWS = 16, 50_000
"""Maximum number of pieces and minimum rows of a piece in resampling; pieces limit the memory of rotations.
"""
FASTEST_ROWS = 50.0
"""Most rows per second unless a rate is given [Hz], the rate of the reference data.  Motion and thrust of an
underwater vehicle change below 10 Hz; more rows only cost time in every fit."""
SLOWER = 1.5
"""Ratio of a channel's step to the sample time above which rows between its samples are empty."""


def raw_table(
    logs: Sequence[SessionLog], meaning: LogMap, rate: float | None = None, *, fill: bool = False
) -> Imported:
    """Convert a log to a raw table: resample it to one clock, and convert frames and units.

    Pose and velocity are interpolated linearly, each channel between its own samples.  Commands are held.
    There are no rows where a channel is silent for longer than its longest step.  A sensor slower than the
    rows has values only in the rows nearest to its samples, interpolated to them; other rows are null.

    Args:
        logs: The sessions of the log.
        meaning: The map of its columns.
        rate: Rows per second [Hz]; by default the median of the channels' rates, or the fastest rate if it is
            clearly faster (with `fill` always the median), but at most FASTEST_ROWS.
        fill: Whether to interpolate a value in every row.

    Returns:
        The raw table, with gaps, notes and prepared sessions.

    Raises:
        DataError: A column has no numbers, no session has all channels at one time, or a command cannot be a
            share of full thrust.
    """
    samples = prepared(logs, meaning)
    logs, meaning = samples.logs, samples.meaning
    steps = _steps(logs, meaning)
    _check_voltage(logs, meaning)
    require_plausible(min(steps), meaning.time)
    if rate is not None:
        extent.require_rate(rate, min(steps))
    dt = 1.0 / rate if rate is not None else sample_time(steps)
    if rate is None and not fill and min(steps) * SLOWER <= dt:
        dt = sample_time([min(steps)])
    notes = samples.notes
    if rate is None and dt * FASTEST_ROWS < 1.0 - ROUNDED:
        notes = (*notes, f"{1.0 / dt:.4g} samples/s resampled to {FASTEST_ROWS:g} rows/s; --rate keeps more")
        dt = 1.0 / FASTEST_ROWS
    extent.require_rows(sum(float(log.t[-1] - log.t[0]) for log in logs if len(log.t)) / dt)
    parts = []
    for log, gated in zip(logs, samples.gated, strict=True):
        t = rows(_shared(log, meaning, {} if fill else gated), dt)
        whole = rows(_shared(log, meaning, {}), dt) if gated else t
        parts.append((log, t, whole, gated))
    full = [(log, t, whole, gated) for log, t, whole, gated in parts if len(t)]
    if not full:
        raise DataError(
            "in no session do all columns have values at the same time; compare the times at which each "
            "column begins and ends, or raise time.longest_step"
        )
    tables = [_part(log, t, meaning, dt, fill, gated) for log, t, _, gated in full]
    clipped = np.sum([beyond for _, beyond in tables], axis=0)
    return Imported(
        frame=pl.concat([part for part, _ in tables]),
        meaning=meaning,
        logs=tuple(log for log, *_ in full),
        times=tuple(whole for _, _, whole, _ in full),
        dt=dt,
        gaps=tuple(gap for log, t, *_ in full for gap in _gaps(log.name, t, dt)),
        left_out=tuple(log.name for log, t, *_ in parts if not len(t)),
        clipped={command_column(i): int(count) for i, count in enumerate(clipped) if count},
        notes=notes,
    )


def _steps(logs: Sequence[SessionLog], meaning: LogMap) -> list[float]:
    """Return the median step of every channel of pose and velocity in every session [s].

    Raises:
        DataError: A column has no numbers.
    """
    steps = []
    for source in (source for block in blocks_of(meaning).values() for source in measured(block)):
        channels = [log.channel(source) for log in logs]
        if not any(len(each.t) for each in channels):
            raise DataError(
                f"column {source.column} has no number in any row; name another column in the map"
            )
        steps += [each.step for each in channels]
    return steps


def _check_voltage(logs: Sequence[SessionLog], meaning: LogMap) -> None:
    """Refuse a supply voltage column without numbers."""
    if meaning.voltage is not None:
        source = named(meaning.voltage.column)
        if not any(len(log.channel(source).t) for log in logs):
            raise DataError(
                f"column {source.column}, the supply voltage, has no number in any row; "
                "name another column in the map, or leave [voltage] out"
            )


def _shared(log: SessionLog, meaning: LogMap, gated: Mapping[str, Array]) -> Array:
    """Return the spans of a session from which rows are made, (k, 2) [s].

    In a span all channels have data, all thrusters have commands, and the map uses the session.  A sensor
    that lost samples as invalid or as repeats has data wherever it sent readings.

    Args:
        log: Session with prepared samples.
        meaning: Map of the columns.
        gated: Times of all readings of sensors that lost some, by block, see `samples.Prepared`.
    """
    longest = meaning.time.longest_step
    found = []
    for name, block in blocks_of(meaning).items():
        for source in measured(block):
            each = log.channel(source)
            if name in gated and len(each.t):
                each = channel(gated[name], np.zeros(len(gated[name])))
            found.append(spans(each, longest))
    for source in map(command, meaning.commands.columns):
        given = log.channel(source).t
        found.append(np.array([[given[0], np.inf]]) if len(given) else np.empty((0, 2)))
    if (used := _used(log.name, meaning)) is not None:
        found.append(used)
    return common(found)


def _used(session: str, meaning: LogMap) -> Array | None:
    """Return the parts of a session that the map uses, (k, 2) [s]; None if it uses all of it."""
    every = stretches(meaning)
    own = [one for one in every if one.session == session] or [one for one in every if one.session is None]
    limits = [(one.start, np.inf if one.stop is None else one.stop) for one in own]
    return np.array(limits) if limits else None


def _part(
    log: SessionLog, t: Array, meaning: LogMap, dt: float, fill: bool, gated: Mapping[str, Array]
) -> tuple[pl.DataFrame, NDArray[np.int64]]:
    """Return the rows of one session, and the number of clipped commands of each thruster.

    Args:
        log: Session with prepared samples.
        t: Times of the N rows [s], (N,).
        meaning: Map of the columns.
        dt: Sample time [s].
        fill: Whether to interpolate a value in every row.
        gated: Times of all readings of sensors that lost some, by block, see `samples.Prepared`.
    """
    conventions.require_shares(log, meaning.commands, t, dt)
    seen = None if fill else _sampled(log, t, meaning, dt) & _heard(log, t, meaning, gated)
    size = max(LEAST_ROWS, -(-len(t) // PIECES))
    pieces = [slice(start, start + size) for start in range(0, len(t), size)]
    tables = [_rows(log, t[rows], meaning, dt, None if seen is None else seen[rows]) for rows in pieces]
    return pl.concat([part for part, _ in tables]), np.sum([beyond for _, beyond in tables], axis=0)


def _rows(
    log: SessionLog, t: Array, meaning: LogMap, dt: float, seen: Mask | None
) -> tuple[pl.DataFrame, NDArray[np.int64]]:
    """Return some rows of a session, and the number of clipped commands of each thruster.

    Args:
        log: Session with prepared samples.
        t: Times of the N rows [s], (N,).
        meaning: Map of the columns.
        dt: Sample time [s].
        seen: Which values have a sample, (N, 12); others are null.  None to interpolate all.
    """
    table = pl.DataFrame(motion(log, t, meaning), schema=[*MOTION]).fill_nan(None)
    drive, beyond = conventions.commands(log, meaning.commands, t, dt, meaning.mixer)
    head = pl.DataFrame({"session": pl.repeat(log.name, len(t), eager=True), "t": t})
    drives = pl.DataFrame(drive, schema=command_columns(drive.shape[1]))
    if seen is not None:
        there = zip(MOTION, seen.T, strict=True)
        table = table.with_columns(
            pl.when(pl.Series(each)).then(name).alias(name) for name, each in there if not each.all()
        )
    wide = [table, drives]
    if meaning.voltage is not None:
        volts = conventions.voltage(log, meaning.voltage, t, dt)
        wide.append(pl.DataFrame({VOLTAGE: volts}).fill_nan(None))
    return pl.concat([head, *wide], how="horizontal"), beyond.sum(axis=0)


def _heard(log: SessionLog, t: Array, meaning: LogMap, gated: Mapping[str, Array]) -> Mask:
    """Return which of N rows are within the spans of each sensor's valid samples, (N, 12).

    Args:
        log: Session with prepared samples.
        t: Times of the rows [s], (N,).
        meaning: Map of the columns.
        gated: Times of all readings of sensors that lost some, by block, see `samples.Prepared`.
    """
    out = np.ones((len(t), len(MOTION)), bool)
    for name, block in blocks_of(meaning).items():
        if name not in gated:
            continue
        edges = common([spans(log.channel(one), meaning.time.longest_step) for one in measured(block)])
        latest = np.searchsorted(edges[:, 0] - ROUNDED, t, side="right") - 1
        within = (latest >= 0) & (t <= np.r_[edges[:, 1], -np.inf][latest] + ROUNDED)
        out[:, 3 * BLOCKS.index(name) : 3 * BLOCKS.index(name) + 3] &= np.reshape(within, (-1, 1))
    turned = isinstance(meaning.velocity, Velocity) and meaning.velocity.frame not in conventions.BODIES
    if turned and "attitude" in gated:
        out[:, 6:9] &= out[:, 3:6]
    return out


def motion(log: SessionLog, t: Array, meaning: LogMap) -> Array:
    """Return pose and velocity of a log at N times, NED, FRD and SI, (N, 12).

    NaN in columns without a sensor.

    Args:
        log: Session of the log.
        t: Times [s], (N,).
        meaning: Map of the columns.
    """
    out, R = np.full((len(t), len(MOTION)), np.nan), np.tile(np.eye(3), (len(t), 1, 1))
    if (placed := meaning.position) is not None:
        first = 0 if placed.columns else 2
        out[:, first:3] = conventions.position(log, placed, t)[:, first:]
    if meaning.attitude is not None:
        R = conventions.attitude(log, meaning.attitude, t)
        out[:, 3:6] = euler_from_rotation(R)
    if meaning.velocity is not None:
        out[:, 6:9] = conventions.velocity(log, meaning.velocity, t, R)
    if meaning.rates is not None:
        out[:, 9:] = conventions.rates(log, meaning.rates, t)
    return out


def _sampled(log: SessionLog, t: Array, meaning: LogMap, dt: float) -> Mask:
    """Return in which of N rows each column of pose and velocity has a sample of its sensors, (N, 12)."""
    nothing = np.zeros(len(t), bool)

    def of(block: Block | None) -> list[Mask]:
        taken = () if block is None else measured(block)
        return [_nearest(log.channel(source), t, dt) for source in taken]

    place, whole = of(meaning.position), [of(meaning.attitude), of(meaning.velocity), of(meaning.rates)]
    level = place[0] & place[1] if len(place) > 1 else nothing
    down = place[-1] if place else nothing
    parts = [np.logical_and.reduce(each) if each else nothing for each in whole]
    return np.stack([level, level, down, *(part for part in parts for _ in range(3))], axis=1)


def _nearest(each: Channel, t: Array, dt: float) -> Mask:
    """Return which of N rows are nearest to a sample, (N,); all for a channel as fast as the rows.

    Args:
        each: Channel.
        t: Times of the rows [s], (N,).
        dt: Sample time [s].
    """
    if not each.step >= SLOWER * dt:
        return np.ones(len(t), bool)
    row = np.clip(np.searchsorted(t, each.t - 0.5 * dt), 0, len(t) - 1)
    near = np.abs(t[row] - each.t) <= (0.5 + ROUNDED) * dt
    out = np.zeros(len(t), bool)
    out[row[near]] = True
    return out


def _gaps(session: str, t: Array, dt: float) -> list[Gap]:
    return [Gap(session, float(t[k]), float(t[k + 1])) for k in np.flatnonzero(np.diff(t) > GAP * dt)]
