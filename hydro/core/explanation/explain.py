"""Stepwise completion of a vehicle file: add the best finding, refit everything together, and diagnose again.

Step 0 is the vehicle file as given.  Each later step adds the finding that explains most, or without a
confirmed finding the candidate with the best held-out prediction.  All existing and added effects are then
refitted. The step is compared with the recording, and with a held-out one that no fit used.  The errors of
all steps form the ladder (`explanation.ladder`).  A step that raises the held-out error is the last.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import polars as pl

from hydro.core.diagnosis.baseline import stable_shots
from hydro.core.diagnosis.findings import UNEXPLAINED, extended, suspects
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import names_of
from hydro.core.diagnosis.pipeline import Beyond, diagnose_log
from hydro.core.diagnosis.provisional import Told
from hydro.core.diagnosis.settings import FAR_FROM_NOISE, MOST_STEPS
from hydro.core.errors import DataError
from hydro.core.explanation.ladder import DATASETS, HORIZON, Step, best, left_out_rung, rungs
from hydro.core.explanation.options import is_open, of_change, options
from hydro.core.explanation.trials import Recordings, Trial, bare, best_trial, chosen_trial
from hydro.core.prediction.tracking import tracked
from hydro.core.progress import Progress, part, silent
from hydro.core.recording.arrays import recording
from hydro.core.residual.hull import Hull
from hydro.core.vehicle.description import Vehicle

TRIED, COMPARED = 0.2, 0.15
"""Approximate shares of the time of a step for trials and for comparisons; the diagnosis takes the rest."""
BEST = "best"
"""Word for the best finding in a list of wanted effects."""
NO_BETTER = "no other candidate lowers the held-out prediction error"


def explain(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    holdout: pl.DataFrame | None = None,
    hull: Hull | None = None,
    done: Sequence[Step] = (),
    beyond: Beyond | None = None,
    recordings: Recordings | None = None,
    corrected: bool = False,
    wanted: Sequence[str] = (),
    progress: Progress | None = None,
    provisional: Told | None = None,
) -> Iterator[Step]:
    """Add missing effects step by step until nothing is found.

    Args:
        vehicle: Vehicle file.
        raw: Raw table of the measured motion and commands.
        holdout: Raw table of a held-out recording, which no fit uses.
        hull: Hull-force model from a recording before a change (`diagnosis.pipeline.hull_of`).  Changes since
            then are added, with the hull-force model and the file's values held fixed.
        done: First steps of the same study, if known already.
        beyond: Function that extends a diagnosis without a finding beyond the catalogue.
        recordings: Both recordings, if preprocessed already; None to preprocess `raw` and `holdout`.
        corrected: Continue where the thrusters contradict the file, with the command columns assigned and
            signed as the audit of the log found them.
        wanted: Effect to add in each step, in this order; BEST stands for the best finding.  The study ends
            after the last.  Empty: each step adds the best finding until nothing is found.
        progress: Called with a short text and the share of the present step that is done.
        provisional: Called with the best candidate of the first diagnosis after its first fits.

    Yields:
        Each new step, once it is done; `ending` returns the reason why no other follows.

    Raises:
        DataError: A recording or the vehicle is at fault, a recording is too short, or the directions or the
            order of the thrusters contradict the file.
    """
    for recorded in (raw, holdout):
        if recorded is not None:
            long_enough(vehicle, recorded, beside=hull is not None)
    steps = list(done)
    if _ended(steps, wanted):
        return
    recordings = recordings or Recordings.of(vehicle, raw, holdout, hull)
    progress = progress or silent
    if corrected:
        recordings = replace(recordings, log=recordings.log.as_audited())
    elif hull is None:
        recordings.log.require_directions()
    while not _ended(steps, wanted):
        effect = wanted[len(steps) - 1] if steps and wanted else BEST
        step = next_step(steps, vehicle, recordings, effect, progress, beyond, None if steps else provisional)
        if step is None:
            return
        steps.append(step)
        yield step


def _ended(steps: Sequence[Step], wanted: Sequence[str]) -> bool:
    """Return whether the study is over: all wanted findings are added, or the last step excludes another."""
    if wanted:
        return len(steps) > min(len(wanted), MOST_STEPS)
    return bool(steps and over(steps))


def long_enough(vehicle: Vehicle, raw: pl.DataFrame, *, beside: bool = False) -> None:
    """Check that a recording is long enough for the predictions of a study.

    With a hull-force model (`beside`) a minimum number of shots is needed as well.

    Raises:
        DataError: The recording does not fit the vehicle, no session lasts HORIZON, or, with `beside`, there
            are too few shots.
    """
    record = recording(vehicle, raw)
    rows = round(HORIZON / record.dt) + 1
    if (record.segments[:, 1] - record.segments[:, 0]).max() < rows:
        raise DataError(f"no session lasts {HORIZON:g} s without a gap; record longer sessions")
    if beside:
        stable_shots(vehicle, Preprocessed(raw, tracked(vehicle, record), ()))


def ending(steps: Sequence[Step], wanted: Sequence[str] = ()) -> str:
    """Return the reason why a study has no further step, once `explain` has ended."""
    if wanted:
        return "all requested findings are added"
    return over(steps) or _with_suspects(NO_BETTER, steps[-1])


def over(steps: Sequence[Step]) -> str:
    """Return in words why a study ends with its last step; empty if another step is to be tried."""
    last = steps[-1]
    if best(steps) is not last:
        held_out = not last.ladder.filter(dataset="holdout").is_empty()
        data = "the held-out data" if held_out else "held-out stretches"
        return (
            f"step {last.number} predicts {data} worse than step {last.number - 1}, which is the one to use"
        )
    if not (options(last) or is_open(last)):
        words = "nothing more has changed" if of_change(last) else "nothing more is found"
        if any(one.verdict in UNEXPLAINED for one in last.findings):
            words = "no effect of the catalogue explains the remaining error"
        return _with_suspects(words, last)
    return f"{MOST_STEPS} steps are the limit" if last.number >= MOST_STEPS else ""


def _with_suspects(words: str, last: Step) -> str:
    """Return a reason for the end of a study, extended by the unconfirmed effects that were not added."""
    fitted = {table["name"] for table in last.tables}
    suspected = ", ".join(name for name in suspects(last.diagnosis) if name not in fitted)
    return f"{words}; unconfirmed, and not added: {suspected}" if suspected else words


def next_step(
    steps: Sequence[Step],
    file: Vehicle,
    recordings: Recordings,
    wanted: str = BEST,
    progress: Progress = silent,
    beyond: Beyond | None = None,
    provisional: Told | None = None,
) -> Step | None:
    """Return the next step of a study; None if no candidate predicts better than the last step.

    Args:
        steps: Steps so far; without any, the next one compares and diagnoses the file as given.
        file: Vehicle file of step 0.
        recordings: Both recordings.
        wanted: Effect of the finding to add, or BEST.
        progress: Called with a short text and the share of the step that is done.
        beyond: Function that extends a diagnosis without a finding beyond the catalogue.
        provisional: Called with the best candidate of the diagnosis after its first fits.

    Raises:
        DataError: The last diagnosis has no values for the wanted effect, or a fit diverges.
    """
    number, log, hull = len(steps), recordings.log, recordings.hull
    first = Trial((), (), file)
    tried: Trial | None = first
    if steps and wanted != BEST:
        progress("joint fit", 0.0)
        tried = chosen_trial(steps[-1], wanted, file, recordings)
    elif steps:
        tried = best_trial(steps[-1], file, recordings, part(progress, 0.0, TRIED))
    if tried is None:
        return None
    begin = TRIED if steps else 0.0
    end = begin + COMPARED
    middle = end if recordings.holdout is None else begin + COMPARED / 2.0
    compared = [recordings.compared(tried.vehicle, log, part(progress, begin, middle))]
    if recordings.holdout is not None:
        compared.append(recordings.compared(tried.vehicle, recordings.holdout, part(progress, middle, end)))
    # Standard errors from this recording are not independent evidence about it.
    plain = extended(file, [bare(table) for table in tried.tables])
    ladder = [rungs(number, tried.added, *pair) for pair in zip(DATASETS, compared, strict=False)]
    if recordings.holdout is None and hull is None:
        error = recordings.error(recordings.left_out(tried.vehicle, names_of(tried.tables)))
        ladder.append(left_out_rung(ladder[0], error))
    in_vain = bool(steps) and steps[-1].chi2[-1] > FAR_FROM_NOISE
    diagnosis = diagnose_log(
        plain,
        log,
        hull=hull,
        further=number > 0,
        file=file,
        in_vain=in_vain,
        beyond=beyond,
        progress=part(progress, end, 1.0),
        provisional=provisional,
    )
    return Step(
        number,
        tried.added,
        tried.tables,
        tried.vehicle,
        compared[0],
        diagnosis.frame(),
        diagnosis.chi2,
        pl.concat(ladder, how="diagonal_relaxed"),
        tried.estimates,
        diagnosis.status,
    )
