"""`rl`: policies that steer the vehicle, trained in the student and flown in the student or the teacher."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.places import FILE, FOLDER, Output
from hydro.commands.rl_study import study
from hydro.commands.shell import STREAM, ModelFile, progress, seed_option, shows_table, write
from hydro.commands.tables import print_table
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    import polars as pl

    from hydro.io.table import Artefact
    from hydro.rl.training.build import Builder
    from hydro.rl.training.config import TrainingConfig
    from hydro.rl.training.evaluate import Actor
    from hydro.rl.training.policy import Policy
    from hydro.rl.training.train import Training

NAME = "rl"
HELP = "Train policies that steer the vehicle in MuJoCo, and see whether they hold in the teacher."

Flown = Annotated[
    Path,
    typer.Argument(
        metavar="RUN",
        show_default=False,
        help="Folder of a training, or a vehicle file for the pilot alone.",
    ),
]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", show_default=False, help="Folder of a training.")]
In = Annotated[Literal["student", "teacher"], typer.Option("--in", help="Where to fly.")]
Stage = Annotated[
    int | None, typer.Option(min=1, max=3, help="Stage to fly; default: the one that training has come to.")
]
Pillars = Annotated[int | None, typer.Option(min=0, help="Pillars of stage 2 and 3; default: likewise.")]


TrainingFolder = Annotated[
    Path, typer.Option("--output", "-o", metavar="DIR", help="Folder of the training."), FOLDER
]
ConditionName = Annotated[
    str, typer.Option(help="Physics: R_0, R_MLP, R_PhysFeat, R_structured or R_effects.")
]
ResidualModel = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Residual model, for the conditions that fly with one."),
]
Steps = Annotated[int, typer.Option(min=1, help="Control steps of all vehicles together at most.")]
Start = Annotated[
    Path | None,
    typer.Option(
        metavar="RUN",
        help="Begin with what another training has learnt, under whatever physics; not with its levels.",
    ),
]
Recipe = Annotated[
    Literal["paper", "demos"],
    typer.Option(help="Choices that go together: as in the paper, or begun with what a pilot by hand does."),
]
Choices = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Another choice, such as sac.batch=256; repeat."),
]


def train(
    vehicle: ModelFile,
    output: TrainingFolder,
    condition: ConditionName = "R_effects",
    model: ResidualModel = None,
    seed: Annotated[int, seed_option("Of weights, exploration, tasks and noise.")] = 0,
    stages: Annotated[int, typer.Option(min=1, max=3, help="Last stage of the curriculum.")] = 1,
    steps: Steps = 500_000,
    start: Start = None,
    recipe: Recipe = "paper",
    choices: Choices = None,
) -> None:
    """Train a policy in the student by soft actor-critic, through the stages of a curriculum.

    Stage 1 is point to point in open water, stage 2 pillars, from none to a slalom of eight, stage 3 a
    planned way to follow. Once 90 % of 150 episodes of training succeed (curriculum.ready) as many are flown
    without exploration, of which 97 % pass a level (curriculum.share). Training ends with the last level or
    with the steps.

    With --recipe demos a pilot by hand, who has the map, flies each level first. The policy is made to do as
    he does, is examined at once and every 10,000 steps, and keeps his flights in half of every batch, with
    critics whose layers are normalised: a level that he masters is passed in seconds.

    DIR gets run.parquet with every choice, curves.parquet, evaluations.parquet and policy.parquet, written
    at every evaluation, and a checkpoint. The same command again goes on where it stopped, with the same
    bits as if it never had; with more --steps, --stages or another curriculum it goes on beyond. With --start
    a policy that has learnt under one condition learns on under another, from the first level.
    """
    given = _Given(
        vehicle, output, condition, model, seed, stages, steps, start, recipe, tuple(choices or ())
    )
    _train(given)


@dataclass(frozen=True)
class _Given:
    """What `train` was called with."""

    vehicle: Path
    output: Path
    condition: str
    model: Path | None
    seed: int
    stages: int
    steps: int
    start: Path | None
    recipe: str
    choices: tuple[str, ...]


def _train(given: _Given) -> None:
    """Begin a training, or go on with it, and tell how it goes."""
    from hydro.io import table
    from hydro.io.vehicle import read as read_vehicle
    from hydro.rl.training.runs import Folder, run_artefact
    from hydro.rl.training.train import Training

    _, text = read_vehicle(given.vehicle)
    residual = table.read(given.model, "model") if given.model is not None else None
    config = _config(given)
    first = None if given.start is None else Folder(given.start).policy()[1]
    folder, run = Folder(given.output), run_artefact(config, text, residual, first)
    builder = _builder(config, text, residual, given.vehicle.parent)
    state = folder.state(run)
    clock = _Clock()
    learnt = Folder(given.start).learnt() if given.start is not None and state is None else None
    training = Training(config, builder, clock.part, learnt)
    folder.begin(run, residual)
    if state is not None:
        training.restore(state)
        typer.echo(f"{given.output}: goes on after {training.steps:,} steps", err=True)
    else:
        print_table(run.frame, f"{given.output}: every choice; --set NAME=VALUE makes another", _stderr())
    clock.start(training)
    with progress("train") as update:
        while not training.finished:
            training.advance(lambda one: update(one.steps, one.config.steps, clock.words(one)))
            folder.save(training, run)
            typer.echo(f"{clock.words(training)}; {_evaluated(training)}; {clock.shares()}", err=True)
    typer.echo(_ending(training), err=True)


def _config(given: _Given) -> TrainingConfig:
    """All choices of a training; a line on stderr for each under the name of an earlier version."""
    from hydro.rl.training.config import RECIPES
    from hydro.rl.training.runs import changed, current_name

    recipe = RECIPES[given.recipe]
    config = replace(
        recipe,
        condition=given.condition,
        seed=given.seed,
        steps=given.steps,
        curriculum=replace(recipe.curriculum, last=given.stages),
    )
    choices = dict(_choice(one) for one in given.choices)
    for name in choices:
        if (present := current_name(name)) != name:
            typer.echo(
                f"hydro: --set {name} is called {present} now; the next version will not know it", err=True
            )
    return changed(config, choices)


def _choice(text: str) -> tuple[str, str]:
    """Name and value in JSON of a `--set`; a bare word is a text."""
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
    """Tells how fast a training goes, how long it may take at most, and where the time goes."""

    def __init__(self) -> None:
        self._first, self._started = 0, time.perf_counter()
        self._spent: dict[str, float] = {}

    def start(self, training: Training) -> None:
        """Count steps and time from here on."""
        self._first, self._started = training.steps, time.perf_counter()

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Add the time of a block to a part of the work."""
        before = time.perf_counter()
        yield
        self._spent[name] = self._spent.get(name, 0.0) + time.perf_counter() - before

    def shares(self) -> str:
        """Where the time has gone."""
        whole = time.perf_counter() - self._started
        return ", ".join(f"{name} {spent / whole:.0%}" for name, spent in self._spent.items())

    def words(self, training: Training) -> str:
        """Steps, steps per second, success, stage and time left."""
        rate = (training.steps - self._first) / max(time.perf_counter() - self._started, 1e-9)
        left = (training.config.steps - training.steps) / rate if rate else 0.0
        stage, pillars = training.curriculum.level
        where = f"stage {stage}" + (f" with {pillars} pillars" if stage > 1 else "")
        return (
            f"{training.steps:,} steps, {rate:.0f}/s, {where}, success {training.curriculum.share:.0%}, "
            f"at most {left / 60.0:.0f} min left"
        )


def _evaluated(training: Training) -> str:
    """The last evaluation in a few words."""
    last = training.evaluations[-1]
    return f"without exploration {last['success']:.0%} of {last['episodes']}, reward {last['reward']:.3g}"


def _ending(training: Training) -> str:
    """How a training ended."""
    if verdict := training.watch.verdict:
        return f"diverged ({verdict}) by {training.steps:,} steps; {training.watch.episodes} episodes did"
    if training.curriculum.done:
        return f"passed its last level after {training.steps:,} steps"
    stage, pillars = training.curriculum.level
    return f"its steps are used up in stage {stage} with {pillars} pillars: go on with more --steps"


def _builder(config: TrainingConfig, text: str, residual: Artefact | None, folder: Path | None) -> Builder:
    """What makes a training's fleets."""
    from hydro.core import effects
    from hydro.io import vehicle
    from hydro.io.model import from_artefact
    from hydro.rl.training.build import Builder

    subject = vehicle.parse(text)
    effects.validate(subject)
    return Builder(config, subject, from_artefact(residual) if residual is not None else None, folder)


def _stderr() -> Any:
    from rich.console import Console

    return Console(stderr=True, highlight=False, markup=False)


def _of_vehicle(path: Path) -> Builder:
    """What makes fleets of a vehicle file under its own effects."""
    from hydro.io.vehicle import read
    from hydro.rl.training.config import TrainingConfig

    return _builder(TrainingConfig(), read(path)[1], None, path.parent)


def _opened(run: Path) -> tuple[Policy, list[Artefact], Builder]:
    """Policy of a run, its table, and what makes its fleets."""
    from hydro.rl.training.runs import Folder

    folder = Folder(run)
    policy, artefact = folder.policy()
    text = folder.run().provenance.vehicle or ""
    return policy, [artefact], _builder(folder.config(), text, folder.model(), run)


def _level(come_to: Mapping[str, Any], stage: int | None, pillars: int | None) -> tuple[int, int]:
    """Stage and pillars to fly, by default those that training has come to."""
    stage = come_to["stage"] if stage is None else stage
    if stage == 1:
        return 1, 0
    return stage, come_to["pillars"] if pillars is None else pillars


def eval_(
    run: Flown,
    simulator: In = "student",
    episodes: Annotated[int, typer.Option(min=1, help="Tasks to fly.")] = 200,
    seed: Annotated[int, seed_option("Of the tasks and the sensors' noise.")] = 1_000_000,
    stage: Stage = None,
    pillars: Pillars = None,
    pilot: Annotated[
        bool, typer.Option("--pilot/--no-pilot", help="Fly the same tasks with a pilot by hand, too.")
    ] = True,
    details: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write the episodes one by one."), FILE
    ] = None,
    output: Output = STREAM,
) -> None:
    """Fly a trained policy without exploration, in the simulator it was trained in or in the teacher.

    The same seed gives the same tasks to every policy and in both simulators: starts, goals and pillars.
    Success with its 95 % interval (Wilson), collisions, time to goal of those that arrived, energy, distance
    from a planned way, and how far the pillars are passed on alternating sides. A policy that wins in its own
    simulator alone has not won, nor one that the helmsman beats: a pilot by hand of eight lines, who flies
    the same tasks besides (stage 3 with the map, stages 1 and 2 without). With a vehicle file in the place
    of RUN he flies alone. On a terminal without -o the result is printed.
    """
    import polars as pl

    from hydro.io import table
    from hydro.rl.environment.helmsman import NAME as HELMSMAN
    from hydro.rl.environment.helmsman import helmsman
    from hydro.rl.training.evaluate import POLICY, fly

    if details is not None and str(details) == STREAM:
        raise UsageError("--details needs a file")
    alone = run.is_file()
    policy, learnt, builder = (None, [], _of_vehicle(run)) if alone else _opened(run)
    begun = {"stage": 1, "pillars": builder.config.settings.world.pillars}
    level = _level(begun if policy is None else policy.training, stage, pillars)
    parameters = {"in": simulator, "episodes": episodes, "seed": seed}

    def made(kind: str, frame: pl.DataFrame) -> Artefact:
        return table.make(kind, frame, stage="rl eval", parameters=parameters, seed=seed, inputs=learnt)

    actors: dict[str, Actor] = {} if policy is None else {POLICY: policy}
    actors |= {HELMSMAN: helmsman} if alone or pilot else {}
    rows = list[pl.DataFrame]()
    for name, actor in actors.items():
        fleet = builder(episodes, seed, simulator)
        fleet.set_level(*level)
        with progress(f"fly {episodes} tasks ({name})"):
            flown = fly(actor, fleet)
        if details is not None and not rows:
            table.write(made("episodes", flown), details)
        steps = 0 if policy is None or name == HELMSMAN else policy.training["steps"]
        who = {"flown_by": name, "condition": builder.config.condition, "seed": builder.config.seed}
        rows.append(_result(flown, who | {"steps": steps, "plant": simulator, "purpose": "test"}))
    result = pl.concat(rows)
    if shows_table(output):
        print_table(result.drop("purpose"), f"{run}, flown in the {simulator}")
    else:
        write(made("evaluations", result), output)


def _result(flown: pl.DataFrame, what: dict[str, Any]) -> pl.DataFrame:
    """What flown episodes come to, behind what they are: one row of `evaluations`."""
    import polars as pl

    from hydro.rl.training.evaluate import RARE, summary

    stage, pillars = flown.select("stage", "pillars").row(0)
    found = what | {"stage": stage, "pillars": pillars} | summary(flown)
    rare = dict.fromkeys(("time_to_goal", *RARE), pl.Float64)
    return pl.DataFrame([found], schema_overrides=rare)


def watch(
    run: RunFolder,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="A .png or an .mp4."), FILE],
    simulator: In = "student",
    task: Annotated[int, seed_option("Seed of the task to fly.")] = 0,
    stage: Stage = None,
    pillars: Pillars = None,
) -> None:
    """See a trained policy fly one task: its path with pillars and plan, or a film of it.

    A .png shows the path in its tank, from above and from the side. An .mp4 is rendered by MuJoCo
    off-screen, and needs the extra `video` and, on a machine without a display, MUJOCO_GL=egl or osmesa.
    """
    if output.suffix not in (".png", ".mp4"):
        raise UsageError(f"{output}: name a .png for a picture or an .mp4 for a film")
    from hydro.rl.training.evaluate import trace

    policy, _, builder = _opened(run)
    fleet = builder(1, task, simulator)
    fleet.set_level(*_level(policy.training, stage, pillars))
    flight = trace(policy, fleet)
    settings, ending = builder.config.settings, f"{flight.outcome} after {flight.t[-1]:.1f} s"
    world = settings.world
    size = world.length, world.width, world.depth
    if output.suffix == ".mp4":
        from hydro.sim.film import Flown, film

        flown = Flown(flight.pose, flight.targets, flight.pillars, settings.period)
        film(builder.vehicle, flown, size, radius=world.pillar_radius, output=output)
    else:
        from hydro.report.training import Tank, draw_flight, save

        title = f"{builder.config.condition}, seed {builder.config.seed}, in the {simulator}: {ending}"
        tank = Tank(size, flight.pillars, world.pillar_radius, flight.goal, settings.task.radius)
        save(draw_flight(flight.pose[:, :3], flight.way, tank, title), output)
    typer.echo(f"{output}: {ending}", err=True)


def curves(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="Folders of trainings.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="A .png."), FILE],
) -> None:
    """Draw how trainings went: mean and one standard deviation over seeds, condition by condition.

    Reward and success of the evaluations without exploration, over the control steps of all vehicles
    together; a training that has passed its curriculum keeps its last value.
    """
    from hydro.report.training import curves_table, draw_curves, save, together
    from hydro.rl.training.runs import Folder

    found = together([Folder(run).evaluations().frame for run in runs])
    save(draw_curves(curves_table(found)), output)


COMMANDS: dict[Callable[..., None], str] = {
    train: "hydro rl train datasets/vehicles/auv151.toml --condition R_effects --seed 0 -o run",
    eval_: "hydro rl eval run --in teacher --episodes 200 -o teacher.parquet",
    watch: "hydro rl watch run -o flight.png",
    curves: "hydro rl curves run -o curves.png",
    study: "hydro rl study datasets/vehicles/auv151.toml --model physfeat.parquet -o study",
}
