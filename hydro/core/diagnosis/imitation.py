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
from hydro.core.diagnosis.model import Model
from hydro.core.identification.fit import Fit
from hydro.core.identification.levenberg_marquardt import PRIOR, moved
from hydro.core.identification.output_error import OutputError
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


def imitation(unchanged: OutputError, file: Vehicle, model: Model) -> Imitation:
    """Work it out by one Gauss-Newton step.

    Args:
        unchanged: Shots of the recording before, without what the model of the hull explains of them.
        file: The vehicle without the change.
        model: The fit of the recording after.
    """
    changed, steps = moved(model.unknown, model.values)
    normal = unchanged.linearise(model.vehicle, [*changed, file], [*steps, 1.0])
    gram = normal.gram[~normal.lost].sum(axis=0)
    matrix, score, own = gram[:-1, :-1], gram[:-1, -1], slice(0, len(changed))
    beside = score - matrix[:, -1]  # about the file: its predictions are the last column away from the fit's
    total = matrix[own, own] + np.eye(len(changed)) * PRIOR**-2
    step = np.linalg.solve(total, beside[own]) * model.unknown.scales
    return Imitation(step, float(-beside[-1] / max(matrix[-1, -1], 1e-300)))


def widened(fit: Fit, steps: Sequence[Array]) -> Fit:
    """The fit with imitations of its values, (P,) each, in the standard errors: one draw each."""
    spread = fit.covariance + sum(np.outer(step, step) for step in steps)
    return replace(fit, covariance=spread, standard_errors=np.sqrt(np.diag(spread)))
