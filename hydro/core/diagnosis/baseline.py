"""What a search for what is missing starts from, what it found, and what of it matters.

A finding matters where it explains enough of the error that the file's own effects leave, or lowers its root
enough, or is much of what others have left of it; whatever kinematics alone shows need only be visible.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import cast

import msgspec
import numpy as np

from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import (
    SLOW,
    Diverges,
    Model,
    Screening,
    Wanted,
    as_it_is,
    fit_model,
    fitted_or_kept,
    from_elsewhere,
    names_of,
)
from hydro.core.effects.catalogue import CATALOGUE, own_effects
from hydro.core.effects.damping import LINEAR_DAMPING
from hydro.core.errors import DataError
from hydro.core.identification.fit import fit as equation_error
from hydro.core.identification.outcome import Fit
from hydro.core.prediction import multiple_shooting
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.output_error import OutputError, in_waves
from hydro.core.prediction.tracking import shot_seconds
from hydro.core.preprocessing.coloured import coloured
from hydro.core.preprocessing.sensor_tests import KinematicTest
from hydro.core.preprocessing.sensor_tests import shown as misread
from hydro.core.recording.shots import SHOT_SECONDS, Shots, room
from hydro.core.sea.sea_state import SeaState, shown
from hydro.core.vehicle.description import Vehicle

MATERIAL = 0.05
"""Share of the squared error beyond the noise that a finding must explain,"""
TELLING = 0.1
"""or else by how much of its root it must lower the root of what is left."""
MUCH_OF_IT, PLAIN = 0.15, 0.01
"""or else the part of what is left that it must explain, and the share of the noise that this must be."""
VISIBLE = 0.005
"""Share of the whole error, noise included, below which nobody would see it in a replay."""
SEA_TWICE = 2
"""Times that waves are looked for: once more with the file's own effects fitted beside them."""
SHOT_LENGTHS = tuple(part * SHOT_SECONDS for part in (1.0, 0.5, 0.25, 0.125))
"""Lengths of a shot that are tried, for vehicles that the model makes unstable [s]."""
DIVERGED_FILE = (
    "the motion that the file predicts diverges within a quarter of a second: all began from linear damping "
    "that equation error finds"
)
DIVERGED_REFIT = "the refit of the file's own effects diverged: they stand as they began"
STABLE = 0.95
"""Part of the shots that must not diverge."""
LEAST_SHOTS = 16
SHORTEST = 0.5
"""Length down to which shots are cut where there are too few longer ones [s]: 10 s of sinking suffice."""
LOUD, ENOUGH = 1e3, 120
"""Mean squared residual, in units of the noise, from which so many shots tell as much as all."""


@dataclass(frozen=True)
class Baseline:
    """A vehicle file, and the best that its own effects can do: what a search starts from.

    Attributes:
        vehicle: The vehicle as its file gives it.
        effects: Names of its own effects, which are fitted anew.
        log: The preprocessed recording.
        problem: The shots, begun where the recording saw the vehicle.
        given: The vehicle with the values of its file.
        refitted: With its own effects fitted anew.
        sensors: What kinematics alone says of the velocity log's errors, by effect.
        start: The vehicle that the fits begin from; another one than the file's where its predictions
            diverge.
        warnings: What went wrong on the way, a sentence each.
        file: Another vehicle whose values alone are known beforehand; None where these are.
        sea: Waves that the recording shows and the file has not: the shots allow for them.
        calmed: Part of the error beyond the noise that goes with them.
    """

    vehicle: Vehicle
    effects: tuple[str, ...]
    log: Preprocessed
    problem: OutputError
    given: Model
    refitted: Model
    sensors: Mapping[str, KinematicTest]
    start: Vehicle | None = None
    warnings: tuple[str, ...] = ()
    file: Vehicle | None = None
    sea: SeaState | None = None
    calmed: float = 0.0

    @property
    def filed(self) -> Vehicle:
        """The vehicle with the values that its fits begin from."""
        return self.start or self.vehicle

    @property
    def beforehand(self) -> Vehicle:
        """The vehicle whose values are known whatever this recording says."""
        return self.file or self.vehicle

    def thinned(self) -> Baseline:
        """The same over ENOUGH of its shots where the file's own effects leave far more than the noise.

        What no noise blurs every shot tells; itself where it leaves less, or has fewer than twice as many: a
        search over some of the shots that comes near the noise is made once more over all.
        """
        if len(self.refitted.costs) < 2 * ENOUGH or not self.refitted.normal.chi2 > LOUD:
            return self
        given, refitted = self.given.some(ENOUGH), self.refitted.some(ENOUGH)
        return replace(self, problem=self.problem.some(ENOUGH), given=given, refitted=refitted)

    def as_filed(self, vehicle: Vehicle) -> Vehicle:
        """A vehicle with the file's own effects at the values that the file gives them."""
        own = [table for table in self.filed.effect if table["name"] in self.effects]
        others = [table for table in vehicle.effect if table["name"] not in self.effects]
        return msgspec.structs.replace(vehicle, effect=(*own, *others))

    def at_file(self) -> Model:
        """The file's own effects free, at the values that it gives them."""
        return fit_model(self.filed, self.effects, self.problem, self.log.track, 0)

    def explained(self, model: Model) -> float:
        """Part of the error beyond the noise that a model explains of what the file's own effects leave."""
        return (self.refitted.normal.cost - model.normal.cost) / max(self.refitted.excess, 1e-9)

    def material(self, gain: float, before: Model) -> bool:
        """Whether explaining so much squared residual of a model matters.

        Where others have explained most, a small share of the first error may be much of what is left, and
        that is enough as long as it is plain beside the noise.
        """
        left, first = max(before.excess - gain, 0.0), self.refitted.excess
        lower = np.sqrt(before.excess) - np.sqrt(left) >= TELLING * np.sqrt(first)
        much = gain >= max(MUCH_OF_IT * before.excess, PLAIN * before.normal.residuals)
        return self.visible(gain) and bool(lower or much or gain >= MATERIAL * first)

    def visible(self, gain: float) -> bool:
        """Whether explaining so much would show in a replay at all."""
        return gain >= VISIBLE * self.refitted.normal.residuals

    def belongs(self, effect: str, gain: float, before: Model) -> bool:
        """Whether an effect is a finding: it matters, or kinematics shows it, however much else is wrong."""
        return self.material(gain, before) or (self.sure(effect) and self.visible(gain))

    def sure(self, effect: str) -> bool:
        """Whether kinematics alone shows that the velocity log misreads so, whatever the dynamics lack."""
        test = self.sensors.get(effect)
        return test is not None and misread(test)


@dataclass(frozen=True)
class Found:
    """An effect that joined the model.

    Attributes:
        effect: Its name.
        p_value: That nothing being missing the most telling effect tells as much.
        rivals: The models in which it, or another effect in its place, explains what is left, by effect.
    """

    effect: str
    p_value: float
    rivals: Mapping[str, Model]


@dataclass(frozen=True)
class Outcome:
    """What a search found.

    Attributes:
        model: The vehicle with all of it.
        found: What joined it.
        last: The suspects of the last round, in which nothing joined.
        without: The model without each effect that was found, all others fitted anew.
        fit: Values and standard errors of all effects fitted together; None of none, and before they are.
        warnings: What went wrong on the way, a sentence each.
    """

    model: Model
    found: tuple[Found, ...]
    last: Screening
    without: Mapping[str, Model] = field(default_factory=dict)
    fit: Fit | None = None
    warnings: tuple[str, ...] = ()

    @property
    def effects(self) -> list[str]:
        """Names of what was found."""
        return [one.effect for one in self.found]


def stable_start(vehicle: Vehicle, log: Preprocessed) -> tuple[Vehicle, OutputError]:
    """The vehicle that fits begin from, and shots on which its predictions stay finite and near.

    It is the file's own, or, where its predictions diverge over the shortest shots too, the file with other
    damping: the linear one that equation error finds, which integrates nothing, in the place of the file's
    linear damping, or of all of its damping.

    Raises:
        DataError: The recording is too short, or the predictions of every start diverge.
    """
    try:
        return vehicle, stable_shots(vehicle, log)
    except Diverges as refusal:
        every = {name for name, effect in CATALOGUE.items() if effect.family == LINEAR_DAMPING.family}
        for removed in ({LINEAR_DAMPING.name}, every):
            kept = tuple(effect for effect in vehicle.effect if effect["name"] not in removed)
            bare = msgspec.structs.replace(vehicle, effect=kept)
            try:
                damped = equation_error(bare, log.raw, [LINEAR_DAMPING.name], method="equation").vehicle
                return damped, stable_shots(damped, log)
            except DataError:
                continue
        raise refusal


def stable_shots(vehicle: Vehicle, log: Preprocessed) -> OutputError:
    """Shots as long as the vehicle's predictions stay finite and near, those that do not left out.

    Raises:
        DataError: The recording is too short.
        Diverges: The predictions of every length do.
    """
    record, blind = log.record, shot_seconds(log.record)
    for seconds in (blind, *SHOT_LENGTHS) if blind > SHOT_LENGTHS[0] else SHOT_LENGTHS:
        count = room(record, seconds)
        if count < LEAST_SHOTS and seconds > SHORTEST:
            continue
        if count < LEAST_SHOTS:
            least, gaps = LEAST_SHOTS * seconds, int(record.after_gap.sum())
            remedy = f"record at least {least:g} s, better some minutes"
            if record.rows * record.dt > least and gaps:
                remedy = f"{gaps} gaps cut the log to pieces: `hydro import` bridges those of a few samples"
            raise DataError(f"{count * seconds:g} s without a gap are too short for a diagnosis; {remedy}")
        if (stable := stable_part(log.shots(seconds), vehicle)) is not None:
            return stable
    raise Diverges(
        f"the vehicle's predicted motion diverges within {SHOT_LENGTHS[-1]:g} s; check its "
        f"damping, or begin with `hydro fit --effect {LINEAR_DAMPING.name}`"
    )


def stable_part(shots: Shots, vehicle: Vehicle) -> OutputError | None:
    """The shots that a vehicle's predictions do not diverge in; None where too many do."""
    problem = OutputError.of(shots, vehicle)
    prepared = multiple_shooting.prepare(candidate(vehicle), problem.shots)
    stable = multiple_shooting.bounded(prepared, problem.shots)
    return OutputError(problem.shots.of(stable)) if stable.mean() >= STABLE else None


def refit(vehicle: Vehicle, log: Preprocessed, problem: OutputError, start: Vehicle) -> Baseline:
    """The file's own effects fitted anew from a start, each channel weighed by its noise, white or not."""
    effects, warnings = own_effects(start), []
    refitted, problem, reached = weighed_fit(start, effects, problem, log)
    if start is not vehicle:
        warnings.append(DIVERGED_FILE)
    if not reached:
        warnings.append(DIVERGED_REFIT)
    given = as_it_is(vehicle, problem)
    return Baseline(
        vehicle, effects, log, problem, given, refitted, log.sensors, start=start, warnings=tuple(warnings)
    )


def allowing_for_waves(baseline: Baseline) -> Baseline:
    """The baseline over shots that allow for the waves of the recording, where it shows any.

    They are no law that shots could be fitted with; what they make of a shot is weighed out by their
    spectrum, or else whatever else is missing would have to explain them.  A file that states waves has
    them allowed for already.
    """
    vehicle, log, shots = baseline.vehicle, baseline.log, baseline.problem.shots
    if any(CATALOGUE[table["name"]].is_random for table in vehicle.effect):
        return baseline
    allowed = baseline
    for _ in range(SEA_TWICE):
        sea = shown(allowed.refitted.vehicle, log.record)
        if sea is None:
            break
        forces = allowed.refitted.vehicle
        model = candidate(msgspec.structs.replace(forces, effect=(*forces.effect, sea.table)))
        problem = OutputError(in_waves(replace(shots, swell=None), model))
        again = refit(vehicle, log, problem, baseline.filed)
        gone = 1.0 - again.refitted.excess / max(baseline.refitted.excess, 1e-9)
        if not gone >= MATERIAL:
            break
        allowed = replace(again, file=baseline.file, sea=sea, calmed=gone)
    return allowed


def weighed_fit(
    vehicle: Vehicle, effects: Wanted, problem: OutputError, log: Preprocessed, share: float = SLOW
) -> tuple[Model, OutputError, bool]:
    """Effects fitted with each channel weighed by its noise, white or not.

    Returns:
        The model, or the vehicle as it is where the fit diverges; the shots so weighed; and whether the fit
        did not diverge.
    """
    model, reached = fitted_or_kept(vehicle, effects, problem, log.track, share)
    model = from_elsewhere(model, problem, log.track, share)
    sigma = coloured(log.noise, model.normal, log.record, log.sensors)
    if not np.array_equal(sigma, log.noise):
        problem, along = problem.weighed(sigma), cast(OutputError, model.problem).weighed(sigma)
        model, reached = fitted_or_kept(model.vehicle, names_of(effects), along, log.track, share)
    return model, problem, reached
