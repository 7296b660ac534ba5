"""Prediction error of a vehicle file on a recording, before and after findings are added to it.

Findings are added as by `hydro add`: their values enter the file, and everything else in it stays.  The error
after is that of held-out stretches, to which the values were not fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hydro.core.columns import VELOCITY, Array
from hydro.core.diagnosis.baseline import stable_start
from hydro.core.diagnosis.findings import WITH_VALUES, Diagnosis, Finding, Prediction, extended
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.settings import ALMOST_ALL, FOLDS, NEGLIGIBLE, RESAMPLES, SHOTS
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
from hydro.core.prediction.parameters import free
from hydro.core.progress import Progress, silent
from hydro.core.recording.shots import Shots
from hydro.core.residual.limits import WITHIN
from hydro.core.vehicle.description import Vehicle


def predicted(
    diagnosis: Diagnosis, vehicle: Vehicle, log: Preprocessed, progress: Progress = silent
) -> Diagnosis:
    """Return a diagnosis with `prediction` filled in, and `error_added` of each finding with values.

    Where nothing is confirmed, a finding that alone removes almost all of the error comes first (`explains`).
    A recording that is too short for held-out predictions gives the diagnosis unchanged.
    """
    progress("predictions of the file", 0.0)
    check = HeldOut.of(vehicle, log)
    if check is None:
        return diagnosis
    alone = dict[int, Squares]()
    added = [(i, one) for i, one in enumerate(diagnosis.findings) if can_be_added(one)]
    for number, (i, one) in enumerate(added):
        progress(f"predictions with {one.effect} added", (number + 1) / (len(added) + 2))
        alone[i] = check.squares([one.table])
    progress("predictions with all findings added", (len(added) + 1) / (len(added) + 2))
    findings = [
        replace(one, error_added=check.error(alone[i])) if i in alone else one
        for i, one in enumerate(diagnosis.findings)
    ]
    stated = [i for i in alone if findings[i].is_confirmed]
    if len(stated) == 1:
        after = alone[stated[0]]
    else:
        after = check.squares([findings[i].table for i in stated]) if stated else check.given
    difference = check.errors(after) - check.errors(check.given)
    prediction = Prediction(
        JUDGED,
        check.error(check.given),
        check.error(after),
        float(difference.std()),
        check.floor,
        by_axis(check.given, after, check.noise),
    )
    tried = [(findings[i].table, squares) for i, squares in alone.items()]
    first = None if stated else check.explains(tried)
    found = tuple(findings) if first is None else with_first(findings, list(alone), list(alone)[first])
    return replace(diagnosis, findings=found, prediction=prediction)


def with_first(findings: Sequence[Finding], places: Sequence[int], first: int) -> tuple[Finding, ...]:
    """Return findings with one of them moved before others; all further findings keep their places.

    None of the others has more confidence than it, because it alone explains almost all of the error.

    Args:
        findings: Findings.
        places: Places of the findings that may change their order, in ascending order.
        first: The one of these places whose finding comes first.
    """
    order, found = [first, *(place for place in places if place != first)], list(findings)
    most = findings[first].confidence
    for place, one in zip(places, (findings[i] for i in order), strict=True):
        found[place] = replace(one, confidence=min(one.confidence, most))
    return tuple(found)


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


Tried = tuple[Mapping[str, Any], Squares]
"""`[[effect]]` table of an effect, and the squared errors with this effect alone added to the file."""


@dataclass(frozen=True)
class HeldOut:
    """Comparison of a vehicle file, and of the file with effects added, with held-out parts of one recording.

    Attributes:
        vehicle: Vehicle file.
        log: Recording.
        problem: Shots to which added effects are refitted.
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
    def of(cls, vehicle: Vehicle, log: Preprocessed) -> HeldOut | None:
        """Predict a recording with the file as given; None with fewer than FOLDS stretches of JUDGED s."""
        try:
            ahead = log.shots(JUDGED)
        except DataError:
            return None
        if len(ahead.starts) < FOLDS:
            return None
        problem = resolved(stable_start(vehicle, log)[1]).some(SHOTS)
        weight = Weights.of(candidate(vehicle)).velocity
        return cls(vehicle, log, problem, ahead, squares_ahead(vehicle, ahead), weight)

    def squares(self, tables: Sequence[Mapping[str, Any]]) -> Squares:
        """Return the squared errors of held-out stretches with `[[effect]]` tables added."""
        vehicle = extended(self.vehicle, tables)
        problem = self.problem.at_measured_states(vehicle)
        return left_out_squares(vehicle, [str(one["name"]) for one in tables], problem, self.ahead)

    def error(self, squares: Squares) -> float:
        """Return the root mean square error over all axes [m/s]."""
        return squares.error(self.weight)

    def errors(self, squares: Squares) -> Array:
        """Return the error for random weights of the stretches, with a fixed seed, (RESAMPLES,) [m/s]."""
        drawn = weights(len(squares.sums), RESAMPLES, seed=0)
        means = (drawn @ squares.sums) / np.maximum(drawn @ squares.counts, 1e-12)
        return np.asarray(np.sqrt(means @ self.weight))

    def removed(self, table: Mapping[str, Any], squares: Squares) -> float:
        """Return the share of the squared error beyond the noise that an effect alone removes.

        Each of its components costs NEGLIGIBLE, because the hull's error is alike on all stretches, so that
        held-out stretches do not penalise components that follow it.

        Args:
            table: Table of the effect.
            squares: Squared errors with the effect added.
        """
        components = len(free(extended(self.vehicle, [table]), [str(table["name"])]).entries)
        gain = self.error(self.given) ** 2 - self.error(squares) ** 2
        return gain / self._beyond_noise - NEGLIGIBLE * components

    def behind(self, tried: Sequence[Tried], fair: Sequence[bool] | None = None) -> list[bool]:
        """Return for each of several effects whether it predicts clearly worse than the best of them.

        It removes nothing where the best removes something, or less than the best by more than WITHIN
        standard errors of the difference (`removed`).

        Args:
            tried: Table of each effect, and squared errors with this effect alone added.
            fair: Whether each effect may be the best; by default all may, also where none is fair.
        """
        if not tried:
            return []
        shares = np.array([self.removed(*one) for one in tried])
        drawn = [self.errors(squares) ** 2 / self._beyond_noise for _, squares in tried]
        among = shares if fair is None or not any(fair) else np.where(fair, shares, -np.inf)
        best = int(np.argmax(among))
        spread = np.array([(one - drawn[best]).std() for one in drawn])
        nothing = (shares <= 0.0) & (shares[best] > 0.0)
        return [bool(late) for late in nothing | (shares[best] - shares > WITHIN * spread)]

    def explains(self, tried: Sequence[Tried]) -> int | None:
        """Return the number of the first effect that is not `behind`, if one removes almost all of the error.

        None where none removes ALMOST_ALL of it: then several effects together may be right.
        """
        given = self.error(self.given) ** 2
        if not any(
            given - self.error(squares) ** 2 >= ALMOST_ALL * self._beyond_noise for _, squares in tried
        ):
            return None
        return self.behind(tried).index(False)

    @cached_property
    def noise(self) -> Array | None:
        """Mean squared errors due to noise alone, (6,) [m^2/s^2, rad^2/s^2].

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

    @property
    def floor(self) -> float | None:
        """Error due to noise alone over all axes [m/s]; None if it is not known."""
        return None if self.noise is None else float(np.sqrt(self.noise @ self.weight))

    @property
    def _beyond_noise(self) -> float:
        """Squared error of the file beyond the noise [m^2/s^2], greater than 0."""
        return max(self.error(self.given) ** 2 - (self.floor or 0.0) ** 2, 1e-12)
