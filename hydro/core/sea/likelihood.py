"""Whittle likelihood of a sea, given the Fourier coefficients of the water's motion.

The spectral matrix of the north, east and down velocity has this model:

    S(omega) = S_v(omega) d d^H + diag(continuum),   d = (cos direction, sin direction, -i).

S_v is the JONSWAP velocity spectrum of the waves at the recorded depths.  The continuum is a smooth spectrum
for each axis; its log is a polynomial in the log of frequency.  A "band" is a JONSWAP peak without the
orbital phase between the axes: the rival of a sea.

The likelihood of the coefficients is Whittle's (Whittle 1953; Brillinger 1981, section 7.3).  A minute of
data resolves frequencies no closer than a tenth of that of a swell, and the peak of a swell is narrower.  So
the coefficients are compared with their expected squares under the taper, not with the spectrum itself
(Sykulski et al. 2019).  The gradient is analytic: a continuum and a band can replace each other along a
narrow valley, in which finite differences fail.

The order of the parameters is: the polynomial coefficients of the three log continua, then log height, log
peak frequency, direction and log of the peak enhancement of the sea.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.polynomial.legendre import legvander

from hydro.core.columns import Array, Rows
from hydro.core.effects.waves import elevation_spectrum
from hydro.core.recording.arrays import Recording

PERIODS = (1.5, 20.0)
"""Shortest and longest period of the waves that are tested [s]."""
FASTEST = 1.6  # highest frequency of the coefficients, relative to that of the fastest waves
SLOWEST = 3  # number of the lowest Fourier frequency of a segment: slower motion is drift
STRIDE = 2  # step in Fourier frequencies: under Hann's taper, every other one is nearly independent
FINER, NEIGHBOURS = 4, 4
"""Frequencies per Fourier frequency, and Fourier frequencies on each side, in the response of the taper."""
LEAST_FREQUENCIES = 24
"""Minimum number of Fourier coefficients of a recording."""
DEPTHS = 500
"""Maximum number of depths of a segment, and number of frequencies, at which the wave decay is computed."""
AXES, DEGREE = 3, 3
"""Number of axes; degree of the polynomial that gives the log of a continuum from the log of frequency."""
PEAK_PRIOR = (0.8, 0.8)
"""Prior mean and standard deviation of the log of the peak enhancement (Hasselmann et al. 1973)."""
SHAPE_PRIOR = 4.0
"""Prior standard deviation of each polynomial coefficient of a log continuum except the constant."""
LEAST_CONTINUUM = 1e-5  # lower bound of a continuum, relative to the mean square of all coefficients
MAX_LOG_CONTINUUM = 50.0  # upper bound of a log continuum, which prevents overflow
STEP = 1e-3  # step of a parameter for the numerical derivatives of the spectra


@dataclass(frozen=True)
class Coefficients:
    """Fourier coefficients of the water's velocity under a Hann taper.

    F is the number of coefficients, G that of frequencies on a finer grid.

    Attributes:
        omega: Frequencies of the coefficients [rad/s], (F,).
        y: Complex coefficients of the north, east and down velocity, (F, 3), scaled so that their expected
            square is 1 where the one-sided spectrum is 1.
        fine: Frequencies on the finer grid [rad/s], (G,).
        response: Expected square of each coefficient for a unit of the elevation spectrum at each fine
            frequency, sparse (F, G).  It contains the taper, the decay with depth, and the factor omega^2
            from elevation to velocity.
        longest: Duration of the longest segment of the recording [s].
        slowest: Lowest frequency [rad/s].
    """

    omega: Array
    y: Any
    fine: Array
    response: Any
    longest: float
    slowest: float

    @cached_property
    def squares(self) -> Array:
        """Squared magnitude of each coefficient, (F, 3)."""
        return np.asarray(np.abs(self.y) ** 2)

    @cached_property
    def powers(self) -> Array:
        """Legendre polynomials of degree 0 to DEGREE at each coefficient's log frequency, (F, DEGREE + 1).

        The tested range of log frequencies is scaled to [-1, 1].
        """
        low, high = math.log(self.slowest), math.log(FASTEST * 2.0 * math.pi / PERIODS[0])
        return np.asarray(legvander((2.0 * np.log(self.omega) - low - high) / (high - low), DEGREE))

    def within(self, low: float, high: float) -> Coefficients:
        """Return a copy with only the coefficients whose frequencies are within limits.

        Args:
            low: Lowest frequency [rad/s].
            high: Highest frequency [rad/s].
        """
        kept = (self.omega >= low) & (self.omega <= high)
        return replace(self, omega=self.omega[kept], y=self.y[kept], response=self.response[kept])


def coefficients(water: Array, record: Recording, gravity: float) -> Coefficients | None:
    """Return the Fourier coefficients of the water's motion.

    Args:
        water: Velocity of the water, north, east and down, (N, 3) [m/s].
        record: Recording of N rows, for its segments and depths.
        gravity: Acceleration of gravity [m/s^2].

    Returns:
        The coefficients of all segments; None if the recording is too short.
    """
    parts = list[tuple[Array, Any, Array, Any]]()
    longest = 0.0
    for begin, end in record.segments:
        seconds, rows = (end - begin) * record.dt, end - begin
        numbers = np.arange(SLOWEST, rows // 2, STRIDE)
        numbers = numbers[numbers <= FASTEST * seconds / PERIODS[0]]
        if numbers.size < LEAST_FREQUENCIES // 2:
            continue
        longest = max(longest, seconds)
        taper = np.hanning(rows)
        y = water[begin:end] - water[begin:end].mean(axis=0)
        spectrum = np.fft.rfft(y * taper[:, None], axis=0)[numbers]
        spectrum *= math.sqrt(record.dt / (math.pi * (taper @ taper)))
        fine = np.arange(1, FINER * (numbers[-1] + NEIGHBOURS) + 1) * 2.0 * math.pi / (FINER * seconds)
        depths = np.maximum(record.eta[begin:end, 2], 0.0)
        decay = _depth_decay(fine, depths, taper, gravity)
        response = _taper_response(taper, numbers, len(fine)) @ scipy.sparse.diags(fine**2 * decay)
        parts.append((2.0 * math.pi * numbers / seconds, spectrum, fine, response))
    if sum(len(omega) for omega, *_ in parts) < LEAST_FREQUENCIES:
        return None
    omegas, spectra, fines, responses = zip(*parts, strict=True)
    return Coefficients(
        np.concatenate(omegas),
        np.concatenate(spectra),
        np.concatenate(fines),
        scipy.sparse.block_diag(responses, format="csr"),
        longest,
        min(float(omega[0]) for omega in omegas),
    )


def _depth_decay(omega: Array, depths: Array, taper: Array, gravity: float) -> Array:
    """Return the decay of wave power at frequencies (G,) [rad/s], averaged over the depths (N,) [m], (G,).

    The decay is smooth, so it is computed at a few depths and frequencies and interpolated.
    """
    every = max(len(depths) // DEPTHS, 1)
    depth, weight = depths[::every], taper[::every] ** 2
    few = np.linspace(omega[0], omega[-1], DEPTHS)
    decay = np.exp(-2.0 * np.outer(few**2 / gravity, depth)) @ weight / weight.sum()
    return np.asarray(np.interp(omega, few, decay))


def _taper_response(taper: Array, numbers: Rows, count: int) -> Any:
    """Return the response of Fourier coefficients (F,) to `count` finer frequencies, sparse (F, count)."""
    aside = np.arange(-FINER * NEIGHBOURS, FINER * NEIGHBOURS + 1)
    turns = np.exp(-2j * np.pi * np.outer(aside, np.arange(taper.size)) / (FINER * taper.size))
    share = np.abs(turns @ taper) ** 2
    share /= share.sum()
    rows, columns = np.broadcast_arrays(
        np.arange(numbers.size)[:, None], FINER * numbers[:, None] + aside - 1
    )
    there = columns >= 0
    values = np.broadcast_to(share, columns.shape)[there]
    return scipy.sparse.csr_array((values, (rows[there], columns[there])), shape=(numbers.size, count))


def unlikely(
    seen: Coefficients, floor: Array, sea: Array | None = None, apart: Array | None = None
) -> tuple[float, Array]:
    """Return the negative log posterior of a spectral model, up to a constant, and its gradient.

    The model has three continua, smooth spectra of north, east and down velocity.  It may also have a sea, or
    else a band: a peak without the orbital phase between the axes.

    Args:
        seen: Fourier coefficients of the recording.
        floor: Polynomial coefficients of the three log continua, (3 (DEGREE + 1),).
        sea: Log height, log peak frequency, direction [rad] and log of the peak enhancement, (4,); None for
            no sea.
        apart: Band: log height of each axis, log peak frequency, log of the peak enhancement, (5,); None for
            no band.

    Returns:
        The value, and a vector of its derivatives by `floor` and then by `sea` or `apart`.
    """
    f, growth = _continuum(seen, floor)
    if apart is not None:
        total, by_f, own = _independent_band(seen, f, apart)
    elif sea is not None:
        total, by_f, own = _sea(seen, f, sea)
    else:
        (total, by_f), own = _independent(seen, f), np.zeros(0)
    uneven = floor.reshape(AXES, -1) / SHAPE_PRIOR
    uneven[:, 0] = 0.0
    total += 0.5 * float((uneven**2).sum())
    by_floor = (by_f * growth).T @ seen.powers + uneven / SHAPE_PRIOR
    if own.size:
        away = ((sea if sea is not None else np.asarray(apart))[-1] - PEAK_PRIOR[0]) / PEAK_PRIOR[1]
        total += 0.5 * away**2
        own[-1] += away / PEAK_PRIOR[1]
    return total, np.concatenate([by_floor.ravel(), own])


def _independent(seen: Coefficients, f: Array) -> tuple[float, Array]:
    """Return the negative log likelihood of independent axes with spectra f (F, 3); its derivatives by f."""
    relative = seen.squares / f
    return float((np.log(f) + relative).sum()), np.asarray((1.0 - relative) / f)


def _independent_band(seen: Coefficients, f: Array, apart: Array) -> tuple[float, Array, Array]:
    """Return the negative log likelihood of continua f and a band; its derivatives by f and by `apart`."""
    band, slopes = _band(seen, 0.0, apart[AXES], apart[AXES + 1])
    squares = np.exp(2.0 * apart[:AXES])
    total, by_f = _independent(seen, f + band[:, None] * squares)
    there = by_f * squares
    return total, by_f, np.concatenate([2.0 * (band @ there), slopes[1:] @ there.sum(axis=1)])


def _sea(seen: Coefficients, f: Array, sea: Array) -> tuple[float, Array, Array]:
    """Return the negative log likelihood of continua f and a sea; its derivatives by f and by `sea`.

    diag(f) + g d d^H is a rank-one update, whose determinant and inverse are closed forms.
    """
    total, by_f = _independent(seen, f)
    g, slopes = _band(seen, sea[0], sea[1], sea[3])
    d, turned = _orbit(sea[2]), np.array([-math.sin(sea[2]), math.cos(sea[2]), 0.0])
    h = (np.abs(d) ** 2 / f).sum(axis=1)
    along = (np.conj(d) * seen.y / f).sum(axis=1)
    square, share = np.abs(along) ** 2, g / (1.0 + g * h)
    total += float((np.log1p(g * h) - share * square).sum())
    by_h, by_along = share + share**2 * square, -2.0 * share[:, None] * np.conj(along)[:, None]
    by_f -= (by_along * np.conj(d) * seen.y / f**2).real + by_h[:, None] * np.abs(d) ** 2 / f**2
    by_g = h / (1.0 + g * h) - square / (1.0 + g * h) ** 2
    by_way = (by_along * turned * seen.y / f).real.sum() + by_h @ (2.0 * turned * d / f).real.sum(axis=1)
    return total, by_f, np.array([by_g @ slopes[0], by_g @ slopes[1], by_way, by_g @ slopes[2]])


def _orbit(way: float) -> Any:
    """Return the orbit (north, east, down) of a wave that travels in direction `way` [rad], complex (3,)."""
    return np.array([math.cos(way), math.sin(way), -1j])


def _continuum(seen: Coefficients, floor: Array) -> tuple[Array, Array]:
    """Return the continua of north, east and down, and their derivatives by their logs, (F, 3) each."""
    grown = np.exp(np.minimum(seen.powers @ floor.reshape(AXES, -1).T, MAX_LOG_CONTINUUM))
    return np.asarray(grown + LEAST_CONTINUUM * seen.squares.mean()), np.asarray(grown)


def _band(seen: Coefficients, height: float, top: float, raised: float) -> tuple[Array, Array]:
    """Return `_velocity_spectrum` for a log height, (F,), and its derivatives by the arguments, (3, F)."""

    def spectrum(top: float, raised: float) -> Array:
        return _velocity_spectrum(seen, math.exp(height), top, raised)

    g = spectrum(top, raised)
    faster = spectrum(top + STEP, raised) - spectrum(top - STEP, raised)
    sharper = spectrum(top, raised + STEP) - spectrum(top, raised - STEP)
    return g, np.stack([2.0 * g, faster / (2.0 * STEP), sharper / (2.0 * STEP)])


def _velocity_spectrum(seen: Coefficients, height: float, top: float, raised: float) -> Array:
    """Return the expected squares of the coefficients along the direction of the waves, (F,).

    Args:
        seen: Fourier coefficients of the recording.
        height: Significant wave height [m].
        top: Log of the peak frequency [rad/s].
        raised: log of the peak enhancement.
    """
    elevation = elevation_spectrum(seen.fine, height, 2.0 * math.pi / math.exp(top), math.expm1(raised))
    return np.asarray(seen.response @ elevation)


def spectra(seen: Coefficients, at: Array) -> Array:
    """Return the expected spectral matrix of the water's velocity at each of F frequencies, (F, 3, 3).

    It is the sum of waves and continua; rows and columns are the north, east and down velocity.

    Args:
        seen: Fourier coefficients of the recording.
        at: Parameters, (3 (DEGREE + 1) + 4,): polynomial coefficients of the three log continua, then log
            height, log peak frequency, direction and log of the peak enhancement of the sea.
    """
    floor, sea = at[:-4], at[-4:]
    d = _orbit(sea[2])
    g = _velocity_spectrum(seen, math.exp(sea[0]), sea[1], sea[3])
    diagonal = np.eye(AXES) * _continuum(seen, floor)[0][:, None, :]
    return np.asarray(g[:, None, None] * np.outer(d, d.conj()) + diagonal)
