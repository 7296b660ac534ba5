"""Command `compare`: prediction errors of a vehicle file, and the regimes in which it fails."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.answers import AsText, Details, Printing, called_with, print_lines
from hydro.commands.as_json import Json, print_json
from hydro.commands.before import Before, Network, learnt
from hydro.commands.places import Output
from hydro.commands.recordings import Definitions, Logs, MapFile, MaxExpanded, Measured, called
from hydro.commands.shell import (
    STREAM,
    ModelFile,
    about,
    progress,
    read,
    report,
    tell_changes,
    tell_not_shown,
    write,
)
from hydro.commands.tables import print_table
from hydro.core.errors import DataError

if TYPE_CHECKING:
    import polars as pl
    from rich.console import Console

    from hydro.commands.before import Earlier
    from hydro.io.table import Artefact
    from hydro.report.following import Call


def compare(
    vehicle: ModelFile,
    measured: Measured = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="COMPARISON",
            show_default=False,
            help="Earlier comparison with the same recording.",
        ),
    ] = None,
    before: Before = None,
    model: Network = None,
    map_: MapFile = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    details: Details = False,
    as_text: AsText = False,
    as_json: Json = False,
    output: Output = STREAM,
) -> None:
    """Measure how well a vehicle file predicts a recording.

    Predictions start all along the recording. The answer has their errors 5 s ahead, the errors that sensor
    noise alone causes (the noise floor), the errors of two simple predictors, and the regimes of motion
    where the model fails most. Add --details for errors at 1 s, 20 s and over whole sessions, and for the
    force that the model does not explain.

        hydro compare vehicle.toml raw.parquet
        hydro compare vehicle.toml after.parquet --before before.parquet

    With --before the second command compares with a hull-force model, which is fitted to the recording before
    a change. An error above the floor means a change, or motion that the first recording does not have.

    Details:

    With --before the answer has a table of errors by axis: of the file alone, before and after, and of the
    file with the hull-force model, before (the floor) and after. The floor is measured on parts of the first
    recording that the model was not fitted to. hydro diagnose --before names what has changed.

    With --against an earlier comparison gives the weights of the axes. Its errors are shown with the new
    ones, and its regimes are evaluated again.

    Errors are those of the cleaned recording, as for diagnose, explain and fit. Impossible readings, the bias
    of a gyro, columns in another frame or unit and exchanged command columns are corrected or left out. Each
    change is one line on stderr and an entry in the footer of the comparison.

    On a terminal the answer goes to stdout. In a pipe stdout has the table, and stderr the headline.
    """
    from hydro.core import effects
    from hydro.core.cleaning.readiness import unready
    from hydro.core.diagnosis.log_faults import preprocess
    from hydro.core.evaluation.compare import compare as compute
    from hydro.core.explanation.with_hull import with_hull
    from hydro.io import table
    from hydro.io import vehicle as vehicles

    printing = Printing(output, as_text, as_json)
    known, text = vehicles.read(vehicle)
    with about(str(vehicle)):
        effects.validate(known)
    logs, name = Logs(map_, msg, vehicle), called(measured)
    source = logs.read(measured)
    former = None if against is None else _former(against, source)
    with about(name):
        tell_not_shown(known, source.frame)
    earlier = learnt(before, model, known, source, logs)
    with about(name), progress("compare") as update:
        log = preprocess(known, source.frame, earlier.hull if earlier else None)
        frame = compute(
            known,
            log.raw,
            record=log.observed,
            against=None if former is None else former.frame,
            progress=lambda words, share: update(round(100 * share), 100, words),
        )
        if earlier is not None:
            frame = with_hull(frame, known, log, earlier.hull)
    changes = tell_changes(name, log.changes)
    report(name, unready(log.observed))
    call = called_with(vehicle, measured, output, before=before, model=model, map_=map_, msg=msg)
    _print(frame, earlier, call, printing, details)
    if as_json:
        print_json(comparison=frame)
    if not printing.saves:
        return
    inputs = [source, *([former] if former else []), *(earlier.inputs if earlier else ())]
    parameters = (earlier.parameters if earlier else {}) | changes
    made = table.make(
        "comparison", frame, stage="compare", parameters=parameters, inputs=inputs, vehicle_text=text
    )
    write(made, output)


def _former(against: str, source: Artefact) -> Artefact:
    """Read the earlier comparison of --against.

    Raises:
        DataError: The comparison is of another recording than `source`.
    """
    earlier = read(against, "comparison")
    # The first recording is the one that was compared with, another the one of --before.
    recordings = [one.content for one in earlier.provenance.inputs if one.kind == "raw"]
    if source.provenance.content not in recordings[:1]:
        raise DataError(
            f"{against}: a comparison with another recording; name one that was made with this recording"
        )
    return earlier


def _print(
    frame: pl.DataFrame, earlier: Earlier | None, call: Call, printing: Printing, details: bool
) -> None:
    """Print the answer, or only its headline if the table goes into a pipe."""
    from hydro.report import change, comparison

    learned = "" if earlier is None else change.learnt(earlier.parameters[change.PARAMETER])
    if printing.brief:
        printing.headline(comparison.headline(frame))
        return
    console = printing.console
    print_lines(comparison.answer(frame, call, console.width, learned), console)
    if details:
        _print_details(frame, earlier, console)


def _print_details(frame: pl.DataFrame, earlier: Earlier | None, console: Console) -> None:
    """Print the tables of all horizons and of forces, and every regime."""
    from hydro.report import change, comparison, yardsticks

    forces = comparison.forces(frame)
    if forces.is_empty():
        console.print("\nNo velocity was measured: the unexplained force is not known.")
    else:
        print_table(forces, "Unexplained force: root mean square and its 95 % interval", console)
    beside = "" if "before" in frame.columns else " (noise floor)"
    print_table(comparison.predictions(frame), f"Errors of predictions: root mean square{beside}", console)
    simple = yardsticks.of_comparison(frame)
    if not simple.is_empty():
        title = f"The model and simple predictors, {yardsticks.ahead(simple)}"
        print_table(yardsticks.table(simple), title, console)
    ranked, former = comparison.failures(frame), comparison.former_failures(frame)
    if not ranked.is_empty():
        print_table(
            ranked,
            "Regimes: share of the squared force error above the noise floor, share of the time, and error "
            "relative to that of the axis in all motion",
            console,
        )
    if not former.is_empty():
        print_table(former, "Regimes of the earlier comparison", console)
    if earlier is not None:
        print_table(change.errors(frame), change.title(frame), console)


COMMANDS = {
    compare: "hydro compare datasets/stonefish/vehicle.toml datasets/stonefish/replay90.parquet "
    "-o comparison.parquet",
}
