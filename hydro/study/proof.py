"""Study of one change: the finding, its true value, and policies trained before and after it.

A log of a changed vehicle is explained.  Policies are then trained in the vehicle file as given and in the
file with the finding, by the same recipe, number of updates and seeds.  All fly the changed vehicle in the
reference simulator.  Each step is an ordinary command, so a study that was stopped resumes where it was.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from hydro.core.errors import DataError
from hydro.core.explanation.ladder import best_step
from hydro.study.steps import Step

BEFORE, AFTER = "before", "after"
"""Vehicle files of the trainings: as given, and with the finding."""
CHANGED, UNCHANGED = "changed", "unchanged"
"""Vehicles of the test flights."""
TASK, LEVEL = "point_to_point", 0
"""Task of all policies, stage 1 of the curriculum."""
EQUAL_BUDGET = ("curriculum.examine=0", "curriculum.window=1000000")
"""Settings by which no examination ends a training, so that all make the same number of updates."""
RESUMABLE = ("evaluate=51200", "checkpoint=1")
"""Settings of evaluations and checkpoints: a stopped training loses at most a minute or two."""
QUICK = (
    *("vehicles=8", "record=80", "evaluate=160", "episodes=4", "pilot=0", "settings.task.steps=20"),
    *("sac.layers=[16,16]", "sac.batch=16", "sac.random=80", "sac.capacity=1000", "sac.horizon=3"),
)
"""Settings of trainings of a second."""


@dataclass(frozen=True)
class Study:
    """Settings of a study of one change of a vehicle: the finding, its truth, and policies trained on it.

    Attributes:
        folder: Folder of the study.
        vehicle: Vehicle file as given.
        log: Recording of the changed vehicle.
        holdout: Held-out recording of the changed vehicle.
        truth: Vehicle file with the true change: the oracle, and the vehicle that policies fly.
        before: Recording from before the change, or None.
        seeds: Number of trainings in each file.
        steps: Control steps of each training; it makes no examination and uses all of them.
        episodes: Tasks of each test.
        recipe: Name of the settings of the trainings.
        choices: Other settings of every training, as `NAME=VALUE`.
        wanted: Findings that `explain` adds without comparison with others; by default it compares.
    """

    folder: Path
    vehicle: Path
    log: Path
    holdout: Path
    truth: Path
    before: Path | None = None
    seeds: int = 5
    steps: int = 179_200
    episodes: int = 100
    recipe: str = "sac"
    choices: tuple[str, ...] = ()
    wanted: tuple[str, ...] = ()

    @property
    def explained(self) -> Path:
        """Path of the folder that `hydro explain` writes, whether it exists or not."""
        return self.folder / "study"

    @property
    def oracle(self) -> Path:
        """Path of the comparison of the truly changed vehicle file with the held-out recording."""
        return self.folder / "oracle.parquet"

    def piloted(self, vehicle: str) -> Path:
        """Return the path of the table of flights that the hand-written pilot makes with a vehicle.

        Args:
            vehicle: CHANGED or UNCHANGED.
        """
        return self.folder / f"pilot-{vehicle}.parquet"

    @property
    def runs(self) -> list[Run]:
        """Trainings of policies, seed by seed.

        For each seed in the file before and the file after the finding.
        """
        return [Run(self.folder, file, seed) for seed in range(self.seeds) for file in (BEFORE, AFTER)]


@dataclass(frozen=True)
class Run:
    """One training of a policy, in the vehicle file before or after the finding.

    Attributes:
        study: Folder of the study.
        file: BEFORE or AFTER, the vehicle file without or with the finding.
        seed: Seed of the training.
    """

    study: Path
    file: str
    seed: int

    @property
    def folder(self) -> Path:
        """Path of the folder of the training, whether it exists or not."""
        return self.study / f"{self.file}-seed{self.seed}"

    @property
    def tests(self) -> tuple[str, ...]:
        """Vehicles that the policy flies, CHANGED or UNCHANGED.

        All policies fly the changed vehicle; a policy of the file as given also flies the unchanged vehicle.
        """
        return (CHANGED, UNCHANGED) if self.file == BEFORE else (CHANGED,)

    def tested(self, vehicle: str) -> Path:
        """Return the path of the table of flights that the policy makes with a vehicle.

        Args:
            vehicle: CHANGED or UNCHANGED.
        """
        return self.folder / f"{vehicle}.parquet"


def finding(study: Study) -> list[Step]:
    """Return two steps, not yet run: explain the log, and compare the true vehicle with held-out data.

    Args:
        study: The study.
    """
    beside = () if study.before is None else ("--before", str(study.before))
    wanted = [word for name in study.wanted for word in ("--add", name)]
    line = ("explain", str(study.vehicle), str(study.log), *beside, "--holdout", str(study.holdout), *wanted)
    reads = (study.vehicle, study.log, study.holdout, *(() if study.before is None else (study.before,)))
    ladder = study.explained / "ladder.parquet"
    oracle = ("compare", str(study.truth), str(study.holdout), "-o", str(study.oracle))
    return [
        Step((*line, "-o", str(study.explained)), reads, (ladder,)),
        Step(oracle, (study.truth, study.holdout), (study.oracle,)),
    ]


def chosen(study: Study) -> Path:
    """Return the path of the vehicle file of the step that `explain` recommends.

    Args:
        study: The study, in which `explain` was run.

    Raises:
        DataError: `explain` added nothing.
    """
    from hydro.io import table

    number = best_step(table.read(study.explained / "ladder.parquet", "ladder").frame)
    if number == 0:
        raise DataError(f"{study.log}: explain added nothing, so no policy can be trained after the finding")
    return study.explained / f"vehicle-{number}.toml"


def trainings(study: Study, after: Path) -> list[Step]:
    """Return the commands (steps), not yet run, that fly the pilot, and train and test all policies.

    Args:
        study: The study.
        after: Vehicle file with the finding.
    """
    files = {BEFORE: study.vehicle, AFTER: after}
    pilots = [
        _flight(study, study.vehicle, study.vehicle, flown, study.piloted(flown))
        for flown in (CHANGED, UNCHANGED)
    ]
    return [*pilots, *(step for run in study.runs for step in _of_a_run(study, run, files[run.file]))]


def _flight(study: Study, actor: Path, read: Path, flown: str, tested: Path) -> Step:
    """Return the step in which a policy or the hand-written pilot flies in the reference simulator.

    Args:
        study: The study.
        actor: Folder of a training, or a vehicle file, which the pilot flies.
        read: File on which the flight depends.
        flown: The changed or the unchanged vehicle.
        tested: Table to write.
    """
    true = ("--truth", str(study.truth)) if flown == CHANGED else ()
    line = ["rl", "eval", str(actor), "--task", TASK, "--level", str(LEVEL), "--in", "teacher", *true]
    line += ["--episodes", str(study.episodes)]
    line += [] if actor == study.vehicle else ["--last", "--no-pilot"]
    reads = (read, *((study.truth,) if true else ()))
    return Step((*line, "-o", str(tested)), reads, (tested,))


def _of_a_run(study: Study, run: Run, vehicle: Path) -> Iterator[Step]:
    """Yield the steps that train a policy in a vehicle file and test it."""
    line = ["rl", "train", str(vehicle), "--recipe", study.recipe, "--stages", "1"]
    line += ["--steps", str(study.steps), "--seed", str(run.seed)]
    line += [word for one in (*EQUAL_BUDGET, *RESUMABLE, *study.choices) for word in ("--set", one)]
    files = [run.folder / f"{name}.parquet" for name in ("run", "curves", "evaluations", "policy")]
    yield Step((*line, "-o", str(run.folder)), (vehicle,), tuple(files))
    for flown in run.tests:
        yield _flight(study, run.folder, run.folder / "policy.parquet", flown, run.tested(flown))


def quick(study: Study) -> Study:
    """Return a copy of a study that takes a few seconds with the same kinds of steps, for tests.

    Args:
        study: The study.
    """
    small = (*study.choices, *QUICK)
    return replace(study, before=None, seeds=1, steps=320, episodes=4, choices=small, wanted=("best",))
