"""Episodes of many vehicles on a GPU, with tasks, sonar and rewards on the device.

A control step is four kernel launches for any number of vehicles, and no data leaves the device.  A vehicle
that begins an episode takes the next scene of a pool drawn in advance.  The pool holds the same scenes as
`environment.fleet` draws.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from hydro.core.errors import UsageError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import quaternion_from_euler
from hydro.rl.environment import observation, reward
from hydro.rl.environment.action import ACTIONS, crew_of
from hydro.rl.environment.blocks import FLAGS, TOTALS, Episodes, Motion, Outcome, Scenes
from hydro.rl.environment.conditions import Condition, waters
from hydro.rl.environment.observation import OBSERVATIONS
from hydro.rl.environment.reward import WEIGHTS
from hydro.rl.environment.step import make_rules
from hydro.rl.tasks.point_to_point import PointToPoint
from hydro.rl.tasks.registry import task_of
from hydro.rl.tasks.task import Ends, Scene, Task, generator
from hydro.rl.world.config import Randomisation, Settings
from hydro.sim.craft import STEP
from hydro.sim.gpu import memory
from hydro.sim.gpu.plant import GpuPlant

POOL = 16_384
"""Greatest number of scenes drawn in advance."""


class GpuFleet:
    """Vehicles that run their episodes in parallel on a GPU.

    Attributes:
        settings: Settings of world, sensors, reward and task.
        plant: Simulator of the vehicles.
        count: Number of vehicles N.
        task: Task of all vehicles.
        level: Level of the task.
        observations: Observations (N, 36) as in `rl.environment.observation`; rewritten in place, as are the
            following.
        reward: Reward of the last step (N,).
        flags: Flags of the last step (FLAGS, N), in the order of `rl.environment.blocks`.
    """

    def __init__(
        self,
        settings: Settings,
        vehicle: Vehicle,
        *,
        count: int = 1,
        seed: int = 0,
        task: str = PointToPoint.name,
        level: int | None = None,
        condition: Condition | None = None,
        timestep: float = STEP,
    ) -> None:
        """Make a fleet; `reset` begins the episodes.

        Args:
            settings: All choices; without randomisation and without stacked observations.
            vehicle: The vehicle file.
            count: Number of vehicles.
            seed: Seed of tasks and noise.
            task: Task with a fixed goal, without planned path and current.
            level: Level of the task; the greatest by default.
            condition: Physics condition; by default the effects of the vehicle file.
            timestep: Greatest integration step [s].

        Raises:
            DataError: The vehicle cannot be simulated.
            UsageError: A GPU is missing, the task or level does not exist, or the GPU does not support it.
        """
        if settings.randomise != Randomisation() or settings.history != 1:
            raise UsageError(
                "a GPU fleet supports neither randomise nor history: leave both out, or fly on the processor"
            )
        water = waters(condition or Condition(), vehicle, settings.period)
        self.plant = GpuPlant(vehicle, water, count=count, period=settings.period, timestep=timestep)
        from hydro.rl.gpu import kernels  # which imports numba-cuda
        from hydro.sim.gpu.kernels import launch

        self._kernels, self._launch = kernels, launch
        self.settings, self.count, self.seed = settings, count, seed
        self.task = task_of(task)
        self.level = self.task.most if level is None else level
        self.task.require(self.level)
        self.device = torch.device("cpu" if memory.simulated() else "cuda")
        self._generator = torch.Generator(self.device).manual_seed(seed)
        crew = crew_of(vehicle)
        self._make_arrays(_drawn(self.task, self.level, settings, count, seed))
        self._make_blocks(vehicle, crew)

    def _make_arrays(self, scenes: list[Scene]) -> None:
        """Allocate the arrays of every vehicle on the device, and the pool of scenes."""
        count = self.count
        pillars = max(1, *(len(scene.pillars) for scene in scenes))
        poses, goals = np.zeros((len(scenes), 7)), np.zeros((len(scenes), 3))
        axes = np.full((len(scenes), pillars, 2), np.nan)
        for row, scene in enumerate(scenes):
            poses[row, :3], poses[row, 3:] = scene.start, quaternion_from_euler(0.0, 0.0, scene.heading)
            goals[row], axes[row, : len(scene.pillars)] = scene.goal, scene.pillars
        self._pool_arrays = poses, goals, axes
        self._pillars = self._zeros(count, pillars, 2)
        self._goals, self._targets = self._zeros(count, 3), self._zeros(count, 3)
        self._poses, self._zero_velocity = self._zeros(count, 7), self._zeros(count, 6)
        self._mask, self._all = (torch.ones(count, dtype=torch.bool, device=self.device) for _ in range(2))
        self._episode = torch.full((count,), -1, dtype=torch.int64, device=self.device)
        self._demands, self._noise = self._zeros(count, ACTIONS), self._zeros(count, OBSERVATIONS)
        self.observations = self._zeros(count, OBSERVATIONS).float()
        self.reward = self._zeros(count).float()
        self.flags = torch.zeros((FLAGS, count), dtype=torch.bool, device=self.device)

    def _make_blocks(self, vehicle: Vehicle, crew: Any) -> None:
        """Build the blocks of arrays that the kernels take."""
        kernels, count, settings, shared = self._kernels, self.count, self.settings, memory.shared
        ends = np.array([self.task.ends(settings)], dtype=np.float64)
        worth = reward.weights(self.task.reward(settings))[None]
        self._commands = memory.zeros((count, len(crew.table)))
        self._crew = kernels.Allocation(*map(memory.put, (crew.allocation, crew.table, crew.authority)))
        self._demand_block = kernels.Demands(shared(self._demands), self._commands)
        self._pool = kernels.Pool(*map(memory.put, self._pool_arrays))
        self._starts = kernels.Starts(shared(self._mask), shared(self._episode), shared(self._poses))
        senses = observation.senses(settings, vehicle)
        self._senses = senses._replace(
            limits=memory.put(senses.limits), fan=memory.put(senses.fan), tank=memory.put(senses.tank),
            sigma=memory.put(senses.sigma),
        )  # fmt: skip
        self._rules = type(rules := make_rules(settings, vehicle, crew.table))(*map(memory.put, rules))
        plant = self.plant
        self._motion = Motion(
            plant.pose, plant.velocity, plant.specific_force, plant.thrust, plant.diverged,
            memory.zeros((count, 9)),
        )  # fmt: skip
        self._scenes = Scenes(
            memory.put(np.broadcast_to(worth, (count, WEIGHTS))),
            memory.put(np.broadcast_to(ends, (count, len(Ends._fields)))),
            shared(self._goals), shared(self._targets), shared(self._pillars), memory.zeros((count,)),
        )  # fmt: skip
        self._episodes = Episodes(
            memory.zeros((count,)), memory.zeros((count, ACTIONS)), memory.zeros((count,)),
            memory.zeros((count, TOTALS)),
        )  # fmt: skip
        self._view = kernels.View(shared(self._mask), shared(self._noise), shared(self.observations))
        self._outcome = Outcome(
            shared(self.reward), shared(self.flags), memory.zeros((count, len(reward.TERMS)))
        )
        self._zero_velocity_block = shared(self._zero_velocity)

    def _zeros(self, *shape: int) -> Tensor:
        """Return zeros on the device."""
        return torch.zeros(shape, dtype=torch.float64, device=self.device)

    def reset(self, mask: Tensor | None = None) -> Tensor:
        """Begin the next episode of the vehicles of a mask (N,), or of all vehicles if it is None.

        Returns:
            Observations of all vehicles (N, 36): the attribute `observations`, rewritten in place.
        """
        kernels = self._kernels
        self._mask.copy_(self._all if mask is None else mask)
        self._launch(kernels.place, self.count, self._pool, self._starts, self._scenes, self._episodes)
        self.plant.reset(self._starts.mask, self._starts.pose, self._zero_velocity_block)
        self._observe()
        return self.observations

    def step(self, actions: Tensor) -> Tensor:
        """Simulate one control step of all vehicles.

        The attributes `reward` and `flags` then hold its outcome.

        Args:
            actions: Actions (N, 6), clipped to [-1, 1]; a vehicle with an action that is not finite diverges.

        Returns:
            Observations of all vehicles (N, 36): the attribute `observations`, rewritten in place.
        """
        kernels = self._kernels
        self._demands.copy_(actions)
        self._launch(kernels.command, self.count, self._crew, self._demand_block)
        self.plant.step(self._commands)
        self._mask.copy_(self._all)
        self._observe()
        self._launch(
            kernels.evaluate_step, self.count, self._rules, self._motion, self._scenes, self._episodes,
            self._demand_block, self._outcome,
        )  # fmt: skip
        return self.observations

    def reseed(self, seed: int) -> None:
        """Set the seed of the sensor noise."""
        self._generator.manual_seed(seed)

    def _observe(self) -> None:
        """Update the observations of the vehicles of the mask."""
        self._noise.normal_(generator=self._generator)
        self._launch(
            self._kernels.observe,
            self.count,
            self._senses,
            self._motion,
            self._scenes,
            self._episodes,
            self._view,
        )


def _drawn(task: Task, level: int, settings: Settings, count: int, seed: int) -> list[Scene]:
    """Draw the scenes of a fleet's first episodes: row r belongs to vehicle r % N in its episode r // N.

    Args:
        task: Task of the scenes.
        level: Level of the task.
        settings: Settings of world and tasks.
        count: Number of vehicles N.
        seed: Seed of the fleet.

    Raises:
        UsageError: The task has a current, a moving goal or a planned path.
    """
    if task.guided:
        raise UsageError(f"{task.name} needs a planned path: fly it on the processor")
    episodes = max(1, POOL // count)
    rows = ((row % count, row // count) for row in range(min(count * episodes, POOL)))
    scenes = [task.scene(settings, level, generator(seed, *row)) for row in rows]
    if any(len(scene.course) > 1 or scene.current.any() for scene in scenes):
        raise UsageError(f"{task.name} has a moving goal or a current: fly it on the processor")
    return scenes
