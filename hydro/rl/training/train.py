"""Training loop: vehicles fly, the policy learns, the curriculum advances, and curves record the progress.

The loop uses neither clock nor files.  The state at an evaluation is complete: a training that continues
from it produces the same bits as an uninterrupted one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Literal

import numpy as np
import polars as pl
import torch

from hydro.rl.environment.action import ACTIONS
from hydro.rl.environment.fleet import Fleet
from hydro.rl.environment.interfaces import Step
from hydro.rl.environment.observation import encoding
from hydro.rl.training.build import PLANTS
from hydro.rl.training.config import TrainingConfig
from hydro.rl.training.curriculum import CurriculumProgress
from hydro.rl.training.demonstrations import Disturbed, corrections, demonstrations, own_actions
from hydro.rl.training.divergence import Watch
from hydro.rl.training.evaluate import POLICY, RARE, fly, summary
from hydro.rl.training.expert_labels import Level
from hydro.rl.training.policy import Policy
from hydro.rl.training.sac import Learner, Losses
from hydro.rl.training.trials import NOMINAL

CURVE_SEED, EXAM_SEED = 900_001, 900_002
"""Seeds of the tasks of evaluations and of examinations; the same for every training."""
SHOWN_SEED, NEXT_SEED = 500_000, 1_000_000
"""Offset of the seed of expert lessons from the training's seed, and its increment per lesson."""


Build = Callable[[int, int], Fleet]
"""Function that builds a fleet under the training's condition from a number of vehicles and a seed."""

Progress = Callable[["Training"], None]

Part = Callable[[str], AbstractContextManager[object]]
"""Function that returns a context, such as a timer, for `flying`, `learning` or `evaluating`."""


class Training:
    """Training of a policy: the loop, its progress, and its complete state.

    Attributes:
        config: Settings.
        steps: Control steps of all vehicles so far, without examinations.
        episodes: Episodes ended so far.
        curriculum: Progress in the curriculum.
        watch: Monitor of divergence.
        curves: Points of the curves so far, rows of a table `curves`.
        evaluations: Evaluations so far, rows of a table `evaluations`.
        task_policies: Policies that passed the last level of a task, by task, since this object was made.
            They are stored separately, because learning the next task may spoil the current policy at it.
    """

    def __init__(
        self,
        config: TrainingConfig,
        build: Build,
        part: Part = nullcontext,
        learnt: Mapping[str, Any] | None = None,
    ) -> None:
        """Reset the vehicles to their first starts.

        Args:
            config: Settings.
            build: Builds fleets; see `Build`.
            part: Context of each part of the work; see `Part`.
            learnt: State of a learner to start from; its policy then replaces random actions.
        """
        torch.set_num_threads(config.threads)
        self.config, self._build, self._part = config, build, part
        self.steps = self.episodes = self._overspeed = 0
        self.curriculum, self.watch = CurriculumProgress(config.curriculum), Watch()
        self.curves: list[dict[str, Any]] = []
        self.evaluations: list[dict[str, Any]] = []
        self.task_policies: dict[str, Policy] = {}
        self._returns: list[float] = []
        self._losses: list[list[float]] = []
        self._learner = Learner(encoding(config.settings), ACTIONS, config.sac, config.seed)
        self._skilled = learnt is not None
        if learnt is not None:
            self._learner.load_weights(learnt)
        self._fleet = build(config.vehicles, config.seed)
        self._fleet.set_level(*self.curriculum.level)
        self._observations = self._fleet.reset()
        self._lessons = self._taught = self._examined = self._recorded = self._evaluated = 0

    @property
    def updates(self) -> int:
        """Number of updates of soft actor-critic so far; imitation makes none."""
        return self._learner.updates

    @property
    def checkpoint_due(self) -> bool:
        """Whether the state is to be saved after this evaluation."""
        return self.finished or self.steps // self.config.evaluate % self.config.checkpoint == 0

    @property
    def finished(self) -> bool:
        """Whether the training is over: curriculum passed, steps used up, or a loss not finite."""
        return self.curriculum.done or self.steps >= self.config.steps or self.watch.broken

    def advance(self, progress: Progress = lambda training: None) -> None:
        """Train to the next evaluation or to the end, then evaluate.

        Args:
            progress: Called at every point of the curves.
        """
        if self.finished:
            return
        while True:
            if not self._lesson() and not self.curriculum.done:
                self._step()
                if self._due:
                    self._examine()
            if self.finished or self._passed_multiple(self.config.record, self._recorded):
                self._record()
                progress(self)
            if self.finished or self._passed_multiple(self.config.evaluate, self._evaluated):
                break
        if not self.watch.broken:
            self._evaluated = self.steps
            self._evaluate("curve", self.config.episodes, CURVE_SEED)

    def _passed_multiple(self, period: int, before: int) -> bool:
        """Return whether a multiple of `period` steps was reached since the step `before`."""
        return self.steps // period > before // period

    def _lesson(self) -> bool:
        """Give the policy one lesson of the expert at the current level, if any remain.

        The first lesson is imitation of the expert's flights.  In later lessons, the corrections, the policy
        flies and learns the expert's actions at the states that it visits.  An examination takes place before
        the first lesson, because training at other levels may suffice.  Others follow after the first lesson,
        and after each correction from the least number on.

        Returns:
            Whether an examination or a lesson took place; otherwise the policy learns by reinforcement.
        """
        config, level, learner = self.config, self.curriculum.level, self._learner
        if not config.demonstrations or self.curriculum.done or self._lessons > config.corrections:
            return False
        if not self._lessons and self._skilled and self._examine():
            return True
        with self._part("flying"):
            fleet = self._expert_fleet(level)
            if self._lessons:
                flying = Disturbed(learner.best, config.push, fleet.seed)
                learner.add_labels(corrections(fleet, flying, config.manner), level)
            else:
                learner.add_demonstrations(demonstrations(fleet, config.manner), level)
        self._lessons += 1
        if config.clone:
            with self._part("learning"):
                learner.clone(config.clone)
            self._skilled = True
            if self._lessons == 1 or self._lessons > config.lessons:
                self._examine()
        return True

    def _expert_fleet(self, level: Level) -> Fleet:
        """Build vehicles with new tasks of a level for one episode's time; their steps are counted."""
        self._taught += 1
        seed = self.config.seed + SHOWN_SEED + self._taught * NEXT_SEED
        fleet = self._build(self.config.demonstrations, seed)
        fleet.set_level(*level)
        self.steps += fleet.count * fleet.task.steps(fleet.settings)
        return fleet

    @property
    def _due(self) -> bool:
        """Return whether an examination is due."""
        every = self.config.curriculum.examine
        if self.curriculum.done:
            return False
        return self.steps - self._examined >= every if every else self.curriculum.ready

    def policy(self, examined: Level | None = None) -> Policy:
        """Return the moving average of the policy so far, with a description of its training.

        Args:
            examined: Level that the policy passed, for the description; by default the level trained now.
        """
        task, level = examined or self.curriculum.level
        return self._learner.policy(
            {
                "recipe": self.config.recipe,
                "steps": self.steps,
                "updates": self.updates,
                "levels_passed": len(self.curriculum.passed),
                "task": task,
                "level": level,
            }
        )

    def _step(self) -> None:
        """Run one control step of all vehicles and the updates after it."""
        learner, sac = self._learner, self.config.sac
        exploring = self.steps < sac.random and not self._skilled
        with self._part("flying"):
            actions = learner.explore(self._fleet.count) if exploring else learner.act(self._observations)
            step = self._fleet.step(actions)
            self._note(step)
        self.steps += self._fleet.count
        with self._part("learning"):
            ended = step.terminated, step.truncated
            learner.remember(self._observations, actions, step.reward, *ended, step.final_obs)
            for _ in range(sac.updates if self.steps >= sac.random and learner.ready else 0):
                losses = [float(loss) for loss in learner.update()]
                self._losses.append(losses)
                self.watch.loss(losses[0])
        self._observations = step.obs

    def _note(self, step: Step) -> None:
        """Record the episodes that ended in a step."""
        self._overspeed += int(step.info.overspeed.sum())
        for k in np.flatnonzero(step.terminated | step.truncated):
            self.episodes += 1
            self._returns.append(float(step.info.episode_return[k]))
            self.watch.episodes += int(step.info.diverged[k])
            self.curriculum.note(bool(step.info.success[k]))

    def _examine(self) -> bool:
        """Examine the policy without exploration; advance to the next level if it passes."""
        level, config = self.curriculum.level, self.config
        share = self._evaluate("exam", config.curriculum.window, EXAM_SEED)
        self._examined = self.steps
        examined = self.policy(level)
        if not self.curriculum.examined(share):
            return False
        if self.curriculum.completed(level[0]):
            self.task_policies[level[0]] = examined
        if config.corrections and self._lessons > config.corrections:
            self._label_own_actions(level)
        self._lessons = 0
        if config.corrections and self.curriculum.done:
            self._examine_all_tasks()
        self._fleet.set_level(*self.curriculum.level)
        return True

    def _label_own_actions(self, level: Level) -> None:
        """Replace the labels of a level by the policy's own actions, if reinforcement learning passed it."""
        with self._part("flying"):
            best = self._learner.best
            self._learner.add_labels(own_actions(self._expert_fleet(level), best), level, replace=True)

    def _examine_all_tasks(self) -> None:
        """Examine every task once more, and return to the first one whose last level fails."""
        for level in self.curriculum.ends.items():
            share = self._evaluate("exam", self.config.curriculum.window, EXAM_SEED, level)
            if share < self.config.curriculum.share:
                self.curriculum.forget(level)
                self._lessons = max(self.config.lessons, 1)  # earlier lessons at this level count
                return
            self.task_policies[level[0]] = self.policy(level)

    def _evaluate(
        self, purpose: Literal["curve", "exam"], episodes: int, seed: int, level: Level | None = None
    ) -> float:
        """Return the success rate at a level, by default the current one, without exploration.

        An examination stops as soon as too many episodes failed.  An evaluation already made at the same
        training step is not repeated.
        """
        task, number = level or self.curriculum.level
        who = {"recipe": self.config.recipe, "condition": self.config.condition, "seed": self.config.seed}
        who |= {"steps": self.steps, "updates": self.updates}
        why = {
            "flown_by": POLICY,
            "plant": PLANTS[self.config.settings.engine],
            "purpose": purpose,
            "task": task,
            "level": number,
        }
        why |= {"setting": NOMINAL} | who
        for one in self.evaluations:
            if one.items() >= why.items():
                return float(one["success"])
        fleet = self._build(episodes, seed)
        fleet.set_level(task, number)
        with self._part("evaluating"):
            spare = self.config.curriculum.spare if purpose == "exam" else None
            found = summary(fly(self._learner.best, fleet, spare, paths=False))
        self.evaluations.append(who | why | found)
        if purpose == "curve":
            self.watch.evaluation(found["success"])
        return float(found["success"])

    def _record(self) -> None:
        """Add a point to the curves; a point at the same step is replaced."""
        self._recorded = self.steps
        if self.curves and self.curves[-1]["steps"] == self.steps:
            self.curves.pop()
        task, level = self.curriculum.level
        losses = _means(self._losses) if self._losses else [None] * len(Losses._fields)
        self.curves.append(
            {
                "recipe": self.config.recipe,
                "steps": self.steps,
                "updates": self.updates,
                "episodes": self.episodes,
                "task": task,
                "level": level,
                "success": self.curriculum.share,
                "reward": float(np.mean(self._returns)) if self._returns else None,
                "overspeed": self._overspeed,
                "diverged": self.watch.episodes,
            }
            | {name: _finite(loss) for name, loss in zip(Losses._fields, losses, strict=True)}
        )
        self._returns, self._losses = [], []

    def tables(self) -> dict[str, pl.DataFrame]:
        """Return the tables `curves` and `evaluations` so far, as a dict by kind of table."""
        return {
            "curves": pl.DataFrame(self.curves, infer_schema_length=None, schema_overrides=_NUMBERS),
            "evaluations": pl.DataFrame(
                self.evaluations,
                infer_schema_length=None,
                schema_overrides=dict.fromkeys(("time_to_goal", *RARE), pl.Float64),
            ),
        }

    def state(self) -> dict[str, Any]:
        """Return the complete state of the training in numbers, texts and arrays; not a copy."""
        return {
            "counts": {name: getattr(self, name) for name in _COUNTS},
            "curves": self.curves,
            "evaluations": self.evaluations,
            "observations": self._observations,
            "returns": self._returns,
            "losses": self._losses,
            "curriculum": self.curriculum.state(),
            "watch": self.watch.state(),
            "fleet": self._fleet.state(),
            "learner": self._learner.state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Set the `state` of this training, or of one with fewer steps or another curriculum."""
        for name, value in state["counts"].items():
            setattr(self, name, value)
        self.curves, self.evaluations = list(state["curves"]), list(state["evaluations"])
        self._observations = state["observations"]
        self._returns, self._losses = list(state["returns"]), list(state["losses"])
        self.curriculum.restore(state["curriculum"])
        self.watch.restore(state["watch"])
        self._fleet.restore(state["fleet"])
        self._fleet.set_level(*self.curriculum.level)
        self._learner.restore(state["learner"])


_COUNTS = (
    "steps", "episodes", "_overspeed", "_skilled", "_lessons", "_taught", "_examined", "_recorded",
    "_evaluated",
)  # fmt: skip
_NUMBERS = dict.fromkeys(("reward", *Losses._fields), pl.Float64)


def _means(losses: list[list[float]]) -> list[float]:
    """Return the mean of every loss over the updates that computed it; NaN if none did."""
    rows = np.array(losses)
    computed = ~np.isnan(rows)
    counts = computed.sum(axis=0)
    sums = np.where(computed, rows, 0.0).sum(axis=0)
    means: list[float] = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan).tolist()
    return means


def _finite(number: float | None) -> float | None:
    """Return a finite number, otherwise None."""
    return number if number is not None and np.isfinite(number) else None
