"""Proposed map of a log: guessed from names and values of its columns, corrected by its motion."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.guessing.aliases import Block
from hydro.core.guessing.interview import lacking
from hydro.core.guessing.map_lines import block_of
from hydro.core.guessing.presets import other_sources
from hydro.core.guessing.validity import validity
from hydro.core.logs.agreement import Evidence, windows
from hydro.core.logs.alternatives import difference
from hydro.core.logs.convention_check import check
from hydro.core.logs.importing import raw_table
from hydro.core.logs.logmap import LogMap, blocks_of, measured
from hydro.io import log_files, logmap
from hydro.io.log import Log, LogFile, values
from hydro.io.log_import import import_log
from hydro.io.sessions import sessions

IDENTITY = {"velocity": 0, "attitude": 1, "rates": 1}
"""Kinematic identity that tests each quantity: 0 of translation, 1 of rotation, see `core.logs.agreement`."""


@dataclass(frozen=True)
class Proposal:
    """Proposed map.

    Attributes:
        columns: All columns of the log.
        blocks: The blocks of the map that could be guessed.
        notes: Corrections of the guess, or why the motion could not be tested, a line each.
    """

    columns: list[str]
    blocks: dict[str, Block]
    notes: tuple[str, ...] = ()


def proposed(
    files: Sequence[LogFile],
    given: Mapping[str, str],
    progress: log_files.Progress = log_files.silent,
    thrusters: int | None = None,
) -> Proposal:
    """Return a proposed map for the files of one dive.

    Args:
        files: The files.
        given: Blocks that the user gives in their text form (`map_lines.block_of`), by name.
        progress: Reports the progress of reading a file.
        thrusters: Number of thrusters of the vehicle, if known.

    Returns:
        The columns, the blocks that could be guessed, and notes.  If a required block is missing, the guess
        is not corrected by the motion and has no notes.

    Raises:
        DataError: A file cannot be read, or the text of a block is invalid.
    """
    columns, blocks = log_files.drafted(files, progress, None, thrusters)
    for name, text in given.items():
        blocks.pop(name, None)
        if (block := block_of(name, text, columns)) is not None:
            blocks[name] = block
    if lacking(blocks):
        return Proposal(columns, blocks)
    blocks, chosen = _faster_sources(files, columns, blocks, progress)
    blocks, notes = corrected(files, columns, blocks, set(given), progress)
    return Proposal(columns, blocks, (*chosen, *notes))


def _faster_sources(
    files: Sequence[LogFile],
    columns: Sequence[str],
    blocks: Mapping[str, Block],
    progress: log_files.Progress,
) -> tuple[dict[str, Block], list[str]]:
    """Replace message types of a map by faster ones of the same quantity that agree better with the motion.

    Args:
        files: The files of one dive.
        columns: All columns of the log.
        blocks: Blocks of the map.
        progress: Reports the progress of reading a file.

    Returns:
        The blocks, and a line for each replacement.
    """
    found, notes = dict(blocks), list[str]()
    others = other_sources(columns, blocks)
    if not others:
        return found, notes
    best = _agreement(files, columns, found, progress)
    for quantity, block in others:
        other = _agreement(files, columns, {**found, quantity: block}, progress, quantity, best)
        if best is None or other is None:
            continue
        k = IDENTITY[quantity]
        if other.errors[k] < best.errors[k]:
            notes.append(
                f"{quantity}: {_sources(block)} has {1.0 / other.steps[quantity]:.3g} samples/s, "
                f"{_sources(found[quantity])} {1.0 / best.steps[quantity]:.3g}: the faster is used"
            )
            found[quantity], best = block, other
    return found, notes


@dataclass(frozen=True)
class _Agreement:
    """Agreement of the sensors of a map with each other.

    Attributes:
        errors: Root mean square residuals of two kinematic identities, (2,): translation [m/s], rotation
            [rad/s].
        steps: Median step of each sensor [s].
    """

    errors: Array
    steps: dict[str, float]


def _agreement(
    files: Sequence[LogFile],
    columns: Sequence[str],
    blocks: Mapping[str, Block],
    progress: log_files.Progress,
    quantity: str = "",
    least: _Agreement | None = None,
) -> _Agreement | None:
    """Return how well the sensors of a map agree with each other.

    Args:
        files: The files of one dive.
        columns: All columns of the log.
        blocks: Blocks of the map.
        progress: Reports the progress of reading a file.
        quantity: Quantity that must be faster than `least`; empty for none.
        least: Agreement of another map.

    Returns:
        None if the log cannot be imported by the map, or if the quantity is not faster.
    """
    try:
        source, read = log_files.gather(files, logmap.from_guess(blocks, columns), progress)
        logs = sessions(source, read)
        steps = {
            name: float(np.median([log.channel(measured(block)[0]).step for log in logs]))
            for name, block in blocks_of(read).items()
        }
        if least is not None and not steps[quantity] < least.steps[quantity]:
            return None
        imported = raw_table(logs, read)
        taken = windows(imported.times, imported.dt)
        if not any(map(len, taken)):
            return None
        follows = check(imported.logs, imported.times, imported.dt, imported.meaning).follows
        return _Agreement(Evidence(imported.logs, taken).errors(follows), steps)
    except DataError:
        return None


def _sources(block: Block) -> str:
    """Return the name of the message that contains the columns of a block."""
    return str(next(iter(block.get("columns") or block["quaternion"]))).rpartition(".")[0]


def corrected(
    files: Sequence[LogFile],
    columns: Sequence[str],
    blocks: Mapping[str, Block],
    stated: Collection[str],
    progress: log_files.Progress = log_files.silent,
) -> tuple[dict[str, Block], tuple[str, ...]]:
    """Return the blocks of a map, with axes, units, signs and lags corrected by the motion of the log.

    Columns that mark samples as valid are added to the blocks of their sensors.

    Args:
        files: The files of one dive.
        columns: All columns of the log.
        blocks: The blocks of a complete map.
        stated: Names of blocks that the user gave, whose axes, units and signs are kept.
        progress: Reports the progress of reading a file.

    Returns:
        The corrected blocks, and a line for each correction.
    """
    asked = validity(columns, blocks)
    gated = {name: {**blocks[name], "valid": column} for name, column in asked.items()}
    found = {**blocks, **gated}
    try:
        source, read = log_files.gather(files, logmap.from_guess(found, columns), progress)
        void = [name for name, column in asked.items() if not _marks_any(source, column)]
        found |= {name: blocks[name] for name in void}
        meaning = logmap.from_guess(found, columns)
        report = import_log(source, msgspec.structs.replace(meaning, session=read.session))
    except DataError as error:
        return dict(blocks), (f"the motion was not tested: {error}",)
    declared = _without_derived(report.imported.meaning, meaning)
    changes = [one for one in difference(declared, report.verdict.follows) if one.block not in stated]
    for change in changes:
        meaning = change.apply(meaning)
        found[change.block] = msgspec.to_builtins(getattr(meaning, change.block))
    notes = [f"{one.claim(declared).removesuffix(' as declared')}: corrected" for one in changes]
    notes += [
        f"{name}: samples with {column} = 0 are excluded"
        for name, column in asked.items()
        if name not in void
    ]
    for name, lag in report.clocks.lags().items():
        if "lag" not in found[name]:
            found[name] = {**found[name], "lag": float(f"{lag:.3g}")}
            late = "late" if lag > 0.0 else "early"
            notes.append(f"{name}: stamps are {abs(lag):.3g} s {late}: corrected by lag = {lag:.3g}")
    return found, tuple(notes)


def _marks_any(source: Log, column: str) -> bool:
    """Return whether a column marks any sample as valid, that is, has an entry other than 0."""
    numbers = values(source, column)
    return numbers is not None and bool(np.any(np.nan_to_num(numbers) != 0.0))


def _without_derived(read: LogMap, given: LogMap) -> LogMap:
    """Return a map without rates, if the given map derives them from the attitude.

    Args:
        read: The map.
        given: Map as given.
    """
    derived = given.rates is not None and given.rates.source == "attitude"
    return msgspec.structs.replace(read, rates=None) if derived else read
