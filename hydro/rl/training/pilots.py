"""Pilots by hand in their seat: without a map a function of what is seen, with one a planner besides."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from hydro.core.columns import Array32, Mask
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.guidance import Guidance
from hydro.rl.environment.helmsman import PLAIN, Manner, docker, helmsman
from hydro.rl.environment.observation import TARGET
from hydro.rl.tasks.docking import Docking
from hydro.rl.tasks.task import Task

Actor = Callable[[Array32], Array32]
"""Observations (N, O) to actions (N, 6)."""


def pilot_of(task: Task, manner: Manner = PLAIN) -> Actor:
    """The pilot by hand of a task, without a map."""
    return partial(docker if task.name == Docking.name else helmsman, manner=manner)


class WithMap:
    """A task's pilot who has a map: he swims to a point ahead on a planned way, whatever he is shown.

    Attributes:
        begun: Vehicles (N,) whose episode has begun since he last acted.
    """

    def __init__(self, fleet: Fleet, manner: Manner = PLAIN) -> None:
        """Take a seat in a fleet that has not flown yet, to fly in a manner."""
        self._fleet, self._manner = fleet, manner
        self._chart = Guidance(fleet.settings, fleet.count, manner.margin)
        self.begun: Mask = np.ones(fleet.count, dtype=np.bool_)

    def __call__(self, observations: Array32) -> Array32:
        """Demands (N, 6) at observations (N, O)."""
        fleet = self._fleet
        on_his_own = fleet.led or not fleet.task.levels
        seen = observations if on_his_own else self._with_target(observations)
        return pilot_of(fleet.task, self._manner)(seen)

    def _with_target(self, observations: Array32) -> Array32:
        """Observations (N, O) with a point ahead on a planned way for a target."""
        fleet, pose = self._fleet, self._fleet.plant.pose
        self._chart.reset(self.begun, fleet.starts, fleet.goals, fleet.pillars)
        self.begun = np.zeros(fleet.count, dtype=np.bool_)
        ahead, _ = self._chart.targets(np.ones(fleet.count, dtype=np.bool_), pose[:, :3])
        seen = observations.copy()
        turned = Rotation.from_quat(pose[:, [4, 5, 6, 3]]).inv()
        seen[:, TARGET : TARGET + 3] = turned.apply(ahead - pose[:, :3])
        return seen
