"""Force residual of a vehicle file against each velocity, with the force that the file exerts there.

The force residual is the wrench ON the vehicle that the file does not account for.  The file accounts for
thrusters, weight, buoyancy, effects and rigid body (C_RB and M_RB among them).  Where the drag of the file is
too small, the residual points against the motion, as drag does.  Along each axis it is averaged in bins of
velocity of equal counts.  Its interval rests on blocks of the recording, because neighbouring rows share
their errors: a cluster-robust variance with leverage correction (Bell and McCaffrey 2002), and Student's t
with as many degrees of freedom as the bin has effective blocks (Kish 1965), less one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
import scipy

from hydro.core.columns import POSE, VELOCITY, VELOCITY_UNITS, WRENCH, WRENCH_UNITS, Array, Mask, Rows
from hydro.core.effects import columns
from hydro.core.effects.layout import ADDED_MASS, FLOW, MOTION, POSITION, RELATIVE_VELOCITY, ROTATION
from hydro.core.effects.layout import VELOCITY as OVER_GROUND
from hydro.core.effects.program import HEADER, Program, constants_of, start, wrench
from hydro.core.errors import DataError
from hydro.core.evaluation.force_error import missing_wrench
from hydro.core.evaluation.regimes import Pieces
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import Candidate, candidate, true_velocity
from hydro.core.recording.arrays import Recording, recording
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.rigid_body import coriolis_kernel

BINS = 10
"""Number of velocity bins, with equally many pieces of the recording."""
CURVE_POINTS = 33
"""Number of points of the file's force curve, evenly spaced over the velocity range."""
RANGE = (0.5, 99.5)
"""Percentiles of the velocity that bound the force curve."""
SAMPLED = 0.9
"""Minimum share of rows that must have a sample of attitude and velocity."""
NEEDED = slice(3, 12)
"""Attitude and velocity among the twelve channels."""
PLAINER = 0.05
"""Minimum share of the force variance that another axis' velocity explains beyond the axis' own velocity."""
PLAIN = 0.1
"""Minimum share of the force variance that another axis' velocity must explain to be shown."""
LEVEL = 0.975
"""Probability below the upper end of a two-sided 95 % interval."""
DEEP = 1e3
"""Depth at which the file's force curve is computed [m], away from the surface."""

Line = dict[str, Any]


def leftover(
    vehicles: Mapping[int, Vehicle], raw: pl.DataFrame, record: Recording | None = None
) -> pl.DataFrame:
    """Return the mean force that vehicle files do not explain, in bins of velocity, and force curves.

    Args:
        vehicles: Vehicle files, by the number of the step of `hydro explain` that made each file.  The first
            file decides against which velocities the force on an axis is shown: the velocity along the same
            axis, and another velocity that explains clearly more of the residual.
        raw: Raw table of the measured motion and commands.
        record: Cleaned recording as arrays; by default the table as it was logged.

    Returns:
        A table with `step`, `axis` of the force, `against` which velocity (through the water according to the
        file, at CO in body axes), and `velocity` [m/s, rad/s].  A row with a bin has the mean residual
        `force` [N, N m], its 95 % interval `low` to `high` (null with fewer than two effective `blocks`) and
        its `rows`.  Rows without `force` are points of the curve: `model` is the force that the file gives at
        that velocity, steady, level and deep, at rest in all other axes.  `unit` is that of the forces,
        `velocity_unit` that of the velocity.

    Raises:
        DataError: The recording does not fit a vehicle, or too few rows have a sample.
    """
    record = record or recording(next(iter(vehicles.values())), raw)
    counted = with_samples(record)
    motion, pieces = Motion.of(record), Pieces.of(record)
    lines: list[Line] = []
    shown: list[tuple[int, int]] = []
    for step, vehicle in vehicles.items():
        model = candidate(vehicle)
        force = missing_wrench(model, record, motion.eta, motion.nu, motion.velocity)
        means = Means.of(force, through_water(model, record, motion), counted, pieces)
        shown = shown or means.worth_showing()
        for axis, against in shown:
            key = {"step": step, "axis": WRENCH[axis], "against": VELOCITY[against]}
            units = {"unit": WRENCH_UNITS[axis], "velocity_unit": VELOCITY_UNITS[against]}
            lines += [key | line | units for line in _bins(means, model.program, axis, against)]
            lines += [key | line | units for line in _curve(means, model.program, axis, against)]
    return pl.DataFrame(lines, infer_schema_length=None).with_columns(
        pl.col("velocity", "force", "low", "high", "blocks", "model").cast(pl.Float64)
    )


def with_samples(record: Recording) -> Mask:
    """Return a mask of the rows that have a sample of attitude and of velocity, (N,).

    Raises:
        DataError: A channel of attitude or velocity has samples in fewer than SAMPLED of the rows.
    """
    if record.seen is None:
        return np.ones(record.rows, bool)
    seen = record.seen[:, NEEDED]
    names = (*POSE, *VELOCITY)[NEEDED]
    rare = [
        f"{name} in {100 * share:.0f} %"
        for name, share in zip(names, seen.mean(axis=0), strict=True)
        if share < SAMPLED
    ]
    if rare:
        raise DataError(
            f"forces need attitude and velocity in {100 * SAMPLED:.0f} % of the rows, but samples are of "
            f"{', '.join(rare)}; import the log with `hydro import --fill`, which draws lines between them"
        )
    return np.asarray(seen.all(axis=1))


def through_water(model: Candidate, record: Recording, motion: Motion) -> Array:
    """Return the velocity of CO through the water at every row, body axes, (N, 6) [m/s, rad/s].

    Args:
        model: Vehicle, with its current and DVL errors.
        record: Recording of N rows.
        motion: Smoothed motion of the recording.
    """
    flow = constants_of(model.program.flat)[FLOW]
    return columns.through_water(flow, motion.eta, true_velocity(model, record, motion.nu), record.t)


@dataclass(frozen=True)
class Means:
    """Means of residual force and velocity over P pieces of a fifth of a second.

    Attributes:
        force: Force on the vehicle that the file does not explain, (P, 6) [N, N m].
        velocity: Velocity through the water, (P, 6) [m/s, rad/s].
        rows: Number of rows with samples, (P,).
        block: Number of the block of pieces that holds each piece, (P,).
    """

    force: Array
    velocity: Array
    rows: Array
    block: Rows

    @classmethod
    def of(cls, force: Array, velocity: Array, counted: Mask, pieces: Pieces) -> Means:
        """Return the means of force and velocity over the rows with samples of each piece.

        Pieces without such a row are left out.

        Args:
            force: Force residual at every row, (N, 6) [N, N m].
            velocity: Velocity through the water at every row, (N, 6) [m/s, rad/s].
            counted: Mask of the rows with samples, (N,).
            pieces: Pieces of the recording.
        """
        rows = pieces.total(counted.astype(np.float64))
        some = rows > 0.0
        force, velocity = (
            pieces.total(values * counted[:, None])[some] / rows[some, None] for values in (force, velocity)
        )
        return cls(force, velocity, rows[some], pieces.block[some])

    def code(self, against: int) -> Rows:
        """Return the number of the bin of velocity in which each of P pieces lies, (P,), from 0.

        The bins have equal counts of pieces.

        Args:
            against: Velocity component, 0 to 5 for u to r.
        """
        speed = self.velocity[:, against]
        edges = np.quantile(speed, np.arange(1, BINS) / BINS)
        code: Rows = np.searchsorted(edges, speed, side="right")
        return code

    def explained(self, axis: int, against: int) -> float:
        """Return the fraction of a force's variance that its means over bins of a velocity explain.

        Args:
            axis: Axis of the force, 0 to 5 for X to N.
            against: Velocity component, 0 to 5 for u to r.
        """
        force, code = self.force[:, axis], self.code(against)
        within = sum(np.var(force[code == one]) * np.mean(code == one) for one in np.unique(code))
        return float(1.0 - within / max(float(np.var(force)), 1e-300))

    def worth_showing(self) -> list[tuple[int, int]]:
        """Return the pairs of a force axis (0 to 5) and a velocity component (0 to 5) to show.

        Each force is shown against the velocity on its own axis, and also against another velocity that
        explains clearly more of the force's variance.
        """
        pairs = [(axis, axis) for axis in range(6)]
        for axis in range(6):
            shares = [self.explained(axis, against) for against in range(6)]
            most = int(np.argmax(shares))
            if shares[most] > max(PLAIN, shares[axis] + PLAINER):
                pairs.append((axis, most))
        return pairs


def _bins(means: Means, program: Program, axis: int, against: int) -> Iterator[Line]:
    """Yield the mean force residual on `axis` by bins of velocity `against`, and the file's force there."""
    code, speed = means.code(against), means.velocity[:, against]
    for one in np.unique(code):
        there = code == one
        velocity = float(np.average(speed[there], weights=means.rows[there]))
        force, half, blocks = block_mean(means.force[there, axis], means.rows[there], means.block[there])
        yield {
            "velocity": velocity,
            "force": force,
            "low": None if half is None else force - half,
            "high": None if half is None else force + half,
            "rows": int(means.rows[there].sum()),
            "blocks": blocks,
            "model": float(steady_force(program, np.array([velocity]), against)[0, axis]),
        }


def _curve(means: Means, program: Program, axis: int, against: int) -> Iterator[Line]:
    """Yield points of the file's force on `axis` as a curve of velocity `against`."""
    slowest, fastest = np.percentile(means.velocity[:, against], RANGE)
    speeds = np.unique(np.linspace(float(slowest), float(fastest), CURVE_POINTS))
    for speed, force in zip(speeds, steady_force(program, speeds, against)[:, axis], strict=True):
        nothing = dict.fromkeys(("force", "low", "high", "blocks"))
        yield {"velocity": float(speed), "rows": 0, "model": float(force)} | nothing


def block_mean(values: Array, rows: Array, block: Rows) -> tuple[float, float | None, float]:
    """Return the mean of P values with a 95 % interval that allows for correlation within blocks.

    Args:
        values: Values, (P,).
        rows: Weight of each value, (P,).
        block: Number of the block of each value, (P,).

    Returns:
        The mean; half the width of its 95 % interval, None with fewer than two effective blocks; and the
        number of effective blocks.
    """
    _, number = np.unique(block, return_inverse=True)
    count = np.bincount(number, rows)
    mean, whole = float(np.average(values, weights=rows)), float(count.sum())
    blocks = float(whole**2 / np.sum(count**2))
    if blocks < 2.0:
        return mean, None, blocks
    errors = np.bincount(number, rows * (values - mean))
    variance = np.sum(errors**2 / (1.0 - count / whole)) / whole**2
    return mean, float(scipy.special.stdtrit(blocks - 1.0, LEVEL) * np.sqrt(variance)), blocks


def stands_out(bins: pl.DataFrame) -> pl.Series:
    """Return whether the mean force of each bin differs significantly from zero, one value for each row.

    The family-wise error rate over all rows is 5 % (Bonferroni).

    Args:
        bins: Rows of a leftover table; a row without an interval never differs.
    """
    force, high, blocks = bins.select(pl.col("force", "high", "blocks").cast(pl.Float64).fill_null(np.nan))
    freedom = blocks.to_numpy() - 1.0
    size = np.abs(force.to_numpy()) / (high - force).to_numpy() * scipy.special.stdtrit(freedom, LEVEL)
    chance = np.nan_to_num(2.0 * scipy.special.stdtr(freedom, -size), nan=1.0)
    return pl.Series(chance * bins.height < 2.0 * (1.0 - LEVEL))


def steady_force(program: Program, speeds: Array, against: int) -> Array:
    """Return the force of the water on a level vehicle, deep and in steady motion along or about one axis.

    It is the sum of the effects of the vehicle file, with steady internal states, and -C_A(nu_r) nu_r
    (Coriolis force of the added mass), minus their values at rest.

    Args:
        program: Compiled vehicle.
        speeds: K velocities through the water on the axis, (K,) [m/s, rad/s].
        against: Number of the axis, 0 to 5; the vehicle is at rest in all other axes.

    Returns:
        Force on the vehicle about CO in body axes, (K, 6) [N, N m].
    """
    moving = np.array([_fluid_wrench(program, speed * np.eye(6)[against]) for speed in speeds])
    force: Array = moving - _fluid_wrench(program, np.zeros(6))
    return force


def _fluid_wrench(program: Program, nu_r: Array) -> Array:
    """Return effects and added-mass Coriolis terms of steady motion at nu_r (6,), (6,) [N, N m]."""
    flat, s, tau, coriolis = program.flat, np.zeros(MOTION), np.zeros(6), np.zeros(6)
    memory, rates = np.zeros(program.states), np.zeros(program.states)
    s[RELATIVE_VELOCITY : RELATIVE_VELOCITY + 6] = s[OVER_GROUND : OVER_GROUND + 6] = nu_r
    s[ROTATION : ROTATION + 9] = np.eye(3).ravel()
    s[POSITION + 2] = DEEP
    start(flat, s, memory)
    wrench(flat, s, memory, rates, tau)
    coriolis_kernel(flat[HEADER + ADDED_MASS : HEADER + ADDED_MASS + 36], nu_r, coriolis)
    force: Array = tau - coriolis
    return force
