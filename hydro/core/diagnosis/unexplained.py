"""What no effect explains: whether there is any, on which axis, where most, and how it grows with speed.

Errors of a model show as forces that last: over two seconds a steady wrench of the shot's own takes up most
of what a current that comes and goes, a wall or a swell does.  White noise of the sensors it takes up by six
numbers' worth a shot, and no more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import cast

import msgspec
import numpy as np

from hydro.core.columns import DOF, VELOCITY, Array
from hydro.core.diagnosis.baseline import Baseline, Outcome
from hydro.core.diagnosis.confidence import explained_share
from hydro.core.diagnosis.findings import FIT, Finding
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.search import Search
from hydro.core.effects.catalogue import wholly_known
from hydro.core.effects.surroundings import steady_pull
from hydro.core.evaluation import failure_regimes
from hydro.core.evaluation.force_error import force
from hydro.core.evaluation.misfit import Misfit
from hydro.core.evaluation.regimes import Pieces, families
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.experiment import advice
from hydro.core.identification.levenberg_marquardt import linear_step
from hydro.core.identification.prior import greatest_change
from hydro.core.identification.suspects import choice, of_entries
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import Normal, block_length
from hydro.core.prediction.output_error import OutputError
from hydro.core.prediction.parameters import free
from hydro.core.recording.arrays import drawn
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation_from_quaternion

STRUCTURED = 0.05
"""Share of the noise that error which no effect explains must reach to be a finding."""
LEFT = 0.05
"""Share of the error beyond the noise which it must reach besides."""
PULL = 0.01  # of the vehicle's weight
WRENCH = 6
LEAST_PIECES = 50
BINS = 8  # of speed, equally full
FLAT = 0.3  # exponent below which a force is said not to grow


def unexplained(baseline: Baseline, outcome: Outcome, *, stated: bool = False) -> list[Finding]:
    """That structured error remains which no effect explains; nothing where only noise does.

    Structured is what some effect answers to by more than chance, or, where the sensors' noise is white,
    what a steady force in each shot would.  A mean squared residual above FIT is structured whatever the
    tests say: noise does not leave it.  Where nothing was found either, the verdict is `far_from_noise`.

    Args:
        baseline: The file and the shots.
        outcome: What was found.
        stated: Whether an effect is stated that no search found, as by transfer.
    """
    first, model, last = baseline.refitted, outcome.model, outcome.last
    far = not model.normal.chi2 <= FIT
    whole = first.excess / max(1.0 - baseline.calmed, 1e-9)  # what waves hid of it included
    if not far and model.excess < max(LEFT * whole, STRUCTURED * model.normal.residuals):
        return []
    if not (far or last.significant or (_white(baseline) and _steady_share(model) >= STRUCTURED)):
        return []
    share, low, high = explained_share(
        model.excesses, first.excesses, max(block_length(model.normal.score), 1)
    )
    where = leftover(model.vehicle, baseline.log)
    words = f"structured error remains that no effect of the catalogue explains: {where.words()}"
    alone = far and not (outcome.found or stated)
    if alone:
        words = (
            f"mean squared residual {model.normal.chi2:.3g} of the noise (a fit leaves at most {FIT:g}), and "
            f"no effect of the catalogue earns it: {where.words()}{where.growing()}; {where.experiment()}"
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
    """Effects held as known that explain more of the error with other values than anything that was found.

    They are tested as if they were not known, where nothing has joined the model yet: what joins may stand
    for them.
    """
    search, first = Search(baseline), baseline.refitted
    joined = outcome.found[:1]
    found = max((first.normal.cost - one.rivals[one.effect].normal.cost for one in joined), default=0.0)
    for name in dict.fromkeys(str(table["name"]) for table in baseline.vehicle.effect):
        if not wholly_known(baseline.vehicle, name):
            continue
        open_ = released(first.vehicle, name)
        screening = search.screened(first, [of_entries(open_, name)])
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
    """The vehicle with nothing of an effect held as known."""
    tables = (t | {"known": False} if t["name"] == name else t for t in vehicle.effect)
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def _white(baseline: Baseline) -> bool:
    """Whether the noise of all sensors is white, so that nothing else is steady over a shot."""
    weights, log = baseline.problem.shots.sigma, baseline.log
    return np.array_equal(weights, log.noise) and not drawn(log.record)


def _steady_share(model: Model) -> float:
    """What steady forces explain of what a model leaves."""
    return steady_disturbance(steady_wrenches(cast(OutputError, model.problem), model.vehicle))


def steady_wrenches(problem: OutputError, vehicle: Vehicle) -> Normal:
    """The linearised problem whose six columns are steady wrenches: forces in NED, moments about body axes.

    Args:
        problem: The shots.
        vehicle: What they are predicted by.
    """
    disturbed = list(steadily_disturbed(vehicle))
    normal = problem.linearise(vehicle, disturbed, [1.0] * len(disturbed))
    turned = wrenches_of_pulls(rotation_from_quaternion(problem.shots.first[:, 3:7]))
    mix = np.zeros((len(turned), len(disturbed) + 1, WRENCH + 1))
    mix[:, :-1, :-1], mix[:, -1, -1] = turned, 1.0
    kept = ~normal.lost
    gram = np.zeros((len(turned), WRENCH + 1, WRENCH + 1))
    gram[kept] = mix[kept].transpose(0, 2, 1) @ normal.gram[kept] @ mix[kept]
    gram[~kept, -1, -1] = np.inf
    return replace(normal, gram=gram, follow=normal.follow @ mix)


def steadily_disturbed(vehicle: Vehicle) -> Iterator[Vehicle]:
    """The vehicle under a small steady pull north, east or down, at CO, ahead, to starboard or below."""
    pull = PULL * vehicle.rigid_body.mass * vehicle.environment.gravity
    lever = 0.5 * vehicle.hull.length
    for place in (np.zeros(3), *np.eye(3)):
        for way in np.eye(3):
            cable = steady_pull(pull, way, lever * place)
            yield msgspec.structs.replace(vehicle, effect=(*vehicle.effect, cable))


def wrenches_of_pulls(rotation: Array) -> Array:
    """How the twelve pulls of `steadily_disturbed` make six independent wrenches at any attitude.

    Levers are fixed to the body and pulls to the world, so that one pull off CO may have no moment: it turns
    with the attitude.  Three pulls e_k x e_i at the ends of the body's axes e_i, each with its opposite at
    CO, are the couple 2 e_k at every attitude, without a force.

    Args:
        rotation: Body to world, (S, 3, 3).

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
    """How much of the residual steady wrenches explain beyond chance, in units of the noise's square.

    Args:
        normal: The problem of `steady_wrenches`.

    Returns:
        0 where nothing but white noise is left, of whatever size.
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


@dataclass(frozen=True)
class Leftover:
    """Where the wrench that a model leaves out is greatest, and how it grows.

    Attributes:
        axis: Of the wrench, 0 to 5; None where what is left is no more than noise in the forces.
        share: Part of the whole that is on this axis.
        name: The axis' name.
        place: Where most of that is, in words; empty where it is everywhere.
        power: Exponent of its growth with speed; None where that is not seen.
        powers: The same with the size of each velocity u to r alone.
    """

    axis: int | None = None
    share: float = 0.0
    name: str = ""
    place: str = ""
    power: float | None = None
    powers: tuple[float | None, ...] = (None,) * len(VELOCITY)

    def words(self) -> str:
        """Axis, place and growth with speed."""
        if self.axis is None:
            return "what is left is no more than noise in the forces: look at the log's own errors"
        text = f"mostly {self.name} ({self.share:.0%} of it)"
        if self.place:
            text += f", most of it {self.place}"
        if self.power is None:
            return text
        if self.power > FLAT:
            return f"{text}; it grows about as speed to the power {self.power:.1f}"
        return f"{text}; it does not grow with speed"

    def growing(self) -> str:
        """Growth with each velocity that it grows with, the steepest first; empty of none."""
        told = ", ".join(f"{VELOCITY[i]} to the power {self.powers[i]:.1f}" for i in self._steepest())
        return f"; by velocities, it grows with {told}" if told else ""

    def experiment(self) -> str:
        """What to fly so that this part of the error stands alone."""
        if self.axis is None:
            return "check the log with `hydro import`, its units, axes and time stamps"
        grown = self._steepest()
        if grown:
            return (
                f"to tell: one velocity at a time, {DOF[grown[0]]} first, at four speeds or more, both ways, "
                "and coast down without thrust after each"
            )
        return (
            f"to tell: hold still without thrust at several headings, tilts and depths, then each thruster "
            f"alone at several commands, and see which of them brings the error in {DOF[self.axis]}"
        )

    def _steepest(self) -> list[int]:
        grown = [(power, i) for i, power in enumerate(self.powers) if power is not None and power > FLAT]
        return [i for _, i in sorted(grown, reverse=True)]


def leftover(vehicle: Vehicle, log: Preprocessed, seed: int = 0) -> Leftover:
    """Where the wrench that a model leaves out is greatest, and how it grows.

    Args:
        vehicle: The model with all that was found.
        log: The recording.
        seed: Of the noise that the noise floor is found with.
    """
    record = log.record
    motion, pieces = Motion.of(record), Pieces.of(record)
    misfit, _, _ = force(candidate(vehicle), record, motion, pieces, seed)
    excess = misfit.weight * (misfit.squares - misfit.noise)
    whole = np.maximum(excess.sum(axis=0), 0.0)
    if not whole.any():
        return Leftover()
    axis = int(whole.argmax())
    found = families(record, vehicle, pieces, motion.eta, motion.nu, motion.nu_dot, log.sessions)
    places = failure_regimes.rank(excess / whole.sum(), misfit.rows, pieces.block, found)
    there = next((place for place in places if place.axis == axis), None)
    left = _mean(misfit, axis)

    def power(columns: slice) -> float | None:
        speed = np.sqrt(pieces.total((motion.nu[:, columns] ** 2).sum(axis=1)) / misfit.rows)
        return growth(speed, left)

    return Leftover(
        axis,
        float(whole[axis] / whole.sum()),
        misfit.axes[axis],
        there.words if there is not None else "",
        power(slice(3)),
        tuple(power(slice(i, i + 1)) for i in range(len(VELOCITY))),
    )


def growth(speed: Array, square: Array) -> float | None:
    """Exponent n in force ~ speed^n, from means over equally full bins of speed; None where it is not seen.

    Args:
        speed: Of each piece [m/s], (P,).
        square: Mean squared force beyond the noise, (P,).
    """
    if len(speed) < LEAST_PIECES:
        return None
    order = np.array_split(np.argsort(speed), BINS)
    v = np.array([speed[part].mean() for part in order])
    f = np.array([square[part].mean() for part in order])
    seen = (f > 0.0) & (v > 0.0)
    if seen.sum() < 3 or v[seen].max() < 1.5 * v[seen].min():
        return None
    return float(0.5 * np.polyfit(np.log(v[seen]), np.log(f[seen]), 1)[0])


def _mean(misfit: Misfit, axis: int) -> Array:
    mean: Array = (misfit.squares - misfit.noise)[:, axis] / misfit.rows
    return mean
