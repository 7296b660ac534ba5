"""Stepwise search for missing effects: test the whole catalogue against the residual, and fit the best.

All candidates are linearised together about the present model, over short shots
(`prediction.multiple_shooting`).  A score test asks whether the largest gain exceeds chance
(`evaluation.score_test`).  The candidates with the largest gains are then fitted together with the model.
The best joins it, and the search continues.  Where the best of the first round does not explain the error
alone, pairs of effects decide.  Where the residual is far above the noise, a few shots separate most
candidates, and only the rest are fitted to all shots.  Afterwards every finding must still be needed with the
others, and be the best in its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import combinations
from typing import cast

import msgspec
import numpy as np

from hydro.core.diagnosis.baseline import Baseline, Found, Grown, Outcome
from hydro.core.diagnosis.model import (
    Diverges,
    Model,
    Screening,
    Wanted,
    beyond_noise,
    fit_model,
    leader,
    not_ruled_out,
    penalty,
)
from hydro.core.diagnosis.provisional import Provisional, Told
from hydro.core.diagnosis.selection import Rounds, grow
from hydro.core.diagnosis.sensor_errors import refuted
from hydro.core.diagnosis.settings import (
    ALMOST_ALL,
    CLOSEST,
    CONTENDERS,
    DISTINCT,
    FAR_FROM_NOISE,
    FIT,
    FURTHER,
    MATERIAL,
    MOST_FINDINGS,
    QUICK_STEPS,
    RIGHT,
    SHOTS,
    SIMILAR,
    SIMILAR_CURVED,
    STEP_SHARE,
    VISIBLE,
)
from hydro.core.effects.catalogue import CATALOGUE
from hydro.core.identification.levenberg_marquardt import ITERATIONS, Problem, linear_step
from hydro.core.identification.suspects import is_curved, plainer, shapes, suspects, with_one_value
from hydro.core.prediction.output_error import OutputError
from hydro.core.progress import Progress, part
from hydro.core.vehicle.description import Vehicle

Pair = tuple[str, str]
"""Names of two candidates."""


@dataclass(frozen=True)
class Round:
    """Result of one round of a search.

    Attributes:
        screening: Test of all candidates.
        found: Effect with the least penalised cost; None if none was fitted.
    """

    screening: Screening
    found: Found | None = None


@dataclass(frozen=True)
class Search:
    """Stepwise search for missing effects from a baseline.

    The argument `chosen` of its methods always names the effects that joined the model.

    Attributes:
        baseline: Start of the search.
        from_file: Whether fits also start at the file's values, if their residual is far above the noise.
            Without the missing effect, refitted values can run away and no step leads back.  Such a search
            continues if its first finding explains ALMOST_ALL: only hull laws absorb so much error.
        made: Fits by their starting values.  Searches that share them repeat none, for example where the file
            has hardly any free effect.
        told: Called once with the best candidate after the first fits; None for a search that reports none.
        reported: Candidates that were reported to `told`, shared by all searches of one diagnosis.
        other: Outcome of another search; a search that only repeats it ends.  None without one.
        far: Residual in units of the noise; if the first effect leaves more, the search pauses.
    """

    baseline: Baseline
    from_file: bool = False
    made: dict[tuple[object, ...], Model] = field(default_factory=dict, repr=False)
    told: Told | None = None
    reported: list[Provisional] = field(default_factory=list, repr=False)
    other: Outcome | None = None
    far: float = np.inf

    def wrong(self, outcome: Outcome) -> bool:
        """Return whether something is missing and no model with the effects found is right.

        A residual above FIT is too large for a fit, whatever the tests of single effects show.
        """
        model, left = outcome.model, outcome.model.normal.chi2
        there = bool(outcome.found) or outcome.last.significant or not left <= FIT
        return there and not left <= RIGHT and not self.baseline.explained(model) >= ALMOST_ALL

    def screen(self, model: Model, chosen: Sequence[str]) -> Screening:
        """Return the linearised test of all effects outside a model against the model's residual."""
        known, reach = [*self.baseline.effects, *chosen], self.baseline.log.track
        return self.baseline.screened(model, suspects(model.vehicle, without=known, reach=reach))

    def fewer(self, model: Model) -> Model:
        """Return the model over SHOTS / 2 shots if its residual is above RIGHT times the noise.

        Otherwise, and with fewer than SHOTS shots, return the model itself.
        """
        enough = model.normal.chi2 > RIGHT and len(model.costs) >= SHOTS
        return model.some(SHOTS // 2) if enough else model

    def contend(
        self,
        model: Model,
        chosen: Sequence[str],
        screening: Screening,
        progress: Progress,
        known: Mapping[str, Model] | None = None,
    ) -> dict[str, Model]:
        """Fit each of the candidates with the largest gains together with the model.

        One test over all effects decides whether something is missing; the fits decide which.  An effect with
        many parameters may be the answer although few blocks cannot test it alone.  Errors of the velocity
        sensor that kinematics shows come before any force.  Errors that kinematics refutes are dropped.

        Returns:
            Fits by effect; only those in `known` if no gain is significant.
        """
        known = known or {}
        if not screening.significant:
            return dict(known)
        gains = screening.gains
        sure = [name for name in self.baseline.sensors if name in gains and self.baseline.sure(name)]
        material = {name: gains[name] for name in sure if self.baseline.material(gains[name], model)}
        fits = dict(known)
        if material:
            fits = self.fitted(model, chosen, screening, material, part(progress, 0.0, 0.3), known)
        new = fits.keys() - known.keys()
        if not any(
            self.baseline.belongs(name, model.normal.cost - fits[name].normal.cost, model) for name in new
        ):
            # Refuted, or no better: a missing force biases the sensor errors that the dynamics suggest.
            rest = {name: gain for name, gain in gains.items() if name not in material}
            fits = self.fitted(model, chosen, screening, rest, part(progress, 0.3, 1.0), known)
        return fits

    def fitted(
        self,
        model: Model,
        chosen: Sequence[str],
        screening: Screening,
        gains: Mapping[str, float],
        progress: Progress,
        known: Mapping[str, Model],
    ) -> dict[str, Model]:
        """Fit some candidates quickly, and the closest of them to convergence.

        Returns:
            The fits to convergence over all shots, by effect.
        """
        few = screening.model is not model
        rivals = {name: fit.some(SHOTS // 2) if few else fit for name, fit in known.items()}
        fits = self.quick_fits(chosen, screening, gains, rivals, progress)
        self._tell(fits, screening.model)
        order = sorted(fits, key=lambda name: fits[name].normal.chi2)
        last, least = dict(known) if few else fits, np.inf
        for number, name in enumerate((not_ruled_out(fits) if few else order)[:CLOSEST]):
            progress(f"{name}, fitted to convergence", 0.6 + 0.4 * number / CLOSEST)
            if beyond_noise(fits[name]) > FIT * least:
                continue
            if name not in known:
                try:
                    last[name] = self.converged(fits[name], model, [*chosen, name])
                except Diverges:
                    continue
            least = min(least, beyond_noise(last[name]) + VISIBLE)
        return self.with_plainer(self.with_one_value(last, chosen), chosen)

    def with_one_value(self, fits: Mapping[str, Model], chosen: Sequence[str]) -> dict[str, Model]:
        """Return fits, by effect, with one value for all thrusters where the penalised cost is less.

        A lower supply voltage, for instance, weakens all thrusters alike.
        """
        found = dict(fits)
        for name, one in fits.items():
            table = with_one_value(one.vehicle, name, self.baseline.vehicle)
            if table is None:
                continue
            with suppress(Diverges):
                common = self._fit(one.vehicle.without(name), [*chosen, table], one.problem, ITERATIONS)
                found[name] = min(one, common, key=lambda each: float(each.penalised.sum()))
        return found

    def _tell(self, fits: Mapping[str, Model], before: Model) -> None:
        """Report the best of the first fits to `told`, once."""
        if self.told is not None and not self.reported and (best := Provisional.of(fits, before)) is not None:
            self.reported.append(best)
            self.told(best)

    def with_plainer(self, fits: dict[str, Model], chosen: Sequence[str]) -> dict[str, Model]:
        """Return fits, by effect, together with fits of simpler special cases of the best effect.

        The best effect is left out if a special case is within DISTINCT standard errors of it.
        """
        best = leader(fits)
        if best is None:
            return fits
        vehicle, plain = fits[best].vehicle.without(best), dict[str, Model]()
        for table in plainer(fits[best].vehicle, best, self.baseline.vehicle):
            with suppress(Diverges):
                plain[table["name"]] = self._fit(vehicle, [*chosen, table], fits[best].problem, ITERATIONS)
        least = min((model.normal.cost for model in plain.values()), default=np.inf)
        if least - fits[best].normal.cost <= DISTINCT**2 * max(fits[best].normal.chi2, 1.0):
            del fits[best]
        return {**fits, **plain}

    def quick_fits(
        self,
        chosen: Sequence[str],
        screening: Screening,
        gains: Mapping[str, float],
        known: Mapping[str, Model],
        progress: Progress,
    ) -> dict[str, Model]:
        """Fit quickly those candidates whose gain is close to the largest.

        If none of them is acceptable, the change is too large for linear gains, and further ones follow.

        Returns:
            Existing and new fits, by effect.
        """
        most, fits, vehicle = max(gains.values(), default=0.0), dict(known), screening.model.vehicle

        def is_near(name: str) -> bool:
            all_explained = any(fit.excess < VISIBLE * fit.normal.residuals for fit in fits.values())
            near = (SIMILAR_CURVED if is_curved(name) and not all_explained else SIMILAR) * most
            return screening.gains[name] >= near and len(fits) < CONTENDERS

        def is_further(name: str) -> bool:
            left = min((fit.normal.chi2 for fit in fits.values()), default=np.inf)
            return left > FIT and len(fits) < 2 * CONTENDERS

        for name, wanted in [*((one, is_near) for one in gains), *((one, is_further) for one in gains)]:
            if name in fits or not wanted(name):
                continue
            progress(f"{name} against the residual", 0.6 * len(fits) / (2 * CONTENDERS))
            fine = shapes(vehicle, name, reach=self.baseline.log.track)
            try:
                finer = self.baseline.screened(screening.model, fine) if fine else screening
                fit = self.joined(chosen, finer, name)
            except Diverges:  # from every start: not a contender
                continue
            if not refuted(self.baseline.sensors, name, fit.vehicle):
                fits[name] = fit
        return fits

    def converged(self, quick: Model, before: Model, chosen: Sequence[str]) -> Model:
        """Return a candidate fitted to convergence over all shots.

        The fit restarts at the measured states, because initial states fitted with a poor model can hold a
        good one back.  If both starts diverge, the quick fit is returned.

        Raises:
            Diverges: Both starts diverge, and the quick fit used a few of the shots only.
        """
        few = len(quick.costs) < len(before.costs)
        enough = quick.normal.chi2 * (RIGHT if few else 1.0)
        at_sight = self.baseline.problem.at_measured_states
        along, best = before.problem if few else quick.problem, quick
        for problem, most in ((at_sight(quick.vehicle), enough), (along, np.inf)):
            try:
                again = self._fit(quick.vehicle, chosen, problem, ITERATIONS)
            except Diverges:
                continue
            if again.normal.chi2 <= most:
                best = again
                break
        if self.from_file and (best is quick or best.normal.chi2 > RIGHT):
            filed = self.baseline.as_filed(quick.vehicle)
            with suppress(Diverges):
                again = self._fit(filed, chosen, at_sight(filed), ITERATIONS)
                best = again if again.normal.chi2 < best.normal.chi2 else best
        if few and best is quick:
            raise Diverges("a fit to a few of the shots does not hold for all of them")
        return best

    def joined(self, chosen: Sequence[str], screening: Screening, *names: str) -> Model:
        """Return a screening's model with some candidates, fitted from the linearised problem's solution."""
        model, tried = screening.model, [screening.ranked[name] for name in names]
        both = [*screening.own, *(column for _, columns in tried for column in columns)]
        step = np.zeros(len(screening.normal.gram[0]) - 1)
        _, step[both] = linear_step(screening.normal, both)
        own = model.unknown.within(model.values + step[: len(model.values)] * model.unknown.scales)
        vehicle, tables = model.unknown.at(own), [one.begin(step[columns]) for one, columns in tried]
        rest = reduce(Vehicle.without, names, vehicle)
        begun = msgspec.structs.replace(vehicle, effect=(*rest.effect, *tables))
        cost, along = model.problem.cost(begun, step, screening.normal)
        if cost > model.normal.cost:  # too far for a linear step: only the effects start from it
            vehicle, along = model.vehicle, model.problem
        try:
            return self._fit(vehicle, [*chosen, *tables], along, QUICK_STEPS)
        except Diverges:  # too far even so: the effects start from their default values
            return self._fit(model.vehicle, [*chosen, *names], model.problem, QUICK_STEPS)

    def with_second(
        self, screening: Screening, fits: Mapping[str, Model], first: str
    ) -> tuple[str, dict[str, Model]]:
        """Return the fitted effect that a second one completes best, where none explains the error alone.

        The gains of all thrusters, for instance, absorb most of a current and a drag together, and no later
        step leads back from them.  The CONTENDERS most promising pairs are fitted quickly, and the most
        promising one with `first`.

        Args:
            screening: Test of all candidates.
            fits: Fits of single effects.
            first: The best of these.

        Returns:
            The effect, and its quick fit together with the second one, by the name of that one; empty if one
            effect is enough.
        """
        if not fits[first].normal.chi2 > 1.0 + MATERIAL:
            return first, {}
        pairs, together = promising_pairs(screening, fits), dict[Pair, Model]()
        for pair in dict.fromkeys([*pairs[:CONTENDERS], *[one for one in pairs if first in one][:1]]):
            with suppress(Diverges):
                together[pair] = self.joined((), screening, *pair)
        if not together:
            return first, {}
        best = min(together, key=lambda pair: float(together[pair].penalised.sum()))
        if first not in best:
            first = leader({name: fits[name] for name in best if name in fits}) or first
        return first, {name: together[best] for name in best if name != first}

    def grow(
        self,
        progress: Progress,
        start: Outcome | None = None,
        other: Outcome | None = None,
        far: float = np.inf,
    ) -> Outcome:
        """Add the best effect until no other is significant and material; return the outcome.

        Args:
            progress: Called with a short text and the share of the work done.
            start: Earlier outcome to continue from; None to start from the baseline.
            other: Outcome of another search; the search ends if it only repeats that one.
            far: Residual in units of the noise; the search ends if the first effect leaves more.
        """
        begun = start or Grown(self.baseline.refitted, ())
        rounds: Rounds[Grown, Round] = replace(self, other=other, far=far)
        found = grow(rounds, begun, progress)
        state, refused = found
        last = refused.screening if refused else None
        if last is None or last.model is not state.model:
            last = self.screen(state.model, state.effects)
        return Outcome(state.model, state.found, last)

    def is_open(self, state: Grown) -> bool:
        """Return whether another effect may join the model.

        None may if there are MOST_FINDINGS, if the search repeats `other`, if the findings explain little,
        or if another search should come first (`waits`).
        """
        model, found = state.model, state.found
        if len(found) == MOST_FINDINGS:
            return False
        if not found:
            return True
        repeats = self.other is not None and same_way(found, self.other.found)
        return not (repeats or self.explains_little(model, found) or self.waits(model, found, self.far))

    def best(self, state: Grown, progress: Progress) -> Round:
        """Screen all effects; return the round with the fitted effect of the least penalised cost, if any."""
        model, count = state.model, len(state.found)
        told = part(progress, 0.2 + 0.12 * count, 0.32 + 0.12 * count)
        told(f"{count} found, looking for more", 0.0)
        begun = self.baseline.at_file() if self.from_file and not count else model
        screening = self.screen(self.fewer(begun), state.effects)
        if screening.model is not begun and not screening.significant:
            screening = self.screen(begun, state.effects)
        if not self.telling(screening, begun) or (count and self.in_vain(screening)):
            return Round(screening)
        known = dict[str, Model]()
        if begun is not model:
            known = self.from_distant_starts(begun)
        elif screening.significant:
            known = self.looked_ahead(state)
        fits = self.contend(begun, state.effects, screening, part(told, 0.3, 1.0), known)
        best, ahead = leader(fits), dict[str, Model]()
        if best is not None and not count:
            best, ahead = self.with_second(screening, fits, best)
        return Round(screening, None if best is None else Found(best, screening.p_value, fits, ahead))

    def belongs(self, state: Grown, step: Round) -> bool:
        """Return whether a round found an effect that is material, or visible and shown by kinematics."""
        if step.found is None:
            return False
        gain = state.model.normal.cost - step.found.model.normal.cost
        return self.baseline.belongs(step.found.effect, gain, state.model)

    def added(self, state: Grown, step: Round) -> Grown:
        """Return the state with the effect of a round, whose fit becomes the model."""
        assert step.found is not None
        return Grown(step.found.model, (*state.found, step.found))

    def explains_little(self, model: Model, found: Sequence[Found]) -> bool:
        """Return whether findings explain too small a share of the baseline fit's error to continue.

        It counts only above RIGHT times the noise; findings that kinematics shows do not count.  Where a
        first effect was fitted together with a second one, that fit counts.
        """
        doubtful = sum(not self.baseline.sure(one.effect) for one in found)
        least = min(ALMOST_ALL, doubtful) if self.from_file else FURTHER * doubtful
        model = next(iter(found[-1].ahead.values()), model)
        return model.normal.chi2 > RIGHT and self.baseline.explained(model) < least

    def waits(self, model: Model, found: Sequence[Found], far: float) -> bool:
        """Return whether another search should precede a second effect of this one.

        That is so if the first effect leaves more than `far` times the noise, and explains enough to go on.
        """
        return len(found) == 1 and model.normal.chi2 > far and not self.explains_little(model, found)

    def telling(self, screening: Screening, model: Model) -> bool:
        """Return whether any tested effect may be large enough for a finding.

        Gains of nonlinear effects are scaled up, because the linearised test shows only a part of them.
        """
        return any(
            self.baseline.belongs(name, most_gain(name, gain), model)
            for name, gain in screening.gains.items()
        )

    def in_vain(self, screening: Screening) -> bool:
        """Return whether the model stays far from the noise with all effects of the catalogue together.

        Their joint gain about a model bounds that of any selection, as far as they are linear.  Such a search
        ends: its names would be by the likelihood of wrong models.
        """
        chi2 = screening.model.normal.chi2
        return chi2 > FAR_FROM_NOISE and screening.evidence.left * chi2 > FAR_FROM_NOISE

    def looked_ahead(self, state: Grown) -> dict[str, Model]:
        """Return the second effect of the last look-ahead, fitted to convergence, by name.

        It is left out where kinematics refutes it.
        """
        fits = dict[str, Model]()
        for name, quick in (state.found[-1].ahead if state.found else {}).items():
            with suppress(Diverges):
                fit = self.converged(quick, state.model, [*state.effects, name])
                if not refuted(self.baseline.sensors, name, fit.vehicle):
                    fits[name] = fit
        return fits

    def from_distant_starts(self, filed: Model) -> dict[str, Model]:
        """Return fits of the file with each effect that has starting tables far from zero in the catalogue.

        A fit of such an effect that starts from zero does not find the values.

        Returns:
            Fits by effect, each from the best of several starting tables.
        """
        fits = dict[str, Model]()
        few = self.fewer(filed)
        for name in CATALOGUE:
            if filed.vehicle.effects(name):
                continue
            begun = []
            for table in CATALOGUE[name].identification.far:
                with suppress(Diverges):
                    begun.append(self._fit(filed.vehicle, [{"name": name} | table], few.problem, QUICK_STEPS))
            if begun:
                best = min(begun, key=lambda fit: fit.normal.chi2)
                with suppress(Diverges):
                    fits[name] = self.converged(best, filed, [name])
        return fits

    def settle(self, outcome: Outcome, progress: Progress) -> Outcome:
        """Return an outcome with findings dropped or swapped; if that changed them, the search continues."""
        kept = self.reconsider(outcome, part(progress, 0.0, 0.4))
        if kept.effects == outcome.effects or not kept.found:
            return kept
        further = self.grow(part(progress, 0.4, 0.8), kept)
        if further.effects == kept.effects:
            return kept
        return self.reconsider(further, part(progress, 0.8, 1.0))

    def reconsider(self, outcome: Outcome, progress: Progress) -> Outcome:
        """Return a new outcome without needless findings, and with better effects in the place of others.

        Each finding in turn is left out and the others are refitted.  It is needless if the squared residual
        then rises too little for a finding (`Baseline.belongs`).  One that is needed competes again with the
        effects outside the model, fitted together with the other findings; the least penalised cost wins.
        The newest finding has just done so, and competes only if another was dropped.  The only one left of
        several must be a finding about the baseline, too; a finding alone from the start is not tested.
        """
        model, first, kept = outcome.model, self.baseline.refitted, list(outcome.found)
        without: dict[str, Model] = {}
        for number, one in enumerate(outcome.found):
            told = part(progress, number / len(outcome.found), (number + 1) / len(outcome.found))
            told(f"without {one.effect}", 0.0)
            others = [other.effect for other in kept if other is not one]
            if not others:
                without[one.effect] = first
                continue
            lesser = self.without(model, one.effect, others)
            if not self.baseline.belongs(one.effect, lesser.normal.cost - model.normal.cost, lesser):
                kept.remove(one)
                model = lesser
                continue
            place = kept.index(one)
            if one is not outcome.found[-1] or len(kept) < len(outcome.found):
                screening = self.screen(self.fewer(lesser), others)
                fits = self.contend(lesser, others, screening, part(told, 0.3, 1.0), {one.effect: model})
                best = leader(fits) or one.effect
                kept[place] = Found(best, min(screening.p_value, one.p_value), fits)
                model = fits[best]
            without[kept[place].effect] = lesser
        if len(kept) == 1 < len(outcome.found):
            # With the dropped finding in the model it may have looked larger than it is.
            without[kept[0].effect] = first
            if not self.baseline.belongs(kept[0].effect, first.normal.cost - model.normal.cost, first):
                return Outcome(first, (), outcome.last)
        return Outcome(model, tuple(replace(one, ahead={}) for one in kept), outcome.last, without)

    def without(self, model: Model, effect: str, others: Sequence[str]) -> Model:
        """Return the model without one finding, all others refitted; the baseline if the fit diverges."""
        in_file = [table for table in self.baseline.refitted.vehicle.effect if table["name"] == effect]
        rest = model.vehicle.without(effect).effect
        vehicle = msgspec.structs.replace(model.vehicle, effect=(*rest, *in_file))
        try:
            return self._fit(vehicle, others, model.problem, QUICK_STEPS)
        except Diverges:
            return self.baseline.refitted

    def _fit(self, vehicle: Vehicle, chosen: Wanted, problem: Problem, iterations: int) -> Model:
        """Fit the baseline's effects and the chosen ones together."""
        wanted, shots = [*self.baseline.effects, *chosen], cast(OutputError, problem).shots
        begun = (repr((vehicle.effect, wanted, iterations)), shots.starts.tobytes(), shots.first.tobytes())
        if begun not in self.made:
            known, reach = self.baseline.known, self.baseline.log.track
            fitted = fit_model(vehicle, wanted, problem, reach, iterations, known=known)
            self.made[begun] = self.baseline.compared(fitted)
        return self.made[begun]


def promising_pairs(screening: Screening, fits: Mapping[str, Model]) -> list[Pair]:
    """Return all pairs of candidates with at least one fitted effect, the most promising first.

    They are ranked by their joint linear gain, less the penalty of their parameters.
    """
    model, gains = screening.model, dict[Pair, float]()
    for pair in combinations(screening.ranked, 2):
        if not fits.keys().isdisjoint(pair):
            columns = [column for name in pair for column in screening.ranked[name][1]]
            gain = screening.evidence.gain(screening.own, columns)
            gains[pair] = gain - penalty(len(model.costs), len(columns), model.normal.chi2)
    return sorted(gains, key=lambda pair: -gains[pair])


def most_gain(effect: str, gain: float) -> float:
    """Return the largest gain in squared residual that a fit of an effect may have.

    The gain in the linearised problem shows only a part of that of a nonlinear effect.
    """
    return gain * (SIMILAR / SIMILAR_CURVED if is_curved(effect) else 1.0)


def same_way(found: Sequence[Found], others: Sequence[Found]) -> bool:
    """Return whether a search finds the same first effects as another one, without a better fit."""
    if [one.effect for one in found] != [one.effect for one in others[: len(found)]]:
        return False
    mine, theirs = (one.rivals[one.effect].normal.cost for one in (found[-1], others[len(found) - 1]))
    return mine > (1.0 - STEP_SHARE) * theirs
