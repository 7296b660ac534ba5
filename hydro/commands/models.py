"""`train` and `evaluate`: residual networks from labels, and how well they predict."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

from hydro.commands.shell import (
    STREAM,
    Output,
    dataset_name,
    print_table,
    progress,
    read,
    refuse_terminal,
    shows_table,
    write,
)

LabelsOrSplit = Annotated[
    str,
    typer.Argument(
        metavar="LABELS", show_default=False, help="Labels or split table; nothing or - is stdin."
    ),
]


def train(
    labels: LabelsOrSplit = STREAM,
    model: Annotated[str, typer.Option(metavar="NAME", help="Architecture: mlp or physfeat.")] = "physfeat",
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first weights and of the order of rows.")] = 0,
    epochs: Annotated[int, typer.Option(min=1, help="Passes over the data at most.")] = 60,
    device: Annotated[Literal["cpu", "cuda"], typer.Option(help="Where to train.")] = "cpu",
    output: Output = STREAM,
) -> None:
    """Train a residual network on the training part of labels, after the paper's protocol.

    Inputs and outputs are standardised on the rows fitted; Adam, gradient clipping, early stopping on a tenth
    of the training blocks. Labels without a split get the default one. The same data and seed give the same
    bytes on one machine.
    """
    from hydro.io.model import to_artefact
    from hydro.learn.train import train as fit

    refuse_terminal(output)
    source = read(labels, "labels", "split")
    frame = source.frame
    if source.kind == "labels":
        from hydro.core.split import split

        frame, _ = split(frame)
    with progress(f"train {model}") as update:
        trained = fit(
            frame,
            model=model,
            seed=seed,
            epochs=epochs,
            device=device,
            progress=lambda epoch: update(
                epoch.number, epoch.limit, f"epoch {epoch.number}, validation {epoch.validation_rmse:.3g}"
            ),
        )
    parameters = {"model": model, "epochs": epochs, "device": device}
    write(to_artefact(trained, parameters=parameters, seed=seed, inputs=[source]), output)


COMMANDS = {
    train: "hydro train split.parquet --model physfeat --epochs 3 -o model.parquet",
}
