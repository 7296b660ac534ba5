"""Functions that commands share: inputs and outputs, the vehicle file, messages and progress.

Binary data never go to a terminal; readable tables and progress never go into a pipe.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.core import seeds
from hydro.core.errors import DataError, UsageError

if TYPE_CHECKING:
    import polars as pl

    from hydro.core.diagnosis.provisional import Provisional
    from hydro.core.recording.extent import Expected
    from hydro.core.simulation.estimates import Estimates
    from hydro.core.simulation.sensor_noise import Noise
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.model import Model
    from hydro.io.table import Artefact
    from hydro.study.steps import Step

STREAM = "-"
PREDICTION_TITLE = "Predicted wrench, RMSE: X Y Z [N], K M N [N m]; RMSE, MAE over all six"
REGIME_TITLE = "Predicted wrench by regime of motion, RMSE over all six [N, N m]"
PIECE_TITLE = "Errors by piece of the recording"
REPLAY_TITLE = "Open-loop replay, RMSE: u v w [m/s], p q r [rad/s]"
CONDITIONING_TITLE = (
    "Conditioning {}: shares of control steps with an axis clipped, with the dead band at work"
)

LONG = 20.0
"""Minimum expected duration of work for which an estimate is printed [s]."""

ModelFile = Annotated[Path, typer.Argument(metavar="VEHICLE", show_default=False, help="Vehicle file.")]
NoiseSpec = Annotated[
    str | None,
    typer.Option(
        "--noise",
        metavar="SPEC",
        help="Velocity noise: none, ordinary, dvl or '{velocity=0.02, rate=0.003}'; default: from the data.",
    ),
]
Known = Annotated[
    list[str] | None,
    typer.Option(
        "--known",
        metavar="NAME",
        show_default=False,
        help="Effect, or EFFECT.PARAMETER, to keep at the file's value.",
    ),
]
Device = Annotated[Literal["cpu", "cuda"], typer.Option(help="Where to train.")]


def seed_option(of: str) -> Any:
    """Return a Typer option for a seed, limited to seeds that every generator takes.

    Args:
        of: Help of the option: what the seed is for.
    """
    return typer.Option(min=0, max=seeds.LARGEST, help=of)


VehicleFile = Annotated[
    Path | None,
    typer.Option("--vehicle", metavar="FILE", help="Vehicle file; default: the one in the data."),
]


def refuse_terminal(output: str) -> None:
    """Raise an error if a command would write Parquet to a terminal; called before any work is done.

    Args:
        output: Destination; `-` is stdout.

    Raises:
        UsageError: stdout is both the destination and a terminal.
    """
    if shows_table(output):
        raise UsageError("an artefact is binary and stdout is a terminal: add -o FILE, or pipe it on")


def shows_table(output: str) -> bool:
    """Return whether a readable table is printed: there is no -o, and stdout is a terminal.

    Args:
        output: Value of -o; `-`, the default, is stdout.
    """
    return output == STREAM and sys.stdout.isatty()


def read(source: str, *kinds: str) -> Artefact:
    """Return one artefact, a table with provenance, read from a file or stdin.

    Args:
        source: Path; `-` is stdin.
        kinds: Accepted kinds of table; by default any.

    Raises:
        DataError: The file is missing, broken, of another kind, or violates its schema.
        UsageError: stdin is requested but is a terminal.
    """
    from hydro.io import table

    return table.read(sys.stdin.buffer if source == STREAM else source, kinds or None)


def network(source: str) -> tuple[Artefact, Model]:
    """Return a trained network, read from a file or stdin: its table with provenance, and the model.

    Args:
        source: Path; `-` is stdin.

    Raises:
        DataError: The file is missing, broken, of another kind, or its footer does not describe a network.
        UsageError: stdin is requested but is a terminal.
    """
    from hydro.io.model import from_artefact

    artefact = read(source, "model")
    with about(source):
        return artefact, from_artefact(artefact)


def write(artefact: Artefact, output: str) -> None:
    """Write an artefact (a table with provenance) to a file, atomically, or to stdout.

    Args:
        artefact: The artefact.
        output: Path; `-` is stdout.
    """
    from hydro.io import table

    table.write(artefact, sys.stdout.buffer if output == STREAM else output)


def vehicle_to_fit(file: Path, known: Sequence[str] | None, source: Artefact) -> tuple[Vehicle, str]:
    """Return the vehicle of a file, some effects marked as known, and the file's text with these marks.

    Standard errors from the covariance file are put into the vehicle's effect tables.  Errors that were
    estimated from the recording `source` are left out, because they are not independent of it.

    Args:
        file: Vehicle file.
        known: Names of the effects to mark, or of parameters as `effect.parameter`; None for none.
        source: Recording that is fitted.

    Raises:
        DataError: the file is invalid, or has no effect or parameter of a name.
    """
    from hydro.io import vehicle

    found, text = vehicle_held(file, known)
    return vehicle.without_errors_from(found, source.provenance.content), text


def vehicle_held(file: Path, known: Sequence[str] | None) -> tuple[Vehicle, str]:
    """Return the vehicle of a file, some effects marked as known, and the file's text with these marks.

    Standard errors from the covariance file are put into the vehicle's effect tables, whatever recording they
    are from.

    Args:
        file: Vehicle file.
        known: Names of the effects to mark, or of parameters as `effect.parameter`; None for none.

    Raises:
        DataError: the file is invalid, or has no effect or parameter of a name.
    """
    from hydro.core import effects
    from hydro.io import covariance, vehicle

    found, text = vehicle.read(file)
    estimates = estimates_beside(file, found)
    with about(str(file)):
        text = vehicle.hold_known(text, known or ())
        found = vehicle.parse(text)
        effects.validate(found)
    if estimates is not None:
        found = covariance.with_errors(found, estimates)
    return found, text


def estimates_beside(file: str | Path, vehicle: Vehicle | None = None) -> Estimates | None:
    """Return the values and covariance stored next to a vehicle file or a diagnosis.

    A covariance of other values than those of the vehicle causes a warning.

    Args:
        file: The vehicle file or diagnosis.
        vehicle: Vehicle of the file, whose values the covariance must match; None for no check.

    Returns:
        The estimates; None if the covariance is missing or does not match.
    """
    from hydro.io import covariance

    found, warning = covariance.read(file, vehicle)
    if warning:
        typer.echo(f"hydro: {warning}", err=True)
    return found


def vehicle_for(artefact: Artefact, file: Path | None) -> tuple[Vehicle, str]:
    """Return the vehicle and the text of its file: `--vehicle` if given, else that in the table's footer.

    Args:
        artefact: Table with provenance in its footer.
        file: Path of `--vehicle`; None if not given.

    Raises:
        DataError: neither the option nor the footer has a vehicle, or the file is invalid.
    """
    return vehicle_or(artefact.provenance.vehicle if file is None else None, artefact.kind, file)


def vehicle_or(footer: str | None, kind: str, file: Path | None) -> tuple[Vehicle, str]:
    """Return the vehicle and the text of its file: from a path if given, else from the footer of a table.

    Args:
        footer: Text of the vehicle file in the footer; None without one.
        kind: Kind of the table, for the message.
        file: Path of the vehicle file; None if not given.

    Raises:
        DataError: neither is given, or the vehicle is invalid.
    """
    from hydro.core import effects
    from hydro.io import vehicle

    if file is not None:
        known, text = vehicle.read(file)
    elif footer:
        text = footer
        known = vehicle.parse(text)
        vehicle.warn(known, text, "the vehicle in the footer")
    else:
        raise DataError(f"this {kind} table carries no vehicle in its footer: add --vehicle FILE")
    effects.validate(known)
    return known, text


@contextmanager
def about(source: str) -> Iterator[None]:
    """Put the name of an input in front of every `DataError` that a `with` block raises.

    Args:
        source: Path of the input; `-` is stdin.
    """
    try:
        yield
    except DataError as error:
        raise DataError(f"{_name(source)}: {error}") from error


def _name(source: str) -> str:
    """Return the name of an input in messages."""
    return "stdin" if source == STREAM else source


def report_gaps(source: str, frame: pl.DataFrame) -> None:
    """Print one line on stderr if a recording has gaps in time.

    Args:
        source: Path of the recording; `-` is stdin.
        frame: Table of the recording.
    """
    from hydro.core.recording.segments import gaps

    report(source, gaps(frame))


def report(source: str, words: str) -> None:
    """Print a remark on an input on stderr; print nothing if the remark is empty.

    Args:
        source: Path of the input; `-` is stdin.
        words: The remark.
    """
    if words:
        message(f"hydro: {_name(source)}: {words}")


def tell_changes(source: str, changes: Sequence[str]) -> dict[str, list[str]]:
    """Print the changes made to a log on stderr, and return them for the footer of an artefact.

    Args:
        source: Name of the log.
        changes: The changes, one line each.

    Returns:
        A dict with the changes as its one entry `cleaning`; empty without changes.
    """
    for line in changes:
        report(source, line)
    return {"cleaning": list(changes)} if changes else {}


def left_out(frame: pl.DataFrame) -> str:
    """Return a remark on the number of rows of a table without a label; empty if all rows have one.

    Args:
        frame: Labels or split table.
    """
    from hydro.core.distillation.labels import labelled

    missing = frame.height - labelled(frame).height
    return f"{missing:,} of {frame.height:,} rows have no label and are left out" if missing else ""


def noise_for(text: str) -> Noise:
    """Return sensor noise from the name of a profile or from inline TOML.

    Raises:
        UsageError: The text is neither.
    """
    from dataclasses import fields

    from hydro.core import toml_text
    from hydro.core.simulation.sensor_noise import PROFILES, Noise

    if text in PROFILES:
        return PROFILES[text]
    try:
        given = toml_text.value(text)
    except DataError:
        given = None
    if not isinstance(given, dict) or given.keys() - {one.name for one in fields(Noise)}:
        raise UsageError(
            f"--noise {text!r:.80}: neither a profile ({', '.join(PROFILES)}) nor a table of velocity, rate, "
            "position and attitude like '{velocity=0.02, rate=0.003}'"
        )
    try:
        return Noise(**given)
    except (DataError, TypeError) as error:
        raise UsageError(f"--noise {text!r:.80}: {error}") from None


def dataset_name(source: str) -> str:
    """Return the name of a data set in metrics: the name of the file without its suffix."""
    return "stdin" if source == STREAM else Path(source).stem


@contextmanager
def progress(label: str, expected: Expected | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar with the remaining time during a `with` block, if stderr is a terminal.

    Args:
        label: Name of the work.
        expected: Range of the work's duration [s]; None where nothing is known beforehand.

    Yields:
        `update(done, total, text)`, a function that sets the progress and a short text next to the bar.
    """
    if not sys.stderr.isatty():
        yield lambda done, total, text="": None
        return
    from hydro.report.waiting import shown

    with shown(label, None if expected is None else expected.middle) as update:
        yield update


def message(text: str) -> None:
    """Print a line on stderr, above a progress bar, which Click would overwrite."""
    print(text, file=sys.stderr, flush=True)


def expected_seconds(frame: pl.DataFrame, *, steps: bool = False) -> Expected:
    """Return the expected range of the duration of a diagnosis [s].

    Args:
        frame: The recording.
        steps: Whether the diagnosis is the first of several, as in `explain`.
    """
    from hydro.core.recording import extent
    from hydro.core.threads import available

    found = extent.diagnosis_seconds(frame.height, available())
    return found.times(extent.EXPLAINED) if steps else found


def is_long(expected: Expected | None) -> bool:
    """Return whether work is expected to be long and stderr is a terminal, so that messages help.

    Args:
        expected: Expected range of the work's duration; None if unknown.
    """
    return expected is not None and expected.middle > LONG and sys.stderr.isatty()


def tell_duration(frame: pl.DataFrame, expected: Expected | None, *, steps: bool = False) -> None:
    """Print the expected range of the duration of a long diagnosis on stderr.

    Args:
        frame: The recording.
        expected: The range [s]; None where nothing is known.
        steps: Whether the diagnosis is the first of several, as in `explain`.
    """
    if expected is None or not is_long(expected):
        return
    from hydro.core.threads import available

    what = "first step " if steps else ""
    processors = available()
    on = "one processor" if processors == 1 else f"{processors} processors"
    message(f"hydro: {frame.height:,} rows: {what}{expected} on {on}, longer the more is missing")


def tell_provisional(
    expected: Expected | None, *, of_change: bool = False
) -> Callable[[Provisional], None] | None:
    """Return a function that prints the provisional best candidate of a long diagnosis.

    Args:
        expected: Range of the duration of the diagnosis [s]; None where nothing is known.
        of_change: Whether a recording from before a change is given; such a diagnosis is always long.

    Returns:
        The function; None for a short diagnosis, and where stderr is not a terminal.
    """
    if not (is_long(expected) or (of_change and sys.stderr.isatty())):
        return None

    def tell(best: Provisional) -> None:
        from hydro.core.diagnosis.status import in_words
        from hydro.report import words

        told = f"{words.effect_name(best.effect)} ({in_words(best.confidence)})"
        message(f"hydro: provisional: {told}, removes {words.percent(best.share)} of the squared error")

    return tell


def here(root: Any) -> Callable[[Step], None]:
    """Return a function that runs a step of a study, which is a command of hydro, in this process.

    Args:
        root: Root command group of hydro, which runs the step's command line.
    """
    return lambda step: root.main(list(step.line), prog_name="hydro", standalone_mode=False)


def tell_not_shown(vehicle: Vehicle, frame: pl.DataFrame) -> None:
    """Print on stderr which effects a recording cannot show because sensors are missing."""
    from hydro.core.prediction.visibility import not_shown

    tell_voltage(vehicle, frame)
    for line in not_shown(vehicle, frame):
        typer.echo(f"hydro: {line}", err=True)


def tell_voltage(vehicle: Vehicle, frame: pl.DataFrame) -> None:
    """Print a line on stderr if a recording lacks the supply voltage that the thrust curves need."""
    from hydro.core.recording.supply import unknown_voltage

    if words := unknown_voltage(vehicle, frame):
        typer.echo(f"hydro: {words}", err=True)
