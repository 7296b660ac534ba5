"""`compare`: how far a vehicle file is from a recording, and where."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.as_json import Json, print_json, saves
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
from hydro.commands.tables import person, print_table
from hydro.core.errors import DataError

if TYPE_CHECKING:
    import polars as pl
    from rich.console import Console

    from hydro.commands.before import Earlier
    from hydro.io.table import Artefact


def compare(
    vehicle: ModelFile,
    measured: Measured = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="COMPARISON",
            help="An earlier comparison with the same recording: its errors are shown beside the new ones, "
            "and its places are looked at again.",
        ),
    ] = None,
    before: Before = None,
    model: Network = None,
    map_: MapFile = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    as_json: Json = False,
    output: Output = STREAM,
) -> None:
    """Measure how well a vehicle file predicts a recording.

    Two kinds of error, each beside what sensor noise alone would cause: the force that the model leaves
    unexplained, and the motion predicted 1, 5 and 20 s ahead from restarts all along the recording, and over
    each whole session. Then the regimes of motion in which the model fails, with their share of the
    unexplained error. They are printed on the terminal, on stderr where stdout is a pipe.

    With --before it shows, axis by axis, where the vehicle has changed since another recording. What the hull
    does beside the file is learnt from that one and held fixed. The errors of short predictions with it, in
    the recording after, stand beside those in stretches of the one before that it was not fitted to, the
    floor, and beside those of the file alone. Above the floor something has changed, or the vehicle moves as
    it did not before; hydro diagnose --before says what, and how sure that is.

    Errors are those of the cleaned recording, as diagnose, explain and fit see it. Readings that no motion
    makes, a gyro's bias, columns in other frames or units and exchanged command columns are put right or left
    out. Every change is one line on stderr, and is kept in the footer of the comparison.

        hydro compare vehicle.toml after.parquet --before before.parquet
    """
    from hydro.core import effects
    from hydro.core.cleaning.readiness import unready
    from hydro.core.diagnosis.log_faults import preprocess
    from hydro.core.evaluation.compare import compare as compute
    from hydro.core.explanation.with_hull import with_hull
    from hydro.io import table
    from hydro.io import vehicle as vehicles

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
    _print(frame, earlier, person(as_json))
    if as_json:
        print_json(comparison=frame)
    if not saves(output, as_json):
        return
    inputs = [source, *([former] if former else []), *(earlier.inputs if earlier else ())]
    parameters = (earlier.parameters if earlier else {}) | changes
    made = table.make(
        "comparison", frame, stage="compare", parameters=parameters, inputs=inputs, vehicle_text=text
    )
    write(made, output)


def _former(against: str, source: Artefact) -> Artefact:
    """The earlier comparison.

    Raises:
        DataError: it is of another recording.
    """
    earlier = read(against, "comparison")
    # The first recording is the one that the vehicle was held against, another the one from before.
    recordings = [one.content for one in earlier.provenance.inputs if one.kind == "raw"]
    if source.provenance.content not in recordings[:1]:
        raise DataError(
            f"{against}: a comparison with another recording; name one that was made with this recording"
        )
    return earlier


def _print(frame: pl.DataFrame, earlier: Earlier | None, console: Console) -> None:
    """The comparison for a person."""
    from hydro.report import change, comparison, yardsticks

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
        ahead = yardsticks.ahead(simple)
        title = f"The model beside simple predictors, {ahead}: least squares fitted to other sessions"
        print_table(yardsticks.table(simple), title, console)
    ranked, former = comparison.failures(frame), comparison.former_failures(frame)
    if not ranked.is_empty():
        print_table(ranked, "Where it fails: share of the unexplained error and of the time", console)
    if not former.is_empty():
        print_table(former, "Where it failed before", console)
    if earlier is not None:
        print_table(change.errors(frame), change.title(frame), console)
        console.print(f"\n{change.learnt(earlier.parameters[change.PARAMETER])}\n{change.summary(frame)}")
    console.print(f"\n{comparison.headline(frame)}")
    if told := yardsticks.sentence(simple):
        console.print(told)


COMMANDS = {
    compare: "hydro compare datasets/stonefish/vehicle.toml datasets/stonefish/replay90.parquet "
    "-o comparison.parquet",
}
