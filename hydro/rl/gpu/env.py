"""TorchRL environment of a GPU fleet: all its tensors stay on the device."""

from __future__ import annotations

from typing import Any

from tensordict import TensorDict, TensorDictBase

from hydro.rl.environment.blocks import ARRIVED, DIVERGED, TERMINATED, TOUCHED, TRUNCATED
from hydro.rl.environment.torch_env import OUTCOMES, Batch
from hydro.rl.gpu.fleet import GpuFleet

FLAGS = {**dict(zip(OUTCOMES, (ARRIVED, TOUCHED, DIVERGED), strict=True)),
         "terminated": TERMINATED, "truncated": TRUNCATED}  # fmt: skip


class GpuEnv(Batch):
    """TorchRL environment on the GPU; after its episode a vehicle waits for a reset, see `Batch`."""

    def __init__(self, fleet: GpuFleet) -> None:
        """Wrap a fleet."""
        super().__init__(fleet.settings, fleet.count, fleet.device)
        self.fleet = fleet

    def _reset(self, tensordict: TensorDictBase | None = None, **_: Any) -> TensorDict:
        """Begin the next episode of the vehicles of `_reset` (N, 1), by default of all."""
        return self.reset_output(self.fleet.reset(self.reset_mask(tensordict)).clone())

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        """Simulate one control step."""
        fleet = self.fleet
        seen = fleet.step(tensordict["action"]).clone()
        flags = {name: fleet.flags[row, :, None].clone() for name, row in FLAGS.items()}
        flags["done"] = flags["terminated"] | flags["truncated"]
        output = {"observation": seen, "reward": fleet.reward[:, None].clone(), **flags}
        return TensorDict(output, self.batch_size, device=self.device)

    def _set_seed(self, seed: int | None) -> None:
        """Set the seed of the sensor noise; the scenes of the fleet do not change."""
        if seed is not None:
            self.fleet.reseed(seed)
