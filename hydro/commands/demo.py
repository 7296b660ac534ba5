"""Command `demo`: all stages on bundled recordings, by the commands that it prints."""

from __future__ import annotations

import shlex
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from hydro.commands.places import FOLDER
from hydro.commands.shell import PREDICTION_TITLE, REPLAY_TITLE, read
from hydro.commands.tables import print_table
from hydro.io.files import bundled

EPOCHS = 20

Folder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder to write into; created if needed."), FOLDER
]


def demo(
    context: typer.Context,
    folder: Folder = Path("demo-out"),
    epochs: Annotated[
        int, typer.Option(min=1, help="Passes over the training data, for each network.")
    ] = EPOCHS,
) -> None:
    """Run every stage on bundled data in a few minutes.

    The first part finds a change of a vehicle in the simulator Stonefish, whose water model hydro does not
    have. The vehicle file was fitted to the unchanged vehicle. The output has the regimes in which the file
    fails on the changed vehicle, the change, and the errors on held-out data before and after the change is
    added. A report shows the results on one page. The second part trains two residual networks: labels,
    split, training, errors on the test part, and a 90 s manoeuvre replayed open loop in MuJoCo without water
    forces, with added mass, and with each network. Every step is an ordinary command, printed as it runs.
    """
    root = context.find_root().command
    typer.echo("The first run after an installation also compiles the physics, a minute or two.")
    typer.echo("\nWhat has changed in a vehicle?\n")
    report, *changed = _changed(root, folder)
    learnt = _learnt(root, folder, epochs)
    typer.echo("Written:")
    for path in [*changed, *learnt]:
        typer.echo(f"  {path}")
    typer.echo(f"\nThe change on one page, for a browser: {report}")


def _changed(root: Any, folder: Path) -> list[Path]:
    """Find and add the change in the bundled recordings by ordinary commands; return the written files.

    Args:
        root: Command group `hydro`.
        folder: Folder of the results.
    """
    data, report, study = _bundled("changed"), folder / "report.html", folder / "study"
    comparison = folder / "comparison.parquet"
    file, log = str(data / "vehicle.toml"), str(data / "thruster.parquet")
    others = ["--before", str(data / "before.parquet"), "--holdout", str(data / "thruster-heldout.parquet")]
    _run(root, ["compare", file, log, "-o", str(comparison)])
    _run(root, ["explain", file, log, *others, "-o", str(study)])
    _run(root, ["report", str(study), "-o", str(report)])
    return [report, comparison, study]


def _learnt(root: Any, folder: Path, epochs: int) -> list[Path]:
    """Train networks on the bundled sample and replay them by ordinary commands; return the written files.

    Without torch, the function says so and returns no file.

    Args:
        root: Command group `hydro`.
        folder: Folder of the results.
        epochs: Passes over the training data.
    """
    from hydro.core import extras

    try:
        extras.require("torch")
    except extras.MissingExtraError as error:
        typer.echo(f"\nThe second part trains networks: {error}\n")
        return []
    typer.echo("\nHow well do residual networks predict the water forces, and how well do they replay?\n")
    data, out = _bundled("stonefish"), {name: str(folder / f"{name}.parquet") for name in _ARTEFACTS}
    steps = [
        ["labels", str(data / "sample.parquet"), "-o", out["labels"]],
        ["split", out["labels"], "--blocks", out["blocks"], "-o", out["split"]],
        ["train", out["split"], "--model", "mlp", "--epochs", str(epochs), "-o", out["mlp"]],
        ["train", out["split"], "--model", "physfeat", "--epochs", str(epochs), "-o", out["physfeat"]],
        ["evaluate", out["mlp"], out["physfeat"], "--labels", out["split"], "-o", out["evaluation"]],
        [
            *("replay", str(data / "replay90.parquet"), "--model", out["mlp"], "--model", out["physfeat"]),
            *("--metrics", out["errors"], "-o", out["replay"]),
        ],
    ]
    for step in steps:
        _run(root, step)
    pictures = _draw(out, folder)
    _print_errors(out)
    return [*map(Path, out.values()), *pictures]


_ARTEFACTS = ("labels", "blocks", "split", "mlp", "physfeat", "evaluation", "replay", "errors")


def _bundled(name: str) -> Path:
    """Return a folder of bundled recordings, relative to the working folder."""
    data = bundled(name)
    return data.relative_to(Path.cwd()) if data.is_relative_to(Path.cwd()) else data


def _run(root: Any, step: list[str]) -> None:
    """Print one command line, run it in this process, and print its duration."""
    typer.echo(f"$ hydro {shlex.join(step)}")
    started = time.perf_counter()
    root.main(step, prog_name="hydro", standalone_mode=False)
    typer.echo(f"  {time.perf_counter() - started:.1f} s")


def _draw(out: dict[str, str], folder: Path) -> list[Path]:
    """Draw velocities and errors of the replay; return the paths of the pictures."""
    from hydro.report import figures
    from hydro.report.tables import replay_errors

    pictures = [folder / "replay.png", folder / "errors.png"]
    figures.save(figures.draw_overlay(figures.overlay_table(read(out["replay"]).frame)), pictures[0])
    figures.save(figures.draw_errors(replay_errors(read(out["errors"]).frame)), pictures[1])
    return pictures


def _print_errors(out: dict[str, str]) -> None:
    """Print both error tables: of the predicted wrench, and of the replayed velocities."""
    from hydro.report.tables import prediction_errors, replay_errors

    predicted, replayed = read(out["evaluation"]).frame, read(out["errors"]).frame
    print_table(prediction_errors(predicted), PREDICTION_TITLE)
    print_table(replay_errors(replayed), REPLAY_TITLE)


COMMANDS = {
    demo: "hydro demo demo-out",
}
