"""What a hull may do beside its file, allowed for while changes are held against one recording.

No file describes a hull exactly, and without a recording from before a change nothing shows what the hull
itself does.  But that much is known of it: it is a force of the motion through the water, as the library has
it (`residual.library`) without what stands for weight and trim, of a size that the recording tells.  So the
library's coefficients are unknowns of zero mean with one factor to their prior deviations, and are integrated
out beside each change, as are the beginnings of the shots.  What remains is the evidence for the change
(MacKay, Bayesian interpolation, Neural Computation 4, 415-447, 1992): a change of weight, current, thrust or
sensor has marks that no force of the motion has, and keeps its evidence; one that only bends to the hull's
error finds it taken up already.

Residuals of a wrong model are no noise.  They last for as long as a shot does, so that one counts for as many
independent numbers as a steady wrench has, of a size that the evidence finds, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array
from hydro.core.identification.levenberg_marquardt import Prior, moved
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.multiple_shooting import (
    ENDLESS,
    corrected_first,
    prepare,
    residuals,
)
from hydro.core.prediction.normal_equations import eliminate
from hydro.core.prediction.parameters import Free
from hydro.core.recording.shots import CHANNELS, Shots
from hydro.core.residual.library import RESTING, Flow, sizes, terms
from hydro.core.residual.regression import answers, robust, thinning
from hydro.core.residual.response import Transitions
from hydro.core.threads import shared
from hydro.core.vehicle.description import Vehicle

NUMBERS = 6
"""Independent numbers that a shot counts for."""
FACTORS = 10.0 ** np.arange(-3.5, -0.9, 0.5)
"""Times the hull's size that coefficients may be (`residual.library.sizes`)."""
TEMPERS = np.exp(np.arange(-1.0, 15.0, 0.25))
"""Mean squared residuals, in units of the noise."""
STEPS, WORTH, SHORTER = 6, 0.5, 0.3
"""Gauss-Newton steps at most, evidence that one must bring, and part of the way that is tried besides."""
LEAST = 1e-300


@dataclass(frozen=True)
class Held:
    """How an effect's values stand beside what the hull may do.

    Attributes:
        values: Of its entries, and of all that is fitted with it, about which it is worked out, (P,).
        evidence: Logarithm of the evidence; minus infinity where a prediction diverges.
        best: The most probable values, (P,),
        covariance: and how far they may be off, (P, P).
        left: Mean squared residual beside them and the library, in units of the noise.
    """

    values: Array
    evidence: float
    best: Array
    covariance: Array
    left: float


@dataclass(frozen=True)
class Allowance:
    """The library along a recording, its answers turned so that their normal equations are diagonal.

    Attributes:
        shots: The recording.
        weight: Of each shot: a few violent ones are not all that counts, (S,).
        beginnings: Answers to the first row of each shot, in units of the noise, (S, R, 12).
        across: What the library takes of residuals, beginnings taken out, (S, R, Q).
        sizes: Eigenvalues of the library's normal equations, (Q,).
        compared: Numbers of a shot that are compared, on average.
    """

    shots: Shots
    weight: Array
    beginnings: Array
    across: Array
    sizes: Array
    compared: float

    @classmethod
    def of(cls, vehicle: Vehicle, shots: Shots) -> Allowance:
        """Work it out along the motion that was measured.

        Args:
            vehicle: The file.
            shots: Of the recording; where samples are rarer than rows, those alone count.
        """
        transitions = Transitions.of(candidate(vehicle), shots)
        library = terms(Flow.of(transitions.model, shots))[:, :-RESTING]
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
        """The library with the beginnings taken out, turned to the axes of its normal equations."""
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
        """Values beside what the hull may do.

        Args:
            unknown: What is fitted.
            values: Of it, (P,).
            prior: What is known of it, in scales of the entries.
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
        """Evidence, the greatest over factors and tempers; there the best step, its covariance, what is left.

        Args:
            own: Normal equations of the effect's columns and the residual, beginnings taken out.
            across: What these take of the library.
            away: How far the values are from where the prior has them, in scales, (P,).
            prior: What is known of them.
        """
        scale = NUMBERS / (self.compared * TEMPERS)  # information of a squared residual, (T,)
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
        numbers = NUMBERS * float(self.weight.sum())
        evidence = -0.5 * (numbers * np.log(TEMPERS) + misfit + width)
        at = np.unravel_index(int(np.argmax(evidence)), evidence.shape)
        spread = np.asarray(np.linalg.inv(matrix[at]))
        return float(evidence[at]), np.asarray(step[at]), spread, float(TEMPERS[at[1]])

    def refined(self, unknown: Free, held: Held, prior: Prior) -> Held:
        """The same about the most probable values, as long as the way to them brings evidence.

        It brings none where the effect is linear in its entries: then they are known already.
        """
        for _ in range(STEPS):
            tried = self.held(unknown, held.best, prior)
            if tried.evidence <= held.evidence + WORTH:  # perhaps too far for a linear guess
                tried = self.held(unknown, held.values + SHORTER * (held.best - held.values), prior)
            if tried.evidence <= held.evidence + WORTH:
                break
            held = tried
        return held


def _error(vehicle: Vehicle, shots: Shots) -> Array:
    """Residuals of the rows that are compared, in units of the noise, begun as they were seen, (S, R)."""
    model = candidate(vehicle)
    begun = corrected_first(shots, model)
    error = residuals(prepare(model, begun), begun, calmed=False)[:, :: thinning(shots)]
    return np.nan_to_num(error.reshape(len(error), -1), nan=np.inf)


def _known(shots: Shots) -> Array:
    """Information that the log itself gives on the beginning of each shot, (S, 12)."""
    return np.broadcast_to(shots.trust**-2, (len(shots.starts), CHANNELS))
