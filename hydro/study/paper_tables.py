"""Result tables of a study of the paper of Wu et al.: trainings, differences of conditions, replays."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

from hydro.study import paper, policies
from hydro.study.steps import LEDGER

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import polars as pl

    from hydro.study.paper import Study
    from hydro.study.policies import Run

NOT_RUN, UNFINISHED, PASSED, BUDGET = "not run", "unfinished", "passed", "budget used"
"""States of a training: not begun, begun, all stages passed, or ended without passing all."""
FACTOR = 100.0
"""Critic's loss in multiples of its running median above which it diverges, see `training.divergence`."""
LASTING = 2
"""Points of a curve, of several hundred updates each, over which the loss stays above that."""


def trainings(study: Study, of: Sequence[Run] = ()) -> pl.DataFrame:
    """Return a table with a row for every training of a study, including those that were not run.

    Args:
        study: The study.
        of: Trainings; () stands for all of the study.

    Returns:
        Columns `recipe`, the settings; `condition`, the water model; `seed`; `state`; `steps` and `updates`
        so far; `updates_1` to `updates_3`, the SAC updates after which a stage was passed; `stages`, the
        number of passed stages; `processor`, the processor time in seconds; `diverged`, the kind of
        divergence or an empty text.
    """
    import polars as pl

    ledger = _ledger(study.folder)
    rows = [_training(study, run, ledger) for run in of or paper.runs(study)]
    numbers = ["steps", "updates", *(f"updates_{stage}" for stage in range(1, study.stages + 1))]
    kinds = dict.fromkeys(numbers, pl.Int64) | {"processor": pl.Float64}
    return pl.DataFrame(rows, schema_overrides=kinds)


def _ledger(folder: Path) -> dict[str, dict[str, str]]:
    """Return the record of the steps that are done, by command line; empty if there is none."""
    path = folder / LEDGER
    return json.loads(path.read_bytes()) if path.is_file() else {}


def _training(study: Study, run: Run, ledger: dict[str, dict[str, str]]) -> dict[str, Any]:
    """Return the row of one training."""
    import polars as pl

    from hydro.io import table

    row: dict[str, Any] = {"recipe": study.recipe, "condition": run.condition, "seed": run.seed}
    if not (run.folder / "evaluations.parquet").is_file():
        return row | {"state": NOT_RUN, "stages": None, "processor": None, "diverged": ""}
    found = table.read(run.folder / "evaluations.parquet", "evaluations").frame
    curves = table.read(run.folder / "curves.parquet", "curves").frame
    exams = found.filter(pl.col("purpose") == "exam", pl.col("success") >= study.policies.curriculum.share)
    first = {
        f"updates_{stage}": exams.filter(task=task, level=level)["updates"].min()
        for stage, (task, level) in enumerate(study.policies.levels, start=1)
    }
    stages = sum(value is not None for value in first.values())
    line = next(
        (name for name in ledger if name.startswith("rl train") and name.endswith(str(run.folder))), ""
    )
    ended = bool(line) or curves["steps"].to_numpy().max(initial=0) >= study.steps or stages == study.stages
    state = PASSED if stages == study.stages else BUDGET if ended else UNFINISHED
    done = {"state": state, "steps": curves["steps"].max(), "updates": curves["updates"].max()}
    spent = ledger.get(line, {}).get("processor")
    used = {"stages": stages, "processor": None if spent is None else float(spent)}
    return row | done | first | used | {"diverged": divergence(curves, found)}


def divergence(curves: pl.DataFrame, evaluations: pl.DataFrame) -> str:
    """Return the kind of divergence of a training: `numerical`, `critic`, `success`, or an empty text.

    Args:
        curves: Table of the training's curves: losses of the critic, and episodes that diverged numerically.
        evaluations: Table of the training's evaluations without exploration.
    """
    import numpy as np

    losses = curves["critic"].drop_nulls().to_numpy()
    medians = np.array([np.median(losses[: k + 1]) for k in range(len(losses))])
    above = losses > FACTOR * medians
    lasting = any(above[k : k + LASTING].all() for k in range(len(above) - LASTING + 1))
    shares = evaluations.filter(purpose="curve")["success"].to_list()
    fell = bool(shares) and max(shares) >= 0.5 and shares[-1] == 0.0
    found = {"numerical": bool((curves["diverged"] > 0).any()), "critic": lasting, "success": fell}
    return next((name for name, holds in found.items() if holds), "")


def flights(study: Study, of: Sequence[Run] = ()) -> pl.DataFrame:
    """Return the test flights of the trainings whose tests in all simulators are complete.

    Args:
        study: The study.
        of: Trainings; () stands for all of the study.

    Returns:
        The rows of all tables of kind `evaluations`, one per policy or pilot and test, with the columns
        `flown_by`, `condition`, `seed`, `plant` (simulator), `task`, `episodes` and `success` among others;
        an empty frame if no training is complete.
    """
    import polars as pl

    from hydro.io import table

    tests = policies.tests(study.policies)
    done = paper.finished(study, of or paper.runs(study))
    read = [table.read(run.tested(*test), "evaluations").frame for run in done for test in tests]
    return pl.concat(read) if read else pl.DataFrame()


def differences(tests: pl.DataFrame, first: str = "R_PhysFeat") -> pl.DataFrame:
    """Return the differences between the arrival rates of each other condition and the condition `first`.

    A condition is the water model in which policies were trained.  Its rate is that of all its policies
    together.  The 95 % interval is Newcombe's, from Wilson's intervals of both rates; it takes all flights as
    independent and so does not include the spread of trainings.

    Args:
        tests: Result of `flights`.
        first: Condition with which the others are compared.

    Returns:
        One row per simulator, task and other condition: `plant`, `task`, `condition`, `compared_with`
        (`first`), the numbers of trainings `seeds` and `compared_seeds`, and the `difference` with the ends
        `low` and `high` of its interval.
    """
    import polars as pl

    counted = (
        tests.filter(flown_by="policy")
        .with_columns(arrived=(pl.col("success") * pl.col("episodes")).round().cast(pl.Int64))
        .group_by("plant", "task", "condition", maintain_order=True)
        .agg(pl.col("arrived").sum(), pl.col("episodes").sum(), pl.col("seed").n_unique().alias("seeds"))
    )
    rows = []
    for (plant, task), each in counted.group_by("plant", "task", maintain_order=True):
        rates = {row["condition"]: row for row in each.to_dicts()}
        if first not in rates:
            continue
        for name, row in rates.items():
            if name != first:
                low, difference, high = _newcombe(row, rates[first])
                rows.append(
                    {"plant": plant, "task": task, "condition": name, "compared_with": first}
                    | {
                        "seeds": row["seeds"],
                        "compared_seeds": rates[first]["seeds"],
                        "difference": difference,
                        "low": low,
                        "high": high,
                    }
                )
    return pl.DataFrame(rows)


def _newcombe(one: dict[str, Any], other: dict[str, Any]) -> tuple[float, float, float]:
    """Return the low end, the value and the high end of the difference of two shares (95 % interval).

    Args:
        one: Row with the numbers `arrived` and `episodes` of one condition.
        other: Row of the other condition, whose share is subtracted.
    """
    from hydro.rl.training.evaluate import interval

    (p, low_p, high_p), (q, low_q, high_q) = (
        (row["arrived"] / row["episodes"], *interval(row["arrived"], row["episodes"])) for row in (one, other)
    )
    low = p - q - math.hypot(p - low_p, high_q - q)
    high = p - q + math.hypot(high_p - p, q - low_q)
    return low, p - q, high


def networks(study: Study) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return two tables with the errors of the networks so far: of the predicted wrench, and of the replay.

    Args:
        study: The study.

    Returns:
        One row per model and training `protocol`, with the columns of `report.tables.prediction_errors`; and
        one row per variant, protocol, `conditioning` and `lead`, with those of `replay_errors`.  A frame is
        empty if nothing was computed yet.
    """
    import polars as pl

    from hydro.io import table
    from hydro.report.tables import prediction_errors, replay_errors

    offline, replayed = list[pl.DataFrame](), list[pl.DataFrame]()
    for protocol in study.protocols:
        if study.offline(protocol).is_file():
            errors = prediction_errors(table.read(study.offline(protocol), "metrics").frame)
            offline.append(errors.with_columns(protocol=pl.lit(protocol)))
        for way in study.replays:
            if study.replayed(protocol, way).is_file():
                errors = replay_errors(table.read(study.replayed(protocol, way), "metrics").frame)
                named = {"protocol": protocol, "conditioning": way.conditioning, "lead": way.lead}
                replayed.append(errors.with_columns(pl.lit(value).alias(key) for key, value in named.items()))
    whole = (pl.concat(one, how="diagonal") if one else pl.DataFrame() for one in (offline, replayed))
    predicted, flown = whole
    return predicted, flown
