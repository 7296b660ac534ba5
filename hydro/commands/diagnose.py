"""Commands `diagnose` and `add`: find the corrections that a vehicle file needs, and add them."""

from __future__ import annotations

import math
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.answers import AsText, Details, Printing, called_with, print_lines
from hydro.commands.as_json import Json, print_json
from hydro.commands.before import Before, Discover, Network, learnt
from hydro.commands.engines import HERE, Address, EngineName, Threads, engine_for, refuse_engine
from hydro.commands.help import ADVANCED, CLUSTER, NEXT_RUN
from hydro.commands.places import FILE, EachOutput, Output
from hydro.commands.recordings import (
    Definitions,
    Logs,
    MapFile,
    MaxExpanded,
    Measured,
    called,
    dataset,
    tell_strangers,
)
from hydro.commands.shell import (
    STREAM,
    Known,
    ModelFile,
    about,
    estimates_beside,
    expected_seconds,
    message,
    progress,
    read,
    tell_changes,
    tell_duration,
    tell_not_shown,
    tell_provisional,
    vehicle_held,
    vehicle_to_fit,
    write,
)
from hydro.commands.tables import print_table
from hydro.core.errors import DataError, UsageError, in_shell

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    import polars as pl
    from rich.console import Console

    from hydro.core.diagnosis.findings import Diagnosis
    from hydro.core.experiment.flight import Flight
    from hydro.core.simulation.estimates import Estimates
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.provenance import Provenance
    from hydro.io.table import Artefact
    from hydro.report.diagnosis import Context
    from hydro.study.engine import Engine


CorrectThrusters = Annotated[
    bool,
    typer.Option(
        "--correct-thrusters",
        help="Continue with thrusters as their audit states them.",
        rich_help_panel=ADVANCED,
    ),
]
CHI2 = ("given", "own_effects", "found")
"""Reduced chi-squares: of the file, with its own effects re-estimated, with the findings added."""


def diagnose(
    vehicle: ModelFile,
    measured: Measured = None,
    known: Known = None,
    before: Before = None,
    map_: MapFile = None,
    details: Details = False,
    as_text: AsText = False,
    as_json: Json = False,
    output: EachOutput = STREAM,
    model: Network = None,
    discover: Discover = False,
    correct_thrusters: CorrectThrusters = False,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    next_run: Annotated[
        Path | None,
        typer.Option(
            "--next-run",
            metavar="COMMANDS",
            show_default=False,
            help="Write the commands of the next run.",
            rich_help_panel=NEXT_RUN,
        ),
        FILE,
    ] = None,
    depth: Annotated[
        tuple[float, float],
        typer.Option(
            metavar="MIN MAX",
            show_default=False,
            help="Least and greatest depth [m].",
            rich_help_panel=NEXT_RUN,
        ),
    ] = (-math.inf, math.inf),
    space: Annotated[
        float,
        typer.Option(
            metavar="METRES",
            show_default=False,
            help="Largest horizontal distance from the start [m].",
            rich_help_panel=NEXT_RUN,
        ),
    ] = math.inf,
    thrust: Annotated[
        float,
        typer.Option(metavar="SHARE", help="Largest share of full thrust.", rich_help_panel=NEXT_RUN),
    ] = 1.0,
    seconds: Annotated[
        float, typer.Option(metavar="N", help="Length of all sessions [s].", rich_help_panel=NEXT_RUN)
    ] = 120.0,
    each: Annotated[
        bool,
        typer.Option("--each", help="Diagnose each session of a folder.", rich_help_panel=CLUSTER),
    ] = False,
    engine: EngineName = HERE,
    address: Address = None,
    threads: Threads = 1,
    fly: Annotated[Path | None, typer.Option("--fly", hidden=True), FILE] = None,
) -> None:
    r"""Find the physical effects that a vehicle file lacks.

    Tests every effect of the catalogue on the prediction errors of the file. Each finding has a confidence,
    its share of the error above the noise and a next command; hydro add writes findings into the file. With
    --before it finds what has changed since that recording.

        hydro diagnose vehicle.toml after.parquet --before before.parquet

    Details:

    The thrusters are audited first, as by hydro check VEHICLE LOG. If their directions or the order of the
    columns contradict the file, that is the only finding, because it would distort all others.
    --correct-thrusters continues with directions and order as the audit finds them.

    The effects of the file are re-estimated before the tests, except those that the file holds as `known` or
    --known names. A recording that clearly contradicts a known value is a finding. The covariance of all
    values is written next to the table that -o names.

    If no model comes near the noise, as for a hull that no file describes exactly, unknown hull forces are
    allowed for. Drag, lift and added mass then remain unconfirmed.

    With --before a hull-force model is fitted to the recording before the change, and held fixed. Ten minutes
    with motion on all axes give a better model than two. Of more than an hour, sessions that are spread
    evenly over it are used. The file's effects keep their values, and a change of one is a finding. A change
    is confirmed if it removes 10 % or more of the error on data that it was not fitted to. Command columns
    that were exchanged or reversed since are the first finding.

    With --model a network of hydro train replaces the hull-force model. Train it on labels of the unchanged
    vehicle that were made with this vehicle file. Its error is measured on the recording of --before, which
    should not be the one that it was trained on.

        hydro labels earlier.parquet --vehicle vehicle.toml | hydro split | \
          hydro train -o net.parquet
        hydro diagnose vehicle.toml after.parquet --before before.parquet \
          --model net.parquet

    With --discover a formula is fitted if no effect explains the error: sparse terms of velocities, products,
    tilt and commands. Each term must reduce the error on sessions and regimes that it was not fitted to. A
    formula is always unconfirmed. Add it by its name if its terms make sense for the vehicle.

        hydro diagnose vehicle.toml raw.parquet --discover -o diagnosis.parquet
        hydro add vehicle.toml diagnosis.parquet --effect formula \
          -o vehicle-1.toml

    With --next-run the manoeuvres that separate close rivals, or show effects that this recording cannot
    show, are written as commands for hydro simulate or an autopilot. Every predicted position of every rival
    stays within --depth and --space. The answer then has the expected separation of rivals in standard
    deviations of the noise, and the expected standard errors. Diagnose the new recording and this one as
    sessions of one raw table.

        hydro diagnose vehicle.toml raw.parquet --next-run next.parquet \
          --depth 2 8 --space 10 --thrust 0.6

    With --each every session of a folder (session=NAME/part.parquet) is diagnosed by itself, and -o is a
    folder. With --engine ray the nodes of a Ray cluster share the sessions; the results are the same bytes.

        hydro diagnose vehicle.toml dives --each -o findings --engine ray \
          --address 10.0.0.1:6379

    On a terminal the answer goes to stdout. In a pipe stdout has the table, and stderr the headline.
    """
    from hydro.core.diagnosis.log_faults import preprocess
    from hydro.core.diagnosis.pipeline import diagnose_log
    from hydro.core.discovery.discover import discovered
    from hydro.core.experiment.flight import Limits, advise
    from hydro.io import covariance, table
    from hydro.io import vehicle as vehicles
    from hydro.report import change
    from hydro.report.diagnosis import Context
    from hydro.report.next_steps import next_steps

    printing = Printing(output, as_text, as_json)
    if fly is not None:
        message("hydro: --fly is now called --next-run; the old name goes with the next version")
        next_run = next_run or fly
    vehicles.read(vehicle)
    if each:
        _refuse_beside_each(before=before, model=model, discover=discover, next_run=next_run, json=as_json)
        connect = partial(engine_for, engine, address, threads)
        _diagnose_each(vehicle, dataset(measured), known, printing, connect, correct_thrusters, details)
        return
    refuse_engine(engine, "sessions are shared out where each is diagnosed by itself: add --each")
    limits = Limits(depth=depth, space=space, thrust=thrust, seconds=seconds)
    logs, name = Logs(map_, msg, vehicle), called(measured)
    source = logs.read(measured)
    start, text = vehicle_to_fit(vehicle, known, source)
    with about(name):
        tell_not_shown(start, source.frame)
        expected = None if before else expected_seconds(source.frame)
        tell_duration(source.frame, expected)
    earlier = learnt(before, model, start, source, logs, discover=discover)
    with about(name), progress("diagnose", expected) as update:

        def advance(words: str, share: float) -> None:
            update(round(100 * share), 100, words)

        hull = earlier.hull if earlier else None
        log = preprocess(start, source.frame, hull)
        log = log.as_audited() if correct_thrusters else log
        beyond, best = discovered if discover else None, tell_provisional(expected, of_change=bool(before))
        found = diagnose_log(start, log, hull=hull, beyond=beyond, progress=advance, provisional=best)
    changes = tell_changes(name, log.changes)
    call = called_with(
        vehicle,
        measured,
        output,
        known=known,
        before=before,
        model=model,
        map_=map_,
        msg=msg,
        discover=discover,
        correct_thrusters=correct_thrusters,
    )
    learned = "" if earlier is None else change.told(earlier.parameters, found.chi2)
    context = Context.of(found, start, log, call, learned)
    _print(found, context, printing, details)
    if as_json:
        errors = {"prediction": asdict(found.prediction)} if found.prediction else {}
        print_json(
            headline=found.headline,
            next=asdict(next_steps(found.frame(), found.prediction)[0]),
            findings=found.frame(),
            chi2=dict(zip(CHI2, found.chi2, strict=True)),
            **errors,
        )
    inputs = [source, *(earlier.inputs if earlier else ())]
    if printing.saves:
        made = table.make(
            "diagnosis",
            found.frame(),
            stage="diagnose",
            parameters=found.summary | (earlier.parameters if earlier else {}) | changes,
            inputs=inputs,
            vehicle_text=text,
        )
        write(made, output)
        if found.estimates is not None and output != STREAM:
            covariance.write(found.estimates, output, stage="diagnose", inputs=inputs, vehicle_text=text)
    if next_run is not None and found.question is None:
        typer.echo(
            "hydro: no commands written: there are no rivals that another run could separate", err=True
        )
    if next_run is not None and found.question is not None:
        with about(name):
            flight = advise(found.question, limits)
        _print_next_run(flight, next_run, printing.console)
        made = table.make("commands", flight.table(), stage="diagnose", inputs=inputs, vehicle_text=text)
        write(made, str(next_run))


def _refuse_beside_each(**given: object) -> None:
    """Refuse options that apply to a single diagnosis, given by name, together with --each.

    Raises:
        UsageError: An option has a value.
    """
    if named := [name for name, there in given.items() if there]:
        option = named[0].replace("_", "-")
        raise UsageError(f"--each diagnoses every session by itself, without --{option}: leave one out")


def _diagnose_each(
    file: Path,
    folder: str | None,
    known: list[str] | None,
    printing: Printing,
    connect: Callable[[], AbstractContextManager[Engine]],
    corrected: bool,
    details: bool,
) -> None:
    """Diagnose every session of a data set separately."""
    from hydro.io import partitions
    from hydro.study.diagnosing import diagnose_part, warm

    output = printing.output
    if folder is None or output == STREAM:
        raise UsageError(f"--each needs a folder of sessions ({partitions.LAYOUT}), and -o FOLDER")
    data = partitions.opened(folder, ("raw",))
    start, text = vehicle_held(file, known)
    tasks = [(part, Path(output), start, text, corrected) for part in data.parts]
    failed, console = 0, printing.console
    with connect() as engine, progress("diagnose") as update:
        engine.prepare(partial(warm, data.parts[0], start))
        for number, one in enumerate(engine.each(diagnose_part, tasks)):
            update(number + 1, len(tasks), one.session)
            if one.findings is None:
                failed += 1
                message(f"hydro: {one.error}")
                continue
            console.print(f"{one.session}: {one.headline}", style="bold")
            if details:
                print_findings(one.findings, console)
    tell_strangers(output, (part.session for part in data.parts))
    if failed:
        raise DataError(f"{folder}: {failed} of {len(tasks)} sessions could not be diagnosed, see above")


def add(
    vehicle: Annotated[
        Path,
        typer.Argument(metavar="VEHICLE", show_default=False, help="The vehicle file that was diagnosed."),
    ],
    diagnosis: Annotated[
        str,
        typer.Argument(metavar="DIAGNOSIS", show_default=False, help="Diagnosis; nothing or - is stdin."),
    ] = STREAM,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            show_default=False,
            help="Finding to add; default: all confirmed ones. May be repeated.",
        ),
    ] = None,
    force: Annotated[
        bool,
        typer.Option("--force", help="Add findings that do not lower the held-out error."),
    ] = False,
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    r"""Add the findings of a diagnosis to a vehicle file.

    Adds the confirmed findings. A missing effect becomes an [[effect]] table at the end of the file; an
    effect of the file gets new values. An unconfirmed effect (confidence below 90 %) is added only by its
    name.

        hydro add vehicle.toml diagnosis.parquet --effect ocean_current \
          -o vehicle-1.toml

    Details:

    Everything else in the file stays, comments too. Standard errors and the hash of the recording are written
    with the values. If the diagnosis has a covariance file, the covariance of the added values is written
    next to the file that -o names; a diagnosis from a pipe has none.

    Findings that do not lower the error 5 s ahead on stretches that the fits left out are refused without
    --force. So is the diagnosis of another vehicle, or of this one before it was edited.
    """
    from hydro.core.diagnosis.findings import by_name, suspects, tables
    from hydro.io import vehicle as vehicles

    known, text = vehicles.read(vehicle)
    source = read(diagnosis, "diagnosis")
    with about(diagnosis):
        found = tables(source.frame, effect)
    _require_of(known, vehicle, source, diagnosis)
    if not force:
        _require_better(source, [str(table["name"]) for table in found], alone=bool(effect))
    if not effect and (left := suspects(source.frame)):
        typer.echo(f"hydro: not added, {by_name(left)}", err=True)
    origin = {"data": _recording(source.provenance), "method": "diagnose"}
    for table in found:
        text = vehicles.set_effect(text, table | {"fit": origin})
    if output == STREAM:
        vehicles.parse(text)
        sys.stdout.write(text)
        return
    estimates = None if diagnosis == STREAM else estimates_beside(diagnosis)
    earlier = estimates_beside(vehicle, known)
    vehicles.write(text, output)
    if estimates is not None:
        added = estimates.of_effects([table["name"] for table in found])
        _write_covariance(added.after(earlier), output, source, text)


def _require_of(known: Vehicle, vehicle: Path, source: Artefact, diagnosis: str) -> None:
    """Refuse the diagnosis of another vehicle, or of an earlier version of this vehicle file.

    Args:
        known: Vehicle of the file.
        vehicle: Path of the file.
        source: Diagnosis table.
        diagnosis: Name of the diagnosis in messages.

    Raises:
        DataError: The vehicle is different, or the diagnosis does not name its vehicle.
    """
    from hydro.io import vehicle as vehicles

    record = source.provenance
    again = f"run `hydro diagnose {in_shell(str(vehicle))} RECORDING -o {in_shell(diagnosis)}`"
    if record.vehicle is None:
        raise DataError(f"{diagnosis}: does not say of which vehicle it is: {again}")
    diagnosed = vehicles.parse(record.vehicle, diagnosis)
    effects = set(source.frame["effect"])
    if differing := vehicles.differences(known, diagnosed, _recording(record), effects):
        raise DataError(
            f"{diagnosis}: made from another vehicle than {vehicle}, they differ in {', '.join(differing)}: "
            f"{again}"
        )


def _write_covariance(estimates: Estimates, output: str, source: Artefact, text: str) -> None:
    """Write the covariance of the added values next to the vehicle file.

    Raises:
        DataError: The covariance file belongs to another diagnosis.
    """
    from hydro.io import covariance
    from hydro.io import vehicle as vehicles

    if other := estimates.disagreement(vehicles.parse(text)):
        raise DataError(f"the covariance of the diagnosis is not of its values: {other}; diagnose again")
    covariance.write(estimates, output, stage="add", inputs=[source], vehicle_text=text)


def _recording(provenance: Provenance) -> str:
    """Return the hash of the recording that was diagnosed; empty if the footer lacks it."""
    return next((one.content for one in provenance.inputs if one.kind == "raw"), "")


def _require_better(source: Artefact, names: list[str], *, alone: bool) -> None:
    """Refuse findings that do not lower the held-out prediction error; see `findings.no_better`.

    Args:
        source: Diagnosis table.
        names: Effects to add.
        alone: Whether they are added by name, not as all confirmed ones.

    Raises:
        DataError: The findings do not lower the error.
    """
    from hydro.core.diagnosis.findings import no_better, prediction_of

    prediction = prediction_of(source.provenance.parameters)
    if why := no_better(source.frame, prediction, names, alone=alone):
        raise DataError(f"{why}; --force adds it all the same")


def _print(found: Diagnosis, context: Context, printing: Printing, details: bool) -> None:
    """Print the answer, or only its headline if the table goes into a pipe."""
    from hydro.report.diagnosis import answer, fits

    if printing.brief:
        printing.headline(found.headline)
        return
    console, frame = printing.console, found.frame()
    print_lines(answer(frame, context, console.width, whole=details), console)
    if details:
        print_findings(frame, console)
        if not context.learned:
            console.print(f"\n{fits(found.chi2)}")


def print_findings(frame: pl.DataFrame, console: Console) -> None:
    """Print the values, the statistical test and the advice of each finding of a diagnosis.

    Args:
        frame: Diagnosis table.
        console: Console to print on.
    """
    from hydro.report.diagnosis import details

    for title, values, words in details(frame):
        if values.is_empty():
            console.print(f"\n{title}", style="bold")
        else:
            print_table(values, title, console)
        console.print(words)


def _print_next_run(flight: Flight, path: Path, console: Console) -> None:
    """Print the manoeuvres of the next run and the expected results."""
    console.print(f"\nNext run ({path}):", style="bold")
    for line in flight.lines():
        console.print(line, soft_wrap=True)


COMMANDS = {
    diagnose: "hydro diagnose datasets/stonefish/vehicle.toml datasets/stonefish/replay90.parquet "
    "-o diagnosis.parquet",
    add: "hydro diagnose datasets/hidden/vehicle.toml datasets/hidden/measured.parquet | "
    "hydro add datasets/hidden/vehicle.toml -o vehicle2.toml",
}
