"""Standard errors of a change that account for the error of the hull model.

The error of a hull model is not white noise: it persists, and it recurs with the motion.  So standard errors
from residuals alone are too small.  Two terms are combined here.  The first is the change that the fit would
find in each held-out stretch of the recording without a change: that much may be caused by the hull model's
error.  The second is the scatter of the values between the stretches of the recording with the change, as in
the sandwich estimator for clustered errors (White 1982, Liang and Zeger 1986).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.identification.levenberg_marquardt import PRIOR, moved
from hydro.core.identification.outcome import Fit
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import Free
from hydro.core.vehicle.description import Vehicle


def imitations(unchanged: OutputError, file: Vehicle, unknown: Free, values: Array, fold: Rows) -> Array:
    """Return the changes that would be fitted to stretches of a recording without a change.

    Each is one Gauss-Newton step along the motion that the file predicts.  Each stretch is weighted to
    represent as much data as all stretches together.

    Args:
        unchanged: Shots of the recording before the change, corrected by the hull model.
        file: The vehicle without the change.
        unknown: Components fitted to the recording after the change.
        values: Their fitted values, (P,).
        fold: Number of the stretch of each shot, (S,).

    Returns:
        Deviations from no change, in the units of the components, (stretches, P).
    """
    changed, steps = moved(unknown, values)
    normal = unchanged.linearise(file, [unknown.at(values), *changed], [1.0] * (1 + len(changed)))
    numbers = np.unique(fold)
    gram = np.array([normal.gram[(fold == one) & ~normal.lost].sum(axis=0) for one in numbers]) * len(numbers)
    # Columns are responses of the file's motion to the whole change, and to a small step of each component.
    little = np.vstack([-np.ones(len(changed)), np.eye(len(changed))]) / np.array(steps)
    matrix = little.T @ gram[:, :-1, :-1] @ little + np.eye(len(changed)) * PRIOR**-2
    score = gram[:, :-1, -1] @ little
    found: Array = np.linalg.solve(matrix, score[..., None])[..., 0] * unknown.scales
    return found


def pulls(normal: Normal, unknown: Free, fold: Rows) -> Array:
    """Return the change of the fitted values caused by each stretch of a recording.

    Args:
        normal: The problem linearised at the fit.
        unknown: The P fitted components.
        fold: Number of the stretch of each shot, (S,).

    Returns:
        Changes of the values, in the units of the components, (stretches, P).
    """
    kept = np.isfinite(normal.gram[:, -1, -1])
    matrix = normal.matrix[kept].sum(axis=0) + np.eye(len(unknown.scales)) * PRIOR**-2
    score = np.array([normal.score[kept & (fold == one)].sum(axis=0) for one in np.unique(fold)])
    found: Array = np.linalg.solve(matrix, score.T).T * unknown.scales
    return found


def widened(fit: Fit, imitated: Array, pulled: Array) -> Fit:
    """Return the fit with standard errors widened by hull model error and by scatter between stretches.

    Correlations stay those of the fit: few stretches do not determine them.

    Args:
        fit: The fit, P values.
        imitated: Draws of the hull model's error in the values, (stretches, P), see `imitations`.
        pulled: Changes of the values by each stretch, (stretches, P), see `pulls`.
    """
    count = len(pulled)
    variance = (imitated**2).mean(axis=0) + (pulled**2).sum(axis=0) * count / max(count - 1, 1)
    errors = np.sqrt(variance)
    scale = errors / np.maximum(np.sqrt(np.diag(fit.covariance)), 1e-300)
    return replace(fit, covariance=fit.covariance * np.outer(scale, scale), standard_errors=errors)
