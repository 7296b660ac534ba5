"""The report: one HTML page that holds everything, in the order in which the story is told.

Each section is made from the artefacts that it needs and is left out where they are not there.  What a figure
shows stands in words or in a table too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

import plotly.graph_objects as go
import polars as pl

from hydro.core.advice import separating
from hydro.core.effects import CATALOGUE
from hydro.core.explain import best_step
from hydro.io import provenance as lineage
from hydro.io import vehicle as vehicles
from hydro.report import plots, words
from hydro.report.comparison import MOTIONS
from hydro.report.figures import MEASURED, TITLES
from hydro.report.sources import Named, Sources
from hydro.report.tables import VELOCITIES

Section = dict[str, Any] | None

HORIZON = 5.0
"""How far ahead the predictions look that the headline speaks of [s]."""
SESSIONS = 12
"""Sessions of a replay that can be chosen on the page."""
FAMILIES = ("speed", "acceleration", "drift", "turn", "depth", "heading", "frequency", "session")
"""Kinds of condition that the errors are shown by first, in this order."""


@dataclass
class Charts:
    """Figures of the page: for each place of it one, or one for each choice of a selector."""

    held: dict[str, list[str]] = field(default_factory=dict)

    def add(self, name: str, *drawn: go.Figure) -> str:
        """Keep the figures of one place; its name."""
        self.held[name] = [one.to_json() for one in drawn]
        return name

    def json(self) -> str:
        """All of them, as JSON that may stand in a script element."""
        held = ",".join(f'"{name}":[{",".join(drawn)}]' for name, drawn in self.held.items())
        return f"{{{held}}}".replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def render(sources: Sources) -> str:
    """The page.

    Args:
        sources: What there is to report on.

    Returns:
        HTML that needs nothing from elsewhere.

    Raises:
        DataError: an artefact contradicts itself, such as values that are not TOML.
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    charts = Charts()
    context = {
        "title": _title(sources),
        "headline": headline(sources),
        "model": _model(sources),
        "places": _places(sources, charts),
        "findings": _findings(sources, charts),
        "ladder": _ladder(sources, charts),
        "replays": [_replay(one, number, charts) for number, one in enumerate(sources.replays)],
        "metrics": [_metrics(one, number, charts) for number, one in enumerate(sources.metrics)],
        "confusions": _confusions(sources),
        "next": _next(sources),
        "provenance": _provenance(sources),
    }
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"figure": words.figure, "percent": words.percent, "sentence": words.sentence}
    page = environment.from_string(_template()).render(
        context,
        charts=Markup(charts.json()),
        plotly=Markup(get_plotlyjs().replace("</script", "<\\/script")),
    )
    return page


@cache
def _template() -> str:
    return resources.files("hydro.report").joinpath("template.html").read_text(encoding="utf-8")


def _title(sources: Sources) -> str:
    """The vehicle's name, or what the page is."""
    text = sources.vehicle_text()
    return vehicles.parse(text).name if text else "Report"


# How good the model is.


@dataclass(frozen=True)
class Standing:
    """How good the model is on one set of data, before and after.

    Attributes:
        data: What it was measured on, in words.
        horizon: How far ahead the predictions look [s].
        before: Error of the file as given.
        after: Error with what was found; None where nothing was added.
        noise: What noise alone would leave.
        unit: Of all of them.
    """

    data: str
    horizon: float | None
    before: float
    after: float | None
    noise: float
    unit: str

    @property
    def left(self) -> float | None:
        """Part of the error that is left."""
        return None if self.after is None or self.before == 0.0 else self.after / self.before


def standings(sources: Sources) -> list[Standing]:
    """How good the model is, on the recording first and then on held-out data."""
    if sources.ladder is not None:
        return _from_ladder(sources.ladder.frame)
    if not sources.comparisons:
        return []
    first, last = sources.comparisons[0].frame, sources.comparisons[-1].frame
    whole = last.filter(level="replay", by="all", axis="all").sort("horizon")
    if whole.is_empty():
        return []
    row = _at_horizon(whole).row(0, named=True)
    before, after = row["rmse"], None
    if len(sources.comparisons) > 1:
        same = pl.col("horizon").eq_missing(row["horizon"])
        earlier = first.filter(same, level="replay", by="all", axis="all")
        before, after = (earlier["rmse"][0] if earlier.height else row["rmse"]), row["rmse"]
    elif row.get("before") is not None:
        before, after = row["before"], row["rmse"]
    return [Standing("the recording", row["horizon"], before, after, row["noise_floor"], row["unit"])]


def _from_ladder(ladder: pl.DataFrame) -> list[Standing]:
    """Standings of the data sets of a ladder."""
    found = []
    for name, (label, *_) in plots.DATASETS.items():
        rows = _at_horizon(ladder.filter(dataset=name, axis="all")).sort("step")
        if rows.is_empty():
            continue
        chosen = rows.filter(step=best_step(ladder))
        given, last = rows.row(0, named=True), (chosen if chosen.height else rows.tail(1)).row(0, named=True)
        after = last["rmse"] if last["step"] > given["step"] else None
        unit, noise = given["unit"], last["noise_floor"]
        found.append(Standing(label, given["horizon"], given["rmse"], after, noise, unit))
    return found


def _at_horizon(rows: pl.DataFrame) -> pl.DataFrame:
    """The rows at HORIZON, or else at the longest that there is."""
    known = [one for one in rows["horizon"].unique().to_list() if one is not None]
    chosen = HORIZON if HORIZON in known else max(known, default=None)
    return rows.filter(pl.col("horizon").eq_missing(pl.lit(chosen, pl.Float64)))


def headline(sources: Sources) -> str:
    """The story in one or two sentences, with figures."""
    found = standings(sources)
    if not found:
        return _first_finding(sources) or _what_it_is(sources)
    first = found[0]
    look = f"Looking {first.horizon:g} s ahead" if first.horizon is not None else "Over a whole run"
    begin = f"{look}, the model as given errs by {words.figure(first.before)} {first.unit}"
    noise = f"noise alone would leave {words.figure(first.noise, 2)}"
    if first.after is None:
        return f"{begin}; {noise}. {_first_finding(sources)}".strip()
    added = _added(sources)
    with_it = f"with {added} added" if added else "with what was found"
    told = f"{begin}, and {with_it} by {words.figure(first.after)}; {noise}."
    for other in found[1:]:
        if other.after is not None:
            told += (
                f" On data that it was not fitted to: {words.figure(other.before)} before, "
                f"{words.figure(other.after)} after."
            )
    return told


def _added(sources: Sources) -> str:
    """Everything that the steps added, in words."""
    if sources.ladder is None:
        return ""
    steps = sources.ladder.frame.filter(pl.col("step") <= best_step(sources.ladder.frame))
    named = steps.sort("step")["effect"].unique(maintain_order=True).to_list()
    names = dict.fromkeys(name for one in named for name in one.split(", ") if name)
    return words.listed([words.effect_name(name) for name in names])


def _first_finding(sources: Sources) -> str:
    """The verdict of the first finding of the last diagnosis."""
    if not sources.diagnoses or sources.diagnoses[-1].frame.is_empty():
        return ""
    return words.verdict(sources.diagnoses[-1].frame.sort("rank").row(0, named=True))[1]


def _what_it_is(sources: Sources) -> str:
    """What the page shows where there is neither comparison nor diagnosis."""
    kinds = [one.artefact.kind for one in sources.everything]
    return "Measured motion against simulated." if "replay" in kinds else "Errors of models, axis by axis."


def _model(sources: Sources) -> Section:
    """Figures at a glance, and the errors at every horizon."""
    found = standings(sources)
    if not found:
        return None
    rows = list(_horizons(sources))
    return {
        "standings": found,
        "rows": rows,
        "held_out": any(row["dataset"] != "the recording" for row in rows),
    }


def _horizons(sources: Sources) -> Iterator[dict[str, Any]]:
    """Errors of velocity and pose at every horizon, before and after."""
    if sources.ladder is not None:
        frame = sources.ladder.frame
        chosen = frame.filter(pl.col("step") == best_step(frame))
        given = frame.filter(step=0)
    else:
        chosen = (
            sources.comparisons[-1].frame.filter(level="replay", by="all").with_columns(dataset=pl.lit("fit"))
        )
        given = (
            sources.comparisons[0].frame.filter(level="replay", by="all").with_columns(dataset=pl.lit("fit"))
        )
    key = ["dataset", "axis", "horizon"]
    alone = sources.ladder is None and len(sources.comparisons) == 1
    if alone and "before" in chosen.columns:
        both = chosen
    else:
        both = chosen.drop("before", strict=False).join(
            given.select(*key, before="rmse"), on=key, how="left", nulls_equal=True, maintain_order="left"
        )
    for axis, label in (("all", "velocity"), ("pose", "position")):
        for row in both.filter(axis=axis).sort("dataset", "horizon", nulls_last=True).iter_rows(named=True):
            yield {
                "dataset": plots.DATASETS[row["dataset"]][0],
                "of": f"{label} [{row['unit']}]",
                "horizon": words.horizon(row["horizon"]),
                "before": words.figure(row["before"]),
                "after": words.figure(row["rmse"]),
                "noise": words.figure(row["noise_floor"], 2),
            }


# Where it fails.


def _places(sources: Sources, charts: Charts) -> Section:
    """Ranked places of the model as given and of the last one, and the errors by kind of condition."""
    if not sources.comparisons:
        return None
    chosen = [sources.comparisons[0], sources.comparisons[-1]][: len(sources.comparisons)]
    titles = ["The model as given", "With what was found"] if len(chosen) > 1 else ["The model as given"]
    lists = [
        {"title": title, "places": list(_ranked(one.frame))}
        for title, one in zip(titles, chosen, strict=True)
    ]
    last = chosen[-1].frame.filter(level="force", axis="all")
    if len(chosen) > 1:
        key = ["by", "place"]
        first = chosen[0].frame.filter(level="force", axis="all").select(*key, before="rmse")
        last = last.drop("before", strict=False).join(first, on=key, how="left", maintain_order="left")
    there = last["by"].unique(maintain_order=True).to_list()
    kinds = [by for by in FAMILIES if by in there]
    kinds += [by for by in there if by not in kinds and by not in ("all", "place")]
    kinds = [by for by in kinds if last.filter(by=by).height > 1]
    if kinds:
        charts.add("conditions", *(plots.conditions(last.filter(by=by)) for by in kinds))
    return {"lists": lists, "kinds": kinds}


def _ranked(comparison: pl.DataFrame) -> Iterator[dict[str, Any]]:
    """Places in the order of their rank, their shares as widths of bars."""
    rows = comparison.filter(pl.col("rank").is_not_null()).sort("rank")
    everything = comparison.filter(level="force", by="all")["rows"].max()
    for row in rows.iter_rows(named=True):
        yield {
            "words": words.sentence(f"{MOTIONS.get(row['axis'], row['axis'])} {row['place']}").rstrip("."),
            "share": row["share"],
            "width": 100.0 * row["share"],
            "time": row["rows"] / max(everything, 1),  # type: ignore[type-var]
            "rmse": f"{words.figure(row['rmse'])} {row['unit']}",
        }


# What is missing, and how sure that is.


def _findings(sources: Sources, charts: Charts) -> Section:
    """What every diagnosis found: in a study, what each step took up, and what the last one says."""
    if not sources.diagnoses:
        return None
    groups = []
    for step, one in enumerate(sources.diagnoses):
        last = step == len(sources.diagnoses) - 1
        rows = one.frame.sort("rank")
        shown = rows.filter(pl.col("verdict") != "not_excited")
        taken = None if last else _taken(sources, step + 1)
        if taken:
            shown = shown.filter(
                pl.col("effect").is_in(taken) | pl.col("verdict").is_in(["cannot_tell_apart"])
            )
        cards = [_card(row, f"{step}-{row['rank']}", charts) for row in shown.iter_rows(named=True)]
        unseen = rows.filter(verdict="not_excited")["effect"].to_list() if last else []
        groups.append({"title": _group_title(step, len(sources.diagnoses)), "cards": cards, "unseen": unseen})
    return {"groups": [one for one in groups if one["cards"] or one["unseen"]]}


def _taken(sources: Sources, step: int) -> list[str]:
    """Effects that a step added."""
    if sources.ladder is None:
        return []
    rows = sources.ladder.frame.filter(step=step)
    return [name for name in rows["effect"][0].split(", ") if name] if rows.height else []


def _group_title(step: int, of: int) -> str:
    if of == 1:
        return ""
    if step == of - 1:
        return "What is left after the last step"
    return "In the model as given" if step == 0 else f"After step {step}"


def _card(row: dict[str, Any], name: str, charts: Charts) -> dict[str, Any]:
    """One finding."""
    label, sentence = words.verdict(row)
    values = words.values(row["effect"], row["parameters"], row["standard_errors"])
    drawn = [
        {"chart": charts.add(f"values-{name}-{i}", plots.parameters(group)), "unit": unit}
        for i, (unit, group) in enumerate(words.by_unit(values))
    ]
    rivals = [words.effect_name(one) for one in row["members"] if one != row["effect"]]
    return {
        "verdict": row["verdict"],
        "label": label,
        "effect": words.effect_name(row["effect"]),
        "sentence": sentence,
        "meaning": words.meaning(row["effect"]),
        "share": row["share_of_error_explained"],
        "low": row["share_low"],
        "high": row["share_high"],
        "confidence": row["confidence"],
        "p_value": words.probability(row["p_value"]),
        "rivals": words.listed(rivals, "or"),
        "values": [(one.name, words.with_error(one), one.unit) for one in values],
        "charts": drawn,
        "advice": row["advice"],
    }


# What happened when it was added.


def _ladder(sources: Sources, charts: Charts) -> Section:
    """Errors step by step: a large figure of all axes together, and a small one of each."""
    if sources.ladder is None:
        return None
    frame = sources.ladder.frame
    horizons = frame["horizon"].unique(maintain_order=True).to_list()
    horizons.sort(key=lambda one: (one is None, one))

    def at(axis: str) -> list[pl.DataFrame]:
        rows = frame.filter(axis=axis)
        return [rows.filter(pl.col("horizon").eq_missing(pl.lit(one, pl.Float64))) for one in horizons]

    kept = [i for i, rows in enumerate(at("all")) if rows.height]
    charts.add("ladder-all", *(plots.ladder(at("all")[i]) for i in kept))
    axes = [axis for axis in VELOCITIES if all(at(axis)[i].height for i in kept)]
    for axis in axes:
        charts.add(f"ladder-{axis}", *(plots.ladder(at(axis)[i], titled=False) for i in kept))
    units = dict(frame.select("axis", "unit").unique().iter_rows())
    chosen = next((n for n, i in enumerate(kept) if horizons[i] == HORIZON), 0)
    return {
        "horizons": [words.horizon(horizons[i]) for i in kept],
        "chosen": chosen,
        "axes": [(axis, f"{TITLES[axis]} {axis}", units[axis]) for axis in axes],
        "steps": list(_rungs(frame)),
        "held_out": "holdout" in frame["dataset"],
        "columns": [(axis, units[axis]) for axis in (*axes, "all")],
        "best": best_step(frame),
        "values": list(_joint(sources)),
    }


def _rungs(frame: pl.DataFrame) -> Iterator[dict[str, Any]]:
    """The table beside the figure: every step and data set, its errors at the horizon of the headline."""
    rows = _at_horizon(frame)
    for (step, dataset), one in rows.group_by(["step", "dataset"], maintain_order=True):
        errors = dict(one.select("axis", "rmse").iter_rows())
        yield {
            "step": step,
            "added": words.effects_named(one["effect"][0]) or "the file as given",
            "dataset": plots.DATASETS[str(dataset)][0],
            "errors": {axis: words.figure(value) for axis, value in errors.items()},
            "noise": words.figure(one.filter(axis="all")["noise_floor"].max(), 2),  # type: ignore[arg-type]
        }


def _joint(sources: Sources) -> Iterator[dict[str, Any]]:
    """Values in the resulting vehicle file, from the fit of everything together."""
    text = sources.comparisons[-1].artefact.provenance.vehicle if sources.comparisons else None
    for table in vehicles.parse(text).effect if text else ():
        if "standard_error" not in table:
            continue
        given = {
            name: value
            for name, value in table.items()
            if name not in ("name", "standard_error", "fit") and isinstance(value, int | float | list)
        }
        values = words.fitted(str(table["name"]), given, dict(table["standard_error"]))
        yield {
            "effect": words.effect_name(str(table["name"])),
            "values": [(one.name, words.with_error(one), one.unit) for one in values],
        }


# Measured against model; errors of networks.


def _replay(one: Named, number: int, charts: Charts) -> dict[str, Any]:
    """Velocities of every session, measured and simulated."""
    sessions = one.frame["session"].unique(maintain_order=True).to_list()
    shown = sessions[:SESSIONS]
    for axis in VELOCITIES:
        drawn = (plots.overlay(one.frame, session, axis) for session in shown)
        charts.add(f"overlay-{number}-{axis}", *drawn)
    variants = one.frame["variant"].unique(maintain_order=True).to_list()
    return {
        "number": number,
        "name": one.name,
        "sessions": shown,
        "hidden": len(sessions) - len(shown),
        "legend": [
            (label, colour, key == MEASURED) for key, (label, colour) in plots.curves(variants).items()
        ],
        "axes": [(axis, f"{TITLES[axis]} {axis}") for axis in VELOCITIES],
        "errors": list(_replay_errors(one.frame, shown, variants)),
    }


def _replay_errors(frame: pl.DataFrame, sessions: Sequence[str], variants: Sequence[str]) -> Iterator[Any]:
    """Root mean square error of every variant and axis over the sessions shown."""
    if MEASURED not in variants:
        return
    rows = frame.filter(pl.col("session").is_in(list(sessions)))
    measured = rows.filter(variant=MEASURED).select("session", "t", *VELOCITIES)
    for name, (label, _) in plots.curves(variants).items():
        if name == MEASURED:
            continue
        both = rows.filter(variant=name).join(measured, on=["session", "t"], how="inner", suffix="_m")
        errors = both.select(
            (pl.col(axis).cast(pl.Float64) - pl.col(f"{axis}_m")).pow(2).mean().sqrt().alias(axis)
            for axis in VELOCITIES
        )
        yield label, [words.figure(errors[axis][0]) for axis in VELOCITIES]


def _metrics(one: Named, number: int, charts: Charts) -> dict[str, Any]:
    """Root mean square errors of models or variants, axis by axis, translation apart from rotation."""
    group = "variant" if (one.frame["variant"] != "").any() else "model"
    rows = one.frame.filter(pl.col("metric") == "rmse", pl.col("axis").str.len_chars() == 1)
    drawn = [
        charts.add(f"metrics-{number}-{i}", plots.bars(rows.filter(unit=unit), group))
        for i, unit in enumerate(rows["unit"].unique(maintain_order=True))
    ]
    names = one.frame[group].unique(maintain_order=True).to_list()
    axes = rows["axis"].unique(maintain_order=True).to_list()
    found = {(row[group], row["axis"]): row for row in rows.iter_rows(named=True)}
    units = dict(rows.select("axis", "unit").iter_rows())
    return {
        "name": one.name,
        "number": number,
        "group": group,
        "datasets": words.listed(one.frame["dataset"].unique(maintain_order=True).to_list()),
        "charts": drawn,
        "legend": [(name, plots.MANY[i % len(plots.MANY)]) for i, name in enumerate(names)],
        "axes": [(axis, units[axis]) for axis in axes],
        "rows": [
            (
                name,
                [words.figure(found[name, axis]["value"]) if (name, axis) in found else "–" for axis in axes],
            )
            for name in names
        ],
    }


# Confusions, what to fly next, where it comes from.


def _confusions(sources: Sources) -> Section:
    """Which effect could be behind each finding as well, and what usually passes for it."""
    if not sources.diagnoses:
        return None
    rows: list[dict[str, str]] = []
    for one in sources.diagnoses:
        for row in one.frame.sort("rank").iter_rows(named=True):
            if row["verdict"] not in ("missing", "cannot_tell_apart") or not row["effect"]:
                continue
            tied = [name for name in row["members"] if name != row["effect"]]
            usual = CATALOGUE[row["effect"]].lookalikes if row["effect"] in CATALOGUE else ()
            known = len(row["members"]) > 1 and all(name in CATALOGUE for name in row["members"])
            entry = {
                "effect": words.effect_name(row["effect"]),
                "tied": words.listed([words.effect_name(name) for name in tied]),
                "usual": words.listed([words.effect_name(name) for name in usual if name not in tied]),
                "parted": separating(row["members"]).partition(": ")[2] if known else "",
            }
            rows = [other for other in rows if other["effect"] != entry["effect"]] + [entry]
    return {"rows": rows} if rows else None


def _next(sources: Sources) -> Section:
    """What the last diagnosis asks to be flown or done, each thing once."""
    if not sources.diagnoses:
        return None
    last = sources.diagnoses[-1].frame.sort("rank")
    asked = ["cannot_tell_apart", "not_excited", "none_of_the_known"]
    rows = last.filter(pl.col("verdict").is_in(asked)).unique("advice", keep="first", maintain_order=True)
    return {
        "rows": [
            {"why": words.verdict(row)[1], "what": row["advice"]}
            for row in rows.iter_rows(named=True)
            if row["advice"]
        ]
    }


def _provenance(sources: Sources) -> dict[str, Any]:
    """Files of the page, what they were made from, and the resulting vehicle file."""
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
    texts = [text for one in sources.comparisons if (text := one.artefact.provenance.vehicle)]
    return {
        "files": files,
        "inputs": [(kind, content) for content, kind in inputs.items()],
        "version": lineage.package_version(),
        "vehicle": texts[-1] if len(set(texts)) > 1 else None,
    }
