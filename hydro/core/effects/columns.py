"""Wrench of a vehicle's effects along a recorded motion: the same kernels, applied to columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.effects.layout import INERTIA, MOTION, POSITION, RELATIVE_VELOCITY, ROTATION, TIME, VELOCITY
from hydro.core.effects.program import HEADER, assemble, heed, relative_to_water, start, wrench
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation, rotation_kernel
from hydro.core.vehicle.rigid_body import coriolis_kernel


def effect_wrenches(
    vehicle: Vehicle,
    eta: ArrayLike,
    nu: ArrayLike,
    segments: ArrayLike,
    t: ArrayLike,
    commands: ArrayLike | None = None,
) -> Array:
    """Return the wrench on the vehicle of all its effects of kind `wrench`, in every row of a motion.

    Added mass, which is in M and C, and thrust are excluded; a current acts through nu_r.

    Args:
        vehicle: The vehicle.
        eta: Pose x y z phi theta psi, NED, shape (N, 6).
        nu: Velocity of CO over ground, body frame, shape (N, 6).
        segments: Uninterrupted runs of rows [start, stop), shape (S, 2); internal states start in the steady
            state of the first velocity.
        t: Times of the rows, shape (N,) [s].
        commands: Commands of the thrusters, shape (N, n), for terms of a `formula`; 0 if None.

    Returns:
        Wrenches about CO, body frame, shape (N, 6) [N, N m]; 0 in rows outside all segments.

    Raises:
        DataError: An effect is not valid in the catalogue.
    """
    program = assemble(vehicle)
    out = np.zeros(np.shape(nu))
    given = np.zeros((len(out), program.thrusters)) if commands is None else commands
    _along(
        program.flat,
        np.ascontiguousarray(eta, np.float64),
        np.ascontiguousarray(nu, np.float64),
        np.ascontiguousarray(segments, np.int64).reshape(-1, 2),
        np.require(t, np.float64, ["C", "W"]),  # a read-only array would compile the kernel again
        np.ascontiguousarray(given, np.float64),
        np.zeros((6, program.states)),
        out,
    )
    return out


def effect_forces(
    vehicle: Vehicle,
    eta: ArrayLike,
    nu: ArrayLike,
    segments: ArrayLike,
    t: ArrayLike,
    commands: ArrayLike | None = None,
) -> Array:
    """Return the wrench on the vehicle of all its effects, except their inertia times the acceleration.

    With the wrench tau_e of `effect_wrenches` and the effects' part I of the mass matrix it is tau_e -
    C_I(nu_r) nu_r - I [omega x R^T v_c; 0]: the Coriolis terms of the inertia (Fossen 2011, theorem 3.2), and
    the part of -I nu_r_dot that a current v_c causes.  The other part, of a current that varies with depth or
    time, is in tau_e.  Rigid-body inertia and thrust are excluded.

    Args:
        vehicle: The vehicle.
        eta: Pose x y z phi theta psi, NED, shape (N, 6).
        nu: Velocity of CO over ground, body frame, shape (N, 6).
        segments: Uninterrupted runs of rows [start, stop), shape (S, 2).
        t: Times of the rows, shape (N,) [s].
        commands: Commands of the thrusters, shape (N, n), for terms of a `formula`; 0 if None.

    Returns:
        Wrenches about CO, body frame, shape (N, 6) [N, N m]; 0 in rows outside all segments.

    Raises:
        DataError: An effect is not valid in the catalogue.
    """
    out = effect_wrenches(vehicle, eta, nu, segments, t, commands)
    _inertia_along(
        assemble(vehicle).flat,
        np.ascontiguousarray(eta, np.float64),
        np.ascontiguousarray(nu, np.float64),
        np.ascontiguousarray(segments, np.int64).reshape(-1, 2),
        np.require(t, np.float64, ["C", "W"]),  # a read-only array would compile the kernel again
        out,
    )
    return out


def through_water(flow: Array, eta: Array, nu: Array, t: ArrayLike) -> Array:
    """Return the velocity of CO through the water, nu_r in body axes, (N, 6) [m/s, rad/s].

    Args:
        flow: Motion of the water, (7,) of `catalogue.current`.
        eta: Pose, NED, (N, 6) [m, rad].
        nu: Velocity over ground, body axes, (N, 6) [m/s, rad/s].
        t: Times of the rows, (N,) [s].
    """
    water = np.tile(flow[:3], (len(eta), 1))
    water[:, :2] += np.outer(eta[:, 2], flow[3:5]) + np.outer(np.asarray(t, float), flow[5:])
    nu_r = nu.copy()
    nu_r[:, :3] -= np.einsum("kji,kj->ki", rotation(*eta[:, 3:].T), water)
    return nu_r


@jit
def _inertia_along(
    flat: Array, eta: Array, nu: Array, segments: NDArray[np.int64], t: Array, out: Array
) -> None:
    """Subtract C_I(nu_r) nu_r + I [omega x R^T v_c; 0] from every row."""
    inertia = flat[HEADER + INERTIA : HEADER + INERTIA + 36]
    s, taken, carried = np.zeros(MOTION), np.zeros(6), np.zeros(3)
    nu_r = s[RELATIVE_VELOCITY : RELATIVE_VELOCITY + 6]
    for begin, end in segments:
        for k in range(begin, end):
            _motion(flat, eta[k], nu[k], t[k], s)
            taken[:] = 0.0
            coriolis_kernel(inertia, nu_r, taken)
            p, q, r = nu[k, 3], nu[k, 4], nu[k, 5]
            x, y, z = nu[k, 0] - nu_r[0], nu[k, 1] - nu_r[1], nu[k, 2] - nu_r[2]  # R^T v_c
            carried[0], carried[1], carried[2] = q * z - r * y, r * x - p * z, p * y - q * x
            for i in range(6):
                for j in range(3):
                    taken[i] += inertia[6 * i + j] * carried[j]
                out[k, i] -= taken[i]


@jit
def _along(
    flat: Array,
    eta: Array,
    nu: Array,
    segments: NDArray[np.int64],
    t: Array,
    commands: Array,
    states: Array,
    out: Array,
) -> None:
    """Integrate internal states from row to row by Runge-Kutta, along a linearly interpolated motion."""
    here, middle, there, unused = np.zeros(MOTION), np.zeros(MOTION), np.zeros(MOTION), np.zeros(6)
    x, trial, a, b, c, d = states[0], states[1], states[2], states[3], states[4], states[5]
    for begin, end in segments:
        for k in range(begin, end):
            if k == begin:
                _motion(flat, eta[k], nu[k], t[k], here)
                heed(commands[k], here)
                start(flat, here, x)
            wrench(flat, here, x, a, out[k])
            if k + 1 == end:
                break
            _motion(flat, eta[k + 1], nu[k + 1], t[k + 1], there)
            heed(commands[k + 1], there)
            if x.size:
                dt = t[k + 1] - t[k]
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
def _motion(flat: Array, eta: Array, nu: Array, t: float, s: Array) -> None:
    """Write the state of motion `s` of one row."""
    s[TIME] = t
    s[POSITION : POSITION + 3] = eta[:3]
    s[VELOCITY : VELOCITY + 6] = nu
    rotation_kernel(eta[3], eta[4], eta[5], s[ROTATION : ROTATION + 9])
    relative_to_water(flat, s)
