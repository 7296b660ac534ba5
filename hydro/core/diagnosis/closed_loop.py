"""A diagnosis of a recording made under feedback: what may stand for a disturbance.

A controller answers to a current, a tether or a trim error, so that its commands and the disturbance are
there together, and a coefficient may stand for the disturbance (Forssell and Ljung 1999).  A slowly varying
disturbance is a wrench that is steady over a stretch of the recording.  With such wrenches free beside it, an
effect that is there keeps its values, and one that stands for a disturbance loses them (J. A. Hausman,
Specification tests in econometrics, Econometrica 46, 1251-1271, 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from hydro.core.columns import Array
from hydro.core.diagnosis.baseline import Baseline, Outcome
from hydro.core.diagnosis.confidence import stated
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.unexplained import WRENCH, steadily_disturbed, wrenches_of_pulls
from hydro.core.effects import CATALOGUE
from hydro.core.identification.levenberg_marquardt import PRIOR, moved
from hydro.core.identification.prior import in_file
from hydro.core.prediction.normal_equations import eliminate
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.feedback import Feedback, feedback
from hydro.core.vehicle.frames import rotation_from_quaternion

STRETCH = 20.0
"""Time over which a disturbance is taken for steady [s]."""
OWN = 0.75
"""Part of an effect that must stay once steady wrenches are free beside it, for it to be told,"""
EVIDENT = 10.0
"""and how many times chance what the recording then still tells of it must be, parameter by parameter."""
DISTURBANCES = tuple(name for name, one in CATALOGUE.items() if one.family == "surroundings")
"""Effects that a controller answers to."""
ADVICE = (
    "commands answer to the motion: {words}. A disturbance that the controller answers to is there together "
    "with the answer; damping, gains and added mass may stand for it. What is stated here stands beside "
    "disturbances that are steady for {stretch:g} s; for the rest, fly planned commands without feedback"
)
IMITATES = (
    "under feedback: with steady disturbances free beside it, {share:.0%} of it goes, so that this recording "
    "does not tell it from a disturbance that the controller answers to"
)


def under_feedback(baseline: Baseline, outcome: Outcome, findings: Sequence[Finding]) -> list[Finding]:
    """The findings with a warning, less sure of what a disturbance may imitate; without feedback as given."""
    seen = feedback(baseline.vehicle, baseline.log.record)
    if not seen.closed:
        return list(findings)
    own = own_shares(baseline, outcome.model)
    return [*(_judged(one, own) for one in findings), _warning(seen)]


def _judged(finding: Finding, own: dict[str, float]) -> Finding:
    """A finding less sure by what steady disturbances take of it; a re-estimate among it is not told."""
    share = own.get(finding.effect, 1.0)
    if finding.verdict not in ("missing", "retune", "cannot_tell_apart") or share >= OWN:
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


def _warning(seen: Feedback) -> Finding:
    """That the recording was made under feedback."""
    return Finding("closed_loop", advice=ADVICE.format(words=seen.words(), stretch=STRETCH))


def own_shares(baseline: Baseline, model: Model) -> dict[str, float]:
    """Part of each fitted effect that stays once a steady wrench of every stretch is free, by its name.

    An effect is its step from the file's values, or from 0.  With the wrenches free all entries move on, by
    the linearised problem; what is left along the step counts, weighed by what the recording then tells.
    Disturbances themselves, and errors of the log, are left out.
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
    for name in dict.fromkeys(entry.effect for entry in entries):
        if CATALOGUE[name].family in ("surroundings", "restoring", "sensor"):
            continue
        of = [i for i, entry in enumerate(entries) if entry.effect == name]
        known = np.linalg.inv(spread[np.ix_(of, of)])
        told = float(after[of] @ known @ after[of]) / len(of)
        stays = float(after[of] @ known @ step[of]) / max(float(step[of] @ known @ step[of]), 1e-300)
        found[name] = (
            float(np.clip(stays, 0.0, 1.0)) if told >= EVIDENT * max(model.normal.chi2, 1.0) else 0.0
        )
    return found


def _with_wrenches(model: Model) -> Array:
    """Products of six steady wrenches and of the model's own columns, by stretches, (B, 7 + P, 7 + P)."""
    problem = cast(OutputError, model.problem)
    changed, steps = moved(model.unknown, model.values)
    pulls = list(steadily_disturbed(model.vehicle))
    normal = problem.linearise(model.vehicle, [*pulls, *changed], [*[1.0] * len(pulls), *steps])
    kept = ~normal.lost
    turned = wrenches_of_pulls(rotation_from_quaternion(problem.shots.first[kept, 3:7]))
    rest = len(steps) + 1
    mix = np.zeros((len(turned), len(pulls) + rest, WRENCH + rest))
    mix[:, : len(pulls), :WRENCH] = turned
    mix[:, len(pulls) :, WRENCH:] = np.eye(rest)
    gram = mix.transpose(0, 2, 1) @ normal.gram[kept] @ mix
    shots, record = problem.shots, problem.shots.record
    place = record.t[shots.starts[kept]] // STRETCH
    key = np.column_stack([shots.segment[kept], place])
    begins = np.flatnonzero(np.r_[True, (np.diff(key, axis=0) != 0).any(axis=1)])
    return np.asarray(np.add.reduceat(gram, begins, axis=0))
