"""What the error of a hull's model makes of a change: the same fit, to the recording without it.

A model of a hull is not exact, and what it leaves is no noise: it lasts, and comes back wherever the motion
does.  So standard errors that residuals alone give are too small.  The stretches of the recording before that
the model was not fitted to show what it leaves, and the derivatives of a fit of the recording after what that
fit would have made of each: that much of its values may be the hull's.  How much the stretches of the
recording after pull its values apart adds to it, as in the sandwich formula of clustered errors (White 1982,
Liang and Zeger 1986).
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
    """Return what fits to the stretches of a recording without a change would find of it.

    Each is one Gauss-Newton step, along the motion that the file predicts, from a stretch that stands for as
    much data as all of them have.

    Args:
        unchanged: Shots of the recording before, without what the model of the hull explains of them.
        file: The vehicle without the change.
        unknown: What was fitted to the recording after,
        values: and the values that were found, (P,).
        fold: Number of the stretch of each shot, (S,).

    Returns:
        Values beyond those of no change, in the units of the entries, (stretches, P).
    """
    changed, steps = moved(unknown, values)
    normal = unchanged.linearise(file, [unknown.at(values), *changed], [1.0] * (1 + len(changed)))
    numbers = np.unique(fold)
    gram = np.array([normal.gram[(fold == one) & ~normal.lost].sum(axis=0) for one in numbers]) * len(numbers)
    # Columns are answers of the file's motion to the whole change, and to a little more of each entry.
    little = np.vstack([-np.ones(len(changed)), np.eye(len(changed))]) / np.array(steps)
    matrix = little.T @ gram[:, :-1, :-1] @ little + np.eye(len(changed)) * PRIOR**-2
    score = gram[:, :-1, -1] @ little
    found: Array = np.linalg.solve(matrix, score[..., None])[..., 0] * unknown.scales
    return found


def pulls(normal: Normal, unknown: Free, fold: Rows) -> Array:
    """Return how far each stretch of a recording pulls the values of a fit to all of it.

    Args:
        normal: The problem about the fit.
        unknown: What was fitted, P entries.
        fold: Number of the stretch of each shot, (S,).

    Returns:
        Changes of the values, in the units of the entries, (stretches, P).
    """
    kept = np.isfinite(normal.gram[:, -1, -1])
    matrix = normal.matrix[kept].sum(axis=0) + np.eye(len(unknown.scales)) * PRIOR**-2
    score = np.array([normal.score[kept & (fold == one)].sum(axis=0) for one in np.unique(fold)])
    found: Array = np.linalg.solve(matrix, score.T).T * unknown.scales
    return found


def widened(fit: Fit, imitated: Array, pulled: Array) -> Fit:
    """Return the fit with standard errors that hold for the hull model's error and between stretches.

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
