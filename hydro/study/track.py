"""Estimates of every dive of a history, each in a file of its own, so that a killed run continues.

A dive is estimated again only if its files, the map, the vehicle file, the baseline or hydro's version
changed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from hydro.core.errors import DataError
from hydro.core.history.baseline import Baseline, learn_baseline
from hydro.core.history.estimate import Estimate, estimate
from hydro.core.history.parameters import Parameter
from hydro.core.vehicle.description import Vehicle
from hydro.io import log, memory, partitions, provenance, recordings, table
from hydro.io.files import name_of
from hydro.study.engine import Engine

FOLDER = "dives"
"""Folder of the estimates of single dives, in the folder of a history."""
KEY, CHI2 = "estimated_from", "residual"
"""Entries in the footer of the estimates of a dive."""


@dataclass(frozen=True)
class Dive:
    """One dive of a vehicle's history: the files from which it is read.

    Attributes:
        name: Name of the dive.
        source: Raw table, part of a data set, or log.
        map: Map of a log, the meaning of its columns; None for tables.
        definitions: Folder with `.msg` files, or None.
        vehicle: Vehicle file with which an imported log is checked.
    """

    name: str
    source: Path
    map: Path | None = None
    definitions: Path | None = None
    vehicle: Path | None = None

    def read(self) -> table.Artefact:
        """Return the raw table of the dive with its provenance.

        Raises:
            DataError: The file is missing, damaged, or no recording.
        """
        with ExitStack() as stack:
            file = stack.enter_context(log.opened(str(self.source), self.definitions))
            if self.map is None or recordings.is_artefact(file):
                return recordings.read(file, ("raw",))
            return recordings.imported([file], self.map, _quiet, vehicle_file=self.vehicle)

    def digest(self) -> str:
        """Return the SHA-256 of the dive's files, in hexadecimal digits.

        Raises:
            DataError: A file cannot be read.
        """
        found = hashlib.sha256()
        for path in [one for one in (self.source, self.map) if one is not None]:
            files = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
            for file in files:
                try:
                    with file.open("rb") as opened:
                        found.update(hashlib.file_digest(opened, "sha256").digest())
                except OSError as error:
                    raise DataError(f"{name_of(file)}: {(error.strerror or str(error)).lower()}") from error
        return found.hexdigest()


@dataclass(frozen=True)
class Estimated:
    """Result of the estimation of one dive.

    Attributes:
        dive: Name of the dive.
        estimate: Estimated parameters; None if the dive could not be estimated.
        parameters: Names of the parameters.
        error: Reason why the dive could not be estimated; empty otherwise.
    """

    dive: str
    estimate: Estimate | None = None
    parameters: tuple[str, ...] = ()
    error: str = ""


def dives_of(
    sources: Sequence[str], map_: Path | None, definitions: Path | None, vehicle: Path | None
) -> list[Dive]:
    """Return the dives among files and folders: every session of a folder, and every file, is one dive.

    Names are those of sessions, and of files without their suffix; files of the same name keep their folders.

    Args:
        sources: Paths of raw tables, logs, and folders of sessions.
        map_: Map of the logs, the meaning of their columns; None for tables.
        definitions: Folder with `.msg` files, or None.
        vehicle: Vehicle file with which imported logs are checked.

    Raises:
        DataError: Two dives have the same name.
    """
    found = list[Dive]()
    for source in sources:
        if partitions.is_dataset(source):
            parts = partitions.opened(source, ("raw",)).parts
            found += [Dive(part.session, part.path) for part in parts]
        else:
            found.append(Dive(Path(source).stem, Path(source), map_, definitions, vehicle))
    names = [one.name for one in found]
    found = [one if names.count(one.name) == 1 else Dive(str(one.source), *_rest(one)) for one in found]
    names = [one.name for one in found]
    if twice := [name for name in names if names.count(name) > 1]:
        raise DataError(f"dive {twice[0]} is given twice: give each dive once")
    return found


def _rest(dive: Dive) -> tuple[Path, Path | None, Path | None, Path | None]:
    """Return the attributes of a dive without its name."""
    return dive.source, dive.map, dive.definitions, dive.vehicle


def _quiet(line: str) -> None:
    """Ignore a line of an import's report."""


def keys(dives: Sequence[Dive], baseline: Iterable[str], text: str) -> dict[str, str]:
    """Return a dict from each dive's name to a hash of everything that determines the dive's estimates.

    Args:
        dives: The dives.
        baseline: Names of the baseline dives.
        text: Text of the vehicle file.
    """
    files = {dive.name: dive.digest() for dive in dives}
    shared = [provenance.package_version(), text, *(f"{name} {files[name]}" for name in baseline)]
    return {
        name: hashlib.sha256("\0".join([*shared, name, one]).encode()).hexdigest()
        for name, one in files.items()
    }


def estimates(
    dives: Sequence[Dive],
    baseline: Sequence[str],
    vehicle: Vehicle,
    text: str,
    folder: Path,
    engine: Engine,
    progress: Callable[[str, int, int], None],
) -> Iterator[Estimated]:
    """Yield the estimates of all dives in their order; estimates that an earlier run stored are read.

    Args:
        dives: The dives.
        baseline: Names of the baseline dives, made with the unchanged vehicle.
        vehicle: Vehicle.
        text: Text of the vehicle's file.
        folder: Folder of the history.
        engine: Engine that runs the tasks, in this process or on a cluster.
        progress: Called with a few words, the number of finished dives and the number of all.

    Raises:
        DataError: The baseline cannot be learnt.
    """
    wanted = keys(dives, baseline, text)
    done = {one.name: _kept(place(folder, one.name), wanted[one.name], one.name) for one in dives}
    todo = [one for one in dives if done[one.name] is None]
    fresh: Iterator[Estimated] = iter(())
    if todo:
        progress("learning the baseline", len(dives) - len(todo), len(dives))
        known = {one.name: one for one in dives}
        learnt = learn_baseline(vehicle, {name: known[name].read().frame for name in baseline})
        memory.give_back()
        engine.prepare()
        tasks = [(one, learnt, text, folder, wanted[one.name]) for one in todo]
        fresh = iter(engine.each(estimate_dive, tasks))
    for number, one in enumerate(dives):
        found = done[one.name] or next(fresh)
        progress(one.name, number + 1, len(dives))
        yield found


def place(folder: Path, dive: str) -> Path:
    """Return the path of the file with the estimates of one dive.

    Args:
        folder: Folder of the history.
        dive: Name of the dive.
    """
    return partitions.place(folder / FOLDER, dive)


def estimate_dive(dive: Dive, baseline: Baseline, text: str, folder: Path, key: str) -> Estimated:
    """Estimate one dive, write its estimates into the folder, and return them.

    An error of the dive becomes part of the result instead of being raised.

    Args:
        dive: The dive.
        baseline: Unchanged vehicle.
        text: Text of the vehicle's file.
        folder: Folder of the history.
        key: Hash of everything that determines the estimates.
    """
    try:
        source = dive.read()
        found = estimate(baseline, dive.name, source.frame)
    except DataError as error:
        return Estimated(dive.name, error=f"{dive.name}: {error}")
    made = table.make(
        "history",
        _frame(dive.name, baseline.parameters, found),
        stage="track",
        parameters={KEY: key, CHI2: found.chi2},
        inputs=[source],
        vehicle_text=text,
    )
    target = place(folder, dive.name)
    target.parent.mkdir(parents=True, exist_ok=True)
    table.write(made, target)
    memory.give_back()
    return _kept(target, key, dive.name) or Estimated(dive.name, error=f"{dive.name}: was changed meanwhile")


def _frame(dive: str, parameters: Sequence[Parameter], found: Estimate) -> pl.DataFrame:
    """Return the estimates of one dive as a history table, not yet relative to the baseline."""
    names = [one.name for one in parameters if one.reported]
    kept = np.array([one.reported for one in parameters])
    values = found.values[kept]
    return pl.DataFrame(
        {
            "number": [1] * len(names),
            "dive": [dive] * len(names),
            "parameter": names,
            "value": values,
            "standard_error": found.errors[kept],
            "level": values,
            "unit": [one.unit for one in parameters if one.reported],
            "flag": ["unchanged"] * len(names),
        }
    )


def _kept(file: Path, key: str, dive: str) -> Estimated | None:
    """Return the estimates of an earlier run, if their file has this key; otherwise None.

    Args:
        file: File of the estimates.
        key: Hash of everything that determines the estimates.
        dive: Name of the dive.
    """
    if not file.is_file():
        return None
    try:
        made = table.read(file, "history")
    except DataError:
        return None
    if made.provenance.parameters.get(KEY) != key:
        return None
    frame, chi2 = made.frame, float(made.provenance.parameters[CHI2])
    values, errors = (frame[name].to_numpy().astype(float) for name in ("value", "standard_error"))
    return Estimated(dive, Estimate(values, errors, chi2), tuple(frame["parameter"]))
