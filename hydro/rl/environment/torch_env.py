"""TorchRL environment of a fleet: one batch of N vehicles."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from hydro.rl.environment.action import ACTIONS
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.observation import bounds
from hydro.rl.world.config import Settings

OUTCOMES = ("success", "collision", "diverged")
"""Fields of `interfaces.Info` that the environment passes on."""


class Batch(EnvBase):  # type: ignore[misc]
    """TorchRL environment of N vehicles with a fixed batch size, on CPU or GPU.

    Input: `action` (N, 6), the demanded wrench as fractions of the limits.  Output: `observation` (N, O) of O
    numbers each, and (N, 1) each: `reward`, `done`, `terminated`, `truncated`, `success`, `collision` and
    `diverged`.
    """

    batch_locked = True

    def __init__(self, settings: Settings, count: int, device: torch.device | str) -> None:
        """Declare the specs of observations, actions, rewards and ends."""
        super().__init__(device=device, batch_size=torch.Size([count]))
        low, high = (torch.from_numpy(bound).to(device).expand(count, -1) for bound in bounds(settings))
        flag = {"shape": (count, 1), "dtype": torch.bool, "device": device}
        self.observation_spec = Composite(
            observation=Bounded(low, high, dtype=torch.float32, device=device),
            **{name: Binary(1, **flag) for name in OUTCOMES},
            shape=self.batch_size,
        )
        self.action_spec = Bounded(-1.0, 1.0, shape=(count, ACTIONS), dtype=torch.float32, device=device)
        self.reward_spec = Unbounded(shape=(count, 1), dtype=torch.float32, device=device)
        ends = ("done", "terminated", "truncated")
        self.done_spec = Composite({name: Binary(1, **flag) for name in ends}, shape=self.batch_size)

    @staticmethod
    def reset_mask(tensordict: TensorDictBase | None) -> torch.Tensor | None:
        """Return the mask of vehicles to reset (N,) that TorchRL passes; None for all vehicles."""
        if tensordict is None or "_reset" not in tensordict.keys():  # noqa: SIM118  a tensordict iterates rows
            return None
        mask: torch.Tensor = tensordict["_reset"].reshape(-1)
        return mask

    def reset_output(self, observation: torch.Tensor) -> TensorDict:
        """Return the output of TorchRL's reset: observations (N, O), and flags that are all False."""
        nothing = torch.zeros(len(observation), 1, dtype=torch.bool, device=self.device)
        flags = {name: nothing.clone() for name in (*OUTCOMES, "done", "terminated", "truncated")}
        return TensorDict({"observation": observation, **flags}, self.batch_size, device=self.device)


class FleetEnv(Batch):
    """TorchRL environment of a fleet on the CPU; a vehicle whose episode has ended waits for a reset."""

    def __init__(self, fleet: Fleet) -> None:
        """Wrap a fleet; the caller sets its task and level."""
        super().__init__(fleet.settings, fleet.count, "cpu")
        self.fleet = fleet

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDict:
        """Begin the next episode of the vehicles of `_reset` (N, 1), by default of all."""
        mask = self.reset_mask(tensordict)
        return self.reset_output(torch.from_numpy(self.fleet.reset(None if mask is None else mask.numpy())))

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        """Simulate one control step."""
        step = self.fleet.step(tensordict["action"].numpy(), renew=False)
        flags = {name: getattr(step.info, name) for name in OUTCOMES}
        flags |= {"terminated": step.terminated, "truncated": step.truncated}
        flags["done"] = step.terminated | step.truncated
        return TensorDict(
            {
                "observation": torch.from_numpy(step.obs),
                "reward": torch.from_numpy(step.reward)[:, None],
                **{name: torch.from_numpy(np.asarray(flag))[:, None] for name, flag in flags.items()},
            },
            self.batch_size,
        )

    def _set_seed(self, seed: int | None) -> None:
        """Restart at the next reset, with the tasks and the noise of a seed."""
        if seed is not None:
            self.fleet.reseed(seed)
