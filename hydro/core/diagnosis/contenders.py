"""What a diagnosis leaves open: effects that explain a recording about as well, and what it does not show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.search import Baseline, Found, Outcome
from hydro.core.experiment.discrimination import Rival
from hydro.core.experiment.flight import Question
from hydro.core.simulation.excitation import LOG_RATE

CLOSEST = 3
"""Rivals of a suspect, itself among them."""


def left_open(baseline: Baseline, outcome: Outcome, findings: Sequence[Finding]) -> Question:
    """The rivals of every finding whose name is not sure, and what the recording does not show."""
    model, log = outcome.model, baseline.log
    ties = []
    for found in outcome.found:
        verdicts = {one.verdict for one in findings if one.effect == found.effect}
        if verdicts & {"cannot_tell_apart", "suspect"}:
            members = next(one.members for one in findings if one.effect == found.effect)
            ties.append(_rivals(found, members, outcome))
    hidden = tuple(one.effect for one in findings if one.verdict == "not_excited")
    widened = np.sqrt(max(model.normal.chi2, 1.0) * log.record.dt * LOG_RATE)
    sigma = baseline.problem.shots.sigma * widened
    return Question(tuple(ties), _rival("", model), hidden, sigma, log.middle, log.positions)


def _rivals(found: Found, members: Sequence[str], outcome: Outcome) -> tuple[Rival, ...]:
    """The effects of a tie, or of a suspect the nearest contenders; without any, the model without it."""
    order = sorted(found.rivals, key=lambda name: float(found.rivals[name].penalised.sum()))
    names = [name for name in members if name in found.rivals]
    if len(names) < 2:
        names += [name for name in order if name not in names][: CLOSEST - len(names)]
    if len(names) < 2:
        rest = _rival(f"no {found.effect}", outcome.without[found.effect])
        return (_rival(found.effect, outcome.model), rest)
    return tuple(_rival(name, found.rivals[name]) for name in names)


def _rival(name: str, model: Model) -> Rival:
    return Rival.of(name, model.unknown, model.values, model.normal)
