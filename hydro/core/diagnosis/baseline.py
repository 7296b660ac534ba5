"""What a search for what is missing starts from, what it found, and what of it matters.

A finding matters where it explains enough of the error that the file's own effects leave, or lowers its root
enough, or is much of what others have left of it; whatever kinematics alone shows need only be visible.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Model, Screening
from hydro.core.identification.fit import Fit
from hydro.core.identification.output_error import OutputError
from hydro.core.preprocessing.sensor_tests import KinematicTest, shown
from hydro.core.vehicle.description import Vehicle

MATERIAL = 0.05
"""Share of the squared error beyond the noise that a finding must explain,"""
TELLING = 0.1
"""or else by how much of its root it must lower the root of what is left."""
MUCH_OF_IT, PLAIN = 0.15, 0.01
"""or else the part of what is left that it must explain, and the share of the noise that this must be."""
VISIBLE = 0.005
"""Share of the whole error, noise included, below which nobody would see it in a replay."""


@dataclass(frozen=True)
class Baseline:
    """A vehicle file, and the best that its own effects can do: what a search starts from.

    Attributes:
        vehicle: The vehicle as its file gives it.
        effects: Names of its own effects, which are fitted anew.
        log: The preprocessed recording.
        problem: The shots, begun where the recording saw the vehicle.
        given: The vehicle with the values of its file.
        refitted: With its own effects fitted anew.
        sensors: What kinematics alone says of the velocity log's errors, by effect.
        start: The vehicle that the fits begin from; another one than the file's where its predictions
            diverge.
        warnings: What went wrong on the way, a sentence each.
        file: Another vehicle whose values alone are known beforehand; None where these are.
    """

    vehicle: Vehicle
    effects: tuple[str, ...]
    log: Preprocessed
    problem: OutputError
    given: Model
    refitted: Model
    sensors: Mapping[str, KinematicTest]
    start: Vehicle | None = None
    warnings: tuple[str, ...] = ()
    file: Vehicle | None = None

    @property
    def beforehand(self) -> Vehicle:
        """The vehicle whose values are known whatever this recording says."""
        return self.file or self.vehicle

    def explained(self, model: Model) -> float:
        """Part of the error beyond the noise that a model explains of what the file's own effects leave."""
        return (self.refitted.normal.cost - model.normal.cost) / max(self.refitted.excess, 1e-9)

    def material(self, gain: float, before: Model) -> bool:
        """Whether explaining so much squared residual of a model matters.

        Where others have explained most, a small share of the first error may be much of what is left, and
        that is enough as long as it is plain beside the noise.
        """
        left, first = max(before.excess - gain, 0.0), self.refitted.excess
        lower = np.sqrt(before.excess) - np.sqrt(left) >= TELLING * np.sqrt(first)
        much = gain >= max(MUCH_OF_IT * before.excess, PLAIN * before.normal.residuals)
        return self.visible(gain) and bool(lower or much or gain >= MATERIAL * first)

    def visible(self, gain: float) -> bool:
        """Whether explaining so much would show in a replay at all."""
        return gain >= VISIBLE * self.refitted.normal.residuals

    def belongs(self, effect: str, gain: float, before: Model) -> bool:
        """Whether an effect is a finding: it matters, or kinematics shows it, however much else is wrong."""
        return self.material(gain, before) or (self.sure(effect) and self.visible(gain))

    def sure(self, effect: str) -> bool:
        """Whether kinematics alone shows that the velocity log misreads so, whatever the dynamics lack."""
        test = self.sensors.get(effect)
        return test is not None and shown(test)


@dataclass(frozen=True)
class Found:
    """An effect that joined the model.

    Attributes:
        effect: Its name.
        p_value: That nothing being missing the most telling effect tells as much.
        rivals: The models in which it, or another effect in its place, explains what is left, by effect.
    """

    effect: str
    p_value: float
    rivals: Mapping[str, Model]


@dataclass(frozen=True)
class Outcome:
    """What a search found.

    Attributes:
        model: The vehicle with all of it.
        found: What joined it.
        last: The suspects of the last round, in which nothing joined.
        without: The model without each effect that was found, all others fitted anew.
        fit: Values and standard errors of all effects fitted together; None of none, and before they are.
        warnings: What went wrong on the way, a sentence each.
    """

    model: Model
    found: tuple[Found, ...]
    last: Screening
    without: Mapping[str, Model] = field(default_factory=dict)
    fit: Fit | None = None
    warnings: tuple[str, ...] = ()

    @property
    def effects(self) -> list[str]:
        """Names of what was found."""
        return [one.effect for one in self.found]
