"""Estimation of the powers by which the water's force on a hull grows with each velocity.

The force is the whole force of the water on the hull: damping, drag and lift of the file plus the residual
force.  Along each axis i the model is

    F_i = -d |nu_i|^n sgn(nu_i) - sum over j of d_j |nu_j|^m_j nu_i + mixed products,

with coefficients d and d_j and powers n and m_j.  One power at a time is estimated.  Every power of a grid is
tried while all other terms have their usual powers.  The power with the least residual is reported.  Its
interval comes from a Bayesian bootstrap over blocks of the recording (Rubin 1981), since neighbouring rows
have correlated errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import polars as pl

from hydro.core.columns import VELOCITY, WRENCH, WRENCH_UNITS, Array, Rows
from hydro.core.effects import CATALOGUE
from hydro.core.effects.record import Role
from hydro.core.evaluation.block_resampling import SAMPLES, weights
from hydro.core.evaluation.force_error import missing_wrench
from hydro.core.evaluation.leftover import Means, through_water, with_samples
from hydro.core.evaluation.regimes import Pieces
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import candidate
from hydro.core.recording.arrays import Recording, recording
from hydro.core.vehicle.description import Vehicle

POWERS = np.arange(0.0, 4.01, 0.05)
"""Powers that are tried."""
RIDGE = 1e-9
"""Relative ridge that keeps the normal equations invertible."""
LEAST_SHARE = 0.02
"""Minimum share of the force's variance that a reported term explains."""
WIDEST_POWER = 1.5
"""Maximum width of a power's 95 % interval for a report: a wider interval does not separate 1 from 2."""


def growth(vehicle: Vehicle, raw: pl.DataFrame, record: Recording | None = None) -> pl.DataFrame:
    """Estimate the exponents with which the water's force on a hull grows with each velocity.

    Args:
        vehicle: The vehicle; rigid body, weight, thrusters, added mass and current of its file are used.
        raw: Raw table of the measured motion and commands.
        record: The cleaned recording as arrays; by default the table as it was logged.

    Returns:
        The growth table, with the terms that the recording shows.  Columns: `axis` i of the force; `against`,
        the velocity j through the water; `power` n with its 95 % interval `low` to `high`; `drag`, the size
        of the term at 1 m/s or 1 rad/s (positive opposes the motion), with its `unit`; and `share`, the share
        of the force's variance that the term explains.  A term is |nu_i|^n sgn(nu_i) if j = i, else |nu_j|^n
        nu_i.

    Raises:
        DataError: The recording does not fit the vehicle, or too few rows have a sample.
    """
    record, bare = record or recording(vehicle, raw), without_hull_water(vehicle)
    motion, pieces, model = Motion.of(record), Pieces.of(record), candidate(bare)
    force = missing_wrench(model, record, motion.eta, motion.nu, motion.velocity)
    means = Means.of(force, through_water(model, record, motion), with_samples(record), pieces)
    lines = [line for axis in range(6) for line in _of_axis(means, axis)]
    floats = ("power", "low", "high", "drag", "share")
    schema = {"axis": pl.String, "against": pl.String} | dict.fromkeys(floats, pl.Float64)
    return pl.DataFrame(lines, schema | {"unit": pl.String})


def without_hull_water(vehicle: Vehicle) -> Vehicle:
    """Return a copy of a vehicle without damping, drag and lift on its hull."""

    def stays(name: str) -> bool:
        effect = CATALOGUE[name]
        return effect.kind != "wrench" or not (
            effect.words or effect.roles & {Role.HULL_WATER, Role.DRAG} or effect.family == "hull"
        )

    return msgspec.structs.replace(vehicle, effect=tuple(e for e in vehicle.effect if stays(str(e["name"]))))


def _of_axis(means: Means, axis: int) -> Iterator[dict[str, Any]]:
    """Yield the table rows of the force on one axis, its own velocity first."""
    nu, force, number = means.velocity, means.force[:, axis], _numbers(means.block)
    for against in (axis, *(j for j in range(6) if j != axis)):
        tried = np.stack([_term(nu, axis, against, power) for power in POWERS], axis=1)
        gram = _grams(tried, np.column_stack([_beside(nu, axis, against), force]), number)
        left, drag, share = _profile(gram.sum(axis=0))
        best = int(left.argmin())
        if share[best] < LEAST_SHARE or best in (0, len(POWERS) - 1):
            continue
        drawn = _drawn(gram)
        low, high = (float(end) for end in np.quantile(drawn, [0.025, 0.975]))
        if high - low <= WIDEST_POWER:
            yield {
                "axis": WRENCH[axis],
                "against": VELOCITY[against],
                "power": float(POWERS[best]),
                "low": min(low, float(POWERS[best])),
                "high": max(high, float(POWERS[best])),
                "drag": -float(drag[best]),
                "share": float(share[best]),
                "unit": WRENCH_UNITS[axis],
            }


def _term(nu: Array, axis: int, against: int, power: float) -> Array:
    """Return |nu_i|^n sgn(nu_i) if i = j, else |nu_j|^n nu_i, with i `axis`, j `against` and n `power`."""
    size = np.abs(nu[:, against]) ** power
    return np.asarray(size * (np.sign(nu[:, axis]) if against == axis else nu[:, axis]))


def _beside(nu: Array, axis: int, against: int) -> Array:
    """Return all other terms of the force on an axis, with usual powers, mixed products and a constant."""
    own, size = nu[:, axis], np.abs(nu)
    drags = [size[:, j] * own for j in range(6) if j not in (axis, against)]
    if against != axis:
        drags += [own, size[:, axis] * own]
    mixed = [nu[:, j] * nu[:, k] for j in range(6) for k in range(j, 6)]
    others = [size[:, j] * nu[:, j] for j in range(6) if j != axis]
    return np.column_stack([*drags, *mixed, *others, np.ones(len(nu))])


def _numbers(block: Rows) -> Rows:
    """Return the block of each piece, renumbered from 0 without gaps, (P,)."""
    return np.asarray(np.unique(block, return_inverse=True)[1], np.int64)


def _grams(tried: Array, beside: Array, number: Rows) -> Array:
    """Return the products of every candidate column with itself and with the other columns, by block.

    Args:
        tried: A column for each of G powers, (P, G).
        beside: K other columns, and the force, (P, K + 1).
        number: Block of each row, from 0, (P,).

    Returns:
        (B, G + K + 1, K + 2): the first G rows hold the products of a candidate column with the other
        columns, the force and itself; the rest hold those of the other columns and the force with one
        another.
    """
    blocks, out = int(number.max()) + 1, []
    for k in range(blocks):
        t, b = tried[number == k], beside[number == k]
        across = np.column_stack([t.T @ b, (t**2).sum(axis=0)])
        out.append(np.vstack([across, np.column_stack([b.T @ b, np.zeros(b.shape[1])])]))
    return np.stack(out)


def _profile(gram: Array) -> tuple[Array, Array, Array]:
    """Return residual, coefficient and share of each candidate column, (G,) each.

    The residual is that of a fit with all other columns; the share is that of the force's square.

    Args:
        gram: Sum of `_grams` over blocks, (G + K + 1, K + 2).
    """
    powers, count = len(POWERS), gram.shape[1] - 2
    within = gram[powers:, : count + 1]
    held = within[:count, :count] + RIDGE * np.diag(np.diag(within)[:count])
    across, size, pull = gram[:powers, :count], gram[:powers, -1], gram[:powers, count]
    solved = np.linalg.solve(held, np.column_stack([across.T, within[:count, count]]))
    free = np.maximum(size - np.einsum("gk,kg->g", across, solved[:, :-1]), 1e-12 * size)
    rest = pull - across @ solved[:, -1]
    first = within[count, count] - within[:count, count] @ solved[:, -1]
    gain = rest**2 / free
    return first - gain, rest / free, gain / max(float(within[count, count]), 1e-300)


def _drawn(gram: Array) -> Array:
    """Return the best powers of recordings resampled from blocks, (SAMPLES,).

    Args:
        gram: Products by block, from `_grams`.
    """
    drawn = weights(len(gram), SAMPLES, 0)
    return np.array([POWERS[_profile(np.tensordot(one, gram, 1))[0].argmin()] for one in drawn])
