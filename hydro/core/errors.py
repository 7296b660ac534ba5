"""Errors for the user; the command line maps each to an exit code and prints its one line."""

from __future__ import annotations

import shlex
from collections.abc import Sequence


class HydroError(Exception):
    """Base class of errors for the user; the message is one line: where, problem and remedy."""

    exit_code = 1


class HydroWarning(UserWarning):
    """Warning of something in the data that is possible but probably wrong: one line, printed once."""


class HydroNotice(HydroWarning):
    """Notice that requires no action by the user: one line, printed once."""


class DataError(HydroError):
    """Fault of the data or of a file (exit code 1)."""


class UsageError(HydroError):
    """Wrong use of a command (exit code 2)."""

    exit_code = 2


def shown(text: str) -> str:
    """Return a text for an error line: as it is, or quoted if it is empty or a character is not printable."""
    return text if text and text.isprintable() else repr(text)


def listed(words: Sequence[str], last: str = "and") -> str:
    """Return words as one enumeration, such as `a, b and c`; `last` is the word before the last one."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {last} {words[-1]}"


def in_shell(text: str) -> str:
    """Return a text quoted as one word of a shell command, for a command that an error line suggests."""
    return shlex.quote(text) if text.isprintable() else repr(text)
