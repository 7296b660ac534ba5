"""Prediction error of a vehicle file on a recording, before and after findings are added to it.

Findings are added as by `hydro add`: their values enter the file, and everything else in it stays.  The error
after is that of held-out stretches, to which the values were not fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import VELOCITY, Array
from hydro.core.diagnosis.baseline import stable_start
from hydro.core.diagnosis.findings import WITH_VALUES, Diagnosis, Finding, Prediction, extended
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.settings import FOLDS, RESAMPLES, SHOTS
from hydro.core.diagnosis.transfer import left_out_squares, resolved
from hydro.core.effects.catalogue import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.evaluation.block_resampling import weights
from hydro.core.evaluation.regimes import Pieces
from hydro.core.evaluation.replay_error import replay
from hydro.core.evaluation.velocity_errors import Squares, axes_by_distance, squares_ahead
from hydro.core.evaluation.weights import Weights
from hydro.core.evaluation.yardsticks import JUDGED
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.output_error import OutputError
from hydro.core.progress import Progress, silent
from hydro.core.recording.shots import Shots
from hydro.core.vehicle.description import Vehicle


def predicted(
    diagnosis: Diagnosis, vehicle: Vehicle, log: Preprocessed, progress: Progress = silent
) -> Diagnosis:
    """Return a diagnosis with `prediction` filled in, and `error_added` of each finding with values.

    A recording with fewer than FOLDS stretches of JUDGED seconds gives the diagnosis unchanged.
    """
    try:
        ahead = log.shots(JUDGED)
    except DataError:
        return diagnosis
    if len(ahead.starts) < FOLDS:
        return diagnosis
    progress("predictions of the file", 0.0)
    check, alone = _Check.of(vehicle, log, ahead), {}
    added = [(i, one) for i, one in enumerate(diagnosis.findings) if can_be_added(one)]
    for number, (i, one) in enumerate(added):
        progress(f"predictions with {one.effect} added", (number + 1) / (len(added) + 2))
        alone[i] = check.squares([one])
    progress("predictions with all findings added", (len(added) + 1) / (len(added) + 2))
    findings = tuple(
        replace(one, error_added=check.error(alone[i])) if i in alone else one
        for i, one in enumerate(diagnosis.findings)
    )
    stated = [i for i in alone if findings[i].is_confirmed]
    if len(stated) == 1:
        after = alone[stated[0]]
    else:
        after = check.squares([findings[i] for i in stated]) if stated else check.given
    difference = check.errors(after) - check.errors(check.given)
    noise = check.noise()
    floor = None if noise is None else float(np.sqrt(noise @ check.weight))
    prediction = Prediction(
        JUDGED,
        check.error(check.given),
        check.error(after),
        float(difference.std()),
        floor,
        by_axis(check.given, after, noise),
    )
    return replace(diagnosis, findings=findings, prediction=prediction)


def by_axis(given: Squares, added: Squares, noise: Array | None) -> dict[str, list[float | None]]:
    """Return three errors of each axis with samples [m/s, rad/s], by name of the axis.

    The errors are root mean squares: of the file as given, with findings added, and by noise alone, None if
    that is not known.

    Args:
        given: Squared errors of the file.
        added: Squared errors with findings added.
        noise: Mean squared errors by noise alone, (6,) [m^2/s^2, rad^2/s^2]; None if not known.
    """
    seen = given.counts.sum(axis=0) > 0.0
    errors = [np.sqrt(given.mean), np.sqrt(added.mean), None if noise is None else np.sqrt(noise)]
    return {
        axis: [None if one is None else float(one[i]) for one in errors]
        for i, axis in enumerate(VELOCITY)
        if seen[i]
    }


def can_be_added(finding: Finding) -> bool:
    """Return whether a finding's values change predictions; random waves have a mean of zero."""
    effect = CATALOGUE.get(finding.effect.partition(":")[0])
    changes = effect is not None and not effect.is_random
    return finding.verdict in WITH_VALUES and bool(finding.parameters) and changes


@dataclass(frozen=True)
class _Check:
    """Comparison of a vehicle file, and of the file with findings added, with one recording.

    Attributes:
        vehicle: Vehicle file.
        log: Recording.
        problem: Shots to which findings are refitted.
        ahead: Shots that are predicted.
        given: Squared errors of the file as given.
        weight: Weight of each axis, (6,).
    """

    vehicle: Vehicle
    log: Preprocessed
    problem: OutputError
    ahead: Shots
    given: Squares
    weight: Array

    @classmethod
    def of(cls, vehicle: Vehicle, log: Preprocessed, ahead: Shots) -> _Check:
        """Predict a recording with the file as given."""
        problem = resolved(stable_start(vehicle, log)[1]).some(SHOTS)
        weight = Weights.of(candidate(vehicle)).velocity
        return cls(vehicle, log, problem, ahead, squares_ahead(vehicle, ahead), weight)

    def squares(self, findings: Sequence[Finding]) -> Squares:
        """Return the squared errors of held-out stretches with findings added."""
        vehicle = extended(self.vehicle, [one.table for one in findings])
        problem = self.problem.at_measured_states(vehicle)
        return left_out_squares(vehicle, [one.effect for one in findings], problem, self.ahead)

    def error(self, squares: Squares) -> float:
        """Return the root mean square error over all axes [m/s]."""
        return squares.error(self.weight)

    def errors(self, squares: Squares) -> Array:
        """Return the error for random weights of the stretches, with a fixed seed, (RESAMPLES,) [m/s]."""
        drawn = weights(len(squares.sums), RESAMPLES, seed=0)
        means = (drawn @ squares.sums) / np.maximum(drawn @ squares.counts, 1e-12)
        return np.asarray(np.sqrt(means @ self.weight))

    def noise(self) -> Array | None:
        """Return mean squared errors due to noise alone, (6,) [m^2/s^2, rad^2/s^2].

        None if velocity was not measured, so that the error is that of the distance covered.
        """
        record, motion = self.log.record, self.log.motion
        if motion is None or axes_by_distance(record).size:
            return None
        both = replay(candidate(self.vehicle), record, motion, Pieces.of(record), JUDGED, 0)
        if both is None:
            return None
        noise, numbers = both[0].noise.sum(axis=0), both[0].numbers.sum(axis=0)
        mean: Array = noise / np.maximum(numbers, 1.0)
        return mean
