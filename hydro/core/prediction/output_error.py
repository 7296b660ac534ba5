"""Output-error problem over shots with free initial states.

Each prediction (a shot) starts from the smoothed measured state.  Its initial state is estimated together
with the parameters, so that noise in it causes no bias (Jategaonkar 2015, ch. 4; Bock 1983 for the shots).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

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

OTHERWISE_NOISY = 0.1  # relative difference of residual and noise above which weights are updated
LEAST_SIGMA = 1e-6
OFF, SHORTER = 1.5, (0.3, 0.1, 0.0)
"""Ratio of a cost to its expectation above which shorter steps are tried, and the lengths of these."""
WAVE_BANDS = 6
"""Number of frequency bands of a sea, with one harmonic each: over a shot each is little more than a slope.
"""
FARTHEST = 3.0  # largest step of an initial state, in standard deviations of the measured one


@dataclass(frozen=True)
class OutputError:
    """Output-error problem over shots with free initial states.

    Attributes:
        shots: The shots.
        near: A candidate prepared for them, whose rotor and memory states may be reused.
    """

    shots: Shots
    near: multiple_shooting.Prepared | None = None

    @classmethod
    def of(cls, shots: Shots, vehicle: Vehicle) -> OutputError:
        """Build the problem with the DVL errors and the waves of a vehicle."""
        return cls(in_waves(shots, candidate(vehicle))).at_measured_states(vehicle)

    def at_measured_states(self, vehicle: Vehicle) -> Self:
        """Return the problem with initial states corrected for the DVL errors of a vehicle."""
        shots = multiple_shooting.corrected_first(self.shots, candidate(vehicle))
        return replace(self, shots=shots, near=None)

    def some(self, most: int) -> Self:
        """Return the problem with at most `most` shots, spread evenly; unchanged if it has fewer."""
        kept = kept_evenly(len(self.shots.starts), most)
        return self if kept.all() else self.over(kept)

    def over(self, kept: NDArray[np.bool_]) -> Self:
        """Return the problem over the shots of a mask (S,)."""
        return replace(self, shots=self.shots.of(kept), near=None)

    def anchored(self) -> Self:
        """Return the problem with the logged initial states as samples, with the noise of its channels.

        They keep this weight if the channels get others.  So the initial states of a fit far from the noise
        cannot absorb errors of the model that are larger than the noise of the log.
        """
        return replace(self, shots=self.shots.anchored())

    def prepared(
        self, vehicle: Vehicle, like: multiple_shooting.Prepared | None = None
    ) -> multiple_shooting.Prepared:
        """Return a vehicle prepared for the shots, see `multiple_shooting.prepare`."""
        return multiple_shooting.prepare(candidate(vehicle), self.shots, like)

    def residuals(self, vehicle: Vehicle) -> Array:
        """Return the residuals of a vehicle in standard deviations of the noise, (S, length - lead, 12)."""
        return multiple_shooting.residuals(self.prepared(vehicle), self.shots)

    def linearise(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Normal:
        """Linearise the problem, see `sensitivity.linearise`."""
        prepared = self.prepared(base, self.near)

        def beside(other: Vehicle) -> multiple_shooting.Prepared:
            return self.prepared(other, prepared)

        return sensitivity.linearise(prepared, spread(beside, moved), steps, self.shots)

    def cost(self, vehicle: Vehicle, step: Array, normal: Normal) -> tuple[float, Self]:
        """Return the cost from initial states moved by the linearised problem.

        Shots with a cost far from its expectation try shorter moves of the initial state, at last none.
        """
        shift = normal.follow[..., -1] - normal.follow[..., :-1] @ step
        farthest = FARTHEST * self.shots.trust
        shift = np.clip(shift, -farthest, farthest)
        first = multiple_shooting.displaced(self.shots.first, shift)
        prepared, reached = self.prepared(vehicle, self.near), OFF * normal.expected(step)
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
        return float(costs.sum()), replace(self, shots=replace(self.shots, first=first), near=prepared)

    def reweighted(self, normal: Normal) -> tuple[Self, bool]:
        """Set the noise of each channel to its residual, so that unexplained channels count less."""
        sigma = np.maximum(self.shots.sigma * normal.rms, LEAST_SIGMA)
        if (np.abs(sigma / self.shots.sigma - 1.0) < OTHERWISE_NOISY).all():
            return self, False
        return self.weighed(sigma), True

    def weighed(self, sigma: Array) -> Self:
        """Return the problem with standard deviations `sigma` of the noise of the 12 channels, (12,)."""
        return replace(self, shots=replace(self.shots, sigma=sigma))


def in_waves(shots: Shots, model: Candidate) -> Shots:
    """Return the shots with the covariance that the waves of a model cause; unchanged without waves.

    Predictions assume a calm sea.  Over the seconds of a shot the sea is a few harmonics of unknown
    amplitudes with the variances of the file.  So the residual of a shot has the covariance 1 + X X^T in
    units of the sensors' noise.  X are its responses to one standard deviation of each amplitude in both
    directions (the unscented transform, Julier and Uhlmann 1997, which includes curvature).  Residuals and
    derivatives times (1 + X X^T)^(-1/2) are white again.  So a fit gives small weight to directions that
    waves disturb, and its standard errors are larger.  Correlation of the waves between shots is not used.
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
    """Return the initial values of output error: those of equation error, unless their motion diverges.

    If samples do not cover all of the motion, equation error uses filled channels.  Then the values with the
    best prediction are returned.
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
