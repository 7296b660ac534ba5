"""Estimate of all parameters of one dive, by Gauss-Newton steps with the hull-force model held fixed.

All parameters are estimated together, so that the values of all dives are comparable: the model does not
depend on the dive.  Each shot has its own initial state, see `prediction.output_error`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.diagnosis.baseline import stable_shots
from hydro.core.diagnosis.log_faults import preprocess_alike
from hydro.core.errors import DataError
from hydro.core.history.baseline import Baseline
from hydro.core.history.parameters import STEP, vehicle_at
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import Normal, covariance
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.shots import Shots
from hydro.core.residual.regression import Regression, robust
from hydro.core.residual.response import Transitions, covered
from hydro.core.vehicle.description import Vehicle

STEPS = 2
"""Number of Gauss-Newton steps.

Thrust, buoyancy and drag act almost linearly over a shot of two seconds; the second step corrects the drag
for the current that the first step found.
"""
FARTHEST = 2.0
"""Maximum distance from the baseline, in prior standard deviations: farther away, predictions diverge."""
LEAST_GOOD_SHOTS = 12
"""Minimum number of shots without a divergent prediction."""


@dataclass(frozen=True)
class Estimate:
    """Estimates of P parameters from one dive.

    Attributes:
        values: Values in the order of the baseline's parameters, (P,).
        errors: Standard errors of the values, (P,).
        chi2: Mean squared residual, in units of `Baseline.sigma` squared.
    """

    values: Array
    errors: Array
    chi2: float


def estimate(baseline: Baseline, dive: str, raw: pl.DataFrame) -> Estimate:
    """Return estimates of the baseline's parameters from one dive, with standard errors.

    Args:
        baseline: Unchanged vehicle.
        dive: Name of the dive; a baseline dive uses a hull-force model that was not fitted to it.
        raw: Raw table of the dive.

    Raises:
        DataError: The dive does not fit the vehicle, is too short, or most of its predictions diverge.
    """
    vehicle, law = baseline.vehicle, baseline.law_for(dive)
    shots = stable_shots(vehicle, preprocess_alike(vehicle, raw, None)).weighed(baseline.sigma).shots
    neutral = np.array([one.neutral for one in baseline.parameters])
    spread = np.array([one.spread for one in baseline.parameters])
    away, normal, known = np.zeros(len(spread)), None, np.eye(len(spread))
    for _ in range(STEPS):
        normal = _linearised(baseline, law, shots, neutral + away * spread, spread)
        matrix = normal.matrix.sum(axis=0) + known * _noise(normal)
        step = np.linalg.solve(matrix, normal.score.sum(axis=0) - away * _noise(normal))
        moved = np.clip(away + step, -FARTHEST, FARTHEST)
        normal, away = normal.after(moved - away), moved
    if normal is None:
        raise DataError("no step was made")
    spread_after = covariance(normal, np.full(len(spread), _noise(normal)))
    return Estimate(neutral + away * spread, np.sqrt(np.diag(spread_after)) * spread, normal.chi2)


def _noise(normal: Normal) -> float:
    """Return the mean squared residual, at least 1: the factor on the information of the prior."""
    return max(normal.chi2, 1.0)


def _linearised(baseline: Baseline, law: Regression, shots: Shots, values: Array, spread: Array) -> Normal:
    """Linearise the residuals of a dive about parameter values, with less weight for outlying shots.

    Args:
        baseline: Unchanged vehicle.
        law: Hull-force model for this dive.
        shots: Shots of the dive.
        values: Parameter values, (P,).
        spread: Prior standard deviations, (P,): units of the columns.

    Raises:
        DataError: The predictions of too many shots diverge.
    """

    def at(there: Array) -> Vehicle:
        return vehicle_at(baseline.vehicle, baseline.drag, baseline.parameters, there)

    here = at(values)
    corrected = Transitions.of(candidate(here), shots).corrected(law.wrench(here, shots, covered(shots)))
    problem = OutputError(corrected).at_measured_states(here)
    moved = [at(values + STEP * spread * unit) for unit in np.eye(len(values))]
    normal = problem.linearise(here, moved, [STEP] * len(moved))
    good = np.asarray(np.isfinite(normal.gram).all(axis=(1, 2)))
    normal = normal.some(good)
    if len(normal.gram) < LEAST_GOOD_SHOTS:
        raise DataError("the predicted motion of most shots diverges: check the vehicle file and the log")
    weight = robust(normal.gram[:, -1, -1])
    weight /= weight.mean()
    return replace(normal, gram=normal.gram * weight[:, None, None])
