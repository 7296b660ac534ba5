"""In words, what no effect explains: on which axis, where most, and how it grows with speed."""

from __future__ import annotations

import numpy as np
import polars as pl

from hydro.core.columns import Array
from hydro.core.evaluation import failure_regimes
from hydro.core.evaluation.misfit import Misfit, Motion, force
from hydro.core.evaluation.regimes import Pieces, families
from hydro.core.identification.candidate import candidate
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle

LEAST_PIECES = 50
BINS = 8  # of speed, equally full
FLAT = 0.3  # exponent below which a force is said not to grow


def words(vehicle: Vehicle, record: Recording, raw: pl.DataFrame, seed: int = 0) -> str:
    """Where the wrench that a model leaves out is greatest, and how it grows.

    Args:
        vehicle: The model with all that was found.
        record: The recording.
        raw: Its table, for the names of its sessions.
        seed: Of the noise that the noise floor is found with.
    """
    motion, pieces = Motion.of(record), Pieces.of(record)
    misfit, _, _ = force(candidate(vehicle), record, motion, pieces, seed)
    excess = misfit.weight * (misfit.squares - misfit.noise)
    whole = np.maximum(excess.sum(axis=0), 0.0)
    if not whole.any():
        return "what is left is no more than noise in the forces: look at the log's own errors"
    axis = int(whole.argmax())
    names = [str(name) for name in raw["session"].gather(record.segments[:, 0])]
    found = families(record, vehicle, pieces, motion.eta, motion.nu, motion.nu_dot, names)
    listed = failure_regimes.rank(excess / whole.sum(), misfit.rows, pieces.block, found)
    told = f"mostly {misfit.axes[axis]} ({whole[axis] / whole.sum():.0%} of it)"
    there = next((place for place in listed if place.axis == axis), None)
    if there is not None and there.words:
        told += f", most of it {there.words}"
    speed = np.sqrt(pieces.total((motion.nu[:, :3] ** 2).sum(axis=1)) / misfit.rows)
    if (power := growth(speed, _mean(misfit, axis))) is not None:
        grows = (
            f"grows about as speed to the power {power:.1f}" if power > FLAT else "does not grow with speed"
        )
        told += f"; it {grows}"
    return told


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
