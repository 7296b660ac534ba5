"""Command `replay`: recorded commands simulated in MuJoCo, with and without learned water forces."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.help import ADVANCED
from hydro.commands.places import FILE, FOLDER, Output
from hydro.commands.recordings import Definitions, Logs, MapFile, MaxExpanded, Measured, called
from hydro.commands.shell import (
    CONDITIONING_TITLE,
    PIECE_TITLE,
    REPLAY_TITLE,
    STREAM,
    VehicleFile,
    about,
    dataset_name,
    network,
    progress,
    shows_table,
    tell_voltage,
    vehicle_for,
    write,
)
from hydro.commands.tables import print_table
from hydro.core.errors import DataError

if TYPE_CHECKING:
    import polars as pl

    from hydro.core.vehicle.description import Vehicle
    from hydro.io.model import Model
    from hydro.io.table import Artefact

Models = Annotated[list[str] | None, typer.Option(metavar="MODEL", help="Trained model; may be repeated.")]
Variants = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME", help="Only this variant, such as MJ0; may be repeated."),
]
Conditioning = Annotated[
    Literal[
        "off", "paper", "paper-old", "paper-new", "low-pass-old", "low-pass-new", "clipping", "dead-band"
    ],
    typer.Option(
        metavar="NAME", help="Filters of the learned wrench, such as paper.", rich_help_panel=ADVANCED
    ),
]
Lead = Annotated[
    float,
    typer.Option(min=0.0, max=1.0, help="Control steps that networks look ahead.", rich_help_panel=ADVANCED),
]
Integrator = Annotated[
    Literal["euler", "implicitfast", "implicit", "rk4"],
    typer.Option(metavar="NAME", help="MuJoCo's integrator.", rich_help_panel=ADVANCED),
]
Timestep = Annotated[float, typer.Option(min=1e-5, help="Physics step [s].", rich_help_panel=ADVANCED)]
Piece = Annotated[
    float | None,
    typer.Option(min=0.1, metavar="SECONDS", help="Also errors of every segment of this length."),
]
Figures = Annotated[Path | None, typer.Option(metavar="DIR", help="Also draw velocities and errors."), FOLDER]
Metrics = Annotated[
    str | None, typer.Option(metavar="FILE", help="Also write the errors as a metrics table."), FILE
]


def replay(
    raw: Measured = None,
    model: Models = None,
    variant: Variants = None,
    conditioning: Conditioning = "off",
    lead: Lead = 0.5,
    integrator: Integrator = "implicitfast",
    timestep: Timestep = 0.002,
    piece: Piece = None,
    figures: Figures = None,
    metrics: Metrics = None,
    vehicle: VehicleFile = None,
    map_: MapFile = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    """Replay recorded commands in MuJoCo and measure the errors.

    The replay is open loop. MJ0 has no water forces, MJ0+M_A added mass, MJ0+ellipsoid MuJoCo's fluid model;
    each --model adds a variant. Errors are printed on a terminal; -o or a pipe gets the time series of all
    variants and of the measured motion.

        hydro replay replay90.parquet --model model.parquet --piece 10

    Details:

    Variants have the paper's names where it has one: mlp is MJ1, physfeat MJ4. A model whose labels had all
    effects subtracted is replayed with them, as effects+MJ4, and the effects alone are a variant as well. A
    log that --map reads gets values in every row, as from hydro import --fill.

    A network's wrench is held from one control step to the next. The network is evaluated at the predicted
    state in the middle of this time; with --lead 0, as in the paper, at the state at its beginning.

    --conditioning filters a learned wrench at 25 Hz, as the paper does: a low-pass with beta = 0.9, then
    clipping of each axis at twice the maximum of the thrusters there, then a dead band that fades the wrench
    out below 0.02 m/s and 0.02 rad/s. The paper does not define beta. In paper-old it weights the old value,
    a lag of 0.38 s: with a network trained on the full Stonefish recordings the errors of replay90 grow by a
    factor of 18 to 37. In paper-new it weights the new value and changes almost nothing; paper is paper-new.
    low-pass-old, low-pass-new, clipping and dead-band are single stages. The metrics have the share of
    control steps in which clipping and dead band acted.
    """
    given = _Given(
        called(raw), tuple(model or ()), tuple(variant or ()), conditioning, lead, integrator, timestep, piece
    )
    source = Logs(map_, msg, vehicle, fill=True).read(raw)
    flown = _flown(given, source, vehicle)
    if figures is not None:
        _draw(flown.series, flown.errors, figures)
    if metrics is not None:
        write(flown.table("metrics", flown.errors), metrics)
    if shows_table(output):
        _show(flown.errors, given)
    else:
        write(flown.table("replay", flown.series), output)


@dataclass(frozen=True)
class _Given:
    """Arguments of `replay`, except outputs."""

    raw: str
    models: tuple[str, ...]
    variants: tuple[str, ...]
    conditioning: str
    lead: float
    integrator: Literal["euler", "implicitfast", "implicit", "rk4"]
    timestep: float
    piece: float | None

    @property
    def parameters(self) -> dict[str, Any]:
        """Arguments of the command, by name, for the footers of the tables that it writes."""
        kept = ("conditioning", "lead", "integrator", "timestep", "piece")
        return {name: value for name in kept if (value := getattr(self, name)) is not None}


@dataclass(frozen=True)
class _Flown:
    """Time series and errors of all variants, with the origin of their tables.

    Attributes:
        series: Replay table.
        errors: Metrics table.
        parameters: Parameters for the footers of the tables.
        inputs: Recording and networks.
        vehicle_text: Text of the vehicle file.
    """

    series: pl.DataFrame
    errors: pl.DataFrame
    parameters: dict[str, Any]
    inputs: list[Artefact]
    vehicle_text: str

    def table(self, kind: str, frame: pl.DataFrame) -> Artefact:
        """Return a frame as a table with provenance: the recording, networks and arguments of these replays.

        Args:
            kind: Kind of the table.
            frame: The frame.
        """
        from hydro.io import table

        return table.make(
            kind,
            frame,
            stage="replay",
            parameters=self.parameters,
            inputs=self.inputs,
            vehicle_text=self.vehicle_text,
        )


def _flown(given: _Given, source: Artefact, file: Path | None) -> _Flown:
    """Read vehicle and models, and replay the recording with them."""
    from hydro.sim import replay as sim
    from hydro.sim.residual.conditioning import preset
    from hydro.sim.student import Physics

    known, text = vehicle_for(source, file)
    tell_voltage(known, source.frame)
    trained = [network(name) for name in given.models]
    networks = [model for _, model in trained]
    for name, model in zip(given.models, networks, strict=True):
        _require_same_effects(name, model, known)
    flown = sim.variants(networks, given.variants or None)
    physics = Physics(timestep=given.timestep, integrator=given.integrator)
    setup = sim.Setup(conditioning=preset(given.conditioning, known), lead=given.lead, physics=physics)
    with progress("replay") as update, about(given.raw):
        series, errors = sim.replay(
            known,
            source.frame,
            flown,
            setup=setup,
            dataset=dataset_name(given.raw),
            piece=given.piece,
            progress=lambda name, done, total: update(done, total, name),
        )
    parameters = {"variants": [one.name for one in flown]} | given.parameters
    return _Flown(series, errors, parameters, [source, *(artefact for artefact, _ in trained)], text)


def _show(errors: pl.DataFrame, given: _Given) -> None:
    """Print the errors, and the shares of steps in which conditioning acted."""
    from hydro.report.tables import conditioning_shares, piece_errors, replay_errors

    print_table(replay_errors(errors), REPLAY_TITLE)
    if given.piece is not None:
        print_table(piece_errors(errors), PIECE_TITLE)
    if given.conditioning != "off" and not (shares := conditioning_shares(errors)).is_empty():
        print_table(shares, CONDITIONING_TITLE.format(given.conditioning))


def _draw(series: pl.DataFrame, errors: pl.DataFrame, folder: Path) -> None:
    """Draw the velocities of every variant over the measured ones, and the errors as a heat map."""
    from hydro.report import figures
    from hydro.report.tables import replay_errors

    figures.save(figures.draw_overlay(figures.overlay_table(series)), folder / "velocities.png")
    figures.save(figures.draw_errors(replay_errors(errors)), folder / "errors.png")


def _require_same_effects(name: str, model: Model, known: Vehicle) -> None:
    """Refuse a model whose labels were computed with other effects than those of the replayed vehicle."""
    from hydro.io.vehicle import vehicle_hash

    if model.labelled is None or model.subtract != "effects":
        return
    if vehicle_hash(model.labelled) != vehicle_hash(known):
        raise DataError(
            f"{name}: the effects of another vehicle file were subtracted from its labels: add --vehicle "
            "with the file that the labels were made with"
        )


COMMANDS = {
    replay: "hydro replay datasets/stonefish/replay90.parquet --model model.parquet -o replay.parquet",
}
