"""Losses and gradients of soft actor-critic in closed form, without automatic differentiation.

On one processor core, recording and replaying the operations of a small network takes as long as the
operations.  Here the derivatives of the layers are written out, and the actor's part may be left out of an
update (`SACConfig.delay`).  The values and gradients are those of `training.sac.TwinLoss`; a test compares
both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from tensordict import TensorDict
from tensordict.nn.utils import biased_softplus
from torch import Tensor, nn
from torch.nn import functional

NORM_EPSILON = 1e-5
"""Constant added to the variance by a layer normalisation, PyTorch's default."""
NOT_COMPUTED = math.nan
"""Value of the actor's losses in an update that leaves the actor unchanged."""


class Values(NamedTuple):
    """Losses of an update of soft actor-critic, and quantities that describe its state; scalars.

    Attributes:
        critic: Mean squared error of both critics, summed.
        actor: Mean of alpha log pi - Q, with the policy's density pi and the smaller critic's value Q.
        temperature: Loss of alpha, the factor of the entropy.
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


class Layer(NamedTuple):
    """Parameters of a linear layer and of the layer normalisation after it, or the gradients of these.

    Attributes:
        weight: Weight of the linear layer (out, in).
        bias: Its bias (out,).
        scale: Factor of the layer normalisation (out,); None without normalisation.
        shift: Offset of the layer normalisation (out,); None without normalisation.
    """

    weight: Tensor
    bias: Tensor
    scale: Tensor | None = None
    shift: Tensor | None = None


class Passed(NamedTuple):
    """Intermediate results of a layer for B inputs.

    Attributes:
        given: Input (B, in).
        linear: Output before the normalisation (B, out).
        mean: Mean over the outputs (B, 1), if the layer is normalised.
        deviation: Inverse standard deviation over the outputs (B, 1), if the layer is normalised.
    """

    given: Tensor
    linear: Tensor
    mean: Tensor | None = None
    deviation: Tensor | None = None


class Perceptron:
    """Multilayer perceptron with ReLU and optional layer normalisation, and its derivatives."""

    def __init__(self, layers: Sequence[Layer], gradients: Sequence[Layer] = ()) -> None:
        """Take the layers, and the tensors to which `backward` writes their gradients."""
        self._layers, self._gradients = layers, gradients

    def forward(self, x: Tensor) -> tuple[Tensor, list[Passed]]:
        """Return the output (B, out) for inputs `x` (B, in), and intermediate results for `backward`."""
        passed: list[Passed] = []
        for weight, bias, scale, shift in self._layers:
            linear = torch.addmm(bias, x, weight.t())
            if scale is None:
                passed.append(Passed(x, linear))
                x = linear.relu()
            else:
                normed, mean, deviation = torch.native_layer_norm(
                    linear, bias.shape, scale, shift, NORM_EPSILON
                )
                passed.append(Passed(x, linear, mean, deviation))
                x = normed.relu_()
        return passed[-1].linear, passed

    def backward(self, passed: Sequence[Passed], back: Tensor) -> None:
        """Write the gradients of the parameters into the network's own buffers of gradients.

        Args:
            passed: Intermediate results of `forward`.
            back: Derivative of the loss with respect to the output (B, out).
        """
        for number in reversed(range(len(self._layers))):
            layer, at, gradient = self._layers[number], passed[number], self._gradients[number]
            if layer.scale is not None and gradient.scale is not None and gradient.shift is not None:
                back, scale, shift = _through_norm(layer, at, back, parameters=True)
                gradient.scale.copy_(scale)
                gradient.shift.copy_(shift)
            torch.mm(back.t(), at.given, out=gradient.weight)
            torch.sum(back, 0, out=gradient.bias)
            if number:
                back = torch.ops.aten.threshold_backward(back @ layer.weight, at.given, 0.0)

    def to_inputs(self, passed: Sequence[Passed], back: Tensor, first: int) -> Tensor:
        """Return the derivative of the loss by the inputs, without the first inputs, (B, in - first).

        Args:
            passed: Intermediate results of `forward`.
            back: Derivative of the loss with respect to the output (B, out).
            first: Number of leading inputs to leave out.
        """
        for number in reversed(range(len(self._layers))):
            layer, at = self._layers[number], passed[number]
            if layer.scale is not None:
                back = _through_norm(layer, at, back, parameters=False)[0]
            if number:
                back = torch.ops.aten.threshold_backward(back @ layer.weight, at.given, 0.0)
        return back @ self._layers[0].weight[:, first:]


def _through_norm(layer: Layer, at: Passed, back: Tensor, *, parameters: bool) -> tuple[Tensor, ...]:
    """Return the derivatives with respect to the input, scale and shift of a layer normalisation."""
    through: tuple[Tensor, ...] = torch.ops.aten.native_layer_norm_backward(
        back, at.linear, layer.bias.shape, at.mean, at.deviation, layer.scale, layer.shift,
        [True, parameters, parameters],
    )  # fmt: skip
    return through


class Sampled(NamedTuple):
    """Actions sampled for B observations, with the intermediate results that `Actor.backward` needs.

    Attributes:
        actions: Actions of A components, (B, A).
        density: Log density of the actions (B,).
        passed: Intermediate results of the layers.
        noise: Standard normal (B, A).
        scale: Standard deviation of the normal distribution before the tanh (B, A).
        biased: Argument of the softplus that gives `scale` (B, A).
    """

    actions: Tensor
    density: Tensor
    passed: list[Passed]
    noise: Tensor
    scale: Tensor
    biased: Tensor


class Actor:
    """Policy network that also computes the gradients of its parameters."""

    def __init__(self, network: nn.Module) -> None:
        """Take the layers of `training.policy.network`."""
        parts = list(network.modules())
        linear = [one for one in parts if isinstance(one, nn.Linear)]
        mapped = next(one for one in parts if isinstance(one, biased_softplus))
        self._offset, self._least = float(mapped.bias), float(mapped.min_val)
        layers = [Layer(one.weight, one.bias) for one in linear]
        gradients = [Layer(*map(torch.zeros_like, layer[:2])) for layer in layers]
        self._network = Perceptron(layers, gradients)
        self._pairs = _pairs(layers, gradients)

    def sample(self, observations: Tensor, generator: torch.Generator | None) -> Sampled:
        """Return sampled actions of the policy at B observations, with all that `backward` needs.

        Args:
            observations: Encoded observations (B, O).
            generator: Generator of the noise; None for torch's global one.
        """
        output, passed = self._network.forward(observations)
        mean, raw = output.chunk(2, -1)
        biased = raw + self._offset
        scale = functional.softplus(biased) + self._least
        noise = torch.randn(mean.shape, generator=generator)
        latent = torch.addcmul(mean, scale, noise)
        slope = 2.0 * (math.log(2.0) - latent - functional.softplus(-2.0 * latent))
        density = -0.5 * (noise.square() + math.log(2.0 * math.pi)) - scale.log() - slope
        return Sampled(latent.tanh(), density.sum(-1), passed, noise, scale, biased)

    def backward(self, sampled: Sampled, action: Tensor, density: Tensor) -> None:
        """Set the gradients (`grad`) of the policy's parameters, given derivatives of the loss.

        Args:
            sampled: Result of `sample`.
            action: Derivative of the loss with respect to the actions (B, A).
            density: Derivative of the loss with respect to each log density.
        """
        # The log density has the derivative 2 tanh(u) with respect to the latent action u, and -1 / scale
        # with respect to the scale at fixed noise and u.
        tanh = sampled.actions
        latent = action * (1.0 - tanh.square()) + 2.0 * density * tanh
        scale = latent * sampled.noise - density / sampled.scale
        self._network.backward(sampled.passed, torch.cat([latent, scale * sampled.biased.sigmoid()], -1))
        for parameter, gradient in self._pairs:
            parameter.grad = gradient

    def freeze(self) -> None:
        """Remove the gradients of the policy's parameters, so that an optimiser leaves them unchanged."""
        for parameter, _ in self._pairs:
            parameter.grad = None


class Critics:
    """Two critic networks that also compute the gradients of their parameters."""

    def __init__(self, weights: Sequence[Tensor]) -> None:
        """Take the parameters in the order of `training.sac.twin`."""
        layers = _layers(weights)
        gradients = [_mapped(torch.zeros_like, layer) for layer in layers]
        self._pairs = _pairs(layers, gradients)
        self._both = [
            Perceptron([_half(one, k) for one in layers], [_half(one, k) for one in gradients])
            for k in range(2)
        ]

    def forward(self, observations: Tensor, actions: Tensor) -> tuple[Tensor, list[list[Passed]]]:
        """Return the values of both critics (2, B), and the intermediate results of each."""
        x = torch.cat([observations, actions], -1)
        values, passed = zip(*(critic.forward(x) for critic in self._both), strict=True)
        return torch.stack([each.squeeze(-1) for each in values]), list(passed)

    def backward(self, passed: Sequence[Sequence[Passed]], values: Tensor) -> None:
        """Set the gradients (`grad`) of both critics' parameters, given derivatives of the loss.

        Args:
            passed: Intermediate results of `forward`.
            values: Derivative of the loss with respect to the values of both critics (2, B).
        """
        for critic, at, back in zip(self._both, passed, values, strict=True):
            critic.backward(at, back[:, None])
        for parameter, gradient in self._pairs:
            parameter.grad = gradient

    def to_actions(self, passed: Sequence[Sequence[Passed]], values: Tensor, observations: int) -> Tensor:
        """Return the derivative of the loss by the actions (B, A), summed over both critics.

        Args:
            passed: Intermediate results of `forward`.
            values: Derivative of the loss with respect to the values of both critics (2, B).
            observations: Number of observations, which precede the actions in the input.
        """
        both = zip(self._both, passed, values, strict=True)
        return sum(
            (critic.to_inputs(at, back[:, None], observations) for critic, at, back in both),
            torch.zeros(()),
        )


def _mapped(change: Callable[[Tensor], Tensor], layer: Layer) -> Layer:
    """Apply a function to every parameter of a layer."""
    scale, shift = (None if one is None else change(one) for one in (layer.scale, layer.shift))
    return Layer(change(layer.weight), change(layer.bias), scale, shift)


def _pairs(layers: Sequence[Layer], gradients: Sequence[Layer]) -> list[tuple[Tensor, Tensor]]:
    """Return every parameter with its gradient."""
    both = (zip(*two, strict=True) for two in zip(layers, gradients, strict=True))
    return [(one, other) for pairs in both for one, other in pairs if one is not None and other is not None]


def _layers(weights: Sequence[Tensor]) -> list[Layer]:
    """Return the layers of both critics, stacked, from their parameters."""
    found: list[Layer] = []
    for weight, bias in zip(weights[::2], weights[1::2], strict=True):
        if weight.dim() == 3:
            found.append(Layer(weight, bias))
        else:
            found[-1] = found[-1]._replace(scale=weight, shift=bias)
    return found


def _half(layer: Layer, number: int) -> Layer:
    """Return the layer of one critic."""
    return _mapped(lambda one: one.detach()[number], layer)


class Gradients:
    """Calculator of a batch's losses, which also sets the gradients of all networks' parameters."""

    def __init__(
        self,
        policy: nn.Module,
        critics: Sequence[Tensor],
        targets: Sequence[Tensor],
        log_alpha: Tensor,
        *,
        discount: float,
        target_entropy: float,
        generator: torch.Generator | None,
    ) -> None:
        """Take the networks of a `training.sac.TwinLoss`.

        Args:
            policy: Policy network.
            critics: Parameters of the critics, in the order of `training.sac.twin`.
            targets: Parameters of their target networks.
            log_alpha: Logarithm of the temperature.
            discount: gamma.
            target_entropy: Target entropy of the policy [nats].
            generator: Generator of the action noise.
        """
        self._actor = Actor(policy)
        self._critics, self._targets = Critics(critics), Critics(targets)
        self._log_alpha, self._discount, self._entropy = log_alpha, discount, target_entropy
        self._generator = generator

    @torch.no_grad()
    def __call__(self, batch: TensorDict, *, actor: bool = True) -> Values:
        """Return the losses of a batch and set the gradients.

        Args:
            batch: See `training.sac.TwinLoss.forward`.
            actor: Whether actor and temperature get gradients; without, their losses are NaN.
        """
        alpha = self._log_alpha.exp()
        critic = self._learn_values(batch, alpha)
        if not actor:
            self._actor.freeze()
            self._log_alpha.grad = None
            none = torch.tensor(NOT_COMPUTED)
            return Values(critic, none, none, alpha, none, none)
        observations = batch["observation"]
        sampled = self._actor.sample(observations, self._generator)
        values, passed = self._critics.forward(observations, sampled.actions)
        smaller, which = values.min(0)
        share = -1.0 / len(smaller)
        back = torch.zeros_like(values).scatter_(0, which[None], share)
        action = self._critics.to_actions(passed, back, observations.shape[-1])
        self._actor.backward(sampled, action, -share * alpha)
        excess = -sampled.density.mean() - self._entropy
        self._log_alpha.grad = excess.reshape(self._log_alpha.shape)
        loss = (alpha * sampled.density - smaller).mean()
        return Values(critic, loss, self._log_alpha * excess, alpha, excess + self._entropy, smaller.mean())

    def _learn_values(self, batch: TensorDict, alpha: Tensor) -> Tensor:
        """Return the loss of the critics, and set their gradients."""
        following = batch["next"]
        ahead = following["observation"]
        sampled = self._actor.sample(ahead, self._generator)
        value = self._targets.forward(ahead, sampled.actions)[0].min(0).values - alpha * sampled.density
        discount = self._discount ** batch["steps_to_next_obs"] * ~following["terminated"]
        target = following["reward"].squeeze(-1) + discount.squeeze(-1) * value
        predicted, passed = self._critics.forward(batch["observation"], batch["action"])
        error = predicted - target
        self._critics.backward(passed, error * (2.0 / error.shape[1]))
        loss: Tensor = error.square().mean(1).sum()
        return loss
