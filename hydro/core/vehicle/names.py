"""Names in a vehicle file: they become identifiers, XML attributes, topics and file names elsewhere."""

from __future__ import annotations

import re
from collections.abc import Mapping

from hydro.core.errors import DataError, shown

PATTERN = r"""^\w[\w .+()'"-]{0,79}$"""
"""Names that every export format can hold as they are, at most 80 characters long: a line of a table."""
ALLOWED = "letters, digits, spaces and . _ + - ( ) ' \", at most 80, the first a letter, a digit or _"
"""The same in words."""
_NAME = re.compile(PATTERN)


def require(named: Mapping[str, str]) -> None:
    """Refuse names that break the rule.

    Args:
        named: Names by their paths in the vehicle file.

    Raises:
        DataError: A name has a character that is not allowed, or is too long; the line says where.
    """
    for path, name in named.items():
        if not _NAME.fullmatch(name):
            short = name if len(name) <= 40 else f"{name[:40]}..."
            raise DataError(f"{path}: must be {ALLOWED}, got {shown(short)}")


def usable_name(text: str) -> str:
    """Return a text with `-` for every character that a name may not have."""
    name = re.sub(r"""[^\w .+()'"-]""", "-", text)[:80]
    return name if _NAME.fullmatch(name) else f"_{name}"[:80]
