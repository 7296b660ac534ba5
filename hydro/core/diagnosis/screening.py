"""Suspects held against what a model leaves, all of them linearised together about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from hydro.core.diagnosis.model import Model
from hydro.core.evaluation.score_test import Columns, Evidence, p_values
from hydro.core.identification.levenberg_marquardt import moved
from hydro.core.identification.normal_equations import Normal
from hydro.core.identification.suspects import Suspect

ALPHA = 0.01
"""Probability of a false alarm in one round, over all effects at once."""


@dataclass(frozen=True)
class Screening:
    """All suspects about one model.

    Attributes:
        model: The model, perhaps over a part of the shots.
        ranked: Best shape of each effect with its columns, the most telling first.
        shapes: Columns of every shape of each effect.
        normal: The linearised problem, in the units that the columns' steps have.
        evidence: The same in columns of unit size.
        own: Columns of the model's own entries.
        gains: Squared residual that each effect would explain of all shots.
    """

    model: Model
    ranked: Mapping[str, tuple[Suspect, Columns]]
    shapes: Mapping[str, Sequence[Columns]]
    normal: Normal
    evidence: Evidence
    own: Columns
    gains: Mapping[str, float]

    @cached_property
    def p_value(self) -> float:
        """Probability that chance alone would tell as much as the most telling effect."""
        return min(p_values(self.evidence, self.own, self.shapes).values(), default=1.0)

    @property
    def significant(self) -> bool:
        """Whether any effect tells more than chance would."""
        return self.p_value <= ALPHA


def screened(model: Model, tried: Sequence[Suspect], shots: int) -> Screening:
    """Hold some suspects against what a model leaves, over a part of so many shots or all of them."""
    changed, steps = moved(model.unknown, model.values)
    own, places = range(len(changed)), list[tuple[Suspect, Columns]]()
    for suspect in tried:
        places.append((suspect, range(len(changed), len(changed) + len(suspect.steps))))
        changed += suspect.changed
        steps += suspect.steps
    normal = model.problem.linearise(model.vehicle, changed, steps)
    evidence = Evidence.of(normal)
    whole = shots / len(normal.gram)
    best: dict[str, tuple[float, Suspect, Columns]] = {}
    every: dict[str, list[Columns]] = {}
    for suspect, columns in places:
        every.setdefault(suspect.effect, []).append(columns)
        gain = evidence.gain(own, columns) * whole
        if suspect.effect not in best or gain > best[suspect.effect][0]:
            best[suspect.effect] = (gain, suspect, columns)
    order = sorted(best, key=lambda name: -best[name][0])
    ranked = {name: best[name][1:] for name in order}
    gains = {name: best[name][0] for name in order}
    return Screening(model, ranked, every, normal, evidence, own, gains)
