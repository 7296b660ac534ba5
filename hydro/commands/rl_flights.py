"""Command `rl eval`: test runs of policies and of a scripted pilot, without exploration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.places import FILE, Output
from hydro.commands.recordings import MaxExpanded
from hydro.commands.shell import STREAM, estimates_beside, progress, seed_option, shows_table, write
from hydro.commands.tables import print_table
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    import polars as pl

    from hydro.core.simulation.estimates import Estimates
    from hydro.io.table import Artefact
    from hydro.rl.environment.fleet import Fleet
    from hydro.rl.tasks.task import Task
    from hydro.rl.training.build import Builder
    from hydro.rl.training.config import TrainingConfig
    from hydro.rl.training.pilots import Actor
    from hydro.rl.training.policy import Policy

Flown = Annotated[
    Path,
    typer.Argument(
        metavar="RUN",
        show_default=False,
        help="Folder of a training, or a vehicle file.",
    ),
]
In = Annotated[
    Literal["kernels", "student", "teacher", "stonefish"],
    typer.Option("--in", help="Simulator; student is MuJoCo."),
]
TaskName = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Task; default: the last of the training."),
]
Stage = Annotated[int | None, typer.Option(min=1, max=3, help="Task of a stage of the curriculum.")]
Level = Annotated[int | None, typer.Option(min=0, help="Number of baffles or pillars.")]
Last = Annotated[
    bool, typer.Option("--last", help="Test the last policy, even if an earlier one passed the task.")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--setting", metavar="NAME", help="Harder condition; may be repeated."),
]
Truth = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Vehicle file to simulate instead."),
]


def builder_of(
    config: TrainingConfig,
    text: str,
    residual: Artefact | None,
    folder: Path | None,
    estimates: Estimates | None = None,
    truth: Path | None = None,
) -> Builder:
    """Return the builder of the fleets (groups of simulated vehicles) of a training.

    Args:
        config: Settings of the training.
        text: Text of the vehicle file.
        residual: Table of the residual model (network); None without one.
        folder: Folder of the vehicle file, which has its hull mesh.
        estimates: Covariance of the vehicle file's parameters; None if they are not drawn at random.
        truth: Vehicle file to simulate instead of the one with the text `text`.
    """
    from hydro.core import effects
    from hydro.io import vehicle
    from hydro.io.model import from_artefact
    from hydro.rl.training.build import Builder

    subject, other = vehicle.parse(text), None if truth is None else vehicle.read(truth)[0]
    for one in (subject, other):
        if one is not None:
            effects.validate(one)
    model = from_artefact(residual) if residual is not None else None
    return Builder(config, subject, model, folder, estimates, other)


def _of_vehicle(path: Path, truth: Path | None) -> Builder:
    """Return the builder of fleets for a vehicle file alone, with all effects of the file.

    Args:
        path: Vehicle file.
        truth: Vehicle file to simulate instead.
    """
    from hydro.io.vehicle import read
    from hydro.rl.training.config import TrainingConfig

    known, text = read(path)
    return builder_of(TrainingConfig(), text, None, path.parent, estimates_beside(path, known), truth)


def _opened(run: Path, task: str | None, truth: Path | None) -> tuple[Policy, list[Artefact], Builder]:
    """Return the policy of a training for a task, its table, and the builder of the training's fleets.

    Args:
        run: Folder of the training.
        task: Task of the policy; None for the last policy.
        truth: Vehicle file to simulate instead.
    """
    from hydro.io import covariance
    from hydro.rl.training.runs import Folder

    folder = Folder(run)
    policy, artefact = folder.policy(task)
    text, kept = folder.run().provenance.vehicle or "", folder.covariance()
    estimates = None if kept is None else covariance.of(kept, str(run))
    builder = builder_of(folder.config(), text, folder.model(), run, estimates, truth)
    return policy, [artefact], builder


def asked_task(run: Path, task: str | None, stage: int | None) -> str | None:
    """Return the name of the task that --task or --stage requests; None if neither is given.

    Args:
        run: Folder of a training, or a vehicle file.
        task: Value of --task.
        stage: Value of --stage: number of a stage of the training's curriculum, from 1.

    Raises:
        UsageError: Both are given.
    """
    from hydro.rl.tasks.registry import STAGES
    from hydro.rl.training.runs import Folder

    if task is not None and stage is not None:
        raise UsageError("--task and --stage both choose the task: give one of them")
    if stage is None:
        return task
    stages = STAGES if is_vehicle(run) else Folder(run).config().curriculum.stages
    return stages[stage - 1]


def is_vehicle(run: Path) -> bool:
    """Return whether a path names a vehicle file, not the folder of a training."""
    return run.is_file() or run.suffix == ".toml"


def flight_of(
    run: Path, wanted: str | None, level: int | None, truth: Path | None = None, *, last: bool = False
) -> tuple[Policy | None, list[Artefact], Builder, Task, int]:
    """Return all that test flights of a training's policy, or of a vehicle file alone, need.

    Args:
        run: Folder of a training, or a vehicle file.
        wanted: Name of the task; by default that of the training.
        level: Level of difficulty of the task; by default the greatest that the training reached.
        truth: Vehicle file to simulate instead of that of the training.
        last: Use the last policy, not the one that passed the task.

    Returns:
        The policy, None for a vehicle file; a list with the table of the policy, empty for a vehicle file;
        the builder of fleets (groups of simulated vehicles); the task; and its level.
    """
    alone = is_vehicle(run)
    policy, learnt, builder = (
        (None, [], _of_vehicle(run, truth)) if alone else _opened(run, None if last else wanted, truth)
    )
    begun = {"task": "point_to_point", "level": 0}
    chosen, level = _task(begun if policy is None else policy.training, builder, wanted, level)
    return policy, learnt, builder, chosen, level


def _task(
    come_to: Mapping[str, Any], builder: Builder, name: str | None, level: int | None
) -> tuple[Task, int]:
    """Return the task and the level to fly, by default those that the training has reached.

    Args:
        come_to: `task` and `level` that the training has reached.
        builder: Builder of fleets, with the curriculum of the training.
        name: Name of the task; None for the default.
        level: Level; None for the default.
    """
    from dataclasses import replace

    from hydro.rl.tasks.registry import STAGES, task_of

    chosen = task_of(name or come_to["task"])
    if level is None:
        levels = dict(replace(builder.config.curriculum, task="", last=len(STAGES)).levels)
        here = come_to["level"] if chosen.name == come_to["task"] else None
        level = levels.get(chosen.name, chosen.most) if here is None else here
    chosen.require(level)
    return chosen, level


def eval_(
    run: Flown,
    simulator: In = "student",
    episodes: Annotated[int, typer.Option(min=1, help="Number of tasks.")] = 200,
    seed: Annotated[int, seed_option("Seed of the tasks and the sensors' noise.")] = 1_000_000,
    task: TaskName = None,
    stage: Stage = None,
    level: Level = None,
    last: Last = False,
    setting: Settings = None,
    truth: Truth = None,
    pilot: Annotated[bool, typer.Option("--pilot/--no-pilot", help="Also test a scripted pilot.")] = True,
    details: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write the episodes of the first row."), FILE
    ] = None,
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    """Run a policy in a simulator and count the successes.

    The same seed gives the same tasks to every policy and in all simulators. The result has the success rate
    with its 95 % interval, collisions, time to goal and energy, also of a scripted pilot in the same tasks.

        task             goal
        point_to_point   a place in open water               (stage 1)
        slalom           baffles from both walls             (stage 2)
        forest           pillars at random, along a plan     (stage 3)
        station_keeping  a place to be held in a current
        circle, helix, lemniscate   a moving point to follow
        docking          a pose, slowly
        pillar_row, waypoints   pillars that may be passed around; places in order

    --setting: no_plan, current, load, dead_thruster, posterior, half_time or all.

    Details:

    --in student is MuJoCo at 500 Hz, kernels the compiled code of the trainings, without MuJoCo, and teacher
    the reference simulator, with panels on the hull. stonefish runs in the program hydro-stonefish.

    The interval is Wilson's. The result also has the distance from the path to follow, and how far baffles or
    pillars are passed on alternating sides. A good policy also succeeds in a simulator in which it was not
    trained, and more often than the scripted pilot (the helmsman). A second row of the pilot, with a map, is
    added if the task has obstacles, and a row of the expert that --recipe imitation learns from, if that is
    another pilot. With a vehicle file as RUN only the pilot runs. On a terminal without -o the result is
    printed.

    With --stage or --task the policy that passed this task in training is tested, if there is one, because
    training for the next stage may undo it; with --last the last policy is tested.

    Values of --setting: no_plan shows the policy its goal instead of a path; current adds a current of 0.3
    m/s; load adds 10 % of the mass on board; dead_thruster stops one thruster; posterior draws parameters
    from the covariance next to the vehicle file; half_time halves the time limit; all tests every setting
    that suits the task; nominal, the default, changes nothing. With --truth the vehicle of that file is
    simulated, while the policy acts as for the vehicle of RUN.
    """
    import polars as pl

    from hydro.io import table
    from hydro.rl.training.evaluate import POLICY, fly
    from hydro.rl.training.trials import NOMINAL, trials_of

    if details is not None and str(details) == STREAM:
        raise UsageError("--details needs a file")
    wanted = asked_task(run, task, stage)
    policy, learnt, builder, chosen, level = flight_of(run, wanted, level, truth, last=last)
    known = builder.estimates is not None and truth is None
    trials = trials_of(setting or [NOMINAL], chosen, estimates=known)
    parameters: dict[str, Any] = {"in": simulator, "episodes": episodes, "seed": seed}

    def made(kind: str, frame: pl.DataFrame) -> Artefact:
        return table.make(kind, frame, stage="rl eval", parameters=parameters, seed=seed, inputs=learnt)

    rows = list[pl.DataFrame]()
    for where, trial in trials.items():
        for name, actor, led in _flyers(policy, chosen, builder.config, pilot=pilot, planless=trial.planless):
            fleet = builder(episodes, seed, simulator, trial)
            fleet.set_level(chosen, level, led=led)
            with progress(f"run {episodes} tasks ({name}, {where})"):
                flown = fly(actor(fleet), fleet)
            if details is not None and not rows:
                table.write(made("episodes", flown), details)
            learning = policy.training if policy is not None and name == POLICY else {}
            who: dict[str, str | int] = {
                "flown_by": name,
                "recipe": builder.config.recipe if policy is not None else "",
            }
            who |= {"condition": builder.config.condition, "seed": builder.config.seed}
            what = {
                "steps": learning.get("steps", 0),
                "updates": learning.get("updates", 0),
                "plant": simulator,
                "purpose": "test",
                "setting": where,
            }
            rows.append(_result(flown, who | what))
    result = pl.concat(rows)
    if shows_table(output):
        print_table(result.drop("purpose"), f"{run}, tested in the {simulator}")
    else:
        write(made("evaluations", result), output)


def _flyers(
    policy: Policy | None, task: Task, config: TrainingConfig, *, pilot: bool, planless: bool
) -> list[tuple[str, Callable[[Fleet], Actor], bool]]:
    """Return name, maker and guidance of each actor that flies: policy and hand-written pilots.

    Args:
        policy: Policy of the training; None for a vehicle file.
        task: The task.
        config: Settings of the training.
        pilot: Whether the hand-written pilots fly, too.
        planless: Whether the planned path is hidden.

    Returns:
        For each actor its name, a function that makes it for a fleet, and whether it sees a planned path.
    """
    from hydro.rl.environment.action import steered_by_fins
    from hydro.rl.environment.helmsman import NAME, PLAIN, TAUGHT, WITH_MAP
    from hydro.rl.training.evaluate import POLICY
    from hydro.rl.training.pilots import WithMap, pilot_of

    flyers = list[tuple[str, "Callable[[Fleet], Actor]", bool]]()
    if policy is not None:
        flyers.append((POLICY, lambda fleet: policy, task.guided and not planless))
    if pilot or policy is None:
        flyers.append((NAME, lambda fleet: pilot_of(task, fins=steered_by_fins(fleet.plant.vehicle)), False))
        if task.levels and not planless:
            flyers.append((WITH_MAP, WithMap, task.guided))
        if config.demonstrations and config.manner != PLAIN and not planless:
            flyers.append((TAUGHT, lambda fleet: WithMap(fleet, config.manner), task.guided))
    return flyers


def _result(flown: pl.DataFrame, what: dict[str, Any]) -> pl.DataFrame:
    """Return the summary of test episodes as one row of an `evaluations` table.

    Args:
        flown: Table of episodes.
        what: Further columns that identify the row.
    """
    import polars as pl

    from hydro.rl.training.evaluate import RARE, summary

    task, level = flown.select("task", "level").row(0)
    found = what | {"task": task, "level": level} | summary(flown)
    rare = dict.fromkeys(("time_to_goal", *RARE), pl.Float64)
    return pl.DataFrame([found], schema_overrides=rare)
