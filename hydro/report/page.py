"""Report: one self-contained HTML page.

Each section is made from its artefacts and omitted without them.  The numbers of every figure are also in
text or in a table.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import polars as pl

from hydro.core.columns import COMMAND, VELOCITY
from hydro.core.effects.record import BOOKKEEPING
from hydro.core.evaluation.rolling_prediction import RESTART_INTERVAL
from hydro.core.explanation.ladder import HORIZON, best_step
from hydro.io import provenance as lineage
from hydro.io import vehicle as vehicles
from hydro.report import cards, change, errors, growth, leftover, plots, recorded, standing, words, yardsticks
from hydro.report.charts import Charts
from hydro.report.comparison import MOTIONS, failures
from hydro.report.figures import MEASURED, TITLES
from hydro.report.glossary import GLOSSARY
from hydro.report.rendering import rendered
from hydro.report.sources import Named, Sources
from hydro.report.standing import chosen_step
from hydro.report.words import DATASETS

Section = dict[str, Any] | None

FIRST_PLACES = 3
"""Number of regimes that are visible; the others are folded."""
MOST_SESSIONS = 12
"""Maximum number of sessions of a replay that can be chosen on the page."""
BEHIND = {"raw": "recording", "vehicle": "vehicle file"}
"""Names of input tables on the page."""
CONDITIONS = ("speed", "acceleration", "drift", "turn", "depth", "heading", "frequency", "session")
"""Kinds of condition in the order of the selector; other kinds follow."""


def render(sources: Sources) -> str:
    """Return the report as the text of one HTML page.

    Args:
        sources: Artefacts of the report.

    Returns:
        HTML that loads no other file.

    Raises:
        DataError: An artefact is inconsistent, for instance its values are not TOML.
    """
    charts = Charts()
    context = {
        "title": _title(sources),
        "answer": standing.answer(sources),
        "headline": standing.headline(sources),
        "errors": bool(standing.standings(sources)),
        "noise": standing.noise_line(sources),
        "step": standing.next_step(sources),
        "folded": bool(sources.comparisons or sources.diagnoses or sources.ladder),
        "model": _model(sources),
        "recorded": recorded.section(sources),
        "places": _places(sources, charts),
        "leftover": leftover.section(sources, charts),
        "growth": growth.section(sources),
        "change": change.section(sources),
        "findings": cards.findings(sources, charts),
        "ladder": _ladder(sources, charts),
        "replays": [_replay(sources, number, charts) for number in range(len(sources.replays))],
        "metrics": [errors.section(one, number, charts) for number, one in enumerate(sources.metrics)],
        "confusions": cards.confusions(sources),
        "next": cards.to_record(sources),
        "glossary": GLOSSARY,
        "provenance": _provenance(sources),
    }
    shown = (words.figure, words.percent, words.probability, words.prose)
    return rendered("template.html", charts, shown, **context)


def _title(sources: Sources) -> str:
    """Return the title of the page: the vehicle's name, if it is known."""
    text = sources.vehicle_text()
    return vehicles.parse(text).name if text else "Report"


def _model(sources: Sources) -> Section:
    """Return the section on prediction errors: main figures, all horizons, and simple predictors."""
    found = standing.standings(sources)
    if not found:
        return None
    held_out = any(one.dataset == "holdout" for one in found)
    return {
        "standings": found,
        "rows": list(standing.horizons(sources)),
        "held_out": held_out,
        "simple": _simple(sources),
    }


def _simple(sources: Sources) -> Section:
    """Return the section that compares the model with simple predictors, if possible on held-out data."""
    dataset = "fit"
    if sources.ladder is not None:
        ladder = sources.ladder.frame
        dataset = yardsticks.judged_on(ladder)
        found = yardsticks.of_ladder(ladder, best_step(ladder), dataset)
    else:
        found = yardsticks.of_comparison(sources.comparisons[-1].frame)
    if found.is_empty():
        return None
    return {
        "sentence": yardsticks.sentence(found),
        "lost": bool(yardsticks.verdict(found)),
        "on": DATASETS[dataset],
        "ahead": yardsticks.ahead(found),
        "columns": yardsticks.table(found).columns,
        "rows": yardsticks.table(found).rows(),
    }


# Where it fails.


def _places(sources: Sources, charts: Charts) -> Section:
    """Return the section on the worst regimes of motion, of the given and of the chosen model."""
    if not sources.comparisons:
        return None
    first = sources.comparisons[0].frame
    lists = [{"title": "The given model", "found": False, "places": list(_ranked(first))}]
    rows, step = first.filter(level="force", axis="all"), _last_comparison(sources)
    if step:
        frame = sources.comparisons[step].frame
        lists.append({"title": "With the findings added", "found": True, "places": list(_ranked(frame))})
        key = ["by", "place"]
        before = rows.select(*key, before="rmse", before_low="low", before_high="high")
        rows = frame.filter(level="force", axis="all").drop("before", strict=False)
        rows = rows.join(before, on=key, how="left", maintain_order="left")
    there = rows["by"].unique(maintain_order=True).to_list()
    kinds = [by for by in CONDITIONS if by in there]
    kinds += [by for by in there if by not in kinds and by not in ("all", "place")]
    kinds = [by for by in kinds if rows.filter(by=by).height > 1]
    if kinds:
        charts.add("conditions", *(plots.conditions(rows.filter(by=by)) for by in kinds))
    return {"lists": lists, "kinds": kinds, "both": "before" in rows.columns, "first": FIRST_PLACES}


def _last_comparison(sources: Sources) -> int:
    """Return the number of the comparison with the findings added; 0 if only the given file was compared."""
    return min(chosen_step(sources) or 0, len(sources.comparisons) - 1)


def _ranked(comparison: pl.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield the worst regimes of motion in order, with their shares of the error as widths of bars."""
    rows = comparison.filter(pl.col("rank").is_not_null()).sort("rank")
    samples = dict(comparison.filter(level="force", by="all").select("axis", "rows").iter_rows())
    ratios = failures(comparison)["ratio"]
    for row, ratio in zip(rows.iter_rows(named=True), ratios, strict=True):
        yield {
            "words": words.sentence(f"{MOTIONS.get(row['axis'], row['axis'])} {row['place']}").rstrip("."),
            "share": row["share"],
            "width": 100.0 * row["share"],
            "time": row["rows"] / samples.get(row["axis"], row["rows"]),
            "ratio": "" if ratio is None else f"{ratio:.1f}",
            "rmse": f"{words.figure(row['rmse'])} {row['unit']}",
        }


# Errors after each step.


def _ladder(sources: Sources, charts: Charts) -> Section:
    """Return the section on the errors step by step: a large figure of all axes, and a small one per axis."""
    if sources.ladder is None:
        return None
    frame = sources.ladder.frame
    horizons = frame.filter(axis="all")["horizon"].unique().sort(nulls_last=True).to_list()

    def at(axis: str) -> list[pl.DataFrame]:
        """Return the rows of one axis at every horizon."""
        rows = frame.filter(axis=axis)
        return [rows.filter(pl.col("horizon").eq_missing(pl.lit(one, pl.Float64))) for one in horizons]

    scales = [plots.wide(rows["rmse"]) for rows in at("all")]
    axes = [axis for axis in VELOCITY if all(rows.height for rows in at(axis))]
    for axis in ("all", *axes):
        drawn = zip(at(axis), scales, strict=True)
        charts.add(f"ladder-{axis}", *(plots.ladder(rows, logarithmic=far) for rows, far in drawn))
    units = dict(frame.select("axis", "unit").unique().iter_rows())
    return {
        "horizons": [words.horizon(one) for one in horizons],
        "chosen": horizons.index(HORIZON) if HORIZON in horizons else 0,
        "axes": [(axis, f"{TITLES[axis]} {axis}", units[axis]) for axis in axes],
        "steps": list(_rungs(frame)),
        "held_out": "holdout" in frame["dataset"],
        "columns": [(axis, units[axis]) for axis in ("all", *axes)],
        "best": best_step(frame),
        "changed": change.of_change(sources.ladder),
        "too_far": best_step(frame) < frame.select(pl.col("step").max()).item(),
        "values": list(_joint(sources)),
    }


def _rungs(frame: pl.DataFrame) -> Iterator[dict[str, Any]]:
    """Yield the rows of the ladder: every step and data set, with its errors at the main horizon."""
    rows = standing.at_horizon(frame)
    for (step, dataset), one in rows.group_by(["step", "dataset"], maintain_order=True):
        errors = dict(one.select("axis", "rmse").iter_rows())
        yield {
            "step": step,
            "added": words.effects_named(one["effect"][0]) or "the file as given",
            "dataset": DATASETS[str(dataset)],
            "errors": {axis: words.figure(value) for axis, value in errors.items()},
            "noise": words.figure(one.filter(axis="all").select("noise_floor").item(), 2),
        }


def _joint(sources: Sources) -> Iterator[dict[str, Any]]:
    """Yield the values in the resulting vehicle file, as fitted with all effects together."""
    for table in vehicles.parse(text).effect if (text := _resulting(sources)) else ():
        if "standard_error" not in table:
            continue
        given = {
            name: value
            for name, value in table.items()
            if name not in BOOKKEEPING and isinstance(value, int | float | list)
        }
        values = words.fitted(str(table["name"]), given, dict(table["standard_error"]))
        yield {
            "effect": words.effect_name(str(table["name"])),
            "values": [(one.name, words.with_error(one), one.unit) for one in values],
        }


def _resulting(sources: Sources) -> str | None:
    """Return the text of the vehicle file with the findings; None if nothing was added or it is not known."""
    step = _last_comparison(sources)
    return sources.comparisons[step].artefact.provenance.vehicle if step > 0 else None


# Measured against model.


def _replay(sources: Sources, number: int, charts: Charts) -> dict[str, Any]:
    """Return the section on one replay: measured and simulated motion of every session."""
    one = sources.replays[number]
    of_study = one.artefact.provenance.stage == "explain"
    held_out = sources.ladder is not None and "holdout" in sources.ladder.frame["dataset"]
    sessions = one.frame["session"].unique(maintain_order=True).to_list()
    shown = sessions[:MOST_SESSIONS]
    bands = sources.bands.frame if of_study and sources.bands is not None else None
    for axis in VELOCITY:
        drawn = (plots.overlay(one.frame, session, axis, bands) for session in shown)
        charts.add(f"overlay-{number}-{axis}", *drawn)
    restart = RESTART_INTERVAL if of_study else None
    charts.add(f"path-{number}", *(plots.path(one.frame, session, restart) for session in shown))
    charts.add(f"depth-{number}", *(plots.depth(one.frame, session, restart, bands) for session in shown))
    if thrusters := _thrusters(one):
        charts.add(f"commands-{number}", *(plots.commands(one.frame, name, thrusters) for name in shown))
    variants = one.frame["variant"].unique(maintain_order=True).to_list()
    return {
        "number": number,
        "commands": bool(thrusters),
        "name": one.name,
        "held_out": of_study and held_out,
        "restarted": f"{restart:g}" if restart else "",
        "sessions": shown,
        "hidden": len(sessions) - len(shown),
        "legend": [
            (label, colour, key == MEASURED) for key, (label, colour) in plots.curves(variants).items()
        ]
        + [("95 % band from the errors of its values", plots.BAND, True)] * (bands is not None),
        "axes": [(axis, f"{TITLES[axis]} {axis}") for axis in VELOCITY],
        "errors": list(_replay_errors(one.frame, shown, variants)),
    }


def _thrusters(replay: Named) -> list[str]:
    """Return the names of the thrusters; empty for a replay without commands."""
    columns = [name for name in replay.frame.columns if name.startswith(COMMAND)]
    if not columns or MEASURED not in replay.frame["variant"]:
        return []
    text = replay.artefact.provenance.vehicle
    names = [one.name for one in vehicles.parse(text).thruster] if text else []
    return names if len(names) == len(columns) else columns


def _replay_errors(frame: pl.DataFrame, sessions: Sequence[str], variants: Sequence[str]) -> Iterator[Any]:
    """Yield the root mean square error of every variant and axis over the shown sessions."""
    if MEASURED not in variants:
        return
    rows = frame.filter(pl.col("session").is_in(list(sessions)))
    measured = rows.filter(variant=MEASURED).select("session", "t", *VELOCITY)
    for name, (label, _) in plots.curves(variants).items():
        if name == MEASURED:
            continue
        both = rows.filter(variant=name).join(measured, on=["session", "t"], how="inner", suffix="_m")
        errors = both.select(
            (pl.col(axis).cast(pl.Float64) - pl.col(f"{axis}_m")).pow(2).mean().sqrt().alias(axis)
            for axis in VELOCITY
        )
        yield label, [words.figure(errors[axis][0]) for axis in VELOCITY]


def _provenance(sources: Sources) -> dict[str, Any]:
    """Return the files of the page, their inputs, and the resulting vehicle file."""
    files, inputs = [], dict[str, str]()
    for one in sources.everything:
        record = one.artefact.provenance
        files.append(
            {
                "name": one.name,
                "kind": record.kind,
                "stage": record.stage or "elsewhere",
                "version": record.package or "–",
                "content": record.content,
            }
        )
        inputs |= {node.content: node.kind for depth, node in lineage.lineage(record) if depth}
    return {
        "files": files,
        "inputs": [(BEHIND.get(kind, kind), content) for content, kind in inputs.items()],
        "version": lineage.package_version(),
        "vehicle": _resulting(sources),
    }
