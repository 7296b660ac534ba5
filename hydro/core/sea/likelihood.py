"""How likely a sea is: the Fourier coefficients of the water's motion, and Whittle's likelihood of them.

The spectra of north, east and down and what they share,

    S(omega) = S_v(omega) d d^H + diag(continuum),   d = (cos direction, sin direction, -i),

S_v that of JONSWAP at the recording's depths, are held against the coefficients by Whittle's likelihood
(Whittle 1953; Brillinger 1981, section 7.3).  A minute parts no frequencies nearer than a tenth of that of a
swell, whose peak is narrower: the coefficients are held against what the spectrum makes of them under their
taper, not against the spectrum itself (Sykulski et al. 2019).  The likelihood comes with its gradient: a
continuum and a band that take each other's place are a long valley, in which differences go astray.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy import sparse

from hydro.core.columns import Array, Rows
from hydro.core.effects.waves import elevation_spectrum
from hydro.core.recording.arrays import Recording

PERIODS = (1.5, 20.0)
"""Of the waves that are looked for [s]."""
FASTEST = 1.6  # frequency that is looked at, over that of the fastest waves
SLOWEST = 3  # Fourier frequency of a segment that is looked at first: drifts are below
EVERY = 2  # Fourier frequencies under Hann's taper that are nearly independent
FINER, ASIDE = 4, 4  # places between two Fourier frequencies, and such frequencies to each side, of a taper
LEAST_FREQUENCIES = 24
DEPTHS = 500  # of a segment at most, and frequencies, at which what they leave of a wave is worked out
AXES, DEGREE = 3, 3  # of a continuum's logarithm in that of frequency
RAISED = (0.8, 0.8)
"""Logarithm of the peak enhancement of seas, and its standard deviation (Hasselmann et al. 1973)."""
UNEVEN = 4.0
"""Standard deviation of what each polynomial but the constant makes of a continuum's logarithm."""
LEAST_NOISE = 1e-5  # of the mean square of all coefficients: no continuum is below it
GREATEST = 50.0  # logarithm of a continuum
STEP = 1e-3  # of a parameter, for the slopes of the spectra


@dataclass(frozen=True)
class Coefficients:
    """Fourier coefficients of the water's velocity under Hann's taper.

    Attributes:
        omega: Their frequencies [rad/s], (F,).
        y: North, east, down; of unit expected square where the one-sided spectrum is 1, (F, 3).
        fine: Frequencies between them [rad/s], (G,).
        response: Expected square of each coefficient for a unit of the elevation's spectrum at each of
            these, (F, G): by the taper, the depth and omega^2 for the velocity.
        longest: Of the segments [s].
        slowest: Least frequency that is looked at [rad/s].
    """

    omega: Array
    y: Any
    fine: Array
    response: Any
    longest: float
    slowest: float

    @cached_property
    def squares(self) -> Array:
        """Squared size of each, (F, 3)."""
        return np.asarray(np.abs(self.y) ** 2)

    @cached_property
    def powers(self) -> Array:
        """Legendre polynomials of the logarithm of frequency between those looked at, (F, DEGREE + 1)."""
        low, high = math.log(self.slowest), math.log(FASTEST * 2.0 * math.pi / PERIODS[0])
        return np.asarray(legvander((2.0 * np.log(self.omega) - low - high) / (high - low), DEGREE))

    def within(self, low: float, high: float) -> Coefficients:
        """Those between two frequencies [rad/s]."""
        kept = (self.omega >= low) & (self.omega <= high)
        return replace(self, omega=self.omega[kept], y=self.y[kept], response=self.response[kept])


def coefficients(water: Array, record: Recording, gravity: float) -> Coefficients | None:
    """Fourier coefficients of the water's motion; None of too short a recording."""
    parts = list[tuple[Array, Any, Array, Any]]()
    longest = 0.0
    for begin, end in record.segments:
        seconds, rows = (end - begin) * record.dt, end - begin
        numbers = np.arange(SLOWEST, rows // 2, EVERY)
        numbers = numbers[numbers <= FASTEST * seconds / PERIODS[0]]
        if numbers.size < LEAST_FREQUENCIES // 2:
            continue
        longest = max(longest, seconds)
        taper = np.hanning(rows)
        y = water[begin:end] - water[begin:end].mean(axis=0)
        spectrum = np.fft.rfft(y * taper[:, None], axis=0)[numbers]
        spectrum *= math.sqrt(record.dt / (math.pi * (taper @ taper)))
        fine = np.arange(1, FINER * (numbers[-1] + ASIDE) + 1) * 2.0 * math.pi / (FINER * seconds)
        depths = np.maximum(record.eta[begin:end, 2], 0.0)
        decay = _left_by_depth(fine, depths, taper, gravity)
        response = _through(taper, numbers, len(fine)) @ sparse.diags(fine**2 * decay)
        parts.append((2.0 * math.pi * numbers / seconds, spectrum, fine, response))
    if sum(len(omega) for omega, *_ in parts) < LEAST_FREQUENCIES:
        return None
    omegas, spectra, fines, responses = zip(*parts, strict=True)
    return Coefficients(
        np.concatenate(omegas),
        np.concatenate(spectra),
        np.concatenate(fines),
        sparse.block_diag(responses, format="csr"),
        longest,
        min(float(omega[0]) for omega in omegas),
    )


def _left_by_depth(omega: Array, depths: Array, taper: Array, gravity: float) -> Array:
    """What the depths (N,) of a segment leave of a wave's power at some frequencies (G,), (G,).

    It falls off evenly: a few frequencies and depths tell of all.
    """
    every = max(len(depths) // DEPTHS, 1)
    depth, weight = depths[::every], taper[::every] ** 2
    few = np.linspace(omega[0], omega[-1], DEPTHS)
    decay = np.exp(-2.0 * np.outer(few**2 / gravity, depth)) @ weight / weight.sum()
    return np.asarray(np.interp(omega, few, decay))


def _through(taper: Array, numbers: Rows, count: int) -> Any:
    """What Fourier coefficients of some numbers (F,) take of `count` frequencies between them, (F, count)."""
    aside = np.arange(-FINER * ASIDE, FINER * ASIDE + 1)
    turns = np.exp(-2j * np.pi * np.outer(aside, np.arange(taper.size)) / (FINER * taper.size))
    share = np.abs(turns @ taper) ** 2
    share /= share.sum()
    rows, columns = np.broadcast_arrays(
        np.arange(numbers.size)[:, None], FINER * numbers[:, None] + aside - 1
    )
    there = columns >= 0
    values = np.broadcast_to(share, columns.shape)[there]
    return sparse.csr_array((values, (rows[there], columns[there])), shape=(numbers.size, count))


def unlikely(
    seen: Coefficients, floor: Array, sea: Array | None = None, apart: Array | None = None
) -> tuple[float, Array]:
    """Negative log likelihood of the coefficients, and its gradient.

    Args:
        seen: They.
        floor: Of the continua, (3 (DEGREE + 1),).
        sea: Logarithms of height and frequency of the peak, direction, logarithm of the enhancement; or None.
        apart: Of a band without orbits: logarithms of the height in each axis, of frequency and enhancement.
    """
    f, growth = _continuum(seen, floor)
    if apart is not None:
        total, by_f, own = _apart(seen, f, apart)
    elif sea is not None:
        total, by_f, own = _in_orbit(seen, f, sea)
    else:
        (total, by_f), own = _alone(seen, f), np.zeros(0)
    uneven = floor.reshape(AXES, -1) / UNEVEN
    uneven[:, 0] = 0.0
    total += 0.5 * float((uneven**2).sum())
    by_floor = (by_f * growth).T @ seen.powers + uneven / UNEVEN
    if own.size:
        away = ((sea if sea is not None else np.asarray(apart))[-1] - RAISED[0]) / RAISED[1]
        total += 0.5 * away**2
        own[-1] += away / RAISED[1]
    return total, np.concatenate([by_floor.ravel(), own])


def _alone(seen: Coefficients, f: Array) -> tuple[float, Array]:
    """Negative log likelihood of spectra (F, 3) that have nothing in common, and its slope in each."""
    relative = seen.squares / f
    return float((np.log(f) + relative).sum()), np.asarray((1.0 - relative) / f)


def _apart(seen: Coefficients, f: Array, apart: Array) -> tuple[float, Array, Array]:
    """The same of continua (F, 3) and a band without orbits, and its slopes in the band's parameters."""
    band, slopes = _band(seen, 0.0, apart[AXES], apart[AXES + 1])
    squares = np.exp(2.0 * apart[:AXES])
    total, by_f = _alone(seen, f + band[:, None] * squares)
    there = by_f * squares
    return total, by_f, np.concatenate([2.0 * (band @ there), slopes[1:] @ there.sum(axis=1)])


def _in_orbit(seen: Coefficients, f: Array, sea: Array) -> tuple[float, Array, Array]:
    """The same of continua and a sea: determinant and inverse of diag(f) + g d d^H, a change of rank 1."""
    total, by_f = _alone(seen, f)
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
    """North, east and down of a wave's orbit toward a direction, (3,)."""
    return np.array([math.cos(way), math.sin(way), -1j])


def _continuum(seen: Coefficients, floor: Array) -> tuple[Array, Array]:
    """Continua of north, east and down, and what of them grows with their logarithms, (F, 3) each."""
    grown = np.exp(np.minimum(seen.powers @ floor.reshape(AXES, -1).T, GREATEST))
    return np.asarray(grown + LEAST_NOISE * seen.squares.mean()), np.asarray(grown)


def _band(seen: Coefficients, height: float, top: float, raised: float) -> tuple[Array, Array]:
    """`_velocity_spectrum` of a logarithm of the height, and its slopes in all three logarithms, (3, F)."""

    def spectrum(top: float, raised: float) -> Array:
        return _velocity_spectrum(seen, math.exp(height), top, raised)

    g = spectrum(top, raised)
    faster = spectrum(top + STEP, raised) - spectrum(top - STEP, raised)
    sharper = spectrum(top, raised + STEP) - spectrum(top, raised - STEP)
    return g, np.stack([2.0 * g, faster / (2.0 * STEP), sharper / (2.0 * STEP)])


def _velocity_spectrum(seen: Coefficients, height: float, top: float, raised: float) -> Array:
    """Expected square of the coefficients along the waves at the depths of the recording, (F,)."""
    elevation = elevation_spectrum(seen.fine, height, 2.0 * math.pi / math.exp(top), math.expm1(raised))
    return np.asarray(seen.response @ elevation)


def spectra(seen: Coefficients, at: Array) -> Array:
    """Spectral matrices of continua and sea, (F, 3, 3)."""
    floor, sea = at[:-4], at[-4:]
    d = _orbit(sea[2])
    g = _velocity_spectrum(seen, math.exp(sea[0]), sea[1], sea[3])
    diagonal = np.eye(AXES) * _continuum(seen, floor)[0][:, None, :]
    return np.asarray(g[:, None, None] * np.outer(d, d.conj()) + diagonal)
