"""Diagnoses in a report: a card for each finding, effects that can be confused, and the next run."""

from __future__ import annotations

from typing import Any

import polars as pl

from hydro.core.effects import CATALOGUE
from hydro.core.errors import listed
from hydro.core.experiment.advice import ADD, separating
from hydro.io import vehicle as vehicles
from hydro.report import diagnosis, plots, recorded, words
from hydro.report.change import of_change
from hydro.report.charts import Charts
from hydro.report.diagnosis import SHARES, Context, has_shares
from hydro.report.sources import Named, Sources
from hydro.report.standing import chosen_step
from hydro.report.words import Value

MOST_VALUES = 12
"""Maximum number of drawn values of one effect; beyond it, only the most significant ones are drawn."""
CLEAR_RATIO = 2.0
"""Minimum distance of a significant value from zero, in standard errors."""
ADDED = ("missing", "suspect", "retune")
"""Verdicts whose advice is to add the finding."""
ASKS = ("cannot_tell_apart", "not_excited", "none_of_the_known", "far_from_noise")
"""Verdicts that ask for another recording."""
NAMES = ("missing", "suspect", "cannot_tell_apart")
"""Verdicts that name an effect which the model may lack."""


def findings(sources: Sources, charts: Charts) -> dict[str, Any] | None:
    """Return the cards of a report, one for each finding of a diagnosis, as values for the template.

    The cards of a study show the effects that each step of the study added, and all findings of the diagnosis
    after the step to use.

    Args:
        sources: Artefacts of the report.
        charts: Collection to which the figures of the cards are added.

    Returns:
        A dict with `groups`, a list with one dict for each diagnosis: its `title`, `shares`, `cards`,
        `others` and `unseen` effects; None if the report has no diagnosis.
    """
    chosen = chosen_step(sources)
    if not sources.diagnoses or chosen is None:
        return None
    last = min(chosen, len(sources.diagnoses) - 1)
    groups, dt = [], recorded.sample_time(sources)
    for step, one in enumerate(sources.diagnoses[: last + 1]):
        rows, about = one.frame.sort("rank"), _context(one, dt)
        shown = rows.filter(pl.col("verdict") != "not_excited")
        taken = [] if step == last else _taken(sources, step + 1)
        others = shown.head(0)
        if taken:
            mine = pl.col("effect").is_in(taken) & (pl.col("effect") != "")
            if step == 0:  # later diagnoses compare with the values of a step, not of the file
                mine |= pl.col("verdict") == "retune"
            others = shown.filter(~mine, pl.col("verdict").is_in(NAMES))
            shown = shown.filter(mine)
        groups.append(
            {
                "title": _group_title(step, last, taken),
                "shares": _shares(shown, step),
                "cards": [
                    _card(row, f"{step}-{row['rank']}", charts, about, added=bool(taken), further=step > 0)
                    for row in shown.iter_rows(named=True)
                ],
                "others": [words.in_short(row) for row in others.iter_rows(named=True)],
                "unseen": _unseen(rows) if step == last else "",
            }
        )
    return {"groups": groups}


def confusions(sources: Sources) -> list[dict[str, str]]:
    """Return, for each finding of a diagnosis, the effects that can be confused with the finding, as texts.

    Returns:
        A dict for each finding: the `effect`, the effects `tied` that fit equally well, the `usual` ones that
        are often confused with it, and in `parted` the manoeuvre that separates them; all texts.
    """
    rows: dict[str, dict[str, str]] = {}
    for one in sources.diagnoses[: (chosen_step(sources) or 0) + 1]:
        for row in one.frame.sort("rank").iter_rows(named=True):
            effect, members = row["effect"], row["members"]
            if row["verdict"] not in NAMES or not effect:
                continue
            tied = [name for name in members if name != effect]
            usual = CATALOGUE[effect].lookalikes if effect in CATALOGUE else ()
            asked = row["advice"] if row["verdict"] == "cannot_tell_apart" else ""
            if not asked and tied and all(name in CATALOGUE for name in members):
                asked = separating(members)
            rows[effect] = {
                "effect": words.effect_name(effect),
                "tied": listed([words.effect_name(name) for name in tied]),
                "usual": listed([words.effect_name(name) for name in usual if name not in tied]),
                "parted": asked.removeprefix("to separate them: "),
            }
    return list(rows.values())


def to_record(sources: Sources) -> list[dict[str, str]] | None:
    """Return the advice which recording to make next, from the diagnosis after the study's step to use.

    Returns:
        A dict for each advice: `what` to record, and `why`; None without a diagnosis.
    """
    chosen = chosen_step(sources)
    if not sources.diagnoses or chosen is None:
        return None
    last = sources.diagnoses[min(chosen, len(sources.diagnoses) - 1)].frame.sort("rank")
    rows = last.filter(pl.col("verdict").is_in(ASKS), pl.col("advice") != "")
    return [
        {"why": words.verdict(row)[1], "what": row["advice"]}
        for row in rows.unique("advice", keep="first", maintain_order=True).iter_rows(named=True)
    ]


def _taken(sources: Sources, step: int) -> list[str]:
    """Return the effects that a step of the study added, from the ladder table; empty without a ladder."""
    if sources.ladder is None:
        return []
    rows = sources.ladder.frame.filter(step=step)
    return [name for name in rows["effect"][0].split(", ") if name] if rows.height else []


def _group_title(step: int, last: int, taken: list[str]) -> str:
    """Return the title of the cards of one diagnosis; empty for a single diagnosis."""
    if step == last:
        return f"After step {step}" if step else ""
    named = listed([words.effect_name(name) for name in taken])
    return f"Step {step + 1} added {named}" if named else f"Found at step {step}"


def _shares(shown: pl.DataFrame, step: int) -> str:
    """Return the note that explains the shares on the cards of one diagnosis; empty if they need none."""
    if not has_shares(shown.to_dicts()):
        return ""
    if not step:
        return SHARES
    return (
        f"Shares of the squared error above the noise after step {step} overlap; they need not sum to 100 %."
    )


def _unseen(rows: pl.DataFrame) -> str:
    """Return the effects that the motion in the recording cannot show, in words."""
    return listed([words.effect_name(name) for name in rows.filter(verdict="not_excited")["effect"]])


def _context(one: Named, dt: float) -> Context | None:
    """Return the vehicle file and the sample time `dt` [s] of a diagnosis, for its sentences.

    None if the table has no vehicle file.
    """
    text = one.artefact.provenance.vehicle
    return Context(vehicles.parse(text), dt, changed=of_change(one)) if text else None


def _told(row: dict[str, Any], about: Context | None) -> tuple[str, str, str]:
    """Return the verdict, the title and the sentence of a finding, a row of a diagnosis table."""
    label, sentence = words.verdict(row, about is not None and about.changed)
    if about is None or row["verdict"] not in diagnosis.TITLES:
        return label, words.effect_name(row["effect"]), sentence
    return label, diagnosis.title(row, about), diagnosis.said(row, about) or sentence


def _card(
    row: dict[str, Any], name: str, charts: Charts, about: Context | None, *, added: bool, further: bool
) -> dict[str, Any]:
    """Return the card of one finding.

    Args:
        row: Row of a diagnosis table.
        name: Prefix of the names of the card's figures.
        charts: Collection to which the figures are added.
        about: Vehicle file and sample time; None without a vehicle file.
        added: Whether a step has added the finding, so that the advice to add it is left out.
        further: Whether earlier steps have added findings.
    """
    label, title, sentence = _told(row, about)
    advice = "" if added and row["verdict"] in ADDED else _without_adding(row["advice"])
    if row["verdict"] == "nothing_missing" and about is not None and about.changed:
        label = label.replace("No change", "No further change") if further else label
        sentence, advice = words.sentence(advice) if advice else sentence, ""
    values = words.values(row["effect"], row["parameters"], row["standard_errors"])
    drawn = [
        charts.add(f"values-{name}-{number}", plots.parameters(group))
        for number, group in enumerate(words.by_unit(_drawn(values)))
    ]
    return {
        "verdict": row["verdict"],
        "label": label,
        "effect": words.effect_name(row["effect"]),
        "name": row["effect"].partition(":")[0] if row["effect"] in CATALOGUE else "",
        "title": title,
        "sure": diagnosis.sureness(row),
        "sentence": sentence,
        "facts": diagnosis.facts(row),
        "meaning": words.meaning(row["effect"]),
        "share": row["share_of_error_explained"],
        "interval": None if row["share_low"] is None else (row["share_low"], row["share_high"]),
        "p_value": row["p_value"],
        "values": [(one.name, words.with_error(one), one.unit) for one in values],
        "long": len(values) > MOST_VALUES,
        "charts": drawn,
        "advice": advice,
    }


def _without_adding(advice: str) -> str:
    """Return the advice of a finding without the sentence to add it, which the head of the page shows."""
    return "" if advice == ADD else advice.removeprefix(f"{ADD}; ")


def _drawn(values: list[Value]) -> list[Value]:
    """Return the values that a figure shows: all, or if they are many, the most significant ones."""
    if len(values) <= MOST_VALUES:
        return values

    def clearness(one: Value) -> float:
        return abs(one.value) / one.error if one.error else float(one.value != 0.0)

    clear = sorted((one for one in values if clearness(one) > CLEAR_RATIO), key=clearness, reverse=True)
    kept = clear[:MOST_VALUES]
    return [one for one in values if one in kept]
