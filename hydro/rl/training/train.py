"""One training: vehicles fly, a policy learns, the curriculum goes on, and curves tell of it.

Nothing here knows a clock or a file. The state of a training at an evaluation is all that its future depends
on: going on from it gives the same bits as never having stopped.
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
from hydro.rl.training.advice import Level
from hydro.rl.training.config import TrainingConfig
from hydro.rl.training.curriculum import CurriculumProgress
from hydro.rl.training.demonstrations import Pushed, corrections, demonstrations, habits
from hydro.rl.training.divergence import Watch
from hydro.rl.training.evaluate import POLICY, RARE, fly, summary
from hydro.rl.training.policy import Policy
from hydro.rl.training.sac import Learner, Losses
from hydro.rl.training.trials import NOMINAL

CURVE_SEED, EXAM_SEED = 900_001, 900_002
"""Of the tasks of evaluations and of examinations: the same for every training."""
SHOWN_SEED, NEXT_SEED = 500_000, 1_000_000
"""Beyond its own, that of the tasks which a training is shown, and from one lesson to the next."""


Build = Callable[[int, int], Fleet]
"""A fleet under the training's condition, of a number of vehicles and a seed."""

Progress = Callable[["Training"], None]

Part = Callable[[str], AbstractContextManager[object]]
"""What surrounds each part of the work, `flying`, `learning` or `evaluating`: a stopwatch, for one."""


class Training:
    """A training that has reached some step.

    Attributes:
        config: What it depends on.
        steps: Control steps of all vehicles together so far, but for examinations.
        episodes: Episodes ended so far.
        curriculum: Where it stands in its curriculum.
        watch: Whether it has diverged.
        curves: Points of the curves so far, rows of a table `curves`.
        evaluations: Evaluations so far, rows of a table `evaluations`.
        masters: The policies that passed the last level of a task since this training was made, by task: what
            is learnt for the next may undo it.
    """

    def __init__(
        self,
        config: TrainingConfig,
        build: Build,
        part: Part = nullcontext,
        learnt: Mapping[str, Any] | None = None,
    ) -> None:
        """Put the vehicles at their first start.

        Args:
            config: What it depends on.
            build: Makes its fleets, see `Build`.
            part: Surrounds each part of the work, see `Part`.
            learnt: A learner's state to begin with; its policy then flies where actions would be random.
        """
        torch.set_num_threads(config.threads)
        self.config, self._build, self._part = config, build, part
        self.steps = self.episodes = self._overspeed = 0
        self.curriculum, self.watch = CurriculumProgress(config.curriculum), Watch()
        self.curves: list[dict[str, Any]] = []
        self.evaluations: list[dict[str, Any]] = []
        self.masters: dict[str, Policy] = {}
        self._returns: list[float] = []
        self._losses: list[list[float]] = []
        self._learner = Learner(encoding(config.settings), ACTIONS, config.sac, config.seed)
        self._skilled = learnt is not None
        if learnt is not None:
            self._learner.begin_with(learnt)
        self._fleet = build(config.vehicles, config.seed)
        self._fleet.set_level(*self.curriculum.level)
        self._observations = self._fleet.reset()
        self._lessons = self._taught = self._examined = self._recorded = self._evaluated = 0

    @property
    def finished(self) -> bool:
        """Whether the curriculum is passed, the steps are used up, or the losses are no numbers any more."""
        return self.curriculum.done or self.steps >= self.config.steps or self.watch.broken

    def advance(self, progress: Progress = lambda training: None) -> None:
        """Train to the next evaluation, or to the end, and evaluate.

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
            if self.finished or self._over(self.config.record, self._recorded):
                self._record()
                progress(self)
            if self.finished or self._over(self.config.evaluate, self._evaluated):
                break
        if not self.watch.broken:
            self._evaluated = self.steps
            self._evaluate("curve", self.config.episodes, CURVE_SEED)

    def _over(self, period: int, before: int) -> bool:
        """Whether a multiple of a number of steps lies between a step before and now."""
        return self.steps // period > before // period

    def _lesson(self) -> bool:
        """Learn from a pilot by hand at the present level, as long as there is a lesson left.

        He flies first and the policy does as he does; then the policy flies, and does what he would have done
        where it came to.  It is examined after what he has shown, and after each correction from the least
        number of them on, and once before: what is passed by what was learnt at other levels needs no lesson.

        Returns:
            Whether that was so; else it is for the policy to learn by itself.
        """
        config, level, learner = self.config, self.curriculum.level, self._learner
        if not config.demonstrations or self.curriculum.done or self._lessons > config.corrections:
            return False
        if not self._lessons and self._skilled and self._examine():
            return True
        with self._part("flying"):
            fleet = self._school(level)
            if self._lessons:
                flying = Pushed(learner.best, config.push, fleet.seed)
                learner.heed(corrections(fleet, flying, config.manner), level)
            else:
                learner.watch(demonstrations(fleet, config.manner), level)
        self._lessons += 1
        if config.clone:
            with self._part("learning"):
                learner.clone(config.clone)
            self._skilled = True
            if self._lessons == 1 or self._lessons > config.lessons:
                self._examine()
        return True

    def _school(self, level: Level) -> Fleet:
        """Vehicles with new tasks of a level, for an episode's time; their steps are counted."""
        self._taught += 1
        seed = self.config.seed + SHOWN_SEED + self._taught * NEXT_SEED
        fleet = self._build(self.config.demonstrations, seed)
        fleet.set_level(*level)
        self.steps += fleet.count * fleet.task.steps(fleet.settings)
        return fleet

    @property
    def _due(self) -> bool:
        """Whether it is time for an examination."""
        every = self.config.curriculum.examine
        if self.curriculum.done:
            return False
        return self.steps - self._examined >= every if every else self.curriculum.ready

    def policy(self, examined: Level | None = None) -> Policy:
        """What has been learnt so far, for a level, by default the present one."""
        task, level = examined or self.curriculum.level
        return self._learner.policy(
            {
                "steps": self.steps,
                "levels_passed": len(self.curriculum.passed),
                "task": task,
                "level": level,
            }
        )

    def _step(self) -> None:
        """One control step of all vehicles, and what is learnt after it."""
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
        """Take down the episodes that ended in a step."""
        self._overspeed += int(step.info.overspeed.sum())
        for k in np.flatnonzero(step.terminated | step.truncated):
            self.episodes += 1
            self._returns.append(float(step.info.episode_return[k]))
            self.watch.episodes += int(step.info.diverged[k])
            self.curriculum.note(bool(step.info.success[k]))

    def _examine(self) -> bool:
        """Let the policy show without exploration that it has learnt the level, and go on if it has."""
        level, config = self.curriculum.level, self.config
        share = self._evaluate("exam", config.curriculum.window, EXAM_SEED)
        self._examined = self.steps
        examined = self.policy(level)
        if not self.curriculum.examined(share):
            return False
        if self.curriculum.behind(level[0]):
            self.masters[level[0]] = examined
        if config.corrections and self._lessons > config.corrections:
            self._keep_habits(level)
        self._lessons = 0
        if config.corrections and self.curriculum.done:
            self._rehearse()
        self._fleet.set_level(*self.curriculum.level)
        return True

    def _keep_habits(self, level: Level) -> None:
        """Let what the policy does count as what should be done, where it has found out by itself."""
        with self._part("flying"):
            best = self._learner.best
            self._learner.heed(habits(self._school(level), best), level, anew=True)

    def _rehearse(self) -> None:
        """Examine every task once more, and go back to the first whose last level is not passed any more."""
        for level in self.curriculum.ends.items():
            share = self._evaluate("exam", self.config.curriculum.window, EXAM_SEED, level)
            if share < self.config.curriculum.share:
                self.curriculum.forget(level)
                self._lessons = max(self.config.lessons, 1)  # it has been shown, and corrected as often
                return
            self.masters[level[0]] = self.policy(level)

    def _evaluate(
        self, purpose: Literal["curve", "exam"], episodes: int, seed: int, level: Level | None = None
    ) -> float:
        """Share of episodes at a level, by default the present one, that succeed without exploration.

        An examination ends with the failure that decides it.  What has been flown at this step is not flown
        again.
        """
        task, number = level or self.curriculum.level
        who = {"condition": self.config.condition, "seed": self.config.seed, "steps": self.steps}
        why = {"flown_by": POLICY, "plant": "student", "purpose": purpose, "task": task, "level": number}
        why |= {"setting": NOMINAL} | who
        for one in self.evaluations:
            if one.items() >= why.items():
                return float(one["success"])
        fleet = self._build(episodes, seed)
        fleet.set_level(task, number)
        with self._part("evaluating"):
            spare = self.config.curriculum.spare if purpose == "exam" else None
            found = summary(fly(self._learner.best, fleet, spare))
        self.evaluations.append(who | why | found)
        if purpose == "curve":
            self.watch.evaluation(found["success"])
        return float(found["success"])

    def _record(self) -> None:
        """Add a point to the curves, in place of one at the same step."""
        self._recorded = self.steps
        if self.curves and self.curves[-1]["steps"] == self.steps:
            self.curves.pop()
        task, level = self.curriculum.level
        losses = np.mean(self._losses, axis=0).tolist() if self._losses else [None] * len(Losses._fields)
        self.curves.append(
            {
                "steps": self.steps,
                "updates": self._learner.updates,
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
        """Curves and evaluations so far, by kind of table."""
        return {
            "curves": pl.DataFrame(self.curves, infer_schema_length=None, schema_overrides=_NUMBERS),
            "evaluations": pl.DataFrame(
                self.evaluations,
                infer_schema_length=None,
                schema_overrides=dict.fromkeys(("time_to_goal", *RARE), pl.Float64),
            ),
        }

    def state(self) -> dict[str, Any]:
        """Everything that the future depends on, in numbers, texts and arrays; not a copy."""
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
        """Go on from the `state` of a training alike, or of one with fewer steps or another curriculum."""
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


def _finite(number: float | None) -> float | None:
    """A number, or nothing where it is none."""
    return number if number is not None and np.isfinite(number) else None
