"""Output error over short predictions whose beginnings go along with the parameters.

Each prediction (a shot) begins where the smoothed log saw the vehicle; its beginning is estimated with the
parameters, so that noise in it biases nothing (Jategaonkar 2015, ch. 4; Bock 1983 for the shots).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.damping import LINEAR_DAMPING
from hydro.core.effects.waves import COSINE, SINE
from hydro.core.errors import DataError
from hydro.core.prediction import multiple_shooting, sensitivity
from hydro.core.prediction.candidate import Candidate, candidate
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.parameters import Free
from hydro.core.recording.shots import Shots, kept_evenly
from hydro.core.threads import spread
from hydro.core.vehicle.description import Vehicle

OTHERWISE_NOISY = 0.1  # share by which a residual differs from its noise for weights to be made anew
LEAST_SIGMA = 1e-6
OFF, SHORTER = 1.5, (0.3, 0.1, 0.0)  # what is far from expected, and parts of the way that are tried then
WAVE_BANDS = 6
"""Of a sea's frequencies, with one harmonic each: over a shot they are hardly more than a slope each."""
FARTHEST = 3.0  # times what a beginning is known to at sight that one step may move it


@dataclass(frozen=True)
class OutputError:
    """Output error over shots, whose beginnings go along with the parameters.

    Attributes:
        shots: The shots.
        near: A candidate made ready for them: its rotors and memories are perhaps another one's, too.
    """

    shots: Shots
    near: multiple_shooting.Prepared | None = None

    @classmethod
    def of(cls, shots: Shots, vehicle: Vehicle) -> OutputError:
        """Begin the shots as this vehicle's velocity log says, and as the waves of its file let it be."""
        return cls(in_waves(shots, candidate(vehicle))).at_measured_states(vehicle)

    def at_measured_states(self, vehicle: Vehicle) -> OutputError:
        """The problem with its shots begun as this vehicle's velocity log says."""
        return OutputError(multiple_shooting.corrected_first(self.shots, candidate(vehicle)))

    def some(self, most: int) -> OutputError:
        """The problem with at most so many of its shots, spread evenly; itself where it has no more."""
        kept = kept_evenly(len(self.shots.starts), most)
        return self if kept.all() else OutputError(self.shots.of(kept))

    def linearise(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Normal:
        """See `sensitivity.linearise`."""
        prepared = multiple_shooting.prepare(candidate(base), self.shots, self.near)

        def beside(other: Vehicle) -> multiple_shooting.Prepared:
            return multiple_shooting.prepare(candidate(other), self.shots, prepared)

        return sensitivity.linearise(prepared, spread(beside, moved), steps, self.shots)

    def cost(self, vehicle: Vehicle, step: Array, normal: Normal) -> tuple[float, OutputError]:
        """Predict anew, from beginnings moved as the linearised problem would have them.

        Where a shot ends far from what that problem expects, less of the way is tried, and none.
        """
        shift = normal.follow[..., -1] - normal.follow[..., :-1] @ step
        farthest = FARTHEST * self.shots.trust
        shift = np.clip(shift, -farthest, farthest)
        first = multiple_shooting.displaced(self.shots.first, shift)
        prepared, reached = (
            multiple_shooting.prepare(candidate(vehicle), self.shots, self.near),
            OFF * normal.expected(step),
        )
        costs = multiple_shooting.costs(prepared, replace(self.shots, first=first))
        for part in SHORTER:
            poor = ~(costs <= np.maximum(reached, normal.freedom))
            if not poor.any():
                break
            less = multiple_shooting.displaced(self.shots.first[poor], part * shift[poor])
            tried = replace(self.shots.of(poor), first=less)
            again = multiple_shooting.costs(prepared.of(poor), tried)
            better = np.flatnonzero(poor)[again < costs[poor]]
            first[better], costs[better] = less[again < costs[poor]], again[again < costs[poor]]
        return float(costs.sum()), OutputError(replace(self.shots, first=first), prepared)

    def reweighted(self, normal: Normal) -> tuple[OutputError, bool]:
        """Noise of each channel as what is left in it: what the model does not explain weighs less."""
        sigma = np.maximum(self.shots.sigma * normal.rms, LEAST_SIGMA)
        if (np.abs(sigma / self.shots.sigma - 1.0) < OTHERWISE_NOISY).all():
            return self, False
        return self.weighed(sigma), True

    def weighed(self, sigma: Array) -> OutputError:
        """The problem with other deviations of its channels, (12,)."""
        return OutputError(replace(self.shots, sigma=sigma), self.near)


def in_waves(shots: Shots, model: Candidate) -> Shots:
    """The shots as the waves of a vehicle's file let them be known; themselves where it has none.

    In a prediction the sea is calm, in the recording it is not.  Over the seconds of a shot it is a few
    harmonics of unknown amplitude whose variances the file states, so that the residual of a shot has the
    covariance 1 + X X^T in units of the sensors' noise, X its answers to one standard deviation of each,
    either way (the unscented transform, Julier and Uhlmann 1997: that they bend counts too).  Residuals and
    derivatives times (1 + X X^T)^(-1/2) are white again: a fit weighs what the waves hide as little as they
    leave of it, and its standard errors say so.  What one shot tells of the waves in the next
    is not used.
    """
    if not model.seas:
        return shots
    prepared = multiple_shooting.prepare(model, shots)
    still = multiple_shooting.residuals(prepared, shots, calmed=False)
    answers = list[Array]()
    for harmonic in (row for sea in model.seas for row in sea(np.full(WAVE_BANDS, 0.5))):
        for amplitude, sign in itertools.product((COSINE, SINE), (1.0, -1.0)):
            alone = harmonic.copy()
            alone[[COSINE, SINE]] = 0.0
            alone[amplitude] = sign * harmonic[amplitude]
            moved = replace(prepared, model=model.in_sea(alone))
            answers.append((still - multiple_shooting.residuals(moved, shots, calmed=False)) * shots.sigma)
    return replace(shots, swell=np.stack(answers, axis=-1) / math.sqrt(2.0))


def aimed(unknown: Free, values: Array, shots: Shots) -> tuple[Array, OutputError]:
    """Where output error begins: as equation error says, unless its motion diverges.

    Where samples do not show all of the motion, equation error balances what was filled in: then it begins
    with the values that predict best.
    """
    tried = []
    for begin in (values, *unknown.starts):
        problem = OutputError.of(shots, unknown.at(begin))
        prepared = multiple_shooting.prepare(candidate(unknown.at(begin)), shots)
        cost = multiple_shooting.cost(prepared, problem.shots)
        if np.isfinite(cost):
            tried.append((cost, begin, problem))
            if shots.seen is None:
                break
    if tried:
        _, begin, problem = min(tried, key=lambda one: one[0])
        return begin, problem
    raise DataError(
        "the vehicle's predicted motion diverges within a shot; check its damping, or fit "
        f"{LINEAR_DAMPING.name} too"
    )
