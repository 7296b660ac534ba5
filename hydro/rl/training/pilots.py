"""Hand-written pilots as actors: one without a map, and one with a map and planner."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from hydro.core.columns import Array32, Mask
from hydro.rl.environment.action import steered_by_fins
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.guidance import Guidance
from hydro.rl.environment.helmsman import PLAIN, Manner, docking_pilot, fin_pilot, helmsman
from hydro.rl.environment.observation import TARGET
from hydro.rl.tasks.docking import Docking
from hydro.rl.tasks.task import Task

Actor = Callable[[Array32], Array32]
"""Function from observations (N, O) to actions (N, 6)."""


def pilot_of(task: Task, manner: Manner = PLAIN, *, fins: bool = False) -> Actor:
    """Return the hand-written pilot that is the baseline of a task, a function from observations to actions.

    It maps observations (N, O) to actions (N, 6).

    Args:
        task: The task.
        manner: Tuning of a pilot that steers with thrusters.
        fins: Whether the vehicle steers with fins alone (`action.steered_by_fins`).
    """
    if fins:
        return fin_pilot
    return partial(docking_pilot if task.name == Docking.name else helmsman, manner=manner)


class WithMap:
    """Pilot with a map: it flies along a path that it plans, whatever target the observation shows.

    Attributes:
        begun: Mask of the vehicles whose episode has begun since the last call, (N,).
    """

    def __init__(self, fleet: Fleet, manner: Manner = PLAIN) -> None:
        """Make the pilot of a fleet that has not flown yet."""
        self._fleet, self._manner = fleet, manner
        self._fins = steered_by_fins(fleet.plant.vehicle)
        self._chart = Guidance(fleet.settings, fleet.count, manner.margin)
        self.begun: Mask = np.ones(fleet.count, dtype=np.bool_)

    def __call__(self, observations: Array32) -> Array32:
        """Return actions (N, 6) at observations (N, O)."""
        fleet = self._fleet
        on_his_own = fleet.led or not fleet.task.levels
        seen = observations if on_his_own else self._with_target(observations)
        return pilot_of(fleet.task, self._manner, fins=self._fins)(seen)

    def _with_target(self, observations: Array32) -> Array32:
        """Replace the target in observations (N, O) by a point ahead on a planned path."""
        fleet, pose = self._fleet, self._fleet.plant.pose
        self._chart.reset(self.begun, fleet.starts, fleet.goals, fleet.pillars)
        self.begun = np.zeros(fleet.count, dtype=np.bool_)
        ahead, _ = self._chart.targets(np.ones(fleet.count, dtype=np.bool_), pose[:, :3])
        seen = observations.copy()
        turned = Rotation.from_quat(pose[:, [4, 5, 6, 3]]).inv()
        seen[:, TARGET : TARGET + 3] = turned.apply(ahead - pose[:, :3])
        return seen
