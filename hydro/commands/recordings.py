"""Recordings for commands: raw tables, or logs of any format with their map, which are imported first."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.help import ADVANCED
from hydro.commands.shell import STREAM, message, progress
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    from hydro.io.log import LogFile
    from hydro.io.table import Artefact

Measured = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="MEASURED...",
        show_default=False,
        help="Raw table, folder of sessions, or logs with --map; - is stdin.",
    ),
]
MapFile = Annotated[
    Path | None,
    typer.Option(
        "--map",
        metavar="FILE",
        show_default=False,
        help="Map of the columns of a log, as hydro import writes it.",
    ),
]
Definitions = Annotated[
    Path | None,
    typer.Option(
        "--msg",
        metavar="DIR",
        show_default=False,
        help="Folder with the .msg files of ROS messages.",
        rich_help_panel=ADVANCED,
    ),
]


def _allow(context: typer.Context, gigabytes: float | None) -> None:
    """Limit the decompressed size [GB] of each file that a command reads, until the command ends."""
    from hydro.io.readers.expansion import allowed

    context.with_resource(allowed(gigabytes))


MaxExpanded = Annotated[
    float | None,
    typer.Option(
        "--max-expanded",
        metavar="GB",
        min=0.0,
        show_default=False,
        callback=_allow,
        help="Largest size of a file once decompressed.",
        rich_help_panel=ADVANCED,
    ),
]


@dataclass(frozen=True)
class Logs:
    """Settings for reading the recordings of a command.

    Attributes:
        map: Map of the logs, the meaning of their columns; None if all recordings are raw tables.
        definitions: Folder with `.msg` files, or None.
        vehicle: Vehicle file with which imported logs are checked.
        fill: Whether values of a log are interpolated in rows without a sample.
    """

    map: Path | None = None
    definitions: Path | None = None
    vehicle: Path | None = None
    fill: bool = False

    def read(self, sources: Sequence[str] | None, *kinds: str) -> Artefact:
        """Return the recording of a command as a table, and print the results of an import on stderr.

        Args:
            sources: A table, a folder of sessions or a log, or the logs of one dive; empty for stdin.
            kinds: Admissible kinds of table; `raw` by default.

        Raises:
            DataError: A file is missing, broken or of another kind, violates its schema, or is a log without
                a map that fits it.
            UsageError: Several files are not logs, or stdin is requested but is a terminal.
        """
        from hydro.io import recordings, table

        if (folder := dataset(sources)) is not None:
            return table.read(folder, kinds or ("raw",))
        with opened(sources or [STREAM], self.definitions) as files:
            tables = [file for file in files if recordings.is_artefact(file)]
            if len(files) > 1 and (tables or self.map is None):
                told = f"{tables[0].name} is a table already" if tables else "without --map they are none"
                raise UsageError(f"several files are the logs of one dive: {told}; give one raw table")
            if self.map is None or tables:
                if self.map is not None:
                    message(f"hydro: {files[0].name}: a table already, read without --map")
                return recordings.read(files[0], kinds or ("raw",))
            message(f"{' '.join(file.name for file in files)} by {self.map}:")
            return recordings.imported(
                files, self.map, message, vehicle_file=self.vehicle, fill=self.fill, progress=reading
            )


def dataset(sources: Sequence[str] | None) -> str | None:
    """Return the path of the folder of sessions that a command's recordings are; None for other recordings.

    Args:
        sources: Paths of the recordings.

    Raises:
        UsageError: A folder is combined with other recordings.
    """
    from hydro.io import partitions

    if not sources or not any(partitions.is_dataset(one) for one in sources):
        return None
    if len(sources) > 1:
        raise UsageError("several recordings, one of them a folder of sessions: give the folder alone")
    return sources[0]


def tell_strangers(folder: str, sessions: Iterable[str]) -> None:
    """Print on stderr which sessions of an output folder are from an earlier command.

    Args:
        folder: The output folder.
        sessions: Names of the sessions that this command has written.
    """
    from hydro.io import partitions

    strangers = sorted(set(partitions.sessions(folder)) - set(sessions))
    if strangers:
        named = ", ".join(strangers[:3]) + (f" and {len(strangers) - 3} more" if len(strangers) > 3 else "")
        message(f"hydro: {folder}: earlier sessions stay in this folder: {named}")


def called(sources: Sequence[str] | None) -> str:
    """Return the name of a recording for messages: the path of its first file, or `-` for stdin."""
    return sources[0] if sources else STREAM


@contextmanager
def opened(names: Sequence[str], definitions: Path | None) -> Iterator[list[LogFile]]:
    """Open log files for reading during a `with` block, which gets a list of them.

    Args:
        names: Paths; `-` is stdin.
        definitions: Folder with `.msg` files, or None.
    """
    from hydro.io.log import opened

    with ExitStack() as stack:
        sources = [sys.stdin.buffer if name == STREAM else name for name in names]
        yield [stack.enter_context(opened(source, definitions)) for source in sources]


@contextmanager
def reading(file: LogFile) -> Iterator[Callable[[float], None] | None]:
    """Show a progress bar while a large file is read during a `with` block.

    Yields:
        Function to call with the share that was read; None for a small file, which needs no bar.
    """
    from hydro.io.log_files import LARGE

    if file.size < LARGE:
        yield None
        return
    with progress(f"reading {file.stem}") as update:
        yield lambda share: update(share, 1.0)
