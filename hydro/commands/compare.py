"""`compare`: how far a vehicle file is from a recording, and where."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.shell import (
    STREAM,
    Measured,
    ModelFile,
    Output,
    about,
    person,
    print_table,
    progress,
    read,
    shows_table,
    tell_not_shown,
    write,
)
from hydro.core.errors import DataError

if TYPE_CHECKING:
    import polars as pl

    from hydro.io.table import Artefact


def compare(
    vehicle: ModelFile,
    measured: Measured = STREAM,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="COMPARISON",
            help="An earlier comparison with the same recording: its errors are shown beside the new ones, "
            "and its places are looked at again.",
        ),
    ] = None,
    output: Output = STREAM,
) -> None:
    """Compare a vehicle file with a recording: how large are its errors, and where do they lie?

    Two kinds of error, each beside what sensor noise alone would cause: the force that the model leaves
    unexplained, and the motion predicted 1, 5 and 20 s ahead from restarts all along the recording, and over
    each whole session. Then the regimes of motion in which the model fails, with their share of the
    unexplained error. They are printed on the terminal, on stderr where stdout is a pipe.
    """
    from hydro.core import effects
    from hydro.core.evaluation.compare import compare as compute
    from hydro.io import table
    from hydro.io import vehicle as vehicles

    known, text = vehicles.read(vehicle)
    with about(str(vehicle)):
        effects.validate(known)
    source = read(measured, "raw")
    earlier = None if against is None else _earlier(against, source)
    with about(measured):
        tell_not_shown(known, source.frame)
    with about(measured), progress("compare") as update:
        frame = compute(
            known,
            source.frame,
            against=None if earlier is None else earlier.frame,
            progress=lambda words, share: update(round(100 * share), 100, words),
        )
    _print(frame)
    if shows_table(output):
        return
    inputs = [source] if earlier is None else [source, earlier]
    write(table.make("comparison", frame, stage="compare", inputs=inputs, vehicle_text=text), output)


def _earlier(against: str, source: Artefact) -> Artefact:
    """The earlier comparison.

    Raises:
        DataError: it is of another recording.
    """
    earlier = read(against, "comparison")
    recordings = {one.content for one in earlier.provenance.inputs if one.kind == "raw"}
    if source.provenance.content not in recordings:
        raise DataError(
            f"{against}: a comparison with another recording; name one that was made with this recording"
        )
    return earlier


def _print(frame: pl.DataFrame) -> None:
    """The comparison for a person."""
    from hydro.report import comparison, yardsticks

    console = person()
    forces = comparison.forces(frame)
    if forces.is_empty():
        console.print("No velocity was measured: the force that the model leaves out is not shown.")
    else:
        title = "Force that the model leaves out: root mean square, 95 % interval"
        print_table(forces, title, console)
    beside = "" if "before" in frame.columns else " (noise alone)"
    title = f"Errors of its predictions: root mean square{beside}"
    print_table(comparison.predictions(frame), title, console)
    simple = yardsticks.of_comparison(frame)
    if not simple.is_empty():
        title = (
            f"The model beside simple predictors, {yardsticks.ahead(simple)}: least squares of the same data"
        )
        print_table(yardsticks.table(simple), title, console)
    ranked, former = comparison.failures(frame), comparison.former_failures(frame)
    if not ranked.is_empty():
        print_table(ranked, "Where it fails: share of the unexplained error and of the time", console)
    if not former.is_empty():
        print_table(former, "Where it failed before", console)
    console.print(f"\n{comparison.headline(frame)}")
    if told := yardsticks.sentence(simple):
        console.print(told)


COMMANDS = {
    compare: "hydro compare datasets/stonefish/vehicle.toml datasets/stonefish/replay90.parquet "
    "-o comparison.parquet",
}
