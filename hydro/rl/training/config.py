"""Every choice of a training beside those of its environment, with its default; a run keeps them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from hydro.core import seeds
from hydro.core.errors import UsageError
from hydro.rl.environment.helmsman import Manner
from hydro.rl.tasks.registry import STAGES, task_of
from hydro.rl.world.config import Settings
from hydro.rl.world.planner import Grid


def _counted(counts: Mapping[str, int]) -> None:
    """Refuse a number of things that is below 1."""
    for name, count in counts.items():
        if count < 1:
            raise UsageError(f"{name} is {count}; give 1 or more")


@dataclass(frozen=True)
class SACConfig:
    """What SAC is run with; the paper's where it says (IV-C).

    Attributes:
        layers: Widths of the hidden layers of actor and critics.
        discount: gamma.
        horizon: Steps n whose rewards are summed before the critics are asked what follows.  A constant
            error of the values dies out at (1 - gamma^n) tau per update: with n = 1 in 20,000 of them.
        tau: Share of the critics that their targets take on in an update.
        average: Share of the policy that its average takes on in an update.  The average is what is evaluated
            and kept: a policy that succeeds over many episodes of training may, as it is after any single
            update, fail one in five.
        target_entropy: Of the policy, in nats.
        temperature: First alpha. From 1, it takes 13,000 updates at this rate to come down to where a step's
            reward weighs as much as its entropy.
        norm: Whether the critics' hidden layers are normalised (Ball et al. 2023): values of actions that
            nobody has tried then stay within reach.
        batch: Transitions of an update.
        demonstrated: Share of them from demonstrations, where there are any.
        capacity: Transitions that are kept.
        rate: Learning rate of actor, critics and temperature.
        random: Steps of all vehicles together that are flown at random before the policy flies.
        updates: Updates per step of all vehicles together.
    """

    layers: tuple[int, ...] = (256, 256)
    discount: float = 0.99
    horizon: int = 10
    tau: float = 0.005
    average: float = 0.001
    target_entropy: float = -6.0
    temperature: float = 0.05
    norm: bool = False
    batch: int = 512
    demonstrated: float = 0.5
    capacity: int = 1_000_000
    rate: float = 3e-4
    random: int = 5_000
    updates: int = 1

    def __post_init__(self) -> None:
        """Refuse what no learning can be run with.

        Raises:
            UsageError: A number is too small, or a share is none; the line names it.
        """
        _counted({f"sac.{name}": getattr(self, name) for name in ("horizon", "batch", "capacity", "updates")})
        _counted({"sac.layers": min(self.layers, default=1)})
        for name in ("discount", "tau", "average"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise UsageError(f"sac.{name} is {getattr(self, name):g}; give a share above 0, at most 1")
        if not 0.0 <= self.demonstrated <= 1.0:
            raise UsageError(f"sac.demonstrated is {self.demonstrated:g}; give a share within 0 and 1")
        for name in ("temperature", "rate"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise UsageError(f"sac.{name} is {getattr(self, name):g}; give a number above 0")
        if self.random < 0:
            raise UsageError(f"sac.random is {self.random}; give 0 or more")


@dataclass(frozen=True)
class Curriculum:
    """When the curriculum goes on.

    Attributes:
        task: A task to be learnt by itself, at its greatest level; empty: the stages are.
        last: Last stage, 1 to 3.
        baffles: Numbers of baffles of stage 2, the slalom, one level each; none is open water.
        pillars: Those of stage 3, the forest.
        share: Share of episodes without exploration that must succeed.
        ready: Share of the last episodes of training from which on they are flown; exploration itself makes
            a policy fail that would not by itself, the more the closer it passes by pillars.
        window: Episodes that both are taken of.
        examine: Steps of all vehicles together from one examination to the next, whatever episodes of
            training come to; 0: when these are `ready`.
    """

    task: str = ""
    last: int = 1
    baffles: tuple[int, ...] = (0, 1, 2, 4)
    pillars: int = 12
    share: float = 0.97
    ready: float = 0.9
    window: int = 150
    examine: int = 0

    def __post_init__(self) -> None:
        """Refuse what is no curriculum.

        Raises:
            UsageError: There is no such stage, task or level, or a share that is none.
        """
        if not 1 <= self.last <= len(STAGES):
            raise UsageError(f"there is no stage {self.last}: choose 1 to {len(STAGES)}")
        if not self.baffles:
            raise UsageError("stage 2 needs at least one level, of 0 baffles or more")
        for name, level in self.levels:
            task_of(name).require(level)
        if not (0.0 < self.share <= 1.0 and 0.0 < self.ready <= 1.0) or self.window < 1:
            raise UsageError("the curriculum goes on at a share within 0 and 1 of at least one episode")
        if self.examine < 0:
            raise UsageError(f"curriculum.examine is {self.examine}; give a number of steps, or 0")

    @property
    def spare(self) -> int:
        """Episodes of an examination that may fail: with one more the level is not passed."""
        few = (ok for ok in range(self.window, -1, -1) if ok / self.window < self.share)
        return self.window - next(few) - 1

    @property
    def levels(self) -> tuple[tuple[str, int], ...]:
        """Task and level of every level, in order."""
        if self.task:
            alone = task_of(self.task)
            return ((alone.name, alone.most),)
        levels = (0,), self.baffles, (self.pillars,)
        stages = zip(STAGES, levels, strict=True)
        return tuple((name, level) for name, of in list(stages)[: self.last] for level in of)


@dataclass(frozen=True)
class TrainingConfig:
    """Everything that a training depends on beside the vehicle and its residual model.

    Attributes:
        condition: Physics that the vehicles fly under; see `conditions`.
        conditioning: Preset for the residual model's wrench.
        seed: Of weights, exploration, batches, tasks and sensor noise.
        steps: Control steps of all vehicles together at most.
        vehicles: That fly side by side.
        threads: Of the updates and of the physics; another number rounds otherwise.
        evaluate: Steps from one evaluation, and one state kept, to the next.
        record: Steps from one point of the curves to the next; `evaluate` is a multiple of it.
        episodes: Of an evaluation.
        pilot: Share of the goals of the first level that a pilot by hand, who has the map, must reach: less,
            and the vehicle cannot do the task; 0: he is not asked.
        demonstrations: Vehicles that a pilot by hand flies, for as long as an episode may last, before a
            level is learnt; 0: none.
        clone: Batches by which the policy is made to do as he did before it flies at a level.
        corrections: Times at most that as many vehicles are then flown by the policy at a level it has not
            passed, for as long, and it is made to do what he would have done where it came to.  Of all
            levels then, and the last policy is to pass the last level of every task.
        lessons: Times at least, at a level that his flights alone did not make it pass. Who has hardly been
            corrected may pass in the simulator that he was corrected in, and not in another.
        margin: Distance that the pilot who teaches keeps from pillars where there is room, unless he is led
            along the policy's way [m].  With the planner's he cuts corners to a tenth of a metre from the
            hull, and who does nearly as he does hits.
        pace: His speeds then, in multiples of those that he has in tables.  Who learns from him is no faster.
        firmness: His demands then for an angle of roll, pitch or heading, likewise.  Where water turns the
            hull by more than he else stands up to it pitches by tens of degrees, and is slow.
        push: Standard deviation of demands in roll and pitch, a third of it in the others, that are added to
            what the policy does with every other vehicle then: a hull in other water trims otherwise.
        curriculum: When it goes on.
        sac: The learner.
        settings: The environment.
    """

    condition: str = "R_effects"
    conditioning: str = "paper"
    seed: int = 0
    steps: int = 500_000
    vehicles: int = 8
    threads: int = 1
    evaluate: int = 20_000
    record: int = 4_000
    episodes: int = 50
    pilot: float = 0.8
    demonstrations: int = 0
    clone: int = 0
    corrections: int = 0
    lessons: int = 0
    margin: float = Grid.margin
    pace: float = 1.0
    firmness: float = 1.0
    push: float = 0.0
    curriculum: Curriculum = field(default_factory=Curriculum)
    sac: SACConfig = field(default_factory=SACConfig)
    settings: Settings = field(default_factory=Settings)

    def __post_init__(self) -> None:
        """Refuse numbers that count nothing, and periods that do not fit together.

        Raises:
            UsageError: A number is below 1, the seed is none, or records and evaluations are no multiples of
                a step of all vehicles.
        """
        seeds.check(self.seed)
        counts = ("steps", "vehicles", "threads", "evaluate", "record", "episodes")
        _counted({name: getattr(self, name) for name in counts})
        if self.demonstrations < 0 or self.clone < 0:
            raise UsageError("demonstrations and clone are numbers of vehicles and batches; give 0 or more")
        if not 0.0 <= self.push < math.inf:
            raise UsageError(f"push is {self.push:g}; give 0 or more")
        if not 0 <= self.lessons <= self.corrections:
            raise UsageError(f"lessons is {self.lessons}; give 0 to {self.corrections}, the corrections")
        if not 0.0 <= self.margin < math.inf:
            raise UsageError(f"margin is {self.margin:g} m; give 0 or more")
        for name in ("pace", "firmness"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise UsageError(f"{name} is {getattr(self, name):g}; give a number above 0")
        if not 0.0 <= self.pilot <= 1.0:
            raise UsageError(f"pilot is {self.pilot:g}; give a share within 0 and 1")
        if self.clone and not self.demonstrations:
            raise UsageError("there is nothing to clone without demonstrations; give some")
        if self.corrections < 0 or (self.corrections and not self.clone):
            raise UsageError("corrections are cloned, 0 or more times: give clone a number of batches")
        if self.record % self.vehicles or self.evaluate % self.record:
            raise UsageError(
                f"{self.vehicles} vehicles, a record every {self.record} steps and an evaluation every "
                f"{self.evaluate}: each must be a multiple of the one before"
            )

    @property
    def manner(self) -> Manner:
        """How the pilot who teaches flies."""
        return Manner(self.margin, self.pace, self.firmness)


RECIPES = {
    "paper": TrainingConfig(),
    "demos": TrainingConfig(
        demonstrations=40,
        clone=3_000,
        corrections=30,
        lessons=10,
        margin=1.6,
        pace=1.125,
        firmness=4.0,
        push=0.6,
        evaluate=100_000,
        curriculum=Curriculum(baffles=(4,), examine=10_000),
        sac=SACConfig(layers=(128, 128), norm=True, batch=256, random=0),
    ),
}
"""Choices that go together: soft actor-critic as in the paper, and begun with what a pilot by hand does."""
