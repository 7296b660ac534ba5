"""What a recording from before a change has taught: what the hull's model leaves of it, and after."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import polars as pl

from hydro.core.columns import POSE, VELOCITY
from hydro.core.explanation.with_hull import AFTER, ALONE, BEFORE, BESIDE, FLOOR, LEVEL
from hydro.report import words
from hydro.report.screen import Text, table
from hydro.report.sources import Named, Sources

PARAMETER = "before"
"""Key of a table's parameters under which it says what it was told of a recording before."""


def of_change(one: Named) -> bool:
    """Whether a table was made with a recording before."""
    return PARAMETER in one.artefact.provenance.parameters


def section(sources: Sources) -> dict[str, Any] | None:
    """What the page tells of a recording before; None where no table was made with one."""
    every = [one.artefact.provenance.parameters for one in sources.everything]
    told = next((given[PARAMETER] for given in every if PARAMETER in given), None)
    if told is None:
        return None
    lines = [learnt(told)]
    if sources.ladder is not None:
        lines += fall(sources.ladder.frame)
    elif sources.diagnoses and (chi2 := sources.diagnoses[-1].artefact.provenance.parameters.get("chi2")):
        lines.append(left(tuple(chi2)))
    table = errors(sources.comparisons[0].frame) if sources.comparisons else pl.DataFrame()
    return {
        "recording": told["recording"],
        "lines": lines,
        "columns": table.columns,
        "rows": [
            [words.figure(one) if isinstance(one, float) else one for one in row] for row in table.rows()
        ],
    }


def learnt(before: Mapping[str, Any]) -> str:
    """What the recording before has taught, in a sentence.

    Args:
        before: Its entry of a table's parameters.
    """
    model = "with the hull-force model, on data that it was not fitted to"
    if "network" in before:
        learns = "was" if before.get("learnt") else "was not"
        model = f"with the network {before['network']}, which {learns} trained on it"
    return (
        f"Recording before, {before['recording']}: reduced chi-square (1: noise alone) "
        f"{before['given']:.3g} of the file, {before['left']:.3g} {model}."
    )


def told(parameters: Mapping[str, Any], chi2: tuple[float, ...]) -> str:
    """Return sentences on the hull-force model and on the residual after the changes.

    Args:
        parameters: Of the diagnosis.
        chi2: See `left`.
    """
    return f"{learnt(parameters[PARAMETER])} {left(chi2)}"


def left(chi2: tuple[float, ...]) -> str:
    """What a diagnosis of a change leaves, in a sentence.

    Args:
        chi2: Mean squared residuals of the diagnosis, in units of what the model of the hull leaves.
    """
    found = f", {chi2[-1]:.3g} with the findings added" if chi2[-1] != chi2[0] else ""
    return f"Recording after, in units of that (1: nothing has changed): {chi2[0]:.3g}{found}."


def errors(comparison: pl.DataFrame) -> pl.DataFrame:
    """Errors with the hull's model beside the file, one row per axis; no rows without such a model.

    Args:
        comparison: Comparison table.

    Returns:
        `axis`; errors of the file alone, before and after; with the hull, before (the `floor`) and `after`;
        and how many `times` the floor that is.
    """
    rows = comparison.filter(level=LEVEL)
    table = rows.filter(pl.col("axis") != FLOOR).select("axis", "unit").unique(maintain_order=True)
    columns = {
        "file before": (ALONE, BEFORE),
        "file after": (ALONE, AFTER),
        "floor": (BESIDE, BEFORE),
        "after": (BESIDE, AFTER),
    }
    for name, (by, place) in columns.items():
        told = rows.filter(by=by, place=place).select("axis", pl.col("rmse").alias(name))
        table = table.join(told, on="axis", how="left", maintain_order="left")
    times = pl.col("after") / pl.col("floor")
    order = pl.col("axis").replace_strict({name: i for i, name in enumerate((*POSE, *VELOCITY))}, default=99)
    return table.sort(order).select("axis", *columns, times.alias("times"), "unit")


def table_of(comparison: pl.DataFrame) -> Iterator[Text]:
    """Yield the same as a table of a terminal, an axis in a row."""
    shown = errors(comparison)
    seconds = comparison.filter(level=LEVEL)["horizon"][0]
    columns = ("file before", "file after", "floor", "after", "times")
    yield from table(
        [f"Error {seconds:.2g} s ahead", *columns],
        (
            [f"  {row['axis']} [{row['unit']}]", *(words.figure(row[name]) for name in columns)]
            for row in shown.iter_rows(named=True)
        ),
    )
    yield Text("floor and after: with the hull-force model; times: after / floor.")


def fall(ladder: pl.DataFrame) -> Iterator[str]:
    """What every step leaves in units of the floor, a sentence for each set of data; none without a floor.

    Args:
        ladder: Ladder table.
    """
    rows = ladder.filter(axis=FLOOR).sort("step")
    for dataset, label in words.DATASETS.items():
        steps = rows.filter(dataset=dataset).select("rmse", "effect").rows()
        if steps:
            told = [f"{rmse:.2f} {f'with {effect}' if effect else 'as given'}" for rmse, effect in steps]
            yield (
                f"Root mean square error on {label}, in units of what the model of the hull leaves of the "
                f"recording before (1: nothing has changed): {', '.join(told)}."
            )


def title(comparison: pl.DataFrame) -> str:
    """The title of the table of `errors`."""
    seconds = comparison.filter(level=LEVEL).select("horizon").row(0)[0]
    return (
        f"Errors of predictions over {seconds:.2g} s: of the file alone, and with the hull's model, "
        "before (the floor) and after"
    )


def summary(comparison: pl.DataFrame) -> str:
    """Whether there is more than the floor, and where most; empty without a model of the hull."""
    table = errors(comparison)
    if table.is_empty():
        return ""
    rows = comparison.filter(level=LEVEL, axis=FLOOR, by=BESIDE)
    whole, low, high = rows.select("rmse", "low", "high").row(0)
    most = table.sort("times", descending=True).row(0, named=True)
    told = (
        f"The error after is {whole:.2f} times the error before, both with the hull-force model "
        f"(95 %: {low:.2f} to {high:.2f})"
    )
    if whole <= 1.0:
        return f"{told}: nothing has changed."
    return f"{told}; most in {most['axis']}, {most['times']:.1f} times."
