"""Ranking of all effects of the catalogue by held-out gain, before any of them is fitted.

Where no model is right, a diagnosis names one change at a time.  It names no effect that merely absorbs the
error with which the file describes the hull, although such an effect can improve predictions.  Here all
effects are linearised together about the present model.  The score of an effect is the error that one linear
step of it, together with all existing effects, removes from held-out stretches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.confidence import left_out_costs
from hydro.core.diagnosis.model import begun, screened, unfitted
from hydro.core.diagnosis.settings import CORRELATED, SUSPECT_SPREAD
from hydro.core.identification.levenberg_marquardt import Problem
from hydro.core.identification.suspects import suspects
from hydro.core.vehicle.description import Vehicle


def promising(
    vehicle: Vehicle, own: Sequence[str], problem: Problem, fold: Rows, reach: Array
) -> list[dict[str, Any]]:
    """Return starting tables of the effects that lower the held-out error, the largest gain first.

    Args:
        vehicle: Vehicle.
        own: Existing effects that are fitted together with each.
        problem: Shots, starting at the measured states, or windows of equation error.
        fold: Fold that each shot or window is held out with, (S,).
        reach: Positions [m] and times [s] of the recording, (N, 4), among which anchors are sought.
    """
    model = begun(vehicle, own, problem, reach) if own else unfitted(vehicle, problem)
    tried = suspects(vehicle, without=own, reach=reach, completing=True)
    screening, there = screened(model, tried, len(fold)), list(range(len(model.values)))
    weight = CORRELATED * max(model.normal.chi2, 1.0) * SUSPECT_SPREAD**-2

    without = left_out_costs(screening.normal.of(there), fold, information=weight)
    found = list[tuple[float, dict[str, Any]]]()
    for name, (_, columns) in screening.ranked.items():
        both = [*there, *columns]
        after = left_out_costs(screening.normal.of(both), fold, information=weight)
        told = np.isfinite(without) & np.isfinite(after)
        table = screening.beginning(name, np.full(len(both), weight))
        found.append((float((without[told] - after[told]).sum()), table))
    return [table for gain, table in sorted(found, key=lambda one: -one[0]) if gain > 0.0]
