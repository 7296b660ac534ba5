"""Study of all residual models, from raw data to tables and figures, in steps that are ordinary commands."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from hydro.core.errors import UsageError
from hydro.study.steps import Runner, Step
from hydro.study.summary import CONDITIONINGS, EFFECTS, SIDE_BY_SIDE, Run, conditioned, summarise

if TYPE_CHECKING:
    import polars as pl

    from hydro.core.simulation.sensor_noise import Noise

MODELS = ("mlp", "resmlp", "multihead", "moe", "physfeat", "structured", "temporal")
ON_REQUEST = ("gp",)
"""Models that are studied only on request: with hours of data a Gaussian process is worse than a network."""
PIECE = "10"
"""Length of a segment of the paper's replay sequence [s]."""
BESIDE_EFFECTS = "physfeat"
"""Model that is trained on the force that the identified effects do not explain."""
QUICK_MODELS = ("mlp", "moe", "structured")
"""Models of a quick study."""


@dataclass(frozen=True)
class Recordings:
    """Paths of the recordings for training, evaluation and replay of networks, and settings for them.

    Attributes:
        raw: Recording to train on.
        replay: Recording of the sequence that is replayed.
        test: Recording of other sessions to evaluate on; without it, the test part of `raw`.
        vehicle: Vehicle file, for recordings without one.
        noise: Noise that is added to `raw` only, not to the data of evaluation and replay.
        effects: Vehicle file with identified effects; a network then learns the remaining force, and is
            replayed together with these effects.
    """

    raw: Path
    replay: Path
    test: Path | None
    vehicle: Path | None
    noise: str
    effects: Path | None = None


@dataclass(frozen=True)
class Study:
    """Settings of a study of residual models, which are networks that learn unexplained forces.

    Attributes:
        folder: Folder of the study.
        data: Paths of the recordings.
        models: Names of the architectures.
        seeds: Number of networks of each architecture.
        minutes: Amounts of data [min] for additional trainings on a part of the data.
        epochs: Maximum number of passes over the data; None for the default of `hydro train`.
        device: Device for training, `cpu` or `cuda`.
        conditionings: Kinds of conditioning (filter of a network's wrench) under which the networks of the
            first seed are replayed as well.
    """

    folder: Path
    data: Recordings
    models: tuple[str, ...] = MODELS
    seeds: int = 5
    minutes: tuple[float, ...] = ()
    epochs: int | None = None
    device: str = "cpu"
    conditionings: tuple[str, ...] = CONDITIONINGS

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            UsageError: A model is unknown, or noise is given without a noise-free recording to test on.
        """
        if unknown := [name for name in self.models if name not in (*MODELS, *ON_REQUEST)]:
            known = ", ".join((*MODELS, *ON_REQUEST))
            raise UsageError(f"no model is called '{unknown[0]}': choose one of {known}")
        if self.data.noise != "none" and self.data.test is None:
            raise UsageError("--noise needs --test RAW, a recording without noise to evaluate on")


@dataclass(frozen=True)
class Result:
    """Result of carrying out a study.

    Attributes:
        ran: Number of steps (commands) that were run now, not before.
        steps: Number of all steps.
        summary: Metrics tables by name, see `study.summary.summarise`.
    """

    ran: int
    steps: int
    summary: dict[str, pl.DataFrame]


def carry_out(study: Study, runner: Runner, workers: int = 1) -> Result:
    """Run the commands (steps) of a study that are not done, and write its summary tables; return the result.

    The tables are written after every round of seeds.

    Args:
        study: The study.
        runner: Runner of steps, which keeps the record of finished steps in the study's folder.
        workers: Number of steps that run at the same time.
    """
    rounds, steps = _rounds(study), _steps(study)
    done, made, complete, ran = set[Step](), set[Path](), 0, 0
    summary: dict[str, pl.DataFrame] = {}
    for step, anew in runner.one_by_one(list(chain.from_iterable(steps)), workers):
        done.add(step)
        made.update(step.writes)
        ran += anew
        while complete < len(steps) and done.issuperset(steps[complete]):
            complete += 1
            if anew or complete == len(steps):
                summary = summarise(list(chain.from_iterable(rounds[:complete])), study.folder, made)
    return Result(ran, len(done), summary)


def _steps(study: Study) -> list[list[Step]]:
    """Return the steps of every round; steps that all rounds share are in the first."""
    steps = [[step for run in runs for step in _of_a_run(run, study)] for runs in _rounds(study)]
    steps[0] = [*_preparation(study), *steps[0], *_together(study), *_beside_effects(study)]
    return steps


def _rounds(study: Study) -> list[list[Run]]:
    """Return the networks in rounds, one per seed: first with all data, then with limited minutes.

    So an interrupted study has a network of every model.
    """
    whole = [[Run(name, seed) for name in study.models] for seed in range(study.seeds)]
    parts = [
        [Run(name, seed, share) for share in study.minutes for name in study.models]
        for seed in range(study.seeds)
    ]
    return [*whole, *parts] if study.minutes else whole


def _vehicle(data: Recordings) -> tuple[str, ...]:
    return () if data.vehicle is None else ("--vehicle", str(data.vehicle))


def _reads(data: Recordings, *files: Path) -> tuple[Path, ...]:
    return files if data.vehicle is None else (*files, data.vehicle)


def disturb(study: Study, runner: Runner, noise: Noise) -> None:
    """Write the training recording with noise added as `noisy.parquet`, unless that is done already.

    No command adds noise, so this function takes the place of a step.

    Args:
        study: The study.
        runner: Runner of steps, which records the file as done.
        noise: Noise to add, drawn with seed 0.
    """
    import numpy as np
    import polars as pl

    from hydro.core.simulation.sensor_noise import disturb as disturbed
    from hydro.io import table

    data, target = study.data, study.folder / "noisy.parquet"
    step = Step(("noise", data.noise), (data.raw,), (target,))
    if runner.done(step):
        return
    started = time.perf_counter()
    source = table.read(data.raw, "raw")
    motion = ["x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r"]
    clean = source.frame.select(pl.col(motion).cast(pl.Float64)).to_numpy()
    noisy = disturbed(clean, noise, np.random.default_rng(0))
    made = table.make(
        "raw",
        source.frame.with_columns(pl.Series(name, noisy[:, k]) for k, name in enumerate(motion)),
        stage="noise",
        parameters={"noise": data.noise},
        seed=0,
        inputs=[source],
        vehicle_text=source.provenance.vehicle,
    )
    table.write(made, target)
    runner.record(step, time.perf_counter() - started)


def _preparation(study: Study) -> list[Step]:
    """Return the steps that label and split the training data, and label the test data."""
    data, folder = study.data, study.folder
    labels, split = folder / "labels.parquet", folder / "split.parquet"
    raw, stated = _learnt_from(data, folder)
    steps = [
        Step(("labels", str(raw), *_vehicle(data), *stated, "-o", str(labels)), _reads(data, raw), (labels,)),
        Step(("split", str(labels), "-o", str(split)), (labels,), (split,)),
    ]
    if data.test is not None:
        target = folder / "test.parquet"
        line = ("labels", str(data.test), *_vehicle(data), "-o", str(target))
        steps.append(Step(line, _reads(data, data.test), (target,)))
    return steps


def _learnt_from(data: Recordings, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """Return the recording that is labelled, with or without noise, and the options that state its noise."""
    return (data.raw, ()) if data.noise == "none" else (folder / "noisy.parquet", ("--noise", data.noise))


def _tested(data: Recordings, folder: Path) -> tuple[Path, str]:
    """Return the table for evaluation, and the part of the table that is used: `test` or `all`."""
    return (folder / "split.parquet", "test") if data.test is None else (folder / "test.parquet", "all")


def _of_a_run(run: Run, study: Study) -> list[Step]:
    """Return the steps that train, evaluate and replay one network."""
    from hydro.sim.replay import PAPER_NAMES

    data, folder = study.data, study.folder
    split, model = folder / "split.parquet", folder / "models" / f"{run.name}.parquet"
    line = ["train", str(split), "--model", run.model, "--seed", str(run.seed), *_trained(study)]
    line += [] if run.minutes is None else ["--minutes", f"{run.minutes:g}"]
    table, part = _tested(data, folder)
    predicted, replayed = (folder / kind / f"{run.name}.parquet" for kind in ("evaluated", "replayed"))
    ways = ("--by", "speed", "--by", "drift", "--by", "reach")
    variant = PAPER_NAMES.get(run.model, run.model)
    return [
        Step((*line, "-o", str(model)), (split,), (model,), ("train", run.model, str(run.minutes))),
        Step(
            ("evaluate", str(model), "--labels", str(table), "--part", part, *ways, "-o", str(predicted)),
            (model, table),
            (predicted,),
        ),
        Step(
            (
                *("replay", str(data.replay), *_vehicle(data), "--model", str(model), "--variant", variant),
                *("--piece", PIECE, "--metrics", str(replayed), "-o", "/dev/null"),
            ),
            _reads(data, data.replay, model),
            (replayed,),
        ),
    ]


def _trained(study: Study) -> tuple[str, ...]:
    """Return the options for the duration and the device of trainings."""
    limited = () if study.epochs is None else ("--epochs", str(study.epochs))
    return limited if study.device == "cpu" else (*limited, "--device", study.device)


def _beside_effects(study: Study) -> list[Step]:
    """Return the steps for the identified effects: labels of the residual force, a network, and replays.

    The replays are of the effects alone, and of the effects with the network.
    """
    from hydro.sim.replay import PAPER_NAMES

    data, folder = study.data, study.folder
    if data.effects is None:
        return []
    raw, stated = _learnt_from(data, folder)
    labels, split = folder / "labels-effects.parquet", folder / "split-effects.parquet"
    model, replayed = folder / "models" / "beside-effects.parquet", folder / EFFECTS
    given, name = ("--vehicle", str(data.effects)), PAPER_NAMES.get(BESIDE_EFFECTS, BESIDE_EFFECTS)
    return [
        Step(
            ("labels", str(raw), *given, *stated, "--subtract", "effects", "-o", str(labels)),
            (raw, data.effects),
            (labels,),
        ),
        Step(("split", str(labels), "-o", str(split)), (labels,), (split,)),
        Step(
            ("train", str(split), "--model", BESIDE_EFFECTS, *_trained(study), "-o", str(model)),
            (split,),
            (model,),
        ),
        Step(
            (
                *("replay", str(data.replay), *given, "--model", str(model), "--piece", PIECE),
                *("--variant", "effects", "--variant", f"effects+{name}"),
                *("--metrics", str(replayed), "-o", "/dev/null"),
            ),
            (data.replay, data.effects, model),
            (replayed,),
        ),
    ]


def _together(study: Study) -> list[Step]:
    """Return the steps for all networks of the first seed: figures, one replay, and each conditioning."""
    data, folder = study.data, study.folder
    models = [folder / "models" / f"{Run(name, 0).name}.parquet" for name in study.models]
    given = [word for model in models for word in ("--model", str(model))]
    flown = ("replay", str(data.replay), *_vehicle(data), *given)
    kind, reads = ("replay", "all models"), _reads(data, data.replay, *models)
    figures, side, beside = folder / "figures", folder / "replay.parquet", folder / SIDE_BY_SIDE
    together = Step(
        (*flown, "--piece", PIECE, "--figures", str(figures), "--metrics", str(beside), "-o", str(side)),
        reads,
        (beside, side, figures / "velocities.png", figures / "errors.png"),
        kind,
        (figures,),
    )
    steps = [_drawn(study, models), together]
    for name in study.conditionings:
        target = folder / conditioned(name)
        line = (*flown, "--conditioning", name, "--metrics", str(target), "-o", "/dev/null")
        steps.append(Step(line, reads, (target,), kind))
    return steps


def _drawn(study: Study, models: Sequence[Path]) -> Step:
    """Return the step that evaluates all networks of the first seed in one table, with figures."""
    figures, predicted = study.folder / "figures", study.folder / "evaluated" / "side-by-side.parquet"
    table, part = _tested(study.data, study.folder)
    names = ("axes", "regimes", *(f"density-{one}" for one in study.models))
    return Step(
        (
            *("evaluate", *map(str, models), "--labels", str(table), "--part", part),
            *("--by", "speed", "--by", "drift", "--by", "reach", "--figures", str(figures)),
            *("-o", str(predicted)),
        ),
        (*models, table),
        (predicted, *(figures / f"{name}.png" for name in names)),
        holds=(figures,),
    )
