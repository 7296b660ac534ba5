"""`study`: all residual models from raw data to tables and figures, resumable."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from hydro.commands.shell import PREDICTION_TITLE, REPLAY_TITLE, print_table, read
from hydro.commands.steps import Runner, Step, apart, here
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    import polars as pl

MODELS = ("mlp", "resmlp", "multihead", "moe", "physfeat", "structured", "temporal")
PIECE = "10"  # s, a segment of the paper's replay sequence
CONDITIONINGS = ("paper-old", "paper-new", "low-pass-old", "low-pass-new", "clipping", "dead-band")
BESIDE_EFFECTS = "physfeat"
QUICK_MODELS = ("mlp", "moe", "structured")
RANKING_TITLE = (
    "Do both errors rank the models alike? Kendall's tau, and the chance of as much without relation"
)


@dataclass(frozen=True)
class Run:
    """One network of a study: a model, a seed, and how many minutes of the data it is trained on."""

    model: str
    seed: int
    minutes: float | None = None

    @property
    def name(self) -> str:
        """Name of its files."""
        part = "" if self.minutes is None else f"-{self.minutes:g}min"
        return f"{self.model}-seed{self.seed}{part}"

    @property
    def label(self) -> str:
        """What distinguishes it from other runs of the same model."""
        return f"seed {self.seed}" + ("" if self.minutes is None else f", {self.minutes:g} min")


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

    DIR gets models/, the errors of every network, and of all of them evaluation.parquet, errors.parquet and
    ranking.parquet (means over seeds, with the smallest and largest), replay.parquet and figures/. `hydro
    report DIR` tells it on one page.
    """
    names = tuple(model) if model else QUICK_MODELS if quick else MODELS
    _require_models(names)
    if noise != "none" and test is None:
        raise UsageError("--noise needs --test RAW, a recording without noise to evaluate on")
    if quick:
        seeds, epochs = 1, 1
    data = Data(raw, replay, test, vehicle, noise, effects)
    folder.mkdir(parents=True, exist_ok=True)
    whole = [Run(name, seed) for name in names for seed in range(seeds)]
    parts = [Run(run.model, run.seed, share) for run in whole for share in minutes or ()]
    steps = [*_preparation(data, folder)]
    for run in (*whole, *parts):
        steps += _of_a_run(run, data, folder, epochs=epochs, device=device)
    steps += _together(names, data, folder, conditionings=() if quick else CONDITIONINGS)
    steps += _beside_effects(data, folder, epochs=epochs, device=device)
    runner = Runner(folder, here(context.find_root().command) if workers == 1 else apart)
    if noise != "none":
        _disturb(data, folder, runner)
    ran = runner.run(steps, workers)
    typer.echo(f"{ran} of {len(steps)} steps run, the others were done", err=True)
    _summarise(whole, parts, data, folder)


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
    from hydro.core.noise import disturb
    from hydro.io import table

    step = Step(("noise", data.noise), (data.raw,), (folder / "noisy.parquet",))
    if runner.done(step):
        return
    started = time.perf_counter()
    source = read(str(data.raw), "raw")
    motion = ["x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r"]
    clean = source.frame.select(pl.col(motion).cast(pl.Float64)).to_numpy()
    noisy = disturb(clean, noise_for(data.noise), np.random.default_rng(0))
    frame = source.frame.with_columns(pl.Series(name, noisy[:, k]) for k, name in enumerate(motion))
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
        Step((*line, "-o", str(model)), (split,), (model,)),
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
    model, replayed = folder / "models" / "beside-effects.parquet", _flown_with_effects(folder)
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


def _flown_with_effects(folder: Path) -> Path:
    return folder / "replayed" / "effects.parquet"


def _together(names: Sequence[str], data: Data, folder: Path, *, conditionings: Sequence[str]) -> list[Step]:
    """The first seeds side by side: figures, the replay's series, and every kind of conditioning."""
    models = [folder / "models" / f"{Run(name, 0).name}.parquet" for name in names]
    given = [word for model in models for word in ("--model", str(model))]
    table, part = _tested(data, folder)
    figures, side = folder / "figures", folder / "replay.parquet"
    beside = folder / "replayed" / "side-by-side.parquet"
    steps = [
        Step(
            (
                *("evaluate", *map(str, models), "--labels", str(table), "--part", part),
                *("--by", "speed", "--by", "drift", "--by", "reach", "--figures", str(figures)),
                *("-o", str(folder / "evaluated" / "side-by-side.parquet")),
            ),
            (*models, table),
            (folder / "evaluated" / "side-by-side.parquet", figures / "axes.png", figures / "regimes.png"),
        ),
        Step(
            (
                *("replay", str(data.replay), *_vehicle(data), *given, "--piece", PIECE),
                *("--figures", str(figures), "--metrics", str(beside), "-o", str(side)),
            ),
            _reads(data, data.replay, *models),
            (beside, side, figures / "velocities.png", figures / "errors.png"),
        ),
    ]
    for kind in conditionings:
        target = folder / "replayed" / f"conditioning-{kind}.parquet"
        line = ("replay", str(data.replay), *_vehicle(data), *given, "--conditioning", kind)
        steps.append(
            Step(
                (*line, "--metrics", str(target), "-o", "/dev/null"),
                _reads(data, data.replay, *models),
                (target,),
            )
        )
    return steps


def _summarise(whole: Sequence[Run], parts: Sequence[Run], data: Data, folder: Path) -> None:
    """Write and print the means over seeds, and how the two errors rank the models."""
    import polars as pl

    from hydro.io import table
    from hydro.report.tables import prediction_errors, ranking, replay_errors, seeds_together

    def errors(kind: str, runs: Sequence[Run]) -> pl.DataFrame:
        return pl.concat(
            read(str(folder / kind / f"{run.name}.parquet"), "metrics").frame.with_columns(
                run=pl.lit(run.label), minutes=pl.lit(run.minutes, pl.Float64)
            )
            for run in runs
        )

    predicted, replayed = errors("evaluated", whole), errors("replayed", whole)
    besides = read(str(folder / "replayed" / "side-by-side.parquet"), "metrics").frame
    baselines = besides.filter(~pl.col("variant").is_in(replayed["variant"].unique()))
    if data.effects is not None:
        baselines = pl.concat([baselines, read(str(_flown_with_effects(folder)), "metrics").frame])
    summary = {
        "evaluation": seeds_together(predicted),
        "errors": pl.concat([baselines, seeds_together(replayed)]),
        "ranking": ranking(predicted, replayed),
    }
    if parts:
        summary["minutes"] = pl.concat(
            [_by_minutes(errors(kind, parts)) for kind in ("evaluated", "replayed")]
        )
    for name, frame in summary.items():
        table.write(table.make("metrics", frame, stage="study"), folder / f"{name}.parquet")
    print_table(prediction_errors(summary["evaluation"]), PREDICTION_TITLE + "; means over seeds")
    print_table(replay_errors(summary["errors"]), REPLAY_TITLE + "; means over seeds")
    if not summary["ranking"].is_empty():
        taus = summary["ranking"].filter(pl.col("metric") == "kendall_tau")
        chances = summary["ranking"].filter(pl.col("metric") == "kendall_p").select("axis", p="value")
        shown = taus.select("axis", "low", "high", tau="value").join(chances, on="axis", how="left")
        print_table(shown.select("axis", "tau", "low", "high", "p"), RANKING_TITLE)


def _by_minutes(errors: pl.DataFrame) -> pl.DataFrame:
    """Means over seeds for every length of training data, which the model's name then tells."""
    import polars as pl

    from hydro.report.tables import seeds_together

    return pl.concat(
        seeds_together(
            errors.filter(pl.col("minutes") == share).with_columns(
                model=pl.col("model") + pl.lit(f", {share:g} min")
            )
        )
        for share in errors["minutes"].unique().sort()
    )


COMMANDS = {
    study: "hydro study models datasets/stonefish/sample.parquet "
    "--replay datasets/stonefish/replay90.parquet --quick -o study",
}
