"""Fluid force on a closed triangulated hull, facet by facet, from the local velocity.

This is a quasi-steady method similar to Newton's impact theory.  A facet with centroid r, outward unit normal
n and area A moves through the water at v = v_r + omega x r, with velocity v_r of the body origin through the
water and angular velocity omega.  The normal part of v is v_n = v . n, the tangential part v_t = v - v_n n.
The forces, in water of density rho, are

    form drag      dF = -1/2 rho C_p A max(v_n, 0)^2 n    where the facet faces the flow, none in the wake
    skin friction  dF = -1/2 rho C_f A |v_t| v_t          on every facet

A flat plate broadside on then has the drag coefficient C_p without skin friction.  A sphere has C_p/2, and a
circular cylinder across the flow 2 C_p/3, plus friction.  Every facet dissipates power, so the sum does: (X,
Y, Z, K, M, N) . nu_r <= 0 for any motion.

C_p = 1.1 is that of a square plate or disc (Hoerner, *Fluid-Dynamic Drag*, 1965, ch. 3: 1.1-1.2); C_f =
0.0043 is the ITTC-1957 line 0.075/(log10 Re - 2)^2 at a Reynolds number of 1.5e6, a 1.5 m hull at 1 m/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.errors import DataError

FORM_DRAG = 1.1  # default C_p, see the module
SKIN_FRICTION = 0.0043  # default C_f, see the module


@dataclass(frozen=True)
class Panels:
    """Closed hull of F flat facets, in body axes FRD about the body origin CO.

    Attributes:
        table: (7, F) rows x y z of the centroid [m], x y z of the outward unit normal, area [m^2].
        volume: Enclosed volume [m^3].
        center: Centroid of the volume (3,) [m]: the centre of buoyancy.
        extent: Lengths (3,) of the bounding box [m].
    """

    table: Array
    volume: float
    center: Array
    extent: Array


def panels(vertices: ArrayLike, faces: ArrayLike) -> Panels:
    """Compute facets, volume and centre of buoyancy of a closed triangulated surface.

    Args:
        vertices: Points [m], FRD about CO, one for each of V vertices, (V, 3).
        faces: Vertex numbers of F triangles, from 0, anticlockwise as seen from outside, (F, 3).

    Returns:
        The panels.  Volume and centroid are sums over the tetrahedra from the origin to each facet (the
        divergence theorem), exact for the polyhedron.

    Raises:
        DataError: The surface is empty, not finite, not closed, not consistently oriented, or inside out.
    """
    points = np.asarray(vertices, dtype=np.float64)
    triangles = np.asarray(faces, dtype=np.int64)
    _check_surface(points, triangles)
    a, b, c = points[triangles].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    normal = cross / np.where(length > 0.0, length, 1.0)[:, None]
    sixfold = np.einsum("ij,ij->i", a, np.cross(b, c))
    volume = float(sixfold.sum()) / 6.0
    if volume <= 0.0:
        raise DataError(
            f"the hull is inside out (volume {volume:.3g} m^3): reverse the vertex order of its faces"
        )
    center = ((a + b + c) * sixfold[:, None]).sum(axis=0) / (24.0 * volume)
    table = np.ascontiguousarray(np.column_stack([(a + b + c) / 3.0, normal, 0.5 * length]).T)
    return Panels(table, volume, center, np.ptp(points[triangles.ravel()], axis=0))


def superellipsoid(
    length: float,
    width: float,
    height: float,
    center: ArrayLike = (0.0, 0.0, 0.0),
    *,
    along: int = 18,
    around: int = 16,
) -> tuple[Array, NDArray[np.int64]]:
    """Return the triangulated surface of a hull of given size: full along its length, rounded across it.

    The surface is (|y'|^2.5 + |z'|^2.5)^(4/2.5) + x'^4 = 1, with x', y', z' from the centre in half lengths.
    Its facets are symmetric about three planes, so straight motion along an axis gives no force across it.

    Args:
        length: Extent along x [m].
        width: Extent along y [m].
        height: Extent along z [m].
        center: Centre (3,) [m] from CO, FRD.
        along: Number of bands from bow to stern, even.
        around: Number of points around each ring, a multiple of 4.

    Returns:
        V points, FRD from CO, (V, 3) [m], and the point numbers of F triangles, (F, 3), with F = 2 around
        (along - 1).

    Raises:
        DataError: A size is not positive and finite.
    """
    size = np.array([length, width, height], dtype=np.float64)
    if not np.all(np.isfinite(size)) or size.min() <= 0.0:
        raise DataError(
            f"a hull needs positive, finite length, width and height in metres, not {size.tolist()}"
        )
    polar = np.linspace(0.0, np.pi, along + 1)[1:-1]
    azimuth = 2.0 * np.pi * np.arange(around) / around
    x, radius = _power(np.cos(polar), 2.0 / 4.0), _power(np.sin(polar), 2.0 / 4.0)
    y, z = _power(np.cos(azimuth), 2.0 / 2.5), _power(np.sin(azimuth), 2.0 / 2.5)
    rings = np.stack(np.broadcast_arrays(x[:, None], radius[:, None] * y, radius[:, None] * z), axis=-1)
    unit = np.concatenate([[[1.0, 0.0, 0.0]], rings.reshape(-1, 3), [[-1.0, 0.0, 0.0]]])
    return unit * (0.5 * size) + np.asarray(center, dtype=np.float64), _ring_faces(along - 1, around)


def loaded_facets(
    hull: Panels, density: float, form: float = FORM_DRAG, friction: float = SKIN_FRICTION
) -> Array:
    """Return the facets of a hull with their drag coefficients, as `panel_wrench_kernel` needs them.

    Args:
        hull: Panels of the hull, F facets.
        density: Water density [kg/m^3].
        form: Coefficient of form drag C_p [-].
        friction: Coefficient of skin friction C_f [-].

    Returns:
        (8, F) rows x y z of the centroid [m], x y z of the normal, 1/2 rho C_p A and 1/2 rho C_f A [kg/m],
        with density rho and area A.
    """
    area = 0.5 * density * hull.table[6]
    return np.ascontiguousarray(np.vstack([hull.table[:6], form * area, friction * area]))


@partial(kernel, reorder_sums=True)
def panel_wrench_kernel(nu_r: Array, facets: Array, out: Array) -> None:
    """Add the drag of the facets of a hull about CO to `out`.

    Args:
        nu_r: Velocity of CO through the water, body axes, (6,) [m/s, rad/s].
        facets: F facets from `loaded_facets`, (8, F); (8, 0) without a hull.
        out: Wrench X Y Z K M N on the vehicle, body axes, (6,) [N, N m], added to.
    """
    u, v, w, p, q, r = nu_r[0], nu_r[1], nu_r[2], nu_r[3], nu_r[4], nu_r[5]
    X = Y = Z = K = M = N = 0.0
    for i in range(facets.shape[1]):
        x, y, z = facets[0, i], facets[1, i], facets[2, i]
        n_x, n_y, n_z = facets[3, i], facets[4, i], facets[5, i]
        v_x, v_y, v_z = u + q * z - r * y, v + r * x - p * z, w + p * y - q * x
        v_n = v_x * n_x + v_y * n_y + v_z * n_z
        t_x, t_y, t_z = v_x - v_n * n_x, v_y - v_n * n_y, v_z - v_n * n_z
        # No branch: max() keeps the loop vectorised.
        facing = max(v_n, 0.0)
        pressure = facets[6, i] * facing * facing
        shear = facets[7, i] * math.sqrt(t_x * t_x + t_y * t_y + t_z * t_z)
        f_x = -pressure * n_x - shear * t_x
        f_y = -pressure * n_y - shear * t_y
        f_z = -pressure * n_z - shear * t_z
        X += f_x
        Y += f_y
        Z += f_z
        K += y * f_z - z * f_y
        M += z * f_x - x * f_z
        N += x * f_y - y * f_x
    out[0] += X
    out[1] += Y
    out[2] += Z
    out[3] += K
    out[4] += M
    out[5] += N


def panel_wrench(hull: Panels, nu_r: ArrayLike, density: float) -> Array:
    """Return the drag of a hull of flat panels, as a wrench on the vehicle about CO, (6,) [N, N m].

    Args:
        hull: Panels of the hull.
        nu_r: Velocity of CO through the water in body axes (6,) [m/s, rad/s].
        density: Density of the water [kg/m^3].
    """
    out = np.zeros(6)
    panel_wrench_kernel(np.array(nu_r, dtype=np.float64), loaded_facets(hull, density), out)
    return out


def _power(value: Array, exponent: float) -> Array:
    """Return sign(value) |value|^exponent; rounding errors near 0 are removed, for exact mirror images."""
    clean = np.where(np.abs(value) < 1e-12, 0.0, value)
    power: Array = np.sign(clean) * np.abs(clean) ** exponent
    return power


def _ring_faces(rings: int, around: int) -> NDArray[np.int64]:
    """Return the triangles between a bow point, rings of points and a stern point, symmetric about planes."""
    faces: list[tuple[int, int, int]] = []
    stern = 1 + rings * around
    for j in range(around):
        here, there = j, (j + 1) % around
        faces.append((0, 1 + here, 1 + there))
        last = 1 + (rings - 1) * around
        faces.append((stern, last + there, last + here))
        for i in range(rings - 1):
            front, back = 1 + i * around, 1 + (i + 1) * around
            corners = (front + here, back + here, back + there, front + there)
            octant_parity = (2 * i < rings - 1) ^ ((4 * j // around) % 2 == 0)
            a, b, c, d = corners if octant_parity else (*corners[1:], corners[0])
            faces += [(a, b, c), (a, c, d)]
    return np.array(faces, dtype=np.int64)


def _check_surface(points: Array, triangles: NDArray[np.int64]) -> None:
    """Refuse a surface that is not closed or not consistently oriented."""
    if points.ndim != 2 or points.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise DataError(
            f"a hull needs (V, 3) vertices and (F, 3) faces, not {points.shape} and {triangles.shape}"
        )
    if len(triangles) < 4:
        raise DataError(f"a closed hull needs at least 4 faces, not {len(triangles)}")
    if not np.all(np.isfinite(points)):
        raise DataError(f"hull vertex {int(np.argmin(np.isfinite(points).all(axis=1))) + 1} is not finite")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise DataError(f"a hull face names vertex {int(triangles.max()) + 1} of {len(points)}")
    # Coincident vertices are one point, even if a file repeats them.
    _, welded = np.unique(points, axis=0, return_inverse=True)
    corners = welded.reshape(-1)[triangles]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    directed, count = np.unique(edges, axis=0, return_counts=True)
    unpaired = len(set(map(tuple, directed.tolist())) ^ set(map(tuple, directed[:, ::-1].tolist()))) // 2
    if unpaired or count.max() > 1:
        doubled = int((count > 1).sum())
        raise DataError(
            f"the hull is not closed and consistently oriented: {unpaired} open edges, {doubled} twice the "
            "same way; fill the holes, or make all faces anticlockwise as seen from outside"
        )
