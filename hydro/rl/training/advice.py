"""What a pilot by hand would do where he, or a policy, has been; level by level, for a policy to do likewise.

A clone of a pilot's own flights errs where he never comes, and its errors add up. So the policy flies and the
pilot says what he would do there, and all that he has ever said is learnt from (dataset aggregation, Ross et
al. 2011).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor, nn

from hydro.core.columns import Array32
from hydro.rl.training.memory import pack, unpack

Level = tuple[str, int]
"""A task and its level."""

EVERY = 4
"""Of so many control steps one is kept: neighbours say nearly the same."""
ROWS = 512
"""Of a batch."""
RATE, LEAST = 1e-3, 0.01
"""Learning rate at first, and the share of it that is left at the end."""
SPREAD = 0.2
"""Scale of the normal under the tanh of a policy that was cloned."""


class Advice:
    """What was said at every level so far."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._said: dict[Level, tuple[Tensor, Tensor]] = {}

    @property
    def levels(self) -> list[Level]:
        """Levels that something was said at, the one that it was last in the end."""
        return list(self._said)

    def add(self, level: Level, encoded: Array32, actions: Array32) -> None:
        """Keep what should be done: encoded observations (K, O) and actions (K, A)."""
        new = torch.from_numpy(encoded), torch.from_numpy(actions)
        old = self._said.pop(level, None)
        seen, done = new if old is None else (torch.cat(pair) for pair in zip(old, new, strict=True))
        self._said[level] = seen, done

    def forget(self, level: Level) -> None:
        """Let go what was said at a level."""
        self._said.pop(level, None)

    def batches(self, count: int, generator: torch.Generator) -> Iterator[tuple[Tensor, Tensor]]:
        """Observations (ROWS, O) and actions (ROWS, A), drawn so many times.

        As much of each level as was said there, but of the one that was spoken of last at least half.
        """
        seen, done = (torch.cat(parts) for parts in zip(*self._said.values(), strict=True))
        sizes = torch.tensor([len(each) for each, _ in self._said.values()])
        first = sizes.cumsum(0) - sizes
        shares = sizes.float()
        shares[-1] = shares[-1].maximum(shares[:-1].sum())
        for _ in range(count):
            level = torch.multinomial(shares, ROWS, replacement=True, generator=generator)
            row = first[level] + (torch.rand(ROWS, generator=generator) * sizes[level]).long()
            yield seen[row], done[row]

    def state(self) -> list[Any]:
        """Everything that the future depends on, packed."""
        return [
            [task, level, pack({"observation": seen, "action": done})]
            for (task, level), (seen, done) in self._said.items()
        ]

    def restore(self, state: list[Any]) -> None:
        """Go back to a `state`."""
        self._said = {}
        for task, level, packed in state:
            found = unpack(packed)
            self._said[task, level] = found["observation"], found["action"]


def imitate(network: nn.Module, advice: Advice, batches: int, generator: torch.Generator) -> None:
    """Make a policy do as was said: least squares over so many batches, ever more slowly.

    Args:
        network: Encoded observations to mean and scale of the normal under the tanh; what it explores by is
            brought to SPREAD besides.
        advice: What was said.
        batches: How many.
        generator: Draws them.
    """
    optimiser = torch.optim.Adam(network.parameters(), RATE, fused=True)
    for k, (seen, said) in enumerate(advice.batches(batches, generator)):
        optimiser.param_groups[0]["lr"] = RATE * (1.0 - (1.0 - LEAST) * k / batches)
        mean, scale = network(seen)
        error = (mean.tanh() - said).square().mean() + (scale - SPREAD).square().mean()
        optimiser.zero_grad()
        error.backward()
        optimiser.step()
