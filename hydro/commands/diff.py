"""Command `diff`: differences of two vehicle files, in words and in their predictions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hydro.commands.as_json import Json, print_json
from hydro.commands.recordings import MaxExpanded
from hydro.commands.shell import about, read
from hydro.commands.tables import print_table


def diff(
    first: Annotated[Path, typer.Argument(metavar="VEHICLE", show_default=False, help="Vehicle file.")],
    second: Annotated[
        Path,
        typer.Argument(metavar="VEHICLE2", show_default=False, help="Vehicle file to compare it with."),
    ],
    on: Annotated[
        str | None,
        typer.Option(
            "--on",
            metavar="RAW",
            help="Recording for the errors; default: manoeuvres.",
        ),
    ] = None,
    max_expanded: MaxExpanded = None,
    as_json: Json = False,
) -> None:
    """Compare two vehicle files and what they predict.

    Each row is a part that differs: both values, and the error 5 s ahead of VEHICLE2 with the value of
    VEHICLE. Without --on, twenty manoeuvres are simulated with VEHICLE2, which counts as the truth.

        hydro diff vehicle.toml vehicle-1.toml --on raw.parquet

    Details:

    The first row is VEHICLE2 itself, the last VEHICLE. The error is the root mean square of the velocity,
    axes weighted by inertia, as in hydro compare. Standard errors and `known` make no difference.
    """
    from hydro.core.difference.changes import table
    from hydro.io import vehicle as vehicles

    one, other = (vehicles.read(file)[0] for file in (first, second))
    raw = None if on is None else read(on, "raw").frame
    with about(str(second) if on is None else on):
        found = table(one, other, raw)
    if as_json:
        print_json(changes=found)
    elif found.is_empty():
        typer.echo(f"{first} and {second} say the same")
    else:
        print_table(found, f"{first} -> {second}")


COMMANDS = {
    diff: "hydro diff datasets/hidden/vehicle.toml datasets/stonefish/vehicle.toml",
}
