"""Commands `study`: resumable studies of residual networks, of the reference paper, and of one change."""

from __future__ import annotations

from dataclasses import replace
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
    from hydro.study.proof import Study as Proof
    from hydro.study.steps import Runner

NAME = "study"
HELP = "Run a whole experiment: networks, the paper, or one change."
TRAININGS = "Trainings"
"""Heading of the options of the trainings of policies."""
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
        metavar="FILE", help="Vehicle file with effects chosen without data.", rich_help_panel=TRAININGS
    ),
]
Conditions = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="Only this physics; may be repeated.", rich_help_panel=TRAININGS),
]
Stages = Annotated[
    int, typer.Option(min=1, max=3, help="Last stage of the curriculum.", rich_help_panel=TRAININGS)
]
Steps = Annotated[int, typer.Option(min=1, help="Most steps of a training.", rich_help_panel=TRAININGS)]
BySac = Annotated[
    Literal["sac", "paper"],
    typer.Option(help="Fast SAC, or SAC with the settings of the paper.", rich_help_panel=TRAININGS),
]
Log = Annotated[
    Path | None,
    typer.Argument(metavar="RAW", show_default=False, help="Log of the changed vehicle; default: bundled."),
]
Earlier = Annotated[Path | None, typer.Option(metavar="RAW", help="Log of the vehicle before the change.")]
HeldOut = Annotated[Path | None, typer.Option(metavar="RAW", help="Held-out log of the changed vehicle.")]
OfEachFile = Annotated[int, typer.Option(min=1, help="Trainings in each of both files.")]
Short = Annotated[bool, typer.Option("--quick", help="No --before, one seed, short trainings.")]
Truth = Annotated[Path | None, typer.Option(metavar="FILE", help="Vehicle file with the true change.")]
Episodes = Annotated[int, typer.Option(min=1, help="Tasks of each test.", rich_help_panel=TRAININGS)]
Choices = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Setting of every training.", rich_help_panel=TRAININGS),
]
Seeds = Annotated[int, typer.Option(min=1, help="Networks of each model, or trainings of each physics.")]


def models(
    context: typer.Context,
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
    device: Device = "cpu",
    workers: Workers = 1,
    engine: EngineName = HERE,
    address: Address = None,
    threads: Threads = 1,
    quick: Quick = False,
) -> None:
    """Train all residual networks with several seeds.

    From raw data: labels, split, training, errors of the predicted wrench, open-loop replay, and Kendall's
    tau between both errors. Each step is an ordinary command, printed as it runs. An interrupted study
    resumes where it stopped. `hydro report DIR` shows the results, also while the study runs.

    Details:

    Errors of the wrench are by axis and regime of motion; the replay is by segment, without and with
    conditioning. Kendall's tau answers whether the model that predicts best also replays best. A step whose
    inputs have not changed is not run again. With --engine ray steps run on the nodes of a Ray cluster, as
    many as have room, and --workers does not count.

    Networks are trained seed by seed. After every seed DIR gets the results so far: evaluation.parquet,
    errors.parquet, conditioning.parquet, ranking.parquet and minutes.parquet (means over seeds, smallest and
    largest), replay.parquet, figures/, models/ and the errors of every network.
    """
    from hydro.study import models as networks
    from hydro.study.models import MODELS, QUICK_MODELS, Recordings, carry_out, disturb
    from hydro.study.summary import CONDITIONINGS

    known = networks.Study(
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
    _tell(result.ran, result.steps)
    show(result.summary)


def paper(
    context: typer.Context,
    raw: Raw,
    replay: Replayed,
    folder: Folder,
    vehicle: VehicleOption = None,
    model: Models = None,
    seeds: Seeds = 5,
    epochs: Epochs = None,
    given: Given = None,
    condition: Conditions = None,
    recipe: BySac = "sac",
    stages: Stages = 3,
    steps: Steps = 800_000,
    episodes: Episodes = 100,
    choices: Choices = None,
    workers: Workers = 1,
    engine: EngineName = HERE,
    address: Address = None,
    threads: Threads = 1,
    quick: Quick = False,
) -> None:
    """Repeat the experiment of the reference paper.

    The networks of Table I are trained, and policies by SAC under each physics. The policies are tested in
    three simulators and compared with a scripted pilot. Each step is an ordinary command, printed as it
    runs. An interrupted study resumes where it stopped.
    """
    from hydro.study import paper as whole

    settings = whole.Study(
        folder, raw, replay, _vehicle_file(raw, vehicle, folder), given, epochs=epochs, seeds=seeds,
        conditions=tuple(condition or whole.CONDITIONS), stages=stages, steps=steps, episodes=episodes,
        recipe=recipe, choices=(*whole.Study.choices, *(choices or ())),
        networks=tuple(model or whole.NETWORKS),
    )  # fmt: skip
    with runner(context, folder, workers, engine, address, threads) as (run, together):
        _paper(whole.quick(settings) if quick else settings, run, together)


def proof(
    context: typer.Context,
    folder: Folder,
    log: Log = None,
    vehicle: VehicleOption = None,
    before: Earlier = None,
    holdout: HeldOut = None,
    truth: Truth = None,
    seeds: OfEachFile = 5,
    steps: Steps = 179_200,
    episodes: Episodes = 100,
    choices: Choices = None,
    workers: Workers = 1,
    engine: EngineName = HERE,
    address: Address = None,
    threads: Threads = 1,
    quick: Short = False,
) -> None:
    r"""Find a change, and compare policies trained before and after it.

    The log of a changed vehicle is explained. Policies are trained by SAC in the vehicle file as given and in
    the file with the finding, with as many updates and the same seeds. All fly the changed vehicle in the
    reference simulator, and so does a scripted pilot. An interrupted study resumes where it stopped.

        hydro study proof after.parquet --vehicle vehicle.toml \
          --before before.parquet --holdout heldout.parquet \
          --truth true.toml -o proof

    Details:

    Without RAW the bundled recordings of Stonefish are used, in which thruster 3 gives 60 % of its thrust.
    The task is point to point in open water, stage 1 of the curriculum. The reference simulator has panels
    for a hull, so its water differs from that of both vehicle files. The true vehicle file also gives the
    oracle's error. No command of the study but the comparison of the oracle and the test flights reads it.

    DIR gets the study of `hydro explain`, a folder per training, and proof.png with three panels: errors 5 s
    ahead on held-out data, found and true values, and shares of arrivals. The picture is drawn
    after every test, so that a stopped study has one. --quick leaves out --before, adds the best finding
    without comparison with others, and trains for a second.
    """
    from hydro.study import proof as change

    settings = _proof(folder, log, vehicle, before, holdout, truth)
    settings = replace(settings, seeds=seeds, steps=steps, episodes=episodes, choices=tuple(choices or ()))
    settings = change.quick(settings) if quick else settings
    with runner(context, folder, workers, engine, address, threads) as (run, together):
        first = change.finding(settings)
        ran = run.run(first, together)
        after = change.chosen(settings)
        rest = change.trainings(settings, after)
        for step, anew in run.one_by_one(rest, together):
            ran += anew
            if anew and step.line[:2] == ("rl", "eval"):
                _draw_proof(settings, after)
    _tell(ran, len(first) + len(rest))
    _show_proof(settings, after)


def _tell(ran: int, steps: int) -> None:
    """Print how many steps of a study were run."""
    message(f"{ran} of {steps} steps run, the others were done")


def _proof(
    folder: Path,
    log: Path | None,
    vehicle: Path | None,
    before: Path | None,
    holdout: Path | None,
    truth: Path | None,
) -> Proof:
    """Return the settings of a study of one change, of the bundled recordings if no log is given.

    Raises:
        UsageError: A file is missing, or files are given without a log.
    """
    from hydro.io.files import bundled
    from hydro.study.proof import Study as Proof

    given = {"--vehicle": vehicle, "--before": before, "--holdout": holdout, "--truth": truth}
    if log is None:
        for option, value in given.items():
            if value is not None:
                raise UsageError(f"{option} {value}: name the log of the changed vehicle, too")
        data = bundled("changed")
        log, holdout = data / "thruster.parquet", data / "thruster-heldout.parquet"
        true = data / "thruster-true.toml"
        return Proof(folder, data / "vehicle.toml", log, holdout, true, data / "before.parquet")
    if holdout is None or truth is None:
        missing = "--holdout RAW" if holdout is None else "--truth FILE"
        raise UsageError(f"{log}: the study also needs {missing}")
    return Proof(folder, _vehicle_file(log, vehicle, folder), log, holdout, truth, before)


def _show_proof(settings: Proof, after: Path) -> None:
    """Print the tables of a study of one change, and draw its figure."""
    from hydro.study import proof_tables as tables

    pooled = tables.pooled(tables.flights(settings))
    print_table(tables.errors(settings), "Velocity error 5 s ahead on held-out data [m/s]")
    print_table(tables.named(settings, after), "Values of the vehicle file, found and true")
    print_table(pooled, "Arrivals over all seeds, with Wilson's 95 % interval")
    message(f"{_draw_proof(settings, after)}: the three panels")


def _draw_proof(settings: Proof, after: Path) -> Path:
    """Draw the figure of a study of one change from its results so far, and return its path."""
    from hydro.report.proof import Shown, draw
    from hydro.report.training import save
    from hydro.study import proof_tables as tables

    errors, flights = tables.errors(settings), tables.flights(settings)
    ours = [name for name in errors["method"] if name.startswith("step ")]
    shown = Shown(errors, tables.named(settings, after), tables.pooled(flights), flights, ours)
    picture = settings.folder / "proof.png"
    save(draw({settings.log.stem: shown}), picture)
    return picture


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
    """Run the study of the paper, and print the flights of the policies.

    Args:
        settings: Settings of the study.
        steps_of: Runner of the steps.
        together: Number of steps that may run at the same time.
    """
    from hydro.study import paper as whole
    from hydro.study import policies

    plan = whole.steps(settings)
    ran = steps_of.run(plan, together)
    _tell(ran, len(plan))
    shown = policies.summarise(settings.policies, whole.runs(settings)).select(
        "recipe", "condition", "flown_by", "seed", "updates", "plant", "task", "level",
        "success", "success_low", "success_high", "collision", "time_to_goal", "energy",
    )  # fmt: skip
    print_table(shown, "Flown without exploration, with 95 % intervals")
    if settings.given is None:
        message("not run: R_effects, for want of its vehicle file: add --given FILE")


def show(summary: dict[str, pl.DataFrame]) -> None:
    """Print the summary tables of a study of networks.

    Args:
        summary: Metrics tables by name, from `study.summary.summarise`.
    """
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
    models: "hydro study models datasets/stonefish/sample.parquet "
    "--replay datasets/stonefish/replay90.parquet --quick -o study",
    paper: "hydro study paper datasets/stonefish/sample.parquet "
    "--replay datasets/stonefish/replay90.parquet --quick -o paper",
    proof: "hydro study proof -o proof",
}
