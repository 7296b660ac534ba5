"""`rl eval` and `rl watch`: policies, and a pilot by hand beside them, flown without exploration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.places import FILE, Output
from hydro.commands.shell import STREAM, progress, seed_option, shows_table, write
from hydro.commands.tables import print_table
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    import polars as pl

    from hydro.io.table import Artefact
    from hydro.rl.training.build import Builder
    from hydro.rl.training.config import TrainingConfig
    from hydro.rl.training.evaluate import Actor
    from hydro.rl.training.policy import Policy

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


def builder_of(config: TrainingConfig, text: str, residual: Artefact | None, folder: Path | None) -> Builder:
    """What makes a training's fleets."""
    from hydro.core import effects
    from hydro.io import vehicle
    from hydro.io.model import from_artefact
    from hydro.rl.training.build import Builder

    subject = vehicle.parse(text)
    effects.validate(subject)
    return Builder(config, subject, from_artefact(residual) if residual is not None else None, folder)


def _of_vehicle(path: Path) -> Builder:
    """What makes fleets of a vehicle file under its own effects."""
    from hydro.io.vehicle import read
    from hydro.rl.training.config import TrainingConfig

    return builder_of(TrainingConfig(), read(path)[1], None, path.parent)


def _opened(run: Path) -> tuple[Policy, list[Artefact], Builder]:
    """Policy of a run, its table, and what makes its fleets."""
    from hydro.rl.training.runs import Folder

    folder = Folder(run)
    policy, artefact = folder.policy()
    text = folder.run().provenance.vehicle or ""
    return policy, [artefact], builder_of(folder.config(), text, folder.model(), run)


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
    alone = run.is_file() or run.suffix == ".toml"
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
