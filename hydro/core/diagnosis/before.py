"""Changes between two recordings of one vehicle whose hull no file describes exactly.

The hull-force error of the file is learnt from the earlier recording and held fixed in the later one
(`core.residual`), so that only the change remains.  The file's effects keep their values; a
change of them is a candidate like any other.  The unit of all residuals is the floor: the residual of the
hull model on held-out stretches of the earlier recording.  Nothing below it is visible.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.diagnosis.baseline import stable_shots
from hydro.core.diagnosis.candidates import Candidate, in_blocks, is_plausible, values_of
from hydro.core.diagnosis.confidence import folds, led, stated
from hydro.core.diagnosis.contenders import (
    Compared,
    Contender,
    contend,
    fitted,
    fitted_together,
    with_hull_response,
)
from hydro.core.diagnosis.findings import Diagnosis, Finding, extended, limited_confidence
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Diverges, Model
from hydro.core.diagnosis.sensor_errors import new_sensor_errors, sensor_finding
from hydro.core.diagnosis.settings import (
    ALPHA,
    CHANCE,
    CHANGED,
    FURTHER,
    MATERIAL,
    MOST_FINDINGS,
    RESAMPLES,
    RIGHT,
    SURE,
    UNKNOWN,
)
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


def diagnose_change(
    vehicle: Vehicle,
    log: Preprocessed,
    problem: OutputError,
    hull: Hull,
    progress: Progress,
    further: bool = False,
) -> Diagnosis:
    """Find the changes: sensor errors that kinematics shows first, then changes of the forces.

    Args:
        vehicle: Vehicle file.
        log: Recording after the change.
        problem: Shots of that recording.
        hull: Hull-force model learnt from the earlier recording.
        progress: Called with a short text and the share of the work done.
        further: Whether the vehicle has changes already, so that the next one must be larger.
    """
    given = Compared.of(log, problem, hull, vehicle)
    errors = new_sensor_errors(log.sensors, kinematic_tests(hull.unchanged.shots.record), vehicle)
    if not errors:
        return as_diagnosis(*given, find(*given, progress, further), further)
    read = extended(vehicle, [one.table for one in errors])
    compared, first = Compared.of(log, stable_shots(read, log), hull, read)
    names = [one.effect for one in errors]
    found = as_diagnosis(compared, first, find(compared, first, progress, further, names), further)
    alone = given[0].chi2(given[1])
    share = 1.0 - compared.chi2(first) / alone
    sensor_findings = [sensor_finding(one, share, log.record.dt, vehicle) for one in errors]
    rest = [one for one in found.findings if one.verdict not in ("nothing_missing", "log_fault")]
    return replace(found, findings=(*log.faults, *sensor_findings, *rest), chi2=(alone, alone, found.chi2[2]))


@dataclass(frozen=True)
class Change:
    """One step of the search for changes.

    Attributes:
        best: Chosen effect.
        rivals: All fitted candidates, by effect.
        whole: Held-out squared residual of each shot without a further change, (S,).
        floor: Squared residual of all shots at the floor of the hull model.
    """

    best: Contender
    rivals: Mapping[str, Contender]
    whole: Array
    floor: float

    @classmethod
    def of(cls, compared: Compared, last: Model, rivals: Mapping[str, Contender]) -> Change | None:
        """Return the change with the best of the rivals; None if there are no rivals."""
        whole = compared.left_out(last.normal.of([]))
        if not rivals:
            return None
        first = cls(next(iter(rivals.values())), rivals, whole, compared.floor(last))
        return replace(first, best=min(rivals.values(), key=first.penalised))

    def penalty(self, rival: Contender) -> float:
        """Return a rival's penalty for its parameters and for the hull-force error that it absorbs."""
        return rival.penalty(self.rivals.values(), float(self.whole.sum()), self.floor)

    def penalised(self, rival: Contender) -> float:
        """Return a rival's held-out cost with its penalty, by which rivals are ranked."""
        return rival.left + self.penalty(rival)

    @property
    def score(self) -> float:
        """Share of the held-out squared residual that the best candidate removes."""
        return float(1.0 - self.best.left / self.whole.sum())

    @property
    def margin(self) -> float:
        """Lead of the best over the next candidate, or over no change, in penalised cost and floors."""
        others = [self.penalised(one) for one in self.rivals.values() if one.effect != self.best.effect]
        return float(min([*others, self.whole.sum()]) - self.penalised(self.best)) / self.floor

    @property
    def relative_gain(self) -> float:
        """Removed residual, as a share of the greater of the residual and the floor."""
        whole = float(self.whole.sum())
        return self.score * whole / max(whole, self.floor)

    def confidence(self, given: float) -> float:
        """Return the probability that the best candidate is the change.

        It is the share of the resamples that the candidate wins, times the probability that its lead is not
        due to chance (`led`).

        Args:
            given: Squared residual of the file as given, in floors.
        """
        beyond = max(self.best.left / self.floor - 1.0, 0.0)
        removed = max(given - float(self.whole.sum()) / self.floor, 0.0)
        by_chance = CHANCE * (1.0 + removed) + UNKNOWN * beyond
        return self.wins()[self.best.effect] * led(self.margin, by_chance)

    def seen(self, further: bool) -> bool:
        """Return whether the change is large enough to be named, as the first or a further one."""
        if further:  # a drag law that absorbs the error of an unchanged hull is not a further change
            return self.relative_gain >= max(FURTHER, CATALOGUE[self.best.effect].identification.absorbs)
        return self.score >= CHANGED and self.score * float(self.whole.sum()) >= MATERIAL * self.floor

    def interval(self, seed: int = 1) -> tuple[float, float]:
        """Return the 95 % interval of the score."""
        both = np.column_stack([self.whole - self.best.costs, self.whole])
        drawn = weights(len(both), RESAMPLES, seed) @ both
        low, high = np.quantile(drawn[:, 0] / drawn[:, 1], [0.025, 0.975])
        return float(min(low, self.score)), float(max(high, self.score))

    def wins(self, seed: int = 0) -> dict[str, float]:
        """Return the share of the resamples in which each rival is the best, in descending order."""
        names = list(self.rivals)
        penalties = np.array([self.penalty(self.rivals[name]) for name in names])
        costs = np.stack([self.rivals[name].costs for name in names], axis=1) + penalties / len(self.whole)
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
        compared: Later recording.
        first: Vehicle with the file's values.
        progress: Called with a short text and the share of the work done.
        further: Whether the vehicle has changes already, so that the next one must be larger.
        without: Effects that are not tried.
    """
    last, changes, refused = first, list[Change](), None
    while len(changes) < MOST_FINDINGS and not ((further or changes) and compared.chi2(last) <= 1.0):
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
    """Return the changes, or the second alone where it fits better without the first.

    A candidate with a threshold may appear only after a poorer candidate has moved the start of its fit.
    """
    if len(changes) != 2:
        return changes
    before, name = changes[0], changes[1].best.effect
    (table,) = changes[1].best.model.vehicle.effects(name)
    try:
        alone = fitted(compared, first, table)
    except (Diverges, np.linalg.LinAlgError):
        return changes
    if before.penalised(alone) >= before.penalised(before.best):
        return changes
    return [replace(before, best=alone, rivals={**before.rivals, name: alone})]


def as_diagnosis(compared: Compared, first: Model, those: Changes, further: bool = False) -> Diagnosis:
    """Return the diagnosis; its chi2 are in units of the floor of the hull model."""
    given, changes = compared.chi2(first), those.found
    tried = tuple(_candidates(compared, first, those))
    if not changes:
        words = (
            f"nothing {'more ' * further}has changed beyond the floor of the hull model: the mean squared "
            f"residual is {given:.3g} floors"
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
    """Yield every candidate change, and at each step the model without a change."""
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
    """Return one candidate change; an empty name stands for the model without one."""
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
    """Return a change as a finding.

    Args:
        change: Change.
        file: Vehicle file.
        compared: Recordings.
        given: Residual of the file as given, in floors.
        left: Residual with all changes, in floors.
    """
    name, wins, model = change.best.effect, change.wins(), change.best.model
    unchanged = compared.unchanged
    hulls = imitations(unchanged, file, model.unknown, model.values, folds(unchanged.shots.session))
    fit = widened(model.estimated(), hulls, pulls(model.normal, model.unknown, compared.fold))
    parameters, errors = fit.table(name)
    words = f"it removes {change.score:.0%} of the residual of held-out stretches"
    rivals = [f"{other} ({part:.0%})" for other, part in wins.items() if other != name and part >= ALPHA]
    if rivals:
        words += f"; in part of the resamples another effect wins: {', '.join(rivals)}"
    if left > RIGHT:
        words += f"; the residual is still {left:.3g} times the floor, and no candidate explains it"
    known = bool(file.effects(name))
    if known:
        entries = [entry for entry in model.unknown.entries if entry.effect == name]
        words = f"{advice.having_changed(name, greatest_change(file, entries, model.values))}; {words}"
    else:
        words = f"{advice.adding(name, parameters, compared.log.record.dt)}; {words}"
    sure = limited_confidence(change.confidence(given), fit.vehicle, name, errors if left <= RIGHT else None)
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
    """Fit changes of a file together, with the rest of the file and the hull forces held fixed.

    Args:
        file: Vehicle file as given.
        log: Recording after the change.
        hull: Hull-force model learnt from the earlier recording.
        changes: `[[effect]]` tables with starting values.

    Raises:
        DataError: The recording is too short, or the predictions diverge.
    """
    compared, first = Compared.of(log, stable_shots(file, log), hull, file)
    model = with_hull_response(compared, first, fitted_together(compared, first, changes))
    return model.estimated()
