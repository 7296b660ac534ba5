"""Result of `hydro.fit`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hydro.api.result import Result

if TYPE_CHECKING:
    import numpy as np
    import polars as pl
    from numpy.typing import NDArray

    from hydro.core.columns import Array
    from hydro.core.identification.outcome import Fit as Outcome
    from hydro.core.simulation.estimates import Estimates
    from hydro.core.vehicle.description import Vehicle
    from hydro.report.result_axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Result):
    """Fitted effects of a vehicle, as `hydro.fit` estimates them.

        fit = hydro.fit(vehicle, raw, ["quadratic_damping"])
        better = hydro.add(vehicle, fit)

    Attributes:
        table: One row per fitted number: `parameter`, `value` and `standard_error` in `unit`, and
            `determined`, whether the recording determines it.
        outcome: Fit of `hydro.core`, with all its numbers.
        sentences: Values of each effect in one or two sentences.
    """

    outcome: Outcome
    sentences: tuple[str, ...]

    @classmethod
    def of(cls, outcome: Outcome, vehicle: Vehicle, dt: float) -> Fit:
        """Return a new result made from a fit of `hydro.core`, with a sentence for each effect.

        Args:
            outcome: The fit of `hydro.core`.
            vehicle: The vehicle whose effects were fitted, before the fit.
            dt: Sample time of the recording [s].
        """
        from hydro.core.effects.sentences import sentence

        told = []
        for table in outcome.tables():
            values = {key: value for key, value in table.items() if key not in ("name", "standard_error")}
            told.append(sentence(vehicle, table["name"], values, table["standard_error"], dt))
        return cls(outcome.frame(), outcome, tuple(told))

    @property
    def headline(self) -> str:
        """Number of fitted effects, and a sentence for each effect, as one text."""
        count = len(self.sentences)
        return f"{count} {'effect' if count == 1 else 'effects'} fitted: {' '.join(self.sentences)}"

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with the fitted values."""
        return self.outcome.vehicle

    @property
    def values(self) -> Array:
        """Fitted values, (P,), one per row of `table` and in its units."""
        return self.outcome.values

    @property
    def standard_errors(self) -> Array:
        """Standard errors of the values, (P,)."""
        return self.outcome.standard_errors

    @property
    def covariance(self) -> Array:
        """Covariance of the values, (P, P), in products of their units."""
        return self.outcome.covariance

    @property
    def determined(self) -> NDArray[np.bool_]:
        """Mask of the values that the recording determines, (P,)."""
        return self.outcome.determined

    @property
    def chi2(self) -> float:
        """Mean squared residual in units of the noise variance; about 1 if the model is right."""
        return self.outcome.chi2

    @property
    def method(self) -> str:
        """Method of the fit: `output` or `equation`."""
        return self.outcome.method

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the fit, one line each."""
        return self.outcome.warnings

    @property
    def changes(self) -> tuple[str, ...]:
        """Changes to the log before the fit, one sentence each; part of `warnings`."""
        return self.outcome.changes

    @property
    def share(self) -> float:
        """Share of the recording that the fit used, 0 to 1."""
        return self.outcome.share

    def tables(self) -> tuple[dict[str, Any], ...]:
        """Return the fitted effects, one dict for each, as their `[[effect]]` tables in a vehicle file.

        Each has the `name`, the values by parameter, and `standard_error`, a dict by parameter.
        """
        return self.outcome.tables()

    def effect(self, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the values and the standard errors of one fitted effect.

        Args:
            name: Name of the effect.

        Returns:
            Values by parameter, and standard errors by parameter, in the units of the catalogue.

        Raises:
            KeyError: The effect was not fitted.
        """
        return self.outcome.table(name)

    def estimates(self) -> Estimates:
        """Return an object with the values of `tables` and their covariance."""
        return self.outcome.estimates()

    def frame(self) -> pl.DataFrame:
        """Return `table`; this method exists because fits of `hydro.core` have it."""
        return self.table

    def summary(self) -> pl.DataFrame:
        """Return a new table of the parameters, those that the data determine first.

        Returns:
            The rows of `table`: `parameter`, `value` and `standard_error` in `unit`, and `determined`.
        """
        return self.table.sort("determined", descending=True, maintain_order=True)

    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> NDArray[np.object_]:
        """Draw the values with their 95 % intervals; those that the data do not determine are hollow.

        Args:
            axes: Matplotlib axes to draw into, one for each unit; by default a new figure's.

        Returns:
            The axes into which it drew, (n,): one for each of n units, in the order of `table`.
        """
        from hydro.report import result_axes

        return result_axes.draw_parameters(axes, self.table)

    def to_json(self) -> str:
        """Return headline, effects, parameters, chi-square, method and warnings as JSON text."""
        from hydro.report.json_text import json_text

        return json_text(
            headline=self.headline,
            effects=self.tables(),
            parameters=self.table,
            chi2=self.chi2,
            method=self.method,
            share=self.share,
            warnings=self.warnings,
        )

    def _above(self) -> Sequence[str]:
        return (
            self.headline,
            f"Fit by {self.method} error; mean squared residual {self.chi2:.3g} (1: noise alone).",
        )

    def _below(self) -> Sequence[str]:
        return self.warnings
