"""`diagnose` and `add`: what is missing in a vehicle file, and the file with it."""

from __future__ import annotations

import math
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.as_json import Json, print_json, saves
from hydro.commands.before import Before, Discover, Network, learnt
from hydro.commands.engines import HERE, Address, EngineName, Threads, engine_for, refuse_engine
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
    progress,
    read,
    tell_changes,
    tell_duration,
    tell_not_shown,
    vehicle_held,
    vehicle_to_fit,
    write,
)
from hydro.commands.tables import person
from hydro.core.errors import DataError, UsageError, in_shell

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    import polars as pl
    from rich.console import Console

    from hydro.commands.before import Earlier
    from hydro.core.diagnosis.findings import Diagnosis, Prediction
    from hydro.core.experiment.flight import Flight
    from hydro.core.simulation.estimates import Estimates
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.provenance import Provenance
    from hydro.io.table import Artefact
    from hydro.study.engine import Engine


CorrectThrusters = Annotated[
    bool,
    typer.Option(
        "--correct-thrusters",
        help="Where the audit of the thrusters contradicts the file, go on with directions and order as the "
        "audit states them; by default nothing else is examined.",
    ),
]
CHI2 = ("given", "own_effects", "found")
"""Mean squared residuals in units of the noise: of the file, of its own effects anew, with what was found."""


def diagnose(
    vehicle: ModelFile,
    measured: Measured = None,
    known: Known = None,
    before: Before = None,
    model: Network = None,
    discover: Discover = False,
    correct_thrusters: CorrectThrusters = False,
    map_: MapFile = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    each: Annotated[
        bool,
        typer.Option("--each", help="Diagnose every session of a folder by itself; -o is a folder."),
    ] = False,
    engine: EngineName = HERE,
    address: Address = None,
    threads: Threads = 1,
    output: EachOutput = STREAM,
    as_json: Json = False,
    fly: Annotated[
        Path | None,
        typer.Option(
            metavar="COMMANDS",
            show_default=False,
            help="Write the flight that would tell what is left open, as a commands table.",
        ),
        FILE,
    ] = None,
    depth: Annotated[
        tuple[float, float],
        typer.Option(metavar="MIN MAX", show_default=False, help="Depths that --fly keeps to [m]."),
    ] = (-math.inf, math.inf),
    space: Annotated[
        float,
        typer.Option(
            metavar="METRES",
            show_default=False,
            help="Greatest horizontal distance of --fly from where a session begins.",
        ),
    ] = math.inf,
    thrust: Annotated[
        float, typer.Option(metavar="SHARE", help="Greatest thrust of --fly, as a share of the full one.")
    ] = 1.0,
    seconds: Annotated[
        float, typer.Option(metavar="N", help="Length of --fly, all sessions together.")
    ] = 120.0,
) -> None:
    """Find the physical effects that a vehicle file lacks.

    First the thrusters are audited, as by hydro check VEHICLE LOG: where directions or the order of the
    columns contradict the file, that is the only finding, because every other one would bend to it.

    The file's own effects are re-estimated first; then every effect of the catalogue is tested on what they
    leave unexplained. A finding gives the share of the error that it explains, the confidence in its name and
    the effects it could be confused with, its values with standard errors, and what to do or to fly next.
    What the file holds as `known`, or --known names, is not re-estimated; where the recording contradicts it
    clearly, that is said. Findings are printed on the terminal, on stderr where stdout is a pipe; hydro add
    writes them into the file. Beside the table that -o names lies the covariance of all values.

    Where no model reaches the noise, as on a hull that no file describes exactly, what a hull may do beside
    its file is allowed for: it takes nothing from the values of what is named. Drag, lift and added mass are
    only suspected there.

    With --before it finds what has changed since another recording: what the hull does beside the file is
    learnt from that one, by a regression on a library of forces, and held fixed: the longer it is the better,
    ten minutes of all axes rather than two. The file's effects keep
    their values, and a change of one is a finding like any other. A change is named where it takes
    10 % or more of the error away from stretches which it was not fitted to. Command columns exchanged or
    reversed since are the first finding, and all else is told as if they were in order.

        hydro diagnose vehicle.toml after.parquet --before before.parquet

    With --model a network of hydro train says what the hull does. Train it on labels of the unchanged
    vehicle, made with this very file. What it leaves is measured on the recording before: best another one
    than it learnt from.

        hydro labels earlier.parquet --vehicle vehicle.toml | hydro split | hydro train -o net.parquet
        hydro diagnose vehicle.toml after.parquet --before before.parquet --model net.parquet

    With --discover, where no effect of the catalogue explains what is left, sparse terms (powers of
    velocities, products, tilt, commands) are tried as a formula. Each must remove error from sessions and
    regimes of motion that it was not fitted to. The formula is suspected, not stated, with standard
    errors and in words: judge whether it can be, and add it by its name. A force that was stated and
    leaves more than the formula does is a suspect then.

        hydro diagnose vehicle.toml raw.parquet --discover -o diagnosis.parquet
        hydro add vehicle.toml diagnosis.parquet --effect formula -o vehicle-1.toml

    With --fly, the manoeuvres that would part close rivals, or else show what this recording does not, are
    written as commands for hydro simulate or an autopilot. They count by what a rival cannot imitate with
    its own values, as far as the recording leaves these open. Every predicted position of every rival keeps
    to --depth and --space: manoeuvres are flown gentler or shorter until it does, or there is one line that
    none does. Printed are the distances of rivals in standard deviations of the noise and the standard errors
    that are expected. Record it, and diagnose both recordings as sessions of one raw table.

        hydro diagnose vehicle.toml raw.parquet --fly next.parquet --depth 2 8 --space 10 --thrust 0.6

    With --each, of a folder with a file session=NAME/part.parquet for each session, every session is
    diagnosed by itself: what was missing in which dive. Findings go to such a folder. With --engine ray the
    nodes of a Ray cluster share the sessions; every byte is the same.

        hydro diagnose vehicle.toml dives --each -o findings --engine ray --address 10.0.0.1:6379
    """
    from hydro.core.diagnosis.diagnose import answered, diagnose_log
    from hydro.core.diagnosis.log_faults import preprocess
    from hydro.core.discovery.discover import discovered
    from hydro.core.experiment.flight import Limits, advise
    from hydro.io import covariance, table
    from hydro.io import vehicle as vehicles

    vehicles.read(vehicle)
    if each:
        _refuse_beside_each(before=before, model=model, discover=discover, fly=fly, json=as_json)
        connect = partial(engine_for, engine, address, threads)
        _diagnose_each(vehicle, dataset(measured), known, output, connect, correct_thrusters)
        return
    refuse_engine(engine, "sessions are shared out where each is diagnosed by itself: add --each")
    limits = Limits(depth=depth, space=space, thrust=thrust, seconds=seconds)
    logs, name = Logs(map_, msg, vehicle), called(measured)
    source = logs.read(measured)
    start, text = vehicle_to_fit(vehicle, known, source)
    with about(name):
        tell_not_shown(start, source.frame)
        if not before:
            tell_duration(start, source.frame)
    earlier = learnt(before, model, start, source, logs, discover=discover)
    with about(name), progress("diagnose") as update:

        def advance(words: str, share: float) -> None:
            update(round(100 * share), 100, words)

        hull = earlier.hull if earlier else None
        log = preprocess(start, source.frame, hull)
        log = log.as_audited() if correct_thrusters else log
        found = diagnose_log(start, log, hull=hull, progress=advance)
        if discover and not log.misdirected:
            found = discovered(start, log, found, advance)
            found = answered(found, start, log, hull=hull)
    changes = tell_changes(name, log.changes)
    _print(found, earlier, person(as_json))
    if as_json:
        errors = {"prediction": asdict(found.prediction)} if found.prediction else {}
        print_json(
            headline=found.headline,
            findings=found.frame(),
            chi2=dict(zip(CHI2, found.chi2, strict=True)),
            **errors,
        )
    inputs = [source, *(earlier.inputs if earlier else ())]
    if saves(output, as_json):
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
    if fly is not None and found.question is None:
        typer.echo("hydro: no flight written: no rivals are left that one could part", err=True)
    if fly is not None and found.question is not None:
        with about(name):
            flight = advise(found.question, limits)
        _print_flight(flight, fly, person(as_json))
        made = table.make("commands", flight.table(), stage="diagnose", inputs=inputs, vehicle_text=text)
        write(made, str(fly))


def _refuse_beside_each(**given: object) -> None:
    """Refuse what is of one diagnosis, not of many.

    Raises:
        UsageError: It is given.
    """
    if named := [name for name, there in given.items() if there]:
        raise UsageError(f"--each diagnoses every session by itself, without --{named[0]}: leave one out")


def _diagnose_each(
    file: Path,
    folder: str | None,
    known: list[str] | None,
    output: str,
    connect: Callable[[], AbstractContextManager[Engine]],
    corrected: bool,
) -> None:
    """Diagnose every session of a dataset by itself."""
    from hydro.io import partitions
    from hydro.study.diagnosing import diagnose_part, warm

    if folder is None or output == STREAM:
        raise UsageError(f"--each needs a folder of sessions ({partitions.LAYOUT}), and -o FOLDER")
    data = partitions.opened(folder, ("raw",))
    start, text = vehicle_held(file, known)
    tasks = [(part, Path(output), start, text, corrected) for part in data.parts]
    failed, console = 0, person()
    with connect() as engine, progress("diagnose") as update:
        engine.prepare(partial(warm, data.parts[0], start))
        for number, one in enumerate(engine.each(diagnose_part, tasks)):
            update(number + 1, len(tasks), one.session)
            if one.findings is None:
                failed += 1
                typer.echo(f"hydro: {one.error}", err=True)
                continue
            console.print(f"{one.session}: {one.headline}", style="bold")
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
            help="A finding to add; by default all missing or to be re-estimated, no suspects. "
            "Repeat for several.",
        ),
    ] = None,
    force: Annotated[
        bool,
        typer.Option("--force", help="Add them although predictions of left-out data do not get better."),
    ] = False,
    output: Output = STREAM,
) -> None:
    """Add the findings of a diagnosis to a vehicle file.

    A missing effect becomes an [[effect]] table at the end of the file, and one that the file has gets its
    new values. Everything else in the file stays, comments too. Standard errors and the hash of the recording
    are written with the values. A suspect, of which the diagnosis is less than 90 % sure, is
    added only by its name. Findings that do not lower the error of predictions 5 s ahead, over stretches of
    the recording that they were not fitted to, are refused without --force. The diagnosis of another vehicle,
    or of this one before it was edited, is refused.
    If there is a covariance file for DIAGNOSIS, the covariance of the added values is written next to the
    file that -o names; a diagnosis from a pipe has none.
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
    """Refuse the diagnosis of another vehicle, or of this one as it was before it was edited.

    Raises:
        DataError: it is, or does not say of which it is.
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
    """Write the covariance of what was added beside the file; of no other values than the file's.

    Raises:
        DataError: it is of another diagnosis than the one that was read.
    """
    from hydro.io import covariance
    from hydro.io import vehicle as vehicles

    if other := estimates.disagreement(vehicles.parse(text)):
        raise DataError(f"the covariance beside the diagnosis is not of its values: {other}; diagnose again")
    covariance.write(estimates, output, stage="add", inputs=[source], vehicle_text=text)


def _recording(provenance: Provenance) -> str:
    """Hash of the recording that a diagnosis was made from; empty where its footer is lost."""
    return next((one.content for one in provenance.inputs if one.kind == "raw"), "")


def _require_better(source: Artefact, names: list[str], *, alone: bool) -> None:
    """Refuse findings that do not lower the error of predictions of data that they were not fitted to.

    Args:
        source: The diagnosis.
        names: Effects that are to be added.
        alone: Whether they were named one by one: then one of them has to lower it by itself.

    Raises:
        DataError: They do not.
    """
    import polars as pl

    from hydro.core.diagnosis.findings import PREDICTION, Prediction

    parameters = source.provenance.parameters
    if PREDICTION not in parameters or "error_added" not in source.frame.columns:
        return
    known = Prediction(**parameters[PREDICTION])
    told = ", ".join(names)
    if not alone:
        if known.added != known.given and not known.falls:
            raise DataError(_no_better(told, known.added, known))
        return
    errors: list[float] = (
        source.frame.filter(pl.col("effect").is_in(names))["error_added"].drop_nulls().to_list()
    )
    if errors and not min(errors) < known.given:
        raise DataError(_no_better(told, min(errors), known))


def _no_better(names: str, error: float, known: Prediction) -> str:
    """Return why findings are refused."""
    return (
        f"adding {names} does not lower the error {known.horizon:g} s ahead of data that it was not fitted "
        f"to: {known.given:.3g} m/s before, {error:.3g} m/s after; --force adds it all the same"
    )


def print_findings(frame: pl.DataFrame, console: Console) -> None:
    """One line per finding, and its advice below."""
    from hydro.report.diagnosis import lines

    for line, advice in lines(frame):
        console.print(line, style="bold")
        console.print(f"    {advice}")


def _print(found: Diagnosis, earlier: Earlier | None, console: Console) -> None:
    """The findings for a person, and how much of the residual they leave."""
    from rich.padding import Padding

    from hydro.report import change
    from hydro.report import prediction as words

    if found.status is not None:
        console.print(f"{found.status.title}{':' if found.status.sentences else '.'}", style="bold")
        for sentence in found.status.sentences:
            console.print(Padding(sentence, (0, 0, 0, 2)))
    if found.prediction is not None:
        console.print(words.prediction(found.prediction))
    console.print()
    print_findings(found.frame(), console)
    given, own, all_of_it = found.chi2
    if earlier is not None:
        console.print(f"\n{change.learnt(earlier.parameters[change.PARAMETER])} {change.left(found.chi2)}")
        return
    console.print(
        f"\nMean squared residual (1: noise alone): {given:.3g} as given, {own:.3g} with the file's "
        f"own effects re-estimated, {all_of_it:.3g} with what was found."
    )


def _print_flight(flight: Flight, path: Path, console: Console) -> None:
    """What to fly next and what it is expected to tell."""
    console.print(f"\nTo fly next ({path}):", style="bold")
    for line in flight.lines():
        console.print(line, soft_wrap=True)


COMMANDS = {
    diagnose: "hydro diagnose datasets/stonefish/vehicle.toml datasets/stonefish/replay90.parquet "
    "-o diagnosis.parquet",
    add: "hydro diagnose datasets/hidden/vehicle.toml datasets/hidden/measured.parquet | "
    "hydro add datasets/hidden/vehicle.toml -o vehicle2.toml",
}
