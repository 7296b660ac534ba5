"""What a pilot by hand, who has the map, would do: episodes to learn from before and beside one's own.

Reinforcement learning with prior data: half of every batch is of demonstrations (Ball et al. 2023, RLPD).
Where the policy flies itself, he says what he would do there (`training.advice`).
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
    """Fly as long as an episode may last, one episode after the other, and tell every step.

    The pilot swims along a plan, whatever the policy is shown: past pillars, where that is the goal alone, he
    is the better for knowing the way.

    Args:
        fleet: Vehicles that have not flown yet, its task and level set.
        manner: How he flies; his margin counts where he is not led along the policy's way.
    """
    once = np.ones(fleet.count, dtype=np.int64)
    for observations, actions, _, step in _flown(fleet, manner=manner):
        ended = step.terminated | step.truncated
        yield Transition(observations, actions, step.reward, step.terminated, ended, step.final_obs, once)


PUSHED = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 1.0]) / 3.0
"""Shares of a push by axis: what the file does not know of a hull turns it most about its level axes."""
WANDER = 50
"""Control steps in which a push becomes another."""


class Pushed:
    """Somebody who flies, and every other vehicle of whose is pushed about (Laskey et al. 2017).

    A hull in other water trims and rolls as none does in the simulator that is learnt in; what to do then is
    to be seen before.
    """

    def __init__(self, actor: Actor, size: float, seed: int) -> None:
        """Take a seat beside him.

        Args:
            actor: Who flies.
            size: Standard deviation of the demand in roll and pitch that is added; see `PUSHED`.
            seed: Of the pushes, which wander over `WANDER` steps.
        """
        self._actor, self._size, self._rng = actor, size, np.random.default_rng([seed, 1 << 33])
        self._push: Array | None = None

    def __call__(self, observations: Array32) -> Array32:
        """Demands (N, 6) at observations (N, O), with the pushes in them."""
        new = self._rng.standard_normal((len(observations), ACTIONS))
        kept = 1.0 - 1.0 / WANDER
        self._push = new if self._push is None else kept * self._push + np.sqrt(1.0 - kept**2) * new
        pushed = self._size * PUSHED * self._push * (np.arange(len(new)) % 2)[:, None]
        return (self._actor(observations) + pushed).astype(np.float32)


def corrections(fleet: Fleet, actor: Actor, manner: Manner = PLAIN) -> Iterator[tuple[Array32, Array32]]:
    """Let somebody else fly, likewise, and tell at every step what the pilot would do in his place.

    Args:
        fleet: As for `demonstrations`.
        actor: Who flies.
        manner: As for `demonstrations`.
    """
    for observations, said, _, _ in _flown(fleet, actor, manner):
        yield observations, said


def habits(fleet: Fleet, actor: Actor) -> Iterator[tuple[Array32, Array32]]:
    """Let somebody else fly, likewise, and tell at every step what he does."""
    for observations, _, done, _ in _flown(fleet, actor):
        yield observations, done


def mastered(fleet: Fleet) -> float:
    """Share of the vehicles whose first goal the pilot reaches.

    Args:
        fleet: As for `demonstrations`.
    """
    first, reached = np.ones(fleet.count, dtype=np.bool_), 0
    for *_, step in _flown(fleet):
        reached += int((first & step.info.success).sum())
        first &= ~(step.terminated | step.truncated)
        if not first.any():
            break
    return reached / fleet.count


def _flown(
    fleet: Fleet, actor: Actor | None = None, manner: Manner = PLAIN
) -> Iterator[tuple[Array32, Array32, Array32, Step]]:
    """Fly for one episode's time, the pilot himself by default.

    Yields:
        What is seen (N, O), what the pilot would do and what is done (N, 6), and what comes of it.
    """
    pilot, observations = WithMap(fleet, manner), fleet.reset()
    for _ in range(fleet.task.steps(fleet.settings)):
        said = np.clip(pilot(observations), -1.0, 1.0)
        done = said if actor is None else actor(observations)
        step = fleet.step(done)
        pilot.begun = step.terminated | step.truncated
        yield observations, said, done, step
        observations = step.obs
