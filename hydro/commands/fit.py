"""Command `fit`: estimate the parameters of named effects, and write them into a vehicle file."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.places import Output
from hydro.commands.recordings import Definitions, Logs, MapFile, MaxExpanded, Measured, called
from hydro.commands.shell import STREAM, Known, about, noise_for, progress, tell_voltage, vehicle_to_fit
from hydro.core.effects import examples
from hydro.core.errors import DataError, UsageError

if TYPE_CHECKING:
    from hydro.core.identification.outcome import Fit
    from hydro.io.table import Artefact


Method = Annotated[
    Literal["output", "equation"],
    typer.Option(
        help="Output error: predictions over shots of two seconds compared with the log. Equation error: "
        "the force balance along the smoothed motion, quicker, but biased by noise."
    ),
]
Noise = Annotated[
    str | None,
    typer.Option(
        metavar="SPEC",
        help="Sensor noise, as in `hydro collect`: ordinary, dvl, or 1-sigma values "
        "'{velocity=0.02, rate=0.003, position=0.05, attitude=0.002}'; by default found from the data.",
    ),
]
Shots = Annotated[
    int,
    typer.Option(
        min=8,
        help="Maximum number of fitted shots of 2 s.",
    ),
]


def fit(
    vehicle: Annotated[Path, typer.Argument(metavar="VEHICLE", help="Vehicle file to start from.")],
    measured: Measured = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT",
            help=f"Effect to fit, also with initial values: '{examples.TO_FIT_FROM}'.",
        ),
    ] = None,
    known: Known = None,
    method: Method = "output",
    noise: Noise = None,
    shots: Shots = 1000,
    map_: MapFile = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    r"""Fit chosen effects to a recording and write the vehicle file.

    An effect of the file is re-estimated from its values; any other is added. The values get standard errors
    and the hash of the recording. A warning names parameters that the recording does not determine, and the
    motion that would. What is `known` is not re-estimated.

        hydro fit vehicle.toml raw.parquet --effect quadratic_damping \
          -o vehicle-1.toml

    Details:

    Name effects as `hydro effects` does, with .matrix or the like if they have several forms. Everything else
    in the file stays, comments too. A parameter that the data do not determine stays near its initial value.
    A standard error of a value in the file makes that value another estimate, unless it comes from this very
    recording. A line on stderr names values that contradict the file or are not plausible. A log with
    reversed or exchanged columns, or with degrees, is refused. Outliers count less if a sensor has heavy
    tails.

    The covariance is written next to the file that -o names: vehicle.covariance.parquet for vehicle.toml.
    Later fits and hydro simulate --bands read it.
    """
    import numpy as np

    from hydro.core.identification.fit import fit as compute
    from hydro.core.recording.arrays import LEAST_NOISE
    from hydro.io import vehicle as vehicles

    if not effect:
        raise UsageError(f"fit: name what to fit, such as --effect {examples.TO_FIT}; see hydro effects")
    wanted = [_wanted(text) for text in effect]
    sigma = None if noise is None else np.maximum(noise_for(noise).deviations, LEAST_NOISE)
    _, text = vehicles.read(vehicle)
    name, source = called(measured), Logs(map_, msg, vehicle).read(measured)
    start, _ = vehicle_to_fit(vehicle, known, source)
    tell_voltage(start, source.frame)
    with about(name), progress("fit") as update:
        found = compute(
            start,
            source.frame,
            wanted,
            method=method,
            noise=sigma,
            most=shots,
            progress=lambda words, share: update(round(100 * share), 100, words),
        )
    if found.share < 1.0:
        typer.echo(
            f"hydro: {shots} shots cover {100 * found.share:.0f} % of the recording; more with --shots",
            err=True,
        )
    _tell(found)
    origin = {"data": source.provenance.content, "method": method, "chi2": round(found.chi2, 4)}
    for table in found.tables():
        text = vehicles.set_effect(text, table | {"fit": origin})
    if output == STREAM:
        vehicles.parse(text)
        sys.stdout.write(text)
    else:
        _write(found, text, vehicle, output, source)


def _write(found: Fit, text: str, start: Path, output: str, source: Artefact) -> None:
    """Write the vehicle file, and next to it the covariance of its values.

    Args:
        found: The fit.
        text: Text of the file with the fitted values.
        start: The initial file, whose other effects keep their covariance.
        output: Output file.
        source: The recording.
    """
    from hydro.io import covariance
    from hydro.io import vehicle as vehicles

    earlier, _ = covariance.read(start, vehicles.read(start)[0])
    vehicles.write(text, output)
    covariance.write(
        found.estimates().after(earlier),
        output,
        stage="fit",
        inputs=[source],
        vehicle_text=text,
        parameters={"cleaning": list(found.changes)} if found.changes else None,
    )


def _tell(found: Fit) -> None:
    """Print the parameters on a terminal, and warnings on stderr."""
    if sys.stderr.isatty():
        _show(found)
    for warning in found.warnings:
        typer.echo(f"hydro: {warning}", err=True)


def _wanted(text: str) -> str | dict[str, Any]:
    """Return an effect's name, or its table from `NAME={...}` with inline TOML.

    Raises:
        UsageError: The text has neither form.
    """
    from hydro.core import toml_text

    if "=" not in text:
        return text
    name, _, values = text.partition("=")
    try:
        table = toml_text.value(values)
    except DataError:
        table = None
    if not isinstance(table, dict):
        raise UsageError(f"--effect {text!r:.80}: not a name, nor a table like '{examples.TO_FIT_FROM}'")
    return {**table, "name": name.strip()}


def _show(found: Fit) -> None:
    """Print the parameters with their standard errors."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    title = f"Fitted by {found.method} error; mean squared residual {found.chi2:.3g} (1: noise alone)"
    shown = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False)
    for name, justify in (("parameter", "left"), ("value", "right"), ("±", "right"), ("", "left")):
        shown.add_column(name, justify=justify, no_wrap=bool(name))  # type: ignore[arg-type]
    for name, value, error, unit, determined in found.frame().iter_rows():
        remark = unit if unit != "1" else ""
        shown.add_row(
            name, f"{value:.4g}", f"{error:.2g}", remark if determined else f"{remark}  not determined"
        )
    Console(stderr=True).print(shown)


COMMANDS = {
    fit: "hydro fit datasets/stonefish/vehicle.toml datasets/stonefish/sample.parquet "
    f"--effect {examples.TO_FIT} -o vehicle2.toml",
}
