"""Commands `train` and `evaluate`: residual networks from labels, and their prediction errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.as_json import Json, print_json, saves
from hydro.commands.help import ADVANCED
from hydro.commands.places import FOLDER, Output
from hydro.commands.recordings import MaxExpanded
from hydro.commands.shell import (
    PREDICTION_TITLE,
    REGIME_TITLE,
    STREAM,
    Device,
    about,
    dataset_name,
    left_out,
    network,
    progress,
    read,
    refuse_terminal,
    report,
    seed_option,
    shows_table,
    write,
)
from hydro.commands.tables import print_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    import polars as pl

    from hydro.io.model import Model
    from hydro.io.table import Artefact

LabelsOrSplit = Annotated[
    str,
    typer.Argument(
        metavar="LABELS", show_default=False, help="Labels or split table; nothing or - is stdin."
    ),
]


Epochs = Annotated[
    int | None,
    typer.Option(min=1, help="Maximum passes over the data; default: 25,000 updates."),
]
Minutes = Annotated[
    float | None,
    typer.Option(metavar="MIN", help="Train on so many minutes of the data.", rich_help_panel=ADVANCED),
]
Accelerations = Annotated[
    bool | None,
    typer.Option(
        "--accelerations/--no-accelerations",
        show_default=False,
        help="Accelerations as inputs; default: if noise is below 1 %.",
        rich_help_panel=ADVANCED,
    ),
]


Protocol = Annotated[
    Literal["annealed", "paper"],
    typer.Option(help="Optimiser and schedule: annealed, or as published.", rich_help_panel=ADVANCED),
]


def train(
    labels: LabelsOrSplit = STREAM,
    model: Annotated[str, typer.Option(metavar="NAME", help="Architecture, see above.")] = "physfeat",
    seed: Annotated[int, seed_option("Seed of the first weights and of the order of rows.")] = 0,
    epochs: Epochs = None,
    minutes: Minutes = None,
    accelerations: Accelerations = None,
    protocol: Protocol = "annealed",
    device: Device = "cpu",
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    """Train a residual network on the training part of labels.

    The same data and seed give the same bytes on one machine. Labels without a split get the default one.

        hydro train split.parquet --model physfeat -o model.parquet

        model       weights  architecture
        mlp          68,358  MLP 12-128-256-128-6, the baseline of the paper
        resmlp      129,542  four residual blocks with layer norms
        multihead   114,390  a trunk and one head per axis
        moe          76,892  four experts and a gate
        physfeat     72,582  PhysicsFeature-MLP: an MLP on 45 features
        structured   71,624  C(nu) nu + D(nu) nu, D >= 0: dissipative
        temporal     73,734  an MLP with the velocities of the last 0.28 s
        gp           60,520  Gaussian process, symmetric, for minutes of data

    Details:

    Inputs and outputs are standardised on the fitted rows. The optimiser is Adam with a learning rate that
    falls to zero as a half cosine, gradient clipping, and early stopping on a tenth of the training blocks,
    in one thread. --protocol paper uses the published settings instead: a learning rate of 1e-3 that falls at
    plateaus, and L2 regularisation in the gradient. The paper gives the numbers of weights as 42K (mlp),
    130K, 114K, 77K and 73K (physfeat); the widths that it states for mlp give 68,358.

    The noise of a log is in the acceleration and, through M nu_dot, in the label: a network that has both
    learns the noise. From a noisy log, networks are therefore trained without accelerations and with a weight
    decay that keeps them from learning the noise of the labels. One line on stderr says so.

    gp has no epochs and takes no accelerations. The error of left-out blocks decides how drag grows with the
    speed, and how symmetric the hull is: port and starboard, bow and stern, top and bottom. It takes about a
    minute, whatever the data.
    """
    from dataclasses import replace
    from math import isnan

    from hydro.io.model import to_artefact
    from hydro.io.provenance import parameters_of
    from hydro.learn.train import train as fit

    refuse_terminal(output)
    source, frame = _split(labels, minutes)
    labelled = parameters_of(source.provenance, "labels")
    if accelerations is None:
        accelerations = _trusted_accelerations(labels, frame, labelled.get("noise"))
    with progress(f"train {model}") as update:
        trained = fit(
            frame,
            model=model,
            seed=seed,
            epochs=epochs,
            device=device,
            accelerations=accelerations,
            centre=_centre_of_gravity(source),
            protocol=protocol,
            progress=lambda epoch: update(
                epoch.number,
                epoch.limit,
                f"step {epoch.number}"
                if isnan(epoch.validation_rmse)
                else f"epoch {epoch.number}, validation {epoch.validation_rmse:.3g}",
            ),
        )
    trained = replace(trained, subtract=labelled.get("subtract", "inertia"))
    parameters: dict[str, Any] = {"model": model, "device": device, "accelerations": accelerations}
    parameters |= {} if protocol == "annealed" else {"protocol": protocol}
    parameters |= {} if epochs is None else {"epochs": epochs}
    parameters |= {} if minutes is None else {"minutes": minutes}
    write(to_artefact(trained, parameters=parameters, seed=seed, inputs=[source]), output)


def _centre_of_gravity(source: Artefact) -> tuple[float, float, float] | None:
    """Return the centre of gravity of the vehicle of the labels; None if it is not known."""
    from hydro.io import vehicle

    text = source.provenance.vehicle
    return None if text is None else vehicle.parse(text).rigid_body.center_of_gravity


def _split(labels: str, minutes: float | None) -> tuple[Artefact, pl.DataFrame]:
    """Return the labels and their split, limited to `minutes` of training data if given.

    Args:
        labels: Path of labels or of a split table; `-` is stdin.
        minutes: Minutes of training data; None for all.
    """
    from hydro.core.distillation.split import split
    from hydro.learn.rows import for_minutes

    source = read(labels, "labels", "split")
    with about(labels):
        frame = split(source.frame)[0] if source.kind == "labels" else source.frame
    report(labels, left_out(source.frame))
    return source, frame if minutes is None else for_minutes(frame, minutes)


def _trusted_accelerations(labels: str, frame: pl.DataFrame, noise: Sequence[float] | None) -> bool:
    """Return whether accelerations have so little noise that a network may use them as inputs.

    If they have too much, a line is printed on stderr.
    """
    from hydro.learn.train import trusted_accelerations

    with about(labels):
        trusted = trusted_accelerations(frame, noise)
    if not trusted:
        typer.echo(
            "hydro: the log is noisy: trained without accelerations as inputs, with strong weight decay",
            err=True,
        )
    return trusted


def evaluate(
    models: Annotated[list[str], typer.Argument(metavar="MODEL", help="Trained models; - is stdin.")],
    labels: Annotated[
        str, typer.Option(metavar="FILE", help="Labels or split table to predict; - is stdin.")
    ],
    part: Annotated[
        Literal["test", "train", "all"], typer.Option(help="Part of the split; labels have only all.")
    ] = "test",
    by: Annotated[
        list[str] | None,
        typer.Option(metavar="WAY", help="Also by speed, drift or reach; may be repeated."),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Also draw errors and predictions."),
        FOLDER,
    ] = None,
    as_json: Json = False,
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    """Measure how well residual networks predict the force.

    The result has root mean square and mean absolute errors and R2 of each axis, with 95 % intervals. --by
    also measures subsets of the rows by speed, drift angle or reach. On a terminal without -o it is printed.

        hydro evaluate mlp.parquet gp.parquet --labels split.parquet --by speed

    Details:

    Intervals are from a bootstrap over blocks. The paper's single figures (its Table II) are over all rows
    and six axes in their own units. Drift is the angle between the velocity and the bow. Reach is the number
    of standard deviations of the training data between the furthest velocity and their mean: above 3 a
    network extrapolates.
    """
    from hydro.io.table import make
    from hydro.learn.evaluate import evaluate as measure
    from hydro.report.tables import prediction_errors, regime_errors

    trained = [network(model) for model in models]
    source = read(labels, "labels", "split")
    name = dataset_name(labels)
    known = [model for _, model in trained]
    with about(labels):
        errors = measure(known, source.frame, part=part, dataset=name, by=by or ())
    report(labels, left_out(source.frame))
    if figures is not None:
        _draw(known, source.frame, part, errors, figures)
    if as_json:
        print_json(errors=errors)
    elif shows_table(output):
        print_table(prediction_errors(errors), PREDICTION_TITLE)
        if by:
            print_table(regime_errors(errors), REGIME_TITLE)
    if saves(output, as_json):
        inputs = [*(artefact for artefact, _ in trained), source]
        parameters = {"part": part} | ({"by": list(by)} if by else {})
        write(make("metrics", errors, stage="evaluate", parameters=parameters, inputs=inputs), output)


def _draw(
    models: Sequence[Model], table: pl.DataFrame, part: str, errors: pl.DataFrame, folder: Path
) -> None:
    """Draw the results of an evaluation into a folder."""
    from hydro.learn import rows
    from hydro.learn.evaluate import predict_rows
    from hydro.report import predictions
    from hydro.report.figures import save

    save(predictions.draw_axes(errors), folder / "axes.png")
    if (errors["variant"] != "").any():
        save(predictions.draw_regimes(errors), folder / "regimes.png")
    for model in models:
        chosen, predicted = predict_rows(model, table, part)
        density = predictions.density_table(rows.wrenches(chosen), predicted)
        save(predictions.draw_density(density, model.name), folder / f"density-{model.name}.png")


COMMANDS = {
    train: "hydro train split.parquet --model physfeat --epochs 3 -o model.parquet",
    evaluate: "hydro evaluate model.parquet --labels split.parquet -o errors.parquet",
}
