"""Vector environment of Stable-Baselines3 around a fleet: all vehicles in one call per step."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env.base_vec_env import VecEnv

from hydro.core.columns import Array32, Mask
from hydro.rl.environment.environments import FleetConfig, encoded_space, make_fleet, named, single_spaces
from hydro.rl.environment.interfaces import Info
from hydro.rl.environment.observation import encoding
from hydro.rl.tasks.point_to_point import PointToPoint

Indices = None | int | Iterable[int]


class StableBaselinesEnv(VecEnv):
    """Fleet as a vector environment of Stable-Baselines3.

    Observations are encoded as for the policies of `hydro rl`, unless `encoded` is False.  The next episode
    begins in the step that ends the last one; the infos of that step have `terminal_observation`,
    `TimeLimit.truncated` and `episode`, as Stable-Baselines3 expects, and the fields of `interfaces.Info`.
    Other steps have empty infos, because dictionaries for every vehicle take longer than its physics.
    """

    def __init__(
        self,
        num_envs: int = 8,
        task: str = PointToPoint.name,
        *,
        seed: int = 0,
        encoded: bool = True,
        render_mode: None = None,
        **choices: Any,
    ) -> None:
        """Make the environment from the fields of `FleetConfig`.

        Args:
            num_envs: Number of vehicles.
            task: One of `tasks.registry.TASKS`.
            seed: Seed of tasks and noise, until `seed` sets another.
            encoded: Whether observations are encoded.
            render_mode: None; vehicles of a fleet are not drawn.
            choices: Other fields of `FleetConfig`.
        """
        self.fleet = make_fleet(FleetConfig.of(choices | {"task": task}), count=num_envs, seed=seed)
        self._encoding = encoding(self.fleet.settings) if encoded else None
        self._restart: int | None = seed
        self._actions: NDArray[Any] = np.zeros((num_envs, 0))
        self.render_mode = render_mode
        space, actions = single_spaces(self.fleet.settings)
        super().__init__(num_envs, encoded_space(space, self._encoding) if self._encoding else space, actions)

    def reset(self) -> Array32:
        """Begin the next episode of all vehicles; return observations (N, O)."""
        given = self._seeds[0]
        self._restart = given if given is not None else self._restart
        seen = self.fleet.reset(seed=self._restart)
        self._restart = None
        self.reset_infos = [{} for _ in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return self._seen(seen)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions (N, 6) for the next call of `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Array32, Array32, Mask, list[dict[str, Any]]]:
        """Simulate one control step of all vehicles.

        Returns:
            Observations (N, O), of the new episode where one ended; rewards (N,); a mask of the episodes that
            ended (N,); and a dict for each vehicle, empty unless its episode ended.
        """
        step = self.fleet.step(self._actions)
        done = step.terminated | step.truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if done.any():
            last = self._seen(step.final_obs)
            for k in map(int, np.flatnonzero(done)):
                infos[k] = _ending(step.info, k)
                infos[k] |= {"terminal_observation": last[k], "TimeLimit.truncated": bool(step.truncated[k])}
        return self._seen(step.obs), step.reward, done, infos

    def _seen(self, observations: Array32) -> Array32:
        """Return observations as the learner gets them."""
        return self._encoding(observations) if self._encoding else observations

    def close(self) -> None:
        """Do nothing: a fleet holds no resources."""

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Return a list with the same attribute of the environment for each index.

        Args:
            attr_name: Name of the attribute.
            indices: Indices of vehicles; None for all.
        """
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set an attribute of the environment, which all vehicles share.

        Args:
            attr_name: Name of the attribute.
            value: Its new value.
            indices: Not used.
        """
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method of the environment once; return a list with its result for each index.

        Args:
            method_name: Name of the method.
            method_args: Its positional arguments.
            indices: Indices of vehicles; None for all.
            method_kwargs: Its keyword arguments.
        """
        found = getattr(self, method_name)(*method_args, **method_kwargs)
        return [found for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: Indices = None) -> list[bool]:
        """Return False for each index: no vehicle has a wrapper of its own."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Return None for each vehicle: vehicles of a fleet are not drawn."""
        return [None for _ in range(self.num_envs)]


def _ending(info: Info, k: int) -> dict[str, Any]:
    """Return the fields of the info of vehicle `k`, with its episode in the form of `Monitor`."""
    by_name = named(info)
    terms = {name: float(values[k]) for name, values in by_name.pop("reward_terms").items()}
    found = {name: values[k].item() for name, values in by_name.items()}
    episode = {"r": found["episode_return"], "l": found["episode_length"], "t": 0.0}
    return found | {"reward_terms": terms, "episode": episode}
