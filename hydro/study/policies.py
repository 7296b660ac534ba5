"""A study of policies: all conditions and seeds, and their flights in both simulators."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hydro.core.errors import UsageError
from hydro.study.steps import Step

if TYPE_CHECKING:
    import polars as pl

CONDITIONS = ("R_0", "R_MLP", "R_PhysFeat", "R_effects")
SIMULATORS = ("student", "teacher")


@dataclass(frozen=True)
class Run:
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


@dataclass(frozen=True)
class Study:
    """What is trained, and where it is kept.

    Attributes:
        folder: Of the study.
        vehicle: The vehicle file.
        models: Residual models of conditions.
        conditions: Physics to train under.
        seeds: Trainings of each.
        stages: Last stage of the curriculum.
        steps: Of each training at most.
        episodes: Tasks of each test.
        recipe: Of every training.
        choices: Other choices of every training, as `NAME=VALUE`.
    """

    folder: Path
    vehicle: Path
    models: tuple[Path, ...] = ()
    conditions: tuple[str, ...] = CONDITIONS
    seeds: int = 5
    stages: int = 3
    steps: int = 2_000_000
    episodes: int = 200
    recipe: str = "paper"
    choices: tuple[str, ...] = ()


def _kind(path: Path) -> str:
    """Architecture of a residual model's file."""
    from hydro.io import table
    from hydro.io.model import from_artefact

    return str(from_artefact(table.read(path, "model")).architecture.get("model"))


def runs(study: Study) -> tuple[list[Run], list[str]]:
    """The trainings, seeds before conditions, and the conditions that lack their model.

    Raises:
        UsageError: There is no such condition, or all lack their model.
    """
    from hydro.rl.environment.conditions import CONDITIONS as KNOWN
    from hydro.rl.environment.conditions import MODELS

    names, models = study.conditions, {_kind(path): path for path in study.models}
    if unknown := [name for name in names if name not in KNOWN]:
        raise UsageError(f"no condition is called {unknown[0]!r}: choose one of {', '.join(KNOWN)}")
    left = [name for name in names if name in MODELS and MODELS[name] not in models]
    found = [
        Run(name, seed, study.folder / f"{name}-seed{seed}", models.get(MODELS.get(name, "")))
        for seed in range(study.seeds)
        for name in names
        if name not in left
    ]
    if not found:
        raise UsageError(f"{', '.join(left)} fly with a residual model: add --model FILE")
    return found, left


def steps(study: Study, of: Sequence[Run]) -> list[Step]:
    """Training and tests of every run, and the curves of all."""
    plan = [step for run in of for step in _of_a_run(study, run)]
    curves, folders = study.folder / "curves.png", [str(run.folder) for run in of]
    reads = tuple(run.folder / "evaluations.parquet" for run in of)
    return [*plan, Step(("rl", "curves", *folders, "-o", str(curves)), reads, (curves,))]


def _of_a_run(study: Study, run: Run) -> Iterator[Step]:
    """Training and tests of one run."""
    given = () if run.model is None else ("--model", str(run.model))
    which = ("--condition", run.condition, *given, "--seed", str(run.seed))
    options = ["--stages", str(study.stages), "--steps", str(study.steps), "--recipe", study.recipe]
    options += [word for one in study.choices for word in ("--set", one)]
    reads = (study.vehicle,) if run.model is None else (study.vehicle, run.model)
    line = ("rl", "train", str(study.vehicle), *which, *options, "-o", str(run.folder))
    yield Step(line, reads, run.files)
    for simulator in SIMULATORS:
        # one pilot stands for all seeds of a condition
        alone = () if run.seed == 0 else ("--no-pilot",)
        flown = ("rl", "eval", str(run.folder), "--in", simulator, "--episodes", str(study.episodes), *alone)
        tested = run.tested(simulator)
        yield Step((*flown, "-o", str(tested)), (run.folder / "policy.parquet",), (tested,))


def summarise(runs: Sequence[Run], folder: Path) -> pl.DataFrame:
    """Write the tests of all runs as one table, and return it."""
    import polars as pl

    from hydro.io import table

    tests = [table.read(run.tested(simulator), "evaluations") for run in runs for simulator in SIMULATORS]
    whole = pl.concat([test.frame for test in tests])
    made = table.make("evaluations", whole, stage="rl study", inputs=tests)
    table.write(made, folder / "tests.parquet")
    return whole
