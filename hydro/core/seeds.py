"""Which numbers are seeds: those that every generator takes, torch's of 64 bits too."""

from __future__ import annotations

from hydro.core.errors import UsageError

LARGEST = 2**64 - 1


def check(seed: int) -> None:
    """Refuse what is no seed, before anything else is done.

    Raises:
        UsageError: It is below 0 or has more than 64 bits.
    """
    if not 0 <= seed <= LARGEST:
        raise UsageError(f"seed is {seed:.6g}; give one from 0 to 2^64 - 1")
