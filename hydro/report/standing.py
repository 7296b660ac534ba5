"""Prediction errors before and after the findings are added, and the step of a study to use."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import polars as pl

from hydro.core.diagnosis.findings import HEADLINE, prediction_of
from hydro.core.errors import listed
from hydro.core.explanation.ladder import HORIZON, best_step
from hydro.report import comparison, words
from hydro.report.change import of_change
from hydro.report.next_steps import ADD, COMPARE, CORRECT, EXPLAIN, FIT, MEND, RUN, next_steps
from hydro.report.sources import Named, Sources
from hydro.report.tables import of_a_piece
from hydro.report.words import DATASETS

BY_COMMAND = {
    ADD: ", with `hydro add`",
    EXPLAIN: ", with `hydro explain`",
    CORRECT: ", with `hydro diagnose --correct-thrusters`",
    RUN: ", with `hydro diagnose --next-run`",
    COMPARE: ", with `hydro compare`",
    FIT: ", with `hydro fit`",
}
"""Commands that take the actions of next steps."""


@dataclass(frozen=True)
class Standing:
    """Prediction errors on one data set, before and after the findings are added.

    Attributes:
        dataset: `fit` or `holdout`.
        horizon: Horizon of the predictions [s]; None for whole runs.
        before: Error of the file as given.
        after: Error with the findings added; None if nothing was added.
        noise: Noise floor.
        unit: Unit of the errors.
    """

    dataset: str
    horizon: float | None
    before: float
    after: float | None
    noise: float
    unit: str

    @property
    def data(self) -> str:
        """The data set in words, such as `held-out data`."""
        return DATASETS[self.dataset]

    @property
    def left(self) -> float | None:
        """Error with the findings added, divided by the error of the file as given.

        None if nothing was added.
        """
        return None if self.after is None or self.before == 0.0 else self.after / self.before

    @property
    def at_floor(self) -> bool:
        """Whether the error with the findings added is at most `words.AT_FLOOR` times the noise floor."""
        return self.after is not None and self.after <= words.AT_FLOOR * self.noise


def chosen_step(sources: Sources) -> int | None:
    """Return the number of the study's step to use; without a ladder, of the last comparison or diagnosis.

    Returns:
        The number, from 0; None if the report has no table.
    """
    if sources.ladder is not None:
        return best_step(sources.ladder.frame)
    return max(len(sources.comparisons), len(sources.diagnoses)) - 1 if sources.everything else None


def at_horizon(rows: pl.DataFrame) -> pl.DataFrame:
    """Return the rows of a ladder or comparison for the horizon of 5 s, or else for the longest."""
    known = [one for one in rows["horizon"].unique().to_list() if one is not None]
    chosen = HORIZON if HORIZON in known else max(known, default=None)
    return rows.filter(pl.col("horizon").eq_missing(pl.lit(chosen, pl.Float64)))


def errors(sources: Sources) -> pl.DataFrame:
    """Return errors of predictions before and after the findings are added, from ladder or comparisons.

    Returns:
        A table with the columns `dataset` (`fit` or `holdout`), `axis`, `horizon` [s], `before`, `after`
        (null if nothing was added), `noise_floor`, `unit`; no rows without a comparison.
    """
    key = ["dataset", "axis", "horizon"]
    if sources.ladder is not None:
        frame = sources.ladder.frame
        first, last = frame.filter(step=0), frame.filter(pl.col("step") == best_step(frame))
        same = best_step(frame) == 0
    elif sources.comparisons:
        ends = (sources.comparisons[0].frame, sources.comparisons[-1].frame)
        first, last = (
            one.filter(level="replay", by="all").with_columns(dataset=pl.lit("fit")) for one in ends
        )
        same = len(sources.comparisons) == 1
        if same and "before" in last.columns:
            first, same = last.with_columns(rmse=pl.col("before")).drop_nulls("rmse"), False
    else:
        first = last = pl.DataFrame(schema=[*key, "rmse", "noise_floor", "unit"])
        same = True
    earlier = first.select(*key, before="rmse")
    both = last.select(*key, "noise_floor", "unit", after="rmse").join(
        earlier, on=key, how="left", nulls_equal=True, maintain_order="left"
    )
    return both.with_columns(
        before=pl.coalesce("before", "after"),
        after=pl.lit(None, pl.Float64) if same else pl.col("after"),
    )


def standings(sources: Sources) -> list[Standing]:
    """Return prediction errors over all axes at the main horizon, on the recording and on held-out data.

    Returns:
        A list with one `Standing` for each data set that the report has, the recording first.
    """
    whole = errors(sources).filter(pl.col("axis") == "all")
    found = []
    for name in DATASETS:
        rows = at_horizon(whole.filter(pl.col("dataset") == name))
        for row in rows.head(1).iter_rows(named=True):
            numbers = (row["before"], row["after"], row["noise_floor"])
            found.append(Standing(name, row["horizon"], *numbers, row["unit"]))
    return found


def horizons(sources: Sources) -> Iterator[dict[str, Any]]:
    """Yield the errors of velocity and position at every horizon, before and after the findings, as texts.

    Yields:
        A dict for each data set, quantity and horizon: `dataset`, `of` (quantity and unit), `horizon`,
        `before`, `after`, `noise`.
    """
    both = errors(sources)
    for axis, label in (("all", "velocity"), ("pose", "position")):
        rows = both.filter(pl.col("axis") == axis).sort("dataset", "horizon", nulls_last=True)
        for row in rows.iter_rows(named=True):
            yield {
                "dataset": DATASETS[row["dataset"]],
                "of": f"{label} [{row['unit']}]",
                "horizon": words.horizon(row["horizon"]),
                "before": words.figure(row["before"]),
                "after": words.figure(row["after"]),
                "noise": words.figure(row["noise_floor"], 2),
            }


def answer(sources: Sources) -> str:
    """Return the headline of the study, or else of the last diagnosis; empty without both."""
    last = (sources.ladder, *sources.diagnoses[::-1])
    told = (one.artefact.provenance.parameters.get(HEADLINE, "") for one in last if one is not None)
    return next((str(line) for line in told if line), "")


def headline(sources: Sources) -> str:
    """Return a sentence on the errors before and after the findings are added.

    Without a comparison, the sentence is on the first finding of the diagnosis.
    """
    found = standings(sources)
    if not found:
        return _first_finding(sources) or _what_it_is(sources)
    first = found[0]
    look = f"{first.horizon:g} s ahead" if first.horizon is not None else "over a whole run"
    if first.after is None:
        told = f"The error of the model is {words.figure(first.before)} {first.unit} {look}."
        return f"{told} {_first_finding(sources) or _worst_place(sources)}".strip()
    added = listed(added_effects(sources))
    own = (
        ""
        if sources.ladder is not None and of_change(sources.ladder)
        else " and the file's values re-estimated"
    )
    begin = f"With {added} added{own}" if added else "With the findings added"
    falls = "falls" if first.after < first.before else "goes"
    told = f"{begin}, the error {look} {falls} {_fall(first)} {first.unit}"
    others = [f", and on {one.data} {_fall(one)}" for one in found[1:] if one.after is not None]
    return f"{told}{''.join(others)}."


def next_step(sources: Sources) -> str:
    """Return a sentence on the next step: to use the file of a study, or to act on the last diagnosis."""
    if sources.ladder is not None:
        best = best_step(sources.ladder.frame)
        return (
            f"Next: use `vehicle-{best}.toml` in the folder of this study."
            if best
            else "Next: keep the vehicle file as it is, because no step lowers the error."
        )
    if not sources.diagnoses:
        return ""
    last = sources.diagnoses[-1]
    step = next_steps(last.frame, prediction_of(last.artefact.provenance.parameters))[0]
    if step.words == MEND:
        return f"Next: {step.words}."
    named = f", with `hydro add --effect {step.effects[0]}`" if step.effects and step.action == ADD else ""
    return f"Next: {step.words}{named or BY_COMMAND[step.action]}."


def noise_line(sources: Sources) -> str:
    """Return sentences on the noise floor and the error above it; empty without a comparison."""
    found = standings(sources)
    if not found:
        return ""
    floor = f"The noise floor is {words.figure(found[0].noise, 2)} {found[0].unit}."
    last = found[-1]
    if last.after is None or last.at_floor:
        return floor
    if sources.ladder is not None and of_change(sources.ladder):
        return f"{floor} The remaining error is water force that the file lacked before the change, too."
    return f"{floor} The remaining error is force that no added effect describes."


def added_effects(sources: Sources) -> list[str]:
    """Return the names, in words, of the effects that the study's steps up to the step to use have added."""
    if sources.ladder is None:
        return []
    frame = sources.ladder.frame.filter(pl.col("step") <= best_step(sources.ladder.frame)).sort("step")
    names = (name for one in frame["effect"].unique(maintain_order=True) for name in one.split(", ") if name)
    return [words.effect_name(name) for name in dict.fromkeys(names)]


def _fall(one: Standing) -> str:
    return f"from {words.figure(one.before)} to {words.figure(one.after)}"


def _first_finding(sources: Sources) -> str:
    """Return the verdict of the first finding of the last diagnosis in words; faults of the log come last."""
    if not sources.diagnoses or sources.diagnoses[-1].frame.is_empty():
        return ""
    rows = sources.diagnoses[-1].frame.sort(pl.col("verdict") == "log_fault", "rank")
    return words.verdict(rows.row(0, named=True), of_change(sources.diagnoses[-1]))[1]


def _worst_place(sources: Sources) -> str:
    """Return a sentence on the regime of motion with most of the unexplained error."""
    return comparison.worst_place(sources.comparisons[-1].frame) if sources.comparisons else ""


def _what_it_is(sources: Sources) -> str:
    """Return the headline of a page without comparison and diagnosis: the kind of tables that it shows."""
    best = [told for one in sources.metrics if _of_study(one) and (told := _best(one.frame))]
    if best:
        return f"Of these networks {listed(best)}."
    if sources.replays:
        return "Measured motion against simulated."
    if sources.metrics:
        return "Errors of models, axis by axis."
    if sources.leftover or sources.growth:
        return "The force of the water on a vehicle, and the force that its file does not explain."
    return "Sessions of a study."


def _of_study(one: Named) -> bool:
    """Return whether a metrics table has the errors of all networks of a study."""
    record = one.artefact.provenance
    return record.stage == "study" and record.parameters.get("part") in ("evaluation", "errors")


def _best(metrics: pl.DataFrame) -> str:
    """Return a clause on the network with the least error over all six axes; empty without errors."""
    found = metrics.filter(pl.col("axis") == "all", pl.col("metric") == "rmse", ~of_a_piece()).sort("value")
    if found["unit"].str.contains("N").any():
        found = found.filter(pl.col("variant") == "")
        did = "{model} predicts the wrench best, to {error} over all six axes"
    else:
        did = "{variant} replays best, to {error} m/s and rad/s"
    if found.is_empty():
        return ""
    row = found.row(0, named=True)
    return did.format(model=row["model"], variant=row["variant"], error=words.figure(row["value"]))
