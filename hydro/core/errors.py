"""The errors a user can meet; the shell maps each to an exit code and prints its one line."""

from __future__ import annotations

import shlex
from collections.abc import Sequence


class HydroError(Exception):
    """Any error with one clear line for the user: what, where, what to do."""

    exit_code = 1


class HydroWarning(UserWarning):
    """Something in the data that is possible and yet likely wrong: one line, which the shell prints once."""


class HydroNotice(HydroWarning):
    """Something that the user should know and need not act on: one line, which the shell prints once."""


class DataError(HydroError):
    """The data or the file is at fault (exit code 1)."""


class UsageError(HydroError):
    """The command was called wrongly (exit code 2)."""

    exit_code = 2


def shown(text: str) -> str:
    """A text as it may stand in an error line: in quotes and escaped where it would break the line."""
    return text if text.isprintable() else repr(text)


def listed(words: Sequence[str], last: str = "and") -> str:
    """Return words in a sentence: `a, b and c`."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def in_shell(text: str) -> str:
    """Return a text as one word of a command that an error line suggests."""
    return shlex.quote(text) if text.isprintable() else shown(text)
