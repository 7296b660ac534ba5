"""Model of the residual hull force, learned from one recording, with its error on held-out data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.errors import DataError
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.output_error import OutputError
from hydro.core.recording.shots import Shots
from hydro.core.residual.regression import learn, robust
from hydro.core.residual.response import Transitions
from hydro.core.vehicle.description import Vehicle

STRETCH = 10.0
"""Length of the stretches of a recording that are held out together [s]."""
FOLDS = 8
"""Number of cross-validation folds; each holds out stretches of every session."""
ACCEPTABLE = 3.0
"""Maximum reduced chi-square of an acceptable prediction, as of a diagnosis (`diagnosis.settings.FIT`)."""
LEAST_SECONDS = 64.0
"""Minimum total length of the shots from which a hull-force model is learned [s]."""


class Law(Protocol):
    """Residual wrench of a hull: the force that its vehicle file lacks, as a function of motion."""

    def wrench(self, vehicle: Vehicle, shots: Shots) -> Array:
        """Return the wrench on the vehicle about CO at every row of a recording, (N, 6) [N, N m].

        Args:
            vehicle: The vehicle; its current and DVL errors determine the motion through the water.
            shots: Shots of the recording, with its smoothed motion.
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
        unchanged: Problem of the shots corrected by the law, each shot by a fit that did not use it.
        measured: Problem of the shots as measured, without the law.
    """

    law: Law
    sigma: Array
    floor: Array
    alone: Array
    given: float
    left: float
    unchanged: OutputError
    measured: OutputError

    @property
    def describes(self) -> bool:
        """Whether the law describes the vehicle, by the function `describes`."""
        return describes(self.given, self.left)


def describes(given: float, left: float) -> bool:
    """Return whether a hull-force model predicts held-out data acceptably, or better than the file alone.

    Args:
        given: Reduced chi-square of the vehicle file without the model.
        left: Reduced chi-square of held-out stretches with the model.
    """
    return left <= max(given, ACCEPTABLE)


def learnt(vehicle: Vehicle, problem: OutputError) -> Hull:
    """Learn the residual hull force of an unchanged vehicle by regression on the hull-force library.

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
    parts = []
    for number, coefficients in enumerate(found.left_out):
        left_out = replace(found, coefficients=coefficients)
        parts.append((fold == number, transitions.corrected(left_out.wrench(vehicle, shots))))
    measured = shots.measured.copy()
    for chosen, corrected in parts:
        measured[chosen] = corrected.measured[chosen]
    return judged(vehicle, problem, OutputError(replace(shots, measured=measured)), found)


def known_by(vehicle: Vehicle, problem: OutputError, law: Law) -> Hull:
    """Return the hull model of a law that was not fitted to the recording, such as a network, with its error.

    Args:
        vehicle: Vehicle file.
        problem: Shots of a recording of the unchanged vehicle.
        law: The residual wrench.
    """
    transitions = Transitions.of(candidate(vehicle), problem.shots)
    corrected = OutputError(transitions.corrected(law.wrench(vehicle, problem.shots)))
    return judged(vehicle, problem, corrected, law)


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
    """Return the cross-validation fold of each of S shots, (S,): stretches of STRETCH seconds in turn."""
    seconds = (shots.length - shots.lead) * shots.record.dt
    number = np.arange(len(shots.starts)) // max(round(STRETCH / seconds), 1)
    return np.asarray(number % min(FOLDS, int(number[-1]) + 1), np.int64)
