"""Water motion with which a vehicle file would explain a recorded motion completely.

The residual force along the three body axes is attributed to moving water of velocity v_w:

    (M_A + rho V) R^T v_w_dot = residual force at nu_r = nu - R^T (v_c + v_w),

with the added mass M_A, water density rho, displaced volume V, rotation R from body to NED, and the current
v_c of the file.  v_w is integrated along the recording from still water.  A steady force drives v_w to the
speed at which drag balances it.  With a correct file in calm water, v_w is noise only.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array, Rows
from hydro.core.compiled import jit
from hydro.core.effects.layout import (
    ADDED_MASS,
    BUOYANCY,
    CENTER_OF_BUOYANCY,
    GRAVITY,
    MASS_MATRIX,
    MOTION,
    RELATIVE_VELOCITY,
    ROTATION,
)
from hydro.core.effects.program import HEADER, constants_of, heed
from hydro.core.evaluation.force_error import missing_wrench
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.prediction.candidate import (
    Candidate,
    memories,
    move,
    rotor_states_around,
    true_velocity,
)
from hydro.core.recording.arrays import Recording
from hydro.core.simulation.dynamics import respond

FASTEST = 20.0
"""Bound of the water velocity on each axis [m/s]; forces that are far too large in a file would exceed it."""


def water_motion(model: Candidate, record: Recording, motion: Motion) -> Array:
    """Return the water velocity that would explain a recording, beyond the current of the vehicle file.

    Args:
        model: Vehicle without waves.
        record: Recording of N rows.
        motion: Smoothed motion of the recording.

    Returns:
        North, east and down velocity at each row, (N, 3) [m/s]; 0 at the start of each segment.
    """
    nu = np.ascontiguousarray(true_velocity(model, record, motion.nu))
    left = missing_wrench(model, record, motion.eta, motion.nu, motion.velocity)
    out = np.zeros((record.rows, 3))
    _follow(
        model.program.flat,
        (motion.eta, nu, record.t, record.commands),
        rotor_states_around(model, record),
        memories(model, record, motion.eta, nu),
        left,
        np.asarray(np.linalg.inv(carried(model)[:3]), np.float64),
        record.segments,
        out,
    )
    return out


def carried(model: Candidate) -> Array:
    """Return the wrench on the vehicle per acceleration of the water along each body axis, (6, 3) [kg, kg m].

    The rows are the wrench X Y Z K M N about CO; the columns are accelerations along x, y, z.
    """
    c = constants_of(model.program.flat)
    x, y, z = c[CENTER_OF_BUOYANCY : CENTER_OF_BUOYANCY + 3]
    lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    pressed: Array = c[BUOYANCY] / c[GRAVITY] * np.vstack([np.eye(3), lever])
    return c[ADDED_MASS : ADDED_MASS + 36].reshape(6, 6)[:, :3] + pressed


@jit
def _follow(
    flat: Array,
    along: tuple[Array, Array, Array, Array],
    rotors: Array,
    memory: Array,
    left: Array,
    inverse: Array,
    segments: Rows,
    out: Array,
) -> None:
    """Integrate the water velocity with Euler's method from row to row, into `out` (N, 3).

    Args:
        flat: Program of the vehicle.
        along: Pose, velocity, times and commands of the rows.
        rotors: Lag states of the thrusters at the rows.
        memory: Internal states of the effects at the rows.
        left: Residual wrench of the rows in still water, (N, 6).
        inverse: Inverse of the force rows of `carried`, (3, 3).
        segments: First and past-the-last row of each segment, (S, 2).
        out: Output: water velocity, NED, (N, 3) [m/s].
    """
    eta, nu, t, commands = along
    mass = flat[HEADER + MASS_MATRIX : HEADER + MASS_MATRIX + 36]
    s, tau, rates = np.zeros(MOTION), np.zeros(6), np.zeros(memory.shape[1])
    calm, moved, force, pushed = np.zeros(6), np.zeros(6), np.zeros(3), np.zeros(3)
    for segment in range(segments.shape[0]):
        for k in range(segments[segment, 0], segments[segment, 1] - 1):
            move(flat, eta[k], nu[k], t[k], s)
            heed(commands[k], s)
            body = s[ROTATION : ROTATION + 9]
            respond(flat, s, rotors[k], memory[k], rates, tau, calm)
            for i in range(3):
                for j in range(3):
                    s[RELATIVE_VELOCITY + i] -= body[3 * j + i] * out[k, j]
            respond(flat, s, rotors[k], memory[k], rates, tau, moved)
            for i in range(3):
                force[i] = left[k, i]
                for j in range(6):
                    force[i] -= mass[6 * i + j] * (moved[j] - calm[j])
            for i in range(3):
                pushed[i] = inverse[i, 0] * force[0] + inverse[i, 1] * force[1] + inverse[i, 2] * force[2]
            for i in range(3):
                rate = body[3 * i] * pushed[0] + body[3 * i + 1] * pushed[1] + body[3 * i + 2] * pushed[2]
                out[k + 1, i] = min(max(out[k, i] + (t[k + 1] - t[k]) * rate, -FASTEST), FASTEST)
