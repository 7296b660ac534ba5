"""Result of `hydro.explain`: steps, and the ladder, which is the table of their errors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

from hydro.api.comparison import Comparison
from hydro.api.diagnosis import Diagnosis, with_stated
from hydro.api.result import Result, same

if TYPE_CHECKING:
    import numpy as np
    import polars as pl
    from numpy.typing import NDArray

    from hydro.core.explanation.ladder import Step as Rung
    from hydro.core.simulation.estimates import Estimates
    from hydro.core.vehicle.description import Vehicle
    from hydro.report.result_axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class Step:
    """One step of a study: the effects that it added to a vehicle, and the errors of that vehicle.

    Attributes:
        number: Number of the step; step 0 is the vehicle as given.
        added: Names of the effects that the step added; if it added none, of those that got new values.
        stated: Whether these effects are confirmed: the diagnosis of the previous step names them with a
            confidence of 0.9 or more. False for step 0.
        tables: `[[effect]]` tables of all effects that were fitted together, with standard errors; empty for
            step 0.
        vehicle: Vehicle with these effects.
        comparison: Errors of this vehicle against the recording.
        diagnosis: Diagnosis of this vehicle.
        ladder: Errors of this step, its rows of the ladder table.
        estimates: Values of `tables` with their covariance; None for step 0.
    """

    number: int
    added: tuple[str, ...]
    stated: bool
    tables: tuple[dict[str, Any], ...]
    vehicle: Vehicle
    comparison: Comparison
    diagnosis: Diagnosis
    ladder: pl.DataFrame
    estimates: Estimates | None = None

    @classmethod
    def of(cls, rung: Rung, stated: bool, *, changed: bool) -> Step:
        """Return the result for one step of a study, made from the step (rung) of `hydro.core`.

        Args:
            rung: Step of `hydro.core.explanation`; it is not changed.
            stated: Whether the diagnosis of the previous step confirms the added effects.
            changed: Whether a recording from before a change was given.

        Raises:
            ValueError: The rung has no status.
        """
        from hydro.io.table import conform

        if rung.status is None:
            raise ValueError("the step has no status")
        found = conform("diagnosis", rung.diagnosis)
        given, own_effects, with_findings = rung.chi2
        return cls(
            rung.number,
            rung.added,
            stated,
            rung.tables,
            rung.vehicle,
            Comparison(conform("comparison", rung.comparison)),
            Diagnosis(
                found,
                rung.status,
                with_stated(rung.vehicle, found),
                (given, own_effects, with_findings),
                changed=changed,
            ),
            conform("ladder", rung.ladder),
            rung.estimates,
        )

    @property
    def headline(self) -> str:
        """The step in one line of text: its number, the added effects and the errors."""
        from hydro.report import words
        from hydro.report.ladder import by_dataset

        rows = ahead(self.ladder)
        errors = [
            f"{words.figure(one['rmse'][0])} {one['unit'][0]} on {label}"
            for _, label, one in by_dataset(rows)
        ]
        added = " and ".join(map(words.effect_name, self.added)) or "as given"
        horizon = words.horizon(rows["horizon"][0])
        return f"Step {self.number}, {added}: error {horizon} {', '.join(errors)}."

    @property
    def chi2(self) -> tuple[float, ...]:
        """Mean squared residuals of `diagnosis`, in units of the noise variance (1: noise alone).

        They are those of the step's vehicle as given, with its own effects refitted, and with the findings.
        """
        return self.diagnosis.chi2

    def error(self, dataset: str) -> float | None:
        """Return the root mean square error of velocity, over all axes, predicted 5 s ahead [m/s].

        Args:
            dataset: `fit` for the recording, `holdout` for the held-out one.

        Returns:
            The error; None if there is no such recording, or if it has no velocities.
        """
        from hydro.core.explanation.ladder import HORIZON

        rows = self.ladder.filter(dataset=dataset, axis="all", horizon=HORIZON)
        return None if rows.is_empty() else float(rows["rmse"][0])

    @property
    def left_out(self) -> float | None:
        """Error 5 s ahead on parts of the recording that were left out of the fit [m/s].

        None if `holdout` or `before` was given to `hydro.explain`.
        """
        from hydro.core.explanation.ladder import LEFT_OUT

        rows = self.ladder.filter(axis=LEFT_OUT)
        return None if rows.is_empty() else float(rows["rmse"][0])

    def __repr__(self) -> str:
        return self.headline

    def __eq__(self, other: object) -> bool:
        return same(self, other)


@dataclass(frozen=True, eq=False, repr=False)
class Study(Result):
    """Effects added to a vehicle step by step, as `hydro.explain` does it.

    Iteration, `len(study)` and `study[1]` refer to the steps. All other attributes and methods of a polars
    frame, such as `study["column"]` or `study.filter(...)`, refer to the table `study.table`.

        study = hydro.explain(vehicle, raw, holdout=other)
        for step in study:
            print(step.number, step.added, step.error("holdout"))
        better = study.vehicle

    Attributes:
        table: Ladder table: errors of predictions after each step, on the recording and on held-out data.
        steps: All steps; step 0 is the vehicle as given.
        best: Step to use: the last one, or the one before it if that predicts better.
        ending: Reason why no step follows the last one, in words.
        answer: Headline.
        corrections: Sentence for each correction of the vehicle, with its values and standard errors.
    """

    steps: tuple[Step, ...]
    best: Step
    ending: str
    answer: str
    corrections: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, steps: Sequence[Step], best: int, ending: str, answer: str, corrections: Sequence[str] = ()
    ) -> Study:
        """Return the study made of these steps, with their errors as its table.

        Args:
            steps: All steps, from 0 on.
            best: Number of the step to use.
            ending: Reason why no step follows, in words.
            answer: Headline.
            corrections: Sentence for each correction of the vehicle.
        """
        import polars as pl

        ladder = pl.concat(step.ladder for step in steps)
        return cls(ladder, tuple(steps), steps[best], ending, answer, tuple(corrections))

    @property
    def headline(self) -> str:
        """Corrections of the vehicle in one line; "unconfirmed" marks a confidence below 0.9."""
        return self.answer

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle of the step to use, with all effects added up to it."""
        return self.best.vehicle

    @property
    def comparison(self) -> Comparison:
        """Errors against the recording of the vehicle of the step to use."""
        return self.best.comparison

    @property
    def diagnosis(self) -> Diagnosis:
        """Diagnosis of the vehicle of the step to use."""
        return self.best.diagnosis

    def summary(self) -> pl.DataFrame:
        """Return a new table of the prediction errors of each step of the study, one row per step.

        The errors are root mean squares over all axes, 5 s ahead or else at the longest horizon.

        Returns:
            Columns `step`, the number from 0; `added`, the names of its effects; `error` on the recording,
            `held_out` on held-out data (null without any) and `noise_floor` of the recording, all in `unit`;
            and `use`, true for the step to use.
        """
        import polars as pl

        rows = ahead(self.table)
        fit, holdout = (rows.filter(dataset=name) for name in ("fit", "holdout"))
        both = fit.join(holdout.select("step", held_out="rmse"), on="step", how="left", maintain_order="left")
        return both.select(
            "step",
            pl.col("effect").alias("added"),
            pl.col("rmse").alias("error"),
            "held_out",
            "noise_floor",
            "unit",
            (pl.col("step") == self.best.number).alias("use"),
        )

    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> NDArray[np.object_]:
        """Draw the prediction error of each step of the study, with its 95 % interval and its noise floor.

        Args:
            axes: Matplotlib axes to draw into; by default a new figure's.

        Returns:
            The axes, (1,): errors of all velocities together [m/s], or of the pose [m] of a recording
            without velocities.
        """
        from hydro.report import result_axes

        panels = result_axes.panels(axes, 1, height=3.8)
        result_axes.draw_ladder(panels[0], ahead(self.table))
        return panels

    def to_json(self) -> str:
        """Return one JSON object as text, with the results of the whole study.

        Keys: `headline`; `use`, the number of the step to use; `ending`, the reason why the study ended;
        `steps`, a list of objects with `step`, `added`, `stated`, `effects`; `ladder`, the rows of `table`;
        and `findings`, the rows of the diagnosis of the step to use.
        """
        from hydro.report.json_text import json_text

        steps = [
            {"step": one.number, "added": one.added, "stated": one.stated, "effects": one.tables}
            for one in self.steps
        ]
        return json_text(
            headline=self.headline,
            use=self.best.number,
            ending=self.ending,
            steps=steps,
            ladder=self.table,
            findings=self.diagnosis.table,
        )

    @overload
    def __getitem__(self, key: int) -> Step: ...
    @overload
    def __getitem__(self, key: Any) -> Any: ...
    def __getitem__(self, key: Any) -> Any:
        return self.steps[key] if isinstance(key, int | slice) else self.table[key]

    def __iter__(self) -> Iterator[Step]:
        return iter(self.steps)

    def __len__(self) -> int:
        return len(self.steps)

    def _above(self) -> Sequence[str]:
        from hydro.report import words

        corrected = [] if all(one in self.headline for one in self.corrections) else self.corrections
        errors = f"Errors of predictions, {words.horizon(ahead(self.table)['horizon'][0])}:"
        return (self.headline, *corrected, errors)

    def _below(self) -> Sequence[str]:
        return (f"The study ended because {self.ending}.", f"Use step {self.best.number}: study.vehicle.")


def ahead(ladder: pl.DataFrame) -> pl.DataFrame:
    """Return the rows of a ladder with the error over all axes, 5 s ahead or else at the longest horizon.

    Args:
        ladder: Ladder table: prediction errors of each step of a study.

    Returns:
        Those rows with all columns, sorted by `dataset` (`fit`, then `holdout`) and `step`.
    """
    from hydro.report.ladder import measured
    from hydro.report.standing import at_horizon

    rows = at_horizon(ladder)
    return rows.filter(axis=measured(rows)[-1]).sort("dataset", "step")
