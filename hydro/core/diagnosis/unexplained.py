"""Error that no effect explains, and known values that it contradicts.

Errors of a model appear as slowly varying forces.  Over two seconds a steady wrench, free in each shot,
absorbs most of the effect of a varying current, a wall or a swell.  Of white sensor noise it absorbs only six
numbers per shot.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import cast

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.diagnosis.baseline import Baseline, Outcome
from hydro.core.diagnosis.confidence import explained_share
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.settings import FIT, MATERIAL, SMALL_STEP
from hydro.core.effects.catalogue import wholly_known
from hydro.core.effects.surroundings import steady_pull
from hydro.core.evaluation.remaining_force import leftover
from hydro.core.experiment import advice
from hydro.core.identification.levenberg_marquardt import linear_step
from hydro.core.identification.prior import greatest_change
from hydro.core.identification.suspects import choice, of_entries
from hydro.core.prediction.normal_equations import Normal, block_length
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import free
from hydro.core.recording.arrays import drawn
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation_from_quaternion

WRENCH = 6
"""Number of components of a wrench."""


def unexplained(baseline: Baseline, outcome: Outcome, *, stated: bool = False) -> list[Finding]:
    """Return the finding that structured error remains which no effect explains; empty without such error.

    Error is structured if an effect of the catalogue reduces it by more than chance, or, with white sensor
    noise, if a steady force in each shot would.  A mean squared residual above FIT is structured whatever the
    tests show, because noise does not cause it.  If no effect was found either, the verdict is
    `far_from_noise`.

    `stated` says whether an effect that no search found is confirmed, or explains almost all, as by transfer.
    """
    first, model, last = baseline.refitted, outcome.model, outcome.last
    far = not model.normal.chi2 <= FIT
    whole = first.excess / max(1.0 - baseline.calmed, 1e-9)  # with the part that waves explain
    if not far and model.excess < max(MATERIAL * whole, MATERIAL * model.normal.residuals):
        return []
    if not (far or last.significant or _has_steady_force(baseline, model)):
        return []
    share, low, high = explained_share(model.excesses, first.excesses, block_length(model.normal.score))
    where = leftover(model.vehicle, baseline.log.record, baseline.log.sessions)
    words = f"structured error remains that no effect of the catalogue explains: {where.words()}"
    alone = far and not (outcome.found or stated)
    if alone:
        words = (
            f"mean squared residual {model.normal.chi2:.3g} times the noise variance (a fit has at most "
            f"{FIT:g}), and no effect of the catalogue explains it: {where.words()}{where.growing()}; "
            f"{where.experiment()}"
        )
    return [
        Finding(
            "far_from_noise" if alone else "none_of_the_known",
            share=share,
            low=low,
            high=high,
            p_value=last.p_value if last.significant else np.nan,
            advice=words,
        )
    ]


def contradicted(baseline: Baseline, outcome: Outcome) -> Iterator[Finding]:
    """Yield effects with known values that would explain more error with other values than any finding.

    They are tested as if free, on the model before any effect joined it, because such an effect may absorb
    their error.
    """
    first = baseline.refitted
    joined = outcome.found[:1]
    found = max((first.normal.cost - one.rivals[one.effect].normal.cost for one in joined), default=0.0)
    for name in dict.fromkeys(str(table["name"]) for table in baseline.vehicle.effect):
        if not wholly_known(baseline.vehicle, name):
            continue
        open_ = released(first.vehicle, name)
        screening = baseline.screened(first, [of_entries(open_, name)])
        gain = screening.gains[name]
        if gain < found or not (screening.significant and baseline.material(gain, first)):
            continue
        columns = screening.ranked[name][1]
        _, step = linear_step(screening.normal, [*screening.own, *columns])
        unknown = free(open_, [choice(open_, name)])
        values = unknown.starts[0] + step[len(screening.own) :] * unknown.scales
        most = greatest_change(open_, unknown.entries, values)
        share = float(np.clip(gain / max(first.excess, 1e-9), 0.0, 1.0))
        words = advice.contradicting(most, share)
        yield Finding("retune", name, (name,), share, p_value=screening.p_value, advice=words)


def released(vehicle: Vehicle, name: str) -> Vehicle:
    """Return a copy of a vehicle in which the values of an effect are not marked as known."""
    tables = (t | {"known": False} if t["name"] == name else t for t in vehicle.effect)
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def _has_steady_force(baseline: Baseline, model: Model) -> bool:
    """Return whether steady forces explain a material residual, and all noise is white.

    Noise that is not white is steady over a shot as well.
    """
    log, problem = baseline.log, cast(OutputError, model.problem)
    if drawn(log.record) or not np.array_equal(baseline.problem.shots.sigma, log.noise):
        return False
    return steady_disturbance(with_steady_wrenches(problem, model.vehicle)) >= MATERIAL


def with_steady_wrenches(
    problem: OutputError, vehicle: Vehicle, changed: Sequence[Vehicle] = (), steps: Sequence[float] = ()
) -> Normal:
    """Return the problem linearised in six steady wrench components: forces in NED, moments in body axes.

    The six columns come first; with a small change of the vehicle each, further columns follow.

    Args:
        problem: Shots.
        vehicle: Vehicle that predicts the shots.
        changed: Copies of the vehicle with one changed parameter each, whose columns follow the wrenches.
        steps: Size of each change.
    """
    pulls, rest = list(steadily_disturbed(vehicle)), len(steps) + 1
    normal = problem.linearise(vehicle, [*pulls, *changed], [*[1.0] * len(pulls), *steps])
    turned = wrenches_of_pulls(rotation_from_quaternion(problem.shots.first[:, 3:7]))
    mix = np.zeros((len(turned), len(pulls) + rest, WRENCH + rest))
    mix[:, : len(pulls), :WRENCH], mix[:, len(pulls) :, WRENCH:] = turned, np.eye(rest)
    kept = ~normal.lost
    gram = np.zeros((len(turned), WRENCH + rest, WRENCH + rest))
    gram[kept] = mix[kept].transpose(0, 2, 1) @ normal.gram[kept] @ mix[kept]
    gram[~kept, -1, -1] = np.inf
    return replace(normal, gram=gram, follow=normal.follow @ mix)


def steadily_disturbed(vehicle: Vehicle) -> Iterator[Vehicle]:
    """Yield twelve copies of a vehicle, each with one small steady pull as of a rope.

    Each pull is along one NED axis, and acts at the body origin CO, or half a hull length ahead of CO, to
    starboard or below.
    """
    pull = SMALL_STEP * vehicle.rigid_body.mass * vehicle.environment.gravity
    lever = 0.5 * vehicle.hull.length
    for place in (np.zeros(3), *np.eye(3)):
        for way in np.eye(3):
            cable = steady_pull(pull, way, lever * place)
            yield msgspec.structs.replace(vehicle, effect=(*vehicle.effect, cable))


def wrenches_of_pulls(rotation: Array) -> Array:
    """Return the amounts of the twelve pulls of `steadily_disturbed` that make six independent wrenches.

    Levers are fixed in the body and pulls in the world, so the moment of one pull off the body origin CO
    changes with attitude.  A couple about body axis e_k is made of pulls at the ends of the levers along the
    body axes e_i.  Each pull is along e_k x e_i, with its opposite at CO.  Together they are the couple 2 e_k
    at every attitude, without a force; amounts are half of that.

    Args:
        rotation: Rotation from body to world of each of S shots, (S, 3, 3).

    Returns:
        Amounts of each pull, (S, 12, 6): for the forces north, east and down, and for the couples about the
        body's axes.
    """
    mix = np.zeros((len(rotation), 4, 3, WRENCH))
    mix[:, 0, :, :3] = np.eye(3)
    for k, axis in enumerate(np.eye(3)):
        for i, place in enumerate(np.eye(3)):
            way = 0.5 * rotation @ np.cross(axis, place)
            mix[:, i + 1, :, 3 + k] += way
            mix[:, 0, :, 3 + k] -= way
    amounts: Array = mix.reshape(len(rotation), 12, WRENCH)
    return amounts


def steady_disturbance(normal: Normal) -> float:
    """Return the mean squared residual that steady wrenches explain beyond chance, relative to the rest.

    The problem is that of `with_steady_wrenches`.

    Returns:
        Ratio to the mean square of what remains; 0 on average where the residual is white noise of any size.
    """
    kept = np.isfinite(normal.gram[:, -1, -1])
    matrix, score, cost = normal.matrix[kept], normal.score[kept], normal.gram[kept, -1, -1]
    size = np.sqrt(np.einsum("sii->si", matrix)) + 1e-300
    unit = matrix / size[:, :, None] / size[:, None, :] + 1e-9 * np.eye(WRENCH)
    scaled: Array = score / size
    gain = np.einsum("si,si->s", scaled, np.linalg.solve(unit, scaled[..., None])[..., 0])
    freedom = float(normal.freedoms[kept].sum())
    noise = float((cost - gain).sum()) / (freedom - WRENCH * len(cost))
    return float(gain.sum() / noise - WRENCH * len(cost)) / freedom
