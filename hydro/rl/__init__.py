"""Reinforcement learning on the student: environments, and policies trained in them.

Importing this registers the environments with Gymnasium; `gymnasium.make` loads what they need.

    import gymnasium
    import hydro.rl

    env = gymnasium.make("hydro/PointToPoint-v0", condition="R_0")
    fleet = gymnasium.make_vec("hydro/Slalom-v0", num_envs=8, level=4)
"""

from __future__ import annotations

import gymnasium

for _name, _stage in (("PointToPoint", 1), ("Slalom", 2), ("Guided", 3)):
    gymnasium.register(
        id=f"hydro/{_name}-v0",
        entry_point="hydro.rl.environment.environments:Single",
        vector_entry_point="hydro.rl.environment.environments:Vector",
        kwargs={"stage": _stage},
        order_enforce=True,
    )
