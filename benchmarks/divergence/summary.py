"""Kept table of the study: one row per cell, both networks side by side."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence

from benchmarks.divergence.cells import CELLS, CONDITIONS
from benchmarks.divergence.open_loop import THRUSTED, UNTHRUSTED
from benchmarks.kept_tables import Row

OPEN, TRAINED = "open", "sac"
"""Parts of the study: flights without a policy, and trainings."""


def kept(rows: Iterable[Row]) -> list[Row]:
    """Return the rows of the kept table.

    Args:
        rows: Rows of all parts, with `part`, `cell`, `condition` and `seed`.
    """
    groups = dict[tuple[str, str, str], list[Row]]()
    for row in rows:
        groups.setdefault((row["part"], row["cell"], row["condition"]), []).append(row)
    made = list[Row]()
    for cell in CELLS:
        line: Row = {"cell": cell.name}
        for title, part, words in (
            ("explodes", OPEN, _explosions),
            ("gains energy", OPEN, _gains),
            ("SAC diverges", TRAINED, _trainings),
        ):
            for condition in CONDITIONS:
                some = groups.get((part, cell.name, condition), [])
                line[f"{condition}: {title}"] = words(some) if some else ""
        made.append(line)
    return made


def _explosions(rows: Sequence[Row]) -> str:
    """Return the networks that exploded by kind of flight, in the order of `THRUSTED`, and the top speed."""
    counts = ", ".join(str(sum(row[f"exploded_{kind}"] > 0 for row in rows)) for kind in THRUSTED)
    numerical = sum(row["numerical"] > 0 for row in rows)
    words = f"{counts} of {len(rows)}; {_speed(max(row['fastest'] for row in rows))} m/s"
    return words + (f"; numerical in {numerical}" if numerical else "")


def _speed(speed: float) -> str:
    """Return a speed with a precision that suits its size."""
    return f"{speed:.1f}" if speed < 10.0 else f"{speed:.0f}" if speed < 1e4 else f"{speed:.0e}"


def _gains(rows: Sequence[Row]) -> str:
    """Return the networks that add energy, in the order of `UNTHRUSTED`, and the share of all flights."""
    counts = ", ".join(str(sum(row[f"gaining_{kind}"] > 0.0 for row in rows)) for kind in UNTHRUSTED)
    share = 100.0 * statistics.fmean(row[f"gaining_{kind}"] for row in rows for kind in UNTHRUSTED)
    return f"{counts} of {len(rows)}" + (f"; {share:.2g}% of flights" if share else "")


def _trainings(rows: Sequence[Row]) -> str:
    """Return the trainings that diverged and how, and the last share of arrivals of each by seed."""
    bad = [row["diverged"] for row in rows if row["diverged"]]
    kinds = f" ({', '.join(sorted(set(bad)))})" if bad else ""
    last = ", ".join(f"{100.0 * row['last']:.0f}" for row in sorted(rows, key=lambda row: row["seed"]))
    return f"{len(bad)} of {len(rows)}{kinds}; arrivals {last}%"
