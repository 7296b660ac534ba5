"""Errors of models and of their replays on the page: a chart of the axes, and tables of the same numbers."""

from __future__ import annotations

from typing import Any

import polars as pl

from hydro.core.columns import UNITS, VELOCITY
from hydro.core.errors import listed
from hydro.report import plots, seeds, tables, words
from hydro.report.charts import Charts
from hydro.report.sources import Named

BY_SEEDS = "Means over seeds; in small print the smallest and largest, for a single seed the 95 % interval."
INTERVALS = "In small print 95 % intervals."
"""Notes on the small print of a table, for several networks of a model and for one."""
OF_NETWORKS = {
    "ranking": (
        "Does the better prediction replay better?",
        "Kendall's tau between the error of the predicted wrench and that of the replay, over models, with "
        "its 95 % interval: 1 where both rank alike, -1 where one ranks in the reverse order; p, the "
        "probability of as much if there were no relation.",
        seeds.ranking_table,
    ),
    "minutes": (
        "Effect of less training data",
        "Root mean square errors over all six axes of the wrench [N, N m] and of the replay [m/s, rad/s], "
        "means over seeds with the smallest and the largest; p, the probability of ranks so far behind those "
        "of the best replays without being worse (rank-sum test).",
        seeds.minutes_table,
    ),
    "conditioning": (
        "Effect of conditioning the learned wrench",
        "Replays of the first seeds, root mean square errors over all six velocities [m/s, rad/s].",
        seeds.conditioning_table,
    ),
}
"""Parts of a study without a chart: title, explanation, and the function that makes the table."""


def section(one: Named, number: int, charts: Charts) -> dict[str, Any]:
    """Return the section of the page on one table of errors (metrics), as values for the page's template.

    Args:
        one: The table.
        number: Number of the table on the page.
        charts: Collection to which its figures are added.

    Returns:
        A dict of `number`, `title`, `lede` (introduction), `charts` (names), `legend` (label, colour),
        `table`, and `more`, which are folded tables. A table has `about`, `columns` (name, whether of
        numbers) and `rows` of cells (figure, small print).
    """
    record = one.artefact.provenance
    part = record.parameters.get("part") if record.stage == "study" else None
    if part in OF_NETWORKS:
        title, lede, tabulated = OF_NETWORKS[part]
        shown = {"charts": [], "legend": [], "table": _table(title, tabulated(one.frame)), "more": []}
        return {"number": number, "title": title, "lede": lede} | shown
    flown = one.frame["axis"].is_in(VELOCITY).any()
    told = (_replays if flown else _predictions)(one.frame, number, charts)
    spread = BY_SEEDS if record.stage == "study" else INTERVALS
    return {"number": number} | told | {"lede": f"{told['lede']} {spread}"}


def _predictions(frame: pl.DataFrame, number: int, charts: Charts) -> dict[str, Any]:
    """Return errors of predicted wrenches (Table II and Fig. 2 of the paper), also by regime of motion."""
    whole = frame.filter(pl.col("variant") == "")
    table = _by_axis(whole, "model", number, charts)
    single = tables.prediction_errors(whole).select("MAE", "R2")
    for name in single.columns:
        table["table"]["columns"].append((name, True))
        for row, value in zip(table["table"]["rows"], single[name], strict=True):
            row.append((words.figure(value, 4 if name == "R2" else 3), ""))
    regimes = tables.regime_errors(frame) if (frame["variant"] != "").any() else None
    more = [] if regimes is None else [_table("By regime of motion, over all six axes", regimes)]
    lede = (
        f"Root mean square errors on {_data(whole)}, axis by axis and over all six in their own units; also "
        "the mean absolute error, and the mean R² of the axes."
    )
    return table | {"title": "Predicted wrench", "lede": lede, "more": more}


def _replays(frame: pl.DataFrame, number: int, charts: Charts) -> dict[str, Any]:
    """Return errors of replayed velocities (Table III of the paper), also by piece of the recording."""
    whole = frame.filter(~tables.of_a_piece())
    pieces = tables.piece_errors(frame)
    more = [] if pieces.is_empty() else [_table("By piece of the recording", pieces)]
    lede = f"Root mean square errors on {_data(whole)}, from the commands alone."
    return _by_axis(whole, "variant", number, charts) | {
        "title": "Open-loop replay",
        "lede": lede,
        "more": more,
    }


def _data(frame: pl.DataFrame) -> str:
    return listed(frame["dataset"].unique(maintain_order=True).to_list())


def _by_axis(frame: pl.DataFrame, group: str, number: int, charts: Charts) -> dict[str, Any]:
    """Return charts of root mean square errors, one per unit, and a table with all axes together last."""
    rows = frame.filter(pl.col("metric") == "rmse")
    axes = [axis for axis in rows["axis"].unique(maintain_order=True) if axis in UNITS]
    own = rows.filter(pl.col("axis").is_in(axes))
    drawn = [
        charts.add(f"metrics-{number}-{i}", plots.bars(own.filter(unit=unit), group))
        for i, unit in enumerate(own["unit"].unique(maintain_order=True))
    ]
    names = frame[group].unique(maintain_order=True).to_list()
    found = {(row[group], row["axis"]): row for row in rows.iter_rows(named=True)}
    columns = [(f"{axis} [{UNITS[axis]}]", True) for axis in axes] + [("all six", True)]
    cells = [[(name, ""), *(_cell(found.get((name, axis))) for axis in (*axes, "all"))] for name in names]
    return {
        "charts": drawn,
        "legend": [(name, plots.MANY[i % len(plots.MANY)]) for i, name in enumerate(names)],
        "table": {"about": "Errors per axis", "columns": [(group, False), *columns], "rows": cells},
    }


def _cell(row: dict[str, Any] | None) -> tuple[str, str]:
    """Return the text of a number, and its interval as small print, from a row of a metrics table."""
    if row is None:
        return words.figure(None), ""
    ends = [words.figure(row[end], 2) for end in ("low", "high") if row[end] is not None]
    return words.figure(row["value"]), " to ".join(ends)


def _table(about: str, frame: pl.DataFrame) -> dict[str, Any]:
    """Return a data frame as a table of the page, with the caption `about`."""
    columns = [(name.replace("_", ", "), dtype.is_numeric()) for name, dtype in frame.schema.items()]
    rows = [
        [(words.figure(value) if dtype.is_numeric() else str(value), "") for value, dtype in cells]
        for cells in (zip(row, frame.dtypes, strict=True) for row in frame.iter_rows())
    ]
    return {"about": about, "columns": columns, "rows": rows}
