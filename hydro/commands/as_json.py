"""Option `--json`: results for programs."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from hydro.commands.shell import STREAM, shows_table

Json = Annotated[
    bool,
    typer.Option("--json", help="Print JSON to stdout, and the answer to stderr."),
]


def saves(output: str, as_json: bool) -> bool:
    """Return whether a command writes its table: to a file, or to a pipe that does not get JSON.

    Args:
        output: Value of `-o`; `-` is stdout.
        as_json: Whether JSON goes to stdout.
    """
    return output != STREAM or not (as_json or shows_table(output))


def print_json(**said: Any) -> None:
    """Print keyword arguments as one JSON object on stdout.

    Tables become lists of rows, and numbers that are not finite become null.
    """
    from hydro.report.json_text import json_text

    typer.echo(json_text(**said))
