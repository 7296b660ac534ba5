"""Baseline of a history: the unchanged vehicle, its hull-force model and its drag, from the first dives.

The hull-force model is the regression of `residual.regression`, held fixed in every later dive.  The
estimates of a baseline dive use coefficients that were fitted to the other baseline dives; otherwise the
model would absorb part of that dive, and baseline dives would scatter less than later dives.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import scipy

from hydro.core.columns import Array, Rows
from hydro.core.diagnosis.baseline import stable_shots
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.effects.columns import effect_wrenches
from hydro.core.errors import DataError
from hydro.core.history.parameters import Drag, Parameter, parameters_of
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.shots import Shots
from hydro.core.residual.hull import judged
from hydro.core.residual.library import Flow
from hydro.core.residual.regression import Regression, learn
from hydro.core.residual.response import Transitions, covered
from hydro.core.vehicle.description import Vehicle

LEAST_DIVES = 2
"""Minimum number of baseline dives: each is predicted by a model fitted to the others."""
LEAST_DRAG = 0.02
"""Minimum drag on an axis for an estimate of it, relative to the spread of all forces on that axis [1]."""


@dataclass(frozen=True)
class Baseline:
    """Unchanged vehicle, to which every dive of a history is compared.

    Attributes:
        vehicle: Vehicle file.
        law: Hull-force model fitted to all baseline dives.
        without: For each baseline dive by name, the hull-force model fitted to the other baseline dives.
        sigma: Standard deviation of pose and velocity, from sensor noise and error of the hull-force model,
            (12,) [m, rad, m/s, rad/s].
        drag: Drag on each axis.
        parameters: Parameters to estimate in every dive.
    """

    vehicle: Vehicle
    law: Regression
    without: Mapping[str, Regression]
    sigma: Array
    drag: Drag
    parameters: tuple[Parameter, ...]

    def law_for(self, dive: str) -> Regression:
        """Return a hull-force model that was not fitted to a dive.

        Args:
            dive: Name of the dive; for a baseline dive, the model is fitted to the other baseline dives.
        """
        return self.without.get(dive, self.law)


def learn_baseline(vehicle: Vehicle, dives: Mapping[str, pl.DataFrame]) -> Baseline:
    """Return the baseline of a history, learnt from dives of the unchanged vehicle.

    Args:
        vehicle: Vehicle file.
        dives: Raw table of each baseline dive, by name.

    Raises:
        DataError: There are too few dives, they do not fit the vehicle, or they are too short.
    """
    if len(dives) < LEAST_DIVES:
        raise DataError(f"a baseline needs at least {LEAST_DIVES} dives of the unchanged vehicle: name more")
    names = list(dives)
    parts = [frame.with_columns(session=_named(i)) for i, frame in enumerate(dives.values())]
    log = preprocess(vehicle, pl.concat(parts, how="diagonal_relaxed"))
    log.require_directions()
    problem = stable_shots(vehicle, log)
    shots = problem.shots
    number = np.array([int(name.partition("/")[0]) for name in log.sessions])
    dive = number[shots.segment]
    if missing := [name for i, name in enumerate(names) if i not in dive]:
        raise DataError(f"baseline dive {missing[0]} has no stretch without a gap that is long enough")
    transitions = Transitions.of(candidate(vehicle), shots)
    law = learn(vehicle, transitions, np.asarray(dive, np.int64))
    without = {name: replace(law, coefficients=law.left_out[i]) for i, name in enumerate(names)}
    corrected = _corrected(vehicle, transitions, dive, [without[name] for name in names])
    hull = judged(vehicle, problem, corrected, law)
    drag = drag_of(vehicle, shots, law)
    return Baseline(vehicle, law, without, hull.sigma * hull.floor, drag, parameters_of(vehicle, drag))


def _named(number: int) -> pl.Expr:
    """Return an expression for session names that begin with the number of the dive."""
    return pl.concat_str(pl.lit(f"{number}/"), pl.col("session"))


def _corrected(vehicle: Vehicle, transitions: Transitions, dive: Rows, laws: list[Regression]) -> OutputError:
    """Return the shots corrected for the hull force, each dive by a model that was not fitted to it.

    Args:
        vehicle: Vehicle file.
        transitions: Shots with the responses of their motion to forces.
        dive: Number of the dive of each shot, (S,).
        laws: Hull-force model for each dive.
    """
    shots = transitions.shots
    measured = shots.measured.copy()
    for number, law in enumerate(laws):
        part = dive == number
        measured[part] = transitions.corrected(law.wrench(vehicle, shots, covered(shots))).measured[part]
    return OutputError(replace(shots, measured=measured))


def drag_of(vehicle: Vehicle, shots: Shots, law: Regression) -> Drag:
    """Return the drag, by axis, that the vehicle file and its hull-force model give together.

    On each axis, linear and quadratic drag in the velocity of this axis are fitted to the force along the
    measured motion, together with inertia, attitude and a constant.  The coefficients are at least 0; both
    are 0 if the drag is below LEAST_DRAG.

    Args:
        vehicle: Vehicle file.
        shots: Shots of the baseline dives.
        law: Hull-force model.
    """
    record = shots.record
    flow = Flow.of(candidate(vehicle), shots)
    still = np.zeros_like(shots.nu)
    moving, resting = (
        effect_wrenches(vehicle, shots.eta, nu, record.segments, record.t, record.commands)
        for nu in (shots.nu, still)
    )
    force = moving - resting + law.wrench(vehicle, shots)
    linear, quadratic = np.zeros(6), np.zeros(6)
    others = np.hstack([flow.nu_dot, flow.down, np.ones((len(force), 1))])
    for axis in range(6):
        speed = flow.nu[:, axis]
        columns = np.column_stack([speed, np.abs(speed) * speed, others])
        size = np.sqrt((columns**2).mean(axis=0)) + 1e-12
        low = np.full(columns.shape[1], -np.inf)
        low[:2] = 0.0
        found = scipy.optimize.lsq_linear(columns / size, -force[:, axis], (low, np.inf)).x / size
        part = columns[:, :2] @ found[:2]
        if np.std(part) >= LEAST_DRAG * np.std(force[:, axis] + part) and np.std(part) > 0.0:
            linear[axis], quadratic[axis] = found[:2]
    return Drag(linear, quadratic)
