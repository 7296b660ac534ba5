"""TOML text, whole files and single values, to plain content: the one place where it is taken apart."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from hydro.core.errors import DataError
from hydro.core.nesting import DEEPEST, too_deep

_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_LONG_KEY = re.compile(rf"(?:^[ \t]*+\[{{0,2}}|[{{,])[ \t]*+(?:{_PART}){{{DEEPEST}}}", re.M)
"""Dotted key of too many parts.  `tomllib` takes a minute for one of 40,000, so it must not see it."""
_TOO_DEEP = f"nested more than {DEEPEST} tables or lists deep: write a flatter file"
INTEGERS = range(-(2**63), 2**63)
"""What TOML 1.0 promises to hold; beyond it a reader must refuse, and no physical quantity is."""


def content(text: str) -> dict[str, Any]:
    """The content of a TOML document.

    Raises:
        DataError: It is not TOML, is nested too deeply, or has an integer of more than 64 bits.
    """
    if _LONG_KEY.search(text):
        raise DataError(_TOO_DEEP)
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"not valid TOML: {error}") from error
    except RecursionError:
        raise DataError(_TOO_DEEP) from None
    except ValueError:  # Python gives up on some thousand digits
        raise DataError("not valid TOML: an integer has thousands of digits: correct it") from None
    if too_deep(found):
        raise DataError(_TOO_DEEP)
    _require_integers(found)
    return found


def value(text: str) -> Any:
    """One value in TOML, such as `{mass = 2.0}`.

    Raises:
        DataError: As for `content`.
    """
    return content(f"value = {text}")["value"]


def _require_integers(found: Any, path: str = "") -> None:
    """Refuse integers that TOML does not have, by their place."""
    if isinstance(found, dict):
        for key, inner in found.items():
            _require_integers(inner, f"{path}.{key}" if path else key)
    elif isinstance(found, list):
        for index, inner in enumerate(found):
            _require_integers(inner, f"{path}[{index}]")
    elif isinstance(found, int) and found not in INTEGERS:
        raise DataError(f"{path}: an integer of more than 64 bits: write a number that can be, such as 1.5e3")
