"""Study of policies: trainings of all conditions and seeds, and test flights in both simulators."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hydro.core.errors import UsageError
from hydro.study.steps import Step

if TYPE_CHECKING:
    import polars as pl

    from hydro.rl.training.config import Curriculum

CONDITIONS = ("R_0", "R_0+M_A", "R_MLP", "R_PhysFeat", "R_structured", "R_effects", "R_identified")
"""Physics under which policies are trained, in the order of the results."""
SIMULATORS = ("kernels", "student", "teacher")
"""Simulators of the test flights: the kernels, the MuJoCo model and the reference simulator."""


@dataclass(frozen=True)
class Run:
    """One training of a policy in a study.

    Attributes:
        condition: Name of the water model in which the policy is trained, such as `R_PhysFeat`.
        seed: Seed of the training.
        folder: Folder of the training.
        vehicle: Vehicle file.
        model: File of the residual model (network); None without one.
    """

    condition: str
    seed: int
    folder: Path
    vehicle: Path
    model: Path | None

    @property
    def files(self) -> tuple[Path, ...]:
        """Paths of the four tables that the training writes, whether they exist or not."""
        return tuple(self.folder / f"{name}.parquet" for name in ("run", "curves", "evaluations", "policy"))

    def tested(self, simulator: str, stage: int) -> Path:
        """Return the path of the table of the policy's test flights.

        Args:
            simulator: Name of the simulator in which the policy flies.
            stage: Stage of the curriculum whose task the policy flies.
        """
        return self.folder / f"{simulator}-{stage}.parquet"


@dataclass(frozen=True)
class Study:
    """Settings of a study that trains policies under several conditions (water models) and tests them.

    Attributes:
        folder: Folder of the study.
        vehicle: Vehicle file of the reference simulator.
        models: Files of the residual models (networks) of the conditions that need one.
        identified: Vehicle file that was identified from data of the reference simulator, for `R_identified`.
        given: Vehicle file with effects that were chosen without data, for `R_effects`; by default `vehicle`.
        conditions: Names of the water models in which policies are trained.
        seeds: Number of trainings under each condition.
        stages: Last stage of the curriculum.
        steps: Maximum number of control steps of each training.
        episodes: Number of episodes of each test.
        recipe: Name of the settings of every training.
        choices: Other settings of every training, as `NAME=VALUE`.
        last: Whether the last policy of a training flies all tests.  By default the policy that passed a task
            flies it, if there is one.
        max_expanded: Largest size of a file that a step reads, once decompressed [GB]; None for the default.
    """

    folder: Path
    vehicle: Path
    models: tuple[Path, ...] = ()
    identified: Path | None = None
    given: Path | None = None
    conditions: tuple[str, ...] = CONDITIONS
    seeds: int = 5
    stages: int = 3
    steps: int = 2_000_000
    episodes: int = 200
    recipe: str = "paper"
    choices: tuple[str, ...] = ()
    last: bool = False
    max_expanded: float | None = None

    @property
    def reading(self) -> tuple[str, ...]:
        """Words of command-line options with which every step reads files; empty for the default limit."""
        from hydro.io.readers.expansion import OPTION

        return () if self.max_expanded is None else (OPTION, f"{self.max_expanded:g}")

    @property
    def levels(self) -> list[tuple[str, int]]:
        """Task and greatest level of every stage, as a list of pairs in the order of the stages."""
        from dataclasses import replace

        return list(dict(replace(self.curriculum, task="", last=self.stages).levels).items())

    @property
    def curriculum(self) -> Curriculum:
        """Curriculum of the trainings: the settings of the recipe, changed by `choices`."""
        from hydro.rl.training.config import RECIPES
        from hydro.rl.training.runs import changed

        chosen = {name: value for name, _, value in (one.partition("=") for one in self.choices)}
        of_curriculum = {name: value for name, value in chosen.items() if name.startswith("curriculum.")}
        return changed(RECIPES[self.recipe], of_curriculum).curriculum


def _kind(path: Path) -> str:
    """Return the name of the architecture of the residual model in a file."""
    from hydro.io import table
    from hydro.io.model import from_artefact

    return str(from_artefact(table.read(path, "model")).architecture.get("model"))


def runs(study: Study) -> tuple[list[Run], list[str]]:
    """Return the trainings of a study, seed by seed, and a message for each condition whose file is missing.

    Args:
        study: The study.

    Returns:
        The trainings, and a list of texts.

    Raises:
        UsageError: A condition is unknown, or all of them lack their file.
    """
    from hydro.rl.environment.conditions import CONDITIONS as KNOWN
    from hydro.rl.environment.conditions import EFFECTS, IDENTIFIED, MODELS

    names, models = study.conditions, {_kind(path): path for path in study.models}
    if unknown := [name for name in names if name not in KNOWN]:
        raise UsageError(f"no condition is called {unknown[0]!r}: choose one of {', '.join(KNOWN)}")
    left = {name: "its residual model: add --model FILE" for name in names if name in MODELS}
    left = {name: want for name, want in left.items() if MODELS[name] not in models}
    if IDENTIFIED in names and study.identified is None:
        left[IDENTIFIED] = "a file that data were explained with: add --identified FILE"
    flown = dict.fromkeys(names, study.vehicle)
    flown |= {IDENTIFIED: study.identified or study.vehicle, EFFECTS: study.given or study.vehicle}
    found = [
        Run(name, seed, study.folder / f"{name}-seed{seed}", flown[name], models.get(MODELS.get(name, "")))
        for seed in range(study.seeds)
        for name in names
        if name not in left
    ]
    wants = [f"{name}, for want of {want}" for name, want in left.items()]
    if not found:
        raise UsageError(f"nothing to train: {'; '.join(wants)}")
    return found, wants


def steps(study: Study, of: Sequence[Run]) -> list[Step]:
    """Return the commands (steps), not yet run, that train and test all policies, and draw their curves.

    Args:
        study: The study.
        of: The trainings.
    """
    plan = [step for run in of for step in _of_a_run(study, run, first=run is of[0])]
    curves, folders = study.folder / "curves.png", [str(run.folder) for run in of]
    reads = tuple(run.folder / "evaluations.parquet" for run in of)
    return [*plan, Step(("rl", "curves", *folders, *study.reading, "-o", str(curves)), reads, (curves,))]


def _of_a_run(study: Study, run: Run, first: bool) -> Iterator[Step]:
    """Yield the steps that train and test one run.

    Args:
        study: The study.
        run: The training.
        first: Whether it is the first run of the study; its tests in the reference simulator include the
            hand-written pilot.
    """
    given = () if run.model is None else ("--model", str(run.model))
    which = ("--condition", run.condition, *given, "--seed", str(run.seed))
    options = ["--stages", str(study.stages), "--steps", str(study.steps), "--recipe", study.recipe]
    options += [word for one in study.choices for word in ("--set", one)]
    reads = (run.vehicle,) if run.model is None else (run.vehicle, run.model)
    line = ("rl", "train", str(run.vehicle), *which, *options, *study.reading, "-o", str(run.folder))
    yield Step(line, reads, run.files)
    levels = study.levels
    for simulator, stage in tests(study):
        # the pilot flies once per condition, and once in the reference simulator for all conditions
        piloted = first if simulator == "teacher" else run.seed == 0
        other = simulator == "teacher" and run.vehicle != study.vehicle
        true = ("--truth", str(study.vehicle)) if other else ()
        task, level = levels[stage - 1]
        what = ("--task", task, "--level", str(level), *(("--last",) if study.last else ()))
        flown = ("rl", "eval", str(run.folder), *what, "--in", simulator, *true)
        many = ("--episodes", str(study.episodes), "--pilot" if piloted else "--no-pilot", *study.reading)
        tested, learnt = run.tested(simulator, stage), run.folder / "policy.parquet"
        reads = (learnt, study.vehicle) if other else (learnt,)
        yield Step((*flown, *many, "-o", str(tested)), reads, (tested,))


def tests(study: Study) -> list[tuple[str, int]]:
    """Return the tests of every policy of a study, as pairs of simulator and stage of the curriculum.

    Args:
        study: The study.
    """
    return [(simulator, stage) for simulator in SIMULATORS for stage in range(1, study.stages + 1)]


def summarise(study: Study, runs: Sequence[Run]) -> pl.DataFrame:
    """Write the results of all tested policies to `tests.parquet` in the study's folder, and return them.

    Args:
        study: The study.
        runs: Trainings whose tests are all complete.

    Returns:
        The written table, one row per policy or pilot and test.
    """
    import polars as pl

    from hydro.io import table

    flown = [table.read(run.tested(*test), "evaluations") for run in runs for test in tests(study)]
    whole = pl.concat([test.frame for test in flown])
    made = table.make("evaluations", whole, stage="rl study", inputs=flown)
    table.write(made, study.folder / "tests.parquet")
    return whole
