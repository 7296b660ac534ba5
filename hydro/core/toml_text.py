"""Parser of TOML text, of whole files and of single values."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from hydro.core.errors import DataError
from hydro.core.nesting import DEEPEST, too_deep

_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_LONG_KEY = re.compile(rf"(?:^[ \t]*+\[{{0,2}}|[{{,])[ \t]*+(?:{_PART}){{{DEEPEST}}}", re.M)
"""Pattern of a dotted key with too many parts; `tomllib` takes a minute for one of 40,000 parts."""
_TOO_DEEP = f"nested more than {DEEPEST} tables or lists deep: write a flatter file"
INTEGERS = range(-(2**63), 2**63)
"""Integers of TOML 1.0; a reader must refuse larger ones, and no physical quantity needs them."""


def content(text: str) -> dict[str, Any]:
    """Return the content of a TOML document as nested dicts and lists.

    Raises:
        DataError: The text is not TOML, is nested too deeply, or has an integer of more than 64 bits.
    """
    if _LONG_KEY.search(text):
        raise DataError(_TOO_DEEP)
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"not valid TOML: {error}") from error
    except RecursionError:
        raise DataError(_TOO_DEEP) from None
    except ValueError:  # Python refuses integers of several thousand digits
        raise DataError("not valid TOML: an integer has thousands of digits: correct it") from None
    if too_deep(found):
        raise DataError(_TOO_DEEP)
    _require_integers(found)
    return found


def value(text: str) -> Any:
    """Return one TOML value, such as `{mass = 2.0}`, as a Python value.

    Raises:
        DataError: The text is not a TOML value, is nested too deeply, or has an integer of more than 64 bits.
    """
    return content(f"value = {text}")["value"]


def _require_integers(found: Any, path: str = "") -> None:
    """Refuse integers outside INTEGERS; the error names their path."""
    if isinstance(found, dict):
        for key, inner in found.items():
            _require_integers(inner, f"{path}.{key}" if path else key)
    elif isinstance(found, list):
        for index, inner in enumerate(found):
            _require_integers(inner, f"{path}[{index}]")
    elif isinstance(found, int) and found not in INTEGERS:
        raise DataError(f"{path}: an integer of more than 64 bits: write a smaller number, such as 1.5e3")
