"""Conditioning of a network's wrench at the control rate: low-pass, clipping, dead band (Wu et al., III-B).

It acts on tau_ML alone, in this order, on FRD and FLU wrenches alike:

1. Low-pass: y_k = a y_k-1 + (1 - a) tau_k, from rest (y = 0).  The paper gives beta = 0.9 without the
   definition.  a is beta if beta weighs the old value (a time constant of 0.38 s at 25 Hz), or 1 - beta if it
   weighs the new one.
2. Clipping: each axis is limited to +-limit.
3. Dead band: the wrench is scaled by 3 s^2 - 2 s^3, s = min(1, |(v / v_0, omega / omega_0)|).  It is 1 in
   motion and 0 at rest.  All axes share one factor, which keeps forces due to motion along other axes.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.compiled import jit, kernel
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import MAX_REVERSE, MAX_THRUST, configuration_matrix, thruster_table

BETA = 0.9  # weight of the low-pass (paper III-B)
WIDTH = 0.02  # width of the dead band [m/s, rad/s]
HEADROOM = 2.0  # clipping limit, relative to the greatest wrench of the thrusters
PRESETS = ("off", "paper", "paper-old", "paper-new", "low-pass-old", "low-pass-new", "clipping", "dead-band")

# Layout of the kernel's parameters and counts.
KEEP, LIMIT, LINEAR, ANGULAR, PARAMETERS = 0, 1, 7, 8, 9
STEPS, CLIPPED, HELD_BACK, COUNTS = 0, 1, 7, 8


@dataclasses.dataclass(frozen=True)
class Conditioning:
    """Settings of the low-pass, clipping and dead band of a network's wrench; by default none acts.

    Attributes:
        beta: Weight of the low-pass, 0 to 1, or None for no low-pass.
        weighs: Whether `beta` weighs the `old` filtered value or the `new` wrench.
        limits: Maximum magnitude of each axis [N, N m], shape (6,), inf for none.
        linear_deadband: Speed v_0 below which the wrench fades [m/s], 0 for no dead band.
        angular_deadband: Angular velocity omega_0 below which the wrench fades [rad/s], 0 for no dead band.
    """

    beta: float | None = None
    weighs: Literal["old", "new"] = "old"
    limits: tuple[float, ...] = (math.inf,) * 6
    linear_deadband: float = 0.0
    angular_deadband: float = 0.0

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            DataError: A number is out of range, or only one of the dead bands is 0.
        """
        if self.beta is not None and not 0.0 <= self.beta <= 1.0:
            raise DataError(f"beta of the low-pass must lie within 0 and 1, not {self.beta:g}")
        if self.keep == 1.0:
            raise DataError("a low-pass that keeps all of its old value lets nothing through; change beta")
        if len(self.limits) != 6 or not all(limit > 0.0 for limit in self.limits):
            raise DataError(f"clipping takes six limits above 0 (N, N m), not {list(self.limits)}")
        bands = (self.linear_deadband, self.angular_deadband)
        if not all(0.0 <= band < math.inf for band in bands) or (bands[0] > 0.0) != (bands[1] > 0.0):
            raise DataError(
                f"the dead band takes two speeds above 0 (m/s, rad/s), or 0 and 0, not {list(bands)}"
            )

    @property
    def keep(self) -> float:
        """Weight of the old filtered value in every step, 0 without low-pass."""
        if self.beta is None:
            return 0.0
        return self.beta if self.weighs == "old" else 1.0 - self.beta

    def parameters(self) -> Array:
        """Return all settings as one array (9,), for `condition_kernel`."""
        return np.array([self.keep, *self.limits, self.linear_deadband, self.angular_deadband])


class Counts(NamedTuple):
    """Number of control steps in which each part of the conditioning changed the network's wrench.

    Attributes:
        steps: All control steps.
        clipped: Steps in which each axis was clipped (6,).
        held_back: Steps in which the dead band reduced the wrench.
    """

    steps: int
    clipped: tuple[int, ...]
    held_back: int


OFF = Conditioning()


def preset(name: str, vehicle: Vehicle) -> Conditioning:
    """Return conditioning settings by name: none, those of Wu et al., or one part of theirs.

    Their low-pass has beta = 0.9, which may weigh the old or the new value. Wu et al. give neither limits nor
    the width of the dead band.  Limits are twice the greatest wrench of the thrusters on an axis, since a
    steady residual balances the thrusters; an axis without thrust has no limit. The dead band is 0.02 m/s and
    0.02 rad/s.

    Args:
        name: `off`; `paper-old`, where beta weighs the old value; `paper-new`; `paper`, which is `paper-new`,
            the meaning with the lower replay error; or one part: `low-pass-old`, `low-pass-new`, `clipping`,
            `dead-band`.
        vehicle: Vehicle, whose thrusters determine the limits.

    Raises:
        DataError: No preset has this name.
    """
    if name not in PRESETS:
        raise DataError(f"conditioning {name!r} is not known; choose one of {', '.join(PRESETS)}")
    if name == "off":
        return OFF
    whole = name.startswith("paper")
    width = WIDTH if whole or name == "dead-band" else 0.0
    return Conditioning(
        beta=BETA if whole or name.startswith("low-pass") else None,
        weighs="old" if name.endswith("old") else "new",
        limits=clipping(vehicle) if whole or name == "clipping" else OFF.limits,
        linear_deadband=width,
        angular_deadband=width,
    )


def clipping(vehicle: Vehicle, headroom: float = HEADROOM) -> tuple[float, ...]:
    """Return the clipping limit of each axis [N, N m], six numbers; infinite on an axis without thrust.

    Args:
        vehicle: Vehicle, whose thrusters determine the limits.
        headroom: Limit in multiples of the greatest wrench of the thrusters on the axis.
    """
    strongest = thruster_table(vehicle)[:, [MAX_THRUST, MAX_REVERSE]].max(axis=1)
    authority = headroom * np.abs(configuration_matrix(vehicle)) @ strongest
    return tuple(float(limit) if limit > 0.0 else math.inf for limit in authority)


@kernel
def condition_kernel(
    wrench: Array, nu: Array, parameters: Array, state: Array, counts: Array, out: Array
) -> None:
    """Write the conditioned wrench of one control step (low-pass, clipping, dead band) to `out`.

    Args:
        wrench: Wrench, shape (6,) [N, N m].
        nu: Velocity, shape (6,) [m/s, rad/s], in FRD or FLU: only the squares of its components matter.
        parameters: `Conditioning.parameters()`, shape (9,).
        state: Low-passed wrench, shape (6,), changed in place; zero at the start.
        counts: Numbers of steps as in `Counts`, shape (8,), increased in place: 0 all, 1-6 those in which
            each axis was clipped, 7 those in which the dead band reduced the wrench.
        out: Conditioned wrench, shape (6,), written.
    """
    keep = parameters[KEEP]
    share = _moving(nu, parameters[LINEAR], parameters[ANGULAR])
    counts[STEPS] += 1
    if share < 1.0:
        counts[HELD_BACK] += 1
    for i in range(6):
        state[i] = keep * state[i] + (1.0 - keep) * wrench[i]
        limit = parameters[LIMIT + i]
        if abs(state[i]) > limit:
            counts[CLIPPED + i] += 1
        out[i] = share * min(max(state[i], -limit), limit)


@kernel
def _moving(nu: Array, linear: float, angular: float) -> float:
    """Return the factor 0 to 1 by which the dead band scales a wrench: 3 s^2 - 2 s^3.

    Args:
        nu: Velocity (6,) [m/s, rad/s]; s = min(1, |(v / linear, omega / angular)|).
        linear: Velocity at which the full wrench acts [m/s]; 0 for no dead band.
        angular: Angular velocity at which the full wrench acts [rad/s].
    """
    if linear == 0.0:
        return 1.0
    square = 0.0
    for i in range(3):
        square += (nu[i] / linear) ** 2 + (nu[3 + i] / angular) ** 2
    if square >= 1.0:
        return 1.0
    return square * (3.0 - 2.0 * math.sqrt(square))


@jit
def _condition_columns(wrenches: Array, nu: Array, parameters: Array, counts: Array, out: Array) -> None:
    state = np.zeros(6)
    for k in range(wrenches.shape[0]):
        condition_kernel(wrenches[k], nu[k], parameters, state, counts, out[k])


def condition(wrenches: ArrayLike, nu: ArrayLike, conditioning: Conditioning) -> tuple[Array, Counts]:
    """Return a sequence of wrenches, one per control step, after low-pass, clipping and dead band.

    Args:
        wrenches: Wrenches of N control steps, the first from rest, shape (N, 6) [N, N m].
        nu: Velocities, shape (N, 6) [m/s, rad/s].
        conditioning: Settings of the conditioning.

    Returns:
        Conditioned wrenches, shape (N, 6), and the counts of clipping and dead band.
    """
    given = np.ascontiguousarray(wrenches, dtype=np.float64)
    out, numbers = np.empty_like(given), np.zeros(COUNTS)
    _condition_columns(
        given, np.ascontiguousarray(nu, dtype=np.float64), conditioning.parameters(), numbers, out
    )
    return out, counts_of(numbers)


def counts_of(numbers: ArrayLike) -> Counts:
    """Return the counts of the conditioning as an object, from the array (8,) of `condition_kernel`."""
    steps, *clipped, held_back = (int(n) for n in np.asarray(numbers))
    return Counts(steps, tuple(clipped), held_back)
