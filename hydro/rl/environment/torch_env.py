"""The fleet as TorchRL knows environments: one batch of N vehicles, on the processor."""

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

OUTCOMES = ("success", "collision", "diverged")
"""Entries of `fleet.Info` that are passed on."""


class FleetEnv(EnvBase):  # type: ignore[misc]
    """Vehicles of a fleet as a locked batch; episodes that have ended wait for a reset.

    Read are `action` (N, 6); written `observation` (N, O), `reward`, `done`, `terminated` and `truncated`
    (N, 1), and `success`, `collision` and `diverged` (N, 1).
    """

    batch_locked = True

    def __init__(self, fleet: Fleet) -> None:
        """Wrap a fleet; its task and level stay its own."""
        super().__init__(device="cpu", batch_size=torch.Size([fleet.count]))
        self.fleet = fleet
        count = fleet.count
        low, high = (torch.from_numpy(bound).expand(count, -1) for bound in bounds(fleet.settings))
        flag = {"shape": (count, 1), "dtype": torch.bool}
        self.observation_spec = Composite(
            observation=Bounded(low, high, dtype=torch.float32),
            **{name: Binary(1, **flag) for name in OUTCOMES},
            shape=self.batch_size,
        )
        self.action_spec = Bounded(-1.0, 1.0, shape=(count, ACTIONS), dtype=torch.float32)
        self.reward_spec = Unbounded(shape=(count, 1), dtype=torch.float32)
        ends = ("done", "terminated", "truncated")
        self.done_spec = Composite({name: Binary(1, **flag) for name in ends}, shape=self.batch_size)

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDict:
        """Begin the next episode of the vehicles of `_reset` (N, 1), of all by default."""
        mask = None
        if tensordict is not None and "_reset" in tensordict.keys():  # noqa: SIM118  a tensordict iterates rows
            mask = tensordict["_reset"].reshape(-1).numpy()
        observation = self.fleet.reset(mask)
        nothing = torch.zeros(self.fleet.count, 1, dtype=torch.bool)
        silent = {name: nothing.clone() for name in (*OUTCOMES, "done", "terminated", "truncated")}
        return TensorDict({"observation": torch.from_numpy(observation), **silent}, self.batch_size)

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        """Fly one control step."""
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
        """Begin anew at the next reset, with the tasks and the noise of a seed."""
        if seed is not None:
            self.fleet.reseed(seed)
