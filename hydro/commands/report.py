"""`report`: a study told on one page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from hydro.commands.places import FOLDER, Output
from hydro.commands.shell import STREAM
from hydro.core.errors import UsageError


def report(
    sources: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="DIR|FILE...",
            show_default=False,
            help="Folder of a study, or comparison, leftover, growth, diagnosis, ladder, replay, sessions "
            "and metrics tables; nothing or - is stdin.",
        ),
    ] = None,
    pictures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", show_default=False, help="Also draw the figures there, as PNG."),
        FOLDER,
    ] = None,
    output: Output = STREAM,
) -> None:
    """Write a study as one HTML page.

    What was recorded, how good the model is, where it fails, what force is left over at which velocity, what
    is missing and how sure that is, what happened when it was added, commands and measured against simulated
    motion, and what to fly next: as far as the given tables contain it. Of tables made with --before it tells
    which recording taught the hull, and what has changed since. The page is one HTML file of some 6 MB that
    needs no network; a table beside each figure has its numbers.
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
