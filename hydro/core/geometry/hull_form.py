"""Geometric forms that represent a hull of known box and displacement.

`torpedo` is a body of elliptic sections of area S(x) = S_0 (1 - |2x/L|^n), with length L, largest section S_0
and n from the displacement, and four tail fins.  `ellipsoid` has n = 2 and no fins.  `box` is an open frame
or a box-like hull whose solid parts are distributed over its box.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.geometry.box import checked_sides

Shape = Literal["torpedo", "ellipsoid", "box"]
SHAPES: tuple[Shape, ...] = get_args(Shape)
SLENDER = 4.0
"""Minimum length over diameter of a hull that counts as a torpedo."""
ROUND = 1.3
"""Maximum ratio of width to height, or height to width, of a hull that counts as a torpedo."""
FULL = (0.4, 0.65)
"""Range of displaced volume over box volume of a hull that counts as an ellipsoid (pi/6 = 0.52).

Open frames are below this range.
"""
PRISMATIC = (2.0 / 3.0, 0.95)
"""Minimum (that of an ellipsoid) and maximum prismatic coefficient of a torpedo."""
FIN_TIP = 1.0
"""Distance of the fin tips from a torpedo's axis, relative to the hull's diameter."""
FIN_CHORD = 0.5
"""Chord of tail fins relative to the hull's diameter: usual for survey vehicles, with a wide error."""


@dataclass(frozen=True)
class Form:
    """Geometric form that represents a hull.

    Attributes:
        shape: One of SHAPES.
        sides: Length, width, height [m], (3,).
        displaced: Mass of the displaced water [kg].
        density: Water density [kg/m^3].
        fins: Whether the hull has four tail fins of usual proportions; only possible for a torpedo.
    """

    shape: Shape
    sides: Array
    displaced: float
    density: float
    fins: bool

    @property
    def fullness(self) -> float:
        """Displaced volume relative to the volume of the box."""
        return float(self.displaced / (self.density * np.prod(self.sides)))

    @property
    def diameter(self) -> float:
        """Diameter of a circle with the area of the largest section [m]."""
        return float(np.sqrt(self.sides[1] * self.sides[2]))

    @property
    def exponent(self) -> float:
        """Exponent n of the section area S(x) = S_0 (1 - |2x/L|^n) along a hull of length L; 2: an ellipsoid.

        For a torpedo, n follows from the prismatic coefficient n/(n + 1), the fullness of the hull relative
        to a cylinder.  S_0 is the area of the section in the middle, x = 0.
        """
        if self.shape != "torpedo":
            return 2.0
        prismatic = float(np.clip(self.fullness / (np.pi / 4.0), *PRISMATIC))
        return prismatic / (1.0 - prismatic)

    @property
    def tail(self) -> float:
        """Position x of the tail fins [m] from the hull's centre: half a chord ahead of the stern."""
        return float(-0.5 * self.sides[0] + 0.5 * FIN_CHORD * self.diameter)


def form_of(
    sides: Sequence[float], displaced: float, density: float, shape: Shape | None = None, fins: bool = True
) -> Form:
    """Return the geometric form that represents a hull.

    Args:
        sides: Length, width, height [m].
        displaced: Mass of the displaced water [kg].
        density: Water density [kg/m^3].
        shape: One of SHAPES; by default a torpedo if the box is long and round, else by the displacement.
        fins: Whether a torpedo has tail fins.

    Raises:
        DataError: A number is not positive and finite, or the displacement exceeds the box.
    """
    size = checked_sides(sides)
    for name, value in (("displaced mass", displaced), ("water density", density)):
        if not np.isfinite(value) or value <= 0.0:
            raise DataError(f"{name}: must be a positive, finite number, got {value:g}")
    held = density * float(np.prod(size))
    if displaced > 1.001 * held:
        box = " x ".join(f"{side:g}" for side in size)
        raise DataError(
            f"a box of {box} m holds {held:.3g} kg of water, but the vehicle displaces {displaced:.3g} kg: "
            "check mass and buoyancy (kg, N) and length, width and height (m)"
        )
    if shape is not None and shape not in SHAPES:
        raise DataError(f"shape: expected {', '.join(SHAPES)}, got {shape}")
    chosen = shape or default_shape(size, displaced / held)
    return Form(chosen, size, displaced, density, fins and chosen == "torpedo")


def default_shape(sides: Array, fullness: float) -> Shape:
    """Return the likely shape of a hull from its proportions.

    Args:
        sides: Length, width, height [m], (3,).
        fullness: Displaced volume relative to the volume of the box.
    """
    length, width, height = sides
    if length >= SLENDER * max(width, height) and max(width, height) <= ROUND * min(width, height):
        return "torpedo"
    return "ellipsoid" if FULL[0] <= fullness <= FULL[1] else "box"


def second_moment(form: Form) -> float:
    """Return the mean square of x over the volume of a torpedo or ellipsoid, about its middle [m^2].

    Args:
        form: Shape and size of the hull; x is along its length.
    """
    n = form.exponent
    return float(form.sides[0] ** 2 / 4.0 * (1.0 / 3.0 - 1.0 / (n + 3.0)) / (1.0 - 1.0 / (n + 1.0)))


def uniform_inertia(form: Form, mass: float) -> Array:
    """Return the moments of inertia (3,) [kg m^2] of a hull of uniform density about its centre.

    Torpedo and ellipsoid have the moments of their form.  A box has those of the ellipsoid within it, since
    heavy parts (batteries, pressure hulls) are near the middle.  The uniform box is an upper bound, 5/3 of
    these values.

    Args:
        form: Shape and size of the hull.
        mass: Dry mass [kg].
    """
    _, width2, height2 = form.sides**2
    n = form.exponent
    # Elliptic sections: mean y^2 = W^2/16 mean of (1 - |s|^n)^2 over mean of (1 - |s|^n).
    across = (1.0 - 2.0 / (n + 1.0) + 1.0 / (2.0 * n + 1.0)) / (1.0 - 1.0 / (n + 1.0)) / 16.0
    x2, y2, z2 = second_moment(form), across * width2, across * height2
    return mass * np.array([y2 + z2, z2 + x2, x2 + y2])
