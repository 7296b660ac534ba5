"""Baseline fit of a vehicle file, result of a search, and the size that a finding must have.

A finding counts if it explains enough of the squared error beyond the noise.  The error is that of the
baseline fit, or that of the present model.  A sensor error that kinematics shows need only be visible.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import cast

import msgspec
import numpy as np

from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import (
    Diverges,
    Model,
    Screening,
    Wanted,
    fit_model,
    fitted_or_kept,
    from_elsewhere,
    names_of,
    screened,
    unfitted,
)
from hydro.core.diagnosis.settings import (
    ALMOST_ALL,
    FAR_FROM_NOISE,
    FURTHER,
    LEAST_SHOTS,
    MATERIAL,
    SHOTS,
    STEP_SHARE,
    VISIBLE,
)
from hydro.core.effects.catalogue import CATALOGUE, own_effects
from hydro.core.effects.damping import LINEAR_DAMPING
from hydro.core.errors import DataError
from hydro.core.identification.fit import fit as equation_error
from hydro.core.identification.levenberg_marquardt import Prior
from hydro.core.identification.outcome import Fit
from hydro.core.identification.prior import about_file
from hydro.core.identification.suspects import Suspect
from hydro.core.prediction import multiple_shooting
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.output_error import OutputError, in_waves
from hydro.core.prediction.parameters import Free
from hydro.core.prediction.tracking import shot_seconds
from hydro.core.preprocessing.coloured import coloured
from hydro.core.preprocessing.sensor_tests import KinematicTest
from hydro.core.preprocessing.sensor_tests import shown as shown_by_kinematics
from hydro.core.recording.shots import SHOT_SECONDS, Shots, room
from hydro.core.sea.sea_state import SeaState, shown
from hydro.core.vehicle.description import Vehicle

SHOT_LENGTHS = tuple(part * SHOT_SECONDS for part in (1.0, 0.5, 0.25, 0.125))
"""Shot lengths to try [s].  The shorter ones are for models that are unstable."""
DIVERGED_FILE = (
    "the motion that the file predicts diverges within a quarter of a second: all fits started from the "
    "linear damping of an equation-error fit"
)
DIVERGED_REFIT = "the refit of the file's effects diverged: they keep their starting values"


@dataclass(frozen=True)
class Baseline:
    """Vehicle file with the best fit of its existing effects: the start of a search.

    Attributes:
        vehicle: Vehicle as given in its file.
        effects: Names of the file's free effects, which are refitted.
        log: Preprocessed recording.
        problem: Shots, starting at the measured states.
        given: Model with the file's values.
        refitted: Model with the existing effects refitted.
        sensors: Kinematic tests of velocity sensor errors, by effect.
        start: Vehicle from which the fits start.  It differs from the file where the file's predictions
            diverge.
        warnings: Problems of the baseline fit, one sentence each.
        file: Vehicle whose values are the prior knowledge, if that is another one; None if it is `vehicle`.
        sea: Waves that the recording shows and the file lacks; the shots allow for them.
        calmed: Share of the error beyond the noise that the waves explain.
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
        """Vehicle with the starting values of the fits: the file, unless its predictions diverge."""
        return self.start or self.vehicle

    @property
    def beforehand(self) -> Vehicle:
        """Vehicle whose values are the prior knowledge, independent of this recording."""
        return self.file or self.vehicle

    @property
    def expected(self) -> Vehicle:
        """Vehicle about whose values fits have their prior: prior knowledge, or the start of the fits."""
        return self.file or self.filed

    def known(self, unknown: Free) -> Prior:
        """Return the prior of the components of a fit: the free effects of the file, near its values."""
        return about_file(self.expected, self.effects, unknown)

    def compared(self, model: Model) -> Model:
        """Return a fit with the prior of all effects of the file, for comparisons with other fits."""
        names = [str(table["name"]) for table in self.expected.effect]
        return replace(model, expected=about_file(self.expected, names, model.unknown))

    def thinned(self) -> Baseline:
        """Return the baseline with SHOTS of its shots, if its mean squared residual is above FAR_FROM_NOISE.

        Return it unchanged if the residual is smaller or if there are fewer than twice as many shots.  A
        search over a part of the shots is repeated over all of them if it ends below FAR_FROM_NOISE.
        """
        if len(self.refitted.costs) < 2 * SHOTS or not self.refitted.normal.chi2 > FAR_FROM_NOISE:
            return self
        given, refitted = self.given.some(SHOTS), self.refitted.some(SHOTS)
        problem = self.problem.some(SHOTS).coarsened(refitted.vehicle)
        return replace(self, problem=problem, given=given, refitted=refitted)

    def as_filed(self, vehicle: Vehicle) -> Vehicle:
        """Return a copy of a vehicle whose existing effects have the starting values, those of `filed`."""
        own = [table for table in self.filed.effect if table["name"] in self.effects]
        others = [table for table in vehicle.effect if table["name"] not in self.effects]
        return msgspec.structs.replace(vehicle, effect=(*own, *others))

    def at_file(self) -> Model:
        """Return the model with the existing effects free, at the values of `filed`, without a fit."""
        return fit_model(self.filed, self.effects, self.problem, self.log.track, 0)

    def explained(self, model: Model) -> float:
        """Return the share of the baseline fit's error beyond the noise that a model explains.

        Squared residuals are compared per shot, because a model may be fitted to some of the shots only.  The
        share is negative for a model that fits worse than the baseline.
        """
        first, all_over_some = self.refitted, len(self.refitted.costs) / len(model.costs)
        return (first.normal.cost - all_over_some * model.normal.cost) / max(first.excess, 1e-9)

    def screened(self, model: Model, tried: Sequence[Suspect]) -> Screening:
        """Return the linearised test of candidates against a model's residual, scaled to all shots."""
        return screened(model, tried, len(self.problem.shots.starts))

    def material(self, gain: float, before: Model) -> bool:
        """Return whether a reduction of a model's squared residual is large enough to be a finding.

        It must be visible (`visible`).  It must also be a share MATERIAL of the error of the baseline fit, or
        a share FURTHER of the error of the present model.  Where other effects explain most of the error, a
        small share of the first is a large share of the second.

        `gain` is in units of the noise variance.
        """
        much = gain >= FURTHER * before.excess
        return self.visible(gain) and (much or gain >= MATERIAL * self.refitted.excess)

    def visible(self, gain: float) -> bool:
        """Return whether a reduction of the squared residual would be visible in a replay.

        `gain` is in units of the noise variance; it is visible from a share VISIBLE of the noise.
        """
        return gain >= VISIBLE * self.refitted.normal.residuals

    def belongs(self, effect: str, gain: float, before: Model) -> bool:
        """Return whether an effect is a finding: it is material, or visible and shown by kinematics.

        `gain` is the reduction of the squared residual by the effect, in units of the noise variance.
        """
        return self.material(gain, before) or (self.sure(effect) and self.visible(gain))

    def sure(self, effect: str) -> bool:
        """Return whether an effect is an error of the velocity sensor that kinematics alone shows."""
        test = self.sensors.get(effect)
        return test is not None and shown_by_kinematics(test)


@dataclass(frozen=True)
class Found:
    """Effect that joined the model in a round of a search.

    Attributes:
        effect: Name of the effect.
        p_value: Probability that the largest gain of all effects is as large by chance.
        rivals: Fitted models of the round, by effect: with this effect, or with another in its place.
        ahead: Quick fit of the effect together with the best second one, by the name of that one; empty
            without a look-ahead.
    """

    effect: str
    p_value: float
    rivals: Mapping[str, Model]
    ahead: Mapping[str, Model] = field(default_factory=dict)

    @property
    def model(self) -> Model:
        """Model with the effect."""
        return self.rivals[self.effect]


@dataclass(frozen=True)
class Grown:
    """State of a search: the model and the effects that joined it.

    Attributes:
        model: Vehicle with all effects found.
        found: Effects that joined the model, in this order.
    """

    model: Model
    found: tuple[Found, ...]

    @property
    def effects(self) -> list[str]:
        """Names of the effects found."""
        return [one.effect for one in self.found]


@dataclass(frozen=True)
class Outcome(Grown):
    """Result of a search.

    Attributes:
        last: Screening of the last round, in which no effect joined.
        without: Model without each effect found, with all others refitted, by effect.
        fit: Values and standard errors of all effects, fitted together, above RIGHT with the hull force free
            (`diagnosis.free_hull_force`); None before that fit, or without effects.
        warnings: Problems of the search, one sentence each.
    """

    last: Screening
    without: Mapping[str, Model] = field(default_factory=dict)
    fit: Fit | None = None
    warnings: tuple[str, ...] = ()


def stable_start(vehicle: Vehicle, log: Preprocessed) -> tuple[Vehicle, OutputError]:
    """Return the vehicle from which fits start, and shots on which its predictions stay bounded.

    The vehicle is that of the file, unless its predictions diverge even over the shortest shots.  Then linear
    damping from an equation-error fit, which integrates nothing, replaces the file's linear damping.  If that
    diverges too, it replaces all damping of the file.

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
    """Return a recording cut into shots as long as possible, without shots whose predictions diverge.

    Shots are shortened until most predictions of the vehicle stay bounded.

    Raises:
        DataError: The recording is too short.
        Diverges: The predictions diverge at every length.
    """
    record, blind = log.record, shot_seconds(log.record)
    for seconds in (blind, *SHOT_LENGTHS) if blind > SHOT_LENGTHS[0] else SHOT_LENGTHS:
        count = room(record, seconds)
        if count < LEAST_SHOTS and seconds > SHOT_LENGTHS[-2]:
            continue
        if count < LEAST_SHOTS:
            least, gaps = LEAST_SHOTS * seconds, int(record.after_gap.sum())
            remedy = f"record at least {least:g} s, better some minutes"
            if record.rows * record.dt > least and gaps:
                remedy = f"{gaps} gaps cut the log to pieces: `hydro import` bridges gaps of a few samples"
            raise DataError(f"{count * seconds:g} s without a gap are too short for a diagnosis; {remedy}")
        if (stable := stable_part(log.shots(seconds), vehicle)) is not None:
            return stable
    raise Diverges(
        f"the vehicle's predicted motion diverges within {SHOT_LENGTHS[-1]:g} s; check its "
        f"damping, or start with `hydro fit --effect {LINEAR_DAMPING.name}`"
    )


def stable_part(shots: Shots, vehicle: Vehicle) -> OutputError | None:
    """Return those shots in which a vehicle's predictions stay bounded; None if less than ALMOST_ALL do."""
    problem = OutputError.of(shots, vehicle)
    prepared = multiple_shooting.prepare(candidate(vehicle), problem.shots)
    stable = multiple_shooting.bounded(prepared, problem.shots)
    return OutputError(problem.shots.of(stable)) if stable.mean() >= ALMOST_ALL else None


def refit(
    vehicle: Vehicle, log: Preprocessed, problem: OutputError, start: Vehicle, file: Vehicle | None = None
) -> Baseline:
    """Refit the file's effects, and return the fit as the baseline of a search.

    Each channel is weighted by its noise, white or coloured.  Values stay near those of the file as far as
    the recording allows: without the missing effect they would run away, to a hull of a hundred times its
    mass for instance, and absorb its error.

    Args:
        vehicle: Vehicle file.
        log: Preprocessed recording.
        problem: Shots.
        start: The file, or a vehicle with other damping if the predictions of the file diverge.
        file: Vehicle whose values are the prior knowledge, if that is another one.
    """
    effects, warnings = own_effects(start), []
    known = partial(about_file, file or start, effects)
    refitted, problem, reached = weighed_fit(start, effects, problem, log, known=known)
    if start is not vehicle:
        warnings.append(DIVERGED_FILE)
    if not reached:
        warnings.append(DIVERGED_REFIT)
    given = unfitted(vehicle, problem)
    warned = tuple(warnings)
    made = Baseline(
        vehicle, effects, log, problem, given, refitted, log.sensors, start=start, warnings=warned, file=file
    )
    return replace(made, refitted=made.compared(refitted))


def allowing_for_waves(baseline: Baseline) -> Baseline:
    """Return the baseline over shots that allow for the recording's waves, if it shows any.

    Waves are random, so shots cannot be fitted to their phases.  Their spectrum adds to the covariance of
    each shot instead; otherwise another effect would have to explain them.  A file that states waves already
    allows for them.
    """
    vehicle, log, shots = baseline.vehicle, baseline.log, baseline.problem.shots
    if any(CATALOGUE[table["name"]].is_random for table in vehicle.effect):
        return baseline
    allowed = baseline
    for _ in range(2):  # the second time with the file's effects refitted
        sea = shown(allowed.refitted.vehicle, log.record, log.motion)
        if sea is None:
            break
        forces = allowed.refitted.vehicle
        model = candidate(msgspec.structs.replace(forces, effect=(*forces.effect, sea.table)))
        problem = OutputError(in_waves(replace(shots, swell=None), model))
        again = refit(vehicle, log, problem, baseline.filed, baseline.file)
        gone = 1.0 - again.refitted.excess / max(baseline.refitted.excess, 1e-9)
        if not gone >= MATERIAL:
            break
        allowed = replace(again, sea=sea, calmed=gone)
    return allowed


def weighed_fit(
    vehicle: Vehicle,
    effects: Wanted,
    problem: OutputError,
    log: Preprocessed,
    share: float = STEP_SHARE,
    known: Callable[[Free], Prior] | None = None,
) -> tuple[Model, OutputError, bool]:
    """Fit effects with each channel weighted by its noise, white or coloured.

    The arguments are those of `fit_model`.

    Returns:
        The model, or the vehicle with its starting values where the fit diverges; the weighted shots; and
        whether the fit converged without divergence.
    """
    fitting = partial(fit_model, reach=log.track, share=share, known=known)
    model, reached = fitted_or_kept(fitting, vehicle, effects, problem)
    model = from_elsewhere(fitting, model, problem, log.track)
    sigma = coloured(log.noise, model.normal, log.record, log.sensors)
    if not np.array_equal(sigma, log.noise):
        problem, along = problem.weighed(sigma), cast(OutputError, model.problem).weighed(sigma)
        model, reached = fitted_or_kept(fitting, model.vehicle, names_of(effects), along)
    return model, problem, reached
