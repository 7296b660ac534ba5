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
"""Squared separation of rivals by pairs of names, in units of the noise variance."""


SHOWN = 0.05
"""Standard error, relative to the scale of a component, at which the component counts half."""
LOG_WEIGHT = 1e-3
"""Weight of the log standard error, which ranks manoeuvres that show equally many components."""


@dataclass(frozen=True)
class Rival:
    """Vehicle model that explains a recording.

    Attributes:
        name: Effect that distinguishes the model.
        unknown: Its free components.
        values: Fitted values, (P,).
        information: Information matrix of the values from the recording, in units of their scales, (P, P).
    """

    name: str
    unknown: Free
    values: Array
    information: Array

    @classmethod
    def of(cls, name: str, unknown: Free, values: Array, normal: Normal) -> Rival:
        """Return the rival of a fit; its information is divided by the fit's mean squared residual."""
        known = normal.matrix.sum(axis=0) / max(normal.chi2, 1.0)
        return cls(name, unknown, values, known + PRIOR**-2 * np.eye(len(values)))

    @property
    def vehicle(self) -> Vehicle:
        """Vehicle with the fitted values."""
        return self.unknown.at(self.values)


@dataclass(frozen=True)
class Expected:
    """Standard errors of a component before and after a flight.

    Attributes:
        name: Name of the component.
        unit: Its unit.
        before: Standard error from the recording; infinite if the recording does not determine the component.
        after: Standard error from the recording and the flight.
    """

    name: str
    unit: str
    before: float
    after: float


def gram(rival: Rival, shots: Shots, more: Sequence[tuple[Vehicle, float]] = ()) -> Array:
    """Return the Gram matrix of a rival's sensitivities, of further columns and of its residual.

    Args:
        rival: Model that predicts the shots.
        shots: Shots of a predicted flight.
        more: Vehicles with small values of other effects, and the size of these values.

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
    """Return the squared residual after a rival has imitated another as well as it can.

    Args:
        total: Result of `gram`, (P + 1, P + 1).
        information: Prior information matrix of the rival's values, (P, P).
    """
    score = total[:-1, -1]
    imitated = float(score @ np.linalg.solve(total[:-1, :-1] + information, score))
    return max(float(total[-1, -1]) - imitated, 0.0)


def parted(rivals: Sequence[Rival], grams: Mapping[tuple[int, int], Array]) -> dict[tuple[str, str], float]:
    """Return the squared separation of each pair: the smaller of the two directions of imitation.

    Args:
        rivals: Rival models.
        grams: Gram matrix of rival j in the flight of rival i, by (i, j).
    """
    return {
        (rivals[i].name, rivals[j].name): min(
            distance(grams[i, j], rivals[j].information), distance(grams[j, i], rivals[i].information)
        )
        for i, j in combinations(range(len(rivals)), 2)
    }


def utility(distances: Parted) -> float:
    """Return the utility of a flight with these squared separations: the sum of log(1 + separation)."""
    return float(sum(np.log1p(square) for square in distances.values()))


def expected(rival: Rival, total: Array) -> list[Expected]:
    """Return the expected standard errors of the effect of a rival after a flight.

    Args:
        rival: Rival model.
        total: Gram matrix of the rival in the flight, (P + 1, P + 1).
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
    """Effect that a recording does not show, as sensitivity columns.

    Attributes:
        name: The effect.
        columns: Vehicle with a small value of each component, and the size of that value in scales.
        labels: Name, unit and scale of each component.
    """

    name: str
    columns: tuple[tuple[Vehicle, float], ...]
    labels: tuple[tuple[str, str, float], ...]


def unseen(vehicle: Vehicle, effects: Sequence[str], reach: Array | None = None) -> list[Unseen]:
    """Return effects as sensitivity columns; a nonlinear effect has the columns of its first shape.

    Args:
        vehicle: The vehicle.
        effects: Names in the catalogue.
        reach: Positions and times of the recording, (N, 4), which limit the search for an anchor.
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
    """Return the expected standard errors of effects that the recording does not show, each tested alone.

    Args:
        rival: Vehicle without the effects.
        asked: Effects, in the order of their columns after those of the rival.
        total: Gram matrix of the flight.
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
    """Return the utility of a flight from its expected standard errors: the share of each effect it shows.

    The weight of a component falls once its standard error exceeds SHOWN times its scale.  A small term in
    the log of the standard errors (D-optimality) ranks flights that show equally many components.
    """
    whole = 0.0
    for effect in asked:
        pairs = zip(effect.labels, errors[effect.name], strict=True)
        size = np.array([max(one.after / scale, 1e-12) for (_, _, scale), one in pairs])
        whole += float(np.mean(1.0 / (1.0 + (size / SHOWN) ** 2) - LOG_WEIGHT * np.log(size)))
    return whole
