"""Result of `hydro.compare`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hydro.api.result import Result

if TYPE_CHECKING:
    import numpy as np
    import polars as pl
    from numpy.typing import NDArray

    from hydro.report.result_axes import Axes

SIMPLE = ("least squares", "zero velocity")
"""Simple predictors in the short table: the best one (least squares), and one that predicts no motion."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """Errors of a vehicle against a recording, as `hydro.compare` measures them.

        compared = hydro.compare(vehicle, raw)
        compared.filter(level="replay", by="all", horizon=5.0)

    Attributes:
        table: Comparison table: errors of force [N, N m] and of predictions [m, rad, m/s, rad/s] by axis,
            horizon and regime of motion, each with its noise floor (the error that sensor noise causes).
    """

    @property
    def headline(self) -> str:
        """The result in one sentence."""
        from hydro.report import comparison

        return comparison.headline(self.table)

    @property
    def horizon(self) -> float | None:
        """Time ahead of the predictions in `summary` [s]: 5, or else the longest; None for whole sessions."""
        horizon: float | None = self._ahead()["horizon"][0]
        return horizon

    def summary(self) -> pl.DataFrame:
        """Return a new table of the errors of predictions 5 s ahead, or else at the longest time ahead.

        Returns:
            `axis`: u v w [m/s], p q r [rad/s] and `all` [m/s]; of a recording without velocities x y z [m],
            phi theta psi [rad] and `pose` [m]. Root mean square errors in `unit`: `error` of the vehicle,
            `noise_floor`, `least_squares` and `zero_velocity` of simple predictors, and `before` of an
            earlier comparison.
        """
        import polars as pl

        from hydro.core.evaluation.yardsticks import LEVEL, column
        from hydro.report.ladder import measured

        rows = self._ahead()
        shown = rows.filter(pl.col("axis").is_in(measured(rows)))
        for name in SIMPLE:
            simple = self.table.filter(level=LEVEL, by=name)
            errors = simple.select("axis", "horizon", pl.col("rmse").alias(column(name)))
            shown = shown.join(
                errors, on=["axis", "horizon"], how="left", nulls_equal=True, maintain_order="left"
            )
        before = ["before"] if "before" in shown.columns else []
        return shown.select(
            "axis", *before, "noise_floor", *map(column, SIMPLE), "unit", error="rmse"
        ).select("axis", *before, "error", "noise_floor", *map(column, SIMPLE), "unit")

    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> NDArray[np.object_]:
        """Draw the errors of predictions axis by axis, with the noise floor and the simple predictors.

        Args:
            axes: Two Matplotlib axes to draw into; by default a new figure's.

        Returns:
            The two axes, (2,): of translation [m/s], and of rotation [rad/s]; [m] and [rad] of a recording
            without velocities.
        """
        from hydro.report import result_axes

        return result_axes.draw_errors_ahead(axes, self.summary(), self.horizon)

    def to_json(self) -> str:
        """Return headline and table as JSON text, as `hydro compare --json` prints it."""
        from hydro.report.json_text import json_text

        return json_text(headline=self.headline, comparison=self.table)

    def _above(self) -> Sequence[str]:
        from hydro.report import words, yardsticks

        simple = yardsticks.sentence(yardsticks.of_comparison(self.table))
        ahead = words.horizon(self.horizon)
        return (self.headline, *([simple] if simple else []), f"Errors of predictions, {ahead}:")

    def _ahead(self) -> pl.DataFrame:
        """Return the errors of predictions over the whole recording, at the horizon of `summary`."""
        from hydro.report.standing import at_horizon

        return at_horizon(self.table.filter(level="replay", by="all"))
