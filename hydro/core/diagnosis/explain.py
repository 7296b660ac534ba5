"""What is missing, step by step: add the best finding, fit everything anew together, and look again.

Step 0 is the vehicle file as it is given.  Each later step adds the finding that explains most, refits it
with all effects that the file has or was given, and is held against the recording and against another one
that no fit has seen.  The errors of all steps make the ladder.  A step that raises the held-out error is the
last.  All steps are measured by the yardstick of step 0: its weights of the axes, and the simple predictors
that were fitted to the recording.  Without held-out data stretches of the recording take its place, each
predicted by the fit to all others.

With the hull that a recording before has taught, a step adds what changed most, and refits with it nothing
but the changes of earlier steps.  What it leaves is measured in units of what the model of the hull leaves of
the recording before, on held-out data too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from typing import Any

import polars as pl

from hydro.core.diagnosis.baseline import stable_shots, stable_start, weighed_fit
from hydro.core.diagnosis.before import BESIDE, FLOOR, fit_changes, with_hull
from hydro.core.diagnosis.before import LEVEL as OF_HULL
from hydro.core.diagnosis.diagnose import diagnose_log, settled
from hydro.core.diagnosis.findings import Diagnosis, extended, suspects, tables
from hydro.core.diagnosis.log_faults import Preprocessed, in_order, preprocess, sound
from hydro.core.diagnosis.model import Wanted
from hydro.core.diagnosis.transfer import left_out_error
from hydro.core.effects.catalogue import CATALOGUE, own_effects
from hydro.core.effects.record import BOOKKEEPING
from hydro.core.errors import DataError
from hydro.core.evaluation.compare import compare
from hydro.core.evaluation.yardsticks import LEVEL, PREDICTORS, Yardstick, column
from hydro.core.identification.fit import Fit
from hydro.core.identification.output_error import OutputError
from hydro.core.identification.parameters import free
from hydro.core.identification.tracking import tracked
from hydro.core.progress import Progress, part, silent
from hydro.core.recording.arrays import recording
from hydro.core.residual.hull import Hull
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle

Table = Mapping[str, Any]

MOST_STEPS = 6
"""The file as given not counted."""
HORIZON = 5.0
"""How far ahead the predictions look by whose error steps are compared [s]."""
RISE = 1.02
"""Held-out error over that of the step before from which a step counts as a step too far."""
STEP_VERDICTS = ("missing", "cannot_tell_apart")
"""Verdicts that make a step; new values of what is there already come along with it."""
LIKELY = 0.3
"""Confidence from which a suspect makes a step where nothing is stated; data left out decide if it stays."""
UNEXPLAINED = ("none_of_the_known", "far_from_noise")
"""Verdicts that something is left which no effect explains."""
Beyond = Callable[[Vehicle, Preprocessed, Diagnosis, Progress], Diagnosis]
"""A diagnosis of a vehicle and a recording, and what lies beyond its catalogue."""
DATASETS = ("fit", "holdout")
LEFT_OUT = "left_out"
"""The axis of all channels together, of stretches of the recording left out of the fit, in their noise."""
RUNG = ("dataset", "axis", "horizon", "rmse", "low", "high", "noise_floor", "unit")


@dataclass(frozen=True)
class Step:
    """One step.

    Attributes:
        number: 0 is the file as given.
        added: Effects that the step added, or gave new values to where it added none; none of step 0.
        tables: All effects that were fitted together, with their standard errors; none of step 0.
        vehicle: The vehicle with them.
        comparison: It against the recording, see `evaluation.compare`.
        diagnosis: What is missing in it, see `diagnosis.findings`.
        chi2: Of the diagnosis.
        ladder: The errors of this step, the rows of the ladder table.
        estimates: The values of `tables` with their covariance; None of step 0.
    """

    number: int
    added: tuple[str, ...]
    tables: tuple[dict[str, Any], ...]
    vehicle: Vehicle
    comparison: pl.DataFrame
    diagnosis: pl.DataFrame
    chi2: tuple[float, ...]
    ladder: pl.DataFrame
    estimates: Estimates | None = None

    def error(self, dataset: str) -> float | None:
        """Error of all velocities together, predicted HORIZON ahead [m/s]; None without such data."""
        row = self.ladder.filter(dataset=dataset, axis="all", horizon=HORIZON)
        return None if row.is_empty() else float(row["rmse"][0])


@dataclass(frozen=True)
class Recordings:
    """What all steps are held against, preprocessed once.

    Attributes:
        log: The recording that everything is fitted to.
        holdout: The held-out one; None without one.
        yardstick: What the file as given, and all steps, are measured by.
        hull: What a recording before a change has taught; None without one.
        problem: Where nothing else tells what a step is worth, shots of the recording to leave out.
    """

    log: Preprocessed
    holdout: Preprocessed | None
    yardstick: Yardstick
    hull: Hull | None
    problem: OutputError | None

    @classmethod
    def of(
        cls, vehicle: Vehicle, raw: pl.DataFrame, holdout: pl.DataFrame | None, hull: Hull | None
    ) -> Recordings:
        """Preprocess both, the held-out one with the same order of its commands."""
        log, other = preprocess(vehicle, raw), None
        if holdout is not None:
            found = sound(vehicle, holdout)
            ordered = in_order(found.raw, log.wiring)
            record = replace(recording(vehicle, ordered), sigma=found.record.sigma)
            other = Preprocessed(ordered, tracked(vehicle, record), ())
        problem = stable_start(vehicle, log)[1] if holdout is None and hull is None else None
        return cls(log, other, Yardstick.of(vehicle, log.raw), hull, problem)

    def compared(self, vehicle: Vehicle, log: Preprocessed, progress: Progress) -> pl.DataFrame:
        """A vehicle against one of them, with the hull's rows where there is a hull."""
        found = compare(vehicle, log.raw, yardstick=self.yardstick, progress=progress)
        return found if self.hull is None else with_hull(found, vehicle, log, self.hull)

    def left_out(self, vehicle: Vehicle, fitted: Sequence[Table]) -> Iterator[dict[str, Any]]:
        """The rung of stretches left out of the fit, where it has to tell what a step is worth."""
        if self.problem is not None:
            error = left_out_error(vehicle, [str(table["name"]) for table in fitted], self.problem)
            row = {"dataset": "fit", "axis": LEFT_OUT, "horizon": self.problem.shots.seconds, "rmse": error}
            yield row | {"low": None, "high": None, "noise_floor": 1.0, "unit": "1"}


def explain(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    holdout: pl.DataFrame | None = None,
    hull: Hull | None = None,
    done: Sequence[Step] = (),
    beyond: Beyond | None = None,
    progress: Progress | None = None,
) -> Iterator[Step]:
    """Add what is missing until nothing more is found.

    Args:
        vehicle: The model.
        raw: Raw table of the measured motion and commands.
        holdout: Another one, which nothing is fitted to.
        hull: What a recording before a change has taught (`diagnosis.diagnose.hull_of`): then what has
            changed since is added, and the hull's law and the file's own values are held.
        done: First steps of the same study that are known already.
        beyond: Looks further where a diagnosis names nothing, see `core.discovery`.
        progress: Called with a few words and the share of the present step that is done.

    Yields:
        Each step that was not done, once it is; `ending` says why the last is the last.

    Raises:
        DataError: A recording or the vehicle is at fault, or a recording is too short.
    """
    for recorded in (raw, holdout):
        if recorded is not None:
            long_enough(vehicle, recorded, beside=hull is not None)
    steps = list(done)
    if steps and ending(steps):
        return
    recordings, progress = Recordings.of(vehicle, raw, holdout, hull), progress or silent
    while not (steps and ending(steps)):
        steps.append(_next(steps, vehicle, recordings, progress, beyond))
        yield steps[-1]


def long_enough(vehicle: Vehicle, raw: pl.DataFrame, *, beside: bool = False) -> None:
    """Hold a recording to what the ladder needs of it, with the model of a hull beside the file or without.

    Raises:
        DataError: It does not fit the vehicle, or no session lasts HORIZON; or, with the model of a hull,
            there are too few shots.
    """
    record = recording(vehicle, raw)
    rows = round(HORIZON / record.dt) + 1
    if (record.segments[:, 1] - record.segments[:, 0]).max() < rows:
        raise DataError(f"no session lasts {HORIZON:g} s without a gap; record longer sessions")
    if beside:
        stable_shots(vehicle, Preprocessed(raw, tracked(vehicle, record), ()))


def ending(steps: Sequence[Step]) -> str:
    """Why no step follows the last of these, in words; empty where one does."""
    last = steps[-1]
    if best(steps) is not last:
        held_out = not last.ladder.filter(dataset="holdout").is_empty()
        data = "the held-out data" if held_out else "stretches that it was not fitted to"
        return (
            f"step {last.number} predicts {data} worse than step {last.number - 1}, which is the one to use"
        )
    if not _finding(last):
        known = last.diagnosis.filter(pl.col("verdict").is_in(UNEXPLAINED)).is_empty()
        words = "nothing more has changed" if _of_change(last) else "nothing more is found"
        words = words if known else "what is left no effect of the catalogue explains"
        suspected = ", ".join(suspects(last.diagnosis))
        return f"{words}; only suspected, and not added: {suspected}" if suspected else words
    return f"{MOST_STEPS} steps are the most, though more is found" if last.number >= MOST_STEPS else ""


def best(steps: Sequence[Step]) -> Step:
    """The step to use: the last, or the one before where the last went too far."""
    return steps[best_step(pl.concat(step.ladder for step in steps))]


def best_step(ladder: pl.DataFrame) -> int:
    """Number of the step to use in a ladder: the last, or the one before it where that predicts better.

    Held-out predictions HORIZON ahead decide, or those with the hull beside the file where its model is
    known; without such data stretches left out of the fit.
    """
    held_out = ladder.filter(dataset="holdout")
    tried = (
        held_out.filter(axis=FLOOR),
        held_out.filter(axis="all", horizon=HORIZON),
        ladder.filter(axis=LEFT_OUT),
    )
    rows = next((one.sort("step") for one in tried if not one.is_empty()), held_out)
    last, errors = int(ladder["step"].max() or 0), rows["rmse"].to_list()  # type: ignore[arg-type]
    return last - 1 if len(errors) > 1 and errors[-1] > RISE * errors[-2] else last


def _finding(step: Step) -> dict[str, Table]:
    """What the next step fits anew, by effect: the best that is missing first, then new values.

    New values alone make a step only where the effects have not been fitted in this one.
    """
    with_values = step.diagnosis.filter(pl.col("parameters") != "")
    if _of_change(step):
        return _change(step, with_values)
    missing = with_values.filter(pl.col("verdict").is_in(STEP_VERDICTS)).sort("rank")["effect"].to_list()
    if not missing:
        fitted = {table["name"] for table in step.tables}
        missing = _likely(with_values, fitted) or _discovered(with_values)
    retuned = with_values.filter(verdict="retune").sort("rank")["effect"].to_list()
    if not missing and {table["name"] for table in step.tables}.issuperset(retuned):
        return {}
    wanted = [*missing[:1], *retuned]
    return {table["name"]: table for table in tables(step.diagnosis, wanted)}


def _of_change(step: Step) -> bool:
    """Whether the step tells of what has changed since a recording before."""
    return not step.ladder.filter(axis=FLOOR).is_empty()


def _change(step: Step, findings: pl.DataFrame) -> dict[str, Table]:
    """The best change that is stated, or else likely, and has not been fitted in the step."""
    fitted = {table["name"] for table in step.tables}
    stated = findings.filter(pl.col("verdict").is_in((*STEP_VERDICTS, "retune"))).sort("rank")["effect"]
    names = [name for name in stated if name not in fitted] or _likely(findings, fitted)
    return {table["name"]: table for table in tables(step.diagnosis, names[:1])} if names else {}


def _likely(findings: pl.DataFrame, fitted: AbstractSet[str]) -> list[str]:
    """Suspects that are not unlikely and have not been fitted in the step."""
    likely = findings.filter(pl.col("confidence") >= LIKELY, verdict="suspect")
    names = likely.sort("rank")["effect"].to_list()
    return [name for name in names if name not in fitted]


def _discovered(findings: pl.DataFrame) -> list[str]:
    """The formula that was discovered beyond the catalogue."""
    formulas = [name for name, effect in CATALOGUE.items() if effect.words]
    return findings.filter(pl.col("effect").is_in(formulas), verdict="suspect")["effect"].to_list()


def _next(
    steps: Sequence[Step], file: Vehicle, recordings: Recordings, progress: Progress, beyond: Beyond | None
) -> Step:
    """The step after these."""
    number, added, fit = len(steps), (), None  # type: int, tuple[str, ...], Fit | None
    chance: list[dict[str, Any]] = []
    log, hull = recordings.log, recordings.hull
    if steps:
        last, found = steps[-1], _finding(steps[-1])
        is_new = next(iter(found)) not in {effect["name"] for effect in last.vehicle.effect}
        added = (next(iter(found)),) if is_new else tuple(found)
        progress("all together", 0.0)
        every = (*last.tables, *found.values())
        chance = [dict(one) for one in every if CATALOGUE[one["name"]].is_random]
        if hull is None:
            there = extended(last.vehicle, [_bare(one) for one in chance])
            fit = _fit_together(there, log, _wanted(last, found), file)
        else:
            fit = fit_changes(file, log, hull, [_bare(one) for one in (*last.tables, *found.values())])
    fitted = (*(fit.tables() if fit else ()), *chance)
    vehicle = extended(file, fitted)
    compared = [recordings.compared(vehicle, log, part(progress, 0.3, 0.5))]
    if recordings.holdout is not None:
        compared.append(recordings.compared(vehicle, recordings.holdout, part(progress, 0.5, 0.6)))
    # Standard errors from this recording are no second opinion on it.
    plain = extended(file, [_bare(table) for table in fitted])
    rungs = [_rungs(number, added, *pair) for pair in zip(DATASETS, compared, strict=False)]
    rungs += [_rung(number, added, row) for row in recordings.left_out(vehicle, fitted)]
    rest = part(progress, 0.6, 0.9 if beyond else 1.0)
    diagnosis = diagnose_log(plain, log, hull=hull, further=number > 0, file=file, progress=rest)
    if beyond is not None:
        diagnosis = beyond(plain, log, diagnosis, part(progress, 0.9, 1.0))
    return Step(
        number,
        added,
        fitted,
        vehicle,
        compared[0],
        diagnosis.frame(),
        diagnosis.chi2,
        pl.concat(rungs, how="diagonal_relaxed"),
        fit.estimates() if fit else None,
    )


def _fit_together(vehicle: Vehicle, log: Preprocessed, wanted: Wanted, file: Vehicle) -> Fit | None:
    """Effects fitted together, from the values that the last diagnosis found, with their standard errors.

    What the recording does not show stays as it stands in the file of step 0.
    """
    if not wanted:
        return None
    unknown = free(vehicle, wanted, reach=log.track)
    begun = unknown.at(unknown.starts[0])
    start, problem = stable_start(begun, log)
    if start is not begun:
        names = [one if isinstance(one, str) else str(one["name"]) for one in wanted]
        vehicle, wanted = start, [name for name in names if start.effects(name)]
    model, _, _ = weighed_fit(vehicle, wanted, problem, log, share=0.0)
    return settled(model, file)[1]


def _wanted(last: Step, found: Mapping[str, Table]) -> list[str | Table]:
    """What is fitted together: the file's own effects and all added, from their values, and what is new.

    What acts by chance is estimated by the diagnosis, not by a fit.
    """
    known = dict.fromkeys([*own_effects(last.vehicle), *(table["name"] for table in last.tables)])
    new = [_bare(table) for name, table in found.items() if not CATALOGUE[name].is_random]
    return [*(name for name in known if name not in found and not CATALOGUE[name].is_random), *new]


def _bare(table: Table) -> dict[str, Any]:
    """An effect's values alone."""
    return {key: value for key, value in table.items() if key not in BOOKKEEPING or key == "name"}


def _rungs(number: int, added: Sequence[str], dataset: str, comparison: pl.DataFrame) -> pl.DataFrame:
    """Rows of the ladder from one comparison: the errors of predictions over all of the recording.

    With the model of the hull also that of all channels together in units of its floor.
    """
    key = ["axis", "horizon"]
    beside = (pl.col("level") == OF_HULL) & (pl.col("axis") == FLOOR) & (pl.col("by") == BESIDE)
    own = (pl.col("level") == "replay") & (pl.col("by") == "all")
    rungs = comparison.filter(own | beside).select(
        pl.lit(number, pl.Int64).alias("step"),
        pl.lit(", ".join(added)).alias("effect"),
        *(pl.lit(dataset).alias(name) if name == "dataset" else name for name in RUNG),
    )
    for name in PREDICTORS:
        simple = comparison.filter(level=LEVEL, by=name).select(*key, pl.col("rmse").alias(column(name)))
        rungs = rungs.join(simple, on=key, how="left", nulls_equal=True, maintain_order="left")
    return rungs.select(pl.exclude("unit"), "unit")


def _rung(number: int, added: Sequence[str], row: Mapping[str, Any]) -> pl.DataFrame:
    """A rung that no comparison has."""
    known: dict[str, Any] = {"step": number, "effect": ", ".join(added)}
    return pl.DataFrame([{**known, **row}], schema_overrides={"low": pl.Float64, "high": pl.Float64})
