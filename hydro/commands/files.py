"""Commands `check` and `show`: check files and audit thrusters, and show the contents of a file."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hydro.commands.answers import AsText
from hydro.commands.diagnose import print_findings
from hydro.commands.recordings import Definitions, Logs, MapFile, MaxExpanded
from hydro.commands.shell import STREAM, read
from hydro.commands.tables import print_table
from hydro.core.errors import DataError

if TYPE_CHECKING:
    import polars as pl
    from rich.tree import Tree

    from hydro.io.table import Artefact

Files = Annotated[
    list[str],
    typer.Argument(
        metavar="FILE", help="Artefacts, folders of sessions, vehicle files and maps; - is stdin."
    ),
]
File = Annotated[
    str, typer.Argument(metavar="FILE", show_default=False, help="An artefact; nothing or - is stdin.")
]
SHORT = len("sha256:") + 12
"""Number of characters of a hash that the lineage shows."""
WHOLE = ("metrics", "ladder", "evaluations")
"""Kinds of small tables, which are shown with all rows instead of a list of columns."""


def check(
    files: Files,
    map_: MapFile = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    as_text: AsText = False,
) -> None:
    """Check files against their schemas, and audit the thrusters.

    With one vehicle file and recordings, the thrusters are audited: their thrust as a multiple of the file's,
    wrong directions, swapped columns, and thrusters that the recording cannot separate. The exit code is 1 if
    a file does not conform to its schema, or if directions or order contradict the vehicle file.

        hydro check vehicle.toml raw.parquet
        hydro check vehicle.toml dive.bag --map map.toml

    Details:

    A schema has columns, types, finite values, bounds, the order in time, and a content that matches the hash
    in the footer. A file that does not conform is one line on stderr; on a terminal, or with --text, a sound
    file is one line on stdout. For a recording with nulls a line says how many samples each such column has.
    For a vehicle file it says which values are not plausible, and which are likely in another unit. Each
    session of a folder is checked by itself.

    The audit gives each thrust with its 95 % interval, negative if the thruster pushes opposite to the file,
    and a factor common to all thrusters.
    """
    unsound, shown = 0, as_text or sys.stdout.isatty()
    vehicles = [file for file in files if _is_vehicle(file)]
    for file in files:
        artefact: Artefact | None
        try:
            if map_ is not None and file not in vehicles:
                artefact = Logs(map_, msg).read([file])
                told = _told(file, artefact)
            else:
                told, artefact = _check(file)
            if shown:
                typer.echo(f"{file}: sound: {told}")
            if artefact is not None and artefact.kind == "raw" and len(vehicles) == 1:
                unsound += _audit(vehicles[0], file, artefact, shown)
        except DataError as error:
            typer.echo(f"hydro: {error}", err=True)
            unsound += 1
    if unsound:
        raise typer.Exit(1)


def _is_vehicle(file: str) -> bool:
    """Return whether a file is a vehicle file, by its suffix."""
    from hydro.io import logmap

    return Path(file).suffix == ".toml" and not logmap.is_map(file)


def _audit(vehicle: str, file: str, artefact: Artefact, shown: bool) -> bool:
    """Print the audit of a vehicle's thrusters by a recording; return whether it contradicts the file.

    Args:
        vehicle: Vehicle file.
        file: Name of the recording.
        artefact: The recording.
        shown: Whether the audit goes to stdout, with its table.
    """
    from hydro.core.diagnosis.log_faults import preprocess
    from hydro.io import vehicle as vehicles

    try:
        found = preprocess(vehicles.read(vehicle)[0], artefact.frame).audit
    except DataError as error:
        typer.echo(f"{file}: the thrusters are not audited: {error}", err=True)
        return False
    if found is None:
        typer.echo(f"{file}: too short, or no thrusters: the thrusters are not audited", err=True)
        return False
    if shown and not found.contradicted:
        print_table(found.table(), f"thrust as a multiple of {vehicle}")
    for line in found.lines(vehicle):
        typer.echo(f"{file}: {line}", err=not shown)
    return found.wrong


def _check(file: str) -> tuple[str, Artefact | None]:
    """Check one file and return its kind: a vehicle file or a map by its suffix, else an artefact."""
    from hydro.core import effects
    from hydro.core.effects.catalogue import implausible
    from hydro.io import logmap, partitions, table, vehicle

    if Path(file).suffix == ".toml":
        if logmap.is_map(file):
            logmap.read(file)
            return "a map of a log", None
        known = vehicle.read(file)[0]
        effects.validate(known)
        for words in implausible(known):
            typer.echo(f"{file}: {words}", err=True)
        named = ", ".join(str(table["name"]) for table in known.effect) or "none"
        return f"the vehicle {known.name}, {len(known.thruster)} thrusters; effects: {named}", None
    if partitions.is_dataset(file):
        data = partitions.opened(file)
        for part in data.parts:
            _check_table(str(part.path), table.read_part(part))
        rows = sum(part.rows for part in data.parts)
        return f"{len(data.parts)} sessions of kind {data.kind}, {rows:,} rows", None
    artefact = read(file)
    return _told(file, artefact), artefact


def _told(file: str, artefact: Artefact) -> str:
    """Check the rows of a table and return its kind and number of rows, in words."""
    _check_table(file, artefact)
    return f"a table of kind {artefact.kind}, {artefact.frame.height:,} rows"


def _check_table(file: str, artefact: Artefact) -> None:
    """Check the rows of a recording, and print remarks on stderr; ignore other tables."""
    from hydro.core.recording import segments
    from hydro.core.vehicle import likely_units

    if artefact.kind == "raw":
        segments.segments(artefact.frame)
        if odd := likely_units.sampling(segments.sample_time(artefact.frame)):
            typer.echo(f"{file}: {odd}", err=True)
        if rare := _rare(artefact):
            typer.echo(f"{file}: {rare}", err=True)


def _rare(artefact: Artefact) -> str:
    """Return which columns have samples in few of the rows, and which in none; empty without nulls."""
    frame, columns = artefact.frame, dict[int, list[str]]()
    for name in frame.columns:
        columns.setdefault(frame.height - frame[name].null_count(), []).append(name)
    rare = [
        f"samples in {count:,} of {frame.height:,} rows: {', '.join(names)}"
        for count, names in columns.items()
        if 0 < count < frame.height
    ]
    return "; ".join([*rare, *([f"no samples: {', '.join(columns[0])}"] if 0 in columns else [])])


def show(file: File = STREAM, max_expanded: MaxExpanded = None) -> None:
    """Print the contents and the origin of a file.

    On a terminal: kind, stage and parameters, lineage, and every column with unit and range. Small tables
    such as metrics are shown whole, findings in words. In a pipe the same as JSON.
    """
    artefact = read(file)
    if sys.stdout.isatty():
        _print_page(artefact)
    else:
        import msgspec

        described = msgspec.to_builtins(artefact.provenance) | {"columns": columns(artefact).to_dicts()}
        typer.echo(msgspec.json.format(msgspec.json.encode(described), indent=2).decode())


def columns(artefact: Artefact) -> pl.DataFrame:
    """Return a new table with one row per column of an artefact.

    Its columns are `column`, `type`, `unit`, `frame`, `samples` (not null), `min`, `max` and `description`.
    """
    import polars as pl

    from hydro.io import schema

    fields = schema.suited(artefact.kind, artefact.frame).columns(artefact.frame.columns)
    numbers = [name for name in fields if artefact.frame.schema[name].is_numeric()]
    values = artefact.frame.select(pl.col(numbers).cast(pl.Float64))
    low, high = (dict(zip(numbers, each.row(0), strict=True)) for each in (values.min(), values.max()))
    return pl.DataFrame(
        {
            "column": list(fields),
            "type": [schema.storage_type(artefact.frame.schema[name]) for name in fields],
            "unit": [field.unit for field in fields.values()],
            "frame": [field.frame for field in fields.values()],
            "samples": [artefact.frame.height - artefact.frame[name].null_count() for name in fields],
            "min": [low.get(name) for name in fields],
            "max": [high.get(name) for name in fields],
            "description": [field.description for field in fields.values()],
        }
    )


def _print_page(artefact: Artefact) -> None:
    """Print an artefact: kind, origin and contents."""
    from rich.console import Console

    console = Console(highlight=False, markup=False)
    for line in _summary(artefact):
        console.print(line)
    console.print(_lineage(artefact))
    if artefact.kind == "diagnosis":
        if headline := artefact.provenance.parameters.get("headline"):
            console.print(headline, style="bold")
        print_findings(artefact.frame, console)
    else:
        print_table(artefact.frame if artefact.kind in WHOLE else columns(artefact).drop("description"))


def _summary(artefact: Artefact) -> Iterator[str]:
    """Yield size, seed, vehicle and network, each in one line, as far as they exist."""
    from hydro.io import vehicle

    record, frame = artefact.provenance, artefact.frame
    sessions = frame["session"].n_unique() if "session" in frame.columns else 0
    counted = f" in {sessions} session{'s' if sessions > 1 else ''}" if sessions else ""
    yield f"{artefact.kind}: {frame.height:,} rows{counted}, {frame.width} columns"
    if artefact.kind == "raw" and (rare := _rare(artefact)):
        yield rare
    if record.seed is not None:
        yield f"seed {record.seed}"
    if record.vehicle is not None:
        yield f"vehicle {vehicle.parse(record.vehicle).name}"
    if record.model is not None:
        yield from _network(record.model)


def _network(model: dict[str, Any]) -> Iterator[str]:
    """Yield two lines on a residual model or a policy, from the description in its footer."""
    kept = {name: value for name, value in model.items() if name not in ("training", "architecture")}
    layers = model.get("architecture")
    if isinstance(layers, dict):
        yield f"model {model.get('name', '')}: {_named(layers)}"
    else:
        yield f"network: {_named(kept)}"
    if isinstance(training := model.get("training"), dict):
        yield f"trained: {_named(training)}"


def _lineage(artefact: Artefact) -> Tree:
    """Return the lineage: the artefact, its inputs, and their inputs in turn."""
    from rich.text import Text
    from rich.tree import Tree

    from hydro.io import provenance

    trees: dict[int, Tree] = {}
    for depth, node in provenance.lineage(artefact.provenance):
        stage = f" by {node.stage} {_named(node.parameters)}".rstrip() if node.stage else ""
        content = node.content[:SHORT] if depth else node.content
        line = Text.assemble((node.kind, "bold"), stage, "\n", (content, "dim"))
        trees[depth] = trees[depth - 1].add(line) if depth else Tree(line)
    return trees[0]


def _named(values: dict[str, Any]) -> str:
    """Return parameters as `name=value` texts; of a long list only its length."""
    short = {
        name: f"[{len(value)}]" if isinstance(value, list) and len(value) > 6 else value
        for name, value in values.items()
    }
    return ", ".join(f"{name}={value}" for name, value in short.items() if value != "")


COMMANDS = {
    check: "hydro check datasets/stonefish/sample.parquet datasets/stonefish/vehicle.toml",
    show: "hydro show datasets/stonefish/sample.parquet",
}
