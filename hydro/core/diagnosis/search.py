"""The search for what a model lacks: hold the whole catalogue against what is left, and fit the best.

All suspects are linearised together about the present model, over short shots
(`identification.multiple_shooting`).  Those that tell most, by more than chance would let the most telling of
all do (`diagnosis.score_test`), are fitted in earnest with everything that is in the model already; the best
joins it, and the search goes on.  Afterwards every finding must still be needed beside the others, and be the
best in its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import msgspec
import numpy as np

from hydro.core.columns import Array, Progress
from hydro.core.diagnosis.score_test import Columns, Evidence, p_values
from hydro.core.diagnosis.sensor_tests import KinematicTest, shown, vetoed
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.identification.fit import OutputError
from hydro.core.identification.levenberg_marquardt import ITERATIONS, Problem, descend, linear_step, moved
from hydro.core.identification.normal_equations import Normal
from hydro.core.identification.parameters import Free, free
from hydro.core.identification.suspects import CURVED, Suspect, shapes, suspects
from hydro.core.vehicle.description import Vehicle

Wanted = Sequence[str | Mapping[str, Any]]

ALPHA = 0.01
"""Probability of a false alarm in one round, over all effects at once."""
MATERIAL = 0.05
"""Share of the squared error beyond the noise that a finding must explain,"""
TELLING = 0.1
"""or else by how much of its root it must lower the root of what is left."""
MOST_OF_IT, PLAIN = 0.5, 0.1
"""or else the part of what is left that it must explain, and the share of the noise that this must be."""
VISIBLE = 0.005
"""Share of the whole error, noise included, below which nobody would see it in a replay."""
CONTENDERS = 5
NEAR, NEAR_CURVED = 0.5, 0.1  # share of the best linear gain from which a suspect is fitted in earnest
MOST = 4  # findings
QUICK = 4  # iterations of a contender's fit
CLOSEST, FAR = 2, 4.0  # contenders that are fitted to the end, and errors of the best beyond which none is
COARSE = 0.3  # a step that lowers the cost by less than this many residuals' worth names nothing,
SLOW = 1e-3  # nor one that takes less than this share of what is left: a poor model never settles


@dataclass(frozen=True)
class Model:
    """A vehicle in the course of the search.

    Attributes:
        unknown: Its free entries.
        values: Their fitted values, (P,).
        problem: The shots, their beginnings moved along.
        normal: The problem about the values, in units of the entries' scales.
    """

    unknown: Free
    values: Array
    problem: Problem
    normal: Normal

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with the fitted values."""
        return self.unknown.at(self.values)

    @property
    def costs(self) -> Array:
        """Squared residual of each shot, (S,)."""
        return np.asarray(self.normal.gram[:, -1, -1])

    @property
    def excess(self) -> float:
        """Squared residual beyond the noise."""
        return max(self.normal.cost - self.normal.residuals, 0.0)

    @property
    def penalised(self) -> Array:
        """Costs of the shots with a fine for each parameter (Schwarz 1978, a shot as one observation), (S,).

        Of two effects of which one can be all that the other is, the smaller is named unless both tell more.
        """
        fine = np.log(len(self.costs)) * len(self.values) * max(self.normal.chi2, 1.0)
        penalised: Array = self.costs + fine / len(self.costs)
        return penalised


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
class Round:
    """All suspects about one model.

    Attributes:
        ranked: Best shape of each effect with its columns, the most telling first.
        normal: The linearised problem, in the units that the columns' steps have.
        evidence: The same in columns of unit size.
        own: Columns of the model's own entries.
        gains: Squared residual that each effect would explain.
    """

    ranked: Mapping[str, tuple[Suspect, Columns]]
    normal: Normal
    evidence: Evidence
    own: Columns
    gains: Mapping[str, float]

    @cached_property
    def p_value(self) -> float:
        """Probability that chance alone would tell as much as the most telling effect."""
        groups = {name: columns for name, (_, columns) in self.ranked.items()}
        return min(p_values(self.evidence, self.own, groups).values(), default=1.0)

    @property
    def significant(self) -> bool:
        """Whether any effect tells more than chance would."""
        return self.p_value <= ALPHA


@dataclass(frozen=True)
class Search:
    """What is searched, and against what.

    Attributes:
        first: The vehicle with its own effects fitted anew.
        base: Names of those effects.
        reach: Positions of the recording, (N, 3).
        sensors: What kinematics alone says of the velocity log's errors.
        sight: The shots, begun where the recording saw the vehicle.
    """

    first: Model
    base: tuple[str, ...]
    reach: Array
    sensors: Mapping[str, KinematicTest]
    sight: OutputError

    def material(self, gain: float, before: Model) -> bool:
        """Whether explaining so much squared residual of a model matters.

        Where others have explained most, a small share of the first error may be most of what is left, and
        of that most is enough as long as it is plain beside the noise.
        """
        left = max(before.excess - gain, 0.0)
        lower = np.sqrt(before.excess) - np.sqrt(left) >= TELLING * np.sqrt(self.first.excess)
        most = gain >= max(MOST_OF_IT * before.excess, PLAIN * before.normal.residuals)
        return self.seen(gain) and bool(lower or most or gain >= MATERIAL * self.first.excess)

    def seen(self, gain: float) -> bool:
        """Whether explaining so much would show in a replay at all."""
        return gain >= VISIBLE * self.first.normal.residuals

    def belongs(self, effect: str, gain: float, before: Model) -> bool:
        """Whether an effect is to be told: it matters, or kinematics shows it, however much else is wrong."""
        sure = effect in self.sensors and shown(self.sensors[effect])
        return self.material(gain, before) or (sure and self.seen(gain))

    def round(self, model: Model, chosen: Sequence[str]) -> Round:
        """Hold all effects that are not in the model against what it leaves."""
        known = [*self.base, *chosen, *repeated(model.vehicle)]
        return self.hold(model, suspects(model.vehicle, without=known, reach=self.reach))

    def hold(self, model: Model, tried: Sequence[Suspect]) -> Round:
        """Hold some suspects against what a model leaves."""
        changed, steps = moved(model.unknown, model.values)
        own, places = range(len(changed)), list[tuple[Suspect, Columns]]()
        for suspect in tried:
            places.append((suspect, range(len(changed), len(changed) + len(suspect.steps))))
            changed += suspect.changed
            steps += suspect.steps
        normal = model.problem.linearise(model.vehicle, changed, steps)
        evidence = Evidence.of(normal)
        best: dict[str, tuple[float, Suspect, Columns]] = {}
        for suspect, columns in places:
            gain = evidence.gain(own, columns)
            if suspect.effect not in best or gain > best[suspect.effect][0]:
                best[suspect.effect] = (gain, suspect, columns)
        order = sorted(best, key=lambda name: -best[name][0])
        ranked = {name: best[name][1:] for name in order}
        gains = {name: best[name][0] for name in order}
        return Round(ranked, normal, evidence, own, gains)

    def contend(
        self, model: Model, chosen: Sequence[str], now: Round, known: Mapping[str, Model] | None = None
    ) -> dict[str, Model]:
        """Fit the most telling suspects in earnest, each with all that is in the model.

        `known` are fits that there are already; they are held against the others.

        That something is missing is tested over all effects at once; which one it is the fits say, and one
        of many parameters may be it though few blocks cannot test it alone.
        What the velocity log misreads for all that kinematics shows comes before any force; what kinematics
        refutes does not come at all.
        """
        given = known or {}
        fits = dict(given)
        if not now.significant:
            return fits
        sure = [n for n, test in self.sensors.items() if shown(test) and n in now.gains]
        material = {n: now.gains[n] for n in sure if self.material(now.gains[n], model)}
        fits |= self.near(model, chosen, now, material, given)
        if fits.keys() == given.keys():
            # All refuted: what else is missing spoils what the dynamics say of the log.
            rest = {n: gain for n, gain in now.gains.items() if n not in material}
            fits |= self.near(model, chosen, now, rest, given)
        least = np.inf
        for name in sorted(fits, key=lambda name: fits[name].normal.cost)[:CLOSEST]:
            if fits[name].excess <= FAR * least:
                if name not in given:
                    fits[name] = self.settled(fits[name], [*chosen, name])
                least = min(least, fits[name].excess + VISIBLE * fits[name].normal.residuals)
        return fits

    def near(
        self,
        model: Model,
        chosen: Sequence[str],
        now: Round,
        gains: Mapping[str, float],
        given: Mapping[str, Model],
    ) -> dict[str, Model]:
        """Quick fits of those suspects that tell nearly as much as the most telling of them."""
        most, fits = max(gains.values(), default=0.0), dict(given)
        for name in gains:
            if name in given:
                continue
            told_all = any(fit.excess < VISIBLE * fit.normal.residuals for fit in fits.values())
            near = (NEAR_CURVED if name in CURVED and not told_all else NEAR) * most
            if now.gains[name] < near or len(fits) == CONTENDERS:
                continue
            fine = shapes(model.vehicle, name, reach=self.reach)
            fit = self.joined(model, chosen, self.hold(model, fine) if fine else now, name)
            if not self.refuted(name, fit.vehicle):
                fits[name] = fit
        return fits

    def settled(self, model: Model, chosen: Sequence[str]) -> Model:
        """The model fitted to the end: a name rests on the difference of two fits.

        Begun again where the recording saw the vehicle: what a poor model has made of the beginnings may
        hold a good one back.
        """
        wanted = [*self.base, *chosen]
        again = fitted(model.vehicle, wanted, self.sight.begun(model.vehicle), self.reach, ITERATIONS)
        if again.normal.cost <= model.normal.cost:
            return again
        return fitted(model.vehicle, wanted, model.problem, self.reach, ITERATIONS)

    def refuted(self, effect: str, vehicle: Vehicle) -> bool:
        """Whether kinematics contradicts what the dynamics would have the velocity log misread."""
        test = self.sensors.get(effect)
        return test is not None and any(vetoed(test, table) for table in vehicle.effects(effect))

    def joined(self, model: Model, chosen: Sequence[str], now: Round, name: str) -> Model:
        """The model with a suspect, fitted from where the linearised problem says that both should be."""
        suspect, columns = now.ranked[name]
        both, step = [*now.own, *columns], np.zeros(len(now.normal.gram[0]) - 1)
        _, step[both] = linear_step(now.normal, both)
        own = model.unknown.within(model.values + step[: len(model.values)] * model.unknown.scales)
        vehicle, table = model.unknown.at(own), suspect.begin(step[columns])
        wanted: Wanted = [*self.base, *chosen, table]
        begun = msgspec.structs.replace(vehicle, effect=(*vehicle.without(name).effect, table))
        cost, along = model.problem.cost(begun, step, now.normal)
        if cost > model.normal.cost:  # too far for a linear guess: the effect begins alone
            vehicle, along = model.vehicle, model.problem
        try:
            return fitted(vehicle, wanted, along, self.reach, QUICK)
        except DataError:  # and too far even so: it begins as the vehicle has it
            return fitted(model.vehicle, [*self.base, *chosen, name], model.problem, self.reach, QUICK)

    def grow(self, told: Progress) -> tuple[Model, list[Found], Round]:
        """Let the best effect join until nothing more is significant and material.

        Args:
            told: Called with a few words and the share of the work done.

        Returns:
            The model, what joined it, and the last round, in which nothing did.
        """
        model, found = self.first, list[Found]()
        while True:
            chosen = [one.effect for one in found]
            told(f"{len(found)} found, looking for more", 0.2 + 0.15 * len(found))
            now = self.round(model, chosen)
            if len(found) == MOST or not any(self.belongs(*one, model) for one in now.gains.items()):
                return model, found, now
            fits = self.contend(model, chosen, now)
            best = leader(fits)
            if best is None or not self.belongs(best, model.normal.cost - fits[best].normal.cost, model):
                return model, found, now
            found.append(Found(best, now.p_value, fits))
            model = fits[best]

    def reconsider(self, model: Model, found: Sequence[Found]) -> tuple[Model, list[Found], dict[str, Model]]:
        """Drop what the others have made needless, and swap what another effect does better in its place.

        Returns:
            The model, what is left in it, and by name of each effect the model without it.
        """
        kept, without = list(found), dict[str, Model]()
        for one in found:
            others = [other.effect for other in kept if other is not one]
            if not others:
                without[one.effect] = self.first
                continue
            lesser = self.lesser(model, one.effect, others)
            if not self.belongs(one.effect, lesser.normal.cost - model.normal.cost, lesser):
                kept.remove(one)
                model = lesser
                continue
            at = kept.index(one)
            if one is not found[-1] or len(kept) < len(found):
                now = self.round(lesser, others)
                fits = self.contend(lesser, others, now, {one.effect: model})
                best = leader(fits) or one.effect
                kept[at] = Found(best, min(now.p_value, one.p_value), fits)
                model = fits[best]
            without[kept[at].effect] = lesser
        if len(kept) == 1 < len(found):  # beside what has been dropped it may have looked larger than it is
            (one,) = kept
            without[one.effect] = self.first
            if not self.belongs(one.effect, self.first.normal.cost - model.normal.cost, self.first):
                return self.first, [], {}
        return model, kept, without

    def lesser(self, model: Model, effect: str, others: Sequence[str]) -> Model:
        """The model without one of its findings, all others fitted anew."""
        given = [e for e in self.first.vehicle.effect if e["name"] == effect]
        rest = model.vehicle.without(effect).effect
        vehicle = msgspec.structs.replace(model.vehicle, effect=(*rest, *given))
        return fitted(vehicle, [*self.base, *others], model.problem, self.reach, QUICK)


def leader(fits: Mapping[str, Model]) -> str | None:
    """The effect whose model explains most for its parameters; None of none."""
    return min(fits, key=lambda name: float(fits[name].penalised.sum()), default=None)


def fitted(
    vehicle: Vehicle, effects: Wanted, problem: Problem, reach: Array, iterations: int, share: float = SLOW
) -> Model:
    """Fit effects to the shots from the values that they have; with none, the vehicle as it is.

    A step that would take less than a `share` of what is left ends the fit.

    Raises:
        DataError: The predicted motion knows no bounds.
    """
    if effects:
        unknown = free(vehicle, effects, reach=reach)
        values, normal, problem = descend(unknown, unknown.starts[0], problem, iterations, COARSE, share)
    else:
        unknown, values = Free(vehicle, (), (np.zeros(0),), frozenset()), np.zeros(0)
        normal = problem.linearise(vehicle, [], [])
    if not np.isfinite(normal.cost):
        raise DataError(
            "the vehicle's predicted motion grows beyond all bounds within two seconds; check its damping, "
            "or begin with `hydro fit --effect linear_damping`"
        )
    return Model(unknown, values, problem, normal)


def own_effects(vehicle: Vehicle) -> tuple[str, ...]:
    """Effects of the file that are fitted anew first: all but inertia, known best, and repeated ones."""
    names = dict.fromkeys(str(effect["name"]) for effect in vehicle.effect)
    several = repeated(vehicle)
    return tuple(name for name in names if CATALOGUE[name].kind != "inertia" and name not in several)


def repeated(vehicle: Vehicle) -> tuple[str, ...]:
    """Names that several effects of the file share: it is not clear which of them a fit would mean."""
    names = [str(effect["name"]) for effect in vehicle.effect]
    return tuple(name for name in dict.fromkeys(names) if names.count(name) > 1)
