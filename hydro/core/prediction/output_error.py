"""Output-error problem over shots with free initial states.

Each shot, a prediction of a few seconds, starts from the smoothed measured state.  Its initial state is
estimated together with the parameters, so that noise in the measured state causes no bias (Jategaonkar 2015,
ch. 4; Bock 1983 for the shots).
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
LEAST_SIGMA = 1e-6  # lower bound of the noise of a channel [m, rad, m/s, rad/s]
OFF, SHORTER = 1.5, (0.3, 0.1, 0.0)
"""Ratio of a cost to its expectation above which shorter steps are tried, and their lengths."""
WAVE_BANDS = 6
"""Number of frequency bands of a sea, with one harmonic each.

Few suffice, since over a shot each harmonic is little more than a slope.
"""
TESTED_SHOTS = 16
"""Number of shots on which longer integration steps are tested: enough for a root mean square within 20 %."""
INTEGRATION_ERROR = 0.01
"""Maximum error of the integration, as a share of the residual: it changes a squared residual by 1e-4."""
FARTHEST = 3.0  # largest step of an initial state, in standard deviations of the measured one


@dataclass(frozen=True)
class OutputError:
    """Output-error problem over shots (short predictions) with free initial states.

    Attributes:
        shots: The shots.
        near: Compiled vehicle similar to the fitted one, already prepared for the shots; its rotor and
            internal states are reused where possible.
    """

    shots: Shots
    near: multiple_shooting.Prepared | None = None

    @classmethod
    def of(cls, shots: Shots, vehicle: Vehicle) -> OutputError:
        """Return the output-error problem of shots for a vehicle.

        Args:
            shots: The shots.
            vehicle: Vehicle for whose DVL errors the initial states are corrected, and for whose waves
                residuals are whitened.
        """
        return cls(in_waves(shots, candidate(vehicle))).at_measured_states(vehicle)

    def at_measured_states(self, vehicle: Vehicle) -> Self:
        """Return a copy of the problem in which shots start at the logged motion.

        Args:
            vehicle: Vehicle for whose DVL errors the logged motion is corrected.
        """
        shots = multiple_shooting.corrected_first(self.shots, candidate(vehicle))
        return replace(self, shots=shots, near=None)

    def some(self, most: int) -> Self:
        """Return a problem with at most `most` shots, spread evenly; the problem itself if it has no more."""
        kept = kept_evenly(len(self.shots.starts), most)
        return self if kept.all() else self.over(kept)

    def over(self, kept: NDArray[np.bool_]) -> Self:
        """Return a copy of the problem with a part of its shots.

        Args:
            kept: Mask of the shots that remain, (S,).
        """
        return replace(self, shots=self.shots.of(kept), near=None)

    def first_part(self, seconds: float) -> Self:
        """Return a copy of the problem with shots cut after a compared time [s]."""
        return replace(self, shots=self.shots.first_part(seconds), near=None)

    def anchored(self) -> Self:
        """Return a copy of the problem in which logged initial states count as samples and are not free.

        The weight of these samples follows from the noise of the channels, and stays the same if the channels
        are reweighted.  So the initial states of a fit far from the noise cannot absorb errors of the model
        that are larger than the noise of the log.
        """
        return replace(self, shots=self.shots.anchored())

    def prepared(
        self, vehicle: Vehicle, like: multiple_shooting.Prepared | None = None
    ) -> multiple_shooting.Prepared:
        """Return a compiled vehicle with its initial rotor and internal states in every shot.

        Args:
            vehicle: The vehicle.
            like: Another vehicle prepared for the same shots; its states are reused where they are the same.
        """
        return multiple_shooting.prepare(candidate(vehicle), self.shots, like)

    def residuals(self, vehicle: Vehicle) -> Array:
        """Return measured minus predicted values in S shots, in units of the noise, (S, length - lead, 12).

        The unit is the standard deviation of the noise of each channel: position, attitude, velocity, rates.
        The first `lead` rows of a shot are not compared.
        """
        return multiple_shooting.residuals(self.prepared(vehicle), self.shots)

    def coarsened(self, vehicle: Vehicle) -> Self:
        """Return a copy of the problem with the fewest integration steps that a vehicle needs.

        By default, steps are short enough for residuals of the size of the noise.  Where residuals are far
        larger, longer steps change no decision and save most of the time.  In each channel, longer steps
        change the predictions of the vehicle by at most INTEGRATION_ERROR of its residual.  If no fewer steps
        suffice, the result is the problem itself.
        """
        tested = self.some(TESTED_SHOTS)
        prepared = tested.prepared(vehicle)

        def predicted(steps: int) -> Array:
            shots = replace(tested.shots, steps=steps)
            return multiple_shooting.residuals(prepared, shots, calmed=False)

        most = multiple_shooting.most_steps(tested.shots)
        fine = predicted(most)
        with np.errstate(over="ignore", invalid="ignore"):
            allowed = INTEGRATION_ERROR**2 * (fine**2).mean(axis=(0, 1))
            for steps in range(1, most):
                if (((predicted(steps) - fine) ** 2).mean(axis=(0, 1)) <= allowed).all():
                    return replace(self, shots=replace(self.shots, steps=steps))
        return self

    def linearise(self, base: Vehicle, moved: Sequence[Vehicle], steps: Sequence[float]) -> Normal:
        """Return the least-squares problem, linearised about a vehicle, in P parameters of the vehicle alone.

        The initial states of the shots are eliminated shot by shot.

        Args:
            base: The vehicle.
            moved: P copies of the vehicle with one changed parameter each.
            steps: Size of each change, in the unit of the problem's parameters.
        """
        prepared = self.prepared(base, self.near)

        def beside(other: Vehicle) -> multiple_shooting.Prepared:
            return self.prepared(other, prepared)

        return sensitivity.linearise(prepared, spread(beside, moved), steps, self.shots)

    def cost(self, vehicle: Vehicle, step: Array, normal: Normal) -> tuple[float, Self]:
        """Return a vehicle's sum of squared residuals after a step, and a copy of the problem.

        Initial states move as the linearised problem predicts.  Where the cost of a shot is far from the
        expected one, shorter moves of its initial state are tried, at last none.

        Args:
            vehicle: Vehicle after the step.
            step: Change of the P parameters, (P,).
            normal: Problem linearised before the step.

        Returns:
            Sum of squared residuals, in units of the noise variance; and a copy of this problem with the new
            initial states.
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
        """Return the problem with each channel's noise set to its residual, and whether the noise changed.

        Channels that no model explains then count less.

        Args:
            normal: Problem linearised at the present estimate.

        Returns:
            A copy and True; the problem itself and False if the noise of all channels nearly fits the
            residuals.
        """
        sigma = np.maximum(self.shots.sigma * normal.rms, LEAST_SIGMA)
        if (np.abs(sigma / self.shots.sigma - 1.0) < OTHERWISE_NOISY).all():
            return self, False
        return self.weighed(sigma), True

    def weighed(self, sigma: Array) -> Self:
        """Return a copy of the problem with the given noise of the channels.

        Args:
            sigma: Standard deviation of position, attitude, velocity and rates, (12,) [m, rad, m/s, rad/s].
        """
        return replace(self, shots=replace(self.shots, sigma=sigma))


def in_waves(shots: Shots, model: Candidate) -> Shots:
    """Return a copy of the shots with the covariance that the waves of a model cause (`swell`).

    Without waves the shots are returned unchanged.  Predictions assume a calm sea.  Over the seconds of a
    shot the sea is a few harmonics of unknown amplitudes with the variances of the file.  So the residual of
    a shot has the covariance 1 + X X^T in units of the sensors' noise.  X are the responses of the shot to
    one standard deviation of each amplitude in both directions (the unscented transform, Julier and Uhlmann
    1997, which includes curvature). Residuals and derivatives times (1 + X X^T)^(-1/2) are white again.  So a
    fit gives small weight to directions that waves disturb, and its standard errors are larger.  Correlation
    of the waves between shots is not used.

    Args:
        shots: The shots.
        model: Compiled vehicle with its waves.
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
    """Return initial values for an output-error fit of free components, and the problem at these values.

    The values of an equation-error fit are used.  If the motion diverges with them, the first of the
    components' own initial values without divergence is used.  Where samples do not cover the whole motion,
    the equation-error fit rests on channels that a model has filled in; then all these values are tried, and
    those with the smallest prediction error are used.

    Args:
        unknown: P free components (numbers of parameters to fit) of a vehicle, with their own initial values.
        values: Result of the equation-error fit, (P,).
        shots: Shots of the recording.

    Returns:
        Initial values, (P,), and the output-error problem whose initial states fit these values.

    Raises:
        DataError: The motion diverges with all initial values.
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
