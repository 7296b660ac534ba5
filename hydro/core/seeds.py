"""Valid range of seeds: numbers that every generator accepts, including the 64 bits of torch."""

from __future__ import annotations

from hydro.core.errors import UsageError

LARGEST = 2**64 - 1  # greatest seed that torch accepts


def check(seed: int) -> None:
    """Check a seed before any other work.

    Raises:
        UsageError: It is below 0 or has more than 64 bits.
    """
    if not 0 <= seed <= LARGEST:
        raise UsageError(f"seed is {seed:.6g}; give one from 0 to 2^64 - 1")
