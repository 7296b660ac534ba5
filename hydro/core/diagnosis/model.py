"""Steps of a search: a vehicle fitted to short shots, and candidates tested against its residual.

All candidates are linearised together about a model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.diagnosis.settings import (
    ALPHA,
    DISTINCT,
    MATERIAL,
    QUICK_STEPS,
    SMALL_STEP,
    STEP_GAIN,
    STEP_SHARE,
)
from hydro.core.effects.damping import LINEAR_DAMPING
from hydro.core.errors import DataError
from hydro.core.evaluation.score_test import Columns, Evidence, p_values
from hydro.core.identification.initial_guess import elsewhere
from hydro.core.identification.levenberg_marquardt import (
    ITERATIONS,
    Prior,
    Problem,
    descend,
    linearised,
    moved,
    searched,
)
from hydro.core.identification.outcome import Fit, information, with_uncertainty
from hydro.core.identification.passivity import possible
from hydro.core.identification.suspects import Suspect
from hydro.core.prediction.normal_equations import Normal, bounded_step
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import Free, free
from hydro.core.recording.shots import kept_evenly
from hydro.core.vehicle.description import Vehicle

Wanted = Sequence[str | Mapping[str, Any]]
"""Effects to fit: names in the catalogue, or tables with starting values."""
Fitting = Callable[..., "Model"]
"""`fit_model` with some of its arguments given; it takes vehicle, effects, problem and iterations."""


def names_of(wanted: Wanted) -> list[str]:
    """Return the names of effects that are given as names or tables."""
    return [one if isinstance(one, str) else str(one["name"]) for one in wanted]


class Diverges(DataError):
    """Error that the predicted motion of a vehicle diverges."""


@dataclass(frozen=True)
class Model:
    """Vehicle during a search, with P free components.

    Attributes:
        unknown: Free components.
        values: Fitted values, (P,).
        problem: Shots, with initial states that follow the fit.
        normal: Problem linearised about the values, in units of the components' scales.
        expected: Prior of the values of the file's effects, for comparisons with other models; None without
            one.
    """

    unknown: Free
    values: Array
    problem: Problem
    normal: Normal
    expected: Prior | None = None

    @property
    def vehicle(self) -> Vehicle:
        """Vehicle with the fitted values."""
        return self.unknown.at(self.values)

    def estimated(self) -> Fit:
        """Return the fit: values with standard errors and covariance, on a physically possible vehicle."""
        return with_uncertainty(self.unknown, self.values, self.normal, self.normal.chi2, "output")

    @property
    def step(self) -> Array:
        """Step to the least squares of the linearised problem, within the bounds, in scales, (P,)."""
        low, high = ((bound - self.values) / self.unknown.scales for bound in self.unknown.bounds)
        return bounded_step(information(self.normal), self.normal.score.sum(axis=0), low, high)

    @property
    def promised(self) -> float:
        """Squared residual that this step would remove from the linearised problem."""
        step, normal = self.step, self.normal
        return float((2.0 * normal.score.sum(axis=0) - normal.matrix.sum(axis=0) @ step) @ step)

    def over(self, kept: NDArray[np.bool_]) -> Model:
        """Return the model over those of its shots that a mask (S,) keeps."""
        problem = cast(OutputError, self.problem).over(kept)
        return replace(self, problem=problem, normal=self.normal.some(kept))

    def some(self, most: int) -> Model:
        """Return the model over at most `most` of its shots, evenly spread, without a new fit."""
        return self.over(kept_evenly(len(self.costs), most))

    @property
    def costs(self) -> Array:
        """Squared residual of each of S shots in units of the noise variance, (S,)."""
        return np.asarray(self.normal.gram[:, -1, -1])

    @property
    def excess(self) -> float:
        """Squared residual beyond the noise in units of the noise variance; at least 0."""
        return max(self.normal.cost - self.normal.residuals, 0.0)

    @property
    def excesses(self) -> Array:
        """Squared residual beyond the noise of each of S shots, (S,); it may be negative."""
        beyond: Array = self.costs - self.normal.freedom
        return beyond

    @property
    def penalised(self) -> Array:
        """Squared residual of each shot plus an equal part of the penalties, (S,).

        They are those of the number of parameters and of their distance from the file's values.  The second
        counts as far as the model's error exceeds the noise: a wrong model fits best with absurd values, and
        for a right one the likelihood decides.
        """
        shots, chi2 = len(self.costs), self.normal.chi2
        much = penalty(shots, len(self.values), chi2)
        if self.expected is not None:
            much += max(chi2 - 1.0, 0.0) * self.expected.cost(self.values / self.unknown.scales)
        penalised: Array = self.costs + much / shots
        return penalised


def penalty(shots: int, parameters: int, chi2: float) -> float:
    """Return Schwarz's penalty for parameters (1978), in units of a squared residual.

    A shot counts as one observation. So of two effects of which one includes the other, the smaller wins
    unless the larger explains more.

    It grows with the mean squared residual `chi2` beyond 1, in units of the noise.
    """
    return float(np.log(shots) * parameters * max(chi2, 1.0))


def fit_model(
    vehicle: Vehicle,
    effects: Wanted,
    problem: Problem,
    reach: Array,
    iterations: int,
    share: float = STEP_SHARE,
    known: Callable[[Free], Prior] | None = None,
) -> Model:
    """Return a model of a vehicle with effects fitted to the shots; without effects, an unfitted model.

    Effects given by name start from the vehicle's values.

    Args:
        vehicle: Vehicle.
        effects: Names or starting tables of the effects to fit.
        problem: Shots.
        reach: Positions [m] and times [s] of the recording, (N, 4): the places among which that of an effect
            fixed in the world, such as a tether's anchor, is searched for.
        iterations: Maximum number of steps; with 0 the values stay as they are.
        share: Least relative reduction of the cost by a step; a smaller one ends the fit.
        known: Function from the free components to their prior; by default a weak one.

    Raises:
        Diverges: The predicted motion diverges.
    """
    if not effects:
        model = unfitted(vehicle, problem)
    else:
        unknown = free(vehicle, effects, reach=reach)
        prior = known(unknown) if known is not None else None
        model = _descended(unknown, problem, iterations, share, prior)
    return _settled(model, iterations, share)


def _settled(model: Model, iterations: int, share: float) -> Model:
    """Return a fitted model, after a search past local minima of components with thresholds.

    The search is made only with at least ITERATIONS iterations.

    Raises:
        Diverges: The predicted motion diverges.
    """
    if iterations >= ITERATIONS and model.unknown.has_thresholds:
        model = _beyond_corners(model, iterations, share)
    if not np.isfinite(model.normal.cost):
        raise Diverges(
            "the vehicle's predicted motion diverges within two seconds; check its damping, "
            f"or start with `hydro fit --effect {LINEAR_DAMPING.name}`"
        )
    return model


def begun(vehicle: Vehicle, effects: Wanted, problem: Problem, reach: Array) -> Model:
    """Return the model at the starting values of a fit, linearised there."""
    unknown = free(vehicle, effects, reach=reach)
    values = unknown.starts[0]
    return Model(unknown, values, problem, linearised(unknown, values / unknown.scales, problem))


def continue_fit(model: Model, iterations: int, share: float = STEP_SHARE) -> Model:
    """Return a new model whose fit continues from the values of another; that model stays as it is.

    The prior is the weak default one.

    Raises:
        Diverges: The predicted motion diverges.
    """
    unknown = replace(model.unknown, starts=(model.values,))
    return _settled(
        _descended(unknown, model.problem, iterations, share, normal=model.normal), iterations, share
    )


def stepped(model: Model) -> Vehicle:
    """Return the vehicle of a model, fitted to most of its shots and others, after one step to all of them.

    Such a fit is close to the best values, so one Gauss-Newton step is enough.  If that does not lower the
    cost, the fit continues from the model's values.

    Raises:
        Diverges: No step from the values of the model reduces the cost.
    """
    unknown, normal, step = model.unknown, model.normal, model.step
    vehicle = unknown.at(unknown.within(model.values + step * unknown.scales))
    cost, _ = model.problem.cost(vehicle, step, normal)
    if cost <= normal.cost + STEP_GAIN * max(normal.chi2, 1.0):
        return vehicle
    return continue_fit(model, QUICK_STEPS // 2).vehicle


def held_at(model: Model, values: Array, held: NDArray[np.bool_], iterations: int) -> Model:
    """Return a model refitted with some of its P components held.

    Args:
        model: Model.
        values: Held values, and starting values of the others, (P,).
        held: Mask of the held components, (P,).
        iterations: Maximum number of steps.

    Raises:
        Diverges: The predicted motion diverges.
    """
    return _descended(model.unknown.holding(values, held), model.problem, iterations, STEP_SHARE)


def passive(model: Model) -> Model:
    """Return the model with the nearest values that a vehicle file accepts, such as passive damping.

    A candidate must be a vehicle that can exist: otherwise values that cannot be given decide its rank.
    """
    unknown = model.unknown
    values = possible(unknown, model.values, information(model.normal))
    if np.array_equal(values, model.values):
        return model
    normal = linearised(unknown, values / unknown.scales, model.problem)
    return replace(model, values=values, normal=normal)


def _descended(
    unknown: Free,
    problem: Problem,
    iterations: int,
    share: float,
    prior: Prior | None = None,
    normal: Normal | None = None,
) -> Model:
    """Fit free components from their first starting values.

    Args:
        unknown: Free components.
        problem: Shots.
        iterations: Maximum number of steps.
        share: Least relative reduction of the cost by a step; a smaller one ends the fit.
        prior: Prior of the components; by default a weak one.
        normal: Problem linearised at the starting values; computed if it is not given.

    Raises:
        Diverges: No step from these values reduces the cost.
    """
    try:
        values, normal, problem = descend(
            unknown, unknown.starts[0], problem, iterations, STEP_GAIN, share, prior, normal
        )
    except np.linalg.LinAlgError as error:
        effects = ", ".join(unknown.effects)
        raise Diverges(f"no step from the values of {effects} reduces the error") from error
    return Model(unknown, values, problem, normal)


def unfitted(vehicle: Vehicle, problem: Problem) -> Model:
    """Return a vehicle as a model without free components; shots that diverge have infinite costs."""
    unfree = Free(vehicle, (), (np.zeros(0),), frozenset())
    return Model(unfree, np.zeros(0), problem, problem.linearise(vehicle, [], []))


def fitted_or_kept(
    fitting: Fitting, vehicle: Vehicle, effects: Wanted, problem: Problem
) -> tuple[Model, bool]:
    """Return the vehicle with the parameters of some effects fitted to convergence, and True.

    If the fit diverges, return the model with the vehicle's present values, and False.

    Raises:
        Diverges: The predictions diverge with the present values too.
    """
    try:
        return fitting(vehicle, effects, problem, iterations=ITERATIONS), True
    except Diverges:
        return fitting(vehicle, effects, problem, iterations=0), False


def _beyond_corners(model: Model, iterations: int, share: float) -> Model:
    """Return the model, or a better one found by a line search along each component with thresholds."""
    unknown, values = model.unknown, searched(model.unknown, model.values, model.problem, SMALL_STEP)
    if np.array_equal(values, model.values):
        return model
    values, normal, problem = descend(unknown, values, model.problem, iterations, STEP_GAIN, share)
    return Model(unknown, values, problem, normal) if normal.cost < model.normal.cost else model


def from_elsewhere(fitting: Fitting, model: Model, problem: Problem, reach: Array) -> Model:
    """Return the model, or a better one from another start of one effect (`initial_guess.elsewhere`).

    `reach` is that of `fit_model`.
    """
    if model.excess < MATERIAL * model.normal.residuals:
        return model
    names = model.unknown.effects
    for values in elsewhere(model.unknown, model.values, problem, reach, model.normal.cost):
        try:
            other = fitting(model.unknown.at(values), names, problem, iterations=ITERATIONS)
        except Diverges:
            continue
        if other.normal.cost < model.normal.cost:
            model = other
    return model


@dataclass(frozen=True)
class Screening:
    """Linearised test of all candidates about one model.

    A candidate adds columns of derivatives to the linearised problem.  A nonlinear effect has several shapes,
    (starting tables), each with its own columns.

    Attributes:
        model: Model, possibly over a part of the shots.
        ranked: Best shape of each effect with its columns, the largest gain first.
        shapes: Columns of every shape of each effect.
        normal: Linearised problem of the model and all candidates.
        evidence: The same problem with columns of unit size.
        own: Columns of the model's components.
        gains: Squared residual that each effect would explain over all shots.
    """

    model: Model
    ranked: Mapping[str, tuple[Suspect, Columns]]
    shapes: Mapping[str, Sequence[Columns]]
    normal: Normal
    evidence: Evidence
    own: Columns
    gains: Mapping[str, float]

    @cached_property
    def p_value(self) -> float:
        """Probability that the largest gain is as large by chance alone."""
        return min(p_values(self.evidence, self.own, self.shapes).values(), default=1.0)

    @property
    def significant(self) -> bool:
        """Whether any gain is larger than chance allows."""
        return self.p_value <= ALPHA

    def beginning(self, name: str, information: Array) -> dict[str, Any]:
        """Return the starting table of an effect: its best shape, with values from the linearised problem.

        Args:
            name: Effect.
            information: Prior information on the P components of the model and of the effect, (P,).
        """
        suspect, columns = self.ranked[name]
        normal = self.normal.of([*self.own, *columns])
        step = np.linalg.solve(normal.matrix.sum(axis=0) + np.diag(information), normal.score.sum(axis=0))
        return {**suspect.begin(step[len(self.own) :]), "name": name}


def screened(model: Model, tried: Sequence[Suspect], shots: int) -> Screening:
    """Return the linearised test of candidates against a model's residual.

    Gains are scaled up from the model's shots to the number `shots` of all.
    """
    changed, steps = moved(model.unknown, model.values)
    own, places = range(len(changed)), list[tuple[Suspect, Columns]]()
    for suspect in tried:
        places.append((suspect, range(len(changed), len(changed) + len(suspect.steps))))
        changed += suspect.changed
        steps += suspect.steps
    normal = model.problem.linearise(model.vehicle, changed, steps)
    evidence = Evidence.of(normal)
    whole = shots / len(normal.gram)
    best: dict[str, tuple[float, Suspect, Columns]] = {}
    every: dict[str, list[Columns]] = {}
    for suspect, columns in places:
        every.setdefault(suspect.effect, []).append(columns)
        gain = evidence.gain(own, columns) * whole
        if suspect.effect not in best or gain > best[suspect.effect][0]:
            best[suspect.effect] = (gain, suspect, columns)
    order = sorted(best, key=lambda name: -best[name][0])
    ranked = {name: best[name][1:] for name in order}
    gains = {name: best[name][0] for name in order}
    return Screening(model, ranked, every, normal, evidence, own, gains)


def beyond_noise(model: Model) -> float:
    """Return the mean squared residual of a model beyond the noise, in units of the noise variance."""
    return model.excess / model.normal.residuals


def not_ruled_out(fits: Mapping[str, Model]) -> list[str]:
    """Return the names of the best model and of all that are not distinct from the best, the best first.

    A model is distinct if its penalised cost is higher by more than DISTINCT standard errors of the
    difference between shots.  All models have the same shots.
    """
    order = sorted(fits, key=lambda name: float(fits[name].penalised.sum()))
    worse = {name: fits[name].penalised - fits[order[0]].penalised for name in order}
    return [
        name for name, each in worse.items() if each.sum() <= DISTINCT * np.sqrt(len(each)) * np.std(each)
    ]


def leader(fits: Mapping[str, Model]) -> str | None:
    """Return the effect whose model has the least penalised cost; None without models."""
    return min(fits, key=lambda name: float(fits[name].penalised.sum()), default=None)
