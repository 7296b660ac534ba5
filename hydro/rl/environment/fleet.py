"""Episodes of many vehicles at once: the batched core below every interface of the environment.

A control step is one call into the plant and two into compiled code, whatever the number of vehicles.  A
vehicle whose episode ends begins its next one within the same step.
"""

from __future__ import annotations

import json
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydro.core.columns import Array, Array32, Mask
from hydro.core.effects import inertia_matrix
from hydro.core.errors import DataError
from hydro.core.vehicle.control_allocation import mixing
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import quaternion_from_euler
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.rl.environment import geometry, observation, reward, tasks
from hydro.rl.environment.action import ACTIONS, command_kernel
from hydro.rl.environment.blocks import (
    AGE,
    ENERGY,
    FLAGS,
    OVERSPEED,
    RETURN,
    TOTALS,
    Episodes,
    Motion,
    Outcome,
    Rules,
    Scenes,
)
from hydro.rl.environment.config import Settings
from hydro.rl.environment.observation import OBSERVATIONS
from hydro.rl.environment.step import sense_kernel, step_kernel
from hydro.sim.plant import Plant

State = dict[str, NDArray[np.generic]]


class Guidance(Protocol):
    """What leads the vehicles of stage 3 along a path."""

    def reset(self, mask: Mask, starts: Array, goals: Array, pillars: Array) -> None:
        """Plan anew for some vehicles (N,): starts and goals (N, 3), NED, pillars (N, P, 2)."""

    def targets(self, mask: Mask, positions: Array) -> tuple[Array, Array]:
        """Points to swim to (N, 3) and weighted costs of being off the path (N,), at positions (N, 3).

        Called once per control step; rows outside the mask (N,) neither advance nor are read.
        """

    def state(self) -> State:
        """Everything that the future depends on."""

    def restore(self, state: State) -> None:
        """Go back to a state, bit for bit."""


class Info(NamedTuple):
    """What happened to every vehicle in a step, (N,) each.

    The totals are of the episode up to and with this step; where it ends here they are final.

    Attributes:
        success: It arrived.
        collision: It touched something or broke the surface.
        diverged: The simulation raised a warning, or its state is not finite.
        distance: To the goal, at the end of the step [m].
        overspeed: It moved faster than `Settings.overspeed`.
        episode_return: Sum of rewards.
        episode_length: Steps.
        episode_energy: Time of all thrusters at full thrust that would have taken the same energy [s].
        episode_overspeed: Steps faster than `Settings.overspeed`.
    """

    success: Mask
    collision: Mask
    diverged: Mask
    distance: Array
    overspeed: Mask
    episode_return: Array
    episode_length: NDArray[np.int64]
    episode_energy: Array
    episode_overspeed: NDArray[np.int64]


class Step(NamedTuple):
    """The outcome of a step of all vehicles.

    Attributes:
        obs: Observations to act on next (N, 36): of the new episode where one ended.
        reward: (N,).
        terminated: Success, collision or divergence, (N,).
        truncated: The last step of an episode that ended by time alone, (N,).
        final_obs: Observations of the states that the step led to (N, 36), before any new episode.
        info: More.
    """

    obs: Array32
    reward: Array32
    terminated: Mask
    truncated: Mask
    final_obs: Array32
    info: Info


class Fleet:
    """Vehicles that learn side by side.

    Attributes:
        settings: All choices.
        plant: What they fly in.
        count: Number of vehicles N.
        stage: Stage of episodes that begin from now on, 1 to 3.
        level: Their number of pillars.
        starts: Start of every vehicle's episode (N, 3), NED.
        goals: Its goal (N, 3).
        pillars: Axes of its pillars (N, P, 2), NaN where there is none.
        targets: What it is to swim to (N, 3): the goal, or in stage 3 a point ahead on the path.
        guidance: What leads it there, if anything.
    """

    def __init__(
        self, settings: Settings, plant: Plant, seed: int = 0, guidance: Guidance | None = None
    ) -> None:
        """Make a fleet of all vehicles of a plant, in stage 1; `reset` begins.

        Args:
            settings: All choices.
            plant: What the vehicles fly in, with the control step of the settings.
            seed: Of tasks and noise.
            guidance: For stage 3.
        """
        crew = mixing(plant.vehicle, mass_matrix(plant.vehicle) + inertia_matrix(plant.vehicle))
        self.settings, self.plant, self.seed, self.guidance = settings, plant, seed, guidance
        self.count, self.stage, self.level = len(plant.pose), tasks.POINT_TO_POINT, 0
        self._mixing = crew.allocation, crew.table, crew.authority
        self._senses = observation.senses(settings, plant.vehicle)
        self._rules = _rules(settings, plant.vehicle, crew.table)
        self._noise = _generator(seed)
        self._make_arrays()

    def _make_arrays(self) -> None:
        """Arrays of every vehicle, and the blocks of them that the kernels take."""
        count, plant = self.count, self.plant
        self.starts, self.goals, self.targets = (np.zeros((count, 3)) for _ in range(3))
        self.pillars = np.full((count, self.settings.world.pillars, 2), np.nan)
        self._stages = np.ones(count, dtype=np.int64)
        self._episode = np.full(count, -1, dtype=np.int64)
        self._before = np.zeros((count, ACTIONS))
        self._distance, self._path_cost, self._least = np.zeros(count), np.zeros(count), np.zeros(count)
        self._rotation, self._totals = np.zeros((count, 9)), np.zeros((count, TOTALS))
        self._seen = np.zeros((count, OBSERVATIONS), dtype=np.float32)
        self._commands, self._all = np.zeros_like(plant.thrust), np.ones(count, dtype=np.bool_)
        self._motion = Motion(
            plant.pose, plant.velocity, plant.specific_force, plant.thrust, plant.diverged, self._rotation
        )
        self._scenes = Scenes(self._stages, self.goals, self.targets, self.pillars, self._path_cost)
        self._episodes = Episodes(self._least, self._before, self._distance, self._totals)

    def set_level(self, stage: int, level: int = 0) -> None:
        """Choose stage and number of pillars of the episodes that begin from now on.

        Raises:
            UsageError: There is no such stage or level, or stage 3 is asked for without guidance.
        """
        tasks.require_level(self.settings, stage, level, guided=self.guidance is not None)
        self.stage, self.level = stage, level

    def reset(self, mask: Mask | None = None, seed: int | None = None) -> Array32:
        """Begin the next episode of some vehicles.

        Args:
            mask: Which (N,); all by default.
            seed: Begin anew with the tasks and the noise of this seed.

        Returns:
            Observations of all vehicles (N, 36), those of the others as they were.
        """
        if seed is not None:
            self.reseed(seed)
        self._begin(self._all if mask is None else mask)
        return self._seen.copy()

    def reseed(self, seed: int) -> None:
        """Let the next episode of every vehicle be the first one of a seed."""
        self.seed, self._noise = seed, _generator(seed)
        self._episode[:] = -1

    def step(self, actions: ArrayLike, *, renew: bool = True) -> Step:
        """Fly one control step.

        Args:
            actions: Demands (N, 6), clipped to [-1, 1].
            renew: Whether vehicles whose episode ends begin their next one at once; else it is for the caller
                to `reset` them.

        Raises:
            DataError: The actions are of another shape, or not numbers.
        """
        demands = np.array(actions, dtype=np.float64)
        if demands.shape != self._before.shape:
            raise DataError(f"actions: expected shape {self._before.shape}, got {demands.shape}")
        if not command_kernel(*self._mixing, demands, np.empty(ACTIONS), self._commands):
            raise DataError("actions: some are not finite; look at what the policy saw")
        self.plant.step(self._commands)

        self._observe(self._all)
        final = self._seen.copy()
        outcome = Outcome(
            np.empty(self.count, dtype=np.float32), np.empty((FLAGS, self.count), dtype=np.bool_)
        )
        step_kernel(self._rules, self._motion, self._scenes, self._episodes, demands, outcome)
        success, collision, diverged, overspeed, terminated, truncated = outcome.flags
        counted = self._totals.astype(np.int64)
        info = Info(
            success, collision, diverged, self._distance.copy(), overspeed, self._totals[:, RETURN].copy(),
            counted[:, AGE], self._totals[:, ENERGY].copy(), counted[:, OVERSPEED],
        )  # fmt: skip
        done = terminated | truncated
        following = final
        if renew and done.any():
            self._begin(done)
            following = self._seen.copy()
        return Step(following, outcome.reward, terminated, truncated, final, info)

    def _begin(self, mask: Mask) -> None:
        """Begin the next episode of some vehicles."""
        pose, velocity = np.zeros((self.count, 7)), np.zeros((self.count, 6))
        self._episode[mask] += 1
        for k in np.flatnonzero(mask):
            scene = tasks.scene(
                self.settings, self.stage, self.level, self.seed, int(k), int(self._episode[k])
            )
            self.starts[k], self.goals[k], self.pillars[k] = scene.start, scene.goal, scene.pillars
            pose[k, :3], pose[k, 3:] = scene.start, quaternion_from_euler(0.0, 0.0, scene.heading)
        self.plant.reset(mask, pose, velocity)
        self._stages[mask] = self.stage
        self._before[mask], self._totals[mask] = 0.0, 0.0
        self._distance[mask] = np.linalg.norm(self.starts[mask] - self.goals[mask], axis=1)
        self.targets[mask], self._path_cost[mask] = self.goals[mask], 0.0
        guided = mask & (self._stages == tasks.GUIDED)
        if self.guidance is not None and guided.any():
            self.guidance.reset(guided, self.starts, self.goals, self.pillars)
        self._observe(mask)

    def _observe(self, mask: Mask) -> None:
        """Renew what some vehicles see, with noise and under guidance."""
        guided = mask & (self._stages == tasks.GUIDED)
        if self.guidance is not None and guided.any():
            ahead, cost = self.guidance.targets(guided, self.plant.pose[:, :3])
            self.targets[guided], self._path_cost[guided] = ahead[guided], cost[guided]
        noise = self._noise.standard_normal((self.count, OBSERVATIONS))
        sense_kernel(mask, self._senses, self._motion, self._scenes, noise, self._least, self._seen)

    def state(self) -> State:
        """Everything that the future depends on, as arrays; see `restore`."""
        parts = {f"fleet/{name}": np.array(getattr(self, name)) for name in _STATE}
        parts |= {f"plant/{name}": value for name, value in self.plant.snapshot().items()}
        if self.guidance is not None:
            parts |= {f"guidance/{name}": value for name, value in self.guidance.state().items()}
        generator = json.dumps(self._noise.bit_generator.state).encode()
        return parts | {"noise": np.frombuffer(generator, dtype=np.uint8).copy()}

    def restore(self, state: State) -> None:
        """Go on from a `state` of a fleet of the same settings, bit for bit as that one did."""
        for name in _STATE:
            value = state[f"fleet/{name}"]
            if isinstance(getattr(self, name), np.ndarray):
                getattr(self, name)[:] = value
            else:
                setattr(self, name, int(value))
        self.plant.restore(_part(state, "plant/"))
        if self.guidance is not None:
            self.guidance.restore(_part(state, "guidance/"))
        self._noise.bit_generator.state = json.loads(state["noise"].tobytes())


_STATE = (
    "seed", "stage", "level", "starts", "goals", "targets", "pillars", "_stages", "_episode", "_before",
    "_distance", "_path_cost", "_least", "_rotation", "_totals", "_seen",
)  # fmt: skip


def _rules(settings: Settings, vehicle: Vehicle, table: Array) -> Rules:
    """Reward and ends of episodes, as the kernels take them; thruster table (n, columns)."""
    task = settings.task
    limits = np.array([task.radius, task.steps, settings.overspeed, settings.period])
    return Rules(
        reward.weights(settings.reward),
        geometry.hull_numbers(vehicle.hull),
        geometry.tank(settings.world),
        table,
        limits,
    )


def _generator(seed: int) -> np.random.Generator:
    """The generator of the sensors' noise, apart from those of the tasks."""
    return np.random.default_rng([seed, 1 << 32])


def _part(state: State, prefix: str) -> State:
    """The entries under a prefix, without it."""
    return {name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)}
