"""Fleets of a plan: in the student under its condition, or in the teacher."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hydro.core.vehicle.description import Vehicle
from hydro.io.model import Model
from hydro.rl.environment import conditions
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.guidance import Guidance
from hydro.rl.training.train import Plan
from hydro.sim.plant import Plant
from hydro.sim.teacher_plant import TeacherPlant

Simulator = Literal["student", "teacher"]


@dataclass(frozen=True)
class Builder:
    """Makes the fleets of a training and of its evaluations.

    Attributes:
        plan: Condition, settings and threads.
        vehicle: The vehicle file.
        model: The residual model of the condition, if it flies with one.
        folder: Folder of the vehicle file, where a hull mesh is looked for.
    """

    plan: Plan
    vehicle: Vehicle
    model: Model | None = None
    folder: Path | None = None

    def __call__(self, count: int, seed: int, simulator: Simulator = "student") -> Fleet:
        """A fleet of `count` vehicles with tasks of a seed.

        Raises:
            DataError: The vehicle cannot be simulated.
            UsageError: The condition lacks its residual model, or has one that it does not fly with.
        """
        settings = self.plan.settings
        return Fleet(settings, self._plant(count, simulator), seed, Guidance(settings, count))

    def _plant(self, count: int, simulator: Simulator) -> Plant:
        if simulator == "teacher":
            return TeacherPlant(self.vehicle, count=count, period=self.plan.settings.period)
        return conditions.plant(
            self.plan.condition,
            self.vehicle,
            self.plan.settings,
            count,
            self.model,
            conditioning=self.plan.conditioning,
            threads=self.plan.threads,
            folder=self.folder,
        )
