"""What the error of a hull's model makes of a change: the same fit, to the recording without it.

A model of a hull is not exact, and what it leaves is no noise: it lasts, and comes back wherever the motion
does.  So standard errors that residuals alone give are too small.  The stretches of the recording before that
the model was not fitted to show what it leaves, and the derivatives of a fit of the recording after what that
fit would have made of it: that much of its values may be the hull's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array
from hydro.core.identification.levenberg_marquardt import PRIOR, moved
from hydro.core.identification.outcome import Fit
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import Free
from hydro.core.vehicle.description import Vehicle


@dataclass(frozen=True)
class Imitation:
    """What a fit makes of a recording without the change.

    Attributes:
        step: Values that it would find there beyond those of no change, in the units of the entries, (P,).
        part: Part of the change itself, taken as a whole, that it would find.
    """

    step: Array
    part: float


def imitation(unchanged: OutputError, file: Vehicle, unknown: Free, values: Array) -> Imitation:
    """Work it out by one Gauss-Newton step, along the motion that the file predicts.

    Args:
        unchanged: Shots of the recording before, without what the model of the hull explains of them.
        file: The vehicle without the change.
        unknown: What was fitted to the recording after,
        values: and the values that were found, (P,).
    """
    changed, steps = moved(unknown, values)
    normal = unchanged.linearise(file, [unknown.at(values), *changed], [1.0] * (1 + len(changed)))
    gram = normal.gram[~normal.lost].sum(axis=0)
    # Columns are answers of the file's motion to the whole change, and to a little more of each entry.
    little = np.vstack([-np.ones(len(changed)), np.eye(len(changed))]) / np.array(steps)
    matrix, score = little.T @ gram[:-1, :-1] @ little, little.T @ gram[:-1, -1]
    step = np.linalg.solve(matrix + np.eye(len(changed)) * PRIOR**-2, score) * unknown.scales
    return Imitation(step, float(gram[0, -1] / max(gram[0, 0], 1e-300)))


def widened(fit: Fit, steps: Sequence[Array]) -> Fit:
    """The fit with imitations of its values, (P,) each, in the standard errors: one draw each."""
    spread = fit.covariance + sum(np.outer(step, step) for step in steps)
    return replace(fit, covariance=spread, standard_errors=np.sqrt(np.diag(spread)))
