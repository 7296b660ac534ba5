"""Shares with their 95 % intervals (Clopper and Pearson 1934)."""

from __future__ import annotations

from collections.abc import Iterable

from scipy.stats import beta


def interval(hits: int, count: int) -> tuple[float, float]:
    """Return the ends of the 95 % interval of a share, both between 0 and 1."""
    low = float(beta.ppf(0.025, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.975, hits + 1, count - hits)) if hits < count else 1.0
    return low, high


def rate(values: Iterable[bool]) -> str:
    """Return a share in words, `95.0 % [83.1, 99.4] (38 of 40)`; `-` where there are no values."""
    told = list(values)
    if not told:
        return "-"
    hits, count = sum(told), len(told)
    low, high = interval(hits, count)
    return f"{100 * hits / count:.1f} % [{100 * low:.1f}, {100 * high:.1f}] ({hits} of {count})"
