"""Cubic spline through samples, the curve of `scipy.interpolate.CubicSpline` with its default ends.

That module also loads `scipy.optimize`, which takes a tenth of a second of every start of a command.

Source: C. de Boor, A Practical Guide to Splines, 2001, chapter IV ("not-a-knot" ends).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from hydro.core.columns import Array


def cubic_spline(x: Array, y: Array) -> Callable[[Array], Array]:
    """Return the cubic spline whose third derivative is continuous at the second sample and the last but one.

    Args:
        x: Places of n samples, at least four, increasing, (n,).
        y: Samples, (n, k).

    Returns:
        Function from places (m,) to values (m, k); outside of the samples the outermost cubics continue.
    """
    dx = np.diff(x)[:, None]
    secant = np.diff(y, axis=0) / dx
    first, last = x[2] - x[0], x[-1] - x[-3]
    banded, right = np.zeros((3, len(x))), np.empty_like(y, dtype=float)
    banded[0, 2:], banded[1, 1:-1], banded[2, :-2] = dx[:-1, 0], 2.0 * (dx[:-1, 0] + dx[1:, 0]), dx[1:, 0]
    banded[1, 0], banded[0, 1], banded[1, -1], banded[2, -2] = dx[1, 0], first, dx[-2, 0], last
    right[1:-1] = 3.0 * (dx[1:] * secant[:-1] + dx[:-1] * secant[1:])
    right[0] = ((dx[0] + 2.0 * first) * dx[1] * secant[0] + dx[0] ** 2 * secant[1]) / first
    right[-1] = (dx[-1] ** 2 * secant[-2] + (2.0 * last + dx[-1]) * dx[-2] * secant[-1]) / last
    slope = scipy.linalg.solve_banded((1, 1), banded, right, check_finite=False)
    bend = (slope[:-1] + slope[1:] - 2.0 * secant) / dx
    square, cube = (secant - slope[:-1]) / dx - bend, bend / dx

    def at(places: Array) -> Array:
        """Return the values of the spline at places (m,), (m, k)."""
        i = np.clip(np.searchsorted(x, places, side="right") - 1, 0, len(x) - 2)
        beyond = (places - x[i])[:, None]
        value: Array = ((cube[i] * beyond + square[i]) * beyond + slope[i]) * beyond + y[i]
        return value

    return at
