"""Results with a recording from before a change: residuals of the hull-force model before and after.

The hull-force model is fitted to the earlier recording and held fixed; it predicts the force that the vehicle
file does not explain.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import polars as pl

from hydro.core.columns import POSE, VELOCITY
from hydro.core.explanation.with_hull import AFTER, ALONE, BEFORE, BESIDE, FLOOR, LEVEL
from hydro.core.residual.hull import Hull, describes
from hydro.report import words
from hydro.report.screen import Text, table
from hydro.report.sources import Named, Sources

PARAMETER = "before"
"""Key of the parameters of a table for the recording before a change."""


def parameters_of(told: Mapping[str, Any], hull: Hull) -> dict[str, Any]:
    """Return the entry in a table's footer that describes the recording from before a change.

    Args:
        told: Name of the recording, and the network if there is one.
        hull: Hull-force model fitted to the recording.

    Returns:
        A dict with one key, for `parameters` of the table's provenance: `told` and the squared errors with
        the vehicle file alone (`given`) and with the hull-force model (`left`).  `fitted` is true if the
        file's effects were fitted to the recording first, and is left out otherwise.
    """
    figures = {"given": float(f"{hull.given:.4g}"), "left": float(f"{hull.left:.4g}")}
    fitted = {} if hull.completion is None else {"fitted": True}
    return {PARAMETER: {**told, **figures, **fitted}}


def of_change(one: Named) -> bool:
    """Return whether a table was made with an additional recording from before a change (`--before`)."""
    return PARAMETER in one.artefact.provenance.parameters


def section(sources: Sources) -> dict[str, Any] | None:
    """Return the section of the page on the recording before a change, as values for the template.

    Returns:
        A dict with the name of the `recording`, sentences `lines`, and `columns` and `rows` of a table of
        errors; None if no table was made with such a recording.
    """
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
    """Return a sentence on how well the hull-force model fits the recording from before the change.

    Args:
        before: Entry `before` of a table's parameters: name of the recording, and squared errors with the
            vehicle file alone and with the hull-force model, in units of the noise variance.
    """
    model = "with the hull-force model, on stretches left out of its fit"
    if before.get("fitted"):
        model = f"with the file's effects fitted to this recording and {model[5:]}"
    if "network" in before:
        learns = "was" if before.get("learnt") else "was not"
        model = f"with the network {before['network']}, which {learns} trained on it"
    fails = ""
    if not describes(before["given"], before["left"]):
        fails = " The model does not describe the vehicle, so no change is certain: improve the file first."
    return (
        f"On the earlier recording ({before['recording']}), the error of short predictions by the file is "
        f"{words.figure(math.sqrt(before['given']))} times that due to noise; {model}, it is "
        f"{words.figure(math.sqrt(before['left']))} times. A change that adds less error than that cannot be "
        f"found.{fails}"
    )


def told(parameters: Mapping[str, Any], chi2: tuple[float, ...]) -> str:
    """Return two sentences: on the fit of the hull-force model, and on the residual after the change.

    Args:
        parameters: Parameters of the diagnosis.
        chi2: Mean squared residuals of the diagnosis: first of the vehicle file as given, last with the
            findings added, in units of the mean squared residual of the hull-force model.
    """
    return f"{learnt(parameters[PARAMETER])} {left(chi2)}"


def left(chi2: tuple[float, ...]) -> str:
    """Return a sentence on the residuals of the recording after the change.

    Args:
        chi2: Mean squared residuals of the diagnosis: first of the vehicle file as given, last with the
            findings added, in units of the mean squared residual of the hull-force model.
    """
    first, last = math.sqrt(chi2[0]), math.sqrt(chi2[-1])
    found = f", and {last:.3g} times with the findings added" if last != first else ""
    return (
        f"On the later recording, the error with this model is {first:.3g} times that on the "
        f"earlier one{found}; 1 means that nothing else has changed."
    )


def errors(comparison: pl.DataFrame) -> pl.DataFrame:
    """Return a table of errors with the hull-force model, one row per axis; no rows without such a model.

    Args:
        comparison: Comparison table.

    Returns:
        Columns `axis`; root mean square prediction errors of the vehicle file alone, `file before` and `file
        after` the change; errors with the hull-force model, `model before` and `model after`; `ratio`, `model
        after` divided by `model before`; and `unit`.
    """
    rows = comparison.filter(level=LEVEL)
    table = rows.filter(pl.col("axis") != FLOOR).select("axis", "unit").unique(maintain_order=True)
    columns = {
        "file before": (ALONE, BEFORE),
        "file after": (ALONE, AFTER),
        "model before": (BESIDE, BEFORE),
        "model after": (BESIDE, AFTER),
    }
    for name, (by, place) in columns.items():
        told = rows.filter(by=by, place=place).select("axis", pl.col("rmse").alias(name))
        table = table.join(told, on="axis", how="left", maintain_order="left")
    ratio = pl.col("model after") / pl.col("model before")
    order = pl.col("axis").replace_strict({name: i for i, name in enumerate((*POSE, *VELOCITY))}, default=99)
    return table.sort(order).select("axis", *columns, ratio.alias("ratio"), "unit")


def table_of(comparison: pl.DataFrame) -> Iterator[Text]:
    """Yield the lines of a table for a terminal: errors with the hull-force model, one line per axis.

    Args:
        comparison: Comparison table.
    """
    shown = errors(comparison)
    seconds = comparison.filter(level=LEVEL)["horizon"][0]
    columns = ("file before", "file after", "model before", "model after", "ratio")
    yield from table(
        [f"Error {seconds:.2g} s ahead", *columns],
        (
            [f"  {row['axis']} [{row['unit']}]", *(words.figure(row[name]) for name in columns)]
            for row in shown.iter_rows(named=True)
        ),
    )
    yield Text("model: the file with the hull-force model; ratio: model after / model before.")


def fall(ladder: pl.DataFrame) -> Iterator[str]:
    """Yield a sentence for each data set with the prediction error of every step of a study.

    The unit is the error of the hull-force model on the recording from before the change; an error of 1 means
    that nothing else has changed.  Without a hull-force model there are no sentences.

    Args:
        ladder: Ladder table: prediction errors of each step of a study.
    """
    rows = ladder.filter(axis=FLOOR).sort("step")
    for dataset, label in words.DATASETS.items():
        steps = rows.filter(dataset=dataset).select("rmse", "effect").rows()
        if steps:
            named = [f"with {words.effects_named(effect)}" if effect else "as given" for _, effect in steps]
            told = [f"{rmse:.2f} {name}" for (rmse, _), name in zip(steps, named, strict=True)]
            yield (
                f"Error on {label}, divided by that of the hull-force model on the earlier recording "
                f"(about 1: no change is left): {', '.join(told)}."
            )


def title(comparison: pl.DataFrame) -> str:
    """Return the title of the table that `errors` makes of a comparison."""
    seconds = comparison.filter(level=LEVEL).select("horizon").row(0)[0]
    return (
        f"Errors of predictions over {seconds:.2g} s: of the file alone, and with the hull-force model, "
        "before and after"
    )


def summary(comparison: pl.DataFrame) -> str:
    """Return a sentence on the error after the change divided by the error before the change, over all axes.

    Both are errors with the hull-force model.  The sentence also names the axis with the largest ratio.  The
    text is empty if the comparison has no hull-force model.
    """
    table = errors(comparison)
    if table.is_empty():
        return ""
    rows = comparison.filter(level=LEVEL, axis=FLOOR, by=BESIDE)
    whole, low, high = rows.select("rmse", "low", "high").row(0)
    most = table.sort("ratio", descending=True).row(0, named=True)
    told = (
        f"The error after is {whole:.2f} times the error before, both with the hull-force model "
        f"(95 %: {low:.2f} to {high:.2f})"
    )
    if whole <= 1.0:
        return f"{told}: nothing has changed."
    return f"{told}; most in {most['axis']}, {most['ratio']:.1f} times."
