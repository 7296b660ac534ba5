"""What a flight would tell: of rivals, how far they part; of an effect, its expected standard errors.

A rival is a vehicle with fitted values and what the recording tells of these.  What parts two of them in a
flight is not the difference of their predictions: the other one's values move, as far as the recording lets
them, to imitate the first (T-optimality: A. C. Atkinson and V. V. Fedorov, The design of experiments for
discriminating between two rival models, Biometrika 62, 57-70, 1975).  To first order that is a least-squares
problem in the other's values, with the recording's information as its prior, over shots of two seconds whose
beginnings are free.
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
"""Squared distance of rivals, in variances of the noise, by pairs of their names."""


SHOWN = 0.05
"""Standard error over scale at which an entry is half shown,"""
LATER = 1e-3
"""and the weight of what it becomes beyond."""


@dataclass(frozen=True)
class Rival:
    """A vehicle that explains a recording.

    Attributes:
        name: The effect that it rests on.
        unknown: Its free entries.
        values: Their fitted values, (P,).
        information: What the recording tells of them, in units of their scales, (P, P).
    """

    name: str
    unknown: Free
    values: Array
    information: Array

    @classmethod
    def of(cls, name: str, unknown: Free, values: Array, normal: Normal) -> Rival:
        """The rival of a fit, its information tempered by what the fit leaves."""
        known = normal.matrix.sum(axis=0) / max(normal.chi2, 1.0)
        return cls(name, unknown, values, known + PRIOR**-2 * np.eye(len(values)))

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with the fitted values."""
        return self.unknown.at(self.values)


@dataclass(frozen=True)
class Expected:
    """An entry as it is known before a flight and after it.

    Attributes:
        name: Of the entry.
        unit: Its unit.
        before: Standard error that the recording gives; infinite where it says nothing.
        after: The same with the flight.
    """

    name: str
    unit: str
    before: float
    after: float


def gram(rival: Rival, shots: Shots, more: Sequence[tuple[Vehicle, float]] = ()) -> Array:
    """Products of a rival's columns, of further ones, and of what it leaves of some shots, (P + K + 1,) * 2.

    Args:
        rival: What predicts the shots.
        shots: Of a predicted flight.
        more: The vehicle with a little of something else, and how much that is.

    Returns:
        Sum over all shots, not finite where a prediction diverges.
    """
    base = multiple_shooting.prepare(candidate(rival.vehicle), shots)
    vehicles, steps = moved(rival.unknown, rival.values)
    vehicles += [vehicle for vehicle, _ in more]
    others = [multiple_shooting.prepare(candidate(vehicle), shots, base) for vehicle in vehicles]
    steps += [step for _, step in more]
    total: Array = sensitivity.linearise(base, others, steps, shots, threads=1).gram.sum(axis=0)
    return total


def distance(total: Array, information: Array) -> float:
    """Squared residual that is left once a rival has imitated another as well as it can.

    Args:
        total: Of `gram`, (P + 1, P + 1).
        information: What is known of its values besides, (P, P).
    """
    score = total[:-1, -1]
    imitated = float(score @ np.linalg.solve(total[:-1, :-1] + information, score))
    return max(float(total[-1, -1]) - imitated, 0.0)


def parted(rivals: Sequence[Rival], grams: Mapping[tuple[int, int], Array]) -> dict[tuple[str, str], float]:
    """Squared distances of all pairs, each the lesser of the two ways round.

    Args:
        rivals: The rivals.
        grams: Of rival j in the flight of rival i, by (i, j).
    """
    return {
        (rivals[i].name, rivals[j].name): min(
            distance(grams[i, j], rivals[j].information), distance(grams[j, i], rivals[i].information)
        )
        for i, j in combinations(range(len(rivals)), 2)
    }


def utility(distances: Parted) -> float:
    """What a flight is worth that parts rivals so far: each pair counts, and more of the same ever less."""
    return float(sum(np.log1p(square) for square in distances.values()))


def expected(rival: Rival, total: Array) -> list[Expected]:
    """Standard errors of a rival's own effect after a flight.

    Args:
        rival: The rival.
        total: Of `gram` in it, (P + 1, P + 1).
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
    """An effect that a recording does not show, as columns.

    Attributes:
        name: The effect.
        columns: The vehicle with a little of each of its entries, and how much that is in scales.
        labels: Name, unit and scale of each entry.
    """

    name: str
    columns: tuple[tuple[Vehicle, float], ...]
    labels: tuple[tuple[str, str, float], ...]


def unseen(vehicle: Vehicle, effects: Sequence[str], reach: Array | None = None) -> list[Unseen]:
    """Effects as columns; of one that is not linear, its first shape.

    Args:
        vehicle: The vehicle.
        effects: Names in the catalogue.
        reach: Positions and times of the recording, (N, 4), among which an anchor is looked for.
    """
    found: dict[str, Unseen] = {}
    for one in suspects(vehicle, reach=reach) if effects else ():
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
    """Standard errors that a flight gives to effects which the recording does not show, each on its own.

    Args:
        rival: The vehicle without them.
        asked: The effects, in the order of their columns behind the rival's own in
        total: the products of `gram`.
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
    """What a flight is worth that gives such standard errors: the part of each effect that it shows.

    An entry counts the less, the more its standard error exceeds SHOWN of its scale; beyond that, the log of
    the information (D-optimality) decides between flights that show as much.
    """
    whole = 0.0
    for effect in asked:
        pairs = zip(effect.labels, errors[effect.name], strict=True)
        size = np.array([max(one.after / scale, 1e-12) for (_, _, scale), one in pairs])
        whole += float(np.mean(1.0 / (1.0 + (size / SHOWN) ** 2) - LATER * np.log(size)))
    return whole
