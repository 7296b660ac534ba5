"""The map that a log suggests: by names and numbers of its columns, then by what its motion contradicts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from hydro.core.errors import DataError
from hydro.core.guessing.aliases import Block
from hydro.core.guessing.interview import lacking
from hydro.core.guessing.map_lines import block_of
from hydro.core.guessing.validity import validity
from hydro.core.logs.alternatives import difference
from hydro.core.logs.logmap import LogMap
from hydro.io import log_files, logmap
from hydro.io.log import Log, LogFile, values
from hydro.io.log_import import import_log


@dataclass(frozen=True)
class Proposal:
    """A map to begin with.

    Attributes:
        columns: All columns of the log.
        blocks: The blocks of the map; those that nothing suggests are not there.
        notes: What the motion changed in the guess, or why it could not be asked, a line each.
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
    """Guess the map of some files, with the lines that are given already.

    Args:
        files: The files of one dive.
        given: Lines of the map, as `map_lines.block_of` reads them, by the name of the block.
        progress: Gives what is told how far each file is read.
        thrusters: How many the vehicle has, if that is known.

    Raises:
        DataError: A file cannot be read, or a given line is none.
    """
    columns, blocks = log_files.drafted(files, progress, None, thrusters)
    for name, text in given.items():
        blocks.pop(name, None)
        if (block := block_of(name, text, columns)) is not None:
            blocks[name] = block
    if lacking(blocks):
        return Proposal(columns, blocks)
    blocks, notes = corrected(files, columns, blocks, set(given), progress)
    return Proposal(columns, blocks, notes)


def corrected(
    files: Sequence[LogFile],
    columns: Sequence[str],
    blocks: Mapping[str, Block],
    stated: Collection[str],
    progress: log_files.Progress = log_files.silent,
) -> tuple[dict[str, Block], tuple[str, ...]]:
    """Return the blocks with axes, units, signs and lags by the motion of the log, and what was changed.

    Samples that a column beside a sensor calls invalid do not count.

    Args:
        files: The files of one dive.
        columns: All columns of the log.
        blocks: The blocks of a whole map.
        stated: Names of blocks that a person has stated: their axes, units and signs stay.
        progress: Gives what is told how far each file is read.
    """
    asked = validity(columns, blocks)
    gated = {name: {**blocks[name], "valid": column} for name, column in asked.items()}
    found = {**blocks, **gated}
    try:
        source, read = log_files.gather(files, logmap.from_guess(found, columns), progress)
        void = [name for name, column in asked.items() if not _says(source, column)]
        found |= {name: blocks[name] for name in void}
        meaning = logmap.from_guess(found, columns)
        report = import_log(source, msgspec.structs.replace(meaning, session=read.session))
    except DataError as error:
        return dict(blocks), (f"the motion could not be asked: {error}",)
    declared = _without_derived(report.imported.meaning, meaning)
    changes = [one for one in difference(declared, report.verdict.follows) if one.block not in stated]
    for change in changes:
        meaning = change.apply(meaning)
        found[change.block] = msgspec.to_builtins(getattr(meaning, change.block))
    notes = tuple(
        f"{one.claim(declared).removesuffix(' as declared')} as the names suggest" for one in changes
    )
    lags = {name: lag for name, lag in report.clocks.lags().items() if "lag" not in found[name]}
    for name, lag in lags.items():
        found[name] = {**found[name], "lag": float(f"{lag:.3g}")}
    late = (
        f"{name} is stamped {abs(lag):.3g} s {'late' if lag > 0.0 else 'early'}: the map says lag = {lag:.3g}"
        for name, lag in lags.items()
    )
    counts = (
        f"{name} counts where {column} is not 0: the map says valid"
        for name, column in asked.items()
        if name not in void
    )
    return found, (*notes, *counts, *late)


def _says(source: Log, column: str) -> bool:
    """Return whether a column calls any sample valid; one that nobody fills in is 0 throughout."""
    numbers = values(source, column)
    return numbers is not None and bool(np.any(np.nan_to_num(numbers) != 0.0))


def _without_derived(read: LogMap, given: LogMap) -> LogMap:
    """Return the map that the check of the conventions was asked about: without rates of the attitude."""
    derived = given.rates is not None and given.rates.source == "attitude"
    return msgspec.structs.replace(read, rates=None) if derived else read
