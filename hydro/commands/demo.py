"""`demo`: the whole line on bundled recordings, by the very commands that it prints."""

from __future__ import annotations

import shlex
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from hydro.commands.shell import PREDICTION_TITLE, REPLAY_TITLE, print_table, read

PACKAGE = Path(__file__).resolve().parents[1]
EPOCHS = 20

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder to write into; made if need be.")]


def demo(
    context: typer.Context,
    folder: Folder = Path("demo-out"),
    epochs: Annotated[
        int, typer.Option(min=1, help="Passes over the training data, for each network.")
    ] = EPOCHS,
) -> None:
    """Run the whole line on a bundled sample of recordings: a few minutes on two cores.

    Labels, split, two networks, their errors on the test part, and a 90 s manoeuvre replayed open loop in
    MuJoCo without water forces, with added mass, and with each network. Every step is an ordinary command,
    printed as it runs. Ends with the errors and the paths of what was written.
    """
    data = _bundled()
    folder.mkdir(parents=True, exist_ok=True)
    out = {name: str(folder / f"{name}.parquet") for name in _ARTEFACTS}
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
    typer.echo("The first run after an installation also compiles the physics, a minute or two.")
    for step in steps:
        _run(context.find_root().command, step)
    pictures = _draw(out, folder)
    _print_errors(out)
    typer.echo("Written:")
    for path in [*out.values(), *pictures]:
        typer.echo(f"  {path}")


_ARTEFACTS = ("labels", "blocks", "split", "mlp", "physfeat", "evaluation", "replay", "errors")


def _bundled() -> Path:
    """The bundled recordings, inside an installed package or beside it in a checkout."""
    packaged = PACKAGE / "_datasets"
    data = (packaged if packaged.is_dir() else PACKAGE.parent / "datasets") / "stonefish"
    return data.relative_to(Path.cwd()) if data.is_relative_to(Path.cwd()) else data


def _run(root: Any, step: list[str]) -> None:
    """Print one command line, run it in this process, and say how long it took."""
    typer.echo(f"$ hydro {shlex.join(step)}")
    started = time.perf_counter()
    root.main(step, prog_name="hydro", standalone_mode=False)
    typer.echo(f"  {time.perf_counter() - started:.1f} s")


def _draw(out: dict[str, str], folder: Path) -> list[Path]:
    """Draw the replay's velocities and errors; the paths of the pictures."""
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
