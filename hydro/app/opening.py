"""Vehicle files and recordings that the workbench opens, with all that the page says about them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from hydro.core import effects
from hydro.core.cleaning.readiness import require_ready
from hydro.core.columns import COMMAND, MOTION, Array
from hydro.core.diagnosis.log_faults import Preprocessed, preprocess
from hydro.core.errors import DataError, listed
from hydro.core.evaluation.replay_error import HORIZONS
from hydro.core.evaluation.weights import Weights
from hydro.core.explanation.explain import long_enough
from hydro.core.guessing.aliases import Block
from hydro.core.guessing.interview import lacking
from hydro.core.guessing.map_lines import KINDS, block_of, text_of
from hydro.core.logs.logmap import BLOCKS
from hydro.core.prediction.candidate import candidate
from hydro.core.progress import Progress
from hydro.core.recording.segments import gaps
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle
from hydro.io import covariance, mapdraft, recordings, table
from hydro.io import vehicle as vehicles
from hydro.io.files import bundled, write_bytes
from hydro.io.log import opened
from hydro.io.log_files import texts_of
from hydro.io.map_proposal import corrected, proposed
from hydro.io.table import Artefact

HELD_OUT, BEFORE = "held-out recording", "recording before a change"
"""Further recordings in the words of the page."""
SAMPLE = "hidden effects"
"""Name of the sample: a bundled recording of a vehicle with more effects than its file."""
AXES = 3
"""Columns of a sensor with three axes: with fewer unused columns a log has no sensor left to name."""
COLUMNS = frozenset({"column", "columns", "quaternion", "depth", "height", "latitude", "longitude"})
"""Keys of a block that name its columns; all others state axes, units or an order."""
UNTESTED = "the motion was not tested"
"""Beginning of a note on a map, which the next test replaces."""
SENSOR_OF = dict(zip(MOTION, (name for name in BLOCKS for _ in range(AXES)), strict=True))
"""Block of a map that fills a column of the raw table."""
_OUT_OF_RANGE = re.compile(r"raw: (\w+) \[")
"""Beginning of the message on implausible values in a column of an imported recording."""


@dataclass(frozen=True)
class Craft:
    """Vehicle file that a tab has opened.

    Attributes:
        path: Path of the file.
        text: Text of the file.
        vehicle: The vehicle, with standard errors from the covariance next to the file.
        estimates: The covariance next to the file; None if there is none.
    """

    path: str
    text: str
    vehicle: Vehicle
    estimates: Estimates | None = None

    @classmethod
    def read(cls, path: str | Path) -> Craft:
        """Return the vehicle of a file, with the file's text and the covariance next to it.

        Raises:
            DataError: The file is not a valid vehicle.
        """
        found, text = vehicles.read(path)
        effects.validate(found)
        estimates, _ = covariance.read(path, found)
        return cls(
            str(path),
            text,
            found if estimates is None else covariance.with_errors(found, estimates),
            estimates,
        )

    def for_recording(self, source: Artefact) -> Craft:
        """Return a copy of the vehicle file without standard errors that were estimated from the recording.

        Such errors are not independent of the recording, so a fit to it must not use them as prior.

        Args:
            source: Raw table of the recording.
        """
        return replace(self, vehicle=vehicles.without_errors_from(self.vehicle, source.provenance.content))


@dataclass(frozen=True)
class Proposed:
    """Map of a log, as it was proposed or corrected.

    Attributes:
        columns: Columns of the log.
        blocks: Blocks of the map.
        lines: Each block as one text, such as `dvl_{x,y,z} FLU m/s`.
        notes: Corrections by the motion of the log.
        missing: Names of required blocks that the map lacks.
    """

    columns: tuple[str, ...]
    blocks: Mapping[str, Block]
    lines: Mapping[str, str]
    notes: tuple[str, ...]
    missing: tuple[str, ...]


@dataclass(frozen=True)
class Further:
    """Additional recording of a study: a held-out recording, or one from before a change.

    Attributes:
        path: Path of the file.
        source: Raw table with its provenance.
    """

    path: str
    source: Artefact


@dataclass(frozen=True)
class Opened:
    """Recording that a tab has opened, imported and cleaned.

    Attributes:
        name: Name of the recording on the page.
        paths: Paths of the logs, or of the raw table.
        map: Path of the map; empty for a raw table.
        source: Raw table with its provenance.
        log: Cleaned recording.
        weights: Weights of the velocity axes, from the inertia of the vehicle with which the recording was
            opened, (6,).
        lines: Results of the import, of the cleaning and of the thruster audit, a line each.
        audit: Contradiction between the thrusters and the file; empty if there is none.
        holdout: Held-out recording; None without one.
        before: Recording before a change; None without one.
    """

    name: str
    paths: tuple[str, ...]
    map: str
    source: Artefact
    log: Preprocessed
    weights: Array
    lines: tuple[str, ...]
    audit: str = ""
    holdout: Further | None = None
    before: Further | None = None

    @property
    def to_send(self) -> Opened:
        """A copy for the worker process, without the predictions that only the page uses."""
        return replace(self, log=replace(self.log))


def sample() -> tuple[str, str]:
    """Return the paths of the vehicle file and of the recording that the package includes as a sample."""
    folder = bundled("hidden")
    return str(folder / "vehicle.toml"), str(folder / "measured.parquet")


def presets() -> dict[str, str]:
    """Return the paths of the bundled vehicle files by name."""
    return {path.stem: str(path) for path in sorted(bundled("vehicles").glob("*.toml"))}


def is_table(paths: Sequence[str]) -> bool:
    """Return whether the chosen files are one raw table, which needs no map.

    Raises:
        DataError: Several files were chosen, and one of them is a raw table.
    """
    with ExitStack() as stack:
        files = [stack.enter_context(opened(path, None)) for path in paths]
        tables = [path for path, file in zip(paths, files, strict=True) if recordings.is_artefact(file)]
    if tables and len(paths) > 1:
        raise DataError(f"{Path(tables[0]).name}: a raw table opens alone: take it or the others away")
    return bool(tables)


def commands_of(path: str) -> tuple[int, str]:
    """Return the number of command columns of a raw table, and the text of the vehicle file in its footer."""
    found = table.read(path, "raw")
    return sum(name.startswith(COMMAND) for name in found.frame.columns), found.provenance.vehicle or ""


def propose_map(
    paths: Sequence[str], given: Mapping[str, str], thrusters: int | None, progress: Progress
) -> Proposed:
    """Return a proposed map of logs, guessed from columns and corrected by the motion.

    Args:
        paths: The files of one dive.
        given: Blocks that the user wrote, by name, each as one text.
        thrusters: Number of thrusters of the vehicle, if known.
        progress: Called with a description of the work and the fraction of it that is done.

    Raises:
        DataError: A file cannot be read, or the text of a block is invalid.
    """
    progress("reading the log", 0.1)
    with ExitStack() as stack:
        files = [stack.enter_context(opened(path, None)) for path in paths]
        found = proposed(files, given, thrusters=thrusters)
        return _proposed(found.columns, found.blocks, found.notes)


def settings(name: str, block: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """Return those settings of a map's block that have fixed choices, such as its unit, with the choices.

    Args:
        name: Name of the block, one of `map_lines.KINDS`.
        block: The block.

    Returns:
        The choices, by the name of the setting.
    """
    hints = get_type_hints(KINDS[name])
    unused = {"unit", "order"} if "quaternion" in block else {"layout", "turns"}
    return {
        field.encode_name: get_args(hints[field.name])
        for field in msgspec.structs.fields(KINDS[name])
        if get_origin(hints[field.name]) is Literal and field.encode_name not in {*unused, "from", "off"}
    }


def edited(before: Proposed, name: str, text: str) -> dict[str, Block]:
    """Return a new dict of the blocks of a map after the user wrote the text of one of them.

    Args:
        before: The map before; not changed.
        name: Name of the block.
        text: Text of the block; `none` removes it.

    Raises:
        DataError: The text does not describe a block of this name.
    """
    blocks = {key: block for key, block in before.blocks.items() if key != name}
    if (block := block_of(name, text, before.columns)) is not None:
        blocks[name] = block
    return blocks


def correct_map(
    paths: Sequence[str], before: Proposed, blocks: Mapping[str, Block], progress: Progress
) -> Proposed:
    """Return a new proposal of a map with blocks that a person has changed.

    The motion corrects the axes and units of all blocks but those for which the person stated them.

    Args:
        paths: The files of one dive.
        before: The map before; not changed.
        blocks: All blocks of the new map, by name.
        progress: Called with a description of the work and the share of it that is done.

    Raises:
        DataError: A file cannot be read.
    """
    progress("testing the map by the motion", 0.1)
    changed = {
        name for name, block in blocks.items() if block != before.blocks.get(name) and set(block) - COLUMNS
    }
    if lacking(blocks):
        return _proposed(before.columns, blocks, ())
    with ExitStack() as stack:
        files = [stack.enter_context(opened(path, None)) for path in paths]
        found, notes = corrected(files, before.columns, blocks, changed)
    kept = [note for note in before.notes if note not in notes and not note.startswith(UNTESTED)]
    return _proposed(before.columns, found, (*kept, *notes))


def unrecognised(found: Proposed) -> list[str]:
    """Return the names of sensors that a map lacks and that unused columns of the log may hold."""
    used = {name for block in found.blocks.values() for name in texts_of(block)}
    unused = [name for name in found.columns if name not in used]
    return [name for name in BLOCKS if name not in found.blocks] if len(unused) >= AXES else []


def _proposed(columns: Sequence[str], blocks: Mapping[str, Block], notes: Sequence[str]) -> Proposed:
    lines = {name: text_of(name, blocks.get(name)) for name in KINDS}
    return Proposed(tuple(columns), blocks, lines, tuple(notes), tuple(lacking(blocks)))


def write_map(found: Proposed, paths: Sequence[str], destination: Path) -> str:
    """Write the map file of a proposal, and return its path as text.

    Args:
        found: The proposed map.
        paths: The logs; the first names the session.
        destination: Path of the map file.

    Raises:
        DataError: The map lacks a required block.
    """
    if found.missing:
        raise DataError(f"{Path(paths[0]).name}: the map has no {listed(found.missing)}: name its columns")
    blocks: dict[str, Any] = {**found.blocks}
    blocks.setdefault("session", {"name": Path(paths[0]).stem})
    text = mapdraft.draft(blocks, found.columns, Path(paths[0]).name, blanks=False)
    write_bytes(text.encode(), destination)
    return str(destination)


def open_recording(
    paths: Sequence[str],
    map_: str,
    craft: Craft,
    progress: Progress,
    *,
    correct: bool = False,
    holdout: str = "",
    before: str = "",
) -> Opened:
    """Return a recording that was imported, cleaned and audited for a vehicle.

    Args:
        paths: A raw table, or the logs of one dive.
        map_: Path of the map; empty for a raw table.
        craft: The vehicle file.
        progress: Called with a description of the work and the fraction of it that is done.
        correct: Accept the directions and the order of the thrusters that the audit states.
        holdout: Held-out recording: a raw table, or a log that the same map fits; empty without one.
        before: Recording before a change: a raw table, or a log that the same map fits; empty without one.

    Raises:
        DataError: A file, the map or the vehicle is invalid, or they do not fit each other; or a further
            recording has the same rows.
    """
    progress("reading", 0.05)
    source, lines = _read(paths, map_, craft)
    beside = {
        words: None if not path else _further(path, words, map_, craft, source)
        for words, path in ((HELD_OUT, holdout), (BEFORE, before))
    }
    for words, found in beside.items():
        lines += [] if found is None else [f"{words}: {line}" for line in _of_table(found.source)]
    progress("cleaning", 0.4)
    craft = craft.for_recording(source)
    if (other := beside[HELD_OUT]) is not None:
        _require_length(other, craft, beside=bool(before))
    log = preprocess(craft.vehicle, source.frame)
    require_ready(log.observed)
    lines += [line for line in log.changes if line not in lines]
    if not map_ and log.audit is not None:
        lines += log.audit.lines(Path(craft.path).name)
    wrong = log.audit.headline(Path(craft.path).name) if log.audit is not None and log.audit.wrong else ""
    if correct:
        log, wrong = log.as_audited(), ""
    progress("shots", 0.8)
    _ = log.noise, log.lateness
    for horizon in HORIZONS:
        try:
            log.shots(horizon)
        except DataError:  # no session is that long; the page offers the shorter horizons
            continue
    weights = Weights.of(candidate(craft.vehicle)).velocity
    return Opened(
        Path(paths[0]).name,
        tuple(paths),
        map_,
        source,
        log,
        weights,
        tuple(lines),
        wrong,
        beside[HELD_OUT],
        beside[BEFORE],
    )


def _read(paths: Sequence[str], map_: str, craft: Craft) -> tuple[Artefact, list[str]]:
    """Return a raw table, read or imported by a map, and lines that describe it."""
    if not map_:
        source = table.read(paths[0], "raw")
        return source, _of_table(source)
    lines = list[str]()
    with ExitStack() as stack:
        files = [stack.enter_context(opened(path, None)) for path in paths]
        try:
            source = recordings.imported(files, Path(map_), lines.append, vehicle_file=Path(craft.path))
        except DataError as error:
            match = _OUT_OF_RANGE.match(str(error))
            if match is None or match[1] not in SENSOR_OF:
                raise
            raise DataError(f"{error}: check the unit of {SENSOR_OF[match[1]]} in the map") from error
    return source, lines


def _further(path: str, words: str, map_: str, craft: Craft, measured: Artefact) -> Further:
    """Read a held-out recording or one from before a change.

    Args:
        path: Path of a raw table or a log.
        words: Name of its purpose, for messages.
        map_: Path of the map; empty for a raw table.
        craft: The vehicle file.
        measured: Raw table of the main recording.

    Raises:
        DataError: The file cannot be read, or has the same rows as the main recording.
    """
    name = Path(path).name
    raw = is_table([path])
    if not raw and not map_:
        raise DataError(f"{name}: a log needs a map, and the recording has none: import this log first")
    source, _ = _read([path], "" if raw else map_, craft)
    if source.provenance.content == measured.provenance.content:
        raise DataError(f"{name}: the same rows as the recording; choose another one as {words}")
    return Further(path, source)


def _require_length(other: Further, craft: Craft, *, beside: bool) -> None:
    """Refuse a further recording that is too short, or belongs to another vehicle.

    Args:
        other: Further recording.
        craft: Vehicle file.
        beside: Whether the study learns a hull-force model, which needs more data.

    Raises:
        DataError: The recording is refused.
    """
    try:
        long_enough(craft.vehicle, other.source.frame, beside=beside)
    except DataError as error:
        raise DataError(f"{Path(other.path).name}: {error}") from error


def _of_table(source: Artefact) -> list[str]:
    """Describe a raw table: rows, sessions and gaps."""
    frame, apart = source.frame, gaps(source.frame)
    sessions = frame["session"].n_unique()
    rate = 1.0 / float(np.median(np.diff(frame["t"].head(50).to_numpy())))
    plural = "s" if sessions > 1 else ""
    return [
        f"{frame.height:,} rows at {rate:.3g} Hz in {sessions} session{plural}",
        *([apart] if apart else []),
    ]
