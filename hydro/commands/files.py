"""`check` and `show`: is a file sound, and what is in it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hydro.commands.shell import STREAM, print_table, read
from hydro.core.errors import DataError

if TYPE_CHECKING:
    import polars as pl

    from hydro.io.table import Artefact

Files = Annotated[list[str], typer.Argument(metavar="FILE", help="Artefacts and vehicle files; - is stdin.")]
File = Annotated[
    str, typer.Argument(metavar="FILE", show_default=False, help="An artefact; nothing or - is stdin.")
]
WHOLE = 60
"""Tables of at most this many rows are shown whole."""


def check(files: Files) -> None:
    """Say whether artefacts and vehicle files are sound.

    Silent, with exit code 0, when every file keeps its schema: columns, types, finite values, bounds, order
    in time, and a content that its footer's hash confirms. Otherwise one line for each file that does not.
    """
    unsound = 0
    for file in files:
        try:
            _check(file)
        except DataError as error:
            typer.echo(f"hydro: {error}", err=True)
            unsound += 1
    if unsound:
        raise typer.Exit(1)


def _check(file: str) -> None:
    """Read one file as what it is: a vehicle file by its suffix, else an artefact."""
    from hydro.core import effects, segments
    from hydro.io import vehicle

    if Path(file).suffix == ".toml":
        effects.validate(vehicle.read(file)[0])
        return
    artefact = read(file)
    if artefact.kind == "raw":
        segments.segments(artefact.frame)


def show(file: File = STREAM) -> None:
    """Show where an artefact comes from and what is in it.

    On a terminal: kind, stage and parameters, lineage, and every column with unit and range; small tables
    such as metrics whole. Into a pipe the same as JSON.
    """
    artefact = read(file)
    if sys.stdout.isatty():
        _print_page(artefact)
    else:
        import msgspec

        described = msgspec.to_builtins(artefact.provenance) | {"columns": columns(artefact).to_dicts()}
        typer.echo(msgspec.json.format(msgspec.json.encode(described), indent=2).decode())


def columns(artefact: Artefact) -> pl.DataFrame:
    """One row per column of an artefact: storage type, unit, frame, smallest and largest value, meaning."""
    import polars as pl

    from hydro.io import schema

    fields = schema.load(artefact.kind).columns(artefact.frame.columns)
    numbers = [name for name in fields if artefact.frame.schema[name].is_numeric()]
    low, high = (
        pl.concat([artefact.frame.select(pl.col(numbers).cast(pl.Float64)).select(extreme)]).to_dicts()[0]
        for extreme in (pl.all().min(), pl.all().max())
    )
    return pl.DataFrame(
        {
            "column": list(fields),
            "type": [schema.storage_type(artefact.frame.schema[name]) for name in fields],
            "unit": [field.unit for field in fields.values()],
            "frame": [field.frame for field in fields.values()],
            "min": [low.get(name) for name in fields],
            "max": [high.get(name) for name in fields],
            "description": [field.description for field in fields.values()],
        }
    )


def _print_page(artefact: Artefact) -> None:
    """Print an artefact for a person."""
    from rich.console import Console
    from rich.tree import Tree

    from hydro.io import provenance

    record, frame, console = artefact.provenance, artefact.frame, Console(highlight=False)
    sessions = f" in {frame['session'].n_unique()} sessions" if "session" in frame.columns else ""
    console.print(f"[bold]{artefact.kind}[/bold]: {frame.height:,} rows{sessions}, {frame.width} columns")
    if record.seed is not None:
        console.print(f"seed {record.seed}")
    if record.vehicle is not None:
        from hydro.io import vehicle

        console.print(f"vehicle {vehicle.parse(record.vehicle).name}")
    if record.model is not None:
        console.print(f"model {record.model['name']}: {_named(record.model['architecture'])}")
    trees: dict[int, Tree] = {}
    for depth, node in provenance.lineage(record):
        stage = f" by {node.stage} {_named(node.parameters)}".rstrip() if node.stage else ""
        line = f"{node.kind}{stage}\n[dim]{node.content}[/dim]"
        trees[depth] = trees[depth - 1].add(line) if depth else Tree(line)
    console.print(trees[0])
    if frame.height <= WHOLE and artefact.kind != "model":
        print_table(frame, "")
    else:
        print_table(columns(artefact).drop("description"), "")


def _named(values: dict[str, Any]) -> str:
    """Parameters in a few words; long lists by their length."""
    short = {
        name: f"[{len(value)}]" if isinstance(value, list) and len(value) > 6 else value
        for name, value in values.items()
    }
    return ", ".join(f"{name}={value}" for name, value in short.items() if value != "")


COMMANDS = {
    check: "hydro check datasets/stonefish/sample.parquet datasets/stonefish/vehicle.toml",
    show: "hydro show datasets/stonefish/sample.parquet",
}
