"""`rl study`: all conditions, seeds and stages, and their flights in the teacher, as one command."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from hydro.commands.shell import ModelFile, print_table
from hydro.commands.steps import Runner, Step, apart, here
from hydro.core.errors import UsageError

CONDITIONS = ("R_0", "R_MLP", "R_PhysFeat", "R_effects")
SIMULATORS = ("student", "teacher")


@dataclass(frozen=True)
class _Run:
    """One training of a study."""

    condition: str
    seed: int
    folder: Path
    model: Path | None

    @property
    def files(self) -> tuple[Path, ...]:
        """Its tables."""
        return tuple(self.folder / f"{name}.parquet" for name in ("run", "curves", "evaluations", "policy"))

    def tested(self, simulator: str) -> Path:
        """The table of its flights in a simulator."""
        return self.folder / f"{simulator}.parquet"


def study(
    context: typer.Context,
    vehicle: ModelFile,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the study.")],
    model: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Residual model of a condition; repeat for several."),
    ] = None,
    condition: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this condition; repeat for several.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Trainings of each condition.")] = 5,
    stages: Annotated[int, typer.Option(min=1, max=3, help="Last stage of the curriculum.")] = 3,
    steps: Annotated[int, typer.Option(min=1, help="Steps of each training at most.")] = 2_000_000,
    episodes: Annotated[int, typer.Option(min=1, help="Tasks of each test.")] = 200,
    workers: Annotated[int, typer.Option(min=1, help="Steps side by side, each a process.")] = 1,
    choices: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Another choice of every training; repeat."),
    ] = None,
) -> None:
    """Train every condition with several seeds, fly every policy in both simulators, and compare.

    Conditions: R_0 without water forces, R_MLP and R_PhysFeat with residual networks, R_effects with the
    vehicle file's effects. Each training goes through the curriculum and is then tested in the student and
    in the teacher on the same tasks. Every step is an ordinary command, printed as it runs; seeds come
    before conditions, so that a study that is stopped has something of each. One that was interrupted goes
    on where it stopped, inside a training too.

    DIR gets a folder per training, tests.parquet with all tests and curves.png. What is not run, for want of
    a model, is said.
    """
    models = {kind: path for path in model or () for kind in [_kind(path)]}
    runs, left = _runs(condition or CONDITIONS, seeds, models, output)
    output.mkdir(parents=True, exist_ok=True)
    options = [word for one in choices or () for word in ("--set", one)]
    plan: list[Step] = []
    for run in runs:
        plan += _steps(run, vehicle, ["--stages", str(stages), "--steps", str(steps), *options], episodes)
    folders = [str(run.folder) for run in runs]
    everything = tuple(run.folder / "evaluations.parquet" for run in runs)
    plan.append(
        Step(
            ("rl", "curves", *folders, "-o", str(output / "curves.png")), everything, (output / "curves.png",)
        )
    )
    runner = Runner(output, here(context.find_root().command) if workers == 1 else apart)
    ran = runner.run(plan, workers)
    typer.echo(f"{ran} of {len(plan)} steps run, the others were done", err=True)
    _summarise(runs, output)
    for condition_left in left:
        typer.echo(f"not run: {condition_left}, for want of its residual model: add --model FILE", err=True)


def _kind(path: Path) -> str:
    """Architecture of a residual model's file."""
    from hydro.io import table
    from hydro.io.model import from_artefact

    return str(from_artefact(table.read(path, "model")).architecture.get("model"))


def _runs(
    names: Sequence[str], seeds: int, models: dict[str, Path], folder: Path
) -> tuple[list[_Run], list[str]]:
    """The trainings, seeds before conditions, and the conditions that lack their model."""
    from hydro.rl.environment.conditions import CONDITIONS as KNOWN
    from hydro.rl.environment.conditions import MODELS

    if unknown := [name for name in names if name not in KNOWN]:
        raise UsageError(f"no condition is called {unknown[0]!r}: choose of {', '.join(KNOWN)}")
    left = [name for name in names if name in MODELS and MODELS[name] not in models]
    runs = [
        _Run(name, seed, folder / f"{name}-seed{seed}", models.get(MODELS.get(name, "")))
        for seed in range(seeds)
        for name in names
        if name not in left
    ]
    if not runs:
        raise UsageError(f"{', '.join(left)} fly with a residual model: add --model FILE")
    return runs, left


def _steps(run: _Run, vehicle: Path, options: Sequence[str], episodes: int) -> Iterator[Step]:
    """Training and tests of one run."""
    given = () if run.model is None else ("--model", str(run.model))
    which = ("--condition", run.condition, *given, "--seed", str(run.seed))
    reads = (vehicle,) if run.model is None else (vehicle, run.model)
    yield Step(("rl", "train", str(vehicle), *which, *options, "-o", str(run.folder)), reads, run.files)
    for simulator in SIMULATORS:
        flown = ("rl", "eval", str(run.folder), "--in", simulator, "--episodes", str(episodes))
        tested = run.tested(simulator)
        yield Step((*flown, "-o", str(tested)), (run.folder / "policy.parquet",), (tested,))


def _summarise(runs: Sequence[_Run], folder: Path) -> None:
    """Write the tests of all runs as one table, and print it with the divergences."""
    import polars as pl

    from hydro.io import table

    tests = [table.read(run.tested(simulator), "evaluations") for run in runs for simulator in SIMULATORS]
    whole = pl.concat([test.frame for test in tests])
    made = table.make("evaluations", whole, stage="rl study", inputs=tests)
    table.write(made, folder / "tests.parquet")
    shown = whole.select(
        "condition", "seed", "steps", "plant", "stage", "pillars", "success", "success_low", "success_high",
        "collision", "time_to_goal", "energy",
    )  # fmt: skip
    print_table(shown, "Flown without exploration, with 95 % intervals")
