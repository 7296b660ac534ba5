"""Gymnasium environments: one vehicle (`Single`), and many as a vector environment (`Vector`).

The fleet itself ends episodes after `Task.steps` control steps; no `TimeLimit` wrapper is needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from hydro.core.columns import Array32
from hydro.core.errors import UsageError
from hydro.core.residual.lowering import TrainedModel
from hydro.core.vehicle.description import Vehicle
from hydro.io import covariance
from hydro.io import vehicle as vehicles
from hydro.io.files import bundled
from hydro.rl.environment import conditions
from hydro.rl.environment.action import ACTIONS
from hydro.rl.environment.encoding import Encoding
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.guidance import Guidance
from hydro.rl.environment.interfaces import Info
from hydro.rl.environment.observation import bounds, encoding
from hydro.rl.environment.reward import TERMS
from hydro.rl.tasks.point_to_point import PointToPoint
from hydro.rl.tasks.registry import task_of
from hydro.rl.world.choices import merged
from hydro.rl.world.config import Engine, Settings
from hydro.sim.bridge.mjcf import Integrator

if TYPE_CHECKING:
    from hydro.sim.film import Camera

VEHICLE = "auv151"
"""Default vehicle: the one of the reference paper."""


@dataclass(frozen=True)
class FleetConfig:
    """Vehicle, task and physics of a fleet: the keyword arguments of the Gymnasium environments.

    Attributes:
        task: One of `tasks.registry.TASKS`.
        level: Level of the task, its number of obstacles (`Task.levels`); the greatest by default.
        led: Whether the observed target is a point ahead on a planned path; None for the task's default,
            `Task.guided`.
        vehicle: A vehicle, the path of its file, or the name of a bundled vehicle.
        condition: One of `conditions.CONDITIONS`.
        model: Residual model, for the conditions that have one.
        conditioning: Preset that limits the wrench of the residual model.
        settings: All other choices, or those that differ from the defaults, in nested mappings or by dotted
            name: `{"task": {"steps": 200}}` or `{"task.steps": 200}`.
        engine: Simulator, `kernels` or `mujoco`; by default that of the settings.
        integrator: Integrator.  The kernels have `rk4` alone; MuJoCo has those of `sim.bridge.mjcf`.  Case
            does not matter; by default that of the settings.
        threads: Number of threads.
    """

    task: str = PointToPoint.name
    level: int | None = None
    led: bool | None = None
    vehicle: Vehicle | str | Path = VEHICLE
    condition: str = conditions.EFFECTS
    model: TrainedModel | None = None
    conditioning: str = "paper"
    settings: Settings | Mapping[str, Any] = field(default_factory=Settings)
    engine: str | None = None
    integrator: str | None = None
    threads: int = 1

    @classmethod
    def of(cls, choices: Mapping[str, Any]) -> FleetConfig:
        """Return a config with the values given by field name in `choices`; other fields keep their defaults.

        Raises:
            UsageError: A name is no field of the config.
        """
        known = [each.name for each in fields(cls)]
        for name in choices:
            if name not in known:
                raise UsageError(f"no keyword is called {name!r}: choose one of {', '.join(known)}")
        return cls(**choices)

    def all_settings(self) -> Settings:
        """Return the settings of the fleet, with the config's own engine and integrator if given.

        Raises:
            UsageError: A setting, the engine or the integrator does not exist.
        """
        given = self.settings
        settings = given if isinstance(given, Settings) else merged(Settings(), given)
        if self.engine is not None:
            settings = replace(settings, engine=cast(Engine, self.engine))
        if self.integrator is None:
            return settings
        asked = self.integrator.lower()
        if settings.engine == "kernels" and asked == "rk4":
            return settings
        if settings.engine == "kernels":
            raise UsageError(
                f"integrator {self.integrator!r}: the kernels have rk4 alone; choose engine='mujoco'"
            )
        if asked not in get_args(Integrator):
            raise UsageError(
                f"integrator {self.integrator!r}: choose one of {', '.join(get_args(Integrator))}"
            )
        return replace(settings, physics=replace(settings.physics, integrator=cast(Integrator, asked)))


def make_fleet(config: FleetConfig | None = None, *, count: int = 1, seed: int = 0) -> Fleet:
    """Return a new fleet of vehicles with a task.

    Args:
        config: Vehicle, task and physics; by default point to point in open water.
        count: Number of vehicles.
        seed: Seed of tasks and noise.

    Raises:
        DataError: The vehicle cannot be read or simulated.
        UsageError: The task, level or condition does not exist.
    """
    config = config or FleetConfig()
    settings, vehicle = config.all_settings(), config.vehicle
    known = vehicle if isinstance(vehicle, Vehicle) else vehicles.read(_file(vehicle))[0]
    condition = conditions.Condition(config.condition, config.model, config.conditioning)
    plant = conditions.plant(condition, known, settings, count, threads=config.threads)
    estimates = None
    if settings.randomise.posterior and not isinstance(vehicle, Vehicle):
        estimates, _ = covariance.read(_file(vehicle), known)
    fleet = Fleet(settings, plant, seed, Guidance(settings, count), estimates=estimates)
    task = task_of(config.task)
    fleet.set_level(task, task.most if config.level is None else config.level, led=config.led)
    return fleet


def _file(vehicle: str | Path) -> Path:
    """Return the path of a vehicle file, given its path or the name of a bundled vehicle."""
    known = bundled("vehicles") / f"{vehicle}.toml"
    return known if known.is_file() else Path(vehicle)


def single_spaces(settings: Settings) -> tuple[spaces.Box, spaces.Box]:
    """Return the Gymnasium spaces of one vehicle: of observations in SI units (O,), and of actions (6,)."""
    low, high = bounds(settings)
    return spaces.Box(low, high, dtype=np.float32), spaces.Box(-1.0, 1.0, (ACTIONS,), np.float32)


def encoded_space(space: spaces.Box, code: Encoding) -> spaces.Box:
    """Return the Gymnasium space that observations have after their encoding.

    Args:
        space: Space of observations in SI units.
        code: Encoding.
    """
    ends = np.sort([code(space.low.copy()), code(space.high.copy())], axis=0)
    return spaces.Box(*ends, dtype=np.float32)


class Single(gymnasium.Env):  # type: ignore[misc]
    """Gymnasium environment with one vehicle.

    `info` holds the fields of `interfaces.Info`, with `reward_terms` as a dict by name (`reward.TERMS`).
    `rl.environment.observation` describes the observations.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 25}  # noqa: RUF012

    def __init__(
        self, task: str = PointToPoint.name, *, render_mode: str | None = None, **choices: Any
    ) -> None:
        """Make the environment from the fields of `FleetConfig`; `reset` takes the seed.

        Raises:
            UsageError: The render mode does not exist.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise UsageError(f"render_mode {render_mode!r}: choose 'rgb_array', or none")
        self.render_mode, self._choices = render_mode, choices | {"task": task}
        self.fleet = make_fleet(FleetConfig.of(self._choices))
        self.metadata = {**self.metadata, "render_fps": round(1.0 / self.fleet.settings.period)}
        self.observation_space, self.action_space = single_spaces(self.fleet.settings)
        self._begun = False
        self._camera: Camera | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array32, dict[str, Any]]:
        """Begin the next episode; if a seed is given, begin the first episode of that seed.

        Args:
            seed: Seed of tasks and noise; None continues with the next episode.
            options: Not used.

        Returns:
            Observation (O,), and an empty dict.
        """
        super().reset(seed=seed)
        restart = seed is not None or not self._begun
        self._begun = True
        return self.fleet.reset(seed=_draw(self.np_random) if restart else None)[0], {}

    def step(self, action: ArrayLike) -> tuple[Array32, float, bool, bool, dict[str, Any]]:
        """Simulate one control step.

        Args:
            action: Demanded wrench (6,), as fractions of the greatest on each axis, clipped to [-1, 1].

        Returns:
            Observation (O,), reward, whether the episode terminated, whether it was truncated, and `info`.

        Raises:
            ResetNeeded: `reset` was not called before.
        """
        _require_reset(self._begun)
        done = self.fleet.step(np.asarray(action)[None], renew=False)
        info = {name: values[0].item() for name, values in done.info._asdict().items() if values.ndim == 1}
        info["reward_terms"] = dict(zip(TERMS, done.info.reward_terms[0].tolist(), strict=True))
        return (
            done.obs[0],
            float(done.reward[0]),
            bool(done.terminated[0]),
            bool(done.truncated[0]),
            info,
        )

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture of the vehicle in its tank from behind and above, (height, width, 3), RGB.

        None without `render_mode`.

        Raises:
            UsageError: Rendering is not available.
        """
        if self.render_mode is None:
            return super().render()  # type: ignore[no-any-return]
        from hydro.sim.film import Camera, Room

        fleet, world = self.fleet, self.fleet.settings.world
        if self._camera is None:
            room = Room((world.length, world.width, world.depth), world.pillars, world.pillar_radius)
            self._camera = Camera(fleet.plant.vehicle, room)
        standing = fleet.pillars[0][np.isfinite(fleet.pillars[0]).all(axis=1)]
        return self._camera.picture(fleet.plant.pose[0], standing, fleet.targets[0])

    def close(self) -> None:
        """Release the camera of `render`, if there is one."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the construction arguments and the state; a copy continues bit for bit."""
        made = partial(Single, **self._choices, render_mode=self.render_mode)
        return made, (), (self._begun, self._np_random, self._np_random_seed, self.fleet.state())

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Restore the state of the pickled environment."""
        self._begun, self._np_random, self._np_random_seed, fleet = state
        self.fleet.restore(fleet)


class Vector(gymnasium.vector.VectorEnv):  # type: ignore[misc]
    """Gymnasium vector environment of N vehicles.

    `autoreset_mode` selects when the next episode begins.  NEXT_STEP, the default, as in Gymnasium: in the
    step after the end, which ignores its action and has reward 0.  SAME_STEP: in the step that ends the last
    one.  DISABLED: when `reset` names the vehicle in its `reset_mask`.  `info` is that of `Single`, with
    arrays (N,).
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        num_envs: int = 8,
        task: str = PointToPoint.name,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **choices: Any,
    ) -> None:
        """Make the environment from the fields of `FleetConfig`; `reset` takes the seed.

        Raises:
            UsageError: A render mode is given, or a keyword does not exist.
        """
        if render_mode is not None:
            raise UsageError(
                f"render_mode {render_mode!r}: many vehicles are not drawn; make one with gymnasium.make"
            )
        self.render_mode = None
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self._mode}
        self.fleet = make_fleet(FleetConfig.of(choices | {"task": task}), count=num_envs)
        self.num_envs = num_envs
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._choices = choices | {"task": task, "num_envs": num_envs, "autoreset_mode": self._mode.value}
        self.single_observation_space, self.single_action_space = single_spaces(self.fleet.settings)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._begun = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array32, dict[str, Any]]:
        """Begin the next episode of each selected vehicle, or the first episodes of a given seed.

        `options["reset_mask"]` selects the vehicles (N,); by default all.

        Args:
            seed: One seed of tasks and noise for all vehicles; None continues with the next episodes.
            options: Dict with `reset_mask`, or None.

        Returns:
            Observations of all vehicles (N, O), and an empty dict.

        Raises:
            UsageError: A seed is given per vehicle, or together with a mask.
        """
        mask = None if options is None else options.get("reset_mask")
        if seed is not None and (not isinstance(seed, int | np.integer) or mask is not None):
            raise UsageError("one seed serves all vehicles of a fleet together; give one number and no mask")
        super().reset(seed=None if seed is None else int(seed))
        restart = seed is not None or not self._begun
        self._begun = True
        new_seed = _draw(self.np_random) if restart else None
        which = np.ones(self.num_envs, np.bool_) if mask is None else np.asarray(mask, dtype=np.bool_)
        self._ended[which] = False
        return self.fleet.reset(which, new_seed), {}

    def step(
        self, actions: ArrayLike
    ) -> tuple[Array32, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Simulate one control step of all vehicles.

        Args:
            actions: Demanded wrenches (N, 6), as shares of the greatest on each axis, clipped to [-1, 1].

        Returns:
            Observations (N, O), rewards (N,), masks of terminated and of truncated episodes (N,), and
            `info`.  In SAME_STEP mode `info` also has the `final_obs` and `final_info` of the episodes that
            ended.

        Raises:
            ResetNeeded: `reset` was not called before.
        """
        _require_reset(self._begun)
        same, before = self._mode is AutoresetMode.SAME_STEP, self._ended
        step = self.fleet.step(actions, renew=same)
        info = named(step.info)
        self._ended = step.terminated | step.truncated
        if same and self._ended.any():
            info |= {"final_obs": step.final_obs, "_final_obs": self._ended}
            info |= {"final_info": named(step.info), "_final_info": self._ended}
        seen, reward = step.obs, step.reward.astype(np.float64)
        if self._mode is AutoresetMode.NEXT_STEP and before.any():
            seen, reward[before] = self.fleet.reset(before), 0.0
            for flags in (step.terminated, step.truncated, self._ended):
                flags[before] = False
        return seen, reward, step.terminated, step.truncated, info

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the construction arguments and the state, as `Single` does."""
        where = (self._begun, self._np_random, self._np_random_seed, self._ended, self.fleet.state())
        return partial(Vector, **self._choices), (), where

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Restore the state of the pickled environment."""
        self._begun, self._np_random, self._np_random_seed, self._ended, fleet = state
        self.fleet.restore(fleet)


class Encoded(gymnasium.ObservationWrapper):  # type: ignore[misc]
    """Gymnasium wrapper that scales observations to the input that policies of `hydro rl` see.

    It is for learners that do not scale observations themselves; see `rl.environment.encoding`.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        """Wrap an environment with one vehicle."""
        super().__init__(env)
        self._encoding = encoding(env.unwrapped.fleet.settings)
        self.observation_space = encoded_space(env.observation_space, self._encoding)

    def observation(self, observation: Array32) -> Array32:
        """Return an observation in SI units (O,) as the scaled input of a policy (O,)."""
        return self._encoding(observation)


def named(info: Info) -> dict[str, Any]:
    """Return the outcome of a control step as a dict by name, with `reward_terms` as a dict by term.

    Values are arrays (N,), one entry per vehicle.
    """
    terms = dict(zip(TERMS, info.reward_terms.T, strict=True))
    return info._asdict() | {"reward_terms": terms}


def _require_reset(begun: bool) -> None:
    """Raise `ResetNeeded` if no episode has begun."""
    if not begun:
        raise ResetNeeded("no episode has begun: call reset() before step()")


def _draw(rng: np.random.Generator) -> int:
    """Draw a seed for a fleet."""
    return int(rng.integers(2**31))
