"""Fleets of a training: in the student under its condition, or in the teacher."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hydro.core.vehicle.description import Vehicle
from hydro.io.model import Model
from hydro.rl.environment import conditions
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.guidance import Guidance
from hydro.rl.training.config import TrainingConfig
from hydro.sim.plant import Plant
from hydro.sim.teacher_plant import TeacherPlant

Simulator = Literal["student", "teacher"]


@dataclass(frozen=True)
class Builder:
    """Makes the fleets of a training and of its evaluations.

    Attributes:
        config: Condition, settings and threads.
        vehicle: The vehicle file.
        model: The residual model of the condition, if it flies with one.
        folder: Folder of the vehicle file, where a hull mesh is looked for.
    """

    config: TrainingConfig
    vehicle: Vehicle
    model: Model | None = None
    folder: Path | None = None

    def __call__(self, count: int, seed: int, simulator: Simulator = "student") -> Fleet:
        """A fleet of `count` vehicles with tasks of a seed.

        Raises:
            DataError: The vehicle cannot be simulated.
            UsageError: The condition lacks its residual model, or has one that it does not fly with.
        """
        settings = self.config.settings
        return Fleet(settings, self._plant(count, simulator), seed, Guidance(settings, count))

    def _plant(self, count: int, simulator: Simulator) -> Plant:
        if simulator == "teacher":
            return TeacherPlant(self.vehicle, count=count, period=self.config.settings.period)
        config = self.config
        condition = conditions.Condition(config.condition, self.model, config.conditioning)
        return conditions.plant(
            condition,
            self.vehicle,
            config.settings,
            count,
            threads=config.threads,
            folder=self.folder,
        )
