"""Added mass of an ellipsoid in an unbounded ideal fluid: Lamb's k-factors for three unequal axes.

Source: H. Lamb, *Hydrodynamics* (6th ed., 1932), art. 114-115; Fossen (2011), section 6.3.3.  With semi-axes
a, b, c and Delta = sqrt((a^2 + s)(b^2 + s)(c^2 + s)), the three constants are

    alpha_0 = a b c int_0^inf ds / ((a^2 + s) Delta),  beta_0 and gamma_0 likewise,  their sum 2
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from hydro.core.columns import Array
from hydro.core.errors import DataError


def lamb_constants(semi_axes: Sequence[float]) -> Array:
    """Return Lamb's constants (alpha_0, beta_0, gamma_0) of an ellipsoid, (3,).

    With Delta = sqrt((a^2 + s)(b^2 + s)(c^2 + s)), alpha_0 is a b c times the integral over s, from 0 to
    infinity, of 1 / ((a^2 + s) Delta); beta_0 and gamma_0 have b^2 and c^2 in the place of a^2.  Their sum is
    2 (Lamb, art. 114 (6)).

    Args:
        semi_axes: a, b, c [m] along body x, y, z; any order of size.

    Raises:
        DataError: A semi-axis is not a positive finite number.
    """
    a, b, c = _checked(semi_axes)
    a2, b2, c2 = a * a, b * b, c * c
    r_d = scipy.special.elliprd
    return 2.0 / 3.0 * a * b * c * np.array([r_d(b2, c2, a2), r_d(c2, a2, b2), r_d(a2, b2, c2)])


def lamb_factors(semi_axes: Sequence[float]) -> Array:
    """Return Lamb's six k-factors: added mass over displaced mass, added inertia over displaced inertia.

    Args:
        semi_axes: a, b, c [m] along body x, y, z.

    Returns:
        Factors [-] along x, y, z and about x, y, z, (6,).  With Lamb's constants, the first is alpha_0 / (2 -
        alpha_0) (art. 114 (7)).  The fourth is (b^2 - c^2)^2 D / ((b^2 + c^2)(2 - (b^2 + c^2) D)) with D =
        (gamma_0 - beta_0) / (b^2 - c^2) (art. 115 (9)), relative to m (b^2 + c^2)/5 with the displaced mass
        m.  The other axes follow by cyclic exchange.  D is computed as an integral, so that there is no 0/0
        at b = c.

    Raises:
        DataError: A semi-axis is not a positive finite number.
    """
    a, b, c = _checked(semi_axes)
    constants = lamb_constants(semi_axes)
    translation = constants / (2.0 - constants)
    rotation = [_rotational_factor(*axes) for axes in ((a, b, c), (b, c, a), (c, a, b))]
    return np.concatenate([translation, rotation])


def added_mass_matrix(semi_axes: Sequence[float], density: float, center: Sequence[float]) -> Array:
    """Return the added mass of an ellipsoid about the body origin.

    Args:
        semi_axes: a, b, c [m] along body x, y, z.
        density: Water density [kg/m^3].
        center: Centre of the ellipsoid [m] from the body origin CO, FRD.

    Returns:
        Added-mass matrix M_A (6, 6) about CO, symmetric and positive semi-definite: H(r)^T D H(r), with the
        diagonal matrix D about the centre and Fossen's transformation H (7.27).  A centre off CO couples sway
        with yaw and so on.

    Raises:
        DataError: A semi-axis is not a positive finite number.
    """
    a, b, c = _checked(semi_axes)
    mass = 4.0 / 3.0 * np.pi * density * a * b * c
    inertia = mass / 5.0 * np.array([b * b + c * c, c * c + a * a, a * a + b * b])
    about_center = np.diag(lamb_factors(semi_axes) * np.concatenate([np.full(3, mass), inertia]))
    x, y, z = (float(value) for value in center)
    transform = np.eye(6)
    transform[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    matrix: Array = transform.T @ about_center @ transform
    return 0.5 * (matrix + matrix.T)


def _rotational_factor(axis: float, b: float, c: float) -> float:
    """Return added over displaced moment of inertia about the semi-axis `axis`; b and c are the others."""
    scale = max(axis, b, c)
    a2, b2, c2 = (axis / scale) ** 2, (b / scale) ** 2, (c / scale) ** 2

    def integrand(log_s: float) -> float:
        # In log s all scales of a slender or flat body have the same width.
        s = np.exp(log_s)
        return float(s / (((b2 + s) * (c2 + s)) ** 1.5 * np.sqrt(a2 + s)))

    knots = sorted({float(np.log(square)) for square in (a2, b2, c2)})
    integral, _ = scipy.integrate.quad(
        integrand, knots[0] - 40.0, knots[-1] + 20.0, points=knots, epsabs=0.0, epsrel=1e-12, limit=400
    )
    ratio = np.sqrt(a2 * b2 * c2) * integral
    total = b2 + c2
    return float((b2 - c2) ** 2 * ratio / (total * (2.0 - total * ratio)))


def _checked(semi_axes: Sequence[float]) -> tuple[float, float, float]:
    """Return the three semi-axes as floats, or raise an error that names them."""
    axes = tuple(float(value) for value in semi_axes)
    if len(axes) != 3 or not all(np.isfinite(axes)) or min(axes) <= 0.0:
        raise DataError(f"an ellipsoid needs three positive, finite semi-axes in metres, not {list(axes)}")
    return axes
