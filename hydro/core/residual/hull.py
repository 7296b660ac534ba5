"""Residual hull model learned from one recording, with its prediction error on held-out data.

The response to the hull force is of first order about the measured motion (`residual.response`), which holds
for a file that predicts nearly the measured motion.  Where the response is not of first order, the force acts
in the simulation of every prediction instead (`prediction.forced`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

import numpy as np

from hydro.core.columns import Array, Mask, Rows
from hydro.core.errors import DataError
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.forced import ForcedOutputError, displaced_by
from hydro.core.prediction.multiple_shooting import predict
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.shots import SHOT_SECONDS, Shots
from hydro.core.residual.completion import Completion
from hydro.core.residual.limits import FIT, LEAST_SHOTS, RIGHT
from hydro.core.residual.regression import Regression, learn, robust
from hydro.core.residual.response import Transitions, covered
from hydro.core.vehicle.description import Vehicle

STRETCH = 10.0
"""Length of the stretches of a recording that are held out together [s]."""
FOLDS = 8
"""Number of cross-validation folds; each holds out stretches of every session."""
LEAST_SECONDS = 2.0 * LEAST_SHOTS * SHOT_SECONDS
"""Minimum total length of the shots from which a hull-force model is learned [s]."""


class Law(Protocol):
    """Residual wrench of a hull: the force that its vehicle file lacks, as a function of motion."""

    def wrench(self, vehicle: Vehicle, shots: Shots, rows: Mask | None = None) -> Array:
        """Return the wrench on the vehicle about CO along a recording, (N, 6) [N, N m].

        Args:
            vehicle: The vehicle; its current and DVL errors determine the motion through the water.
            shots: Shots of the recording, with its smoothed motion.
            rows: Rows at which the wrench is needed, (N,); it may be zero at all others.  None for every row.
        """


@dataclass(frozen=True)
class Hull:
    """Model of the residual hull force and its error on held-out data.

    Attributes:
        law: The residual wrench.
        sigma: Noise of pose and velocity, (12,) [m, rad, m/s, rad/s].
        floor: Root mean square residual of held-out stretches in units of the noise, at least 1, (12,).
        alone: Root mean square residual of the vehicle file without the law, in units of the noise, (12,).
        given: Reduced chi-square of the vehicle file without the law.
        left: Reduced chi-square of held-out stretches with the law.
        unchanged: The shots corrected by the law, each by a fit that did not use it.
        measured: The shots as measured, without the law.
        simulated: Whether the law acts in the simulation, because its response is not of first order.
        completion: Fit of the file to the recording, if the law was learnt about the fitted vehicle.
        sensors: Kinematic tests of the velocity sensor in the recording, by effect, as of
            `preprocessing.sensor_tests`; None if they were not made.
    """

    law: Law
    sigma: Array
    floor: Array
    alone: Array
    given: float
    left: float
    unchanged: OutputError
    measured: OutputError
    simulated: bool = False
    completion: Completion | None = None
    sensors: Mapping[str, Any] | None = None

    def completed(self, vehicle: Vehicle) -> Vehicle:
        """Return a vehicle to whose predictions the law adds: the file itself unless it was fitted.

        Args:
            vehicle: Vehicle file, perhaps with changes.
        """
        return vehicle if self.completion is None else self.completion.of(vehicle)

    def acting(self, vehicle: Vehicle, transitions: Transitions) -> OutputError:
        """Return the shots of a recording as a fitting problem that takes account of the hull force.

        Args:
            vehicle: The vehicle; its current and DVL errors determine the motion through the water.
            transitions: The shots, with their responses to forces.
        """
        shots = transitions.shots
        if self.simulated:
            return ForcedOutputError.under(shots, self.law.wrench(vehicle, shots))
        return OutputError(transitions.corrected(self.law.wrench(vehicle, shots, covered(shots))))

    @property
    def describes(self) -> bool:
        """Whether the law predicts held-out data acceptably, or better than the file alone."""
        return describes(self.given, self.left)


def describes(given: float, left: float) -> bool:
    """Return whether a hull-force model predicts held-out data acceptably, or better than the file alone.

    Args:
        given: Reduced chi-square of the vehicle file without the model.
        left: Reduced chi-square of held-out stretches with the model.
    """
    return left <= max(given, FIT)


def learnt(vehicle: Vehicle, problem: OutputError) -> Hull:
    """Return the residual hull force of an unchanged vehicle, by regression on the hull-force library.

    Args:
        vehicle: Vehicle file.
        problem: Shots of a recording of the unchanged vehicle.

    Raises:
        DataError: The shots are too short in total.
    """
    shots = problem.shots
    seconds = len(shots.starts) * round((shots.length - shots.lead) * shots.record.dt, 6)
    if seconds < LEAST_SECONDS:
        raise DataError(
            f"{seconds:g} s without a gap are too short to learn a hull from; record at least "
            f"{LEAST_SECONDS:g} s, or estimate single effects with `hydro fit --effect`, such as the weight "
            "from a few descents without thrust"
        )
    transitions, fold = Transitions.of(candidate(vehicle), shots), stretches(shots)
    found = learn(vehicle, transitions, fold)
    measured = shots.measured.copy()
    for number, wrench in enumerate(found.left_out_wrenches(vehicle, shots, covered(shots))):
        chosen = fold == number
        measured[chosen] = transitions.over(chosen).corrected(wrench).measured
    hull = judged(vehicle, problem, OutputError(replace(shots, measured=measured)), found)
    return hull if _of_first_order(vehicle, transitions, hull) else _simulated(vehicle, problem, hull, found)


def _of_first_order(vehicle: Vehicle, transitions: Transitions, hull: Hull) -> bool:
    """Return whether the simulated response to the hull force is as accurate as that of first order."""
    sigma = hull.sigma * hull.floor
    both = (replace(hull, simulated=one).acting(vehicle, transitions) for one in (False, True))
    first, other = (one.weighed(sigma).linearise(vehicle, [], []).gram[:, -1, -1] for one in both)
    return bool(np.median(other) <= RIGHT * np.median(first))


def _simulated(vehicle: Vehicle, problem: OutputError, hull: Hull, found: Regression) -> Hull:
    """Return the hull model whose force acts in the simulation, if it predicts held-out data better.

    The coefficients get one Gauss-Newton step, from the residual of the simulation.
    """
    shots = problem.shots
    fold, under = stretches(shots), partial(ForcedOutputError.under, shots)

    def motion(one: OutputError) -> Array:
        return predict(one.prepared(vehicle), one.shots)

    left = displaced_by(shots.measured, motion(problem), motion(under(found.wrench(vehicle, shots))))
    step = learn(vehicle, Transitions.of(candidate(vehicle), replace(shots, measured=left)), fold)
    law = found.moved(step)
    whole = under(law.wrench(vehicle, shots))
    everywhere, measured = motion(whole), shots.measured.copy()
    for number, wrench in enumerate(law.left_out_wrenches(vehicle, shots)):
        chosen = fold == number
        there = motion(under(wrench).over(chosen))
        measured[chosen] = displaced_by(measured[chosen], everywhere[chosen], there)
    other = replace(judged(vehicle, problem, whole.of_measured(measured), law), simulated=True)
    return other if other.left < hull.left else hull


def known_by(vehicle: Vehicle, problem: OutputError, law: Law) -> Hull:
    """Return the hull model of a law that was not fitted to the recording, such as a network, with its error.

    Args:
        vehicle: Vehicle file.
        problem: Shots of a recording of the unchanged vehicle.
        law: The residual wrench.
    """
    transitions = Transitions.of(candidate(vehicle), problem.shots)
    corrected = transitions.corrected(law.wrench(vehicle, problem.shots, covered(problem.shots)))
    return judged(vehicle, problem, OutputError(corrected), law)


def judged(vehicle: Vehicle, problem: OutputError, corrected: OutputError, law: Law) -> Hull:
    """Return the hull model of a law, with its error on shots to which the law was not fitted.

    Args:
        vehicle: Vehicle file.
        problem: Shots as measured.
        corrected: The same shots with the response to the law subtracted.
        law: The residual wrench.
    """
    given, left = (one.linearise(vehicle, [], []) for one in (problem, corrected))
    weight = robust(left.gram[:, -1, -1])
    weight /= weight.mean()
    level, alone = (replace(one, channels=one.channels * weight[:, None]).rms for one in (left, given))
    floor, sigma = np.maximum(level, 1.0), problem.shots.sigma
    return Hull(law, sigma, floor, alone, given.chi2, left.chi2, corrected, problem)


def stretches(shots: Shots) -> Rows:
    """Return the cross-validation fold of each of S shots, from 0, (S,).

    Successive stretches of STRETCH seconds get the folds in turn.
    """
    seconds = (shots.length - shots.lead) * shots.record.dt
    number = np.arange(len(shots.starts)) // max(round(STRETCH / seconds), 1)
    return np.asarray(number % min(FOLDS, int(number[-1]) + 1), np.int64)
