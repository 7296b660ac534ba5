"""Commands `simulate` and `effects`: simulation of a vehicle file, and the catalogue of effects."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hydro.commands.places import Output
from hydro.commands.recordings import Definitions, Logs, MapFile, MaxExpanded, called
from hydro.commands.shell import (
    STREAM,
    about,
    progress,
    refuse_terminal,
    report,
    seed_option,
    tell_voltage,
    write,
)
from hydro.commands.tables import person, print_table
from hydro.core import seeds
from hydro.core.effects import examples
from hydro.core.errors import DataError, UsageError

if TYPE_CHECKING:
    from hydro.core.effects import Effect
    from hydro.io.table import Artefact


def simulate(
    vehicle: Annotated[Path, typer.Argument(metavar="VEHICLE", show_default=False, help="Vehicle file.")],
    commands: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="COMMANDS...",
            show_default=False,
            help="Commands or raw table, or logs with --map; - is stdin.",
        ),
    ] = None,
    bands: Annotated[
        bool,
        typer.Option("--bands", help="Write 95 % bands of the prediction."),
    ] = False,
    draws: Annotated[int, typer.Option(min=40, help="Vehicles drawn for the bands.")] = 100,
    seed: Annotated[int, seed_option("Seed of the draws.")] = 0,
    sea: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=seeds.LARGEST,
            show_default=False,
            help="Draw waves from this seed; default: calm sea.",
        ),
    ] = None,
    map_: MapFile = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    """Simulate a vehicle under given thruster commands.

    A commands table starts each session at rest at the origin. A raw table starts each session, and restarts
    after each gap, from the state of its row. The result is a raw table without noise. --bands adds 95 %
    bands of the prediction from the covariance of the vehicle file.

        hydro simulate vehicle.toml commands.parquet --bands -o bands.parquet

    Details:

    Every effect of the file acts; Runge-Kutta steps at 500 Hz integrate the motion. The recording carries the
    vehicle file, so that no later command needs --vehicle. Predictions have a calm sea; --sea draws waves
    from the spectrum of the file, for each session again.

    For --bands, parameters are drawn from vehicle.covariance.parquet, which hydro fit, add and explain write
    next to vehicle.toml, and every draw is simulated. The table then has the predicted motion and the band of
    every pose and velocity. A band contains the uncertainty of the parameters, but neither sensor noise nor
    model error.
    """
    from hydro.core.recording.extent import above_surface
    from hydro.core.simulation.simulate import simulate as move
    from hydro.io import table
    from hydro.io import vehicle as vehicles

    refuse_terminal(output)
    known, text = vehicles.read(vehicle)
    name = called(commands)
    source = Logs(map_, msg, vehicle).read(commands, "commands", "raw")
    tell_voltage(known, source.frame)
    if bands and sea is not None:
        raise UsageError("--sea draws one sea, and --bands many vehicles in a calm one: give one of the two")
    if bands:
        write(_bands(vehicle, source, name, draws, seed), output)
        return
    with about(name):
        frame = move(known, source.frame, sea=sea)
    report(name, above_surface(frame))
    made = table.make("raw", frame, stage="simulate", seed=sea, inputs=[source], vehicle_text=text)
    write(made, output)


def _bands(vehicle: Path, source: Artefact, name: str, draws: int, seed: int) -> Artefact:
    """Return 95 % bands of the prediction of a vehicle file.

    Raises:
        DataError: The file has no covariance.
    """
    from hydro.core.simulation.bands import bands
    from hydro.io import covariance, table
    from hydro.io import vehicle as vehicles

    known, text = vehicles.read(vehicle)
    estimates, warning = covariance.read(vehicle, known)
    if estimates is None:
        place = covariance.beside(vehicle)
        why = warning or f"{place}: no such file"
        raise DataError(f"{why}; bands need the covariance that `hydro fit -o`, add or explain write")
    with about(name), progress("bands") as update:
        frame = bands(
            known,
            estimates,
            source.frame,
            draws=draws,
            seed=seed,
            progress=lambda words, share: update(round(100 * share), 100, words),
        )
    inputs = [source, table.read(covariance.beside(vehicle), covariance.KIND)]
    parameters = {"draws": draws}
    return table.make(
        "bands", frame, stage="simulate", parameters=parameters, seed=seed, inputs=inputs, vehicle_text=text
    )


def effects(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", show_default=False, help="One effect; all by default.")
    ] = None,
) -> None:
    """List the physical effects that a vehicle file can hold.

    With a name, all about that effect: its meaning, its parameters with units and bounds, the motion that
    determines them, effects that it is often confused with, its source, and a table for a vehicle file. On a
    terminal as tables, into a pipe as JSON.
    """
    from hydro.core.effects import CATALOGUE
    from hydro.core.effects.describe import describe

    chosen = _effect(name) if name is not None else None
    if not sys.stdout.isatty():
        import msgspec

        shown = describe(chosen) if chosen else [describe(effect) for effect in CATALOGUE.values()]
        typer.echo(msgspec.json.format(msgspec.json.encode(shown), indent=2).decode())
    elif chosen is None:
        _print_catalogue()
    else:
        _print_effect(chosen)


def _effect(name: str) -> Effect:
    """Return the effect of a name.

    Raises:
        UsageError: The catalogue does not have it.
    """
    import difflib

    from hydro.core.effects import CATALOGUE

    if name not in CATALOGUE:
        near = difflib.get_close_matches(name, CATALOGUE, 1)
        hint = f"did you mean {near[0]}?" if near else "`hydro effects` lists all"
        raise UsageError(f"no effect is called {name!r}: {hint}")
    return CATALOGUE[name]


def _print_catalogue() -> None:
    """Print one line per effect."""
    import polars as pl

    from hydro.core.effects import CATALOGUE

    rows = [
        (
            effect.name,
            effect.kind,
            effect.family,
            effect.definition,
            " ".join(parameter.name for parameter in effect.parameters),
        )
        for effect in CATALOGUE.values()
    ]
    print_table(pl.DataFrame(rows, ["name", "kind", "family", "definition", "parameters"], orient="row"), "")


def _print_effect(effect: Effect) -> None:
    """Print one effect in full."""
    import polars as pl

    from hydro.core.effects import describe

    console = person()
    console.print(
        f"{effect.name} ({effect.kind}, {effect.family}): {effect.definition}\n\n{effect.description}"
    )
    parameters: list[dict[str, Any]] = [
        {
            "parameter": parameter.name,
            "unit": describe.unit(parameter),
            "numbers": describe.size(parameter),
            "bounds": describe.bounds(parameter),
            "plausible": describe.plausible(parameter),
            "if left out": describe.when_left_out(effect, parameter),
            "meaning": parameter.meaning,
        }
        for parameter in effect.parameters
    ]
    print_table(pl.DataFrame(parameters), "")
    sources = dict.fromkeys(one.plausible.source for one in effect.parameters if one.plausible)
    console.print(f"\nplausible by: {'; '.join(sources)}")
    console.print(f"needs: {effect.excitation}")
    console.print(f"easily mistaken for: {', '.join(effect.lookalikes)}")
    console.print(f"source: {effect.source}\n\nin a vehicle file (0: without effect):\n")
    typer.echo(describe.toml(effect), nl=False)


COMMANDS = {
    simulate: "hydro simulate datasets/stonefish/vehicle.toml datasets/stonefish/replay90.parquet "
    "-o simulated.parquet",
    effects: f"hydro effects {examples.TO_LOOK_UP}",
}
