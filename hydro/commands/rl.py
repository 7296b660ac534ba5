"""Commands `rl`: policies, trained in the MuJoCo model, and tested in it or in the reference simulator."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hydro.commands.places import FILE, TRAINING
from hydro.commands.recordings import MaxExpanded
from hydro.commands.rl_flights import builder_of, eval_
from hydro.commands.rl_recipes import Recipe, current_recipe
from hydro.commands.rl_study import study
from hydro.commands.rl_watch import watch
from hydro.commands.shell import ModelFile, estimates_beside, progress, seed_option
from hydro.commands.tables import print_table
from hydro.core.errors import DataError, UsageError

if TYPE_CHECKING:
    from hydro.rl.training.config import TrainingConfig
    from hydro.rl.training.train import Build, Training

NAME = "rl"
PILOTS, PILOT_SEED = 20, 600_000  # vehicles that a scripted pilot steers before a training
HELP = "Train policies that steer a vehicle, and test them in simulators."

TrainingFolder = Annotated[
    Path, typer.Option("--output", "-o", metavar="DIR", help="Folder of the training."), TRAINING
]
ConditionName = Annotated[
    str, typer.Option(help="Physics: R_0, R_0+M_A, R_MLP, R_PhysFeat, R_structured, R_effects, R_identified.")
]
ResidualModel = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Residual model, for conditions with one."),
]
Steps = Annotated[
    int | None,
    typer.Option(min=1, help="Maximum control steps of all vehicles together; default: of the recipe."),
]
Start = Annotated[
    Path | None,
    typer.Option(
        metavar="RUN",
        help="Begin with the policy of another training.",
    ),
]
TaskAlone = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Train for one task only; see hydro rl eval."),
]
Randomise = Annotated[
    list[str] | None,
    typer.Option(metavar="WHAT", help="What to randomise per episode; may be repeated."),
]
Choices = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Setting, such as sac.batch=256."),
]


def train(
    vehicle: ModelFile,
    output: TrainingFolder,
    condition: ConditionName = "R_effects",
    model: ResidualModel = None,
    seed: Annotated[int, seed_option("Seed of weights, exploration, tasks and noise.")] = 0,
    stages: Annotated[int, typer.Option(min=1, max=3, help="Last stage of the curriculum.")] = 1,
    task: TaskAlone = None,
    steps: Steps = None,
    start: Start = None,
    recipe: Recipe = "paper",
    randomise: Randomise = None,
    choices: Choices = None,
    max_expanded: MaxExpanded = None,
) -> None:
    """Train a policy by SAC or by imitation, see --recipe.

    Stage 1 is point to point, stage 2 a slalom, stage 3 a forest of pillars. DIR gets the policy, all
    settings and the evaluations. The same command again resumes. --randomise posterior draws the vehicle of
    each episode from the covariance stored next to its file, --randomise 0.2 from 20 % about its values.

        recipe     learns by            settings
        paper      rewards (SAC)        those of the paper where it gives them
        sac        rewards (SAC)        64 vehicles, a tenth of the time
        imitation  an expert's actions  no SAC update as long as imitation passes

        hydro rl train vehicle.toml --recipe sac --randomise posterior -o run

    Details:

    The slalom has none to four baffles; with --recipe sac stage 2 is a row of two, four and eight pillars
    instead (curriculum.row), because rewards alone do not lead through a slalom. The forest has a planned way
    to follow. Once 90 % of 150 episodes of training succeed (curriculum.ready), as many are run without
    exploration, of which 97 % pass a level (curriculum.share). With --recipe sac such an examination follows
    every 25,600 steps (curriculum.examine). Training ends with the last level or with the steps.

    With --recipe imitation a scripted expert with a map steers first and the policy imitates it (behavioural
    cloning). Then the policy steers, the expert labels the states that it visits (DAgger), and the policy
    imitates these labels, until it passes. Levels that it still does not pass it learns by rewards, with
    runs of the expert in half of every batch. All levels are rehearsed, and the last policy passes the
    last level of every task. Stage 2 begins with all four baffles.

    DIR gets run.parquet with all settings, curves.parquet, evaluations.parquet and policy.parquet at every
    evaluation, and a checkpoint. A resumed training has the same bits as an uninterrupted one; with more
    --steps, --stages or another curriculum it continues. With --recipe sac every fifth evaluation writes a
    checkpoint. Lines of progress, curves and evaluations state the recipe and the number of SAC updates. With
    --start a policy of one condition is trained further under another, from the first level.

    --randomise current=0.3 draws a current of up to 0.3 m/s, load=0.1 a payload of up to 10 % of the mass,
    thruster=1 the share of thrust that one thruster has lost, bias=1 biases as large as the noise of the
    sensors, delay=0.1 and late=0.1 the delays of sensors and commands [s]. `hydro fit`, `add` and `explain`
    write the covariance next to the file.

    Vehicles fly in this project's own kernels, about five times as fast as in MuJoCo; --set
    settings.engine=mujoco trains in MuJoCo at 500 Hz, as in the paper.
    """
    given = _Given(
        vehicle, output, condition, model, seed, stages, task or "", steps, start, recipe,
        (*_drawn(randomise or ()), *(choices or ())),
    )  # fmt: skip
    _train(given)


def _drawn(words: Sequence[str]) -> Iterator[str]:
    """Yield the words of --randomise as settings `NAME=VALUE`.

    Raises:
        UsageError: A word is neither `posterior`, nor a share, nor a name with a value.
    """
    group = "settings.randomise"
    for word in words:
        name, equals, value = word.partition("=")
        if word == "posterior":
            yield f"{group}.posterior=true"
        elif equals:
            yield f"{group}.{name}={value}"
        elif word.replace(".", "", 1).isdecimal():
            yield f"{group}.box={word}"
        else:
            raise UsageError(
                f"--randomise {word}: give posterior, a share such as 0.2, or a name and a value such as "
                "current=0.3"
            )


@dataclass(frozen=True)
class _Given:
    """Arguments of `train`."""

    vehicle: Path
    output: Path
    condition: str
    model: Path | None
    seed: int
    stages: int
    task: str
    steps: int | None
    start: Path | None
    recipe: str
    choices: tuple[str, ...]


def _train(given: _Given) -> None:
    """Start or resume a training, and print its progress."""
    from hydro.io import table
    from hydro.io.covariance import KIND, beside
    from hydro.io.vehicle import read as read_vehicle
    from hydro.rl.training.config import PAPER, UNPUBLISHED
    from hydro.rl.training.runs import Folder, run_artefact
    from hydro.rl.training.train import Training

    known, text = read_vehicle(given.vehicle)
    estimates = estimates_beside(given.vehicle, known)
    covariance = None if estimates is None else table.read(beside(given.vehicle), KIND)
    residual = table.read(given.model, "model") if given.model is not None else None
    config = _config(given)
    first = None if given.start is None else Folder(given.start).policy()[1]
    folder, run = Folder(given.output), run_artefact(config, text, residual, covariance, first)
    state = folder.state(run)
    clock = _Clock()
    with progress("prepare"):  # shows that it runs: the first fleet may compile, and a pilot makes flights
        builder = builder_of(config, text, residual, given.vehicle.parent, estimates)
        learnt = Folder(given.start).learnt() if given.start is not None and state is None else None
        training = Training(config, builder, clock.part, learnt)
        if state is None:
            _require_ability(config, builder, given.vehicle)
    folder.begin(run, residual, covariance)
    if state is not None:
        training.restore(state)
        typer.echo(f"{given.output}: resumes after {training.steps:,} steps", err=True)
    else:
        print_table(run.frame, f"{given.output}: all settings; --set NAME=VALUE changes one", _stderr())
        if config.recipe == PAPER:
            typer.echo(f"the paper does not state, chosen here: {', '.join(UNPUBLISHED)}", err=True)
    clock.start(training)
    with progress("train") as update:
        while not training.finished:
            training.advance(lambda one: update(one.steps, one.config.steps, clock.words(one)))
            folder.save(training, run)
            typer.echo(f"{clock.words(training)}; {_evaluated(training)}; {clock.shares()}", err=True)
    typer.echo(_ending(training), err=True)


def _require_ability(config: TrainingConfig, builder: Build, vehicle: Path) -> None:
    """Refuse a vehicle with which the scripted pilot reaches too few goals of the first level.

    Raises:
        DataError: The pilot reaches too few goals.
    """
    from hydro.rl.training.demonstrations import mastered

    if not config.pilot:
        return
    fleet = builder(PILOTS, config.seed + PILOT_SEED)
    fleet.set_level(*config.curriculum.levels[0])
    share = mastered(fleet)
    if share < config.pilot:
        raise DataError(
            f"{vehicle}: the scripted pilot with a map reaches {share:.0%} of the goals of "
            f"{fleet.task.name} in {fleet.task.steps(fleet.settings)} steps, so that no policy can pass it: "
            "too weak or too slow for the task; give it time with --set settings.task.steps=N, or train it "
            "all the same with --set pilot=0"
        )


def _config(given: _Given) -> TrainingConfig:
    """Return all settings of a training; print a line on stderr for each name of an earlier version."""
    from hydro.rl.training.config import RECIPES
    from hydro.rl.training.runs import changed, current_name

    recipe = RECIPES[current_recipe(given.recipe)]
    config = replace(
        recipe,
        condition=given.condition,
        seed=given.seed,
        steps=given.steps or recipe.steps,
        curriculum=replace(recipe.curriculum, last=given.stages, task=given.task),
    )
    choices = dict(_choice(one) for one in given.choices)
    for name in choices:
        if (present := current_name(name)) != name:
            typer.echo(
                f"hydro: --set {name} is called {present} now; the next version will not know it", err=True
            )
    return changed(config, choices)


def _choice(text: str) -> tuple[str, str]:
    """Return the name and the JSON value in a `--set NAME=VALUE`; a word without quotes is a string."""
    import json

    name, equals, value = text.partition("=")
    if not equals:
        raise UsageError(f"--set {text}: give a name and a value, such as sac.batch=256")
    try:
        json.loads(value)
    except ValueError:
        value = json.dumps(value)
    return name, value


class _Clock:
    """Clock of a training: speed, maximum remaining time, and share of time of each part of the work."""

    def __init__(self) -> None:
        self._first, self._started = 0, time.perf_counter()
        self._spent: dict[str, float] = {}

    def start(self, training: Training) -> None:
        """Set the clock to zero: count steps and time from now on."""
        self._first, self._started = training.steps, time.perf_counter()

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Count the time of a `with` block for one part of a training's work.

        Args:
            name: Name of the part.
        """
        before = time.perf_counter()
        yield
        self._spent[name] = self._spent.get(name, 0.0) + time.perf_counter() - before

    def shares(self) -> str:
        """Return the share of time of each part of the work, as text."""
        whole = time.perf_counter() - self._started
        return ", ".join(f"{name} {spent / whole:.0%}" for name, spent in self._spent.items())

    def words(self, training: Training) -> str:
        """Return a training's steps, steps per second, level, success and maximum remaining time, as text."""
        rate = (training.steps - self._first) / max(time.perf_counter() - self._started, 1e-9)
        left = (training.config.steps - training.steps) / rate if rate else 0.0
        return (
            f"{training.config.recipe}: {training.steps:,} steps, {training.updates:,} SAC updates, "
            f"{rate:.0f} steps/s, {_level(training)}, "
            f"success {training.curriculum.share:.0%}, at most {left / 60.0:.0f} min left"
        )


def _evaluated(training: Training) -> str:
    """Return the last evaluation in a few words."""
    last = training.evaluations[-1]
    return f"without exploration {last['success']:.0%} of {last['episodes']}, reward {last['reward']:.3g}"


def _ending(training: Training) -> str:
    """Return a sentence on the end of a training."""
    if verdict := training.watch.verdict:
        return (
            f"{training.config.recipe}: diverged ({verdict}) by {training.steps:,} steps and "
            f"{training.updates:,} SAC updates; {training.watch.episodes} episodes did"
        )
    if training.curriculum.done:
        name, level = training.curriculum.level
        last = {"purpose": "exam", "task": name, "level": level}
        exam = next(one for one in reversed(training.evaluations) if one.items() >= last.items())
        low, high = exam["success_low"], exam["success_high"]
        return (
            f"{training.config.recipe}: passed its last level, {_level(training)}, after "
            f"{training.steps:,} steps and {training.updates:,} SAC updates: "
            f"{exam['success']:.1%} of {exam['episodes']} episodes without exploration "
            f"[{low:.1%}, {high:.1%}]"
        )
    return (
        f"{training.config.recipe}: the limit of steps is reached in {_level(training)} after "
        f"{training.updates:,} SAC updates: continue with more --steps"
    )


def _level(training: Training) -> str:
    """Return the present level of a training in words."""
    from hydro.rl.tasks.registry import TASKS

    name, level = training.curriculum.level
    counted = TASKS[name].levels
    return name + (f" with {level} {counted}" if counted else "")


def _stderr() -> Any:
    from rich.console import Console

    return Console(stderr=True, highlight=False, markup=False)


def curves(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of trainings.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="A .png."), FILE],
    max_expanded: MaxExpanded = None,
) -> None:
    """Draw the learning curves of trainings, averaged over seeds.

    Mean and one standard deviation, condition by condition, of reward and success in the evaluations without
    exploration, over the control steps of all vehicles together. A training that has passed its curriculum
    keeps its last value.
    """
    from hydro.report.training import curves_table, draw_curves, save, together
    from hydro.rl.training.runs import Folder

    found = together([Folder(run).evaluations().frame for run in runs])
    save(draw_curves(curves_table(found)), output)


COMMANDS: dict[Callable[..., None], str] = {
    train: "hydro rl train datasets/vehicles/auv151.toml --condition R_effects --seed 0 -o run",
    eval_: "hydro rl eval run --in teacher --episodes 200 -o teacher.parquet",
    watch: "hydro rl watch run -o path.png",
    curves: "hydro rl curves run -o curves.png",
    study: "hydro rl study datasets/vehicles/auv151.toml --model physfeat.parquet -o study",
}
