"""Conditioning of an injected wrench at the control rate: low-pass, clipping, dead band; paper III-B.

It acts on tau_ML alone, in this order, and works alike on FRD and FLU wrenches:

1. y_k = a y_k-1 + (1 - a) tau_k, from rest (y = 0).  The paper gives beta = 0.9 without saying of what: a is
   beta where it weighs the old value (a time constant of 0.38 s at 25 Hz), 1 - beta where it weighs the new;
2. each axis is clipped to +-limit;
3. the wrench is scaled by 3 s^2 - 2 s^3, s = min(1, |(v / v_0, omega / omega_0)|): whole in motion, nothing
   at rest.  One factor serves all axes, so that a force due to motion along another axis is not cut off.
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

BETA = 0.9  # paper III-B
WIDTH = 0.02  # m/s and rad/s, of the dead band
HEADROOM = 2.0  # clipping limit in units of the wrench that the thrusters can make
PRESETS = ("off", "paper", "paper-old", "paper-new", "low-pass-old", "low-pass-new", "clipping", "dead-band")

# Layout of the parameters and counts that the kernel takes.
KEEP, LIMIT, LINEAR, ANGULAR, PARAMETERS = 0, 1, 7, 8, 9
STEPS, CLIPPED, HELD_BACK, COUNTS = 0, 1, 7, 8


@dataclasses.dataclass(frozen=True)
class Conditioning:
    """What is done to a wrench before it is injected; by default nothing.

    Attributes:
        beta: Weight of the low-pass, 0 to 1, or None for no low-pass.
        weighs: Whether `beta` weighs the `old` filtered value or the `new` wrench.
        limits: Largest size of each axis [N, N m], shape (6,), inf for none.
        linear_deadband: v_0 [m/s], 0 for no dead band.
        angular_deadband: omega_0 [rad/s], 0 for no dead band.
    """

    beta: float | None = None
    weighs: Literal["old", "new"] = "old"
    limits: tuple[float, ...] = (math.inf,) * 6
    linear_deadband: float = 0.0
    angular_deadband: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what has no meaning.

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
        """Weight of the old filtered value at every step."""
        if self.beta is None:
            return 0.0
        return self.beta if self.weighs == "old" else 1.0 - self.beta

    def parameters(self) -> Array:
        """The numbers that `condition_kernel` takes, shape (9,)."""
        return np.array([self.keep, *self.limits, self.linear_deadband, self.angular_deadband])


class Counts(NamedTuple):
    """How often each part acted.

    `steps`: control steps in all.  `clipped` (6,): steps in which an axis was clipped.  `held_back`: steps in
    which the dead band took part of the wrench.
    """

    steps: int
    clipped: tuple[int, ...]
    held_back: int


OFF = Conditioning()


def preset(name: str, vehicle: Vehicle) -> Conditioning:
    """A conditioning by name: none, the paper's with either reading of beta = 0.9, or one piece of it.

    The paper gives neither limits nor a width.  Limits are twice the wrench that the thrusters can make on an
    axis, since a steady residual balances the thrusters (no limit where they can make none); the dead band
    is 0.02 m/s and 0.02 rad/s.

    Args:
        name: `off`; `paper-old`, where beta weighs the old value; `paper-new`; `paper`, which is `paper-new`,
            the reading that replays better; or a piece alone: `low-pass-old`, `low-pass-new`, `clipping`,
            `dead-band`.
        vehicle: Gives the limits.

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
        limits=_limits(vehicle) if whole or name == "clipping" else OFF.limits,
        linear_deadband=width,
        angular_deadband=width,
    )


def _limits(vehicle: Vehicle) -> tuple[float, ...]:
    """Clipping limits [N, N m] from what the thrusters can make on each axis."""
    strongest = thruster_table(vehicle)[:, [MAX_THRUST, MAX_REVERSE]].max(axis=1)
    authority = HEADROOM * np.abs(configuration_matrix(vehicle)) @ strongest
    return tuple(float(limit) if limit > 0.0 else math.inf for limit in authority)


@kernel
def condition_kernel(
    wrench: Array, nu: Array, parameters: Array, state: Array, counts: Array, out: Array
) -> None:
    """Condition the wrench of one control step.

    Args:
        wrench: The wrench, shape (6,) [N, N m].
        nu: Velocity, shape (6,) [m/s, rad/s], in the frame of the wrench or its FRD/FLU mirror.
        parameters: `Conditioning.parameters()`, shape (9,).
        state: Low-passed wrench, shape (6,), changed in place; zero at the start.
        counts: `steps`, `clipped` and `held_back`, shape (8,), changed in place.
        out: Written: the conditioned wrench, shape (6,).
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
    """Share of the wrench that the dead band lets through."""
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
    """Condition a sequence of wrenches, one per control step, from rest.

    Args:
        wrenches: Shape (N, 6) [N, N m].
        nu: Velocities, shape (N, 6) [m/s, rad/s].
        conditioning: What to do.

    Returns:
        The conditioned wrenches, shape (N, 6), and how often clipping and dead band acted.
    """
    given = np.ascontiguousarray(wrenches, dtype=np.float64)
    out, numbers = np.empty_like(given), np.zeros(COUNTS)
    _condition_columns(
        given, np.ascontiguousarray(nu, dtype=np.float64), conditioning.parameters(), numbers, out
    )
    return out, counts_of(numbers)


def counts_of(numbers: ArrayLike) -> Counts:
    """Counts from the array that `condition_kernel` fills, shape (8,)."""
    steps, *clipped, held_back = (int(n) for n in np.asarray(numbers))
    return Counts(steps, tuple(clipped), held_back)
