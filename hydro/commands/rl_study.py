"""Command `rl study`: trainings under all conditions and seeds, and their tests in both simulators."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hydro.commands.engines import HERE, Address, EngineName, Threads, runner
from hydro.commands.help import CLUSTER
from hydro.commands.places import FOLDER
from hydro.commands.recordings import MaxExpanded
from hydro.commands.rl_recipes import Recipe, current_recipe
from hydro.commands.shell import ModelFile, message
from hydro.commands.tables import print_table

Folder = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the study."), FOLDER]
Models = Annotated[
    list[Path] | None,
    typer.Option(metavar="FILE", help="Residual model of a condition; may be repeated."),
]
Identified = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Fitted vehicle file, of R_identified."),
]
Conditions = Annotated[
    list[str] | None, typer.Option(metavar="NAME", help="Only this condition; may be repeated.")
]
Choices = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Setting of every training."),
]


def study(
    context: typer.Context,
    vehicle: ModelFile,
    output: Folder,
    model: Models = None,
    identified: Identified = None,
    condition: Conditions = None,
    seeds: Annotated[int, typer.Option(min=1, help="Trainings of each condition.")] = 5,
    stages: Annotated[int, typer.Option(min=1, max=3, help="Last stage of the curriculum.")] = 3,
    steps: Annotated[int, typer.Option(min=1, help="Steps of each training at most.")] = 2_000_000,
    episodes: Annotated[int, typer.Option(min=1, help="Tasks of each test.")] = 200,
    workers: Annotated[int, typer.Option(min=1, help="Steps at a time.", rich_help_panel=CLUSTER)] = 1,
    recipe: Recipe = "paper",
    choices: Choices = None,
    max_expanded: MaxExpanded = None,
    engine: EngineName = HERE,
    address: Address = None,
    threads: Threads = 1,
) -> None:
    """Train all conditions with several seeds and compare the policies.

    Each training goes through the curriculum; its policy then runs the task of every stage in the MuJoCo
    model and in the reference simulator of VEHICLE, as do scripted pilots. Each step is an ordinary command,
    printed as it runs. An interrupted study resumes where it stopped, also within a training.

    Details:

    Conditions: R_0 without water forces; R_0+M_A with added mass and a network whose output is zero; R_MLP,
    R_PhysFeat and R_structured with residual networks; R_effects with the effects of the vehicle file;
    R_identified with those of a file that was identified from data of the reference simulator. All policies
    run the same tasks. Trainings run seed by seed, so that a stopped study has some of each. With --engine
    ray steps run on the nodes of a Ray cluster, as many as have room, and --workers does not count.

    DIR gets a folder per training, tests.parquet with all tests, and curves.png. A line names conditions that
    are not run because a file is missing.
    """
    from hydro.study import policies

    known = policies.Study(
        output,
        vehicle,
        models=tuple(model or ()),
        identified=identified,
        conditions=tuple(condition or policies.CONDITIONS),
        seeds=seeds,
        stages=stages,
        steps=steps,
        episodes=episodes,
        recipe=current_recipe(recipe),
        choices=tuple(choices or ()),
        max_expanded=max_expanded,
    )
    runs, left = policies.runs(known)
    plan = policies.steps(known, runs)
    with runner(context, output, workers, engine, address, threads) as (steps_of, together):
        ran = steps_of.run(plan, together)
    message(f"{ran} of {len(plan)} steps run, the others were done")
    shown = policies.summarise(known, runs).select(
        "condition", "flown_by", "seed", "steps", "plant", "task", "level",
        "success", "success_low", "success_high", "collision", "time_to_goal", "energy",
    )  # fmt: skip
    print_table(shown, "Without exploration, with 95 % intervals")
    for want in left:
        message(f"not run: {want}")
