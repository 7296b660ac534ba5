"""Command `explain`: add missing effects step by step, and show the errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.answers import AsText, Details, Printing, print_lines
from hydro.commands.as_json import Json, print_json
from hydro.commands.before import Before, Discover, Network, learnt
from hydro.commands.diagnose import CorrectThrusters, print_findings
from hydro.commands.help import ADVANCED
from hydro.commands.places import STUDY
from hydro.commands.recordings import Definitions, Logs, MapFile, MaxExpanded, Measured, called
from hydro.commands.shell import (
    Known,
    ModelFile,
    about,
    expected_seconds,
    message,
    progress,
    tell_changes,
    tell_duration,
    tell_not_shown,
    tell_provisional,
    vehicle_to_fit,
)
from hydro.commands.tables import print_table
from hydro.core.errors import DataError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from hydro.core.explanation.ladder import Step
    from hydro.core.explanation.trials import Recordings
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.study import Study
    from hydro.io.table import Artefact
    from hydro.report.study import Outcome


def explain(
    vehicle: ModelFile,
    folder: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", help="Folder for the study."),
        STUDY,
    ],
    measured: Measured = None,
    holdout: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RAW",
            show_default=False,
            help="Held-out recording: nothing is fitted to it.",
        ),
    ] = None,
    known: Known = None,
    before: Before = None,
    map_: MapFile = None,
    details: Details = False,
    as_text: AsText = False,
    as_json: Json = False,
    model: Network = None,
    discover: Discover = False,
    correct_thrusters: CorrectThrusters = False,
    add: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT",
            show_default=False,
            help="Finding that the next step adds, or best; repeat for more steps.",
            rich_help_panel=ADVANCED,
        ),
    ] = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
) -> None:
    r"""Find missing effects, add them one by one and show the errors.

    Step 0 is the vehicle file as given. Each step adds the effect that explains most, re-estimates all
    effects together, and measures the error on held-out data. It ends when nothing more is found, or when a
    step raises that error.

        hydro explain vehicle.toml raw.parquet --holdout other.parquet -o study
        hydro explain vehicle.toml after.parquet --before before.parquet \
          -o study

    The second command adds changes since another recording. An interrupted study resumes
    where it stopped.

    Details:

    The thrusters are audited first, as by hydro check VEHICLE LOG. If their directions or the order of the
    columns contradict the file, nothing is added.

    A confirmed finding (confidence of 90 % or more) makes a step. Without one, unconfirmed findings and other
    candidate effects of the catalogue are tried, if a finding has a confidence of 50 % or more or no model
    comes near the noise. The one with the best predictions 5 s ahead, on data that its fit leaves out, is
    added if it lowers their error by 2 % or more. Such a step is unconfirmed: it predicts better, but its
    name may be wrong. A study has six steps at most. Without --holdout, parts of the recording are left out
    of the fit instead.

    DIR gets comparison-K.parquet, diagnosis-K.parquet, vehicle-K.toml and vehicle-K.covariance.parquet of
    every step K, and ladder.parquet with the errors of all. For the first and the best step it gets
    replay.parquet (measured and predicted motion) and leftover.parquet (unexplained force against velocity).
    For the best step it gets growth.parquet (powers of velocity by which the water force grows) and
    bands.parquet (95 % bands of predictions). sessions.parquet lists the recordings. Another study in the
    same folder replaces it.

    With --before a hull-force model is fitted to the recording before the change. The model and the file's
    own values are held fixed. A step adds a change with a confidence of 50 % or more, a confirmed one
    first, and refits it together with earlier changes. Errors are in units of the error of the hull-force
    model on parts of the first recording that it was not fitted to. --holdout is then a recording of the
    changed vehicle.

    With --add the steps add the findings that it names, in this order, without a comparison with others; the
    study ends after the last of them. The workbench (hydro app) adds findings in this way.

        hydro explain vehicle.toml raw.parquet --add ocean_current \
          --add best -o study

    With --discover a step adds a formula of sparse terms if no effect is confirmed. The formula must reduce
    the error on regimes of motion that it was not fitted to; see hydro diagnose.

        hydro explain vehicle.toml raw.parquet --discover -o study
    """
    from hydro.core.discovery.discover import discovered
    from hydro.core.explanation.explain import ending
    from hydro.core.explanation.explain import explain as compute
    from hydro.core.explanation.ladder import best
    from hydro.core.explanation.status import corrections, study_status
    from hydro.core.explanation.trials import Recordings
    from hydro.io.study import Study
    from hydro.report.study import Outcome, answer
    from hydro.study.explained import save_bands, save_recorded

    printing = Printing(str(folder), as_text, as_json)
    logs, name = Logs(map_, msg, vehicle), called(measured)
    source = logs.read(measured)
    start, text = vehicle_to_fit(vehicle, known, source)
    other = _held_out(holdout, logs, source, start, beside=bool(before)) if holdout else None
    with about(name):
        tell_not_shown(start, source.frame)
        expected = None if before else expected_seconds(source.frame, steps=True)
        tell_duration(source.frame, expected, steps=True)
    earlier = learnt(before, model, start, source, logs, discover=discover)
    frame, hull = None if other is None else other.frame, earlier.hull if earlier else None
    with about(name):
        recordings = Recordings.of(start, source.frame, frame, hull)
        if hull is None and not correct_thrusters:
            recordings.log.require_directions(str(vehicle))
    changes = tell_changes(name, recordings.log.changes)
    if recordings.holdout is not None:
        held_out = tell_changes(called(holdout), recordings.holdout.changes)
        changes |= {f"{key}_holdout": lines for key, lines in held_out.items()}
    told = earlier.parameters if earlier else {"discover": True} if discover else {}
    inputs = earlier.inputs if earlier else ()
    wanted = add or ()
    told = told | ({"add": list(wanted)} if wanted else {})
    study = Study(folder, text, source, other, inputs, told | changes)
    steps = study.done()
    if study.clear(steps) and not steps:
        typer.echo(f"hydro: {folder}: the files of another study there are replaced", err=True)
    for number in range(len(steps)):
        _tell(steps[: number + 1], "already done")
    with about(name), progress("explain", expected) as update:

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
            wanted=wanted,
            progress=advance,
            provisional=tell_provisional(expected, of_change=bool(before)),
        )
        for found_step in () if study.has_ended(steps) else found:
            steps.append(found_step)
            study.save_step(steps)
            _tell(steps)
        dt = recordings.log.record.dt
        headline = study_status(steps, best(steps), dt, hull).headline
        study.end(steps, ending(steps, wanted), headline)
        update(0, 0, "files of the study")
        save_recorded(study, {step.number: step.vehicle for step in (steps[0], best(steps))}, recordings.log)
        if why := save_bands(study, best(steps)):
            message(f"hydro: no bands: {why}")
    outcome = Outcome(
        steps,
        best(steps),
        headline,
        ending(steps, wanted),
        folder,
        corrections(steps, best(steps), dt, hull),
    )
    print_lines(answer(outcome, printing.console.width), printing.console)
    if details:
        _print_details(study, outcome, recordings, printing.console)
    if as_json:
        _print_json(outcome)


def _held_out(holdout: list[str], logs: Logs, source: Artefact, known: Vehicle, *, beside: bool) -> Artefact:
    """Read the held-out recording.

    Args:
        holdout: Arguments of --holdout.
        logs: Settings for reading the recording.
        source: Recording to which effects are fitted.
        known: Vehicle of the file.
        beside: Whether a recording from before a change is given as well.

    Raises:
        DataError: It has the same rows as the other recording, is too short, or is another vehicle's.
    """
    from hydro.core.explanation.explain import long_enough

    other, name = logs.read(holdout), called(holdout)
    if other.provenance.content == source.provenance.content:
        raise DataError(f"{name}: the same rows as the measured recording; hold other sessions out")
    with about(name):
        long_enough(known, other.frame, beside=beside)
    return other


def _tell(steps: Sequence[Step], remark: str = "") -> None:
    """Print a line on the last of the steps so far, with a remark in brackets, as soon as it is done."""
    from hydro.core.explanation.status import added
    from hydro.report.study import step_line

    line = step_line(steps[-1], added(steps[-2:]))
    message(f"step {line} ({remark})" if remark else f"step {line}")


def _print_details(study: Study, outcome: Outcome, recordings: Recordings, console: Console) -> None:
    """Print the errors of all steps, the values that they added, and the last diagnosis."""
    from hydro.core.explanation.ladder import DATASETS
    from hydro.report import change, ladder, yardsticks

    rungs = outcome.rungs
    for dataset in DATASETS:
        if not rungs.filter(dataset=dataset).is_empty():
            print_table(ladder.errors(rungs, dataset), ladder.title(rungs, dataset), console)
    simple = yardsticks.of_ladder(rungs, outcome.chosen.number, yardsticks.judged_on(rungs))
    for line in yardsticks.explained(simple, recordings.yardstick, recordings.log.record):
        console.print(line)
    if recordings.holdout is not None:
        both = recordings.log.observed, recordings.holdout.observed
        for line in yardsticks.unlearnt(simple, recordings.yardstick.vehicle, *both):
            console.print(line)
    if change.PARAMETER in study.parameters:
        console.print(f"\n{change.learnt(study.parameters[change.PARAMETER])}", *change.fall(rungs), sep="\n")
    for step in outcome.steps[1:]:
        console.print(f"\nStep {step.number}", style="bold")
        for table in step.tables:
            if table["name"] in step.added:
                console.print(f"    {table['name']}", *ladder.values(table), sep="\n        ", soft_wrap=True)
        others = [table["name"] for table in step.tables if table["name"] not in step.added]
        if others:
            console.print(f"    re-estimated with it: {', '.join(others)}")
    if beyond := outcome.beyond:
        console.print("\nNot plausible:", *beyond, sep="\n    ")
    console.print(f"\nDiagnosis of step {outcome.chosen.number}", style="bold")
    print_findings(outcome.chosen.diagnosis, console)


def _print_json(outcome: Outcome) -> None:
    """Print the ladder, the fitted values of each step, and the file to use as JSON."""
    from hydro.core.explanation.status import added

    confirmed = added(outcome.steps)
    fitted = [
        {
            "step": step.number,
            "added": step.added,
            "stated": bool(step.added) and all(confirmed[name] for name in step.added),
            "effects": step.tables,
        }
        for step in outcome.steps
    ]
    print_json(
        headline=outcome.headline,
        use=str(outcome.file),
        ending=outcome.reason,
        steps=fitted,
        ladder=outcome.rungs,
        findings=outcome.chosen.diagnosis,
        implausible=outcome.beyond,
    )


COMMANDS = {
    explain: "hydro explain datasets/hidden/vehicle.toml datasets/hidden/measured.parquet -o study",
}
