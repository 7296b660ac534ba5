"""Reinforcement learning: environments in this project's kernels or in MuJoCo, and policies trained in them.

Importing this package registers the environments with Gymnasium.  `gymnasium.make` imports the package that
stands before the colon of an ID, and loads the heavy modules only when it makes an environment.

    import gymnasium

    env = gymnasium.make("hydro.rl:hydro/PointToPoint-v0", condition="R_0")
    fleet = gymnasium.make_vec("hydro/Slalom-v1", num_envs=8, level=2)
"""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING, Any

from hydro.core import extras

extras.require("gymnasium", "torch", "torchrl", "tensordict")

import gymnasium  # noqa: E402

if TYPE_CHECKING:
    from hydro.rl.environment.environments import Encoded
    from hydro.rl.environment.stable_baselines import StableBaselinesEnv

__all__ = ["Encoded", "StableBaselinesEnv"]

IDS = {
    "PointToPoint-v0": "point_to_point",
    "Slalom-v1": "slalom",
    "Forest-v0": "forest",
    "StationKeeping-v0": "station_keeping",
    "Circle-v0": "circle",
    "Helix-v0": "helix",
    "Lemniscate-v0": "lemniscate",
    "Docking-v0": "docking",
    "PillarRow-v0": "pillar_row",
    "Waypoints-v0": "waypoints",
}
"""Gymnasium IDs behind the namespace `hydro/`, and the tasks that they fly (names of `rl.tasks.registry`)."""

for _id, _task in IDS.items():
    gymnasium.register(
        id=f"hydro/{_id}",
        entry_point="hydro.rl.environment.environments:Single",
        vector_entry_point="hydro.rl.environment.environments:Vector",
        kwargs={"task": _task},
        order_enforce=True,
    )


def __getattr__(name: str) -> Any:
    """Load an attribute on first access, so that registering the environments loads nothing heavy."""
    if name not in __all__:
        raise AttributeError(f"module {__name__} has no attribute {name!r}")
    if name == "StableBaselinesEnv":
        if importlib.util.find_spec("stable_baselines3") is None:
            from hydro.core.errors import UsageError

            raise UsageError("StableBaselinesEnv needs Stable-Baselines3: pip install stable-baselines3")
        from hydro.rl.environment import stable_baselines

        return getattr(stable_baselines, name)
    from hydro.rl.environment import environments

    return getattr(environments, name)
