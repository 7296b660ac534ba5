"""Valid range of seeds: numbers that every generator accepts, including the 64 bits of torch."""

from __future__ import annotations

from hydro.core.errors import UsageError

LARGEST = 2**64 - 1  # greatest seed that torch accepts


def check(seed: int) -> None:
    """Check that a seed is from 0 to LARGEST, so that every random generator accepts the number.

    Raises:
        UsageError: The seed is below 0 or has more than 64 bits.
    """
    if not 0 <= seed <= LARGEST:
        raise UsageError(f"seed is {seed:.6g}; give one from 0 to 2^64 - 1")
