"""Conversion of latitude and longitude to metres north and east of a session's first fix."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array

EQUATOR, FLATTENING = 6_378_137.0, 1.0 / 298.257223563
"""Radius at the equator [m] and flattening of the ellipsoid WGS 84."""
NORTH, EAST = "north of the first fix", "east of the first fix"
"""Names of the columns derived from latitude and longitude [m]."""


def metres(latitude: Array, longitude: Array, first: tuple[float, float]) -> tuple[Array, Array]:
    """Return the distances north, (n,), and east, (m,), of latitudes and longitudes from a place [m].

    The curvature of WGS 84 at this place is used. Within a kilometre the relative error is below a thousandth
    between 80 degrees south and north.

    Args:
        latitude: Geodetic latitudes [deg], (n,).
        longitude: Longitudes [deg], (m,); jumps at 180 degrees are removed.
        first: Latitude and longitude of the place [deg].
    """
    sine = np.sin(np.radians(first[0]))
    square = FLATTENING * (2.0 - FLATTENING)
    across = EQUATOR / np.sqrt(1.0 - square * sine**2)
    along = across * (1.0 - square) / (1.0 - square * sine**2)
    turned = np.mod(longitude - first[1] + 180.0, 360.0) - 180.0
    north = along * np.radians(latitude - first[0])
    east = across * np.cos(np.radians(first[0])) * np.radians(turned)
    return np.asarray(north), np.asarray(east)
