"""Library of hydrodynamic force terms, with prior sizes for a hull of given dimensions.

The terms of each axis are products of velocities and accelerations through the water
(`distillation.features`), the remaining |nu_i| nu_j, and the direction of gravity for weight and trim.  The
prior standard deviation of a coefficient follows from the water density rho and the hull's box alone.  Drag
is half rho A with A the mean of the box's sides; mass is that of the displaced water; the lever arm of each
rotation is half the length.  Linear damping equals quadratic damping at SLOW.  Weight and buoyancy balance
within UNEVEN.  Coefficients that port-starboard symmetry rules out, such as a sway force of surge, are scaled
by UNEVEN.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array, Mask, Rows
from hydro.core.distillation.features import CROSS, features
from hydro.core.effects.columns import through_water
from hydro.core.effects.layout import FLOW
from hydro.core.effects.program import constants_of
from hydro.core.local_polynomials import savitzky_golay
from hydro.core.prediction.candidate import Candidate, true_velocity
from hydro.core.recording.arrays import CUBIC_REACH
from hydro.core.recording.shots import Shots
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation

AXES = 6
SLOW = 0.3
"""Speed at which linear and quadratic damping are equal [m/s]."""
UNEVEN = 0.05
"""Prior size of deviations from symmetry and balance, which designers avoid.

For coefficients that port-starboard symmetry rules out it is relative to other coefficients, for weight and
trim relative to buoyancy.
"""
MIRRORED = np.array([False, True, False, True, False, True])
"""Axes whose velocities and wrenches change sign under port-starboard reflection."""
RESTING = 4
"""Number of terms that do not vanish at rest, the last of the library: gravity direction and a constant."""
ROWS_TOGETHER = 2048
"""Number of rows whose terms are in memory together: about one megabyte, the size of a processor's cache."""
KNOWN_PAIRS = {(int(i), int(j)) for i, j in CROSS}
PAIRS = tuple((i, j) for i in range(AXES) for j in range(AXES) if i != j and (i, j) not in KNOWN_PAIRS)
"""Pairs (i, j) of |nu_i| nu_j that the features of networks lack."""


@dataclass(frozen=True)
class Flow:
    """Smoothed motion through the water along a recording of N rows.

    Attributes:
        nu: Velocity of CO through the water, body axes, (N, 6) [m/s, rad/s].
        nu_dot: Rate of `nu` in body axes, (N, 6) [m/s^2, rad/s^2].
        down: Unit vector down in body axes, (N, 3).
    """

    nu: Array
    nu_dot: Array
    down: Array

    @classmethod
    def of(cls, model: Candidate, shots: Shots) -> Flow:
        """Return the motion of CO through the water, corrected for the model's current and DVL errors.

        Args:
            model: The vehicle, with its current and DVL errors.
            shots: Shots of the recording, with its smoothed motion.
        """
        record = shots.record
        flow = constants_of(model.program.flat)[FLOW]
        nu = through_water(flow, shots.eta, true_velocity(model, record, shots.nu), record.t)
        rate = np.zeros_like(nu)
        widest = max(2 * round(CUBIC_REACH / record.dt) + 1, 5)
        for start, stop in record.segments:
            width = min(widest, (stop - start - 1) // 2 * 2 + 1)
            if width >= 5:
                rate[start:stop] = savitzky_golay(nu[start:stop], width, 3, deriv=1, dt=record.dt)
        return cls(nu, rate, rotation(*shots.eta[:, 3:].T)[:, 2])

    @property
    def columns(self) -> Array:
        """Velocity, acceleration and down vector side by side, (N, 15)."""
        return np.hstack([self.nu, self.nu_dot, self.down])

    def rows(self, part: slice | Rows | Mask) -> Flow:
        """Return the motion in some of the rows: a slice, numbers (n,), or a mask (N,)."""
        return Flow(self.nu[part], self.nu_dot[part], self.down[part])

    def within(self, low: Array, high: Array) -> Flow:
        """Return the motion with velocity, acceleration and down vector clipped to bounds, (15,) each."""
        nu, rate, down = np.split(np.clip(self.columns, low, high), [AXES, 2 * AXES], axis=1)
        return Flow(nu, rate, down)


def terms(flow: Flow) -> Array:
    """Return the F library terms at each of N rows of a motion, (N, F).

    Their order: the features of `distillation.features`, |nu_i| nu_j of PAIRS, unit vector down, and 1.
    """
    nu = flow.nu
    pairs = np.stack([np.abs(nu[:, i]) * nu[:, j] for i, j in PAIRS], axis=1)
    return np.hstack([features(np.hstack([nu, flow.nu_dot])), pairs, flow.down, np.ones((len(nu), 1))])


def force(flow: Flow, coefficients: Array) -> Array:
    """Return the sums of terms times coefficients (F, C) at each of N rows of a motion, (N, C).

    The terms are computed for some rows at a time, because those of a long recording fill the memory.
    """
    starts = range(0, len(flow.nu), ROWS_TOGETHER)
    parts = [terms(flow.rows(slice(at, at + ROWS_TOGETHER))) @ coefficients for at in starts]
    return np.concatenate(parts) if parts else np.zeros((0, coefficients.shape[1]))


def sizes(vehicle: Vehicle) -> Array:
    """Return the prior standard deviations of the coefficients of F library terms on each axis, (F, 6).

    They follow from the hull's box, buoyancy and water density; the terms have the order of `terms`.  They
    are 0 for forces that weight and buoyancy cannot exert, such as a heave force of the pitch angle.
    """
    box, rho = vehicle.hull, vehicle.environment.water_density
    lever = 0.5 * box.length
    area = (box.length * box.width + box.width * box.height + box.height * box.length) / 3.0
    arm = np.repeat([1.0, lever], 3)
    drag, mass = 0.5 * rho * area, vehicle.buoyancy.force / vehicle.environment.gravity
    first = np.concatenate([drag * SLOW * arm, mass * arm, drag * arm**2])
    upper = [drag * arm[i] * arm[j] for i in range(AXES) for j in range(i + 1, AXES)]
    both = [drag * arm[i] * arm[j] for i, j in (*CROSS, *PAIRS)]
    trim = np.full(4, UNEVEN * vehicle.buoyancy.force)
    size = np.concatenate([first, upper, both, trim])
    uneven = _mirrored()[:, None] != MIRRORED
    found = size[:, None] * arm * np.where(uneven, UNEVEN, 1.0)
    found[-RESTING:-1][~_restoring()] = 0.0
    return np.asarray(found)


def precision(count: int) -> Array:
    """Return the prior precision of coefficients in units of `sizes`, six axes for each term, (count, count).

    The mass matrix of a body and of the water that it accelerates is symmetric (Fossen 2011, property 6.1).
    So the coefficients of accelerations are symmetric too, within UNEVEN of their sizes.  Those of gravity
    are the same for the three forces, and antisymmetric for the moments (Fossen 2011, eq. 4.6), as closely.
    """
    out = np.eye(count)
    for i in range(AXES):
        for j in range(i):
            _tie(out, (AXES + i) * AXES + j, (AXES + j) * AXES + i)
    down = count - RESTING * AXES
    for i in range(3):
        for j in range(i):
            _tie(out, down + i * AXES + i, down + j * AXES + j)
            _tie(out, down + i * AXES + 3 + j, down + j * AXES + 3 + i, -1.0)
    return out


def _tie(precision: Array, one: int, other: int, sign: float = 1.0) -> None:
    """Add to a prior precision that one coefficient is `sign` times another, within UNEVEN of their sizes."""
    both = np.array([1.0, -sign])
    precision[np.ix_([one, other], [one, other])] += UNEVEN**-2 * np.outer(both, both)


def _restoring() -> NDArray[np.bool_]:
    """Return on which axes each component of the vector down may act: weight and buoyancy, (3, 6).

    A force acts along the vector, a moment about the two axes normal to its component (Fossen 2011, eq. 4.6).
    """
    along = np.eye(3, dtype=np.bool_)
    return np.hstack([along, ~along])


def _mirrored() -> NDArray[np.bool_]:
    """Return which library terms change sign under port-starboard reflection, (F,)."""
    both = [MIRRORED[i] != MIRRORED[j] for i in range(AXES) for j in range(i + 1, AXES)]
    second = [MIRRORED[j] for _, j in (*CROSS, *PAIRS)]
    return np.array([*MIRRORED, *MIRRORED, *MIRRORED, *both, *second, False, True, False, False])
