"""Values of effects with the unmodelled hull force free, where no model reaches the noise.

A fit of effects alone moves their values towards what absorbs the hull's error, by several standard errors.
Here the hull force is integrated out (`residual.allowance`), and the values of the file's other effects have
their priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hydro.core.diagnosis.baseline import Baseline
from hydro.core.diagnosis.hull_laws import has_drag
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.settings import LEAST_EVIDENCE, MATERIAL, QUICK_STEPS, RIGHT, SHOTS
from hydro.core.diagnosis.transfer import Known, resolved
from hydro.core.identification.levenberg_marquardt import Prior
from hydro.core.identification.outcome import Fit, with_response_error
from hydro.core.prediction.parameters import Free
from hydro.core.residual.allowance import Allowance, Held

LEAST_GAIN = MATERIAL * LEAST_EVIDENCE
"""Minimum gain of log evidence by one more step of a fit: a part of what gaps of the library give."""


def beside_hull(baseline: Baseline, model: Model, effects: Sequence[str]) -> Fit | None:
    """Return the values of a model with the hull force free, with the error of the response to forces.

    Args:
        baseline: Vehicle file and shots.
        model: Fitted model, whose values are the start.
        effects: Effects of the model that may have any plausible values.

    Returns:
        Values and standard errors of all components of the model.  None where the model may be right, for a
        file without drag, because the hull force would take over the drag, and where predictions diverge.
    """
    if not effects or model.normal.chi2 <= RIGHT or not has_drag(baseline.vehicle):
        return None
    allowance = Allowance.of(baseline.vehicle, resolved(baseline.problem.some(SHOTS)).shots)
    prior = Known(baseline.beforehand, 1.0, frozenset(effects)).alone(model.unknown)
    held = allowance.held(model.unknown, model.values, prior)
    if not np.isfinite(held.evidence):
        return None
    held = refined(allowance, model.unknown, held, prior)
    fit = replace(model, values=held.best).estimated().with_covariance(held.covariance)
    return with_response_error(fit, baseline.vehicle)


def refined(allowance: Allowance, unknown: Free, held: Held, prior: Prior) -> Held:
    """Return a fit with the hull force free, after at most QUICK_STEPS further steps."""
    return allowance.refined(unknown, held, prior, QUICK_STEPS, LEAST_GAIN)
