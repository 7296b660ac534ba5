"""What one recording has taught of a hull: the wrench beside its file, and how much error that leaves."""

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
"""Length of a stretch that is left out [s]."""
FOLDS = 8
"""Sets of stretches that are left out together, so that each holds some of every session."""
LEAST_SECONDS = 64.0
"""Length of all shots together in the recording that a hull is learnt from [s]."""


class Law(Protocol):
    """The wrench of a hull beside its file's."""

    def wrench(self, vehicle: Vehicle, shots: Shots) -> Array:
        """At every row of a recording, (N, 6) [N, N m]; current and velocity log are the vehicle's."""


@dataclass(frozen=True)
class Hull:
    """A hull as a recording shows it.

    Attributes:
        law: Its wrench beside the file's.
        sigma: Noise of the channels of that recording, (12,).
        floor: Root mean square residual of stretches that the law was not fitted to, in units of the noise
            and at least 1, (12,).
        alone: The same of the file alone, (12,).
        given: Mean squared residual of the file alone in units of the noise, and
        left: that of stretches left out.
        unchanged: The shots without what the law explains of them, left out of its fit in turn.
    """

    law: Law
    sigma: Array
    floor: Array
    alone: Array
    given: float
    left: float
    unchanged: OutputError


def learnt(vehicle: Vehicle, problem: OutputError) -> Hull:
    """Learn from the shots of an unchanged vehicle by the built-in regression.

    Raises:
        DataError: They are too short together.
    """
    shots = problem.shots
    seconds = len(shots.starts) * round((shots.length - shots.lead) * shots.record.dt, 6)
    if seconds < LEAST_SECONDS:
        raise DataError(
            f"{seconds:g} s without a gap are too short to learn a hull from; record {LEAST_SECONDS:g} s at "
            "least, or estimate single effects by `hydro fit --effect`, such as a weight from a few sinks"
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
    """A law that is known already, as a network's, with its floor on the shots of an unchanged vehicle."""
    transitions = Transitions.of(candidate(vehicle), problem.shots)
    corrected = OutputError(transitions.corrected(law.wrench(vehicle, problem.shots)))
    return judged(vehicle, problem, corrected, law)


def judged(vehicle: Vehicle, problem: OutputError, corrected: OutputError, law: Law) -> Hull:
    """A law with the floor that corrected shots, to which it was not fitted, have of it."""
    given, left = (one.linearise(vehicle, [], []) for one in (problem, corrected))
    weight = robust(left.gram[:, -1, -1])
    weight /= weight.mean()
    level, alone = (replace(one, channels=one.channels * weight[:, None]).rms for one in (left, given))
    return Hull(law, problem.shots.sigma, np.maximum(level, 1.0), alone, given.chi2, left.chi2, corrected)


def stretches(shots: Shots) -> Rows:
    """The set of stretches that each shot is left out with, (S,)."""
    seconds = (shots.length - shots.lead) * shots.record.dt
    number = np.arange(len(shots.starts)) // max(round(STRETCH / seconds), 1)
    return np.asarray(number % min(FOLDS, int(number[-1]) + 1), np.int64)
