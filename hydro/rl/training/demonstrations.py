"""What a pilot by hand, who has the map, would do: episodes to learn from before and beside one's own.

Reinforcement learning with prior data: half of every batch is of demonstrations (Ball et al. 2023, RLPD).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hydro.core.columns import Array32
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.interfaces import Step
from hydro.rl.training.pilots import WithMap
from hydro.rl.training.returns import Transition


def demonstrations(fleet: Fleet) -> Iterator[Transition]:
    """Fly as long as an episode may last, one episode after the other, and tell every step.

    The pilot swims along a plan, whatever the policy is shown: past pillars, where that is the goal alone, he
    is the better for knowing the way.

    Args:
        fleet: Vehicles that have not flown yet, its task and level set.
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
    """What is seen (N, O), what the pilot does (N, 6) and what comes of it, for one episode's time."""
    pilot, observations = WithMap(fleet), fleet.reset()
    for _ in range(fleet.task.steps(fleet.settings)):
        actions = np.clip(pilot(observations), -1.0, 1.0)
        step = fleet.step(actions)
        pilot.begun = step.terminated | step.truncated
        yield observations, actions, step
        observations = step.obs
