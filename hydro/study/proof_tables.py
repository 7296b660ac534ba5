"""Result tables of a study of one change: held-out errors, found and true values, and arrivals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hydro.core.effects.record import BOOKKEEPING
from hydro.core.evaluation.yardsticks import PREDICTORS, column
from hydro.core.explanation.ladder import HORIZON
from hydro.core.interval import NORMAL_95
from hydro.study import proof

if TYPE_CHECKING:
    from pathlib import Path

    import polars as pl

    from hydro.core.vehicle.description import Vehicle
    from hydro.study.proof import Study

GIVEN, ORACLE = "file as given", "file with the true change"
"""Names of the first and the last row of the errors."""
FLOWN = ("seed", "updates", "episodes", "success", "success_low", "success_high")
"""Columns of the flights that are those of evaluations."""


def errors(study: Study) -> pl.DataFrame:
    """Return a table of the velocity errors 5 s ahead on held-out data, with all axes weighted together.

    Args:
        study: The study, in which `explain` was run.

    Returns:
        Columns `method`: the file, every step of `explain`, the simple predictors and the file with the true
        change; `error` [m/s] with `low` and `high`, a 95 % interval of a block bootstrap, where there is one.
    """
    import polars as pl

    from hydro.io import table

    ladder = table.read(study.explained / "ladder.parquet", "ladder").frame
    steps = ladder.filter(dataset="holdout", axis="all", horizon=HORIZON).sort("step")
    rows = [
        {"method": f"step {row['step']}: {row['effect']}" if row["step"] else GIVEN, **_error(row)}
        for row in steps.iter_rows(named=True)
    ]
    rows += [{"method": name, "error": steps[column(name)][0]} for name in PREDICTORS]
    oracle = table.read(study.oracle, "comparison").frame
    (row,) = oracle.filter(level="replay", by="all", axis="all", horizon=HORIZON).to_dicts()
    schema = {"method": pl.String} | dict.fromkeys(("error", "low", "high"), pl.Float64)
    return pl.DataFrame([*rows, {"method": ORACLE, **_error(row)}], schema=schema)


def _error(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return an error and the ends of its interval from a row of a comparison or ladder."""
    return {"error": row["rmse"], "low": row["low"], "high": row["high"]}


def named(study: Study, after: Path) -> pl.DataFrame:
    """Return a table of every value that the finding or the truth changes in the vehicle file.

    Args:
        study: The study.
        after: Vehicle file with the finding.

    Returns:
        Columns `value`, its name, such as `thruster_gain g[3]` for the third thruster; `given`, null in a new
        effect; `found` with the 95 % interval `low` to `high`; `true`, 0 if the true vehicle has no such
        effect.
    """
    from hydro.io import vehicle

    given, found, true = (vehicle.read(path)[0] for path in (study.vehicle, after, study.truth))
    return changes(given, found, true)


def changes(given: Vehicle, found: Vehicle, true: Vehicle) -> pl.DataFrame:
    """Return a table of the values in which a found or a true vehicle differs from a given one.

    Args:
        given: Vehicle as given.
        found: Vehicle with the finding, and its standard errors.
        true: Vehicle with the true change.

    Returns:
        Columns `value` (name), `given`, `found` with the 95 % interval `low` to `high`, and `true`, as in
        `named`; values of new effects come first.
    """
    import polars as pl

    before, ours, theirs = (_values(one) for one in (given, found, true))
    spread = _values(found, errors=True)
    names = [
        name
        for name in dict.fromkeys([*ours, *theirs])
        if any(one.get(name, 0.0) != before.get(name, 0.0) for one in (ours, theirs))
    ]
    names.sort(key=lambda name: name in before)  # new effects first, then new values of the file's effects
    rows = [
        {
            "value": name,
            "given": before.get(name),
            "found": ours.get(name, 0.0),
            "low": ours.get(name, 0.0) - NORMAL_95 * spread[name] if name in spread else None,
            "high": ours.get(name, 0.0) + NORMAL_95 * spread[name] if name in spread else None,
            "true": theirs.get(name, 0.0),
        }
        for name in names
    ]
    schema = {"value": pl.String} | dict.fromkeys(("given", "found", "low", "high", "true"), pl.Float64)
    return pl.DataFrame(rows, schema=schema)


def _values(vehicle: Vehicle, *, errors: bool = False) -> dict[str, float]:
    """Return the numbers of all effects of a vehicle, or their standard errors, by name."""
    found = dict[str, float]()
    for effect in vehicle.effect:
        table = effect.get("standard_error", {}) if errors else effect
        for key, value in table.items():
            if key not in BOOKKEEPING:
                found |= {f"{effect['name']} {key}{place}": number for place, number in _numbers(value)}
    return found


def _numbers(value: Any) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a parameter with their places, counted from 1; nothing for a text."""
    numbers = np.asarray(value)
    if numbers.dtype.kind not in "fiu":
        return
    for at in np.ndindex(numbers.shape):
        yield "".join(f"[{one + 1}]" for one in at), float(numbers[at])


def flights(study: Study) -> pl.DataFrame:
    """Return the test flights of all policies that were tested, and of the pilot, one row per test.

    Args:
        study: The study.

    Returns:
        Columns `flown_by` (policy or helmsman), `file` (before or after the finding), `vehicle` (changed or
        unchanged), `seed`, `updates`, `episodes`; the share `success` of arrivals.  Wilson's 95 % interval is
        `success_low` to `success_high`.
    """
    import polars as pl

    from hydro.io import table

    tests = [(run.file, flown, run.tested(flown)) for run in study.runs for flown in run.tests]
    tests += [(proof.BEFORE, flown, study.piloted(flown)) for flown in (proof.CHANGED, proof.UNCHANGED)]
    parts = [
        table.read(path, "evaluations").frame.select(
            "flown_by", *FLOWN, file=pl.lit(file), vehicle=pl.lit(flown)
        )
        for file, flown, path in tests
        if path.is_file()
    ]
    return pl.concat(parts)


def pooled(flights: pl.DataFrame) -> pl.DataFrame:
    """Return the arrivals over all seeds, with Wilson's interval and the smallest and largest rate of a seed.

    The interval counts episodes as independent, so it does not include the scatter between trainings.

    Args:
        flights: Result of the function `flights`.

    Returns:
        One row for each pilot or kind of policy and vehicle, with the columns `flown_by`, `file`, `vehicle`,
        `seeds`, `episodes`, `success` (rate), `success_low`, `success_high`, `least`, `most`.
    """
    import polars as pl

    from hydro.rl.training.evaluate import interval

    key = ("flown_by", "file", "vehicle")
    arrived = (pl.col("success") * pl.col("episodes")).round().cast(pl.Int64)
    together = flights.group_by(key, maintain_order=True).agg(
        pl.len().alias("seeds"),
        pl.col("episodes").sum(),
        arrived.sum().alias("arrived"),
        pl.col("success").min().alias("least"),
        pl.col("success").max().alias("most"),
    )
    rows = []
    for row in together.iter_rows(named=True):
        low, high = interval(row["arrived"], row["episodes"])
        share = row.pop("arrived") / row["episodes"]
        rows.append(row | {"success": share, "success_low": low, "success_high": high})
    return pl.DataFrame(rows)
