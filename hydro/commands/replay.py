"""`replay`: recorded commands flown again in MuJoCo, with and without learned water forces."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from hydro.commands.shell import (
    STREAM,
    Output,
    VehicleFile,
    dataset_name,
    print_table,
    progress,
    read,
    refuse_terminal,
    shows_table,
    vehicle_for,
    write,
)

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
        Literal["off", "paper", "paper-new"],
        typer.Option(help="Low-pass, clipping and dead band of the learned wrench, as the paper does."),
    ] = "off",
    integrator: Annotated[
        Literal["euler", "implicitfast", "implicit", "rk4"], typer.Option(help="MuJoCo's integrator.")
    ] = "implicitfast",
    timestep: Annotated[float, typer.Option(min=1e-5, help="Physics step [s].")] = 0.002,
    metrics: Annotated[
        str | None, typer.Option(metavar="FILE", help="Also write the errors, a metrics table.")
    ] = None,
    vehicle: VehicleFile = None,
    output: Output = STREAM,
) -> None:
    """Fly a recording's commands again in MuJoCo, open loop, and measure how far each variant strays.

    MJ0 has no water forces, MJ0+M_A has added mass alone; every model adds its own variant, under the paper's name
    where it has one (mlp is MJ1, physfeat MJ4). On a terminal without -o the errors are printed; with -o the time
    series of all variants and of the measured motion are written.
    """
    from hydro.io import model as models
    from hydro.io import table
    from hydro.sim import replay as sim

    if metrics is None and not shows_table(output):
        refuse_terminal(output)
    source = read(raw, "raw")
    known, text = vehicle_for(source, vehicle)
    trained = [read(name, "model") for name in model or []]
    flown = sim.variants([models.from_artefact(artefact) for artefact in trained], variant or None)
COMMANDS = {}
