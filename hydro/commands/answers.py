"""Options `--text`, `--details` and `--json`: the stream on which a command prints its answer."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hydro.commands.shell import STREAM
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from hydro.report.following import Call
    from hydro.report.screen import Text

AsText = Annotated[
    bool, typer.Option("--text", help="Print the answer to stdout, also into a pipe or a file.")
]
Details = Annotated[bool, typer.Option("--details", help="Print all tables: values, tests, every horizon.")]


@dataclass(frozen=True)
class Printing:
    """Choice of the streams and files to which a command writes its answer.

    Attributes:
        output: File of the command's result table; `-` is stdout.
        text: Whether the answer always goes to stdout.
        json: Whether JSON goes to stdout.
        folder: Whether the output is a folder, so that nothing else is written to stdout.

    Raises:
        UsageError: Both text and JSON are requested.
    """

    output: str
    text: bool = False
    json: bool = False
    folder: bool = False

    def __post_init__(self) -> None:
        """Refuse two answers on one stream."""
        if self.text and self.json:
            raise UsageError("--text and --json both write to stdout: choose one")

    @property
    def saves(self) -> bool:
        """Whether the result table is written: to a file, or to a pipe that takes neither text nor JSON."""
        return self.output != STREAM or not (self.text or self.json or sys.stdout.isatty())

    @property
    def brief(self) -> bool:
        """Whether only the headline is printed, on stderr, because the table goes into a pipe."""
        return self.saves and self.output == STREAM

    @property
    def console(self) -> Console:
        """Console for the answer: stdout with --text and on a terminal, otherwise stderr."""
        from rich.console import Console

        aside = not self.text and (self.json or not sys.stdout.isatty())
        return Console(stderr=aside, highlight=False, markup=False)

    def headline(self, text: str) -> None:
        """Print a text on stderr, as the headline of an answer."""
        typer.echo(text, err=True)


def print_lines(lines: Iterable[Text], console: Console) -> None:
    """Print the lines of an answer, each without further wrapping.

    Args:
        lines: Lines of text; a line may be bold.
        console: Console to print on.
    """
    for line in lines:
        console.print(line.text, style="bold" if line.bold else None, soft_wrap=True)


def called_with(vehicle: Path, measured: Sequence[str] | None, output: str = STREAM, **options: Any) -> Call:
    """Return a record of a command's arguments, from which the answer forms the commands to run next.

    Args:
        vehicle: Vehicle file.
        measured: Recordings; None for stdin.
        output: File of the answer.
        options: Options by their Python name, such as `correct_thrusters`; `map_` is `--map`.
    """
    from hydro.report.following import Call

    named: Mapping[str, Any] = {
        f"--{name.strip('_').replace('_', '-')}": value for name, value in options.items()
    }
    return Call(vehicle, tuple(measured or ()), named, output)
