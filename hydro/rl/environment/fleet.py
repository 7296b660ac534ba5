"""Episodes of many vehicles at once: the batched core below every interface of the environment.

A control step is one call into the plant and two into compiled code, for any number of vehicles.  A vehicle
whose episode ends begins its next one within the same step.  If episodes randomise the vehicle
(`rl.environment.randomiser`) or a task has a current, each episode begins with its own model.
"""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydro.core.columns import Array, Array32, Mask
from hydro.core.errors import DataError, UsageError
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import quaternion_from_euler
from hydro.rl.environment import observation, reward
from hydro.rl.environment.action import ACTIONS, command_kernel, crew_of
from hydro.rl.environment.blocks import (
    AGE,
    ENERGY,
    ERROR,
    FLAGS,
    OVERSPEED,
    RETURN,
    SETTLING,
    TOTALS,
    Episodes,
    Motion,
    Outcome,
    Scenes,
)
from hydro.rl.environment.history import History
from hydro.rl.environment.interfaces import Guidance, Info, State, Step
from hydro.rl.environment.observation import OBSERVATIONS
from hydro.rl.environment.randomiser import Randomiser
from hydro.rl.environment.reward import TERMS, WEIGHTS
from hydro.rl.environment.step import make_rules, sense_kernel, step_kernel
from hydro.rl.tasks.registry import TASKS, task_of
from hydro.rl.tasks.task import Ends, Task, generator
from hydro.rl.world.config import Settings
from hydro.sim.plant import Plant


class Fleet:
    """N vehicles that run their episodes in parallel.

    Attributes:
        settings: Settings of world, sensors, reward, tasks and engine.
        plant: Simulator of the vehicles.
        count: Number of vehicles N.
        task: Task of episodes that begin from now on.
        level: Level of that task.
        led: Whether the target is a point ahead on a planned path instead of the goal.
        starts: Start of every vehicle's episode (N, 3), NED [m].
        goals: Current position of every vehicle's goal (N, 3), NED [m].
        pillars: North and east of the axes of the P pillars of every vehicle's scene (N, P, 2) [m], NaN in
            unused rows.
        targets: Point that every vehicle's observations show as the target (N, 3), NED [m].
        guidance: Path planner and follower, if any.
    """

    def __init__(
        self,
        settings: Settings,
        plant: Plant,
        seed: int = 0,
        guidance: Guidance | None = None,
        *,
        believed: Vehicle | None = None,
        estimates: Estimates | None = None,
    ) -> None:
        """Make a fleet of all vehicles of a plant, with the task point to point; `reset` begins the episodes.

        Args:
            settings: All choices.
            plant: Simulator of the vehicles, with the control step of the settings.
            seed: Seed of tasks, noise and random draws.
            guidance: Path planner and follower, for guided tasks.
            believed: Vehicle file that allocates actions to thrusters; by default that of the plant.
            estimates: Covariance of the file's parameters, for `Randomisation.posterior`.

        Raises:
            UsageError: `believed` has another number of thrusters, or the covariance is missing.
        """
        known = believed or plant.vehicle
        crew = crew_of(known)
        if len(crew.table) != plant.thrust.shape[1]:
            raise UsageError(
                f"{plant.vehicle.name} has {plant.thrust.shape[1]} thrusters and {known.name} has "
                f"{len(crew.table)}: give a true vehicle with the same number"
            )
        self.settings, self.plant, self.seed, self.guidance = settings, plant, seed, guidance
        self.count, self.task, self.level, self.led = len(plant.pose), next(iter(TASKS.values())), 0, False
        self._mixing = crew.allocation, crew.table, crew.authority
        self._senses = observation.senses(settings, plant.vehicle)
        self._rules = make_rules(settings, plant.vehicle, crew.table)
        self._noise = _generator(seed)
        self._randomiser = Randomiser(settings, plant.vehicle, OBSERVATIONS, estimates)
        self._make_arrays()

    def _make_arrays(self) -> None:
        """Allocate the arrays of every vehicle, and the blocks that the kernels take."""
        count, plant = self.count, self.plant
        self.starts, self.goals, self.targets = (np.zeros((count, 3)) for _ in range(3))
        self.pillars = np.full((count, self.settings.world.pillars, 2), np.nan)
        self._courses, self._ahead = np.zeros((count, 1, 3)), np.zeros(count, dtype=np.int64)
        self._passed, self._waypoint = np.zeros(count), np.zeros(count, dtype=np.int64)
        self._weights, self._ends = np.zeros((count, WEIGHTS)), np.zeros((count, len(Ends._fields)))
        self._following, self._episode = np.zeros(count, dtype=np.bool_), np.full(count, -1, dtype=np.int64)
        self._drawn, self._currents = np.zeros((count, 2), dtype=np.int64), np.zeros((count, 3))
        self._changed, self._bias = np.zeros(count, dtype=np.bool_), np.zeros((count, OBSERVATIONS))
        self._before = np.zeros((count, ACTIONS))
        self._distance, self._path_cost, self._least = np.zeros(count), np.zeros(count), np.zeros(count)
        self._rotation, self._totals = np.zeros((count, 9)), np.zeros((count, TOTALS))
        self._now = np.zeros((count, OBSERVATIONS), dtype=np.float32)
        seen, obeyed = self._randomiser.latest
        self._seen = History(count, seen + self.settings.history, OBSERVATIONS, np.float32)
        self._demands = History(count, obeyed + 1, ACTIONS, np.float64)
        self._commands, self._all = np.zeros_like(plant.thrust), np.ones(count, dtype=np.bool_)
        self._motion = Motion(
            plant.pose, plant.velocity, plant.specific_force, plant.thrust, plant.diverged, self._rotation
        )
        self._scenes = Scenes(
            self._weights, self._ends, self.goals, self.targets, self.pillars, self._path_cost
        )
        self._episodes = Episodes(self._least, self._before, self._distance, self._totals)

    @property
    def courses(self) -> Array | None:
        """Start and waypoints of every vehicle in order (N, K, 3), NED [m]; None for tasks with one goal."""
        if not self._passed.any():
            return None
        return np.concatenate([self.starts[:, None], self._courses], axis=1)

    def set_level(self, task: str | Task, level: int = 0, *, led: bool | None = None) -> None:
        """Set task and level of the episodes that begin from now on.

        Args:
            task: The task, or its name.
            level: Level of the task.
            led: Whether vehicles follow a planned path; by default if the task is `guided`.

        Raises:
            UsageError: The task or level does not exist, or a path is required and the fleet has no guidance.
        """
        chosen = task_of(task) if isinstance(task, str) else task
        chosen.require(level)
        led = chosen.guided if led is None else led
        if led and self.guidance is None:
            raise UsageError(f"{chosen.name} needs a path planner; give the fleet a Guidance")
        self.task, self.level, self.led = chosen, level, led

    def reset(self, mask: Mask | None = None, seed: int | None = None) -> Array32:
        """Begin the next episode of each vehicle in a mask.

        Args:
            mask: Vehicles to reset (N,); by default all.
            seed: Restart with the tasks and the noise of this seed.

        Returns:
            Observations of all vehicles (N, O); those outside the mask are unchanged.
        """
        if seed is not None:
            self.reseed(seed)
        self._begin(self._all if mask is None else mask)
        return self._visible()

    def reseed(self, seed: int) -> None:
        """Make the next episode of every vehicle the first episode of a seed."""
        self.seed, self._noise = seed, _generator(seed)
        self._episode[:] = -1

    def step(self, actions: ArrayLike, *, renew: bool = True, flying: Mask | None = None) -> Step:
        """Simulate one control step of all vehicles.

        Args:
            actions: Actions (N, 6), clipped to [-1, 1].
            renew: Whether vehicles whose episode ends begin the next one at once; otherwise the caller resets
                them.
            flying: Vehicles that move (N,), by default all; all others stay where they are, and their results
                are meaningless.

        Returns:
            Observations, rewards, and flags of the episodes that ended.

        Raises:
            DataError: The actions have a wrong shape or are not finite.
        """
        demands = np.array(actions, dtype=np.float64)
        if demands.shape != self._before.shape:
            raise DataError(f"actions: expected shape {self._before.shape}, got {demands.shape}")
        np.minimum(np.maximum(demands, -1.0, out=demands), 1.0, out=demands)  # three times as fast as np.clip
        self._demands.append(self._all, demands)
        if not command_kernel(*self._mixing, self._demands.arrived(), np.empty(ACTIONS), self._commands):
            raise DataError("actions: some are not finite; check the observations of the policy")
        self.plant.step(self._commands, flying)

        self._observe(self._all, 1)
        final = self._visible()
        outcome = Outcome(
            np.empty(self.count, dtype=np.float32),
            np.empty((FLAGS, self.count), dtype=np.bool_),
            np.empty((self.count, len(TERMS))),
        )
        step_kernel(self._rules, self._motion, self._scenes, self._episodes, demands, outcome)
        success, collision, diverged, overspeed, terminated, truncated = outcome.flags
        counted = self._totals.astype(np.int64)
        info = Info(
            success, collision, diverged, self._distance.copy(), overspeed, self._totals[:, RETURN].copy(),
            counted[:, AGE], self._totals[:, ENERGY].copy(), counted[:, OVERSPEED], self._error(),
            outcome.terms,
        )  # fmt: skip
        done = terminated | truncated
        following = final
        if renew and done.any():
            self._begin(done)
            following = self._visible()
        return Step(following, outcome.reward, terminated, truncated, final, info)

    def _begin(self, mask: Mask) -> None:
        """Begin the next episode of some vehicles."""
        pose, velocity = np.zeros((self.count, 7)), np.zeros((self.count, 6))
        late = np.zeros((2, self.count), dtype=np.int64)
        vehicles: dict[int, Vehicle] = {}
        self._episode[mask] += 1
        for k in map(int, np.flatnonzero(mask)):
            pose[k, :3], pose[k, 3:] = self._set_scene(k)
            self._drawn[k] = self.seed, self._episode[k]
            vehicles |= self._draw(k, late)
        if vehicles:
            self.plant.change(vehicles)
        self.plant.reset(mask, pose, velocity)
        self._weights[mask] = reward.weights(self.task.reward(self.settings))
        self._ends[mask] = self.task.ends(self.settings)
        self._ahead[mask] = round(self.task.lead(self.settings) / self.settings.period)
        self._before[mask], self._totals[mask], self._following[mask] = 0.0, 0.0, self.led
        self._distance[mask] = np.linalg.norm(self.starts[mask] - self.goals[mask], axis=1)
        self._path_cost[mask] = 0.0
        if self.guidance is not None and self.led:
            self.guidance.reset(mask, self.starts, self.goals, self.pillars)
        self._demands.fill(mask, self._before, late[1])
        self._observe(mask)
        self._seen.fill(mask, self._now, late[0])

    def _set_scene(self, k: int) -> tuple[Array, Array]:
        """Draw the scene of a vehicle's episode; return its initial position and quaternion."""
        rng = generator(self.seed, k, int(self._episode[k]))
        scene = self.task.scene(self.settings, self.level, rng)
        if len(scene.pillars) > self.pillars.shape[1]:
            raise UsageError(
                f"a scene has {len(scene.pillars)} pillars, but there is room for {self.pillars.shape[1]}: "
                "raise world.pillars"
            )
        if (more := len(scene.course) - self._courses.shape[1]) > 0:
            self._courses = np.pad(self._courses, ((0, 0), (0, more), (0, 0)), mode="edge")
        self._courses[k, : len(scene.course)] = scene.course
        self._courses[k, len(scene.course) :] = scene.course[-1]
        self.starts[k], self.goals[k], self._currents[k] = scene.start, scene.goal, scene.current
        self._passed[k], self._waypoint[k] = scene.passed, 0
        self.pillars[k] = np.nan
        self.pillars[k, : len(scene.pillars)] = scene.pillars
        return scene.start, quaternion_from_euler(0.0, 0.0, scene.heading)

    def _draw(self, k: int, late: NDArray[np.int64]) -> dict[int, Vehicle]:
        """Draw the vehicle, biases and delays of an episode; return the new vehicle by index if it changes.

        Args:
            k: Index of the vehicle.
            late: Delays of sensors and commands of each vehicle (2, N) [steps]; written.
        """
        seed, episode = map(int, self._drawn[k])
        draw = self._randomiser.draw(seed, k, episode, self._currents[k])
        self._bias[k], late[:, k] = draw.bias, (draw.seen_late, draw.obeyed_late)
        before, self._changed[k] = self._changed[k], draw.vehicle is not None
        if draw.vehicle is None:
            return {k: self.plant.vehicle} if before else {}
        return {k: draw.vehicle}

    def _observe(self, mask: Mask, elapsed: int = 0) -> None:
        """Update goals, targets and observations of some vehicles, `elapsed` steps after the last update."""
        if self._courses.shape[1] > 1:
            every, last = np.arange(self.count), self._courses.shape[1] - 1
            now = self._totals[:, AGE].astype(np.int64) + elapsed
            if self._passed.any():
                now = np.where(self._passed > 0.0, self._pass_waypoints(mask), now)
            self.goals[mask] = self._courses[every, np.minimum(now, last)][mask]
            self.targets[mask] = self._courses[every, np.minimum(now + self._ahead, last)][mask]
        else:
            np.copyto(self.targets, self.goals, where=mask[:, None])
        if self.guidance is not None and (led := mask & self._following).any():
            ahead, cost = self.guidance.targets(led, self.plant.pose[:, :3])
            self.targets[led], self._path_cost[led] = ahead[led], cost[led]
        noise = self._noise.standard_normal((self.count, OBSERVATIONS)) + self._bias
        sense_kernel(mask, self._senses, self._motion, self._scenes, noise, self._least, self._now)
        self._seen.append(mask, self._now)

    def _pass_waypoints(self, mask: Mask) -> NDArray[np.int64]:
        """Give each vehicle of a mask that reached its waypoint the next one; return waypoint numbers (N,).

        Distances to the goal are reset to the new waypoint, so that a change of the goal gives no reward.
        """
        last = self._courses.shape[1] - 1
        away = np.linalg.norm(self.goals - self.plant.pose[:, :3], axis=1)
        reached = mask & (away <= self._passed) & (self._waypoint < last)
        self._waypoint[reached] += 1
        following = self._courses[reached, self._waypoint[reached]]
        self._distance[reached] = np.linalg.norm(following - self.plant.pose[reached, :3], axis=1)
        return self._waypoint

    def _visible(self) -> Array32:
        """Return the observations of all vehicles that have arrived (N, O), the newest first."""
        return self._seen.arrived(self.settings.history)

    def _error(self) -> Array:
        """Return the root mean square distances from the goal (N,) [m]; 0 for tasks that end on arrival."""
        held = self._ends[:, SETTLING] >= 0.0
        if not held.any():
            return np.zeros(self.count)
        counted = self._totals[:, AGE] - np.floor(self._ends[:, SETTLING])
        mean = self._totals[:, ERROR] / np.maximum(counted, 1.0)
        held &= counted > 0.0
        return np.where(held, np.sqrt(mean), 0.0)

    def state(self) -> State:
        """Return a copy of the complete state of the fleet, as arrays by name, for `restore`."""
        parts = {f"fleet/{name}": np.array(getattr(self, name)) for name in _STATE}
        parts["fleet/task"] = np.frombuffer(self.task.name.encode(), dtype=np.uint8).copy()
        for name, history in (("seen", self._seen), ("demands", self._demands)):
            parts |= {f"{name}/values": history.values.copy(), f"{name}/late": history.late.copy()}
        parts |= {f"plant/{name}": value for name, value in self.plant.snapshot().items()}
        if self.guidance is not None:
            parts |= {f"guidance/{name}": value for name, value in self.guidance.state().items()}
        generator = json.dumps(self._noise.bit_generator.state).encode()
        return parts | {"noise": np.frombuffer(generator, dtype=np.uint8).copy()}

    def restore(self, state: State) -> None:
        """Set the state that `state` of a fleet with the same settings returned, and continue bit for bit."""
        changed = np.flatnonzero(self._changed)
        self._courses = np.zeros_like(state["fleet/_courses"], dtype=np.float64)
        for name in _STATE:
            value = state[f"fleet/{name}"]
            if isinstance(getattr(self, name), np.ndarray):
                getattr(self, name)[:] = value
            else:
                setattr(self, name, type(getattr(self, name))(value))
        self.task = task_of(state["fleet/task"].tobytes().decode())
        for name, history in (("seen", self._seen), ("demands", self._demands)):
            history.values[:], history.late[:] = state[f"{name}/values"], state[f"{name}/late"]
        vehicles = dict.fromkeys(map(int, changed), self.plant.vehicle)
        for k in map(int, np.flatnonzero(self._changed)):
            vehicles |= self._draw(k, np.zeros((2, self.count), dtype=np.int64))
        if vehicles:
            self.plant.change(vehicles)
        self.plant.restore(_part(state, "plant/"))
        if self.guidance is not None:
            self.guidance.restore(_part(state, "guidance/"))
        self._noise.bit_generator.state = json.loads(state["noise"].tobytes())


_STATE = (
    "seed", "level", "led", "starts", "goals", "targets", "pillars", "_courses", "_ahead", "_weights",
    "_ends", "_following", "_episode", "_drawn", "_currents", "_changed", "_bias", "_before", "_distance",
    "_path_cost", "_least", "_rotation", "_totals", "_now", "_passed", "_waypoint",
)  # fmt: skip


def _generator(seed: int) -> np.random.Generator:
    """Return the generator of sensor noise, with a stream separate from those of the tasks."""
    return np.random.default_rng([seed, 1 << 32])


def _part(state: State, prefix: str) -> State:
    """Return the entries under a prefix, with the prefix removed."""
    return {name.removeprefix(prefix): value for name, value in state.items() if name.startswith(prefix)}
