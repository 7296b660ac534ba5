"""Where a command writes: looked at before it reads or computes anything.

A place that cannot be written to is worth knowing of before an hour's work and not after it, and a command
that is refused leaves nothing behind.  A folder of results is made and held while the command runs
(`io.lock`): two at once would mix theirs.
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
    """Says of an option, in its `Annotated`, that the command writes there.

    Attributes:
        folder: Into a folder, which is made where it is missing; else one file, in a folder that is there.
        like: An argument: where it is a dataset, a folder of sessions, the command writes one too.
        where: And that only where this option is given; always by default.
    """

    folder: bool = False
    like: str = ""
    where: str = ""

    def to_folder(self, given: Mapping[str, Any]) -> bool:
        """Whether it is a folder that a command writes into which is called like this."""
        if self.folder or not self.like or (self.where and not given[self.where]):
            return self.folder
        return any(_is_dataset(one) for one in _each(given[self.like]))


FILE, FOLDER = Writes(), Writes(folder=True)
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
    """The command, which first refuses places that it could not write to, and holds its folders."""

    @functools.wraps(command)
    def run(**given: Any) -> None:
        refuse(command, given)
        with contextlib.ExitStack() as held:
            for folder in _folders(command, given):
                held.enter_context(_alone(folder))
            command(**given)

    return run


def refuse(command: Callable[..., None], given: Mapping[str, Any]) -> None:
    """Look at every place that a command is to write to.

    Args:
        command: The command.
        given: What it is called with.

    Raises:
        DataError: a file's folder is missing, cannot be written to, or the place is of the other kind.
        UsageError: two results are to go into one file, or one over an input.
    """
    from hydro.io.files import check_file, check_folder

    marks = _marks(command)
    outputs = {name: given[name] for name in marks if given.get(name) not in (None, STREAM)}
    folders = {name for name, mark in marks.items() if mark.to_folder(given)}
    for name, place in outputs.items():
        (check_folder if name in folders else check_file)(place)
        if name in folders and any(_is_dataset(one) and same(one, place) for one in _inputs(given, outputs)):
            raise UsageError(f"{place}: this is the input, and would be lost: name another folder")
    files = {name: os.path.realpath(place) for name, place in outputs.items() if name not in folders}
    for name, path in files.items():
        if os.path.exists(path) and not os.path.isfile(path):
            continue  # a device or a pipe takes as much as it is given
        if any(path == other for another, other in files.items() if another != name):
            raise UsageError(f"{outputs[name]}: two results are to go there: name a file for each")
        if path in {os.path.realpath(one) for one in _inputs(given, outputs)}:
            raise UsageError(f"{outputs[name]}: this is an input, and would be lost: name another file")


def _folders(command: Callable[..., None], given: Mapping[str, Any]) -> list[str]:
    """The folders that a command is to write into, each once."""
    marked = {
        name: mark for name, mark in _marks(command).items() if given.get(name) not in (None, STREAM, "")
    }
    named = [given[name] for name, mark in marked.items() if mark.to_folder(given)]
    return list({os.path.realpath(one): str(one) for one in named}.values())


def _alone(folder: str) -> AbstractContextManager[None]:
    """See `io.lock.alone`; imported by the commands alone that write into folders."""
    from hydro.io.lock import alone

    return alone(folder)


@functools.cache
def _marks(command: Callable[..., None]) -> dict[str, Writes]:
    """The parameters of a command that are places to write to."""
    hints = get_type_hints(command, include_extras=True)
    found = {name: [one for one in get_args(hint) if isinstance(one, Writes)] for name, hint in hints.items()}
    return {name: marks[0] for name, marks in found.items() if marks}


def _inputs(given: Mapping[str, Any], outputs: Mapping[str, Any]) -> Iterator[str]:
    """Everything else that a command is given and that could be a file."""
    for name, value in given.items():
        if name not in outputs:
            yield from (str(one) for one in _each(value) if isinstance(one, str | Path))


def _is_dataset(place: object) -> bool:
    """See `io.partitions.is_dataset`; imported for folders alone."""
    if not isinstance(place, str | Path) or not os.path.isdir(place):
        return False
    from hydro.io.partitions import is_dataset

    return is_dataset(place)


def same(one: str | Path, other: str | Path) -> bool:
    """Whether two paths lead to one place."""
    return os.path.realpath(one) == os.path.realpath(other)


def _each(value: Any) -> list[Any]:
    """A value, or the values of a list."""
    return list(value) if isinstance(value, list | tuple) else [value]
