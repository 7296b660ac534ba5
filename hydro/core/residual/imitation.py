"""Error that a hull-force model causes in the fitted values of a change.

The error of a hull-force model is not white noise: it persists, and it recurs with the motion.  So its effect
on a fit is estimated from a recording without a change: from the change that a fit would find in each
held-out stretch of this recording.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.identification.levenberg_marquardt import PRIOR, moved
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import Free
from hydro.core.vehicle.description import Vehicle


def imitations(unchanged: OutputError, file: Vehicle, unknown: Free, values: Array, fold: Rows) -> Array:
    """Return the changes that a fit would find in a recording without a change, by stretch of the recording.

    Each value is that of a recording in which all stretches are like this one.  It is one Gauss-Newton step
    along the motion that the file predicts, with the information of all stretches and the score of one
    stretch in place of each.  One stretch alone need not determine every entry: in a straight run, thrusters
    with equal commands cannot be separated.

    Args:
        unchanged: Shots of the recording before the change, corrected by the hull-force model.
        file: The vehicle without the change.
        unknown: P components fitted to the recording after the change.
        values: Fitted values of the components, (P,).
        fold: Number of the stretch of each of S shots, (S,).

    Returns:
        Deviations from no change, in the scales of the components, (stretches, P).
    """
    changed, steps = moved(unknown, values)
    normal = unchanged.linearise(file, [unknown.at(values), *changed], [1.0] * (1 + len(changed)))
    numbers = np.unique(fold)
    # Columns are responses of the file's motion to the whole change, and to a small step of each component.
    little = np.vstack([-np.ones(len(changed)), np.eye(len(changed))]) / np.array(steps)
    kept = normal.some(~normal.lost)
    matrix = little.T @ kept.matrix.sum(axis=0) @ little + np.eye(len(changed)) * PRIOR**-2
    each = np.array([kept.score[fold[~normal.lost] == one].sum(axis=0) for one in numbers]) @ little
    found: Array = len(numbers) * np.linalg.solve(matrix, each.T).T
    return found
