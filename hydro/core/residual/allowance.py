"""Bayesian allowance for unmodelled hull force while candidate changes are tested against one recording.

No vehicle file describes a hull exactly.  Without a recording from before a change, the model error of the
hull is unknown.  It is modelled as a force of the motion through the water: the terms of `residual.library`
without those for weight and trim.  The coefficients of the library have zero mean and the prior deviations of
the hull's size times one common factor.  They are integrated out together with the initial states of the
shots, and the evidence selects the factor.

The remaining evidence belongs to the change (MacKay, Bayesian interpolation, Neural Computation 4, 415-447,
1992).  A change of weight, current, thrust or sensor has features that no force of the motion has, and keeps
its evidence.  The library explains a change that only imitates the hull's model error.

Residuals of a wrong model are not white noise: they persist for the length of a shot, a prediction of two
seconds.  So each shot counts as six independent values, the components of a steady wrench.  The evidence also
selects the variance of these values, as a factor on that of the noise (the temper).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array
from hydro.core.identification.levenberg_marquardt import Prior, moved
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import ENDLESS, corrected_first, prepare, residuals
from hydro.core.prediction.normal_equations import eliminate
from hydro.core.prediction.output_error import SHORTER
from hydro.core.prediction.parameters import Free
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.residual.library import AXES, RESTING, Flow, sizes
from hydro.core.residual.regression import answers, robust, terms_of, thinning
from hydro.core.residual.response import Transitions
from hydro.core.threads import shared
from hydro.core.vehicle.description import Vehicle

FACTORS = 10.0 ** np.arange(-3.5, -0.9, 0.5)
"""Candidate factors on the prior deviations of the coefficients (`residual.library.sizes`)."""
TEMPERS = np.exp(np.arange(-1.0, 15.0, 0.25))
"""Candidate reduced chi-squares of the model with effect and library."""
LEAST = 1e-300  # lower bound of a divisor


@dataclass(frozen=True)
class Held:
    """Fit of an effect with the unmodelled hull force integrated out.

    P is the number of fitted components, of the effect and of the file.

    Attributes:
        values: Values of the components at the linearisation point, (P,).
        evidence: Logarithm of the evidence; minus infinity where a prediction diverges.
        best: Most probable values, (P,).
        covariance: Posterior covariance of the values, (P, P).
        left: Reduced chi-square with the effect and the library, as selected by the evidence.
    """

    values: Array
    evidence: float
    best: Array
    covariance: Array
    left: float


@dataclass(frozen=True)
class Allowance:
    """Allowance for unmodelled hull forces in fits: responses of short predictions to the hull-force library.

    The library's coefficients are rotated so that their normal equations are diagonal.  S is the number of
    shots, R that of compared residuals per shot, Q that of coefficients.

    Attributes:
        shots: Short predictions of the recording.
        weight: Robust weight of each shot, so that a few violent shots do not dominate, (S,).
        beginnings: Responses to the initial state of each shot, in units of the noise, (S, R, 12).
        across: Responses to the library with the initial states eliminated, (S, R, Q).
        sizes: Eigenvalues of the library's normal equations, (Q,).
        compared: Average number of compared residuals per shot.
    """

    shots: Shots
    weight: Array
    beginnings: Array
    across: Array
    sizes: Array
    compared: float

    @classmethod
    def of(cls, vehicle: Vehicle, shots: Shots) -> Allowance:
        """Return the allowance for shots, with their responses to the hull-force library.

        Responses are those along the measured motion.

        Args:
            vehicle: The vehicle file.
            shots: Short predictions of the recording; where sensors are slower than rows, only rows with a
                sample count.
        """
        transitions = Transitions.of(candidate(vehicle), shots)
        library = terms_of(Flow.of(transitions.model, shots), shots)[..., :-RESTING]
        prior = sizes(vehicle)[:-RESTING].ravel()
        made = (columns.astype(np.float32) for _, columns in answers(transitions, library, prior))
        both = np.concatenate(list(made)).reshape(len(shots.starts), -1, CHANNELS + prior.size)
        error = _error(vehicle, shots)
        tame = (np.abs(both) < ENDLESS).all(axis=(1, 2)) & (np.abs(error) < ENDLESS).all(axis=1)
        weight = np.zeros(len(error))
        weight[tame] = robust(np.einsum("sr,sr->s", error[tame], error[tame]))
        both[~tame] = 0.0
        return cls._turned(shots, weight, both[..., :CHANNELS], both[..., CHANNELS:])

    @classmethod
    def _turned(cls, shots: Shots, weight: Array, beginnings: Array, library: Array) -> Allowance:
        """Eliminate the initial states and rotate the library to the eigenvectors of its normal equations.

        Args:
            shots: Short predictions of the recording.
            weight: Robust weight of each shot, (S,).
            beginnings: Responses to the initial states, (S, R, 12).
            library: Responses to the coefficients in units of their priors, (S, R, Q).
        """
        gram, across, known = np.zeros((library.shape[2], library.shape[2])), library.copy(), _known(shots)
        seen = shots.weights(slice(None))
        compared = library.shape[1] if seen is None else float(seen[:, :: thinning(shots)].sum() / len(seen))
        for s in range(len(library)):
            both = np.hstack([beginnings[s], library[s]]).astype(float)
            (left,), (follow,) = eliminate((both.T @ both)[None], CHANNELS, known[s : s + 1])
            across[s] -= both[:, :CHANNELS] @ follow
            gram += weight[s] * left
        found, axes = np.linalg.eigh(gram)
        turned = across @ axes.astype(np.float32)
        return cls(shots, weight, beginnings, turned, np.maximum(found, 0.0), compared)

    def held(self, unknown: Free, values: Array, prior: Prior) -> Held:
        """Return the fit of an effect by one linear step, with the hull force integrated out.

        Args:
            unknown: The P fitted components.
            values: Values of the components from which the step starts, (P,).
            prior: Prior of the values, in scales of the components.
        """
        vehicle, count = unknown.at(values), len(values)
        error = _error(vehicle, self.shots)
        counted = self.weight > 0.0
        if not (np.abs(error[counted]) < ENDLESS).all():
            return Held(values, -np.inf, values, np.diag(unknown.scales**2 / prior.information), np.inf)
        columns = np.empty((*error.shape, count + 1))
        columns[..., -1] = error
        changed, steps = moved(unknown, values)
        others = shared(lambda other: _error(other, self.shots), changed)
        for i, (other, step) in enumerate(zip(others, steps, strict=True)):
            columns[..., i] = (error - other) / step
        columns[~counted] = 0.0
        columns[~(np.abs(columns) < ENDLESS).all(axis=(1, 2)), :, :-1] = 0.0
        both = np.concatenate([self.beginnings, columns], axis=-1)[counted]
        begun, _ = eliminate(both.transpose(0, 2, 1) @ both, CHANNELS, _known(self.shots)[counted])
        own, across = np.tensordot(self.weight[counted], begun, 1), np.zeros((len(self.sizes), count + 1))
        for s in np.flatnonzero(counted):
            across += self.weight[s] * (self.across[s].T @ columns[s].astype(np.float32))
        scales = unknown.scales
        away = values / scales - prior.centre
        evidence, stride, spread, left = self._integrated(own, across, away, prior)
        most = unknown.within(values + stride * scales)
        return Held(values, evidence, most, spread * np.outer(scales, scales), left)

    def _integrated(
        self, own: Array, across: Array, away: Array, prior: Prior
    ) -> tuple[float, Array, Array, float]:
        """Maximise the evidence over the factors FACTORS and the reduced chi-squares TEMPERS.

        Args:
            own: Normal equations of the effect's columns and the residual, initial states eliminated.
            across: Products of these columns with the library, (Q, P + 1).
            away: Distance of the values from the prior mean, in scales, (P,).
            prior: Prior of the values.

        Returns:
            The log evidence, the best step of the values (P,) and its covariance (P, P), both in scales, and
            the reduced chi-square.
        """
        scale = AXES / (self.compared * TEMPERS)  # information of a squared residual, (T,)
        size = np.multiply.outer(FACTORS**2, self.sizes)[:, None] * scale[:, None]  # (F, T, Q)
        shape = (*size.shape[:2], *own.shape)
        pairs = (across[:, :, None] * across[:, None, :]).reshape(len(across), -1)
        part = size / (1.0 + size) / self.sizes.clip(LEAST)
        taken = (part.reshape(-1, len(pairs)) @ pairs).reshape(shape)
        left = scale[:, None, None] * (own - taken)
        matrix = left[..., :-1, :-1] + np.diag(prior.information)
        pull = left[..., :-1, -1] - prior.information * away
        step = np.linalg.solve(matrix, pull[..., None])[..., 0]
        misfit = left[..., -1, -1] + prior.information @ away**2 - (pull * step).sum(axis=-1)
        width = np.log1p(size).sum(axis=-1) + np.linalg.slogdet(matrix)[1]
        width -= np.log(prior.information).sum()
        numbers = AXES * float(self.weight.sum())
        evidence = -0.5 * (numbers * np.log(TEMPERS) + misfit + width)
        at = np.unravel_index(int(np.argmax(evidence)), evidence.shape)
        spread = np.asarray(np.linalg.inv(matrix[at]))
        return float(evidence[at]), np.asarray(step[at]), spread, float(TEMPERS[at[1]])

    def refined(self, unknown: Free, held: Held, prior: Prior, most: int, gain: float) -> Held:
        """Return a fit linearised again at its most probable values, as long as the evidence grows.

        Effects that are linear in their components need no step.  A step that gains too little is shortened
        once.

        Args:
            unknown: The fitted components.
            held: Fit to start from.
            prior: Prior of the values, in scales of the components.
            most: Maximum number of steps.
            gain: Minimum gain of log evidence by one step.
        """
        for _ in range(most):
            tried = self.held(unknown, held.best, prior)
            if tried.evidence <= held.evidence + gain:  # the step may exceed the linear range
                tried = self.held(unknown, held.values + SHORTER[0] * (held.best - held.values), prior)
            if tried.evidence <= held.evidence + gain:
                break
            held = tried
        return held


def _error(vehicle: Vehicle, shots: Shots) -> Array:
    """Return residuals of the compared rows in units of the noise, from measured initial states, (S, R)."""
    model = candidate(vehicle)
    begun = corrected_first(shots, model)
    error = residuals(prepare(model, begun), begun, calmed=False)[:, :: thinning(shots)]
    return np.nan_to_num(error.reshape(len(error), -1), nan=np.inf)


def _known(shots: Shots) -> Array:
    """Return the information of the log on the initial state of each shot, (S, 12)."""
    return np.broadcast_to(shots.trust**-2, (len(shots.starts), CHANNELS))
