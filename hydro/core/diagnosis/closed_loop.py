"""Check of a diagnosis against a recording made under feedback.

A controller reacts to a current, a tether or a trim error.  Commands and disturbance are then correlated, and
a coefficient can absorb the disturbance (Forssell and Ljung 1999).  A slowly varying disturbance is modelled
as a wrench that is constant over a stretch of the recording.  With such wrenches free, a real effect keeps
its values and an effect that absorbs a disturbance loses them (J. A. Hausman, Specification tests in
econometrics, Econometrica 46, 1251-1271, 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from hydro.core.columns import Array
from hydro.core.diagnosis.baseline import Baseline, Outcome
from hydro.core.diagnosis.doubts import stated
from hydro.core.diagnosis.findings import STATED, Finding
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.settings import DISTINCT, NEARLY_EQUAL, STEADY_SECONDS
from hydro.core.diagnosis.unexplained import WRENCH, with_steady_wrenches
from hydro.core.effects import CATALOGUE
from hydro.core.identification.levenberg_marquardt import PRIOR, moved
from hydro.core.identification.prior import in_file
from hydro.core.prediction.normal_equations import eliminate
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.feedback import feedback

DISTURBANCES = tuple(name for name, one in CATALOGUE.items() if one.family == "surroundings")
"""Effects to which a controller reacts."""
ADVICE = (
    "commands answer to the motion: {words}. The controller counteracts disturbances, so damping, gains and "
    "added mass may absorb them. The findings allow for disturbances that are steady for {stretch:g} s; to "
    "exclude others, run planned commands without feedback"
)
IMITATES = (
    "under feedback: {share:.0%} of it vanishes with steady disturbances free, so this recording cannot "
    "separate it from a disturbance that the controller counteracts"
)


def under_feedback(baseline: Baseline, outcome: Outcome, findings: Sequence[Finding]) -> list[Finding]:
    """Return findings with less confidence where they may be disturbances, and a warning as a last one.

    Findings of a recording without feedback are returned as they are.
    """
    seen = feedback(baseline.vehicle, baseline.log.record)
    if not seen.closed:
        return list(findings)
    own = own_shares(baseline, outcome.model)
    warning = Finding("closed_loop", advice=ADVICE.format(words=seen.words(), stretch=STEADY_SECONDS))
    return [*(_judged(one, own) for one in findings), warning]


def _judged(finding: Finding, own: dict[str, float]) -> Finding:
    """Lower a finding's confidence by the share that steady disturbances explain.

    New values of an existing effect are withdrawn instead.

    `own` is the share of each effect that remains with steady wrenches free, see `own_shares`.
    """
    share = own.get(finding.effect, 1.0)
    if finding.verdict not in STATED or share >= NEARLY_EQUAL:
        return finding
    words = f"{finding.advice}; {IMITATES.format(share=1.0 - share)}"
    if finding.verdict == "retune":
        return replace(
            finding,
            verdict="not_separable",
            members=(finding.effect, *DISTURBANCES),
            parameters={},
            standard_errors={},
            advice=words,
        )
    return stated(replace(finding, confidence=finding.confidence * share, advice=words))


def own_shares(baseline: Baseline, model: Model) -> dict[str, float]:
    """Return the share of each fitted effect, by name, that remains with steady wrenches free.

    An effect is measured by its step from the file's values, or from 0.  With one wrench per stretch of
    STEADY_SECONDS free, the linearised problem gives a new step.  The share is the projection of the new step
    on the first, weighted by the information that remains.  It is 0 if the new step is not DISTINCT from 0.
    Disturbances and sensor errors are skipped.
    """
    entries = model.unknown.entries
    if not entries:
        return {}
    step = (model.values - in_file(baseline.vehicle, entries)) / model.unknown.scales
    gram = _with_wrenches(model)
    left, _ = eliminate(gram, WRENCH, np.full(WRENCH, 1e-9 * max(float(np.abs(gram).max()), 1.0)))
    total = left.sum(axis=0)
    spread = np.linalg.inv(total[:-1, :-1] + PRIOR**-2 * np.eye(len(entries)))
    after, found = step + spread @ total[:-1, -1], dict[str, float]()
    for name in model.unknown.effects:
        if CATALOGUE[name].family in ("surroundings", "restoring", "sensor"):
            continue
        of = model.unknown.places(name)
        known = np.linalg.inv(spread[np.ix_(of, of)])
        told = float(after[of] @ known @ after[of]) / len(of)
        stays = float(after[of] @ known @ step[of]) / max(float(step[of] @ known @ step[of]), 1e-300)
        found[name] = (
            float(np.clip(stays, 0.0, 1.0)) if told >= DISTINCT**2 * max(model.normal.chi2, 1.0) else 0.0
        )
    return found


def _with_wrenches(model: Model) -> Array:
    """Return the normal equations with six steady wrenches free in each stretch of the recording.

    Returns:
        Products of the columns of the wrenches, of the components and of the residual, for each of B
        stretches, (B, 7 + P, 7 + P).
    """
    problem = cast(OutputError, model.problem)
    shots, record = problem.shots, problem.shots.record
    normal = with_steady_wrenches(problem, model.vehicle, *moved(model.unknown, model.values))
    kept = ~normal.lost
    place = record.t[shots.starts[kept]] // STEADY_SECONDS
    key = np.column_stack([shots.segment[kept], place])
    begins = np.flatnonzero(np.r_[True, (np.diff(key, axis=0) != 0).any(axis=1)])
    return np.asarray(np.add.reduceat(normal.gram[kept], begins, axis=0))
