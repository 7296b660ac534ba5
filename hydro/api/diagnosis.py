"""Result of `hydro.diagnose`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from hydro.api.result import Result

if TYPE_CHECKING:
    import numpy as np
    import polars as pl
    from numpy.typing import NDArray

    from hydro.core.diagnosis.findings import Diagnosis as Found
    from hydro.core.diagnosis.findings import Prediction, Status
    from hydro.core.simulation.estimates import Estimates
    from hydro.core.vehicle.description import Vehicle
    from hydro.report.next_steps import NextStep
    from hydro.report.result_axes import Axes

CHI2 = ("given", "own_effects", "found")
"""Names of the mean squared residuals in JSON: vehicle as given, own effects refitted, findings added."""


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Result):
    """Missing or changed effects of a vehicle, as `hydro.diagnose` finds them.

        found = hydro.diagnose(vehicle, raw)
        print(found.headline)
        better = found.vehicle

    Attributes:
        table: Diagnosis table, one finding per row, that with the largest share of the error first.
        status: Overall result: `kind` is `fault`, `stated`, `uncertain`, `unexplained` or `nothing`, and
            `sentences` has one or two sentences for each effect.
        vehicle: Vehicle with the confirmed findings (confidence of 0.9 or more), as `hydro.add` with
            `force=True` returns it; the given vehicle if none is confirmed.
        chi2: Mean squared residual in units of the noise variance (1: noise alone), three numbers: of the
            vehicle as given, with its own effects refitted, and with the findings.
        prediction: Errors of predictions before and after the confirmed findings are added [m/s], measured on
            parts that the fits left out.  None if no session is long enough, or if `before` was given.
        estimates: Values that were fitted together, with their covariance; None if none were fitted.
        changed: Whether the findings are changes since an earlier recording (`before`).
    """

    status: Status
    vehicle: Vehicle
    chi2: tuple[float, float, float]
    prediction: Prediction | None = None
    estimates: Estimates | None = None
    changed: bool = False

    units: ClassVar[Mapping[str, str]] = {"error_added": "m/s"}

    @classmethod
    def of(cls, found: Found, vehicle: Vehicle, table: pl.DataFrame, *, changed: bool) -> Diagnosis:
        """Return a new result made from a diagnosis of `hydro.core`.

        Args:
            found: Diagnosis, with its status.
            vehicle: Vehicle that was diagnosed; it is not changed.
            table: Diagnosis table, with the column types of its schema.
            changed: Whether a recording from before a change was given.

        Raises:
            ValueError: The diagnosis has no status.
        """
        if found.status is None:
            raise ValueError("the diagnosis has no status")
        return cls(
            table,
            found.status,
            with_stated(vehicle, table),
            found.chi2,
            found.prediction,
            found.estimates,
            changed,
        )

    @property
    def headline(self) -> str:
        """Overall result in one line: the number of corrections, and a short sentence for each."""
        return self.status.headline

    @property
    def next_step(self) -> NextStep:
        """Recommended next step: its `action`, such as `add`, its `words`, and `effects` to add by name."""
        from hydro.report.next_steps import next_steps

        return next_steps(self.table, self.prediction)[0]

    @property
    def unseen(self) -> tuple[str, ...]:
        """Names of the effects that the motion in the recording cannot show."""
        return tuple(self.table.filter(verdict="not_excited")["effect"])

    @property
    def footer(self) -> dict[str, Any]:
        """A new dict of chi-square, headline and prediction errors, which `hydro.write` stores."""
        from hydro.core.diagnosis.findings import HEADLINE, PREDICTION

        errors = {} if self.prediction is None else {PREDICTION: asdict(self.prediction)}
        return {"chi2": [round(value, 4) for value in self.chi2], HEADLINE: self.headline} | errors

    def summary(self) -> pl.DataFrame:
        """Return the findings in short, without effects that the recording cannot show.

        Returns:
            `finding`, the kind of finding; `effect`; `share_of_error`, explained share of the squared error
            above the noise (0 to 1); `confidence`, probability that the effect has the right name (0 to 0.98,
            the greatest that the benchmarks support); and `error_added`, error of predictions with this
            finding alone added [m/s].
        """
        import polars as pl

        from hydro.core.diagnosis.settings import MOST_STATED
        from hydro.report import words

        rows = self.table.filter(pl.col("verdict") != "not_excited").sort("rank")
        return rows.select(
            pl.Series("finding", [words.verdict(row, self.changed)[0] for row in rows.to_dicts()], pl.String),
            "effect",
            pl.col("confidence").clip(upper_bound=MOST_STATED),
            "error_added",
            share_of_error="share_of_error_explained",
        ).select("finding", "effect", "share_of_error", "confidence", "error_added")

    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> NDArray[np.object_]:
        """Draw errors of predictions before and after, and the share of the error that each finding explains.

        Args:
            axes: Matplotlib axes to draw into, as many as are returned; by default a new figure's.

        Returns:
            The axes, (2,): errors [m/s], and shares [%] with 95 % intervals; (1,), the shares alone, where
            there is no `prediction`.
        """
        from hydro.report import result_axes

        count = 1 if self.prediction is None else 2
        panels = result_axes.panels(axes, count, height=1.6 + 0.45 * max(self.summary().height, 2))
        if self.prediction is not None:
            result_axes.draw_prediction(panels[0], self.prediction)
        result_axes.draw_findings(panels[-1], self.table, changed=self.changed)
        return panels

    def to_json(self) -> str:
        """Return headline, next step, findings, chi-square and errors as JSON text.

        It is the text that `hydro diagnose --json` prints.
        """
        from hydro.report.json_text import json_text

        errors = {} if self.prediction is None else {"prediction": asdict(self.prediction)}
        chi2 = dict(zip(CHI2, self.chi2, strict=True))
        step = asdict(self.next_step)
        return json_text(headline=self.headline, next=step, findings=self.table, chi2=chi2, **errors)

    def _above(self) -> Sequence[str]:
        from hydro.report.next_steps import in_python

        step, call = self.next_step, in_python(self.next_step)
        following = f"Next: {step.words}{f', `{call}`' if call else ''}."
        values = [one for one in self.table.sort("rank")["sentence"] if one and one not in self.headline]
        errors = [] if self.prediction is None else [_in_words(self.prediction)]
        return (self.headline, following, *values, *errors)

    def _below(self) -> Sequence[str]:
        from hydro.report.diagnosis import SHARES, UNCONFIRMED, has_shares, has_unconfirmed, look_up

        rows = [row for row in self.table.sort("rank").to_dicts() if row["verdict"] != "not_excited"]
        unseen = ", ".join(self.unseen)
        return (
            *([SHARES] if has_shares(rows) else []),
            *([UNCONFIRMED] if has_unconfirmed(rows) else []),
            *(line.text for line in look_up([row["effect"] for row in rows])),
            *([f"Not visible in this recording: {unseen}."] if unseen else []),
        )


def _in_words(known: Prediction) -> str:
    """Return the errors of predictions and their noise floor in a sentence."""
    from hydro.report.words import figure

    told = [f"{figure(known.given)} m/s as given"]
    if known.added != known.given:
        told.append(f"{figure(known.added)} m/s on held-out data with the findings added")
    if known.floor is not None:
        told.append(f"noise floor {figure(known.floor, 2)} m/s")
    refused = " The findings do not lower it, so `hydro add` refuses them." if known.refuted else ""
    return f"Error {known.horizon:g} s ahead: {', '.join(told)}.{refused}"


def with_stated(vehicle: Vehicle, table: pl.DataFrame) -> Vehicle:
    """Return a copy of a vehicle with the confirmed findings of a diagnosis added.

    Args:
        vehicle: Vehicle that was diagnosed; the vehicle itself is returned if no finding is confirmed.
        table: Diagnosis table.
    """
    from hydro.core.diagnosis.findings import extended, of_table, tables

    stated = any(one.is_confirmed and one.parameters for one in of_table(table))
    return extended(vehicle, tables(table)) if stated else vehicle
