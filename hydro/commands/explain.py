"""`explain`: add what is missing, step by step, and watch the error fall."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.as_json import Json, print_json
from hydro.commands.before import Before, Discover, Network, learnt
from hydro.commands.diagnose import CorrectThrusters
from hydro.commands.places import FOLDER
from hydro.commands.recordings import Definitions, Logs, MapFile, MaxExpanded, Measured, called
from hydro.commands.shell import (
    Known,
    ModelFile,
    about,
    progress,
    tell_changes,
    tell_duration,
    tell_not_shown,
    vehicle_to_fit,
)
from hydro.commands.tables import person, print_table
from hydro.core.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from hydro.core.diagnosis.log_faults import Preprocessed
    from hydro.core.explanation.ladder import Step
    from hydro.core.explanation.trials import Recordings
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.study import Study
    from hydro.io.table import Artefact


NOT_STATED = ", not stated: of what was tried it predicts best what its fit left out"
ONLY_SUSPECTED = ", not stated: it is suspected"


def explain(
    vehicle: ModelFile,
    folder: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", help="Folder for the study; created if needed."),
        FOLDER,
    ],
    measured: Measured = None,
    holdout: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RAW",
            show_default=False,
            help="Another recording, to which nothing is fitted: it shows whether a step generalises. "
            "Repeat for the logs of one dive.",
        ),
    ] = None,
    known: Known = None,
    before: Before = None,
    model: Network = None,
    discover: Discover = False,
    correct_thrusters: CorrectThrusters = False,
    map_: MapFile = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    as_json: Json = False,
) -> None:
    """Find missing effects, add them one by one and show the errors.

    First the thrusters are audited, as by hydro check VEHICLE LOG: where directions or the order of the
    columns contradict the file, nothing is added.

    Step 0 is the file as given. Each later step adds the finding that explains most, re-estimates it together
    with the file's own effects and all that was added before, and compares the new file with the recording
    and the held-out one. Where no statement comes first, and a suspect has a confidence of 20 % or more or no
    model is near the noise, suspects are tried and, beside them, what else of the catalogue promises most:
    the one joins that predicts best, five seconds ahead, stretches of the recording that its fit leaves out,
    if it lowers their error by 2 % or more. Such a step predicts better; that its name is right it does not
    say, and it is marked as not stated. It ends when nothing is significant and material and no trial
    predicts better, when a step makes the predictions of the held-out recording worse, or after six steps.
    Without --holdout, stretches that are left out take its place.

    DIR gets comparison-K.parquet, diagnosis-K.parquet, vehicle-K.toml and, with its covariance,
    vehicle-K.covariance.parquet of every step K, and ladder.parquet, the errors of all. Of the first and the
    best step it gets replay.parquet, measured and predicted motion, and leftover.parquet, the force left over
    against velocity; of the best growth.parquet, the powers by which the force of the water grows with each
    velocity, and bands.parquet, 95 % bands of its predictions; sessions.parquet lists what was recorded. The
    same study in the same folder resumes where it stopped; another one replaces it.

    With --before it adds, step by step, what has changed since another recording, until nothing more has.
    What the hull does beside the file is learnt from that one and held fixed, and so are the file's own
    values: a step adds the change that is stated, or suspected with a confidence of 20 % or more, and refits
    it together with earlier changes alone. What is left is told in units of what the model of the hull leaves
    of stretches of that recording that it was not fitted to. So is what is left of --holdout, a recording of
    the changed vehicle: it ends the study where a step makes that worse.

        hydro explain vehicle.toml after.parquet --before before.parquet -o study

    With --discover, a step adds a formula of sparse terms where no effect of the catalogue is stated and one
    removes error from regimes of motion that it was not fitted to; see hydro diagnose.

        hydro explain vehicle.toml raw.parquet --discover -o study
    """
    from hydro.core.discovery.discover import discovered
    from hydro.core.explanation.explain import ending
    from hydro.core.explanation.explain import explain as compute
    from hydro.core.explanation.ladder import best
    from hydro.core.explanation.trials import Recordings
    from hydro.io.study import Study

    logs, name = Logs(map_, msg, vehicle), called(measured)
    source = logs.read(measured)
    start, text = vehicle_to_fit(vehicle, known, source)
    other = _held_out(holdout, logs, source, start, beside=bool(before)) if holdout else None
    with about(name):
        tell_not_shown(start, source.frame)
        if not before:
            tell_duration(start, source.frame, steps=True)
    earlier = learnt(before, model, start, source, logs, discover=discover)
    frame, hull = None if other is None else other.frame, earlier.hull if earlier else None
    with about(name):
        recordings = Recordings.of(start, source.frame, frame, hull)
    changes = tell_changes(name, recordings.log.changes)
    if recordings.holdout is not None:
        held_out = tell_changes(called(holdout), recordings.holdout.changes)
        changes |= {f"{key}_holdout": lines for key, lines in held_out.items()}
    told = earlier.parameters if earlier else {"discover": True} if discover else {}
    inputs = earlier.inputs if earlier else ()
    study = Study(folder, text, source, other, inputs, told | changes)
    steps = study.done()
    if study.clear(steps) and not steps:
        typer.echo(f"hydro: {folder}: the files of another study there are replaced", err=True)
    for step in steps:
        _tell(step, "already done")
    with about(name), progress("explain") as update:

        def advance(words: str, share: float) -> None:
            update(round(100 * share), 100, f"step {len(steps)}: {words}")

        done = list(steps)
        found = compute(
            start,
            source.frame,
            holdout=frame,
            hull=hull,
            done=done,
            recordings=recordings,
            beyond=discovered if discover else None,
            corrected=correct_thrusters,
            progress=advance,
        )
        for step in () if study.has_ended(steps) else found:
            steps.append(step)
            study.save_step(steps)
            _tell(step)
        study.end(steps, ending(steps))
        _save_recorded(study, {step.number: step.vehicle for step in (steps[0], best(steps))}, recordings.log)
        _save_bands(study, best(steps))
    _print(study, steps, best(steps), ending(steps), recordings, person(as_json))
    if as_json:
        _print_json(study, steps, best(steps), ending(steps))


def _save_recorded(study: Study, vehicles: dict[int, Vehicle], log: Preprocessed) -> None:
    """Write what these steps make of the recordings, and which sessions those have."""
    import polars as pl

    from hydro.core.discovery.growth import growth
    from hydro.core.evaluation.leftover import leftover
    from hydro.core.evaluation.rolling_prediction import restarted
    from hydro.core.explanation.ladder import DATASETS
    from hydro.core.recording.segments import sessions
    from hydro.io.study import NO_FORCES

    given = [one.frame for one in (study.measured, study.holdout) if one is not None]
    study.save("replay", restarted({f"step-{k}": one for k, one in vehicles.items()}, given[-1]))
    why = ""
    try:
        study.save("leftover", leftover(vehicles, log.raw, log.observed))
        grown = growth(list(vehicles.values())[-1], log.raw, log.observed)
        if not grown.is_empty():
            study.save("growth", grown)
    except DataError as error:  # too few samples: what else is wrong with a recording has ended the study
        why = str(error)
    listed = [
        sessions(frame).with_columns(dataset=pl.lit(name))
        for name, frame in zip(DATASETS, given, strict=False)
    ]
    study.save("sessions", pl.concat(listed), **({NO_FORCES: why} if why else {}))


def _save_bands(study: Study, step: Step) -> None:
    """Write the bands of the step's predictions; none of a file that nothing was fitted in."""
    from hydro.core.evaluation.rolling_prediction import FEW_DRAWS, restarted_bands

    if step.estimates is None:
        return
    shown = study.holdout or study.measured
    try:
        frame = restarted_bands(step.vehicle, step.estimates, shown.frame)
    except DataError as error:
        typer.echo(f"hydro: no bands: {error}", err=True)
        return
    study.save("bands", frame, draws=FEW_DRAWS, step=step.number)


def _held_out(holdout: list[str], logs: Logs, source: Artefact, known: Vehicle, *, beside: bool) -> Artefact:
    """The held-out recording.

    Raises:
        DataError: It is the measured one, is too short, or is another vehicle's.
    """
    from hydro.core.explanation.explain import long_enough

    other, name = logs.read(holdout), called(holdout)
    if other.provenance.content == source.provenance.content:
        raise DataError(f"{name}: the same rows as the measured recording; hold other sessions out")
    with about(name):
        long_enough(known, other.frame, beside=beside)
    return other


def _tell(step: Step, remark: str = "") -> None:
    """One line for a step, as soon as it is done."""
    from hydro.report.ladder import headline

    line = headline(step.ladder)
    typer.echo(f"{line} ({remark})" if remark else line, err=True)


def _print(
    study: Study, steps: Sequence[Step], chosen: Step, reason: str, recordings: Recordings, console: Console
) -> None:
    """The ladder, what was added, what the last diagnosis says, and where the files are."""
    import polars as pl

    from hydro.core.explanation.ladder import DATASETS
    from hydro.core.explanation.options import is_open, is_stated
    from hydro.report import change, ladder, yardsticks
    from hydro.report.diagnosis import lines

    every = pl.concat(step.ladder for step in steps)
    for dataset in DATASETS:
        if not every.filter(dataset=dataset).is_empty():
            print_table(ladder.errors(every, dataset), ladder.title(every, dataset), console)
    simple = yardsticks.of_ladder(every, chosen.number, yardsticks.judged_on(every))
    if told := yardsticks.sentence(simple):
        console.print(
            told, *yardsticks.explained(simple, recordings.yardstick, recordings.log.record), sep="\n"
        )
    if change.PARAMETER in study.parameters:
        console.print(f"\n{change.learnt(study.parameters[change.PARAMETER])}", *change.fall(every), sep="\n")
    for last, step in pairwise(steps):
        how = "" if is_stated(last, step) else NOT_STATED if is_open(last) else ONLY_SUSPECTED
        console.print(f"\nStep {step.number}{how}", style="bold")
        for table in step.tables:
            if table["name"] in step.added:
                console.print(f"    {table['name']}", *ladder.values(table), sep="\n        ", soft_wrap=True)
        others = [table["name"] for table in step.tables if table["name"] not in step.added]
        if others:
            console.print(f"    re-estimated with it: {', '.join(others)}")
    console.print(f"\nIt ends here: {reason}.", style="bold")
    for line, advice in lines(chosen.diagnosis):
        console.print(line)
        console.print(f"    {advice}")
    if beyond := _implausible(chosen):
        console.print("\nBeyond belief, so that it stands for something else:", style="bold")
        console.print(*(f"    {words}" for words in beyond), sep="\n")
    console.print(
        f"\nThe file to use is {study.folder / f'vehicle-{chosen.number}.toml'}; all others are beside it."
    )


def _implausible(step: Step) -> list[str]:
    """Values that a study has fitted and that lie beyond what physics leaves to them, a sentence each."""
    from hydro.core.effects.catalogue import implausible

    return implausible(step.vehicle, [table["name"] for table in step.tables])


def _print_json(study: Study, steps: Sequence[Step], chosen: Step, reason: str) -> None:
    """The ladder, what each step fitted, and the file to use, for a program."""
    import polars as pl

    from hydro.core.explanation.options import is_stated

    every = pl.concat([step.ladder for step in steps], how="diagonal_relaxed")
    stated = [False, *(is_stated(*both) for both in pairwise(steps))]
    fitted = [
        {"step": step.number, "added": step.added, "stated": sure, "effects": step.tables}
        for step, sure in zip(steps, stated, strict=True)
    ]
    use = study.folder / f"vehicle-{chosen.number}.toml"
    beyond = _implausible(chosen)
    print_json(
        use=str(use), ending=reason, steps=fitted, ladder=every, findings=chosen.diagnosis, implausible=beyond
    )


COMMANDS = {
    explain: "hydro explain datasets/hidden/vehicle.toml datasets/hidden/measured.parquet -o study",
}
