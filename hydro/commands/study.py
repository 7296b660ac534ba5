"""Command `study`: resumable studies of the residual models, and of the reference paper as a whole."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from hydro.commands.engines import HERE, Address, EngineName, Threads, runner
from hydro.commands.help import CLUSTER
from hydro.commands.places import FOLDER
from hydro.commands.shell import PREDICTION_TITLE, REPLAY_TITLE, Device, message, noise_for
from hydro.commands.tables import print_table
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    import polars as pl

    from hydro.study.paper import Study
    from hydro.study.steps import Runner

PAPER = "Study of the paper"
"""Heading of the options of `hydro study paper`."""
CONDITIONING_TITLE = "Replays of the first seeds by conditioning of the learned wrench, RMSE over all six"
RANKING_TITLE = (
    "Do both errors rank the models alike? Kendall's tau, and the probability of as much by chance"
)
MINUTES_TITLE = (
    "From so many minutes of data, RMSE over all six: wrench [N, N m], replay [m/s, rad/s]; p, the\n"
    "probability of ranks so far behind those of the best replays without being worse (rank-sum test)"
)


Raw = Annotated[Path, typer.Argument(metavar="RAW", show_default=False, help="Recording to train on.")]
Replayed = Annotated[Path, typer.Option(metavar="RAW", help="Recording to replay, such as replay90.")]
Folder = Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the study."), FOLDER]
Tested = Annotated[
    Path | None,
    typer.Option(metavar="RAW", help="Test recording; default: the split's test part."),
]
VehicleOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Vehicle file; default: the one in the data."),
]
Models = Annotated[
    list[str] | None, typer.Option("--model", metavar="NAME", help="Only this model; may be repeated.")
]
Epochs = Annotated[
    int | None,
    typer.Option(min=1, help="Maximum passes over the data; see hydro train."),
]
Minutes = Annotated[
    list[float] | None,
    typer.Option(metavar="MIN", help="Also train on this many minutes; may be repeated."),
]
Noise = Annotated[
    str,
    typer.Option(metavar="SPEC", help="Noise added to the training data: none, ordinary, dvl."),
]
Fitted = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Vehicle file with fitted effects to replay."),
]
Workers = Annotated[int, typer.Option(min=1, help="Steps at a time.", rich_help_panel=CLUSTER)]
Quick = Annotated[bool, typer.Option("--quick", help="A few models, one seed, one epoch, short trainings.")]
Given = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Vehicle file with effects chosen without data.", rich_help_panel=PAPER
    ),
]
Conditions = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="Only this physics; may be repeated.", rich_help_panel=PAPER),
]
Stages = Annotated[
    int, typer.Option(min=1, max=3, help="Last stage of the curriculum.", rich_help_panel=PAPER)
]
Steps = Annotated[int, typer.Option(min=1, help="Most steps of a training.", rich_help_panel=PAPER)]
Episodes = Annotated[int, typer.Option(min=1, help="Tasks of each test.", rich_help_panel=PAPER)]
Choices = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Setting of every training.", rich_help_panel=PAPER),
]
Seeds = Annotated[int, typer.Option(min=1, help="Networks of each model, or trainings of each physics.")]


def study(
    context: typer.Context,
    what: Annotated[
        Literal["models", "paper"],
        typer.Argument(metavar="WHAT", help="models: the residual models; paper: the paper with policies."),
    ],
    raw: Raw,
    replay: Replayed,
    folder: Folder,
    test: Tested = None,
    vehicle: VehicleOption = None,
    model: Models = None,
    seeds: Seeds = 5,
    epochs: Epochs = None,
    minutes: Minutes = None,
    noise: Noise = "none",
    effects: Fitted = None,
    given: Given = None,
    condition: Conditions = None,
    stages: Stages = 3,
    steps: Steps = 800_000,
    episodes: Episodes = 100,
    choices: Choices = None,
    device: Device = "cpu",
    workers: Workers = 1,
    engine: EngineName = HERE,
    address: Address = None,
    threads: Threads = 1,
    quick: Quick = False,
) -> None:
    """Train all residual networks, or repeat the paper's experiment.

    From raw data: labels, split, training, errors of the predicted wrench, open-loop replay, and Kendall's
    tau between both errors. Each step is an ordinary command, printed as it runs. An interrupted study
    resumes where it stopped. `hydro report DIR` shows the results, also while the study runs.

    WHAT paper trains the networks of Table I, then policies by SAC under each physics. It tests them in three
    simulators beside a scripted pilot.

    Details:

    Errors of the wrench are by axis and regime of motion; the replay is by segment, without and with
    conditioning. Kendall's tau answers whether the model that predicts best also replays best. A step whose
    inputs have not changed is not run again. With --engine ray steps run on the nodes of a Ray cluster, as
    many as have room, and --workers does not count.

    Networks are trained seed by seed. After every seed DIR gets the results so far: evaluation.parquet,
    errors.parquet, conditioning.parquet, ranking.parquet and minutes.parquet (means over seeds, smallest and
    largest), replay.parquet, figures/, models/ and the errors of every network.
    """
    if what == "paper":
        refused = {
            "--test": test, "--minutes": minutes, "--effects": effects,
            "--noise": None if noise == "none" else noise, "--device": None if device == "cpu" else device,
        }  # fmt: skip
        for option, value in refused.items():
            if value:
                raise UsageError(f"{option} is of hydro study models: leave it out")
        from hydro.study import paper

        settings = paper.Study(
            folder, raw, replay, _vehicle_file(raw, vehicle, folder), given, epochs=epochs, seeds=seeds,
            conditions=tuple(condition or paper.CONDITIONS), stages=stages, steps=steps, episodes=episodes,
            choices=(*paper.Study.choices, *(choices or ())),
            networks=tuple(model or paper.NETWORKS),
        )  # fmt: skip
        with runner(context, folder, workers, engine, address, threads) as (run, together):
            _paper(paper.quick(settings) if quick else settings, run, together)
        return
    from hydro.study import models
    from hydro.study.models import MODELS, QUICK_MODELS, Recordings, carry_out, disturb
    from hydro.study.summary import CONDITIONINGS

    known = models.Study(
        folder,
        Recordings(raw, replay, test, vehicle, noise, effects),
        models=tuple(model) if model else QUICK_MODELS if quick else MODELS,
        seeds=1 if quick else seeds,
        minutes=tuple(minutes or ()),
        epochs=1 if quick else epochs,
        device=device,
        conditionings=() if quick else CONDITIONINGS,
    )
    with runner(context, folder, workers, engine, address, threads) as (run, together):
        if noise != "none":
            disturb(known, run, noise_for(noise))
        result = carry_out(known, run, together)
    message(f"{result.ran} of {result.steps} steps run, the others were done")
    show(result.summary)


def _vehicle_file(raw: Path, vehicle: Path | None, folder: Path) -> Path:
    """Return the vehicle file of a study; that of a recording is written into the folder."""
    from hydro.io import table
    from hydro.io.files import write_bytes

    if vehicle is not None:
        return vehicle
    text = table.read(raw, "raw").provenance.vehicle
    if text is None:
        raise UsageError(f"{raw}: has no vehicle file: add --vehicle FILE")
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / "vehicle.toml"
    if not target.is_file() or target.read_text() != text:
        write_bytes(text.encode(), str(target))
    return target


def _paper(settings: Study, steps_of: Runner, together: int) -> None:
    """Run the study of the paper, and print the flights of the policies."""
    from hydro.study import paper, policies

    plan = paper.steps(settings)
    ran = steps_of.run(plan, together)
    message(f"{ran} of {len(plan)} steps run, the others were done")
    shown = policies.summarise(settings.policies, paper.runs(settings)).select(
        "recipe", "condition", "flown_by", "seed", "updates", "plant", "task", "level",
        "success", "success_low", "success_high", "collision", "time_to_goal", "energy",
    )  # fmt: skip
    print_table(shown, "Flown without exploration, with 95 % intervals")
    if settings.given is None:
        message("not run: R_effects, for want of its vehicle file: add --given FILE")


def show(summary: dict[str, pl.DataFrame]) -> None:
    """Print a summary."""
    from hydro.report.seeds import conditioning_table, minutes_table, ranking_table
    from hydro.report.tables import prediction_errors, replay_errors

    print_table(prediction_errors(summary["evaluation"]), PREDICTION_TITLE + "; means over seeds")
    print_table(replay_errors(summary["errors"]), REPLAY_TITLE + "; means over seeds")
    for name, tabulated, title in (
        ("conditioning", conditioning_table, CONDITIONING_TITLE),
        ("ranking", ranking_table, RANKING_TITLE),
        ("minutes", minutes_table, MINUTES_TITLE),
    ):
        if name in summary and not (table := tabulated(summary[name])).is_empty():
            print_table(table, title)


COMMANDS = {
    study: "hydro study models datasets/stonefish/sample.parquet "
    "--replay datasets/stonefish/replay90.parquet --quick -o study",
}
