"""What no effect explains: whether there is any, on which axis, where most, and how it grows with speed.

Errors of a model show as forces that last: over two seconds a steady wrench of the shot's own takes up most
of what a current that comes and goes, a wall or a swell does.  White noise of the sensors it takes up by six
numbers' worth a shot, and no more.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.diagnosis.confidence import explained_share
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.log_faults import Preprocessed
from hydro.core.diagnosis.model import Model
from hydro.core.diagnosis.search import Baseline, Outcome
from hydro.core.effects.surroundings import steady_pull
from hydro.core.evaluation import failure_regimes
from hydro.core.evaluation.misfit import Misfit, Motion, force
from hydro.core.evaluation.regimes import Pieces, families
from hydro.core.identification.candidate import candidate
from hydro.core.identification.normal_equations import Normal, block_length
from hydro.core.recording.arrays import drawn
from hydro.core.vehicle.description import Vehicle

STRUCTURED = 0.05
"""Share of the noise that error which no effect explains must reach to be a finding."""
LEFT = 0.05
"""Share of the error beyond the noise which it must reach besides."""
PULL = 0.01  # of the vehicle's weight
WRENCH = 6
LEAST_PIECES = 50
BINS = 8  # of speed, equally full
FLAT = 0.3  # exponent below which a force is said not to grow


def unexplained(baseline: Baseline, outcome: Outcome) -> list[Finding]:
    """That structured error remains which no effect explains; nothing where only noise does.

    Structured is what some effect answers to by more than chance, or, where the sensors' noise is white,
    what a steady force in each shot would.
    """
    first, model, last = baseline.refitted, outcome.model, outcome.last
    if model.excess < max(LEFT * first.excess, STRUCTURED * model.normal.residuals):
        return []
    if not last.significant and not (_white(baseline) and _steady_share(model) >= STRUCTURED):
        return []
    share, low, high = explained_share(
        model.excesses, first.excesses, max(block_length(model.normal.score), 1)
    )
    where = describe(model.vehicle, baseline.log)
    return [
        Finding(
            "none_of_the_known",
            share=share,
            low=low,
            high=high,
            p_value=last.p_value if last.significant else np.nan,
            advice=f"structured error remains that no effect of the catalogue explains: {where}",
        )
    ]


def _white(baseline: Baseline) -> bool:
    """Whether the noise of all sensors is white, so that nothing else is steady over a shot."""
    weights, log = baseline.problem.shots.sigma, baseline.log
    return np.array_equal(weights, log.noise) and not drawn(log.record)


def _steady_share(model: Model) -> float:
    """What steady forces explain of what a model leaves."""
    disturbed = list(steadily_disturbed(model.vehicle))
    return steady_disturbance(model.problem.linearise(model.vehicle, disturbed, [1.0] * WRENCH))


def steadily_disturbed(vehicle: Vehicle) -> Iterator[Vehicle]:
    """The vehicle under a small steady pull: three at CO along north, east and down, three off CO."""
    pull = PULL * vehicle.rigid_body.mass * vehicle.environment.gravity
    lever = 0.5 * vehicle.hull.length
    for arm in (0.0, lever):
        for way in range(3):
            cable = steady_pull(pull, np.eye(3)[way], arm * np.eye(3)[(way + 1) % 3])
            yield msgspec.structs.replace(vehicle, effect=(*vehicle.effect, cable))


def steady_disturbance(normal: Normal) -> float:
    """How much of the residual steady wrenches explain beyond chance, in units of the noise's square.

    Args:
        normal: The problem whose columns are the six pulls.

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


def describe(vehicle: Vehicle, log: Preprocessed, seed: int = 0) -> str:
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
        return "what is left is no more than noise in the forces: look at the log's own errors"
    axis = int(whole.argmax())
    found = families(record, vehicle, pieces, motion.eta, motion.nu, motion.nu_dot, log.sessions)
    places = failure_regimes.rank(excess / whole.sum(), misfit.rows, pieces.block, found)
    text = f"mostly {misfit.axes[axis]} ({whole[axis] / whole.sum():.0%} of it)"
    there = next((place for place in places if place.axis == axis), None)
    if there is not None and there.words:
        text += f", most of it {there.words}"
    speed = np.sqrt(pieces.total((motion.nu[:, :3] ** 2).sum(axis=1)) / misfit.rows)
    power = growth(speed, _mean(misfit, axis))
    if power is None:
        return text
    return text + (
        f"; it grows about as speed to the power {power:.1f}"
        if power > FLAT
        else "; it does not grow with speed"
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
