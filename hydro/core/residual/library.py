"""A library of forces that a body in water may feel, and how large each may be on a hull of a given size.

For every axis: products of velocities and accelerations through the water (`distillation.features`), the
other |nu_i| nu_j, and where down lies, which stands for weight and trim.  The size of a coefficient is its
prior standard deviation, from the density and the hull's box alone: a drag of half rho A with A the mean of
the box's sides, a mass of the displaced water, a lever of half the length for every rotation; linear damping
is the drag at SLOW, and weight and buoyancy are in balance to a twentieth.  What a hull that is the same
on port and starboard cannot have, as a sway force of surge, is expected to be UNEVEN times that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.distillation.features import CROSS, features
from hydro.core.effects.columns import through_water
from hydro.core.effects.layout import FLOW
from hydro.core.effects.program import constants_of
from hydro.core.prediction.candidate import Candidate, true_velocity
from hydro.core.recording.arrays import CUBIC_REACH
from hydro.core.recording.shots import Shots
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation

AXES = 6
SLOW = 0.3
"""Speed [m/s] at which linear and quadratic damping are alike."""
TRIM = 0.05
"""Part of the buoyancy that weight and trim may be off by."""
UNEVEN = 0.05
"""Of a coefficient that port and starboard alike would rule out, times the others'."""
MIRRORED = np.array([False, True, False, True, False, True])
"""Axes whose velocities and wrenches change sign in a mirror that swaps port and starboard."""
RESTING = 4
"""Terms, the last, that do not vanish with the motion: where down lies, and one for all."""
KNOWN_PAIRS = {(int(i), int(j)) for i, j in CROSS}
PAIRS = tuple((i, j) for i in range(AXES) for j in range(AXES) if i != j and (i, j) not in KNOWN_PAIRS)
"""(i, j) of the |nu_i| nu_j that the features of the networks have not."""


@dataclass(frozen=True)
class Flow:
    """The motion through the water along a recording, smoothed.

    Attributes:
        nu: Velocity, (N, 6) [m/s, rad/s].
        nu_dot: Its rate in the body's axes, (N, 6).
        down: Unit vector down in the body's axes, (N, 3).
    """

    nu: Array
    nu_dot: Array
    down: Array

    @classmethod
    def of(cls, model: Candidate, shots: Shots) -> Flow:
        """The motion of a recording past the water of a vehicle's file, CO behind its velocity log."""
        record = shots.record
        flow = constants_of(model.program.flat)[FLOW]
        nu = through_water(flow, shots.eta, true_velocity(model, record, shots.nu), record.t)
        rate = np.zeros_like(nu)
        widest = max(2 * round(CUBIC_REACH / record.dt) + 1, 5)
        for start, stop in record.segments:
            width = min(widest, (stop - start - 1) // 2 * 2 + 1)
            if width >= 5:
                rate[start:stop] = scipy.signal.savgol_filter(
                    nu[start:stop], width, 3, deriv=1, delta=record.dt, axis=0
                )
        return cls(nu, rate, rotation(*shots.eta[:, 3:].T)[:, 2])

    @property
    def columns(self) -> Array:
        """All of it, (N, 15)."""
        return np.hstack([self.nu, self.nu_dot, self.down])

    def within(self, low: Array, high: Array) -> Flow:
        """The nearest motion between two bounds, (15,) each."""
        nu, rate, down = np.split(np.clip(self.columns, low, high), [AXES, 2 * AXES], axis=1)
        return Flow(nu, rate, down)


def terms(flow: Flow) -> Array:
    """The library at every row, (N, F)."""
    nu = flow.nu
    pairs = np.stack([np.abs(nu[:, i]) * nu[:, j] for i, j in PAIRS], axis=1)
    return np.hstack([features(np.hstack([nu, flow.nu_dot])), pairs, flow.down, np.ones((len(nu), 1))])


def sizes(vehicle: Vehicle) -> Array:
    """Prior standard deviation of every coefficient of the library on every axis, (F, 6)."""
    box, rho = vehicle.hull, vehicle.environment.water_density
    lever = 0.5 * box.length
    area = (box.length * box.width + box.width * box.height + box.height * box.length) / 3.0
    arm = np.repeat([1.0, lever], 3)
    drag, mass = 0.5 * rho * area, vehicle.buoyancy.force / vehicle.environment.gravity
    first = np.concatenate([drag * SLOW * arm, mass * arm, drag * arm**2])
    upper = [drag * arm[i] * arm[j] for i in range(AXES) for j in range(i + 1, AXES)]
    both = [drag * arm[i] * arm[j] for i, j in (*CROSS, *PAIRS)]
    trim = np.full(4, TRIM * vehicle.buoyancy.force)
    size = np.concatenate([first, upper, both, trim])
    uneven = _mirrored()[:, None] != MIRRORED
    return np.asarray(size[:, None] * arm * np.where(uneven, UNEVEN, 1.0))


def _mirrored() -> NDArray[np.bool_]:
    """Which terms change sign in the mirror, (F,)."""
    both = [MIRRORED[i] != MIRRORED[j] for i in range(AXES) for j in range(i + 1, AXES)]
    second = [MIRRORED[j] for _, j in (*CROSS, *PAIRS)]
    return np.array([*MIRRORED, *MIRRORED, *MIRRORED, *both, *second, False, True, False, False])
