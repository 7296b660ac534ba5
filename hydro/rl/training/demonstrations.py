"""What a pilot by hand, who has the map, would do: episodes to learn from before and beside one's own.

Reinforcement learning with prior data: half of every batch is of demonstrations (Ball et al. 2023, RLPD).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from hydro.core.columns import Array32, Mask
from hydro.rl.environment.fleet import Fleet, Step
from hydro.rl.environment.guidance import Guidance
from hydro.rl.environment.helmsman import helmsman
from hydro.rl.environment.observation import TARGET
from hydro.rl.environment.tasks import GUIDED
from hydro.rl.training.returns import Transition


def demonstrations(fleet: Fleet) -> Iterator[Transition]:
    """Fly as long as an episode may last, one episode after the other, and tell every step.

    The pilot swims along a plan, whatever the policy is shown: past pillars, where that is the goal alone, he
    is the better for knowing the way.

    Args:
        fleet: Vehicles that have not flown yet, their stage and level set.
    """
    once = np.ones(fleet.count, dtype=np.int64)
    for observations, actions, step in _flown(fleet):
        ended = step.terminated | step.truncated
        yield Transition(observations, actions, step.reward, step.terminated, ended, step.final_obs, once)


def mastered(fleet: Fleet) -> float:
    """Share of the vehicles whose first goal the pilot reaches.

    Args:
        fleet: As for `demonstrations`.
    """
    first, reached = np.ones(fleet.count, dtype=np.bool_), 0
    for _, _, step in _flown(fleet):
        reached += int((first & step.info.success).sum())
        first &= ~(step.terminated | step.truncated)
        if not first.any():
            break
    return reached / fleet.count


def _flown(fleet: Fleet) -> Iterator[tuple[Array32, Array32, Step]]:
    """What is seen (N, 36), what the pilot does (N, 4) and what comes of it, for one episode's time."""
    observations = fleet.reset()
    chart, begun = Guidance(fleet.settings, fleet.count), np.ones(fleet.count, dtype=np.bool_)
    for _ in range(fleet.settings.task.steps):
        actions = np.clip(helmsman(_with_map(fleet, chart, begun, observations)), -1.0, 1.0)
        step = fleet.step(actions)
        begun = step.terminated | step.truncated
        yield observations, actions, step
        observations = step.obs


def _with_map(fleet: Fleet, chart: Guidance, begun: Mask, observations: Array32) -> Array32:
    """Observations (N, 36) with a point ahead on a planned way for a target."""
    if fleet.stage == GUIDED:
        return observations
    chart.reset(begun, fleet.starts, fleet.goals, fleet.pillars)
    pose = fleet.plant.pose
    ahead, _ = chart.targets(np.ones(fleet.count, dtype=np.bool_), pose[:, :3])
    seen = observations.copy()
    turned = Rotation.from_quat(pose[:, [4, 5, 6, 3]]).inv()
    seen[:, TARGET : TARGET + 3] = turned.apply(ahead - pose[:, :3])
    return seen
