"""`replay`: recorded commands flown again in MuJoCo, with and without learned water forces."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.shell import (
    CONDITIONING_TITLE,
    PIECE_TITLE,
    REPLAY_TITLE,
    STREAM,
    Output,
    VehicleFile,
    about,
    dataset_name,
    print_table,
    progress,
    read,
    shows_table,
    vehicle_for,
    write,
)
from hydro.core.errors import DataError

if TYPE_CHECKING:
    import polars as pl

    from hydro.core.vehicle.description import Vehicle
    from hydro.io.table import Artefact

Raw = Annotated[
    str, typer.Argument(metavar="RAW", help="Raw table; nothing or - is stdin.", show_default=False)
]


def replay(
    raw: Raw = STREAM,
    model: Annotated[
        list[str] | None, typer.Option(metavar="MODEL", help="A trained model; repeat for several.")
    ] = None,
    variant: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this variant, such as MJ0 or MJ4; repeat for several."),
    ] = None,
    conditioning: Annotated[
        Literal[
            "off", "paper", "paper-old", "paper-new", "low-pass-old", "low-pass-new", "clipping", "dead-band"
        ],
        typer.Option(help="What is done to the learned wrench before it acts; see above."),
    ] = "off",
    lead: Annotated[
        float,
        typer.Option(min=0.0, max=1.0, help="How far ahead networks look, in control steps; 0: the paper."),
    ] = 0.5,
    integrator: Annotated[
        Literal["euler", "implicitfast", "implicit", "rk4"], typer.Option(help="MuJoCo's integrator.")
    ] = "implicitfast",
    timestep: Annotated[float, typer.Option(min=1e-5, help="Physics step [s].")] = 0.002,
    piece: Annotated[
        float | None,
        typer.Option(
            min=0.1, metavar="SECONDS", help="Also measure every piece of so many seconds of a sequence."
        ),
    ] = None,
    figures: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also draw velocities and errors of all variants.")
    ] = None,
    metrics: Annotated[
        str | None, typer.Option(metavar="FILE", help="Also write the errors, a metrics table.")
    ] = None,
    vehicle: VehicleFile = None,
    output: Output = STREAM,
) -> None:
    """Fly a recording's commands again in MuJoCo, open loop, and measure how far each variant strays.

    MJ0 has no water forces, MJ0+M_A has added mass alone, MJ0+ellipsoid MuJoCo's own fluid model; every model
    adds its own variant, under the paper's name where it has one (mlp MJ1, physfeat MJ4). A model whose
    labels left out all effects flies with them, as effects+MJ4, beside the effects alone. On a terminal
    without -o the errors are printed; with -o, or into a pipe, the time series of all variants and of the
    measured motion are written. --piece 10 measures replay90 by its nine segments as well.

    A network's wrench is held from one control step to the next, and the network is asked for that of the
    middle of this time; --lead 0 asks, as the paper does, for that of its beginning.

    --conditioning says what is done to a learned wrench at 25 Hz: off, nothing; or the paper's low-pass with
    beta = 0.9, then clipping of each axis at twice what the thrusters can make there, then a dead band that
    fades the wrench out below 0.02 m/s and 0.02 rad/s. The paper leaves open what beta weighs. paper-old
    weighs the old value, a lag of 0.38 s: with a network trained on the full Stonefish recordings the errors
    of replay90 grow by a factor of 18 to 37. paper-new weighs the new value and changes next to nothing
    there; paper is paper-new. low-pass-old, low-pass-new, clipping and dead-band are one piece alone. The
    metrics tell how often clipping and dead band acted, as shares of the control steps.
    """
    from hydro.io import model as models
    from hydro.io import table
    from hydro.report.tables import conditioning_shares, piece_errors, replay_errors
    from hydro.sim import replay as sim
    from hydro.sim.residual.conditioning import preset
    from hydro.sim.student import Physics

    source = read(raw, "raw")
    known, text = vehicle_for(source, vehicle)
    trained = [read(name, "model") for name in model or []]
    for name, artefact in zip(model or [], trained, strict=True):
        _require_same_effects(name, artefact, known)
    flown = sim.variants([models.from_artefact(artefact) for artefact in trained], variant or None)
    physics = Physics(timestep=timestep, integrator=integrator)
    setup = sim.Setup(conditioning=preset(conditioning, known), lead=lead, physics=physics)
    with progress("replay") as update, about(raw):
        series, errors = sim.replay(
            source.frame,
            known,
            flown,
            setup=setup,
            dataset=dataset_name(raw),
            piece=piece,
            progress=lambda name, done, total: update(done, total, name),
        )
    if figures is not None:
        _draw(series, errors, figures)
    parameters: dict[str, Any] = {
        "variants": [one.name for one in flown],
        "conditioning": conditioning,
        "lead": lead,
        "integrator": integrator,
        "timestep": timestep,
    } | ({} if piece is None else {"piece": piece})

    def made(kind: str, frame: pl.DataFrame) -> Artefact:
        inputs = [source, *trained]
        return table.make(
            kind, frame, stage="replay", parameters=parameters, inputs=inputs, vehicle_text=text
        )

    if metrics is not None:
        write(made("metrics", errors), metrics)
    if shows_table(output):
        print_table(replay_errors(errors), REPLAY_TITLE)
        if piece is not None:
            print_table(piece_errors(errors), PIECE_TITLE)
        if conditioning != "off" and not (shares := conditioning_shares(errors)).is_empty():
            print_table(shares, CONDITIONING_TITLE.format(conditioning))
    else:
        write(made("replay", series), output)


def _draw(series: pl.DataFrame, errors: pl.DataFrame, folder: Path) -> None:
    """Draw the velocities of every variant over the measured ones, and the errors as a heat map."""
    from hydro.report import figures
    from hydro.report.tables import replay_errors

    folder.mkdir(parents=True, exist_ok=True)
    figures.save(figures.draw_overlay(figures.overlay_table(series)), folder / "velocities.png")
    figures.save(figures.draw_errors(replay_errors(errors)), folder / "errors.png")


def _require_same_effects(name: str, model: Artefact, known: Vehicle) -> None:
    """Refuse a model that learnt what other effects leave than those that would fly with it."""
    from hydro.io import vehicle

    labelled = model.provenance.vehicle
    if labelled is None or (model.provenance.model or {}).get("subtract") != "effects":
        return
    if vehicle.vehicle_hash(vehicle.parse(labelled)) != vehicle.vehicle_hash(known):
        raise DataError(
            f"{name}: its labels left out the effects of another vehicle file: add --vehicle with the file "
            "that the labels were made with"
        )


COMMANDS = {
    replay: "hydro replay datasets/stonefish/replay90.parquet --model model.parquet -o replay.parquet",
}
