"""Soft actor-critic (Haarnoja et al. 2018) on TorchRL, with a faster evaluation of its loss.

TorchRL holds the networks' functional parameters, the temperature, the target networks and the replay
buffer.  On two cores its `SACLoss` spends half of an update outside the matrix products: on a vmap over
critics, and on temporary tables of tensors.  `TwinLoss` is the same loss of the same parameters; a test
compares both.  It evaluates both critics in one pass and computes only the gradients that are needed.
On the processor, `training.gradients` computes the same without automatic differentiation.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torch.nn import functional
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn
from torchrl import torchrl_logger
from torchrl.data import LazyTensorStorage, ReplayBuffer
from torchrl.modules import ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import SACLoss, SoftUpdate

from hydro.core.columns import Array32, Mask
from hydro.core.errors import DataError
from hydro.rl.environment.encoding import Encoding
from hydro.rl.training.config import SACConfig
from hydro.rl.training.expert_labels import EVERY, ExpertLabels, Level, imitate
from hydro.rl.training.gradients import Gradients
from hydro.rl.training.memory import pack, unpack
from hydro.rl.training.policy import Policy, layers, median, network
from hydro.rl.training.returns import Horizon, Transition

torchrl_logger.setLevel("WARNING")


class Losses(NamedTuple):
    """Losses of an update, and quantities that describe its state; scalars.

    Attributes:
        critic: Mean squared error of both critics, summed.
        actor: Mean of alpha log pi - Q, with the policy's density pi and the smaller critic's value Q.
        temperature: log alpha times (entropy - target entropy); alpha falls while the entropy exceeds its
            target.
        alpha: Temperature.
        entropy: Entropy of the policy on the batch [nats].
        value: Mean of the smaller critic at the policy's actions.
    """

    critic: Tensor
    actor: Tensor
    temperature: Tensor
    alpha: Tensor
    entropy: Tensor
    value: Tensor


class TwinLoss(SACLoss):  # type: ignore[misc]
    """SAC loss of TorchRL with both critics in one pass, and action noise from a given generator.

    Attributes:
        target: Updater of the target networks.
    """

    def __init__(
        self,
        policy: nn.Module,
        observations: int,
        actions: int,
        config: SACConfig,
        generator: torch.Generator | None = None,
    ) -> None:
        """Make the loss and its parameters.

        Args:
            policy: Observations to mean and scale of the normal under the tanh.
            observations: Number of observations O.
            actions: Number of actions A.
            config: SAC settings.
            generator: Generator of the action noise; the global one by default.
        """
        actor = ProbabilisticActor(
            TensorDictModule(policy, ["observation"], ["loc", "scale"]),
            in_keys=["loc", "scale"],
            distribution_class=TanhNormal,
            return_log_prob=True,
        )
        critic = ValueOperator(
            layers(observations + actions, 1, config.layers, norm=config.norm),
            in_keys=["observation", "action"],
        )
        super().__init__(
            actor,
            critic,
            loss_function="l2",
            alpha_init=config.temperature,
            target_entropy=config.target_entropy,
        )
        self.make_value_estimator(gamma=config.discount)
        self._discount, self._generator = config.discount, generator
        # Assigned through __dict__, so that Module does not register these tensors a second time.
        self.__dict__["target"] = SoftUpdate(self, tau=config.tau)
        self.__dict__["_policy"] = policy
        self.__dict__["_critics"] = _leaves(self.qvalue_network_params)
        self.__dict__["_targets"] = _leaves(self.target_qvalue_network_params)

    def sample(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Return sampled actions (B, A) of the policy at observations (B, O), and their log density (B,).

        Sampling is by reparameterisation, so the result has derivatives by the policy's parameters.
        """
        mean, scale = self._policy(observations)
        noise = torch.randn(mean.shape, generator=self._generator, device=mean.device)
        latent = mean + scale * noise
        log_density = -0.5 * (noise.square() + math.log(2.0 * math.pi)) - scale.log()
        log_slope = 2.0 * (math.log(2.0) - latent - functional.softplus(-2.0 * latent))
        return latent.tanh(), (log_density - log_slope).sum(-1)

    def forward(self, batch: TensorDict) -> Losses:
        """Return the losses of a batch of B transitions.

        Args:
            batch: `observation` (B, O), `action` (B, A) and `steps_to_next_obs` (B, 1); under `next` the
                `observation`, `reward` (B, 1) and `terminated` (B, 1) after that many steps.  The value of a
                truncated episode is bootstrapped.
        """
        observations, following = batch["observation"], batch["next"]
        alpha = self.log_alpha.detach().exp()
        with torch.no_grad():
            ahead = following["observation"]
            actions, log_density = self.sample(ahead)
            value = twin(self._targets, ahead, actions).min(0).values - alpha * log_density
            discount = self._discount ** batch["steps_to_next_obs"] * ~following["terminated"]
            target = following["reward"].squeeze(-1) + discount.squeeze(-1) * value
        predicted = twin(self._critics, observations, batch["action"])
        critic = (predicted - target).square().mean(1).sum()

        actions, log_density = self.sample(observations)
        value = twin([weight.detach() for weight in self._critics], observations, actions).min(0).values
        actor = (alpha * log_density - value).mean()
        entropy = -log_density.detach().mean()
        temperature = self.log_alpha * (entropy - self.target_entropy)
        return Losses(critic, actor, temperature, alpha, entropy, value.detach().mean())


def twin(weights: Sequence[Tensor], observations: Tensor, actions: Tensor) -> Tensor:
    """Return the values of both critics (2, B) for B observations and actions.

    Args:
        weights: Weight (2, out, in) and bias (2, out) of every layer, first to last.  A normalisation after a
            layer adds its factor and its offset, (2, out) each.
        observations: (B, O).
        actions: (B, A).
    """
    first, bias, *deeper = weights
    both = functional.linear(torch.cat([observations, actions], -1), first.flatten(0, 1), bias.flatten())
    layers = list(both.chunk(2, -1))
    for weight, offset in zip(deeper[::2], deeper[1::2], strict=True):
        parts = list(zip(layers, weight.unbind(0), offset.unbind(0), strict=True))
        if weight.dim() == 2:
            layers = [functional.layer_norm(layer, layer.shape[-1:], w, b) for layer, w, b in parts]
        else:
            layers = [functional.linear(layer.relu(), w, b) for layer, w, b in parts]
    return torch.stack([layer.squeeze(-1) for layer in layers])


class Learner:
    """Soft actor-critic learner of a policy, from transitions and from the expert's labels.

    Attributes:
        network: Policy network: encoded observations to mean and standard deviation before the tanh.
        loss: SAC loss with critics and temperature.
        updates: Updates so far.
    """

    def __init__(self, encoding: Encoding, actions: int, config: SACConfig, seed: int) -> None:
        """Make the networks without changing the global random state.

        Args:
            encoding: Encoding of observations (O,) for networks and replay buffers.
            actions: Number of actions A.
            config: SAC settings.
            seed: Seed of initial weights, action noise and batches.
        """
        self.config, self.updates, self._encoding, self._actions = config, 0, encoding, actions
        self._generators = {name: _generator(seed, name) for name in ("actions", "loss", "batches")}
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.network = network(len(encoding), actions, config.layers)
            self.loss = TwinLoss(self.network, len(encoding), actions, config, self._generators["loss"])
            follow = get_ema_multi_avg_fn(1.0 - config.average)  # type: ignore[no-untyped-call]
            self._average = AveragedModel(self.network, multi_avg_fn=follow)
        self._gradients = Gradients(
            self.network, self.loss._critics, self.loss._targets, self.loss.log_alpha,
            discount=config.discount, target_entropy=config.target_entropy,
            generator=self._generators["loss"],
        )  # fmt: skip
        self._noise: Tensor | None = None
        self._optimiser = torch.optim.Adam(self.loss.parameters(), config.rate, fused=True)
        self._replay, self._shown = (
            ReplayBuffer(storage=LazyTensorStorage(config.capacity), generator=self._generators["batches"])
            for _ in range(2)
        )
        self._memories = {"done": self._replay, "shown": self._shown}
        self._labels = ExpertLabels()
        self._horizon = Horizon(config.horizon, config.discount)

    @property
    def ready(self) -> bool:
        """Whether the learner has stored any transition to learn from."""
        return len(self._replay) + len(self._shown) > 0

    @torch.no_grad()
    def act(self, observations: Array32) -> Array32:
        """Return actions (N, A) sampled from the policy at observations (N, O) in SI units.

        The noise of one vehicle is correlated from step to step by `SACConfig.correlation`.
        """
        mean, scale = self.network(torch.from_numpy(self._encoding(observations)))
        noise = torch.randn(mean.shape, generator=self._generators["actions"])
        if kept := self.config.correlation:
            if self._noise is not None:
                noise = kept * self._noise + math.sqrt(1.0 - kept * kept) * noise
            self._noise = noise
        actions: Array32 = (mean + scale * noise).tanh().numpy()
        return actions

    def explore(self, count: int) -> Array32:
        """Return `count` random actions (count, A), uniform in [-1, 1]."""
        drawn = torch.rand((count, self._actions), generator=self._generators["actions"])
        actions: Array32 = (2.0 * drawn - 1.0).numpy()
        return actions

    def best(self, observations: Array32) -> Array32:
        """Return actions (N, A) without exploration at observations (N, O) in SI units.

        The moving average of the policy acts.
        """
        return median(self._average.module, self._encoding(observations))

    def policy(self, training: Mapping[str, Any]) -> Policy:
        """Return a `Policy` with the moving average of the weights in training.

        Args:
            training: Description of the training, stored with the policy.
        """
        weights = {name: each.numpy().copy() for name, each in self._average.module.state_dict().items()}
        return Policy(self.config.layers, self._encoding, weights, training)

    def remember(
        self,
        observations: Array32,
        actions: Array32,
        rewards: Array32,
        terminated: Mask,
        truncated: Mask,
        following: Array32,
    ) -> None:
        """Store a control step of N vehicles; if the buffer is full, the oldest transition is dropped.

        The buffer holds transitions over `horizon` steps, so the newest transition starts that many steps
        back.

        Args:
            observations: Observations before the step (N, O).
            actions: Actions of the step (N, A).
            rewards: Rewards of the step (N,).
            terminated: Episodes that ended by success, collision or divergence (N,).
            truncated: Episodes that ended by time alone (N,).
            following: Observations after the step (N, O).
        """
        once, ended = np.ones(len(rewards), dtype=np.int64), terminated | truncated
        step = Transition(observations, actions, rewards, terminated, ended, following, once)
        if (made := self._horizon.add(step)) is not None:
            self._keep(made, self._replay)

    def add_demonstrations(self, steps: Iterable[Transition], level: Level) -> None:
        """Store transitions of the expert at a level in a separate buffer, and its actions as labels.

        Args:
            steps: One transition per step of N vehicles.
            level: Task and number of the level.
        """
        horizon = Horizon(self.config.horizon, self.config.discount)
        for k, step in enumerate(steps):
            if k % EVERY == 0:
                self._labels.add(level, self._encoding(step.observations), step.actions)
            if (made := horizon.add(step)) is not None:
                self._keep(made, self._shown)

    def add_labels(
        self, labels: Iterable[tuple[Array32, Array32]], level: Level, *, replace: bool = False
    ) -> None:
        """Store the expert's labels of a level, for imitation.

        Args:
            labels: Pairs of observations (N, O) and actions (N, A), one pair per step.
            level: Task and number of the level.
            replace: Whether the new labels replace earlier labels of the level.
        """
        if replace:
            self._labels.forget(level)
        for k, (observations, actions) in enumerate(labels):
            if k % EVERY == 0:
                self._labels.add(level, self._encoding(observations), actions)

    def clone(self, batches: int) -> None:
        """Train the policy to imitate all labels, and set its moving average to the result.

        Args:
            batches: Number of batches.
        """
        imitate(self.network, self._labels, batches, self._generators["batches"])
        self._average.module.load_state_dict(self.network.state_dict())

    def _keep(self, made: Transition, memory: ReplayBuffer) -> None:
        """Add transitions to a replay buffer, under TorchRL's names."""
        rows = len(made.rewards)
        after = {
            "observation": torch.from_numpy(self._encoding(made.following)),
            "reward": torch.from_numpy(made.rewards)[:, None],
            "terminated": torch.from_numpy(made.terminated)[:, None],
        }
        now = {
            "steps_to_next_obs": torch.from_numpy(made.steps)[:, None],
            "observation": torch.from_numpy(self._encoding(made.observations)),
            "action": torch.from_numpy(made.actions),
        }
        memory.extend(TensorDict(now | {"next": TensorDict(after, rows)}, rows))

    def _batch(self) -> TensorDict:
        """Draw the next batch from demonstrations and from the policy's own transitions."""
        share = self.config.demonstrated if len(self._replay) else 1.0
        shown = round(share * self.config.batch) if len(self._shown) else 0
        parts = [self._shown.sample(shown)] if shown else []
        parts += [self._replay.sample(self.config.batch - shown)] if shown < self.config.batch else []
        return torch.cat(parts) if len(parts) > 1 else parts[0]

    def update(self) -> Losses:
        """Run one update of the networks; return the losses from before the update.

        The losses of the actor are NaN in an update that leaves the actor unchanged, see `SACConfig.delay`.
        """
        losses = self._gradients(self._batch(), actor=self.updates % self.config.delay == 0)
        self._optimiser.step()
        with torch.no_grad():
            torch._foreach_lerp_(self.loss._targets, self.loss._critics, self.config.tau)
        self._average.update_parameters(self.network)
        self.updates += 1
        return Losses(*losses)

    def state(self) -> dict[str, Any]:
        """Return the complete state of the learner by name, for `torch.save`.

        Transitions are packed into bytes.
        """
        return {
            "loss": self.loss.state_dict(),
            "average": self._average.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "generators": {name: each.get_state() for name, each in self._generators.items()},
            "memories": {
                name: (pack(_transitions(memory)), memory.writer.state_dict())
                for name, memory in self._memories.items()
            },
            "advice": self._labels.state(),
            "noise": self._noise,
            "horizon": [[torch.from_numpy(part) for part in step] for step in self._horizon.state()],
            "updates": self.updates,
        }

    def load_weights(self, learnt: Mapping[str, Any]) -> None:
        """Replace policy, critics and temperature by those in the `state` of another learner.

        Args:
            learnt: Return value of `state` of the other learner.

        Raises:
            DataError: The other learner's networks have other layers.
        """
        try:
            self.loss.load_state_dict(learnt["loss"])
            self._average.load_state_dict(learnt["average"])
        except (KeyError, RuntimeError, ValueError) as error:
            raise DataError("the training to start from has other layers: give its sac.layers") from error

    def restore(self, state: dict[str, Any]) -> None:
        """Set the state that `state` of a learner with the same settings returned; continue bit for bit."""
        self.load_weights(state)
        self._optimiser.load_state_dict(state["optimiser"])
        for name, each in self._generators.items():
            each.set_state(state["generators"][name])
        for name, memory in self._memories.items():
            packed, writer = state["memories"][name]
            memory.empty()
            if transitions := unpack(packed):
                rows = len(transitions["action"])
                memory.extend(TensorDict(transitions, rows).unflatten_keys("."))
            memory.writer.load_state_dict(writer)
        self._labels.restore(state["advice"])
        self._horizon.restore([[part.numpy() for part in step] for step in state["horizon"]])
        self._noise = state["noise"]
        self.updates = state["updates"]


def _transitions(memory: ReplayBuffer) -> dict[str, Tensor]:
    """Return the content of a replay buffer."""
    transitions: dict[str, Tensor] = memory[:].flatten_keys(".").to_dict() if len(memory) else {}
    return transitions


def _leaves(parameters: Any) -> list[Tensor]:
    """Return weights and biases of a network's functional parameters, first layer to last."""
    return [tensor for _, tensor in sorted(parameters.items(True, True), key=_place)]


def _place(item: tuple[tuple[str, ...], Tensor]) -> tuple[int, bool]:
    """Return the sort key of a tensor: the number of its layer, weights before biases."""
    *_, layer, name = item[0]
    return int(layer), name != "weight"


def _generator(seed: int, name: str) -> torch.Generator:
    """Return an independent random stream for a purpose."""
    words = np.random.SeedSequence([seed, *name.encode()]).generate_state(1, np.uint64)
    return torch.Generator().manual_seed(int(words[0]))
