"""Figures of predicted wrenches: against the truth, by axis, and by regime of motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import polars as pl

from hydro.core.columns import WRENCH, WRENCH_UNITS
from hydro.report.figures import COLOURS, STYLE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

CELLS = 120
"""Number of cells along each side of a density plot."""
TAIL = 0.1
"""Percentage of the true values beyond each end of a density plot, before margins."""


def density_table(truth: NDArray[Any], predicted: NDArray[Any]) -> pl.DataFrame:
    """Return the joint histogram of true and predicted wrenches (Fig. 3 of Wu et al.), as a table.

    Args:
        truth: Labels (N, 6) [N, N m].
        predicted: Predictions of the model (N, 6).

    Returns:
        One row per cell with rows of the data: `axis`, `truth` and `predicted` (centre of the cell) [N, N m],
        `cell` (length of its sides), and the number of `rows`. Rows beyond the frame are counted at its edge.
    """
    tables = []
    for i, axis in enumerate(WRENCH):
        low, high = np.percentile(truth[:, i], (TAIL, 100.0 - TAIL))
        reach = max(high - low, 1e-9)
        edges = np.linspace(low - 0.1 * reach, high + 0.1 * reach, CELLS + 1)
        inside = (np.clip(values[:, i], edges[0], edges[-1]) for values in (truth, predicted))
        counts, _, _ = np.histogram2d(next(inside), next(inside), bins=[edges, edges])
        x, y = np.nonzero(counts)
        middle = 0.5 * (edges[1:] + edges[:-1])
        tables.append(
            pl.DataFrame({"truth": middle[x], "predicted": middle[y], "rows": counts[x, y].astype(np.int64)})
            .with_columns(axis=pl.lit(axis), cell=pl.lit(edges[1] - edges[0]))
            .select("axis", "truth", "predicted", "cell", "rows")
        )
    return pl.concat(tables)


def draw_density(table: pl.DataFrame, title: str) -> Figure:
    """Return a figure with the histogram of true and predicted wrenches, one panel per axis.

    Exact predictions are on the diagonal.

    Args:
        table: Result of `density_table`.
        title: Title of the figure.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 6.6), layout="constrained")
        panels = figure.subplots(2, 3).ravel()
        for panel, axis, unit in zip(panels, WRENCH, WRENCH_UNITS, strict=True):
            _draw_cells(panel, table.filter(pl.col("axis") == axis), f"{axis} [{unit}]")
        figure.suptitle(
            f"{title}: prediction against truth", fontsize=11, fontweight="bold", x=0.01, ha="left"
        )
    return figure


def _draw_cells(panel: Axes, rows: pl.DataFrame, title: str) -> None:
    """Draw one axis: counts of rows on a logarithmic scale."""
    from matplotlib.colors import LogNorm

    cell = rows["cell"][0]
    ends = rows.select("truth", "predicted").to_numpy()
    low, high = ends.min() - cell, ends.max() + cell
    edges = np.arange(low - 0.5 * cell, high + cell, cell)
    counts, _, _ = np.histogram2d(
        rows["truth"], rows["predicted"], bins=[edges, edges], weights=rows["rows"].cast(pl.Float64)
    )
    shown = np.ma.masked_equal(counts.T, 0.0)
    panel.pcolormesh(edges, edges, shown, norm=LogNorm(1.0, max(2.0, counts.max())), cmap="cividis")
    panel.plot([low, high], [low, high], color="#D55E00", linewidth=0.9)
    panel.set(xlim=(low, high), ylim=(low, high), aspect="equal", title=title)
    panel.set_xlabel("truth")
    panel.set_ylabel("predicted")


def draw_axes(metrics: pl.DataFrame) -> Figure:
    """Return a figure with the errors of models by axis, with 95 % intervals (Fig. 2 of Wu et al.).

    Args:
        metrics: Metrics of predicted wrenches.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    chosen = metrics.filter(pl.col("metric") == "rmse", pl.col("variant") == "")
    models = chosen["model"].unique(maintain_order=True).to_list()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 3.6), layout="constrained")
        for panel, axes, unit in zip(
            figure.subplots(1, 2), (WRENCH[:3], WRENCH[3:]), ("N", "N m"), strict=True
        ):
            for k, (model, colour) in enumerate(zip(models, COLOURS, strict=False)):
                rows = chosen.filter(pl.col("model") == model, pl.col("axis").is_in(axes))
                at = np.arange(len(axes)) + (k + 0.5) * 0.8 / len(models) - 0.4
                panel.bar(at, rows["value"], 0.76 / len(models), color=colour, label=model)
                if rows["low"].null_count() == 0:
                    panel.vlines(at, rows["low"], rows["high"], color="#222222", linewidth=1.0)
            panel.set_xticks(range(len(axes)), axes)
            panel.set(ylabel=f"RMSE [{unit}]")
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return figure


def draw_regimes(metrics: pl.DataFrame) -> Figure:
    """Return a figure with the errors of models by regime of motion, one panel per way to divide the rows.

    Args:
        metrics: metrics of predicted wrenches, measured by regime.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    chosen = metrics.filter(
        pl.col("variant") != "", pl.col("metric") == "rmse", pl.col("axis") == "all"
    ).with_columns(way=pl.col("variant").str.split(" ").list.first())
    ways = chosen["way"].unique(maintain_order=True).to_list()
    models = chosen["model"].unique(maintain_order=True).to_list()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(1.0 + 3.6 * len(ways), 3.8), layout="constrained")
        for panel, way in zip(figure.subplots(1, len(ways), squeeze=False).ravel(), ways, strict=True):
            rows = chosen.filter(pl.col("way") == way)
            names = rows["variant"].unique(maintain_order=True).to_list()
            for model, colour in zip(models, COLOURS, strict=False):
                own = rows.filter(pl.col("model") == model)
                at = [names.index(name) for name in own["variant"]]
                panel.plot(at, own["value"], "o-", color=colour, label=model, linewidth=1.4, markersize=4)
            short = [name.removeprefix(f"{way} ").rpartition(" ")[0] for name in names]
            panel.set_xticks(range(len(names)), short, fontsize=8)
            panel.set(title=f"by {way} [{names[0].rpartition(' ')[2]}]", ylabel="RMSE over all six [N, N m]")
            panel.set_ylim(bottom=0.0)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return figure
