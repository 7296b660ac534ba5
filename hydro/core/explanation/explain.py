"""What is missing, step by step: add the best finding, fit everything anew together, and look again.

Step 0 is the vehicle file as it is given.  Each later step adds the finding that explains most, or where none
is stated what predicts best, refits it with all effects that the file has or was given, and is held against
the recording and against another one that no fit has seen.  The errors of all steps make the ladder
(`explanation.ladder`).  A step that raises the held-out error is the last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import polars as pl

from hydro.core.diagnosis.baseline import LOUD, stable_shots
from hydro.core.diagnosis.diagnose import diagnose_log
from hydro.core.diagnosis.findings import UNEXPLAINED, Diagnosis, extended, suspects
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import names_of
from hydro.core.diagnosis.provisional import Told
from hydro.core.diagnosis.status import status
from hydro.core.errors import DataError
from hydro.core.explanation.ladder import DATASETS, HORIZON, Step, best, left_out_rung, rungs
from hydro.core.explanation.options import is_open, of_change, options
from hydro.core.explanation.trials import Recordings, Trial, bare, best_trial
from hydro.core.prediction.tracking import tracked
from hydro.core.progress import Progress, part, silent
from hydro.core.recording.arrays import recording
from hydro.core.residual.hull import Hull
from hydro.core.vehicle.description import Vehicle

MOST_STEPS = 6
"""The file as given not counted."""
TRIED, COMPARED = 0.2, 0.15
"""Shares of the time of a step for trials and for comparisons, about; the diagnosis takes the rest."""
NO_BETTER = "nothing else that was tried predicts stretches better that it was not fitted to"
Beyond = Callable[[Vehicle, Preprocessed, Diagnosis, Progress], Diagnosis]
"""A diagnosis of a vehicle and a recording, and what lies beyond its catalogue."""


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
    progress: Progress | None = None,
    provisional: Told | None = None,
) -> Iterator[Step]:
    """Add what is missing until nothing more is found.

    Args:
        vehicle: The model.
        raw: Raw table of the measured motion and commands.
        holdout: Another one, which nothing is fitted to.
        hull: What a recording before a change has taught (`diagnosis.diagnose.hull_of`): then what has
            changed since is added, and the hull's law and the file's own values are held.
        done: First steps of the same study that are known already.
        recordings: Both recordings cleaned already, see `explanation.trials`.
        beyond: Looks further where a diagnosis names nothing, see `core.discovery`.
        corrected: Go on where the thrusters contradict the file, with the columns as the audit states them.
        progress: Called with a few words and the share of the present step that is done.
        provisional: Receives the best candidate of the first diagnosis after its first fits.

    Yields:
        Each step that was not done, once it is; `ending` says why the last is the last.

    Raises:
        DataError: A recording or the vehicle is at fault, a recording is too short, or the directions or the
            order of the thrusters contradict the file.
    """
    for recorded in (raw, holdout):
        if recorded is not None:
            long_enough(vehicle, recorded, beside=hull is not None)
    steps = list(done)
    if steps and over(steps):
        return
    recordings = recordings or Recordings.of(vehicle, raw, holdout, hull)
    progress = progress or silent
    if corrected:
        recordings = replace(recordings, log=recordings.log.as_audited())
    elif hull is None:
        recordings.log.require_directions()
    while not (steps and over(steps)):
        step = _next(steps, vehicle, recordings, progress, beyond, None if steps else provisional)
        if step is None:
            return
        steps.append(step)
        yield step


def long_enough(vehicle: Vehicle, raw: pl.DataFrame, *, beside: bool = False) -> None:
    """Hold a recording to what the ladder needs of it, with the model of a hull beside the file or without.

    Raises:
        DataError: It does not fit the vehicle, or no session lasts HORIZON; or, with the model of a hull,
            there are too few shots.
    """
    record = recording(vehicle, raw)
    rows = round(HORIZON / record.dt) + 1
    if (record.segments[:, 1] - record.segments[:, 0]).max() < rows:
        raise DataError(f"no session lasts {HORIZON:g} s without a gap; record longer sessions")
    if beside:
        stable_shots(vehicle, Preprocessed(raw, tracked(vehicle, record), ()))


def ending(steps: Sequence[Step]) -> str:
    """Why no step follows the last of these, in words, once `explain` has ended."""
    return over(steps) or _with_suspects(NO_BETTER, steps[-1])


def over(steps: Sequence[Step]) -> str:
    """The same where the steps themselves say that none follows; empty where one is to be tried."""
    last = steps[-1]
    if best(steps) is not last:
        held_out = not last.ladder.filter(dataset="holdout").is_empty()
        data = "the held-out data" if held_out else "stretches that it was not fitted to"
        return (
            f"step {last.number} predicts {data} worse than step {last.number - 1}, which is the one to use"
        )
    if not (options(last) or is_open(last)):
        known = last.diagnosis.filter(pl.col("verdict").is_in(UNEXPLAINED)).is_empty()
        words = "nothing more has changed" if of_change(last) else "nothing more is found"
        words = words if known else "what is left no effect of the catalogue explains"
        return _with_suspects(words, last)
    return f"{MOST_STEPS} steps are the most" if last.number >= MOST_STEPS else ""


def _with_suspects(words: str, last: Step) -> str:
    """The words, with what is suspected and was not added."""
    fitted = {table["name"] for table in last.tables}
    suspected = ", ".join(name for name in suspects(last.diagnosis) if name not in fitted)
    return f"{words}; only suspected, and not added: {suspected}" if suspected else words


def _next(
    steps: Sequence[Step],
    file: Vehicle,
    recordings: Recordings,
    progress: Progress,
    beyond: Beyond | None,
    provisional: Told | None,
) -> Step | None:
    """The step after these; None where nothing that may be added predicts better."""
    number, log, hull = len(steps), recordings.log, recordings.hull
    first = Trial((), (), file)
    tried = best_trial(steps[-1], file, recordings, part(progress, 0.0, TRIED)) if steps else first
    if tried is None:
        return None
    begin = TRIED if steps else 0.0
    end = begin + COMPARED
    middle = end if recordings.holdout is None else begin + COMPARED / 2.0
    compared = [recordings.compared(tried.vehicle, log, part(progress, begin, middle))]
    if recordings.holdout is not None:
        compared.append(recordings.compared(tried.vehicle, recordings.holdout, part(progress, middle, end)))
    # Standard errors from this recording are no second opinion on it.
    plain = extended(file, [bare(table) for table in tried.tables])
    ladder = [rungs(number, tried.added, *pair) for pair in zip(DATASETS, compared, strict=False)]
    if recordings.holdout is None and hull is None:
        error = recordings.error(recordings.left_out(tried.vehicle, names_of(tried.tables)))
        ladder.append(left_out_rung(ladder[0], error))
    rest = part(progress, end, 0.9 if beyond else 1.0)
    in_vain = bool(steps) and steps[-1].chi2[-1] > LOUD
    diagnosis = diagnose_log(
        plain,
        log,
        hull=hull,
        further=number > 0,
        file=file,
        in_vain=in_vain,
        progress=rest,
        provisional=provisional,
    )
    if beyond is not None:
        diagnosis = beyond(plain, log, diagnosis, part(progress, 0.9, 1.0))
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
        status(diagnosis.findings, plain, log.record.dt, None if hull is None else diagnosis.chi2[-1]),
    )
