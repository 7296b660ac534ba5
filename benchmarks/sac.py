"""Time of an update of soft actor-critic, compared with plain PyTorch.

The same networks, batch and optimiser settings, in turn:

    plain        as one writes it in PyTorch: three Adams, a loop over critics, min of two
    torchrl      TorchRL's SACLoss as usually written: vmap over critics, one fused Adam, SoftUpdate
    compiled     the same inside torch.compile (only with --compile: it takes minutes to compile)
    hydro        `rl.training.sac`: the same parameters and losses, both critics in one pass

A round makes one update of every case; given are medians of wall and processor time, and the ratio of plain's
processor time to each, with quartiles over rounds.

Run: `python benchmarks/sac.py [--threads N] [--rounds N] [--compile]`
"""

from __future__ import annotations

import argparse
import copy
import time
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import torch
from tensordict import TensorDict
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import Tensor, nn
from torch.nn import functional
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.modules import MLP, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import SACLoss, SoftUpdate

from hydro.rl.environment.observation import ENCODING, OBSERVATIONS
from hydro.rl.training.config import SACConfig
from hydro.rl.training.sac import Learner

ACTIONS, FILLED = 6, 100_000
CHOICES = SACConfig(horizon=1)  # of random transitions, nothing follows one another


def transitions() -> dict[str, Tensor]:
    """Return random transitions, so many that batches are scattered over memory."""
    generator = torch.Generator().manual_seed(0)

    def drawn(*shape: int) -> Tensor:
        return torch.randn(FILLED, *shape, generator=generator)

    return {
        "observation": drawn(OBSERVATIONS),
        "action": drawn(ACTIONS).tanh(),
        "reward": drawn(),
        "following": drawn(OBSERVATIONS),
        "terminated": torch.rand(FILLED, generator=generator) < 0.01,
    }


def mlp(inputs: int, outputs: int) -> nn.Sequential:
    widths = [inputs, *CHOICES.layers]
    layers = [layer for a, b in pairwise(widths) for layer in (nn.Linear(a, b), nn.ReLU())]
    return nn.Sequential(*layers, nn.Linear(widths[-1], outputs))


class Plain:
    """SAC in plain PyTorch, without special measures for speed."""

    def __init__(self, data: dict[str, Tensor]) -> None:
        self.data = list(data.values())
        self.actor = mlp(OBSERVATIONS, 2 * ACTIONS)
        self.critics = nn.ModuleList([mlp(OBSERVATIONS + ACTIONS, 1) for _ in range(2)])
        self.targets = copy.deepcopy(self.critics)
        self.log_alpha = torch.zeros(1, requires_grad=True)
        parts = self.actor.parameters(), self.critics.parameters(), [self.log_alpha]
        self.of_actor, self.of_critics, self.of_alpha = (torch.optim.Adam(p, CHOICES.rate) for p in parts)

    def sample(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        mean, log_scale = self.actor(observation).chunk(2, -1)
        normal = torch.distributions.Normal(mean, log_scale.clamp(-5.0, 2.0).exp())
        latent = normal.rsample()
        action = latent.tanh()
        return action, (normal.log_prob(latent) - (1.0 - action**2 + 1e-6).log()).sum(-1)

    def values(self, critics: nn.ModuleList, observation: Tensor, action: Tensor) -> list[Tensor]:
        return [critic(torch.cat([observation, action], -1)).squeeze(-1) for critic in critics]

    def update(self) -> None:
        rows = torch.randint(0, FILLED, (CHOICES.batch,))
        observation, action, reward, following, terminated = (each[rows] for each in self.data)
        alpha = self.log_alpha.exp().detach()
        with torch.no_grad():
            next_action, log_density = self.sample(following)
            value = torch.min(*self.values(self.targets, following, next_action)) - alpha * log_density
            target = reward + CHOICES.discount * ~terminated * value
        loss = sum(functional.mse_loss(q, target) for q in self.values(self.critics, observation, action))
        self.step(self.of_critics, loss)
        new, log_density = self.sample(observation)
        value = torch.min(*self.values(self.critics, observation, new))
        self.step(self.of_actor, (alpha * log_density - value).mean())
        entropy_error = log_density.detach() + CHOICES.target_entropy
        self.step(self.of_alpha, -(self.log_alpha.exp() * entropy_error).mean())
        with torch.no_grad():
            for new, old in zip(self.critics.parameters(), self.targets.parameters(), strict=True):
                old.mul_(1.0 - CHOICES.tau).add_(new, alpha=CHOICES.tau)

    @staticmethod
    def step(optimiser: torch.optim.Optimizer, loss: Tensor) -> None:
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


class TorchRL:
    """SAC of TorchRL, as in its examples."""

    def __init__(self, data: dict[str, Tensor], *, compiled: bool = False) -> None:
        layers = MLP(OBSERVATIONS, 2 * ACTIONS, num_cells=list(CHOICES.layers), activation_class=nn.ReLU)
        actor = ProbabilisticActor(
            TensorDictModule(
                nn.Sequential(layers, NormalParamExtractor()), ["observation"], ["loc", "scale"]
            ),
            in_keys=["loc", "scale"],
            distribution_class=TanhNormal,
            return_log_prob=True,
        )
        critic = MLP(OBSERVATIONS + ACTIONS, 1, num_cells=list(CHOICES.layers), activation_class=nn.ReLU)
        values = ValueOperator(critic, in_keys=["observation", "action"])
        self.loss = SACLoss(actor, values, loss_function="l2", target_entropy=CHOICES.target_entropy)
        self.loss.make_value_estimator(gamma=CHOICES.discount)
        self.target = SoftUpdate(self.loss, tau=CHOICES.tau)
        self.optimiser = torch.optim.Adam(self.loss.parameters(), CHOICES.rate, fused=True)
        self.replay = ReplayBuffer(storage=LazyTensorStorage(FILLED), batch_size=CHOICES.batch)
        ended = data["terminated"][:, None]
        after = {"observation": data["following"], "reward": data["reward"][:, None]}
        after |= {"terminated": ended, "done": ended}
        now = {"observation": data["observation"], "action": data["action"]}
        self.replay.extend(TensorDict(now | {"next": TensorDict(after, FILLED)}, FILLED))
        self.learn = torch.compile(self.descend) if compiled else self.descend

    def descend(self, batch: TensorDict) -> None:
        losses = self.loss(batch)
        (losses["loss_actor"] + losses["loss_qvalue"] + losses["loss_alpha"]).backward()
        self.optimiser.step()
        self.optimiser.zero_grad()

    def update(self) -> None:
        self.learn(self.replay.sample())
        self.target.step()


def learner(data: dict[str, Tensor]) -> Learner:
    made = Learner(ENCODING, ACTIONS, CHOICES, seed=0)
    before = (data[name].numpy() for name in ("observation", "action", "reward", "terminated"))
    made.remember(*before, np.zeros(FILLED, dtype=np.bool_), data["following"].numpy())
    return made


def measure(cases: dict[str, Callable[[], object]], rounds: int) -> dict[str, np.ndarray]:
    """Return wall and processor time [ms] of each update, (rounds, 2), by case."""
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in cases}
    for number in range(rounds + 5):
        for name, update in cases.items():
            wall, processor = time.perf_counter(), time.process_time()
            update()
            if number >= 5:
                spent[name].append((time.perf_counter() - wall, time.process_time() - processor))
    return {name: 1e3 * np.array(times) for name, times in spent.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--compile", action="store_true", help="also TorchRL's loss inside torch.compile")
    parser.add_argument("--quick", action="store_true", help="see that it runs; the figures mean nothing")
    chosen = parser.parse_args()
    torch.set_num_threads(chosen.threads)
    data = transitions()
    cases = {"plain": Plain(data).update, "torchrl": TorchRL(data).update, "hydro": learner(data).update}
    if chosen.compile:
        cases["compiled"] = TorchRL(data, compiled=True).update
    rounds = 3 if chosen.quick else chosen.rounds
    spent = measure(cases, rounds)
    print(
        f"PyTorch {torch.__version__}, {chosen.threads} threads, batch {CHOICES.batch}, {CHOICES.layers}; "
        f"medians of {rounds} interleaved rounds\n"
    )
    print("| update | wall, ms | processor, ms | plain's processor time / its own |\n|---|---:|---:|---:|")
    for name, times in spent.items():
        low, ratio, high = np.percentile(spent["plain"][:, 1] / times[:, 1], [25, 50, 75])
        wall, processor = np.median(times, axis=0)
        print(f"| {name} | {wall:.1f} | {processor:.1f} | {ratio:.2f} [{low:.2f}, {high:.2f}] |")


if __name__ == "__main__":
    main()
