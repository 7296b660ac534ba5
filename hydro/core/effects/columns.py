"""The wrench of a vehicle's effects along a recorded motion: the same kernels, looped over columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydro.core.compiled import jit
from hydro.core.effects.layout import MOTION, POSITION, ROTATION, VELOCITY
from hydro.core.effects.program import assemble, relative_to_water, start, wrench
from hydro.core.effects.record import Array
from hydro.core.frames import rotation_kernel
from hydro.core.vehicle import Vehicle


def effect_wrenches(vehicle: Vehicle, eta: ArrayLike, nu: ArrayLike, segments: ArrayLike, dt: float) -> Array:
    """Wrench ON the vehicle of all its effects of kind `wrench`, at every row of a recorded motion.

    Added mass is not among them (it is in M and C), nor is the thrust; a current is felt through nu_r.

    Args:
        vehicle: The vehicle.
        eta: Pose x y z phi theta psi, NED, shape (N, 6).
        nu: Velocity of CO over ground, body frame, shape (N, 6).
        segments: Unbroken runs of rows [start, stop), shape (S, 2); internal states begin each as if its
            first velocity had always been.
        dt: Sample time [s].

    Returns:
        Wrenches about CO, body frame, shape (N, 6) [N, N m]; 0 in rows outside all segments.

    Raises:
        DataError: An effect that the catalogue does not admit.
    """
    program = assemble(vehicle)
    out = np.zeros(np.shape(nu))
    _along(
        program.flat,
        np.ascontiguousarray(eta, np.float64),
        np.ascontiguousarray(nu, np.float64),
        np.ascontiguousarray(segments, np.int64).reshape(-1, 2),
        dt,
        np.zeros((6, program.states)),
        out,
    )
    return out


@jit
def _along(
    flat: Array, eta: Array, nu: Array, segments: NDArray[np.int64], dt: float, states: Array, out: Array
) -> None:
    """Internal states go from row to row by Runge-Kutta, along a straight line of the motion between."""
    here, middle, there, unused = np.zeros(MOTION), np.zeros(MOTION), np.zeros(MOTION), np.zeros(6)
    x, trial, a, b, c, d = states[0], states[1], states[2], states[3], states[4], states[5]
    for begin, end in segments:
        for k in range(begin, end):
            if k == begin:
                _motion(flat, eta[k], nu[k], here)
                start(flat, here, x)
            wrench(flat, here, x, a, out[k])
            if k + 1 == end:
                break
            _motion(flat, eta[k + 1], nu[k + 1], there)
            if x.size:
                middle[:] = 0.5 * (here + there)
                trial[:] = x + 0.5 * dt * a
                wrench(flat, middle, trial, b, unused)
                trial[:] = x + 0.5 * dt * b
                wrench(flat, middle, trial, c, unused)
                trial[:] = x + dt * c
                wrench(flat, there, trial, d, unused)
                x += dt / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            here[:] = there


@jit
def _motion(flat: Array, eta: Array, nu: Array, s: Array) -> None:
    """The state of motion `s` of one row."""
    s[POSITION : POSITION + 3] = eta[:3]
    s[VELOCITY : VELOCITY + 6] = nu
    rotation_kernel(eta[3], eta[4], eta[5], s[ROTATION : ROTATION + 9])
    relative_to_water(flat, s)
