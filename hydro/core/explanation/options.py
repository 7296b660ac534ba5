"""Candidates for the next step, from the diagnosis of a step.

The confirmed finding that explains most makes one step.  Where nothing is confirmed, or an unconfirmed effect
explains more, trials decide (`explanation.trials`).  With a hull-force model from an earlier recording, a
step adds the largest change.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import polars as pl

from hydro.core.diagnosis.findings import LACKING, STATED, tables
from hydro.core.diagnosis.settings import DOUBTFUL
from hydro.core.effects.catalogue import CATALOGUE
from hydro.core.explanation.ladder import Step
from hydro.core.explanation.with_hull import FLOOR

Table = Mapping[str, Any]

SUSPECTED, FAR = "suspect", "far_from_noise"
"""Verdict on an unconfirmed effect, and verdict on a recording whose residual stays far above the noise."""


def options(step: Step) -> list[dict[str, Table]]:
    """Return the choices for the next step, the best missing effect first.

    A choice is a dict of the `[[effect]]` tables to fit together, by effect name: a missing effect, and the
    effects of the file with new values.  The best confirmed finding is the only choice, unless trials decide
    (`is_open`): then all unconfirmed effects are choices too.  New values alone make a step only if the last
    one did not fit these effects.
    """
    with_values = step.diagnosis.filter(pl.col("parameters") != "").sort("rank")
    if of_change(step):
        return _change(step, with_values)
    fitted = {table["name"] for table in step.tables}
    first = _missing(step)["effect"].to_list()[:1]
    formulas = _discovered(with_values)
    suspected = _suspected(step)["effect"].to_list()
    missing = [*suspected, *first, *formulas] if is_open(step) else first or formulas
    retuned = _retuned(step)
    if not missing and fitted.issuperset(retuned):
        return []
    wanted = [[name, *retuned] for name in dict.fromkeys(missing)] or [retuned]
    return [{table["name"]: table for table in tables(step.diagnosis, names)} for names in wanted]


def finding_option(step: Step, effect: str) -> dict[str, Table]:
    """Return the choice that adds one finding of a diagnosis, with the new values of existing effects.

    Returns:
        The `[[effect]]` tables to fit together, by effect name.

    Raises:
        DataError: The diagnosis has no values for the effect.
    """
    names = [effect] if of_change(step) else list(dict.fromkeys([effect, *_retuned(step)]))
    return {table["name"]: table for table in tables(step.diagnosis, names)}


def is_open(step: Step) -> bool:
    """Return whether trials decide the next step, with further candidates of the catalogue.

    Trials decide if two conditions hold.  No confirmed finding comes first.  An unconfirmed one is likely, or
    the residual of every model is many times the noise.
    """
    if of_change(step):
        return False
    named = pl.concat([_suspected(step), _missing(step)]).sort("rank")
    decided = not named.is_empty() and named["verdict"][0] != SUSPECTED
    return not decided and bool(_likely(step) or FAR in step.diagnosis["verdict"])


def is_stated(last: Step, step: Step) -> bool:
    """Return whether one step's diagnosis confirms all effects that the next step adds or refits."""
    return all(states(last, name) for name in step.added)


def states(step: Step, effect: str) -> bool:
    """Return whether the diagnosis of a step confirms that an effect is missing or has new values."""
    return not step.diagnosis.filter(pl.col("verdict").is_in(STATED), effect=effect).is_empty()


def of_change(step: Step) -> bool:
    """Return whether the study looks for changes since an earlier recording, with its hull-force model."""
    return not step.ladder.filter(axis=FLOOR).is_empty()


def _change(step: Step, findings: pl.DataFrame) -> list[dict[str, Table]]:
    """Return a choice with the best confirmed change that the step has not fitted; empty without one.

    Without a confirmed change it is the best unconfirmed one, if any of these is likely.
    """
    fitted = {table["name"] for table in step.tables}
    stated = findings.filter(pl.col("verdict").is_in(STATED))["effect"]
    names = [name for name in stated if name not in fitted] or _likely(step)
    return [{table["name"]: table for table in tables(step.diagnosis, names[:1])}] if names else []


def _missing(step: Step) -> pl.DataFrame:
    """Return confirmed findings of missing effects, with values, the best first."""
    stated = pl.col("verdict").is_in(LACKING)
    return step.diagnosis.filter(pl.col("parameters") != "", stated).sort("rank")


def _retuned(step: Step) -> list[str]:
    """Return the existing effects for which the diagnosis has new values, the best first."""
    return (
        step.diagnosis.filter(pl.col("parameters") != "", verdict="retune").sort("rank")["effect"].to_list()
    )


def _suspected(step: Step) -> pl.DataFrame:
    """Return unconfirmed findings with values that have not been fitted in the step, the best first."""
    new = ~pl.col("effect").is_in([table["name"] for table in step.tables])
    return step.diagnosis.filter(pl.col("parameters") != "", new, verdict=SUSPECTED).sort("rank")


def _likely(step: Step) -> list[str]:
    """Return the effects of the unconfirmed findings, the best first; empty if none of them is likely."""
    suspected = _suspected(step)
    likely = suspected.filter(pl.col("confidence") >= DOUBTFUL)
    return [] if likely.is_empty() else suspected["effect"].to_list()


def _discovered(findings: pl.DataFrame) -> list[str]:
    """Return the formula that was discovered beyond the catalogue; empty without one."""
    formulas = [name for name, effect in CATALOGUE.items() if effect.is_written]
    return findings.filter(pl.col("effect").is_in(formulas), verdict=SUSPECTED)["effect"].to_list()
