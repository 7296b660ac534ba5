"""Check of the output files and folders of a command, before it reads or computes anything.

A file that cannot be written is reported before an hour's work and not after it, and a refused command writes
nothing.  A folder of results is made and locked while the command runs (`io.lock`), so that two commands do
not mix their results.
"""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import typer

from hydro.commands.shell import STREAM
from hydro.core.errors import UsageError


@dataclass(frozen=True)
class Writes:
    """Mark, in the `Annotated` of an option, of a file or folder to which the command writes.

    Attributes:
        folder: Whether it is a folder, which is made if it is missing; else one file in an existing folder.
        holds: Kind of content of the folder, a key of `MARKS`; a folder with another kind is refused.
        like: Name of an argument: if that is a folder of sessions, the command writes such a folder too.
        where: Name of an option: `like` applies only if this option is given; by default `like` always
            applies.
    """

    folder: bool = False
    holds: str = ""
    like: str = ""
    where: str = ""

    def to_folder(self, given: Mapping[str, Any]) -> bool:
        """Return whether a command with given arguments writes into a folder at this option.

        Args:
            given: Arguments of the command by name.
        """
        if self.folder or not self.like or (self.where and not given[self.where]):
            return self.folder
        return any(_is_dataset(one) for one in _each(given[self.like]))


MARKS = {"a study": "ladder.parquet", "a training": "run.parquet", "sessions": "session=*"}
"""Contents of folders, and the file or folder by which each is recognised."""

FILE, FOLDER = Writes(), Writes(folder=True)
STUDY, TRAINING, SESSIONS = (Writes(folder=True, holds=what) for what in MARKS)
Output = Annotated[
    str,
    typer.Option("--output", "-o", metavar="FILE", show_default=False, help="Output file; - is stdout."),
    FILE,
]


SessionsOutput = Annotated[
    str,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        show_default=False,
        help="Output file, of a folder of sessions a folder; - is stdout.",
    ),
    Writes(like="raw"),
]
EachOutput = Annotated[
    str,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        show_default=False,
        help="Output file, with --each a folder; - is stdout.",
    ),
    Writes(like="measured", where="each"),
]


def checked(command: Callable[..., None]) -> Callable[..., None]:
    """Return a version of a command that first checks its output places and locks its output folders.

    Args:
        command: Function of the command; its options for outputs are marked with `Writes`.
    """

    @functools.wraps(command)
    def run(**given: Any) -> None:
        refuse(command, given)
        with contextlib.ExitStack() as held:
            for folder in _folders(command, given):
                held.enter_context(_alone(folder))
            command(**given)

    return run


def refuse(command: Callable[..., None], given: Mapping[str, Any]) -> None:
    """Raise an error if a command cannot write one of its files and folders, or must not.

    Args:
        command: Function of the command; its options for outputs are marked with `Writes`.
        given: Arguments of the command by name.

    Raises:
        DataError: A folder is missing or cannot be written to, or a folder is given for a file or vice versa.
        UsageError: Two results would go into one file, or a result would replace an input.
    """
    from hydro.io.files import check_file, check_folder

    marks = _marks(command)
    outputs = {name: given[name] for name in marks if given.get(name) not in (None, STREAM)}
    folders = {name for name, mark in marks.items() if mark.to_folder(given)}
    for name, place in outputs.items():
        (check_folder if name in folders else check_file)(place)
        if name in folders:
            _refuse_other_contents(place, marks[name].holds)
        if name in folders and any(_is_dataset(one) and same(one, place) for one in _inputs(given, outputs)):
            raise UsageError(f"{place}: this is the input, and would be lost: name another folder")
    files = {name: os.path.realpath(place) for name, place in outputs.items() if name not in folders}
    for name, path in files.items():
        if os.path.exists(path) and not os.path.isfile(path):
            continue  # a device or a pipe can take several results
        if any(path == other for another, other in files.items() if another != name):
            raise UsageError(f"{outputs[name]}: two results are to go there: name a file for each")
        if path in {os.path.realpath(one) for one in _inputs(given, outputs)}:
            raise UsageError(f"{outputs[name]}: this is an input, and would be lost: name another file")


def _refuse_other_contents(folder: str | Path, holds: str) -> None:
    """Refuse a folder in which another kind of command keeps its results.

    Args:
        folder: Folder of results; it may be missing.
        holds: Kind of content of the command, a key of `MARKS`; "" allows any folder.
    """
    for what, mark in MARKS.items():
        if holds and what != holds and (found := next(Path(folder).glob(mark), None)):
            raise UsageError(f"{folder}: holds {what} ({found.name}): name another folder")


def _folders(command: Callable[..., None], given: Mapping[str, Any]) -> list[str]:
    """Return the folders into which a command would write, each once."""
    marked = {
        name: mark for name, mark in _marks(command).items() if given.get(name) not in (None, STREAM, "")
    }
    named = [given[name] for name, mark in marked.items() if mark.to_folder(given)]
    return list({os.path.realpath(one): str(one) for one in named}.values())


def _alone(folder: str) -> AbstractContextManager[None]:
    """Lock a folder, see `io.lock.alone`; imported only by commands that write into folders."""
    from hydro.io.lock import alone

    return alone(folder)


@functools.cache
def _marks(command: Callable[..., None]) -> dict[str, Writes]:
    """Return the marks of those parameters of a command that are output places, by parameter."""
    hints = get_type_hints(command, include_extras=True)
    found = {name: [one for one in get_args(hint) if isinstance(one, Writes)] for name, hint in hints.items()}
    return {name: marks[0] for name, marks in found.items() if marks}


def _inputs(given: Mapping[str, Any], outputs: Mapping[str, Any]) -> Iterator[str]:
    """Yield the arguments of a command that can be input files: texts and paths that are no outputs."""
    for name, value in given.items():
        if name not in outputs:
            yield from (str(one) for one in _each(value) if isinstance(one, str | Path))


def _is_dataset(place: object) -> bool:
    """Return whether a place is a folder of sessions, see `io.partitions.is_dataset`."""
    if not isinstance(place, str | Path) or not os.path.isdir(place):
        return False
    from hydro.io.partitions import is_dataset

    return is_dataset(place)


def same(one: str | Path, other: str | Path) -> bool:
    """Return whether two paths lead to the same file or folder."""
    return os.path.realpath(one) == os.path.realpath(other)


def _each(value: Any) -> list[Any]:
    """Return the values of a list, or a single value as a list."""
    return list(value) if isinstance(value, list | tuple) else [value]
