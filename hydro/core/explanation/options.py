"""Candidates for the next step, from the diagnosis of a step.

The confirmed finding that explains most makes one step.  Where nothing is confirmed, or an unconfirmed effect
explains more, trials decide (`explanation.trials`).  With a hull-force model from an earlier recording, a
step adds the largest change.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hydro.core.diagnosis.findings import LACKING, STATED, Finding, tables
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
    if of_change(step):
        return _change(step)
    first = [one.effect for one in step.with_values(*LACKING)][:1]
    formulas = [one.effect for one in step.with_values(SUSPECTED) if CATALOGUE[one.effect].is_written]
    suspected = [one.effect for one in _suspected(step)]
    missing = [*suspected, *first, *formulas] if is_open(step) else first or formulas
    retuned = _retuned(step)
    if not missing and _fitted(step).issuperset(retuned):
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
    named = [*step.with_values(*LACKING), *_suspected(step)]
    named.sort(key=step.findings.index)
    if named and named[0].verdict != SUSPECTED:
        return False
    return bool(_likely(step)) or any(one.verdict == FAR for one in step.findings)


def is_stated(last: Step, step: Step) -> bool:
    """Return whether one step's diagnosis confirms all effects that the next step adds or refits."""
    return all(states(last, name) for name in step.added)


def states(step: Step, effect: str) -> bool:
    """Return whether the diagnosis of a step confirms that an effect is missing or has new values."""
    return any(one.verdict in STATED and one.effect == effect for one in step.findings)


def of_change(step: Step) -> bool:
    """Return whether the study looks for changes since an earlier recording, with its hull-force model."""
    return not step.ladder.filter(axis=FLOOR).is_empty()


def _change(step: Step) -> list[dict[str, Table]]:
    """Return a choice with the best confirmed change that the step has not fitted; empty without one.

    Without a confirmed change it is the best unconfirmed one, if any of these is likely.
    """
    stated = [one.effect for one in step.with_values(*STATED) if one.effect not in _fitted(step)]
    names = stated or _likely(step)
    return [{table["name"]: table for table in tables(step.diagnosis, names[:1])}] if names else []


def _fitted(step: Step) -> set[str]:
    """Return the names of the effects that were fitted in a step."""
    return {table["name"] for table in step.tables}


def _retuned(step: Step) -> list[str]:
    """Return the existing effects for which the diagnosis has new values, the best first."""
    return [one.effect for one in step.with_values("retune")]


def _suspected(step: Step) -> list[Finding]:
    """Return unconfirmed findings with values that have not been fitted in the step, the best first."""
    return [one for one in step.with_values(SUSPECTED) if one.effect not in _fitted(step)]


def _likely(step: Step) -> list[str]:
    """Return the effects of the unconfirmed findings, the best first; empty if none of them is likely."""
    suspected = _suspected(step)
    likely = any(one.confidence >= DOUBTFUL for one in suspected)
    return [one.effect for one in suspected] if likely else []
