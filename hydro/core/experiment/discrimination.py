"""Predicted information of a manoeuvre: separation of rival models, and expected standard errors.

A rival is a vehicle model with fitted values and their information matrix from the recording.  The difference
of two predictions overstates how well a manoeuvre separates them: the values of one rival can change, within
the information of the recording, to imitate the other.  The separation is the difference that remains after
this imitation (T-optimality: A. C. Atkinson and V. V. Fedorov, The design of experiments for discriminating
between two rival models, Biometrika 62, 57-70, 1975).  To first order it is a least-squares problem in the
values of one rival, with the information of the recording as prior.  The data are shots of two seconds with
free initial values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hydro.core.columns import Array
from hydro.core.identification.levenberg_marquardt import PRIOR, moved
from hydro.core.identification.suspects import choice, is_curved, suspects
from hydro.core.prediction import multiple_shooting, sensitivity
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.parameters import Free, free
from hydro.core.recording.shots import Shots
from hydro.core.vehicle.description import Vehicle

Parted = Mapping[tuple[str, str], float]
"""Squared separation of rival models in units of the noise variance, by pair of names."""


SHOWN = 0.05
"""Standard error of a component, relative to its scale, at which the component has half its full weight."""
LOG_WEIGHT = 1e-3
"""Weight of the log standard error in `worth`: it only ranks manoeuvres that show equally many components."""


@dataclass(frozen=True)
class Rival:
    """Vehicle model that explains a recording about as well as other models do.

    Attributes:
        name: Effect that distinguishes this model from the other models.
        unknown: The P free components: the numbers of the vehicle file that the fit changed.
        values: Fitted values of the components, (P,).
        information: Information matrix of the values from the recording and the prior, in units of the
            components' scales, (P, P).
    """

    name: str
    unknown: Free
    values: Array
    information: Array

    @classmethod
    def of(cls, name: str, unknown: Free, values: Array, normal: Normal) -> Rival:
        """Return the rival model made from a fit.

        The fit's information matrix is divided by its mean squared residual if that exceeds 1.

        Args:
            name: Effect that distinguishes the model.
            unknown: P free components of the fit.
            values: Fitted values of the components, (P,).
            normal: Least-squares problem, linearised at `values`.
        """
        known = normal.matrix.sum(axis=0) / max(normal.chi2, 1.0)
        return cls(name, unknown, values, known + PRIOR**-2 * np.eye(len(values)))

    @property
    def vehicle(self) -> Vehicle:
        """Vehicle with the fitted values."""
        return self.unknown.at(self.values)


@dataclass(frozen=True)
class Expected:
    """Standard errors of one component of an effect before and after a planned flight.

    Attributes:
        name: Name of the component.
        unit: Unit of the component and of both errors.
        before: Standard error from the recording; infinite if the recording does not determine the component.
        after: Standard error from the recording and the flight together.
    """

    name: str
    unit: str
    before: float
    after: float


def gram(rival: Rival, shots: Shots, more: Sequence[tuple[Vehicle, float]] = ()) -> Array:
    """Return the Gram matrix of a model's sensitivities and its residual over a predicted flight.

    A sensitivity is the derivative of the predictions by one component.  Rows and columns are the P free
    components of the model in units of their scales, K further components from `more`, and last the residual.
    Sensitivities and residual are divided by the sensor noise.

    Args:
        rival: Model whose predictions are compared with the shots.
        shots: Two-second shots of a flight that another model predicts.
        more: K vehicles, each with one small additional value, and the size of that value.

    Returns:
        Sum over all shots, (P + K + 1, P + K + 1); not finite if a prediction diverges.
    """
    base = multiple_shooting.prepare(candidate(rival.vehicle), shots)
    vehicles, steps = moved(rival.unknown, rival.values)
    vehicles += [vehicle for vehicle, _ in more]
    others = [multiple_shooting.prepare(candidate(vehicle), shots, base) for vehicle in vehicles]
    steps += [step for _, step in more]
    total: Array = sensitivity.linearise(base, others, steps, shots, threads=1).gram.sum(axis=0)
    return total


def distance(total: Array, information: Array) -> float:
    """Return the squared difference of two models after one has changed its values to imitate the other.

    Args:
        total: Gram matrix of the imitating model, with P components, in a flight of the other, from `gram`,
            (P + 1, P + 1).
        information: Information matrix of the imitating model's values from the recording, (P, P).

    Returns:
        Sum of squares over all samples, in units of the noise variance.
    """
    score = total[:-1, -1]
    imitated = float(score @ np.linalg.solve(total[:-1, :-1] + information, score))
    return max(float(total[-1, -1]) - imitated, 0.0)


def parted(rivals: Sequence[Rival], grams: Mapping[tuple[int, int], Array]) -> dict[tuple[str, str], float]:
    """Return the squared separation of each pair of models in a flight.

    The separation is the difference of the predictions after one model has changed its values to imitate the
    other.  Either model of a pair may imitate; the smaller difference counts.

    Args:
        rivals: Rival models.
        grams: Gram matrix of model j in the flight that model i predicts, by (i, j), from `gram`.

    Returns:
        Squared separation by pair of names, in units of the noise variance.
    """
    return {
        (rivals[i].name, rivals[j].name): min(
            distance(grams[i, j], rivals[j].information), distance(grams[j, i], rivals[i].information)
        )
        for i, j in combinations(range(len(rivals)), 2)
    }


def utility(distances: Parted) -> float:
    """Return the utility of a flight: the sum of log(1 + squared separation) over all pairs of models.

    Args:
        distances: Squared separation by pair of names, in units of the noise variance, from `parted`.
    """
    return float(sum(np.log1p(square) for square in distances.values()))


def expected(rival: Rival, total: Array) -> list[Expected]:
    """Return the standard errors that a model's distinguishing effect has before and after a flight.

    Args:
        rival: The model, with P free components.
        total: Gram matrix of the model in the flight, from `gram`, (P + 1, P + 1).

    Returns:
        One entry for each component of the effect `rival.name`.
    """
    before = np.linalg.inv(rival.information)
    after = np.linalg.inv(rival.information + total[:-1, :-1])
    found = []
    for i, entry in enumerate(rival.unknown.entries):
        if entry.effect == rival.name:
            errors = [float(np.sqrt(max(spread[i, i], 0.0))) * entry.scale for spread in (before, after)]
            found.append(Expected(entry.name, entry.unit, *errors))
    return found


@dataclass(frozen=True)
class Unseen:
    """Effect that a recording does not show, prepared for a linear prediction of its standard errors.

    Attributes:
        name: Name of the effect.
        columns: For each component, the vehicle with a small value of it, and the size of that value in units
            of the component's scale.
        labels: Name, unit and scale (the size of a significant value) of each component.
    """

    name: str
    columns: tuple[tuple[Vehicle, float], ...]
    labels: tuple[tuple[str, str, float], ...]


def unseen(vehicle: Vehicle, effects: Sequence[str], reach: Array | None = None) -> list[Unseen]:
    """Return effects that a recording does not show, prepared for a prediction of their standard errors.

    An effect that is nonlinear in its parameters is represented by the first of its coarse shapes.

    Args:
        vehicle: The vehicle.
        effects: Names in the catalogue.
        reach: Positions and times of the N rows of the recording, (N, 4) [m, s], candidates for the place of
            a tether's anchor.

    Returns:
        One object for each effect, with a small value of each component, as `gram` needs it in `more`.
    """
    found: dict[str, Unseen] = {}
    for one in suspects(vehicle, reach=reach, completing=True) if effects else ():
        if one.effect not in effects or one.effect in found:
            continue
        if is_curved(one.effect):
            labels = [(f"{one.effect} (in plain sizes)", "1", 1.0)] * len(one.steps)
        else:
            entries = free(vehicle, [choice(vehicle, one.effect)]).entries
            labels = [(entry.name, entry.unit, entry.scale) for entry in entries]
        found[one.effect] = Unseen(one.effect, tuple(zip(one.changed, one.steps, strict=True)), tuple(labels))
    return list(found.values())


def shown(rival: Rival, asked: Sequence[Unseen], total: Array) -> dict[str, list[Expected]]:
    """Return the standard errors that effects have after a flight, each effect added to a model alone.

    Args:
        rival: Model without these effects, with P free components.
        asked: Effects that the recording does not show, with K components in the order of the columns of
            `total`.
        total: Gram matrix of the model in the flight, with the effects as `more`, (P + K + 1, P + K + 1).

    Returns:
        Expected standard errors of the components, by name of the effect.
    """
    own, place = len(rival.values), len(rival.values)
    found: dict[str, list[Expected]] = {}
    for one in asked:
        both = [*range(own), *range(place, place + len(one.columns))]
        place += len(one.columns)
        matrix = total[np.ix_(both, both)] + PRIOR**-2 * np.eye(len(both))
        matrix[:own, :own] += rival.information
        errors = np.sqrt(np.maximum(np.diag(np.linalg.inv(matrix))[own:], 0.0))
        found[one.name] = [
            Expected(name, unit, np.inf, float(error) * scale)
            for (name, unit, scale), error in zip(one.labels, errors, strict=True)
        ]
    return found


def worth(asked: Sequence[Unseen], errors: Mapping[str, Sequence[Expected]]) -> float:
    """Return the utility of a flight for effects that the recording does not show.

    The utility is the sum over the effects of the mean weight of their components.  The weight of a component
    is 1 for an exact value and 1/2 if its standard error is SHOWN times its scale.  A small term in the log
    of the standard errors (D-optimality) ranks flights that show equally many components.

    Args:
        asked: The effects.
        errors: Expected standard errors by effect, from `shown`.
    """
    whole = 0.0
    for effect in asked:
        pairs = zip(effect.labels, errors[effect.name], strict=True)
        size = np.array([max(one.after / scale, 1e-12) for (_, _, scale), one in pairs])
        whole += float(np.mean(1.0 / (1.0 + (size / SHOWN) ** 2) - LOG_WEIGHT * np.log(size)))
    return whole
