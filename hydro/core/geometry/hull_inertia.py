"""Added mass of a vehicle from the form of its hull, with standard errors."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.geometry.box import box_added_mass
from hydro.core.geometry.hull_form import FIN_CHORD, FIN_TIP, Form, second_moment
from hydro.core.vehicle.ellipsoid import lamb_factors

ERRORS = {
    "torpedo": (0.5, 0.25, 0.25, 1.0, 0.4, 0.4),
    "ellipsoid": (0.5, 0.3, 0.3, 1.0, 0.5, 0.5),
    "box": (0.5, 0.5, 0.5, 0.6, 0.6, 0.6),
}
"""Relative standard errors of the diagonal of the added mass, by shape.

A torpedo's sway is well known for any ends; along and about the axis, protruding parts matter most.  A box
lies between its solid parts alone and a solid box, about a factor of two either way.
"""
LEAST = 0.05
"""Minimum standard error relative to displaced mass or inertia, for a round body without added inertia."""


def added_mass(form: Form) -> Array:
    """Return the diagonal of a hull's added-mass matrix about its centre, (6,) [kg, kg m^2].

    Ellipsoid: Lamb's k-factors times displaced mass and inertia (Lamb 1932, art. 114-115).  Torpedo: the same
    k-factors, as the reduction by the ends of a strip of elliptic section (Newman 1977, section 4.15), times
    the mass and second moment of its fuller form, plus the fins.  Box: the solid box of DNV-RP-C205 times its
    fullness, since solid parts of a frame have added mass in proportion to their volume.

    Args:
        form: Shape and size of the hull.
    """
    if form.shape == "box":
        return np.asarray(form.fullness * box_added_mass(tuple(form.sides), form.density))
    half2 = form.sides**2 / 4.0
    along = 5.0 * second_moment(form)  # L^2/4 of an ellipsoid
    mass = form.displaced
    inertia = mass / 5.0 * np.array([half2[1] + half2[2], half2[2] + along, along + half2[1]])
    hull = lamb_factors(tuple(form.sides / 2.0)) * np.concatenate([np.full(3, mass), inertia])
    fin = fin_mass(form)
    roll = 2.0 / np.pi * form.density * (FIN_TIP * form.diameter) ** 4 * FIN_CHORD * form.diameter
    fins = np.array([0.0, fin, fin, roll, fin * form.tail**2, fin * form.tail**2])
    return np.asarray(hull + fins * form.fins)


def fin_mass(form: Form) -> float:
    """Return the added mass [kg] of the pair of tail fins across sway, or across heave.

    Slender-body theory of a cylinder of radius R with fins that reach to s from its axis (Nielsen 1960;
    Blevins 1979), minus the bare cylinder: rho pi (s^2 - R^2)^2/s^2 per length, with the water density rho.

    Args:
        form: Shape and size of the hull.
    """
    s, R = FIN_TIP * form.diameter, 0.5 * form.diameter
    return float(form.density * np.pi * (s * s - R * R) ** 2 / (s * s) * FIN_CHORD * form.diameter)


def added_mass_errors(form: Form, values: Array, body: Array, relative: tuple[float, ...] = ()) -> Array:
    """Return standard errors of the diagonal of a hull's added mass, (6,) [kg, kg m^2].

    The standard errors of the dry inertia are included, since a vehicle file has no standard error of
    `inertia`, and motion shows only the sum of dry and added inertia.

    Args:
        form: Shape and size of the hull.
        values: Diagonal of the added mass, (6,) [kg, kg m^2].
        body: Standard errors of the dry moments of inertia, (3,) [kg m^2].
        relative: Relative standard errors of `values`, (6,); by default those of the shape.
    """
    mass = form.displaced
    squares = form.sides**2
    inertia = (
        mass / 20.0 * np.array([squares[1] + squares[2], squares[2] + squares[0], squares[0] + squares[1]])
    )
    own = np.array(relative or ERRORS[form.shape]) * values
    least = LEAST * np.concatenate([np.full(3, mass), inertia])
    return np.asarray(np.hypot(np.maximum(own, least), np.concatenate([np.zeros(3), body])))
