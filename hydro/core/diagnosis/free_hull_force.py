"""Names and values where no model reaches the noise: the hull force is free.

A fit of effects alone absorbs the hull's error, and its values are several standard errors from the truth.
Here the hull force is integrated out (`residual.allowance`), and the values of the file's other effects have
their priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro.core.diagnosis.baseline import Baseline, Outcome
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.settings import (
    ALMOST_ALL,
    DOUBTFUL,
    LEAST_EVIDENCE,
    MATERIAL,
    QUICK_STEPS,
    RIGHT,
    SHOTS,
    SMALL_STEP,
)
from hydro.core.diagnosis.transfer import Known, resolved
from hydro.core.effects.hull_laws import has_drag, is_hull_law
from hydro.core.identification.levenberg_marquardt import Prior
from hydro.core.identification.outcome import Fit, with_response_error
from hydro.core.prediction.parameters import Free
from hydro.core.residual.allowance import Allowance, Held

LEAST_GAIN = MATERIAL * LEAST_EVIDENCE
"""Minimum gain of log evidence by one more step of a fit: a part of what gaps of the library give."""


def with_free_hull_force(baseline: Baseline, model: Model, effects: Sequence[str]) -> Fit | None:
    """Return the values of a model with the hull force free, with the error of the response to forces.

    Args:
        baseline: Vehicle file and shots.
        model: Fitted model, whose values are the start.
        effects: Effects of the model that may have any plausible values.

    Returns:
        Values and standard errors of all components of the model.  None where the model leaves at most RIGHT
        times the noise; for a file without drag, because the hull force would take over the drag; in waves,
        because the allowance does not whiten their motion; and where predictions diverge.
    """
    if not effects or not unknown_hull_force(baseline, model) or baseline.problem.shots.swell is not None:
        return None
    shots = resolved(baseline.problem.some(SHOTS)).shots
    allowance = Allowance.of(model.vehicle, shots)
    if (allowance.weight > 0.0).mean() < ALMOST_ALL:
        return None
    prior = Known(baseline.beforehand, 1.0, frozenset(effects)).alone(model.unknown)
    held = allowance.held(model.unknown, model.values, prior)
    if not np.isfinite(held.evidence):
        return None
    held = refined(allowance, model.unknown, held, prior)
    fit = replace(model, values=held.best).estimated().with_covariance(held.covariance)
    return with_response_error(fit, baseline.vehicle)


def unknown_hull_force(baseline: Baseline, model: Model) -> bool:
    """Return whether a hull force of unknown form acts: above RIGHT times the noise, for a file with drag."""
    return model.normal.chi2 > RIGHT and has_drag(baseline.vehicle)


def hull_laws_alone(baseline: Baseline, outcome: Outcome) -> bool:
    """Return whether a hull force of unknown form acts, and all effects found may only describe that force.

    Then likelihood compares descriptions of the hull's error, and evidence with the hull force free decides.
    Errors of the velocity sensor that kinematics shows do not count.
    """
    found = [name for name in outcome.effects if not baseline.sure(name)]
    return bool(found) and all(map(is_hull_law, found)) and unknown_hull_force(baseline, outcome.model)


def limited_for_hull(confidence: float, effect: str, baseline: Baseline, fit: Fit, model: Model) -> float:
    """Return the confidence in a name, at most DOUBTFUL where the hull force alone may explain the effect.

    That is so above RIGHT if the effect is a hull law, or is not present with the hull force free.
    """
    if not unknown_hull_force(baseline, model):
        return confidence
    return min(confidence, DOUBTFUL) if is_hull_law(effect) or not is_present(fit, effect) else confidence


def is_present(fit: Fit, effect: str) -> bool:
    """Return whether any fitted value of an effect exceeds SMALL_STEP in its natural scale.

    An effect may vanish where its values must be physically possible, or where the hull force is free.
    """
    own = fit.free.places(effect)
    sizes = np.abs(fit.values[own]) / fit.free.scales[own]
    return bool((sizes > SMALL_STEP).any())


def refined(allowance: Allowance, unknown: Free, held: Held, prior: Prior) -> Held:
    """Return a fit with the hull force free, after at most QUICK_STEPS further steps."""
    return allowance.refined(unknown, held, prior, QUICK_STEPS, LEAST_GAIN)
