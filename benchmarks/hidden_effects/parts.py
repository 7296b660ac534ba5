"""Forces of the benchmark's simulator in addition to hull damping: drag of parts, a fin, a power law.

As `plant`, it shares no code with `hydro.core`.  Body FRD, forces ON the vehicle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from hydro.core.columns import Array

SLOPE, PROFILE, BLEND = (
    math.pi,
    0.01,
    0.05,
)  # of fins: lift slope, drag along the flow, width of the stall [rad]


class Parts(NamedTuple):
    """Parameters of drag and lift in addition to the hull.

    Attributes:
        power: Drag of the six axes at 1 m/s and 1 rad/s, and the power of the speed, (7,).
        offset: Drag along the three axes and the point where it acts, (6,).
        fin: 1/2 rho A, the point where it acts, the roll of its span, deflection and stall, (7,).
        form: 1/2 rho C of an ellipsoid along the three axes, (3,).
        faces: Place and outward area vector of each of the F faces of the ellipsoid, (F, 6).
    """

    power: Array
    offset: Array
    fin: Array
    form: Array
    faces: Array


def ellipsoid(half: Array, center: Array) -> Array:
    """Return the faces (F, 6) of an ellipsoid: 6 bands of equal height with 8 faces each.

    The frontal area of each axis is exact.
    """
    height, turn = np.meshgrid((np.arange(6) - 2.5) / 3.0, (np.arange(8) + 0.5) * np.pi / 4.0)
    radius = np.sqrt(1.0 - height**2)
    unit = np.column_stack([height.ravel(), (radius * np.cos(turn)).ravel(), (radius * np.sin(turn)).ravel()])
    frontal = np.pi * half.prod() / half
    return np.hstack([center + unit * half, unit * frontal / np.maximum(unit, 0.0).sum(axis=0)])


@njit(cache=True)
def cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@njit(cache=True)
def push(tau: Array, force: Array, point: Array) -> None:
    """Add a force in body axes at a point of the body, with its moment, to the wrench `tau` (6,)."""
    tau[:3] += force
    tau[3:] += cross(point, force)


@njit(cache=True)
def coefficients(angle: float, stall: float) -> tuple[float, float]:
    """Return lift and drag coefficients of a fin: a wing below its angle of stall, a flat plate above it."""
    plate = 0.5 * (1.0 + math.tanh(0.5 * (abs(angle) - stall) / BLEND))
    lift = (1.0 - plate) * SLOPE * angle + plate * math.sin(2.0 * angle)
    return lift, PROFILE + 1.0 - math.cos(2.0 * angle)


@njit(cache=True)
def hang(parts: Parts, n: Array, tau: Array) -> None:
    """Add the forces of all parts at the velocity n through the water (6,) to the wrench `tau` (6,)."""
    tau -= parts.power[:6] * np.sign(n) * np.abs(n) ** parts.power[6]
    if parts.offset[:3].any():
        place = parts.offset[3:]
        there = n[:3] + cross(n[3:], place)
        push(tau, -parts.offset[:3] * np.abs(there) * there, place)
    if parts.form.any():
        for face in parts.faces:
            there = n[:3] + cross(n[3:], face[:3])
            flux = (there * face[3:]).sum()
            if flux > 0.0:
                push(tau, -flux * parts.form * there, face[:3])
    if parts.fin[0] > 0.0:
        place, roll, deflection = parts.fin[1:4], parts.fin[4], parts.fin[5]
        there = n[:3] + cross(n[3:], place)
        normal = np.array([0.0, -math.sin(roll), math.cos(roll)])
        ahead, drift = there[0], (there * normal).sum()
        lift, drag = coefficients(
            (math.atan2(drift, ahead) + deflection + math.pi) % (2.0 * math.pi) - math.pi, parts.fin[6]
        )
        pressure = parts.fin[0] * math.hypot(ahead, drift)
        force = -pressure * (lift * ahead + drag * drift) * normal
        force[0] = pressure * (lift * drift - drag * ahead)
        push(tau, force, place)
