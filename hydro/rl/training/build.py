"""Fleets of a training in kernels, MuJoCo (student), the reference simulator (teacher) or Stonefish."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from hydro.core.errors import UsageError
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle
from hydro.io.model import Model
from hydro.rl.environment import conditions
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.guidance import Guidance
from hydro.rl.training.config import TrainingConfig
from hydro.rl.training.trials import Trial
from hydro.rl.world.config import Engine, Settings
from hydro.sim.plant import Plant
from hydro.sim.stonefish.plant import StonefishPlant
from hydro.sim.teacher_plant import TeacherPlant

Simulator = Literal["kernels", "student", "teacher", "stonefish"]
"""Simulator of a flight, as in the column `plant` of evaluations.

The first two are the engines of the environment: this project's own kernels, and the MuJoCo model.
"""
ENGINES: dict[Simulator, Engine] = {"kernels": "kernels", "student": "mujoco"}
PLANTS: dict[Engine, Simulator] = {engine: name for name, engine in ENGINES.items()}
"""Name of each engine in the column `plant`."""


@dataclass(frozen=True)
class Builder:
    """Factory of the fleets of a training and of its evaluations; a call returns a fleet.

    Attributes:
        config: Condition, settings and threads.
        vehicle: Vehicle file, which allocates actions to thrusters.
        model: Residual model, if the condition has one.
        folder: Folder of the vehicle file, where hull meshes are.
        estimates: Covariance of the vehicle file's parameters, if there is one.
        truth: Vehicle to simulate instead of the one of the file.
    """

    config: TrainingConfig
    vehicle: Vehicle
    model: Model | None = None
    folder: Path | None = None
    estimates: Estimates | None = None
    truth: Vehicle | None = None

    def __call__(
        self, count: int, seed: int, simulator: Simulator | None = None, trial: Trial | None = None
    ) -> Fleet:
        """Build a fleet of `count` vehicles with the tasks of a seed, for training or for a trial.

        Args:
            count: Number of vehicles.
            seed: Seed of tasks and noise.
            simulator: Simulator; by default the engine of the training.
            trial: Test setting; by default the settings of the training.

        Raises:
            DataError: The vehicle cannot be simulated.
            UsageError: Stonefish's program is not installed; the residual model is missing or superfluous; or
                parameters are to be drawn that the condition ignores, or without a covariance.
        """
        settings = self.config.settings if trial is None else trial.of(self.config.settings)
        drawn = settings.randomise
        if (drawn.posterior or drawn.box) and self.config.condition not in conditions.OF_THE_FILE:
            raise UsageError(
                f"{self.config.condition} ignores the parameters of the vehicle file's effects: draw them "
                f"with --condition {conditions.EFFECTS}"
            )
        return Fleet(
            settings,
            self._plant(settings, count, simulator or PLANTS[settings.engine]),
            seed,
            Guidance(settings, count),
            believed=self.vehicle,
            estimates=self.estimates,
        )

    def _plant(self, settings: Settings, count: int, simulator: Simulator) -> Plant:
        flown, config = self.truth or self.vehicle, self.config
        if simulator == "teacher":
            return TeacherPlant(flown, count=count, period=settings.period)
        if simulator == "stonefish":
            return StonefishPlant(flown, count=count, period=settings.period)
        condition = conditions.Condition(config.condition, self.model, config.conditioning, config.wrench)
        settings = replace(settings, engine=ENGINES[simulator])
        return conditions.plant(condition, flown, settings, count, threads=config.threads, folder=self.folder)
