"""Figure of a study of one change: held-out errors, found values and the truth, and arrivals of policies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import polars as pl

from hydro.report import figures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POLICY, PILOT = "policy", "helmsman"
ARRIVALS = {
    "trained before,\nunchanged vehicle": (POLICY, "before", "unchanged"),
    "trained before,\nchanged vehicle": (POLICY, "before", "changed"),
    "trained after,\nchanged vehicle": (POLICY, "after", "changed"),
    "pilot,\nchanged vehicle": (PILOT, "before", "changed"),
}
"""Rows of the right panel: who flies, in which file it was trained, and which vehicle it flies."""
VALUES = 10
"""Maximum number of values in the middle panel; more have no room."""
OURS, OTHERS, TRUE = figures.COLOURS[2], "#9A9A9A", "#222222"
"""Colours of hydro's results, of all others, and of the truth."""


@dataclass(frozen=True)
class Shown:
    """Results for one change of the vehicle, drawn in one row of the figure.

    Attributes:
        errors: Held-out error by method; columns `method` and `error` [m/s].
        named: Found values, with the columns `value`, `given` (in the file), `found`, `low`, `high`, `true`;
            values that are only refitted are not drawn.
        pooled: Arrivals of policies over all seeds; columns `flown_by`, `file`, `vehicle`, `seeds`,
            `episodes`, `success`, `success_low`, `success_high`.
        flights: Arrivals of policies by seed; columns `flown_by`, `file`, `vehicle`, `success`.
        ours: Methods of hydro.
        missing: Methods that were not run, with the reason.
    """

    errors: pl.DataFrame
    named: pl.DataFrame
    pooled: pl.DataFrame
    flights: pl.DataFrame
    ours: Sequence[str] = ()
    missing: Sequence[str] = ()


def draw(changes: Mapping[str, Shown]) -> Figure:
    """Return a figure with a row of three panels for every change of the vehicle.

    Args:
        changes: Results of each change, by the title of its row.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(figures.STYLE):
        drawn = Figure(figsize=(13.0, 3.9 * len(changes)), layout="constrained")
        axes = drawn.subplots(len(changes), 3, squeeze=False)
        for (title, shown), (left, middle, right) in zip(changes.items(), axes, strict=True):
            _errors(left, shown, title)
            _named(middle, shown.named)
            _arrivals(right, shown)
        notes = [
            f"{title}, left out: {'; '.join(one.missing)}" for title, one in changes.items() if one.missing
        ]
        if notes:
            drawn.supxlabel("\n".join(notes), x=0.01, ha="left", fontsize=8)
        return drawn


def _errors(panel: Axes, shown: Shown, title: str) -> None:
    """Draw the errors as bars on a logarithmic scale, the largest on top."""
    rows = shown.errors.drop_nulls("error").sort("error").to_dicts()
    colours = [OURS if row["method"] in shown.ours else OTHERS for row in rows]
    panel.barh(range(len(rows)), [row["error"] for row in rows], color=colours, height=0.65)
    panel.set_yticks(range(len(rows)), [row["method"] for row in rows])
    for place, row in enumerate(rows):
        panel.annotate(
            f"{row['error']:.3g}", (row["error"], place), (3, 0), textcoords="offset points", va="center"
        )
    panel.set(xscale="log", xlabel="velocity error 5 s ahead, held out [m/s]", title=f"{title}\nName it")
    panel.tick_params(axis="x", which="minor", labelbottom=False)
    panel.margins(x=0.2)
    panel.grid(visible=False, axis="y")


def _named(panel: Axes, named: pl.DataFrame) -> None:
    """Draw the values of new or changed effects, found with their intervals and true."""
    changed = pl.col("given").is_null() | (pl.col("given") != pl.col("true"))
    rows = named.filter(changed).head(VALUES).to_dicts()[::-1]
    for place, row in enumerate(rows):
        if row["low"] is not None:
            panel.plot([row["low"], row["high"]], [place, place], color=OURS, linewidth=3, alpha=0.5)
    places = range(len(rows))
    panel.plot([row["found"] for row in rows], places, "o", color=OURS, label="found, 95 % interval")
    panel.plot(
        [row["true"] for row in rows], places, "x", color=TRUE, markersize=9, markeredgewidth=2, label="true"
    )
    panel.set_yticks(places, [row["value"].replace(" ", "\n", 1) for row in rows])
    panel.set(xlabel="value in the vehicle file", title="Add it", ylim=(-0.6, len(rows) - 0.2))
    panel.margins(x=0.25)
    panel.locator_params(axis="x", nbins=4)
    panel.legend(frameon=False, fontsize=8, loc="upper right")


def _arrivals(panel: Axes, shown: Shown) -> None:
    """Draw the share of arrivals: a bar with Wilson's interval for all seeds, and a ring for each seed."""
    labels = []
    for place, (label, (by, file, vehicle)) in enumerate(reversed(ARRIVALS.items())):
        those = {"flown_by": by, "file": file, "vehicle": vehicle}
        together = shown.pooled.filter(**those).to_dicts()
        labels.append(label)
        if not together:
            panel.annotate("not run", (0.02, place), va="center", color="#777777")
        for row in together:
            share, colour = row["success"], OURS if file == "after" else OTHERS
            off = [[share - row["success_low"]], [row["success_high"] - share]]
            panel.barh(place, share, xerr=off, color=colour, height=0.55, ecolor=TRUE, capsize=3)
            if by == POLICY:
                labels[-1] += f" ({row['seeds']})"
        own = shown.flights.filter(flown_by=POLICY, **{k: v for k, v in those.items() if k != "flown_by"})
        if by == POLICY:
            panel.plot(own["success"], [place + 0.36] * own.height, "o", mfc="none", color=TRUE, markersize=4)
    panel.set_yticks(range(len(labels)), labels)
    panel.set(xlim=(0.0, 1.04), ylim=(-0.5, len(labels) - 0.4), title="The policy arrives")
    panel.set_xlabel("share of arrivals (number of seeds)")
    panel.grid(visible=False, axis="y")
