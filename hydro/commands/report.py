"""Command `report`: a study as one HTML page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from hydro.commands.places import FOLDER, Output
from hydro.commands.recordings import MaxExpanded
from hydro.commands.shell import STREAM
from hydro.core.errors import UsageError


def report(
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="DIR|FILE...",
            show_default=False,
            help="Folder of a study, or its tables; - is stdin.",
        ),
    ] = None,
    pictures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", show_default=False, help="Also draw the figures there, as PNG."),
        FOLDER,
    ] = None,
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    """Write a study as one HTML page.

    The page has the recordings, the errors, the regimes where the model fails, the findings with their
    confidence, and the next run, as far as the given tables contain it. It is one file of 6 MB that needs
    no network.

        hydro report study -o report.html

    Details:

    A table next to each figure has its numbers. For tables made with --before the page names the recording
    that the hull-force model was fitted to, and the changes since.
    """
    from hydro.io.files import write_bytes
    from hydro.report.page import render
    from hydro.report.sources import gather

    if output == STREAM and sys.stdout.isatty():
        raise UsageError(
            "a page is for a browser and stdout is a terminal: add -o report.html, or pipe it on"
        )
    found = gather([sys.stdin.buffer if one == STREAM else one for one in sources or [STREAM]])
    page = render(found).encode()
    if pictures is not None:
        from hydro.report.pictures import draw

        for path in draw(found, pictures):
            typer.echo(path, err=True)
    write_bytes(page, sys.stdout.buffer if output == STREAM else output)
    if output != STREAM and sys.stdout.isatty():
        typer.echo(f"{output}: {len(page) / 1e6:.1f} MB; open it in a browser")


COMMANDS = {
    report: "hydro compare datasets/stonefish/vehicle.toml datasets/stonefish/replay90.parquet | "
    "hydro report -o report.html",
}
