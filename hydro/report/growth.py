"""Growth of the water force with velocity: a sentence for each axis, and the powers with intervals."""

from __future__ import annotations

from typing import Any

from hydro.core.columns import DOF, VELOCITY, WRENCH
from hydro.core.evaluation.growth import POWERS
from hydro.report import words
from hydro.report.figures import TITLES
from hydro.report.sources import Sources

GRID = float(POWERS[1] - POWERS[0])
"""Step between neighbouring powers of the velocity that were fitted."""


def section(sources: Sources) -> dict[str, Any] | None:
    """Return the section of the page on the growth of force with velocity, as values for the page's template.

    Returns:
        A dict with sentences `told` and table rows `rows`; None without a growth table.
    """
    if sources.growth is None:
        return None
    rows = sources.growth.frame.to_dicts()
    own = [row for row in rows if WRENCH.index(row["axis"]) == VELOCITY.index(row["against"])]
    told = [
        f"Drag in {DOF[WRENCH.index(row['axis'])]} grows as |{row['against']}| to the power "
        f"{words.figure(row['power'])} ({_interval(row)})."
        for row in own
    ]
    return {"told": told, "rows": [_line(row) for row in rows]}


def _interval(row: dict[str, Any]) -> str:
    """Return the 95 % interval of a fitted power as text, at least as wide as the steps of the search."""
    wider = 0.5 * GRID if row["low"] == row["high"] else 0.0
    return f"{words.figure(row['low'] - wider)} to {words.figure(row['high'] + wider)}"


def _line(row: dict[str, Any]) -> dict[str, Any]:
    """Return a row of the growth table, one force term, as text for the page."""
    i, against = WRENCH.index(row["axis"]), row["against"]
    own = VELOCITY[i]
    law = f"|{against}|^n" if against == own else f"|{against}|^n {own}"
    return {
        "axis": row["axis"],
        "law": f"{law} ({TITLES[against]})",
        "power": words.figure(row["power"]),
        "interval": _interval(row),
        "drag": words.figure(row["drag"]),
        "unit": row["unit"],
        "share": words.percent(row["share"]),
    }
