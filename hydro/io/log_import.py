"""Import of a log with its map as a raw table, with a report: the core of `hydro import`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl
import polars.selectors as cs

from hydro.core.cleaning.readiness import ran
from hydro.core.columns import COMMAND, MOTION
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.errors import DataError
from hydro.core.guessing.aliases import guess
from hydro.core.guessing.refining import refined
from hydro.core.logs.convention_check import Verdict, check
from hydro.core.logs.importing import Imported, raw_table
from hydro.core.logs.logmap import Attitude, Block, LogMap, Position, blocks_of, command, measured, named
from hydro.core.vehicle.description import Vehicle
from hydro.io import logmap
from hydro.io.clock_report import Clocks, clocks
from hydro.io.log import Log, values
from hydro.io.readers.tables import Tables
from hydro.io.sessions import sessions


@dataclass(frozen=True)
class ImportReport:
    """Raw table of a log, with the results of its checks.

    Attributes:
        map: Map of the columns.
        imported: Raw table, its sessions, sample time [s], gaps and clipped commands.
        verdict: Result of the kinematic check of the map's frames, units and signs.
        clocks: Lags of the sensors relative to the pose, and of the motion relative to the commands.
        cuts: Description of each session that starts because the log's clock jumped.
    """

    map: LogMap
    imported: Imported
    verdict: Verdict
    clocks: Clocks
    cuts: tuple[str, ...] = ()

    def lines(self) -> Iterator[str]:
        """Yield the report line by line: rows, gaps, warnings, and the check of frames, units and signs."""
        yield from (f"note: {line}" for line in self.cuts)
        yield from _size_lines(self.imported)
        yield from _verdict_lines(self.verdict)
        yield from self.clocks.lines()


def declared(file: str | Path | LogMap, name: str) -> LogMap:
    """Return the user's map of a log, checked and with a session name.

    Args:
        file: Map, or path of a map file.
        name: Session name to use if the map has none.

    Raises:
        DataError: The file or the map breaks a rule of maps.
    """
    if not isinstance(file, LogMap):
        return _with_session(logmap.read(file), name)
    logmap.check(file)
    return _with_session(file, name)


def guessed(
    source: Log, name: str, preset: str | None = None, thrusters: int | None = None
) -> tuple[dict[str, dict[str, Any]], LogMap]:
    """Return the map of a log, guessed from the names of its columns.

    Args:
        source: The log.
        name: Session name to use if the map has none.
        preset: Naming scheme of the columns; by default any.
        thrusters: Number of thrusters of the vehicle, if known.

    Returns:
        The guessed blocks by name, such as `velocity`, each with its keys and values; and the map made of
        them.

    Raises:
        DataError: The names do not suffice for a guess.
    """
    names = source.table.columns
    try:
        blocks = guess(names, source.texts(), preset, thrusters)
        plain = {
            name: {key: block[key] for key in block if key != "pressure"} for name, block in blocks.items()
        }
        return blocks, _with_session(logmap.from_guess(plain, names), name)
    except DataError as error:
        raise DataError(f"{source.name}: {error}") from error


def refined_map(source: Log, blocks: Mapping[str, dict[str, Any]], name: str) -> tuple[LogMap, list[str]]:
    """Return a map whose guessed blocks are corrected by the log's values, and one line for each correction.

    Args:
        source: The log.
        blocks: Guessed blocks by name.
        name: Session name to use if the map has none.

    Raises:
        DataError: The remaining blocks do not suffice.
    """
    found, notes = refined(blocks, lambda column: values(source, column))
    try:
        return _with_session(logmap.from_guess(found, source.table.columns), name), notes
    except DataError as error:
        raise DataError(f"{source.name}: {error}") from error


def _with_session(meaning: LogMap, name: str) -> LogMap:
    """Return a map whose session is called `name` if the map states none."""
    if meaning.session.column is None and meaning.session.name is None:
        session = msgspec.structs.replace(meaning.session, name=name)
        meaning = msgspec.structs.replace(meaning, session=session)
    return meaning


def import_log(
    source: Log, meaning: LogMap, *, rate: float | None = None, strict: bool = False, fill: bool = False
) -> ImportReport:
    """Convert a log to a raw table on one clock, and check its frames, units and signs by kinematics.

    Args:
        source: The log.
        meaning: Map of its columns.
        rate: Rows per second [Hz]; by default the median rate of the channels, or the rate of the fastest
            channel if that is clearly higher, but at most 50.
        strict: Refuse a log whose motion contradicts the map.
        fill: Interpolate between the samples of a slow sensor instead of leaving nulls.

    Returns:
        The raw table with the results of the checks.

    Raises:
        DataError: A column is missing or not numeric, time goes backwards, or, with `strict`, the motion
            contradicts the map.
    """
    logs = sessions(source, meaning)
    try:
        imported = raw_table(logs, meaning, rate, fill=fill)
    except DataError as error:
        raise DataError(f"{source.name}: {error}") from error
    as_measured = imported.meaning
    if meaning.rates is not None and meaning.rates.source == "attitude":
        as_measured = msgspec.structs.replace(as_measured, rates=None)
    verdict = check(imported.logs, imported.times, imported.dt, as_measured)
    travel = source.table.travel() if isinstance(source.table, Tables) else {}
    offsets = clocks(imported, verdict.follows, meaning, travel)
    against = [*verdict.contradictions, *offsets.contradictions()]
    if strict and against:
        more = f" (and {len(against) - 1} more: see without --strict)" if len(against) > 1 else ""
        raise DataError(f"{source.name}: {against[0]}{more}")
    cuts = tuple(f"session {log.name} begins where {log.cut}" for log in logs if log.cut)
    return ImportReport(meaning, imported, verdict, offsets, cuts)


def audited(report: ImportReport, vehicle: Vehicle, file: str) -> Iterator[str]:
    """Yield one line for each fault or limit that the thruster audit (test of direction and order) finds.

    A wrong frame of a sensor looks like reversed or swapped thrusters.  So nothing is audited before the map
    agrees with the motion.

    Args:
        report: Import of the log.
        vehicle: Vehicle with as many thrusters as there are commands.
        file: Name of the vehicle file.
    """
    if report.verdict.contradictions:
        yield "note: the thrusters are not audited: first correct the map as the warnings say"
        return
    try:
        found = preprocess(vehicle, report.imported.frame).audit
    except DataError as error:
        yield f"note: the thrusters are not audited: {error}"
        return
    if found is None:
        return
    mixed = report.map.mixer is not None
    sources = None if mixed else [command(one).column for one in report.map.commands.columns]
    contradictions = list(found.statements(file, sources))
    for line in found.lines(file, sources):
        yield f"{'warning' if line in contradictions else 'note'}: {line}"


def described(meaning: LogMap) -> Iterator[str]:
    """Yield a line of text for each block of a map: its columns, frames and units."""
    yield f"time {meaning.time.column} [{meaning.time.unit}]"
    if meaning.session.column is not None:
        yield f"session {meaning.session.column}"
    for name, block in blocks_of(meaning).items():
        columns = " ".join(source.column for source in measured(block))
        yield f"{name} {columns} [{_settings(block)}]"
    columns = " ".join(command(source).column for source in meaning.commands.columns)
    yield f"commands {columns} [{meaning.commands.unit}]"
    if meaning.voltage is not None:
        yield f"voltage {named(meaning.voltage.column).column} [{meaning.voltage.unit}]"


def _settings(block: Block) -> str:
    """Return frames and units of a block as text."""
    match block:
        case Position():
            return f"{block.world}, {block.unit}"
        case Attitude():
            return f"{block.body} in {block.world}, {block.layout if block.quaternion else block.unit}"
        case _:
            return f"{block.frame}, {block.unit}"


def _size_lines(imported: Imported) -> Iterator[str]:
    """Yield lines with the number of rows, the missing sensors and the gaps."""
    sessions, rate = len(imported.logs), 1.0 / imported.dt
    yield (
        f"{imported.frame.height:,} rows at {rate:g} Hz in {sessions} session{'s' if sessions > 1 else ''}"
    )
    frame = imported.frame
    rare = {name: frame.height - frame[name].null_count() for name in MOTION if frame[name].null_count()}
    if none := [name for name, count in rare.items() if not count]:
        yield f"no sensor, null in every row: {', '.join(none)}"
    if rare := {name: count for name, count in rare.items() if count}:
        counts = ", ".join(f"{name} {count:,}" for name, count in rare.items())
        yield f"slower sensors, null between their samples (--fill interpolates): {counts}"
    yield from imported.notes
    if imported.gaps:
        longest = max(imported.gaps, key=lambda gap: gap.stop - gap.start)
        total = sum(gap.stop - gap.start for gap in imported.gaps)
        yield (
            f"gaps left open: {len(imported.gaps)}, {total:.3g} s in all; the longest, "
            f"{longest.stop - longest.start:.3g} s, after {longest.start:.5g} s of {longest.session}"
        )
    if imported.left_out:
        yield f"left out, because no two rows have all columns: {', '.join(imported.left_out)}"
    for name, count in imported.clipped.items():
        yield f"warning: {name} is beyond -1 to 1 in {count:,} rows and clipped: check commands.unit and pwm"
    yield from _command_lines(frame)


def _command_lines(frame: pl.DataFrame) -> Iterator[str]:
    """Yield a note if the commands of a raw table cannot show what the thrusters do."""
    commands = frame.select(cs.starts_with(COMMAND)).cast(pl.Float64).to_numpy()
    if not ran(commands):
        yield (
            "note: no thruster ran, so the log shows nothing about thrust: check commands.columns and "
            "commands.unit if the vehicle was under way"
        )
    elif commands.shape[1] and len(commands) > 1 and not np.ptp(commands, axis=0).any():
        yield (
            "note: no command changes, so thrust cannot be told from a steady load: check commands.columns "
            "if the vehicle was steered"
        )


def _verdict_lines(verdict: Verdict) -> Iterator[str]:
    """Yield lines with the results of the kinematic check."""
    yield from (f"warning: {line}" for line in verdict.contradictions)
    names = (("d(position)/dt", "m/s"), ("the attitude's rate", "rad/s"))
    tested = [
        f"{name} to {error:.2g} {unit}"
        for (name, unit), error, wrong in zip(names, verdict.agreement, verdict.disagree, strict=True)
        if not math.isnan(error) and not wrong
    ]
    if tested and not verdict.contradictions:
        yield f"pose and velocity agree: {', '.join(tested)}"
    yield from (f"note: {line}" for line in verdict.notes)
