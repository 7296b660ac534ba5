"""Demonstrations of the expert, a hand-written pilot with a map, and its labels of the policy's states.

Half of every batch of reinforcement learning comes from demonstrations (Ball et al. 2023, RLPD).  If the
policy flies, the expert labels the states that it visits (`training.expert_labels`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hydro.core.columns import Array, Array32
from hydro.rl.environment.action import ACTIONS
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.helmsman import PLAIN, Manner
from hydro.rl.environment.interfaces import Step
from hydro.rl.training.pilots import Actor, WithMap
from hydro.rl.training.returns import Transition


def demonstrations(fleet: Fleet, manner: Manner = PLAIN) -> Iterator[Transition]:
    """Fly with the expert pilot for one episode's time limit, and yield the transition of every control step.

    Vehicles that finish early begin further episodes.  The expert follows a planned path, even if the policy
    only observes the goal; the path makes it better near pillars.

    Args:
        fleet: Vehicles that have not flown yet, with task and level set.
        manner: Tuning of the expert; its margin applies if it does not follow the policy's path.
    """
    once = np.ones(fleet.count, dtype=np.int64)
    for observations, actions, _, step in _fly(fleet, manner=manner):
        ended = step.terminated | step.truncated
        yield Transition(observations, actions, step.reward, step.terminated, ended, step.final_obs, once)


DISTURBANCE = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 1.0]) / 3.0
"""Relative disturbance by axis; unknown moments of a hull act most in roll and pitch."""
CORRELATION = 50
"""Correlation time of the disturbances [control steps]."""


class Disturbed:
    """Actor whose actions are disturbed at random for every other vehicle (Laskey et al. 2017).

    In other water a hull trims and rolls differently than in the simulator of the training.  The disturbances
    show the policy such states.
    """

    def __init__(self, actor: Actor, size: float, seed: int) -> None:
        """Disturb an actor.

        Args:
            actor: Policy or pilot.
            size: Standard deviation of the disturbance in roll and pitch; see `DISTURBANCE`.
            seed: Seed of the disturbances, which have a correlation time of `CORRELATION` steps.
        """
        self._actor, self._size, self._rng = actor, size, np.random.default_rng([seed, 1 << 33])
        self._disturbance: Array | None = None

    def __call__(self, observations: Array32) -> Array32:
        """Return disturbed actions (N, 6) at observations (N, O)."""
        new = self._rng.standard_normal((len(observations), ACTIONS))
        kept = 1.0 - 1.0 / CORRELATION
        self._disturbance = (
            new if self._disturbance is None else kept * self._disturbance + np.sqrt(1.0 - kept**2) * new
        )
        disturbance = self._size * DISTURBANCE * self._disturbance * (np.arange(len(new)) % 2)[:, None]
        return (self._actor(observations) + disturbance).astype(np.float32)


def corrections(fleet: Fleet, actor: Actor, manner: Manner = PLAIN) -> Iterator[tuple[Array32, Array32]]:
    """Fly with an actor for one episode's time limit; yield the expert's actions at the states it visits.

    Args:
        fleet: Vehicles that have not flown yet, with task and level set.
        actor: Policy or pilot that flies.
        manner: Tuning of the expert.

    Yields:
        For each step the observations (N, O), and the actions (N, 6) that the expert would take there.
    """
    for observations, expert, _, _ in _fly(fleet, actor, manner):
        yield observations, expert


def own_actions(fleet: Fleet, actor: Actor) -> Iterator[tuple[Array32, Array32]]:
    """Fly with an actor for one episode's time limit; yield its observations and actions in every step.

    Args:
        fleet: Vehicles that have not flown yet, with task and level set.
        actor: Policy or pilot that flies.

    Yields:
        For each step the observations (N, O) and the actor's actions (N, 6).
    """
    for observations, _, done, _ in _fly(fleet, actor):
        yield observations, done


def mastered(fleet: Fleet) -> float:
    """Return the fraction (0 to 1) of vehicles with which the expert pilot succeeds in the first episode.

    Args:
        fleet: Vehicles that have not flown yet, with task and level set.
    """
    first, reached = np.ones(fleet.count, dtype=np.bool_), 0
    for *_, step in _fly(fleet):
        reached += int((first & step.info.success).sum())
        first &= ~(step.terminated | step.truncated)
        if not first.any():
            break
    return reached / fleet.count


def _fly(
    fleet: Fleet, actor: Actor | None = None, manner: Manner = PLAIN
) -> Iterator[tuple[Array32, Array32, Array32, Step]]:
    """Fly for the time limit of one episode, by default with the expert.

    Yields:
        Observations (N, O), actions of the expert and of the actor (N, 6), and the result of the step.
    """
    pilot, observations = WithMap(fleet, manner), fleet.reset()
    for _ in range(fleet.task.steps(fleet.settings)):
        expert = np.clip(pilot(observations), -1.0, 1.0)
        done = expert if actor is None else actor(observations)
        step = fleet.step(done)
        pilot.begun = step.terminated | step.truncated
        yield observations, expert, done, step
        observations = step.obs
