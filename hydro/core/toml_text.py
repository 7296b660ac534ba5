"""TOML text, whole files and single values, to plain content: the one place where it is taken apart."""

from __future__ import annotations

import tomllib
from typing import Any

from hydro.core.errors import DataError

INTEGERS = range(-(2**63), 2**63)
"""What TOML 1.0 promises to hold; beyond it a reader must refuse, and no physical quantity is."""


def content(text: str) -> dict[str, Any]:
    """The content of a TOML document.

    Raises:
        DataError: It is not TOML, is nested too deeply, or has an integer of more than 64 bits.
    """
    try:
        found = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"not valid TOML: {error}") from error
    except RecursionError:
        raise DataError("not valid TOML: nested too deeply") from None
    except ValueError:  # Python gives up on some thousand digits
        raise DataError("not valid TOML: an integer has thousands of digits: correct it") from None
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
