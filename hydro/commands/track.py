"""Command `track`: changes of a vehicle over its dives."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hydro.commands.answers import AsText, Printing
from hydro.commands.as_json import Json, print_json
from hydro.commands.engines import Address, EngineName, Threads, engine_for
from hydro.commands.places import FOLDER
from hydro.commands.recordings import Definitions, MapFile
from hydro.commands.shell import ModelFile, message, progress, vehicle_held
from hydro.core.errors import DataError, UsageError

if TYPE_CHECKING:
    from hydro.core.history.history import History
    from hydro.io.table import Artefact

NEW = 3
"""Exit code if a change was found that the last run had not found."""
TABLE, PAGE, CHANGES = "history.parquet", "report.html", "changes.json"
"""Files of a history."""
FEW = 4
"""Default number of baseline dives: with fewer the scatter between dives is hardly known, and with more an
early change could be in the baseline."""


def track(
    vehicle: ModelFile,
    dives: Annotated[
        list[str],
        typer.Argument(
            metavar="DIVES...",
            show_default=False,
            help="Raw tables, logs with --map, or folders of sessions, the oldest dive first.",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="HISTORY", show_default=False, help="Folder of the history."),
        FOLDER,
    ],
    map_: MapFile = None,
    msg: Definitions = None,
    baseline: Annotated[
        int,
        typer.Option(min=2, metavar="N", help="Number of first dives of the unchanged vehicle."),
    ] = FEW,
    baseline_dive: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            show_default=False,
            help="Name of a dive of the baseline, in place of the first ones. May be repeated.",
        ),
    ] = None,
    engine: EngineName = "here",
    address: Address = None,
    threads: Threads = 1,
    as_text: AsText = False,
    as_json: Json = False,
) -> None:
    r"""Find out whether a vehicle has changed over its dives, and when.

    The baseline dives teach the vehicle's hull force. Each dive then gets an estimate of the thrust of every
    thruster, the net buoyancy and the drag on each axis, relative to the baseline. A change is named with
    its size and its date. Every file, and every session of a folder, is one dive.

    The exit code is 3 if this run found a change that the last run had not found, and 0 otherwise.

        hydro track vehicle.toml dives/*.mcap --map map.toml -o history

    Details:

    HISTORY/history.parquet has a row for each dive and parameter, HISTORY/report.html the time lines, and
    HISTORY/changes.json the changes. Add new dives to the end of the command line and run it again: dives
    that are done are not estimated again, and a run that was killed continues.

    The test for changes allows at most one false alarm in 500 unchanged dives, over all parameters. The
    scatter between dives is estimated from the history, so that standard errors that are too small cause no
    alarm. A change needs two dives after it, so that a single odd dive is not one. A slow trend can be
    distinguished from a jump once it has lasted four dives.

    A bug in hydro has exit code 3 as well; its line on stderr then says so. New changes are reported on
    stderr in lines that begin with "hydro: new:".

    Dives of five minutes with motion on all axes determine most parameters. `hydro diagnose --before` names
    a change of another kind, such as a payload or a faulty sensor.
    """
    from functools import partial

    from hydro.core.history.history import history
    from hydro.core.history.parameters import named
    from hydro.io import table
    from hydro.study.track import dives_of, estimates

    printing = Printing(str(output), as_text, as_json, folder=True)
    known, text = vehicle_held(vehicle, None)
    listed = dives_of(dives, map_, msg, vehicle)
    first = _baseline([one.name for one in listed], baseline, baseline_dive or [])
    listed = sorted(listed, key=lambda one: one.name not in first)
    connect = partial(engine_for, engine, address, threads)
    found, failed, names = dict[str, Any](), list[str](), tuple[str, ...]()
    with connect() as running, progress("track") as update:

        def advance(words: str, done: int, total: int) -> None:
            update(done, total, words)

        for one in estimates(listed, first, known, text, output, running, advance):
            if one.estimate is None:
                failed.append(one.error)
                message(f"hydro: {one.error}")
            else:
                found[one.dive], names = one.estimate, one.parameters
    if not found:
        raise DataError(f"none of {len(listed)} dives could be estimated, see above")
    whole = history(named(known, names), found, first)
    made = table.make(
        "history",
        whole.table(),
        stage="track",
        parameters={"baseline_dives": first, "found": whole.sentences},
        vehicle_text=text,
    )
    new = _new(whole, output / CHANGES)
    _write(whole, made, known.name, failed, output)
    _print(whole, printing, new)
    if new:
        raise typer.Exit(NEW)


def _baseline(names: Sequence[str], count: int, given: Sequence[str]) -> list[str]:
    """Return the names of the baseline dives.

    Raises:
        UsageError: A named dive is not among the dives, or there are too few.
    """
    if unknown := [name for name in given if name not in names]:
        raise UsageError(f"--baseline-dive {unknown[0]}: no such dive; there are {', '.join(names[:5])}, ...")
    chosen = list(dict.fromkeys(given)) or list(names[:count])
    if len(chosen) < 2 or len(names) < len(chosen):
        raise UsageError(f"{len(names)} dives: a baseline needs at least 2 dives; give more dives")
    if not given and len(names) < count:
        raise UsageError(f"{len(names)} dives are fewer than the baseline of {count}: lower --baseline")
    return chosen


def _new(whole: History, file: Path) -> list[str]:
    """Return the sentences on changes that the last run had not found; in the first run, all sentences."""
    try:
        before = {(one["parameter"], one["found_in"]) for one in json.loads(file.read_bytes())["changes"]}
    except (OSError, ValueError, KeyError, TypeError):
        before = set()
    rows = whole.changes_table().iter_rows(named=True)
    return [row["sentence"] for row in rows if (row["parameter"], row["found_in"]) not in before]


def _write(whole: History, made: Artefact, title: str, failed: Sequence[str], folder: Path) -> None:
    """Write the table, the page and, last, the changes, by which the next run knows what is new."""
    from hydro.io import table
    from hydro.io.files import write_bytes
    from hydro.report.history import render
    from hydro.report.json_text import json_text

    table.write(made, folder / TABLE)
    write_bytes(render(whole, made, title, failed).encode(), folder / PAGE)
    write_bytes(json_text(changes=whole.changes_table()).encode(), folder / CHANGES)


def _print(whole: History, printing: Printing, new: Sequence[str]) -> None:
    """Print the answer, and the new changes on stderr."""
    from hydro.core.history.sentences import limits

    printing.console.print(whole.headline, style="bold", soft_wrap=True)
    printing.console.print(limits(), soft_wrap=True)
    if whole.undetermined:
        named = ", ".join(one.label for one in whole.undetermined)
        printing.console.print(f"Not determined by these dives: {named}.", soft_wrap=True)
    for words in new:
        message(f"hydro: new: {words}")
    if printing.json:
        said: dict[str, Any] = {
            "headline": whole.headline,
            "new": list(new),
            "changes": whole.changes_table(),
        }
        print_json(**said, history=whole.table())


COMMANDS = {
    track: "hydro track datasets/hidden/vehicle.toml datasets/hidden/measured.parquet "
    "datasets/hidden/heldout.parquet --baseline 2 -o history",
}
