"""Reinforcement learning on the student: environments, and policies trained in them.

Importing this registers the environments with Gymnasium; `gymnasium.make` loads what they need, and imports
what stands before a colon.

    import gymnasium

    env = gymnasium.make("hydro.rl:hydro/PointToPoint-v0", condition="R_0")
    fleet = gymnasium.make_vec("hydro/Slalom-v0", num_envs=8, level=4)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from hydro.rl.environment.environments import Encoded

__all__ = ["Encoded"]

for _name, _stage in (("PointToPoint", 1), ("Slalom", 2), ("Guided", 3)):
    gymnasium.register(
        id=f"hydro/{_name}-v0",
        entry_point="hydro.rl.environment.environments:Single",
        vector_entry_point="hydro.rl.environment.environments:Vector",
        kwargs={"stage": _stage},
        order_enforce=True,
    )


def __getattr__(name: str) -> Any:
    """Load what was asked for: registering alone loads nothing heavy."""
    if name not in __all__:
        raise AttributeError(f"module {__name__} has no attribute {name!r}")
    from hydro.rl.environment import environments

    return getattr(environments, name)
