"""Drag and lift of a vehicle from the form of its hull, with standard errors.

Along and across the hull, C_d of streamlined and bluff bodies applies to the area that faces the flow.  In
rotation, the same C_d is integrated over the hull at the local speed omega x r (strip theory of cross-flow
drag: Hoerner 1965; Fossen 2021, chapter 6).  The quadratic coefficient is the force at 1 m/s.  The linear
coefficient represents friction and slow flow; linear and quadratic drag are equal at the speed SLOW.

Sources: DNV-RP-C205 (2010), appendix E (plates, rods along the flow, elliptic sections, cylinders of finite
length); S. F. Hoerner, *Fluid-Dynamic Drag* (1965), ch. 3 and 6; friction by the ITTC-1957 line.
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.geometry.hull_form import FIN_CHORD, FIN_TIP, Form

SLOW = 0.1
"""Speed at which linear and quadratic drag are equal [m/s]: 0.1 to 0.2 for identified vehicles."""
PLATE = 1.16
"""C_d of a square plate across the flow; also of an open frame, where the flow does not reattach."""
ROD = ((0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0), (PLATE, 1.15, 0.97, 0.87, 0.9, 0.93, 0.95, 0.95))
"""C_d of a block by its depth along the flow over its narrower side across the flow."""
CYLINDER = 1.2
"""C_d of a long circular cylinder across the flow, below the critical Reynolds number."""
SPHERE = 0.47
"""C_d of a sphere, below the critical Reynolds number."""
FINITE = ((1.0, 2.0, 5.0, 10.0, 20.0, 40.0, 100.0), (SPHERE / CYLINDER, 0.58, 0.62, 0.68, 0.74, 0.82, 0.98))
"""Factor on C_d of a cylinder by its length over its diameter; at 1 that of a sphere."""
ELLIPSE = ((0.125, 0.25, 0.5, 1.0, 2.0), (0.22, 0.3, 0.6, 1.0, 1.6))
"""C_d of an elliptic section, relative to a circle, by its width across over its depth along the flow."""
STREAMLINED = 4.0
"""Minimum length over diameter of a hull at which the flow stays attached."""
VISCOSITY = 1.2e-6
"""Kinematic viscosity [m^2/s] of water of about 13 degrees."""
ROLL = 0.1
"""Minimum share of the cross-flow drag that acts on a round hull in roll, from protruding parts."""
LIFT_VISCOUS = 0.9
"""Lift slope of a real wing section over 2 pi (Hoerner)."""

ERROR = 0.6
"""Relative standard error of C_d.

Frames reach a C_d of 2.5 (DNV-RP-H103), about twice that of a plate, and about two of these errors away.
"""
ERROR_TURNING = 0.8
"""Relative standard error of C_d in rotation, where lever arms count to the fourth power.

It is doubled for the roll of a round hull.
"""
ERROR_LINEAR = 1.0
"""Relative standard error of linear damping."""


def quadratic_drag(form: Form) -> Array:
    """Return the diagonal of a hull's quadratic damping matrix about its centre, (6,) [N s^2/m^2, N m s^2].

    Args:
        form: Shape and size of the hull.
    """
    if form.shape == "box":
        return _of_box(form)
    return _of_round_hull(form) + _of_fins(form) * form.fins


def linear_drag(form: Form, quadratic: Array) -> Array:
    """Return the diagonal of a hull's linear damping matrix, (6,) [N s/m, N m s].

    Linear and quadratic damping are equal at the speed SLOW; in rotation, at the rate at which the box has a
    root mean square speed of SLOW.

    Args:
        form: Shape and size of the hull.
        quadratic: Diagonal of quadratic damping, (6,) [N s^2/m^2, N m s^2].
    """
    squares = form.sides**2 / 12.0
    arms = np.sqrt([squares[1] + squares[2], squares[2] + squares[0], squares[0] + squares[1]])
    return np.asarray(quadratic * np.concatenate([np.full(3, SLOW), SLOW / arms]))


def drag_errors(form: Form, quadratic: Array, linear: Array) -> tuple[Array, Array]:
    """Return the standard errors of quadratic and of linear damping, (6,) each, in the units of the values.

    Args:
        form: Shape and size of the hull.
        quadratic: Diagonal of quadratic damping, (6,) [N s^2/m^2, N m s^2].
        linear: Diagonal of linear damping, (6,) [N s/m, N m s].
    """
    relative = np.array([ERROR] * 3 + [ERROR_TURNING] * 3)
    if form.shape != "box":
        relative[3] *= 2.0
    return relative * quadratic, ERROR_LINEAR * linear


def fin_lift(form: Form) -> float:
    """Return the lift coefficient of a pair of tail fins, 1/2 rho c_L A [kg/m]: L11 of effect `body_lift`.

    The lift is this coefficient times forward speed times drift speed.  rho is the water density, A the area
    of the pair, and c_L = 1/(1/(2 pi 0.9) + 1/(pi A_e)) the lift slope, with the aspect ratio A_e = span^2/A
    (Hoerner; Prestero 2001, ch. 4).

    Args:
        form: Shape and size of the hull.
    """
    span = (2.0 * FIN_TIP - 1.0) * form.diameter
    area = span * FIN_CHORD * form.diameter
    slope = 1.0 / (1.0 / (2.0 * np.pi * LIFT_VISCOUS) + area / (np.pi * span**2))
    return float(0.5 * form.density * slope * area)


def _of_box(form: Form) -> Array:
    """Return the quadratic drag of a box, (6,): solid parts as a block, the rest as plates.

    The flow reattaches to a block.  About axis i, a face of normal j has the lever arm r along k: int |r|^3
    dA = s_i s_k^4/32, with the sides s.
    """
    size, solid = form.sides, min(form.fullness, 1.0)
    across = [(size[(i + 1) % 3], size[(i + 2) % 3]) for i in range(3)]
    block = np.array([np.interp(size[i] / min(across[i]), *ROD) for i in range(3)])
    C_d = solid * block + (1.0 - solid) * PLATE
    faces = np.array([one * other for one, other in across])
    turning = [
        size[i] / 32.0 * (C_d[j] * size[k] ** 4 + C_d[k] * size[j] ** 4)
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
    ]
    return np.asarray(0.5 * form.density * np.concatenate([C_d * faces, turning]))


def _of_round_hull(form: Form) -> Array:
    """Return the quadratic drag of a streamlined body, (6,).

    Its elliptic sections have half widths W/2 sqrt(1 - |2x/L|^n), with length L, width W and exponent n.
    """
    length, width, height = form.sides
    stations = np.linspace(0.0, 1.0, 2001)
    outline = np.sqrt(np.maximum(1.0 - stations**form.exponent, 0.0))
    area = np.trapezoid(outline, stations)
    arm3 = np.trapezoid(stations**3 * outline, stations) * length**3 / 8.0
    C_x = _streamlined(length / form.diameter, length)
    finite = np.interp(np.log(length / form.diameter), np.log(FINITE[0]), FINITE[1])
    C_y, C_z = (
        CYLINDER * finite * np.interp(np.log(ratio), np.log(ELLIPSE[0]), ELLIPSE[1])
        for ratio in (height / width, width / height)
    )
    forces = [C_x * np.pi / 4.0 * width * height, C_y * area * length * height, C_z * area * length * width]
    flat = max(abs(width**2 - height**2) / (width**2 + height**2), ROLL)
    roll = flat * length * area / 32.0 * (C_y * height**4 + C_z * width**4)
    return (
        0.5
        * form.density
        * np.array([*forces, roll, C_z * width * length * arm3, C_y * height * length * arm3])
    )


def _streamlined(slenderness: float, length: float) -> float:
    """Return C_d, relative to the largest section, of a body along the flow at 1 m/s.

    Bodies of length l and diameter d, l/d >= 4: C_f (3 l/d + 4.5 sqrt(d/l) + 21 (d/l)^2) with the friction
    coefficient C_f (Hoerner, ch. 6).  For shorter bodies C_d tends to that of a sphere and then of a plate.

    Args:
        slenderness: l/d.
        length: l [m].
    """
    friction = 0.075 / (np.log10(max(length / VISCOSITY, 1e4)) - 2.0) ** 2

    def attached(ratio: float) -> float:
        return float(friction * (3.0 * ratio + 4.5 / np.sqrt(ratio) + 21.0 / ratio**2))

    if slenderness >= STREAMLINED:
        return attached(slenderness)
    if slenderness <= 1.0:
        return float(np.interp(slenderness, [0.0, 1.0], [PLATE, SPHERE]))
    share = np.log(slenderness) / np.log(STREAMLINED)
    return float(SPHERE * (attached(STREAMLINED) / SPHERE) ** share)


def _of_fins(form: Form) -> Array:
    """Return the quadratic drag of four tail fins, (6,): two act in sway, two in heave, all in roll."""
    inner, tip, chord = 0.5 * form.diameter, FIN_TIP * form.diameter, FIN_CHORD * form.diameter
    pair = PLATE * 2.0 * (tip - inner) * chord
    roll = PLATE * 4.0 * chord * (tip**4 - inner**4) / 4.0
    arm3 = abs(form.tail) ** 3
    return 0.5 * form.density * np.array([0.0, pair, pair, roll, pair * arm3, pair * arm3])
