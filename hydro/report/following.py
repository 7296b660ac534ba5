"""Next commands of an answer, ready to be pasted, with the files and options of the first command."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from hydro.core.errors import in_shell

STREAM = "-"
"""Argument that means stdin or stdout."""
PIPE = "|"
"""Word that joins two commands."""
INDENT = "    "
"""Indentation of a printed command, which separates it from text."""
CONTINUED = 2
"""Number of columns for ` \\` at the end of a continued line."""


@dataclass(frozen=True)
class Call:
    """The command that was run: those of its arguments that the next command needs.

    Attributes:
        vehicle: Vehicle file.
        measured: Recording, or the logs of one dive; empty for stdin.
        options: Values of the options for reading recordings, by their name; lists are repeated options, and
            `True` is a flag.
        output: File of the answer; `-` if it was not saved.
    """

    vehicle: Path
    measured: Sequence[str]
    options: Mapping[str, Any] = field(default_factory=dict)
    output: str = STREAM

    @property
    def repeatable(self) -> bool:
        """Whether the command can be run again: stdin can be read only once."""
        return bool(self.measured) and STREAM not in self.measured

    def command(self, name: str, *more: str, without: Sequence[str] = ()) -> list[str]:
        """Return the words of another command on the same inputs.

        Args:
            name: Name of the command.
            more: Words to append.
            without: Options that the command does not have.
        """
        words = ["hydro", name, str(self.vehicle), *self.measured]
        for option, value in self.options.items():
            if option in without or value in (None, False) or value == []:
                continue
            for one in value if isinstance(value, list | tuple) else [value]:
                words += [option] if one is True else [option, str(one)]
        return [*words, *more]

    def adding(self, *effects: str, into: str = "") -> list[str] | None:
        """Return the words of the `hydro add` command for all confirmed findings, or for the named effects.

        Args:
            effects: Effects to add; empty for all confirmed findings.
            into: End of the name of the new file, `vehicle-payload.toml` for `payload`; empty for a number.

        Returns:
            The words; None if the diagnosis was not saved and cannot be repeated.
        """
        named = [word for effect in effects for word in ("--effect", effect)]
        target = ["-o", next_file(self.vehicle, into)]
        if self.output != STREAM:
            return ["hydro", "add", str(self.vehicle), self.output, *named, *target]
        if not self.repeatable:
            return None
        return [*self.command("diagnose"), PIPE, "hydro", "add", str(self.vehicle), *named, *target]

    def flipping(self, thrusters: Sequence[int]) -> list[str]:
        """Return the words of the `hydro vehicle flip` command that reverses thrusters.

        Args:
            thrusters: Indices of the thrusters, counted from 0.
        """
        numbers = ",".join(str(one + 1) for one in thrusters)
        target = ["-o", next_file(self.vehicle)]
        return ["hydro", "vehicle", "flip", str(self.vehicle), "--thruster", numbers, *target]

    def fitting(self, *effects: str) -> list[str] | None:
        """Return the words of the `hydro fit` command that fits effects to the recording before a change.

        Args:
            effects: Effects to fit.

        Returns:
            The words; None if there is no such recording, or it came from stdin.
        """
        before = self.options.get("--before")
        earlier = [str(one) for one in (before if isinstance(before, list | tuple) else [before]) if one]
        if not earlier or STREAM in earlier:
            return None
        reading = {name: self.options.get(name) for name in ("--map", "--msg")}
        named = [word for effect in effects for word in ("--effect", effect)]
        target = ["-o", next_file(self.vehicle, "fitted")]
        return replace(self, measured=earlier, options=reading).command("fit", *named, *target)

    def designing(self) -> list[str] | None:
        """Return the words of `hydro diagnose --next-run`; None if the inputs cannot be read again."""
        kept = "diagnosis.parquet" if self.output == STREAM else self.output
        return self.again("diagnose", "--next-run", "next.parquet", "-o", kept)

    def again(self, name: str, *more: str, without: Sequence[str] = ()) -> list[str] | None:
        """Return the words of another command on the same inputs; None if they cannot be read again.

        Args:
            name: Name of the command.
            more: Words to append.
            without: Options that the command does not have.
        """
        return self.command(name, *more, without=without) if self.repeatable else None

    def of(self, vehicle: Path) -> Call:
        """Return a copy of this call with another vehicle file.

        Args:
            vehicle: Path of the vehicle file.
        """
        return replace(self, vehicle=vehicle)


def next_file(vehicle: Path, into: str = "") -> str:
    """Return a name for a new vehicle file that is free in the working folder: `vehicle-1.toml`.

    Args:
        vehicle: Vehicle file.
        into: End of the name instead of a number, as in `vehicle-payload.toml`.
    """
    stem, number = vehicle.stem, 0
    if into and not Path(name := f"{stem}-{into}.toml").exists():
        return name
    stem += f"-{into}" * bool(into)
    if found := re.fullmatch(r"(.*)-(\d+)", stem):
        stem, number = found[1], int(found[2])
    while Path(name := f"{stem}-{number + 1}.toml").exists():
        number += 1
    return name


def quoted(words: Sequence[str]) -> list[str]:
    """Return the words of a command quoted for a shell; the word `|`, which joins two commands, stays."""
    return [one if one == PIPE else in_shell(one) for one in words]


def pasted(words: Sequence[str], width: int, indent: str = INDENT) -> Iterator[str]:
    """Yield the lines of a command, each at most as wide as the terminal, that a shell reads as one command.

    Only a single word can be wider. An option and its value stay on one line.

    Args:
        words: Quoted words.
        width: Columns of the terminal.
        indent: Indentation of each line.
    """
    units: list[str] = []
    for word in words:
        if units and units[-1].startswith("-") and " " not in units[-1] and word[0] not in f"-{PIPE}":
            units[-1] += f" {word}"
        else:
            units.append(word)
    line = ""
    for unit in units:
        begin = f"{line} " if line else indent
        if line.endswith(f" {PIPE}"):  # a shell reads on after a pipe
            yield line
            begin = indent
        elif line and len(begin) + len(unit) + CONTINUED > width:
            yield f"{line} \\"
            begin = f"{indent}  "
        line = begin + unit
    yield line
