"""Settings of a training other than those of its environment, with defaults; a run stores them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from hydro.core import seeds
from hydro.core.errors import UsageError
from hydro.rl.environment.helmsman import Manner
from hydro.rl.environment.wrench import WrenchSettings
from hydro.rl.tasks.registry import STAGES, task_of
from hydro.rl.tasks.row import PillarRow
from hydro.rl.world.config import Settings
from hydro.rl.world.planner import Grid


def _require_counts(counts: Mapping[str, int]) -> None:
    """Check that counts are at least 1."""
    for name, count in counts.items():
        if count < 1:
            raise UsageError(f"{name} is {count}; give 1 or more")


@dataclass(frozen=True)
class SACConfig:
    """Settings of soft actor-critic; those of Wu et al. (IV-C) where they give them.

    Attributes:
        layers: Widths of the hidden layers of actor and critics.
        discount: gamma.
        horizon: Steps n of an n-step return.  A constant error of the values decays at (1 - gamma^n) tau per
            update: with n = 1 that takes 20,000 updates.
        tau: Share of the critics that their target networks adopt per update.
        average: Share of the policy that its moving average adopts per update.  The average is evaluated and
            stored.  A policy that succeeds in training may fail one episode in five after a single update.
        target_entropy: Target entropy of the policy [nats].
        temperature: Initial alpha.  From 1 it takes 13,000 updates at this learning rate until the reward of
            a step weighs as much as its entropy.
        norm: Whether the critics' hidden layers are normalised (Ball et al. 2023), which bounds the values of
            actions that were never tried.
        batch: Transitions per update.
        demonstrated: Share of demonstrations in a batch, if there are any.
        capacity: Transitions that the replay buffer keeps.
        rate: Learning rate of actor, critics and temperature.
        random: Steps of all vehicles with random actions before the policy acts.
        updates: Updates per step of all vehicles.
        delay: Updates of the critics per update of actor and temperature (Fujimoto et al. 2018).
        correlation: Correlation rho of the exploration noise of successive control steps, a first-order
            autoregressive process.  With 0.95 a vehicle keeps its course for 20 steps; with white noise a
            heavy vehicle hardly moves.
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
    delay: int = 1
    correlation: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            UsageError: A number is too small, or a share is not within its range; the message names it.
        """
        _require_counts(
            {
                f"sac.{name}": getattr(self, name)
                for name in ("horizon", "batch", "capacity", "updates", "delay")
            }
        )
        _require_counts({"sac.layers": min(self.layers, default=1)})
        for name in ("discount", "tau", "average"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise UsageError(f"sac.{name} is {getattr(self, name):g}; give a share above 0, at most 1")
        if not 0.0 <= self.demonstrated <= 1.0:
            raise UsageError(f"sac.demonstrated is {self.demonstrated:g}; give a share within 0 and 1")
        for name in ("temperature", "rate"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise UsageError(f"sac.{name} is {getattr(self, name):g}; give a number above 0")
        if not 0.0 <= self.correlation < 1.0:
            raise UsageError(f"sac.correlation is {self.correlation:g}; give 0 or more, and less than 1")
        if self.random < 0:
            raise UsageError(f"sac.random is {self.random}; give 0 or more")


@dataclass(frozen=True)
class Curriculum:
    """Levels of a curriculum, and the conditions that pass them.

    Attributes:
        task: Task to learn alone, at its greatest level; empty for the stages.
        last: Last stage, 1 to 3.
        baffles: Numbers of baffles of stage 2, the slalom, one level each; 0 is open water.
        row: Numbers of pillars of stage 2 as a row of pillars, one level each; empty for the slalom.  By
            rewards alone a policy passes a row of eight pillars, but not a slalom of four baffles.
        pillars: Number of pillars of stage 3, the forest.
        share: Success rate without exploration that passes a level.
        ready: Success rate in training that triggers an examination.  It is lower than `share`, because
            exploration makes a policy fail, especially close to pillars.
        window: Number of episodes of both rates.
        examine: Steps of all vehicles between examinations, regardless of `ready`; 0 uses `ready`.
    """

    task: str = ""
    last: int = 1
    baffles: tuple[int, ...] = (0, 1, 2, 4)
    row: tuple[int, ...] = ()
    pillars: int = 12
    share: float = 0.97
    ready: float = 0.9
    window: int = 150
    examine: int = 0

    def __post_init__(self) -> None:
        """Check that the levels exist.

        Raises:
            UsageError: A stage, task or level does not exist, or a share is not within its range.
        """
        if not 1 <= self.last <= len(STAGES):
            raise UsageError(f"there is no stage {self.last}: choose 1 to {len(STAGES)}")
        if not (self.row or self.baffles):
            raise UsageError("stage 2 needs at least one level, of 0 baffles or more")
        for name, level in self.levels:
            task_of(name).require(level)
        if not (0.0 < self.share <= 1.0 and 0.0 < self.ready <= 1.0) or self.window < 1:
            raise UsageError(
                "curriculum: share and ready need a share within 0 and 1, window at least one episode"
            )
        if self.examine < 0:
            raise UsageError(f"curriculum.examine is {self.examine}; give a number of steps, or 0")

    @property
    def spare(self) -> int:
        """Number of episodes of an examination that may fail without failing the examination."""
        few = (ok for ok in range(self.window, -1, -1) if ok / self.window < self.share)
        return self.window - next(few) - 1

    @property
    def levels(self) -> tuple[tuple[str, int], ...]:
        """All levels in order, each as a pair of the task's name and the level's number."""
        if self.task:
            alone = task_of(self.task)
            return ((alone.name, alone.most),)
        levels = (0,), self.row or self.baffles, (self.pillars,)
        stages = zip(self.stages, levels, strict=True)
        return tuple((name, level) for name, of in list(stages)[: self.last] for level in of)

    @property
    def stages(self) -> tuple[str, str, str]:
        """Names of the tasks of the three stages."""
        first, second, third = STAGES
        return first, PillarRow.name if self.row else second, third


@dataclass(frozen=True)
class TrainingConfig:
    """Settings of a training, except the vehicle and its residual model.

    The expert is a hand-written pilot with a map.  The policy first imitates its flights.  Then the policy
    flies and the expert labels the states that it visits: one such round is a correction.

    Attributes:
        recipe: Name of the recipe that the settings began with, for tables and curves.
        condition: Physics condition; see `conditions`.
        conditioning: Preset that limits the wrench of the residual model.
        wrench: Other settings of that wrench: lead, filter, and changes of the preset.
        seed: Seed of weights, exploration, batches, tasks and sensor noise.
        steps: Greatest number of control steps of all vehicles.
        vehicles: Number of parallel vehicles.
        threads: Threads of updates and physics; another number changes rounding.
        evaluate: Steps between evaluations; each saves the tables.
        checkpoint: Evaluations between checkpoints, from which a training continues.  A checkpoint of 500,000
            transitions takes as long as a thousand updates.
        record: Steps between points of the curves; `evaluate` is a multiple of it.
        episodes: Episodes per evaluation.
        pilot: Success rate at the first level that the hand-written pilot with a map must reach.  If it is
            lower, the vehicle cannot do the task.  0 skips this test.
        demonstrations: Vehicles that the expert flies for one episode's time before a level is learnt; 0
            disables demonstrations.
        clone: Batches of imitation before the policy flies at a level, and after each correction.
        corrections: Greatest number of corrections at a level.  With corrections, the final policy must pass
            the last level of every task.
        lessons: Least number of corrections at a level that imitation alone did not pass.  A policy with few
            corrections may pass in the simulator it was corrected in, and not in another.
        margin: Distance that the expert keeps from pillars, if there is room and it does not follow the
            policy's path [m].  With the planner's margin it cuts corners to a tenth of a metre from the hull,
            and a policy that imitates it inexactly collides.
        pace: Speeds of the expert, in multiples of the baseline pilot's; it bounds the speed of the policy.
        firmness: Actions of the expert per angle of roll, pitch and heading, in multiples of the baseline
            pilot's.  If water turns the hull by more than it can correct, the hull pitches by tens of
            degrees.
        push: Standard deviation of the disturbance of the policy's actions in roll and pitch; in the other
            axes a third of it.  It is applied to every other vehicle in a correction, because other water
            trims the hull differently.
        curriculum: Levels and conditions that pass them.
        sac: Soft actor-critic.
        settings: Environment.
    """

    recipe: str = "paper"
    condition: str = "R_effects"
    conditioning: str = "paper"
    wrench: WrenchSettings = field(default_factory=WrenchSettings)
    seed: int = 0
    steps: int = 500_000
    vehicles: int = 8
    threads: int = 1
    evaluate: int = 20_000
    checkpoint: int = 1
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
        """Check the ranges, and that the periods are multiples of each other.

        Raises:
            UsageError: A number or the seed is not within its range, or records and evaluations are not
                multiples of a step of all vehicles.
        """
        seeds.check(self.seed)
        counts = ("steps", "vehicles", "threads", "evaluate", "checkpoint", "record", "episodes")
        _require_counts({name: getattr(self, name) for name in counts})
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
            raise UsageError("clone needs demonstrations; give a number of vehicles")
        if self.corrections < 0 or (self.corrections and not self.clone):
            raise UsageError("corrections must be 0 or more, and need clone: give clone a number of batches")
        if self.record % self.vehicles or self.evaluate % self.record:
            raise UsageError(
                f"{self.vehicles} vehicles, a record every {self.record} steps and an evaluation every "
                f"{self.evaluate}: each must be a multiple of the one before"
            )

    @property
    def manner(self) -> Manner:
        """Tuning of the expert pilot: its margin, pace and firmness."""
        return Manner(self.margin, self.pace, self.firmness)


PAPER, SAC, IMITATION = "paper", "sac", "imitation"
RENAMED_RECIPES = {"demos": IMITATION}
"""Names of recipes in earlier versions, with their present names."""

RECIPES = {
    PAPER: TrainingConfig(),
    SAC: TrainingConfig(
        recipe=SAC,
        vehicles=64,
        steps=2_000_000,
        evaluate=102_400,
        checkpoint=5,
        record=12_800,
        curriculum=Curriculum(row=(2, 4, 8), examine=25_600),
        sac=SACConfig(
            layers=(128, 128),
            norm=True,
            batch=256,
            rate=1e-3,
            horizon=20,
            average=0.003,
            target_entropy=-3.0,
            capacity=500_000,
            random=20_000,
            updates=3,
            delay=2,
            correlation=0.95,
        ),
    ),
    IMITATION: TrainingConfig(
        recipe=IMITATION,
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
"""Settings by recipe.

`paper`: soft actor-critic with the published settings: 8 vehicles, batches of 512, a buffer of 10^6 and a
learning rate of 3e-4.  `UNPUBLISHED` names the settings that the paper does not state, such as the width of
the networks, the updates per step and the number of steps.
`sac`: soft actor-critic in about a tenth of the processor time, by rewards alone.
`imitation`: imitation of an expert pilot; it makes no update of soft actor-critic if imitation passes.
"""
UNPUBLISHED = (
    "sac.layers", "sac.updates", "steps", "sac.horizon", "sac.tau", "sac.discount", "sac.random",
    "sac.target_entropy", "sac.temperature", "sac.average",
)  # fmt: skip
"""Settings of the recipe `paper` that the paper does not state."""
