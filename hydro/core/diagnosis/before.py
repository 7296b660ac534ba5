"""What has changed between two recordings of one vehicle, whose hull no file describes exactly?

What the hull does beside its file is learnt from the recording before and held fixed in the one after
(`core.residual`), so that a change stands alone.  The file's effects keep their values, and are suspects like
all others.  Residuals are measured against what the model of the hull leaves of stretches of the recording
before that it was not fitted to: below that floor there is nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.diagnosis.baseline import stable_shots
from hydro.core.diagnosis.candidates import Candidate, in_blocks, is_plausible, values_of
from hydro.core.diagnosis.confidence import folds, stated
from hydro.core.diagnosis.contenders import (
    RIGHT,
    Compared,
    Contender,
    answering,
    contend,
    fitted,
    fitted_together,
)
from hydro.core.diagnosis.findings import SURE, Diagnosis, Finding, extended, no_surer
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.misread import misread, newly_misread
from hydro.core.diagnosis.model import Diverges, Model
from hydro.core.effects import CATALOGUE
from hydro.core.evaluation.block_resampling import weights
from hydro.core.experiment import advice
from hydro.core.identification.outcome import Fit
from hydro.core.identification.prior import greatest_change
from hydro.core.prediction.output_error import OutputError
from hydro.core.preprocessing.sensor_tests import kinematic_tests
from hydro.core.progress import Progress, part
from hydro.core.residual.hull import Hull
from hydro.core.residual.imitation import imitations, pulls, widened
from hydro.core.vehicle.description import Vehicle

NAMED = 0.10
"""Share of the residual left out that a change must remove to be named,"""
LEAST = 0.06
"""Share of the floor that it must remove besides,"""
FURTHER = 0.20
"""and a further change, of the residual after the first or of the floor where that is greater."""
RESAMPLES = 2000
MOST_CHANGES = 3
CHANCE = 0.03
"""Mean margin by which the best candidate is ahead by chance, in floors: by the error of the hull model,"""
UNKNOWN = 0.3
"""by the residual that remains, for each floor beyond one, which any rival may explain,"""
INEXACT = 0.01
"""and by errors in the formulas of changes found before, for each floor that these removed."""
TIED = 0.02
"""Part of the resamples that a rival must win to be told beside the best."""


def diagnose_change(
    vehicle: Vehicle,
    log: Preprocessed,
    problem: OutputError,
    hull: Hull,
    progress: Progress,
    further: bool = False,
) -> Diagnosis:
    """Find what has changed: what the velocity log misreads as kinematics shows it, then what forces do.

    Args:
        vehicle: The file.
        log: The recording after.
        problem: Its shots.
        hull: What the recording before has taught.
        progress: Called with a few words and the share of the work done.
        further: Whether the vehicle has changes already, so that more is asked of the next one.
    """
    given = Compared.of(log, problem, hull, vehicle)
    errors = newly_misread(log.sensors, kinematic_tests(hull.unchanged.shots.record), vehicle)
    if not errors:
        return told(*given, find(*given, progress, further), further)
    read = extended(vehicle, [one.table for one in errors])
    compared, first = Compared.of(log, stable_shots(read, log), hull, read)
    names = [one.effect for one in errors]
    found = told(compared, first, find(compared, first, progress, further, names), further)
    alone = given[0].chi2(given[1])
    share = 1.0 - compared.chi2(first) / alone
    misreadings = [misread(one, share, log.record.dt, vehicle) for one in errors]
    rest = [one for one in found.findings if one.verdict not in ("nothing_missing", "log_fault")]
    return replace(found, findings=(*log.faults, *misreadings, *rest), chi2=(alone, alone, found.chi2[2]))


@dataclass(frozen=True)
class Change:
    """A change that was found.

    Attributes:
        best: The effect that is it.
        rivals: All that were fitted, by effect.
        whole: Squared residual of each shot without it, (S,).
        floor: What the model of the hull leaves of all of them.
    """

    best: Contender
    rivals: Mapping[str, Contender]
    whole: Array
    floor: float

    @classmethod
    def of(cls, compared: Compared, last: Model, rivals: Mapping[str, Contender]) -> Change | None:
        """The best of the rivals; None of none."""
        whole = compared.left_out(last.normal.of([]))
        if not rivals:
            return None
        first = cls(next(iter(rivals.values())), rivals, whole, compared.floor(last))
        return replace(first, best=min(rivals.values(), key=first.fined))

    def fine(self, rival: Contender) -> float:
        """What a rival must remove for its parameters and for what it absorbs of a hull."""
        return rival.fine(self.rivals.values(), float(self.whole.sum()), self.floor)

    def fined(self, rival: Contender) -> float:
        """What a rival leaves, with its fine: by it they are put in order."""
        return rival.left + self.fine(rival)

    @property
    def score(self) -> float:
        """Share of the squared residual left out that the best removes."""
        return float(1.0 - self.best.left / self.whole.sum())

    @property
    def margin(self) -> float:
        """Return how far the best is ahead of the next, or of no change, each with its fine, in floors."""
        others = [self.fined(one) for one in self.rivals.values() if one.effect != self.best.effect]
        return float(min([*others, self.whole.sum()]) - self.fined(self.best)) / self.floor

    @property
    def plain(self) -> float:
        """What it removes, as a share of what there is or of the floor where that is greater."""
        whole = float(self.whole.sum())
        return self.score * whole / max(whole, self.floor)

    def confidence(self, given: float) -> float:
        """Return the probability that the best candidate is the change.

        It is the part of the resampled recordings in which it wins, times the probability that its margin
        does not come about by chance.  Such margins have an exponential distribution.

        Args:
            given: Squared residual of the file as given, in floors.
        """
        beyond = max(self.best.left / self.floor - 1.0, 0.0)
        removed = max(given - float(self.whole.sum()) / self.floor, 0.0)
        by_chance = CHANCE + UNKNOWN * beyond + INEXACT * removed
        return self.wins()[self.best.effect] * -math.expm1(-max(self.margin, 0.0) / by_chance)

    def seen(self, further: bool) -> bool:
        """Whether it is large enough to be named, as the first or a further one."""
        if further:  # what a formula of drag absorbs of an unchanged hull is no further change
            return self.plain >= max(FURTHER, CATALOGUE[self.best.effect].identification.absorbs)
        return self.score >= NAMED and self.score * float(self.whole.sum()) >= LEAST * self.floor

    def interval(self, seed: int = 1) -> tuple[float, float]:
        """95 % interval of the score."""
        both = np.column_stack([self.whole - self.best.costs, self.whole])
        drawn = weights(len(both), RESAMPLES, seed) @ both
        low, high = np.quantile(drawn[:, 0] / drawn[:, 1], [0.025, 0.975])
        return float(min(low, self.score)), float(max(high, self.score))

    def wins(self, seed: int = 0) -> dict[str, float]:
        """Part of the resampled recordings in which each rival is the best, the most frequent first."""
        names = list(self.rivals)
        fine = np.array([self.fine(self.rivals[name]) for name in names])
        costs = np.stack([self.rivals[name].costs for name in names], axis=1) + fine / len(self.whole)
        drawn = weights(len(costs), RESAMPLES, seed) @ costs
        part = np.bincount(drawn.argmin(axis=1), minlength=len(names)) / RESAMPLES
        order = np.argsort(-part, kind="stable")
        return {names[i]: float(part[i]) for i in order}


@dataclass(frozen=True)
class Changes:
    """Result of the search for changes.

    Attributes:
        found: The changes, the greatest first.
        refused: The best candidate of the last step, where it was too small to be named; None otherwise.
    """

    found: tuple[Change, ...]
    refused: Change | None = None


def find(
    compared: Compared,
    first: Model,
    progress: Progress,
    further: bool = False,
    without: Sequence[str] = (),
) -> Changes:
    """Find the changes, the greatest first.

    Args:
        compared: The recording after.
        first: The vehicle as its file is.
        progress: Called with a few words and the share of the work done.
        further: Whether the vehicle has changes already, so that more is asked of the next one.
        without: Effects that are not to be tried.
    """
    last, changes, refused = first, list[Change](), None
    while len(changes) < MOST_CHANGES and not ((further or changes) and compared.chi2(last) <= 1.0):
        here = part(progress, 0.3 + 0.2 * len(changes), 0.5 + 0.2 * len(changes))
        here(f"{len(changes)} changes found, looking for more", 0.0)
        rivals = contend(compared, last, [*without, *(one.best.effect for one in changes)], here)
        change = Change.of(compared, last, rivals)
        if change is None or not change.seen(further=further or bool(changes)):
            refused = change
            break
        changes = reconsidered(compared, first, [*changes, change])
        last = changes[-1].best.model
    return Changes(tuple(changes), refused)


def reconsidered(compared: Compared, first: Model, changes: list[Change]) -> list[Change]:
    """The changes; the second alone where, fitted without the first, it is the better of the two.

    An effect that only its own fit shows, as a threshold does, may come to light beside a poorer one first.
    """
    if len(changes) != 2:
        return changes
    before, name = changes[0], changes[1].best.effect
    (table,) = changes[1].best.model.vehicle.effects(name)
    try:
        alone = fitted(compared, first, table)
    except (Diverges, np.linalg.LinAlgError):
        return changes
    if before.fined(alone) >= before.fined(before.best):
        return changes
    return [replace(before, best=alone, rivals={**before.rivals, name: alone})]


def told(compared: Compared, first: Model, those: Changes, further: bool = False) -> Diagnosis:
    """Return the findings; chi2 are in units of what the model of the hull leaves."""
    given, changes = compared.chi2(first), those.found
    tried = tuple(_candidates(compared, first, those))
    if not changes:
        words = (
            f"nothing {'more ' * further}has changed beyond what the model of the hull leaves: mean squared "
            f"residual {given:.3g} of that"
        )
        nothing = Finding("nothing_missing", advice=words)
        return Diagnosis(
            (*compared.log.faults, nothing), first.vehicle, (given, given, given), candidates=tried
        )
    left = [given, *(compared.chi2(change.best.model) for change in changes)]
    findings = [_finding(change, first.vehicle, compared, given, left[-1]) for change in changes]
    return Diagnosis(
        (*compared.log.faults, *findings),
        changes[-1].best.model.vehicle,
        (given, given, left[-1]),
        candidates=tried,
    )


def _candidates(compared: Compared, first: Model, those: Changes) -> Iterator[Candidate]:
    """Yield every candidate change, and the model without any at each step."""
    last = first
    for step, change in enumerate([*those.found, *([those.refused] if those.refused else [])]):
        taken = step < len(those.found)
        yield _candidate(compared, step, "", not taken, change, Contender("", last, change.whole), first)
        for name, rival in change.rivals.items():
            chosen = taken and name == change.best.effect
            yield _candidate(compared, step, name, chosen, change, rival, first)
        last = change.best.model


def _candidate(
    compared: Compared, step: int, name: str, chosen: bool, change: Change, rival: Contender, first: Model
) -> Candidate:
    """Return one candidate change, or the model without any for an empty name."""
    vehicle = rival.model.vehicle
    return Candidate(
        "change",
        step,
        name,
        chosen,
        len(rival.model.values),
        len(rival.costs),
        in_blocks(rival.costs),
        compared.chi2(rival.model),
        change.floor,
        left_out=float(1.0 - rival.left / change.whole.sum()),
        own=bool(name) and bool(first.vehicle.effects(name)),
        absorbs=CATALOGUE[name].identification.absorbs if name else 0.0,
        plausible=not name or is_plausible(vehicle, name),
        values=values_of(vehicle, name) if name else {},
    )


def _finding(change: Change, file: Vehicle, compared: Compared, given: float, left: float) -> Finding:
    """A change as a finding.

    Args:
        change: The change.
        file: The file.
        compared: The recordings.
        given: What the file as given leaves, in units of the floor.
        left: What all changes leave, likewise.
    """
    name, wins, model = change.best.effect, change.wins(), change.best.model
    unchanged = compared.unchanged
    hulls = imitations(unchanged, file, model.unknown, model.values, folds(unchanged.shots.session))
    fit = widened(model.estimated(), hulls, pulls(model.normal, model.unknown, compared.fold))
    parameters, errors = fit.table(name)
    words = f"it removes {change.score:.0%} of the residual of stretches that it was not fitted to"
    rivals = [f"{other} ({part:.0%})" for other, part in wins.items() if other != name and part >= TIED]
    if rivals:
        words += f"; some of the recording would rather have {', '.join(rivals)}"
    if left > RIGHT:
        words += f"; {left:.3g} times the squared residual of before is left, which nothing here explains"
    known = bool(file.effects(name))
    if known:
        entries = [entry for entry in model.unknown.entries if entry.effect == name]
        words = f"{advice.having_changed(name, greatest_change(file, entries, model.values))}; {words}"
    else:
        words = f"{advice.adding(name, parameters, compared.log.record.dt)}; {words}"
    sure = no_surer(change.confidence(given), fit.vehicle, name, errors if left <= RIGHT else None)
    found = Finding(
        "retune" if known else "missing",
        name,
        (name,),
        change.score,
        *change.interval(),
        confidence=sure,
        parameters=parameters,
        standard_errors=errors,
        advice=words,
        support=wins[name],
    )
    if known and found.confidence < SURE:
        return replace(found, verdict="suspect", advice=advice.suspecting(name, found.advice))
    return stated(found)


def fit_changes(file: Vehicle, log: Preprocessed, hull: Hull, changes: Sequence[Mapping[str, Any]]) -> Fit:
    """Changes of a file fitted together, with all else of the file and the hull's share held.

    Args:
        file: The file as given.
        log: The recording after.
        hull: What the recording before has taught.
        changes: `[[effect]]` tables with the values to begin from.

    Raises:
        DataError: The recording is too short, or the predictions diverge.
    """
    compared, first = Compared.of(log, stable_shots(file, log), hull, file)
    model = answering(compared, first, fitted_together(compared, first, changes))
    return model.estimated()
