"""Soft actor-critic on the device of the environment: networks, replay buffer and batches.

The loss and its settings are those of `training.sac`; updates are counted per control step of all vehicles.
The device waits for the host only where TorchRL asks after each step whether an episode has ended.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torch.optim.swa_utils import get_ema_multi_avg_fn
from torchrl.data import LazyTensorStorage, ReplayBuffer

from hydro.rl.environment.action import ACTIONS
from hydro.rl.environment.encoding import Encoding
from hydro.rl.environment.torch_env import Batch
from hydro.rl.gpu.returns import Horizon, Transition
from hydro.rl.training.config import SACConfig
from hydro.rl.training.policy import Policy, encoded, network
from hydro.rl.training.sac import Losses, TwinLoss

WARM_UP = 3
"""Ordinary updates before one is recorded as a graph; they create state such as the optimiser's moments."""


class Captured:
    """Update of the networks, recorded as one CUDA graph; a call runs the update on a batch.

    The graph saves the time of hundreds of kernel launches.
    """

    def __init__(
        self, work: Callable[[TensorDict], Losses], batch: TensorDict, generator: torch.Generator
    ) -> None:
        """Record an update for batches of one shape that draws from a generator, without executing it."""
        self._batch, self._graph = batch.clone(), torch.cuda.CUDAGraph()
        self._graph.register_generator_state(generator)
        with torch.cuda.graph(self._graph):
            self._losses = work(self._batch)

    def __call__(self, batch: TensorDict) -> Losses:
        """Execute the update on a batch; the next call overwrites the returned losses."""
        self._batch.copy_(batch)
        self._graph.replay()
        return self._losses


class DeviceLearner:
    """Soft actor-critic learner of a policy in a batched environment, all on one device.

    Attributes:
        env: The environment.
        steps: Control steps of all vehicles so far.
        updates: Updates of the networks so far.
    """

    def __init__(self, env: Batch, encoding: Encoding, config: SACConfig, seed: int) -> None:
        """Make the networks, and reset the environment.

        Args:
            env: Environment on any device; vehicles are reset when their episodes end.
            encoding: Encoding of observations (O,).
            config: SAC settings; `updates` counts updates per control step of all vehicles.
            seed: Seed of initial weights, action noise and batches.
        """
        self.env, self.config, self.steps, self.updates = env, config, 0, 0
        self._encoding, device = encoding, env.device
        self._scale = torch.from_numpy(encoding.scale).to(device)
        self._fades = torch.from_numpy(encoding.fades).to(device)
        self._generator = torch.Generator(device).manual_seed(seed)
        gpus = [device] if device.type == "cuda" else []
        with torch.random.fork_rng(devices=gpus), torch.device(device):
            torch.manual_seed(seed)
            self.network = network(len(encoding), ACTIONS, config.layers)
            self.loss = TwinLoss(self.network, len(encoding), ACTIONS, config, self._generator)
        self._average = copy.deepcopy(self.network)
        self._follow = get_ema_multi_avg_fn(1.0 - config.average)  # type: ignore[no-untyped-call]
        self._captured: Captured | None = None
        self._optimiser = torch.optim.Adam(
            self.loss.parameters(), config.rate, fused=True, capturable=device.type == "cuda"
        )
        self._replay = ReplayBuffer(
            storage=LazyTensorStorage(config.capacity, device=device), generator=self._generator
        )
        self._horizon = Horizon(config.horizon, config.discount)
        self._now = env.reset()

    def encoded(self, observations: Tensor) -> Tensor:
        """Return observations in SI units (..., O), scaled to network input (..., O).

        See `environment.encoding`.
        """
        return encoded(observations, self._scale, self._fades)

    @torch.no_grad()
    def advance(self) -> None:
        """Simulate one control step with actions of the policy, then run the updates of the networks."""
        seen = self._now["observation"]
        actions = self._explored(seen)
        done, self._now = self.env.step_and_maybe_reset(self._now.set("action", actions))
        after, count = done["next"], len(actions)
        self.steps += count
        step = Transition(
            seen, actions, after["reward"].squeeze(-1), after["terminated"].squeeze(-1),
            after["done"].squeeze(-1), after["observation"],
            torch.ones(count, dtype=torch.int64, device=actions.device),
        )  # fmt: skip
        if (made := self._horizon.add(step)) is not None:
            self._keep(made)
        if self.steps > self.config.random and len(self._replay):
            for _ in range(self.config.updates):
                self.update()

    def _explored(self, seen: Tensor) -> Tensor:
        """Sample actions (N, A) from the policy; uniformly from the whole range during the random phase."""
        shape, device = (len(seen), ACTIONS), seen.device
        if self.steps < self.config.random:
            return 2.0 * torch.rand(shape, generator=self._generator, device=device) - 1.0
        mean, scale = self.network(self.encoded(seen))
        noise = torch.randn(shape, generator=self._generator, device=device)
        actions: Tensor = (mean + scale * noise).tanh()
        return actions

    def _keep(self, made: Transition) -> None:
        """Add transitions to the replay buffer, under TorchRL's names."""
        after = {
            "observation": self.encoded(made.following),
            "reward": made.rewards[:, None].float(),
            "terminated": made.terminated[:, None],
        }
        now = {
            "steps_to_next_obs": made.steps[:, None],
            "observation": self.encoded(made.observations),
            "action": made.actions,
        }
        rows = len(made.rewards)
        self._replay.extend(TensorDict(now | {"next": TensorDict(after, rows)}, rows))

    def update(self) -> Losses:
        """Run one update of the networks; return the losses from before the update."""
        batch = self._replay.sample(self.config.batch)
        self.updates += 1
        if self.env.device.type != "cuda" or self.updates <= WARM_UP:
            return self._learn(batch)
        if self._captured is None:
            self._captured = Captured(self._learn, batch, self._generator)
        return self._captured(batch)

    @torch.enable_grad()
    def _learn(self, batch: TensorDict) -> Losses:
        """Take a gradient step on a batch; return the losses before it."""
        losses = self.loss(batch)
        self._optimiser.zero_grad()
        (losses.critic + losses.actor + losses.temperature).backward()
        self._optimiser.step()
        self.loss.target.step()
        with torch.no_grad():
            self._follow(list(self._average.parameters()), list(self.network.parameters()), 0)
        return Losses(*(loss.detach() for loss in losses))

    @torch.no_grad()
    def success(self, env: Batch, steps: int) -> float:
        """Return the fraction of vehicles that reach their goal in one episode each, without exploration.

        The moving average of the policy acts.

        Args:
            env: Environment of the evaluation, separate from that of the training.
            steps: Greatest number of control steps of an episode.
        """
        now = env.reset()
        going = torch.ones(env.batch_size[0], 1, dtype=torch.bool, device=env.device)
        arrived = torch.zeros_like(going)
        for _ in range(steps):
            actions = self._average(self.encoded(now["observation"]))[0].tanh()
            now = env.step(now.set("action", actions))["next"]
            arrived |= going & now["success"]
            going &= ~now["done"]
            if not going.any():
                break
        return float(arrived.float().mean())

    def policy(self, training: Mapping[str, Any]) -> Policy:
        """Return a `Policy` with the moving average of the weights in training.

        Args:
            training: Description of the training, stored with the policy.
        """
        learnt = self._average.state_dict().items()
        weights = {name: each.cpu().numpy().copy() for name, each in learnt}
        return Policy(self.config.layers, self._encoding, weights, training)
