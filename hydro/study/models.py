"""A study of all residual models, from raw data to tables and figures; its steps are ordinary commands."""

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
"""Studied where they are asked for alone: of hours of data a Gaussian process makes less than a network."""
PIECE = "10"  # s, a segment of the paper's replay sequence
BESIDE_EFFECTS = "physfeat"
QUICK_MODELS = ("mlp", "moe", "structured")


@dataclass(frozen=True)
class Recordings:
    """What networks learn from and are measured on.

    Attributes:
        raw: Recording to train on.
        test: Recording of other sessions to evaluate on; without it, the test part of `raw`.
        replay: Recording of the sequence that is replayed.
        vehicle: Vehicle file, where the recordings carry none.
        noise: Noise added to `raw` alone; evaluation and replay stay free of it.
        effects: Vehicle file with identified effects, beside which a network flies of what they leave.
    """

    raw: Path
    replay: Path
    test: Path | None
    vehicle: Path | None
    noise: str
    effects: Path | None = None


@dataclass(frozen=True)
class Study:
    """What is trained, on what, and where it is kept.

    Attributes:
        folder: Of the study.
        data: Recordings.
        models: Architectures.
        seeds: Networks of each.
        minutes: Trainings on so many minutes alone, beside those on all data.
        epochs: Passes over the data at most; those of `hydro train` by default.
        device: Where to train.
        conditionings: Kinds of conditioning that the first seeds fly under as well.
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
        """Refuse what cannot be studied.

        Raises:
            UsageError: There is no such model, or noise without a recording free of it to test on.
        """
        if unknown := [name for name in self.models if name not in (*MODELS, *ON_REQUEST)]:
            known = ", ".join((*MODELS, *ON_REQUEST))
            raise UsageError(f"no model is called '{unknown[0]}': choose one of {known}")
        if self.data.noise != "none" and self.data.test is None:
            raise UsageError("--noise needs --test RAW, a recording without noise to evaluate on")


@dataclass(frozen=True)
class Result:
    """What a study has come to.

    Attributes:
        ran: Steps run.
        steps: Steps in all.
        summary: Metrics tables by name, see `study.summary.summarise`.
    """

    ran: int
    steps: int
    summary: dict[str, pl.DataFrame]


def carry_out(study: Study, runner: Runner, workers: int = 1) -> Result:
    """Run what is not done, and summarise after every round of seeds."""
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
    """Steps of every round; what there is once for all of them comes with the first."""
    steps = [[step for run in runs for step in _of_a_run(run, study)] for runs in _rounds(study)]
    steps[0] = [*_preparation(study), *steps[0], *_together(study), *_beside_effects(study)]
    return steps


def _rounds(study: Study) -> list[list[Run]]:
    """Networks seed by seed, so that a study that is cut short has every model: whole data first."""
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
    """Write the training recording with noise, unless it is there already: no command does this."""
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
    """Labels and split of the training data, and labels to test on."""
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
    """The recording that labels are made from, and what is said of its noise."""
    return (data.raw, ()) if data.noise == "none" else (folder / "noisy.parquet", ("--noise", data.noise))


def _tested(data: Recordings, folder: Path) -> tuple[Path, str]:
    """The table to evaluate on, and which part of it."""
    return (folder / "split.parquet", "test") if data.test is None else (folder / "test.parquet", "all")


def _of_a_run(run: Run, study: Study) -> list[Step]:
    """Training, evaluation and replay of one network."""
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
    """How long and where networks are trained."""
    limited = () if study.epochs is None else ("--epochs", str(study.epochs))
    return limited if study.device == "cpu" else (*limited, "--device", study.device)


def _beside_effects(study: Study) -> list[Step]:
    """Labels of what the identified effects leave, a network of them, and the replay of both and of one."""
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
    """The first seeds side by side: figures, the replay's series, and every kind of conditioning."""
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
    """What the first seeds predict, side by side, with figures."""
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
