"""Smoothing of evenly spaced samples by local polynomials (Savitzky and Golay, 1964).

The functions equal `savgol_filter` and `savgol_coeffs` of `scipy.signal`.  That module is not used because it
loads all of `scipy.stats`, which takes a second of every start of a command.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from hydro.core.columns import Array


def savitzky_golay_weights(width: int, degree: int, *, deriv: int = 0, dt: float = 1.0) -> Array:
    """Return the weights of neighbouring samples in a smoothed sample, or in its derivative.

    A polynomial is fitted to `width` samples by least squares and evaluated at the middle sample.

    Args:
        width: Number of samples of a polynomial, odd and greater than `degree`.
        degree: Degree of the polynomial.
        deriv: Order of the derivative to compute; 0 for the value.
        dt: Time between samples [s].

    Returns:
        The weights [1/s^deriv], (width,), in the order of `numpy.convolve`: the last sample's weight first.
    """
    half = width // 2
    powers = np.arange(half, -half - 1, -1.0) ** np.arange(degree + 1.0)[:, None]
    wanted = np.zeros(degree + 1)
    wanted[deriv] = math.factorial(deriv) / dt**deriv
    return np.asarray(np.linalg.lstsq(powers, wanted, rcond=None)[0])


def savitzky_golay(values: Array, width: int, degree: int, *, deriv: int = 0, dt: float = 1.0) -> Array:
    """Return smoothed samples or derivatives, from a polynomial fitted about each sample.

    The first and last samples are those of the polynomials through the first and last `width` samples.

    Args:
        values: Samples of one or K channels, (N,) or (N, K) with N >= `width`.
        width: Number of samples of a polynomial, odd and greater than `degree`.
        degree: Degree of the polynomials.
        deriv: Order of the derivative to compute; 0 for the value.
        dt: Time between samples [s].

    Returns:
        The smoothed samples, or their derivatives per s^`deriv`, in the shape of `values`.
    """
    out = scipy.ndimage.convolve1d(
        values, savitzky_golay_weights(width, degree, deriv=deriv, dt=dt), axis=0, mode="constant"
    )
    half = width // 2
    out[:half] = _at_samples(values[:width], degree, deriv)[:half] / dt**deriv
    out[-half:] = _at_samples(values[-width:], degree, deriv)[-half:] / dt**deriv
    return np.asarray(out)


def _at_samples(values: Array, degree: int, deriv: int) -> Array:
    """Return the derivative of the polynomial through samples (N,) or (N, K), at each of them, per sample."""
    alone = [1] * (values.ndim - 1)
    clock = np.arange(float(len(values)))
    fitted = np.polyfit(clock, values, degree)
    for _ in range(deriv):
        fitted = fitted[:-1] * np.arange(len(fitted) - 1.0, 0.0, -1.0).reshape(-1, *alone)
    return np.asarray(np.polyval(fitted, clock.reshape(-1, *alone)))
