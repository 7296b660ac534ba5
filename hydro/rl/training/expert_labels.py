"""Actions of the expert at the states that the expert or the policy visited, by level, for imitation.

A clone of the expert's own flights fails in states that the expert never visits, and its errors accumulate.
So the policy flies, the expert labels the states that it visits, and the policy is trained on all labels so
far (dataset aggregation, DAgger; Ross et al. 2011).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor, nn

from hydro.core.columns import Array32
from hydro.rl.training.memory import pack, unpack

Level = tuple[str, int]
"""Task and its level."""

EVERY = 4
"""One control step in this many is kept; neighbouring steps carry nearly the same information."""
ROWS = 512
"""Rows of a batch."""
RATE, LEAST = 1e-3, 0.01
"""Initial learning rate of Adam, and its final value as a share of it."""
SPREAD = 0.2
"""Scale of the normal distribution under the tanh to which imitation drives a policy."""


class ExpertLabels:
    """Observations labelled with actions of the expert pilot, by level, for imitation."""

    def __init__(self) -> None:
        """Start without labels."""
        self._labels: dict[Level, tuple[Tensor, Tensor]] = {}

    @property
    def levels(self) -> list[Level]:
        """Levels that have labels, each a pair of task and number, in the order of their last addition."""
        return list(self._labels)

    def add(self, level: Level, encoded: Array32, actions: Array32) -> None:
        """Add labels of a level: encoded observations (K, O) and the expert's actions (K, A)."""
        new = torch.from_numpy(encoded), torch.from_numpy(actions)
        old = self._labels.pop(level, None)
        seen, done = new if old is None else (torch.cat(pair) for pair in zip(old, new, strict=True))
        self._labels[level] = seen, done

    def forget(self, level: Level) -> None:
        """Remove the labels of a level."""
        self._labels.pop(level, None)

    def batches(self, count: int, generator: torch.Generator) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield `count` random batches of labels: encoded observations (ROWS, O) and actions (ROWS, A).

        Levels are drawn in proportion to their numbers of labels, but the level added last makes up at least
        half.
        """
        seen, done = (torch.cat(parts) for parts in zip(*self._labels.values(), strict=True))
        sizes = torch.tensor([len(each) for each, _ in self._labels.values()])
        first = sizes.cumsum(0) - sizes
        shares = sizes.float()
        shares[-1] = shares[-1].maximum(shares[:-1].sum())
        for _ in range(count):
            level = torch.multinomial(shares, ROWS, replacement=True, generator=generator)
            row = first[level] + (torch.rand(ROWS, generator=generator) * sizes[level]).long()
            yield seen[row], done[row]

    def state(self) -> list[Any]:
        """Return all labels as a list for a checkpoint: task, level, and packed observations and actions."""
        return [
            [task, level, pack({"observation": seen, "action": done})]
            for (task, level), (seen, done) in self._labels.items()
        ]

    def restore(self, state: list[Any]) -> None:
        """Replace all labels by those in a list that `state` returned.

        Args:
            state: Task, level, and packed observations and actions of each level.
        """
        self._labels = {}
        for task, level, packed in state:
            found = unpack(packed)
            self._labels[task, level] = found["observation"], found["action"]


def imitate(network: nn.Module, labels: ExpertLabels, batches: int, generator: torch.Generator) -> None:
    """Train a policy network in place by least squares on labels, with a linearly decreasing learning rate.

    Args:
        network: Policy network from encoded observations to mean and standard deviation of the action before
            the tanh; the standard deviation is trained towards SPREAD.
        labels: Encoded observations with actions of the expert.
        batches: Number of batches.
        generator: Generator of the batches.
    """
    optimiser = torch.optim.Adam(network.parameters(), RATE, fused=True)
    for k, (seen, actions) in enumerate(labels.batches(batches, generator)):
        optimiser.param_groups[0]["lr"] = RATE * (1.0 - (1.0 - LEAST) * k / batches)
        mean, scale = network(seen)
        error = (mean.tanh() - actions).square().mean() + (scale - SPREAD).square().mean()
        optimiser.zero_grad()
        error.backward()
        optimiser.step()
