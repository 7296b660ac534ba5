"""What the commands share: where bytes come from and go to, which vehicle is meant, tables for human eyes.

Binary never goes to a terminal; tables and progress never go into a pipe.
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
    from hydro.core.simulation.estimates import Estimates
    from hydro.core.simulation.sensor_noise import Noise
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.model import Model
    from hydro.io.table import Artefact
    from hydro.study.steps import Step

STREAM = "-"
PREDICTION_TITLE = "Predicted wrench, RMSE: X Y Z [N], K M N [N m]; RMSE, MAE over all six"
REGIME_TITLE = "Predicted wrench by regime of motion, RMSE over all six [N, N m]"
PIECE_TITLE = "The same by piece of the recording"
REPLAY_TITLE = "Open-loop replay, RMSE: u v w [m/s], p q r [rad/s]"
CONDITIONING_TITLE = (
    "Conditioning {}: shares of control steps with an axis clipped, with the dead band at work"
)

LONG = 30.0
"""Seconds from which on it is said how long something takes."""

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
    """The option `--seed`: what the seed is of, and the seeds that every generator takes."""
    return typer.Option(min=0, max=seeds.LARGEST, help=of)


VehicleFile = Annotated[
    Path | None,
    typer.Option("--vehicle", metavar="FILE", help="Vehicle file; default: the one in the data."),
]


def refuse_terminal(output: str) -> None:
    """Refuse, before any work is done, to write Parquet to a terminal.

    Raises:
        UsageError: stdout is both the destination and a terminal.
    """
    if shows_table(output):
        raise UsageError("an artefact is binary and stdout is a terminal: add -o FILE, or pipe it on")


def shows_table(output: str) -> bool:
    """Whether findings are for a person's eyes: no -o, and stdout is a terminal."""
    return output == STREAM and sys.stdout.isatty()


def read(source: str, *kinds: str) -> Artefact:
    """Read one artefact of one of `kinds` from a file or stdin; of any kind where none is named.

    Raises:
        DataError: the file is missing, broken, of another kind, or breaks its schema.
        UsageError: stdin is meant but is a terminal.
    """
    from hydro.io import table

    return table.read(sys.stdin.buffer if source == STREAM else source, kinds or None)


def network(source: str) -> tuple[Artefact, Model]:
    """Read a trained network, as its table and as what that describes.

    Raises:
        DataError: as for `read`, or its footer does not describe a network.
    """
    from hydro.io.model import from_artefact

    artefact = read(source, "model")
    with about(source):
        return artefact, from_artefact(artefact)


def write(artefact: Artefact, output: str) -> None:
    """Write an artefact to a file, whole or not at all, or to stdout."""
    from hydro.io import table

    table.write(artefact, sys.stdout.buffer if output == STREAM else output)


def vehicle_to_fit(file: Path, known: Sequence[str] | None, source: Artefact) -> tuple[Vehicle, str]:
    """A vehicle file with some effects held as known, and its text with them.

    Standard errors that lie beside the file are put into its tables. Those that come from the very recording
    which the vehicle is held against are left out: they are no second opinion on it.

    Raises:
        DataError: the file is invalid, or has nothing of a name.
    """
    from hydro.io import vehicle

    found, text = vehicle_held(file, known)
    return vehicle.without_errors_from(found, source.provenance.content), text


def vehicle_held(file: Path, known: Sequence[str] | None) -> tuple[Vehicle, str]:
    """The same with all standard errors, wherever they come from.

    Raises:
        DataError: the file is invalid, or has nothing of a name.
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
    """The covariance beside a vehicle file or a diagnosis; None, and a word, where it is of other values."""
    from hydro.io import covariance

    found, warning = covariance.read(file, vehicle)
    if warning:
        typer.echo(f"hydro: {warning}", err=True)
    return found


def vehicle_for(artefact: Artefact, file: Path | None) -> tuple[Vehicle, str]:
    """The vehicle and its file's text: `--vehicle` if given, else the one in the artefact's footer.

    Raises:
        DataError: neither says what the vehicle is, or the file is invalid.
    """
    return vehicle_or(artefact.provenance.vehicle if file is None else None, artefact.kind, file)


def vehicle_or(footer: str | None, kind: str, file: Path | None) -> tuple[Vehicle, str]:
    """The same by the text in the footer of a table of some kind, where it has one.

    Raises:
        DataError: neither says what the vehicle is, or the file is invalid.
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
    """Put the input's name before what the pure functions say of its data."""
    try:
        yield
    except DataError as error:
        raise DataError(f"{_name(source)}: {error}") from error


def _name(source: str) -> str:
    """What messages call an input."""
    return "stdin" if source == STREAM else source


def report_gaps(source: str, frame: pl.DataFrame) -> None:
    """Say in one line on stderr that an input has gaps in time; nothing where it has none."""
    from hydro.core.recording.segments import gaps

    report(source, gaps(frame))


def report(source: str, words: str) -> None:
    """Say something of an input in one line on stderr; nothing where there is nothing to say."""
    if words:
        message(f"hydro: {_name(source)}: {words}")


def tell_changes(source: str, changes: Sequence[str]) -> dict[str, list[str]]:
    """Say on stderr what was changed in a log, one line each, and return it for the footer of an artefact."""
    for line in changes:
        report(source, line)
    return {"cleaning": list(changes)} if changes else {}


def left_out(frame: pl.DataFrame) -> str:
    """How many rows of a labels table have no label; empty where all have one."""
    from hydro.core.distillation.labels import labelled

    missing = frame.height - labelled(frame).height
    return f"{missing:,} of {frame.height:,} rows have no label and are left out" if missing else ""


def noise_for(text: str) -> Noise:
    """The noise of a profile's name or of inline TOML.

    Raises:
        UsageError: it is neither.
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
    """What metrics call the data of an input: the file's name without its suffix."""
    return "stdin" if source == STREAM else Path(source).stem


@contextmanager
def progress(label: str, expected: float | None = None) -> Iterator[Callable[..., None]]:
    """Show a progress bar with the remaining time on stderr; nothing elsewhere.

    Args:
        label: What is being done.
        expected: How long it takes, about [s]; None where nothing is known beforehand.

    Yields:
        `update(done, total, text)`: how far the work is, and a few words next to the bar.
    """
    if not sys.stderr.isatty():
        yield lambda done, total, text="": None
        return
    from hydro.report.waiting import shown

    with shown(label, expected) as update:
        yield update


def message(text: str) -> None:
    """Print a line on stderr; a progress bar there moves below it, which Click would overwrite."""
    print(text, file=sys.stderr, flush=True)


def expected_seconds(vehicle: Vehicle, frame: pl.DataFrame, *, steps: bool = False) -> float:
    """Return how long a diagnosis takes, about [s].

    Args:
        vehicle: What is diagnosed.
        frame: The recording.
        steps: Whether it is the first of several, as in `explain`.
    """
    from hydro.core.effects.catalogue import own_effects
    from hydro.core.prediction.parameters import free
    from hydro.core.recording import extent
    from hydro.core.threads import available

    own = own_effects(vehicle)
    values = len(free(vehicle, own).entries) if own else 0
    seconds = extent.diagnosis_seconds(frame.height, values, available())
    return seconds * (extent.EXPLAINED if steps else 1.0)


def is_long(expected: float | None) -> bool:
    """Whether a person waits at a terminal for something that takes long."""
    return expected is not None and expected > LONG and sys.stderr.isatty()


def tell_duration(frame: pl.DataFrame, expected: float | None, *, steps: bool = False) -> None:
    """Print how long a long diagnosis takes, about.

    Args:
        frame: The recording.
        expected: How long it takes, about [s]; None where nothing is known.
        steps: Whether it is the first of several, as in `explain`.
    """
    if expected is None or not is_long(expected):
        return
    from hydro.core.recording import extent
    from hydro.core.threads import available

    what = "first step about" if steps else "about"
    processors = available()
    on = "one processor" if processors == 1 else f"{processors} processors"
    message(f"hydro: {frame.height:,} rows: {what} {extent.duration(expected)} on {on}, half to twice that")


def tell_provisional(expected: float | None) -> Callable[[Provisional], None] | None:
    """Return what prints the best candidate of a long diagnosis after its first fits; None of a short one.

    Args:
        expected: How long the diagnosis takes, about [s].
    """
    if not is_long(expected):
        return None

    def tell(best: Provisional) -> None:
        from hydro.core.diagnosis.status import in_words
        from hydro.report import words

        told = f"{words.effect_name(best.effect)} ({in_words(best.confidence)})"
        message(f"hydro: provisional: {told}, {words.percent(best.share)} of the explainable error")

    return tell


def here(root: Any) -> Callable[[Step], None]:
    """Run steps of a study in this process, by a Click command."""
    return lambda step: root.main(list(step.line), prog_name="hydro", standalone_mode=False)


def tell_not_shown(vehicle: Vehicle, frame: pl.DataFrame) -> None:
    """What a recording without some sensors cannot show, on stderr, before anything else is said."""
    from hydro.core.prediction.visibility import not_shown

    tell_voltage(vehicle, frame)
    for line in not_shown(vehicle, frame):
        typer.echo(f"hydro: {line}", err=True)


def tell_voltage(vehicle: Vehicle, frame: pl.DataFrame) -> None:
    """That a recording lacks the supply voltage which a vehicle's thrust curves ask for, on stderr."""
    from hydro.core.recording.supply import unknown_voltage

    if words := unknown_voltage(vehicle, frame):
        typer.echo(f"hydro: {words}", err=True)
