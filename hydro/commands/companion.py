"""Commands `data`: the recordings of the companion distribution deep-hydro-sim-data."""

from __future__ import annotations

from typing import Annotated

import typer

from hydro.commands.shell import progress
from hydro.commands.tables import print_table

NAME = "data"
HELP = "Find and verify the separately installed recordings."


def list_() -> None:
    """List the installed recordings.

    The Stonefish recordings are a distribution of their own, deep-hydro-sim-data. If it is not installed, an
    error line says how to install it. The bundled data in datasets/ need no installation.
    """
    import polars as pl

    from hydro.io import companion

    rows = [
        {
            "name": one.name,
            "rows": one.rows or None,
            "sessions": one.sessions or None,
            "MB": round(one.bytes / 1e6, 2),
            "content": one.about,
        }
        for one in companion.manifest().files
    ]
    print_table(pl.DataFrame(rows, infer_schema_length=None))


def path(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME", show_default=False, help="A recording, such as nominal; the folder by default."
        ),
    ] = None,
) -> None:
    """Print the path of a recording, or of the folder of all recordings.

    Use it in other commands:

        hydro labels "$(hydro data path nominal)" -o labels.parquet
    """
    from hydro.io import companion

    typer.echo(str(companion.folder() if name is None else companion.path_of(name)))


def verify() -> None:
    """Verify the installed recordings by their hashes.

    Compares size and SHA-256 of every file with the manifest, and for tables also the hash of the values.
    Each faulty file is one line on stderr, and the exit code is then 1.
    """
    from hydro.core.errors import DataError
    from hydro.io import companion

    files, faulty = companion.manifest().files, 0
    with progress("verify") as update:
        for number, entry in enumerate(files):
            update(number, len(files), entry.name)
            try:
                found = companion.fault(entry)
            except DataError as error:
                found = str(error)
            if found:
                typer.echo(f"hydro: {entry.name}: {found}", err=True)
                faulty += 1
    if faulty:
        raise typer.Exit(1)
    size = sum(one.bytes for one in files) / 1e6
    typer.echo(f"{len(files)} files, {size:.1f} MB: all as in the manifest")


COMMANDS = {
    list_: "hydro data list",
    path: "hydro data path nominal",
    verify: "hydro data verify",
}
