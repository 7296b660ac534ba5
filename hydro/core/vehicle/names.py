"""Rule for names in a vehicle file, which become identifiers, XML attributes, topics and file names."""

from __future__ import annotations

import re
from collections.abc import Mapping

from hydro.core.errors import DataError, shown

PATTERN = r"""^\w[\w .+()'"-]{0,79}$"""
"""Pattern of names that every export format supports, at most 80 characters so that they fit into tables."""
ALLOWED = "letters, digits, spaces and . _ + - ( ) ' \", at most 80, the first a letter, a digit or _"
"""The rule for names in words."""
_NAME = re.compile(PATTERN)


def require(named: Mapping[str, str]) -> None:
    """Raise an error if a name in a vehicle file violates the rule for names, ALLOWED.

    Args:
        named: Names by their paths in the vehicle file.

    Raises:
        DataError: A name has a character that is not allowed, or is too long; the message contains the path.
    """
    for path, name in named.items():
        if not _NAME.fullmatch(name):
            short = name if len(name) <= 40 else f"{name[:40]}..."
            raise DataError(f"{path}: must be {ALLOWED}, got {shown(short)}")


def usable_name(text: str) -> str:
    """Return `text` as a name that a vehicle file allows.

    Every character that is not allowed becomes `-`, and the name ends after 80 characters.
    """
    name = re.sub(r"""[^\w .+()'"-]""", "-", text)[:80]
    return name if _NAME.fullmatch(name) else f"_{name}"[:80]
