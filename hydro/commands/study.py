"""`study`: all residual models from raw data to tables and figures, resumable."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Annotated, Literal

import typer

from hydro.commands.shell import read
from hydro.commands.steps import Runner, Step, apart, here
from hydro.commands.summary import (
    CONDITIONINGS,
    EFFECTS,
    SIDE_BY_SIDE,
    Run,
    conditioned,
    show,
    summarise,
)
from hydro.core.errors import UsageError

MODELS = ("mlp", "resmlp", "multihead", "moe", "physfeat", "structured", "temporal")
PIECE = "10"  # s, a segment of the paper's replay sequence
BESIDE_EFFECTS = "physfeat"
QUICK_MODELS = ("mlp", "moe", "structured")


@dataclass(frozen=True)
class Data:
    """What a study is made on.

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


def study(
    context: typer.Context,
    what: Annotated[Literal["models"], typer.Argument(help="What is studied: the residual models.")],
    raw: Annotated[Path, typer.Argument(metavar="RAW", show_default=False, help="Recording to train on.")],
    replay: Annotated[
        Path, typer.Option(metavar="RAW", help="Recording of a sequence to replay, such as replay90.")
    ],
    folder: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the study.")],
    test: Annotated[
        Path | None,
        typer.Option(
            metavar="RAW", help="Recording of other sessions to test on; default: the split's test part."
        ),
    ] = None,
    vehicle: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Vehicle file; default: the one in the recordings' footers."),
    ] = None,
    model: Annotated[
        list[str] | None, typer.Option("--model", metavar="NAME", help="Only this model; repeat for several.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Networks of each model.")] = 5,
    epochs: Annotated[
        int | None,
        typer.Option(min=1, help="Passes over the training data at most; default: that of `hydro train`."),
    ] = None,
    minutes: Annotated[
        list[float] | None,
        typer.Option(metavar="MIN", help="Also train on so many minutes alone; repeat for several."),
    ] = None,
    noise: Annotated[
        str,
        typer.Option(metavar="SPEC", help="Noise added to the training data alone: none, ordinary, dvl, …."),
    ] = "none",
    effects: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Vehicle file with fitted effects: fly them alone, and with a network."
        ),
    ] = None,
    device: Annotated[Literal["cpu", "cuda"], typer.Option(help="Where to train.")] = "cpu",
    workers: Annotated[
        int, typer.Option(min=1, help="Steps that run side by side, each in a process of one thread.")
    ] = 1,
    quick: Annotated[
        bool, typer.Option("--quick", help="See that it runs: three models, one seed, one epoch.")
    ] = False,
) -> None:
    """Train, evaluate and replay all residual models, several seeds each, and compare how they rank.

    From raw data: labels, split, training, errors of the predicted wrench by axis and regime of motion,
    open-loop replay by segment without and with conditioning, and Kendall's tau between both errors: does the
    model that predicts best also replay best? Every step is an ordinary command, printed as it runs. A step
    whose inputs have not changed is not run again: a study that was interrupted goes on where it stopped.

    Networks are made seed by seed, and after every seed DIR gets what is known so far: evaluation.parquet,
    errors.parquet, conditioning.parquet, ranking.parquet and minutes.parquet (means over seeds, with the
    smallest and largest), replay.parquet and figures/, beside models/ and the errors of every network. `hydro
    report DIR` tells it on one page, while the study runs as well.
    """
    names = tuple(model) if model else QUICK_MODELS if quick else MODELS
    _require_models(names)
    if noise != "none" and test is None:
        raise UsageError("--noise needs --test RAW, a recording without noise to evaluate on")
    if quick:
        seeds, epochs = 1, 1
    data = Data(raw, replay, test, vehicle, noise, effects)
    folder.mkdir(parents=True, exist_ok=True)
    rounds = _rounds(names, seeds, minutes or ())
    steps = [
        [step for run in runs for step in _of_a_run(run, data, folder, epochs=epochs, device=device)]
        for runs in rounds
    ]
    steps[0] = [
        *_preparation(data, folder),
        *steps[0],
        *_together(names, data, folder, conditionings=() if quick else CONDITIONINGS),
        *_beside_effects(data, folder, epochs=epochs, device=device),
    ]
    runner = Runner(folder, here(context.find_root().command) if workers == 1 else apart)
    if noise != "none":
        _disturb(data, folder, runner)
    done, made, complete, ran = set[Step](), set[Path](), 0, 0
    for step, anew in runner.one_by_one(list(chain.from_iterable(steps)), workers):
        done.add(step)
        made.update(step.writes)
        ran += anew
        while complete < len(steps) and done.issuperset(steps[complete]):
            complete += 1
            if anew or complete == len(steps):
                summary = summarise(list(chain.from_iterable(rounds[:complete])), folder, made)
    typer.echo(f"{ran} of {len(done)} steps run, the others were done", err=True)
    show(summary)


def _rounds(names: Sequence[str], seeds: int, minutes: Sequence[float]) -> list[list[Run]]:
    """Networks seed by seed, so that a study that is cut short has every model: whole data first."""
    whole = [[Run(name, seed) for name in names] for seed in range(seeds)]
    parts = [[Run(name, seed, share) for share in minutes for name in names] for seed in range(seeds)]
    return [*whole, *parts] if minutes else whole


def _require_models(names: Sequence[str]) -> None:
    unknown = [name for name in names if name not in MODELS]
    if unknown:
        raise UsageError(f"no model is called '{unknown[0]}': choose of {', '.join(MODELS)}")


def _vehicle(data: Data) -> tuple[str, ...]:
    return () if data.vehicle is None else ("--vehicle", str(data.vehicle))


def _reads(data: Data, *files: Path) -> tuple[Path, ...]:
    return files if data.vehicle is None else (*files, data.vehicle)


def _disturb(data: Data, folder: Path, runner: Runner) -> None:
    """Write the training recording with noise, unless it is there already: no command does this."""
    import numpy as np
    import polars as pl

    from hydro.commands.shell import noise_for
    from hydro.core.columns import MOTION
    from hydro.core.simulation.sensor_noise import disturb
    from hydro.io import table

    step = Step(("noise", data.noise), (data.raw,), (folder / "noisy.parquet",))
    if runner.done(step):
        return
    started = time.perf_counter()
    source = read(str(data.raw), "raw")
    clean = source.frame.select(pl.col(MOTION).cast(pl.Float64)).to_numpy()
    noisy = disturb(clean, noise_for(data.noise), np.random.default_rng(0))
    frame = source.frame.with_columns(pl.Series(name, noisy[:, k]) for k, name in enumerate(MOTION))
    made = table.make(
        "raw",
        frame,
        stage="noise",
        parameters={"noise": data.noise},
        seed=0,
        inputs=[source],
        vehicle_text=source.provenance.vehicle,
    )
    table.write(made, folder / "noisy.parquet")
    runner.record(step, time.perf_counter() - started)


def _preparation(data: Data, folder: Path) -> list[Step]:
    """Labels and split of the training data, and labels to test on."""
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


def _learnt_from(data: Data, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """The recording that labels are made from, and what is said of its noise."""
    return (data.raw, ()) if data.noise == "none" else (folder / "noisy.parquet", ("--noise", data.noise))


def _tested(data: Data, folder: Path) -> tuple[Path, str]:
    """The table to evaluate on, and which part of it."""
    return (folder / "split.parquet", "test") if data.test is None else (folder / "test.parquet", "all")


def _of_a_run(run: Run, data: Data, folder: Path, *, epochs: int | None, device: str) -> list[Step]:
    """Training, evaluation and replay of one network."""
    from hydro.sim.replay import PAPER_NAMES

    split, model = folder / "split.parquet", folder / "models" / f"{run.name}.parquet"
    line = ["train", str(split), "--model", run.model, "--seed", str(run.seed), *_trained(epochs, device)]
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


def _trained(epochs: int | None, device: str) -> tuple[str, ...]:
    """How long and where networks are trained."""
    limited = () if epochs is None else ("--epochs", str(epochs))
    return limited if device == "cpu" else (*limited, "--device", device)


def _beside_effects(data: Data, folder: Path, *, epochs: int | None, device: str) -> list[Step]:
    """Labels of what the identified effects leave, a network of them, and the replay of both and of one."""
    from hydro.sim.replay import PAPER_NAMES

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
            ("train", str(split), "--model", BESIDE_EFFECTS, *_trained(epochs, device), "-o", str(model)),
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


def _together(names: Sequence[str], data: Data, folder: Path, *, conditionings: Sequence[str]) -> list[Step]:
    """The first seeds side by side: figures, the replay's series, and every kind of conditioning."""
    models = [folder / "models" / f"{Run(name, 0).name}.parquet" for name in names]
    given = [word for model in models for word in ("--model", str(model))]
    table, part = _tested(data, folder)
    figures, side, beside = folder / "figures", folder / "replay.parquet", folder / SIDE_BY_SIDE
    predicted = folder / "evaluated" / "side-by-side.parquet"
    drawn = [figures / f"{name}.png" for name in ("axes", "regimes", *(f"density-{one}" for one in names))]
    steps = [
        Step(
            (
                *("evaluate", *map(str, models), "--labels", str(table), "--part", part),
                *("--by", "speed", "--by", "drift", "--by", "reach", "--figures", str(figures)),
                *("-o", str(predicted)),
            ),
            (*models, table),
            (predicted, *drawn),
        ),
        Step(
            (
                *("replay", str(data.replay), *_vehicle(data), *given, "--piece", PIECE),
                *("--figures", str(figures), "--metrics", str(beside), "-o", str(side)),
            ),
            _reads(data, data.replay, *models),
            (beside, side, figures / "velocities.png", figures / "errors.png"),
            ("replay", "all models"),
        ),
    ]
    for kind in conditionings:
        target = folder / conditioned(kind)
        line = ("replay", str(data.replay), *_vehicle(data), *given, "--conditioning", kind)
        steps.append(
            Step(
                (*line, "--metrics", str(target), "-o", "/dev/null"),
                _reads(data, data.replay, *models),
                (target,),
                ("replay", "all models"),
            )
        )
    return steps


COMMANDS = {
    study: "hydro study models datasets/stonefish/sample.parquet "
    "--replay datasets/stonefish/replay90.parquet --quick -o study",
}
