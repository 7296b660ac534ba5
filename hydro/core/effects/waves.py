"""Waves: orbital motion of the water under an irregular, long-crested sea.

The phases of a sea are unknown in advance.  So waves do not predict a motion: their mean is zero, and the
water is calm in every comparison of a recording with a vehicle file.  In a generated motion (a simulation,
the reference simulator, MuJoCo), a sea of the stated spectrum is drawn from a seed.

A wave of frequency omega and elevation a cos(omega t) moves the water at depth z on circles (Airy; Newman
1977, section 6.2), in its direction of travel and, a quarter of a period later, downward:

    v = a omega exp(-k z) [cos(omega t) along, sin(omega t) down],  k = omega^2/g in deep water.

The hull is assumed small relative to the wavelength.  Time is that of the vehicle's encounter with the waves,
so the frequency is the encounter frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.case import Case
from hydro.core.effects.currents import quickened
from hydro.core.effects.layout import (
    BUOYANCY,
    CENTER_OF_BUOYANCY,
    GRAVITY,
    POSITION,
    RELATIVE_VELOCITY,
    ROTATION,
    TIME,
    VELOCITY,
    WATER_GROWTH,
    WATER_RATE,
)
from hydro.core.effects.phrases import Entry, changed, undetermined
from hydro.core.effects.record import Effect, Parameter
from hydro.core.effects.restoring import push_at
from hydro.core.effects.wording import compass
from hydro.core.vehicle.plausible import between

HEIGHT, PERIOD, DIRECTION, PEAK = range(4)
COMPONENTS = 96
"""Number of harmonics of a random sea."""
COMPONENT = 6  # omega, k, amplitudes of cosine and sine along, north, east
COSINE, SINE = 2, 3
BAND = (0.5, 4.0)
"""Frequency range of a sea relative to its peak: other waves have less than 1 % of its energy."""
NARROW, WIDE = 0.07, 0.09  # width of the JONSWAP peak below and above its frequency
FINE = 4000  # number of frequencies in the integral of a spectrum


def elevation_spectrum(omega: ArrayLike, height: float, period: float, peak: float) -> Array:
    """Return the one-sided spectrum of the sea surface elevation, S(omega) [m^2 s], in the shape of `omega`.

    It is the JONSWAP spectrum (Hasselmann et al. 1973) with the peak enhancement 1 + peak.  Its integral over
    the frequencies of BAND is (height/4)^2.  A peak of 0 gives a fully developed sea (Pierson and Moskowitz),
    a large peak gives swell.

    Args:
        omega: Frequencies [rad/s], above 0, any shape.
        height: Significant wave height [m].
        period: Period of the peak [s].
        peak: Peak enhancement minus 1.
    """
    top = 2.0 * math.pi / period
    energy = _energy(float(peak))
    x = np.asarray(omega, float) / top
    inside, found = (x >= BAND[0]) & (x <= BAND[1]), np.zeros(x.shape)
    found[inside] = _shape(x[inside], peak) * (height / 4.0) ** 2 / (energy * top)
    return found


@lru_cache(maxsize=64)
def _energy(peak: float) -> float:
    """Return the integral of the spectrum's form over BAND."""
    edges, parts = _fine()
    return float(np.trapezoid(_formed(parts, peak), edges))


@cache
def _fine() -> tuple[Array, tuple[Array, Array, Array]]:
    """Return FINE frequencies in BAND, and the parts of the form there."""
    edges = np.linspace(*BAND, FINE)
    return edges, _parts(edges)


def _shape(x: Array, peak: float) -> Array:
    """Return the form of the spectrum at frequencies relative to the peak."""
    return _formed(_parts(x), peak)


def _parts(x: Array) -> tuple[Array, Array, Array]:
    """Return what does not depend on the peak's height: the power, the decay, and the form of the peak."""
    width = np.where(x <= 1.0, NARROW, WIDE)
    return x**-5.0, -1.25 * x**-4.0, np.exp(-0.5 * ((x - 1.0) / width) ** 2)


def _formed(parts: tuple[Array, Array, Array], peak: float) -> Array:
    """Return the form of the spectrum from its parts (`_parts`)."""
    power, decay, around = parts
    return np.asarray(power * np.exp(decay + np.log1p(peak) * around))


def harmonics(p: Array, gravity: float, places: Array) -> Array:
    """Return the harmonics of a sea, one for each of H frequency bands, (H, COMPONENT).

    Limits of the bands have a constant ratio.  A row has the frequency [rad/s], the wave number [1/m], the
    amplitudes of cosine and sine [m/s], and the direction as a unit vector north, east.  Both amplitudes are
    the standard deviation that the spectrum gives the band.

    Args:
        p: Parameters of the effect: height, period, direction and peak.
        gravity: Acceleration of gravity [m/s^2].
        places: Position of each harmonic within its band, from 0 to 1 on a logarithmic scale, (H,).
    """
    height, period, direction, peak = p
    x, edges = np.geomspace(*BAND, FINE), np.linspace(0.0, 1.0, len(places) + 1)
    shape = _shape(x, peak)
    below = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(x) * (shape[1:] + shape[:-1]))])
    energy = np.diff(np.interp(edges, np.linspace(0.0, 1.0, FINE), below / below[-1]))
    low, high = np.log(BAND)
    omega = np.exp(low + (high - low) * (edges[:-1] + places / len(places))) * 2.0 * math.pi / period
    amplitude = 0.25 * height * np.sqrt(energy) * omega
    way = np.full(len(omega), math.cos(direction)), np.full(len(omega), math.sin(direction))
    return np.stack([omega, omega**2 / gravity, amplitude, amplitude, *way], axis=1)


def drawn(rows: Callable[[Array], Array], rng: np.random.Generator) -> Array:
    """Return a random sea: harmonics of random frequency and Gaussian amplitudes, (COMPONENTS, COMPONENT).

    Waves then form groups as at sea (Tucker, Challenor and Carter 1984), and never repeat.

    Args:
        rows: Function from positions within the bands, in [0, 1], to harmonics, as `harmonics` returns.
        rng: Generator of random numbers.
    """
    sea = rows(rng.random(COMPONENTS))
    sea[:, 2:4] *= rng.standard_normal((COMPONENTS, 2))
    return sea


def calm(p: Array, flow: Array) -> None:
    """Leave `flow` unchanged: the mean motion of the water in waves is zero.

    The function stands in the record of the waves, which needs a `flow` function.
    """


@kernel
def orbits(sea: Array, s: Array) -> tuple[float, float, float]:
    """Return the velocity of the water in waves [m/s], north, east and down, at the vehicle's depth and time.

    Args:
        sea: Harmonics, row after row, as `harmonics` returns.
        s: State of motion, the layout of `core.effects.layout`.  The function writes the water's acceleration
            at a fixed place (WATER_RATE) and the velocity's gradient with depth (WATER_GROWTH) to it.
    """
    north = east = down = 0.0
    for i in range(6):
        s[WATER_RATE + i] = 0.0
    z, t = s[POSITION + 2], s[TIME]
    for at in range(0, sea.size, COMPONENT):
        omega, k = sea[at], sea[at + 1]
        decay, growth = (math.exp(-k * z), -k) if z > 0.0 else (1.0, 0.0)
        c, d = math.cos(omega * t), math.sin(omega * t)
        along = decay * (sea[at + 2] * c + sea[at + 3] * d)
        under = decay * (sea[at + 2] * d - sea[at + 3] * c)
        north += along * sea[at + 4]
        east += along * sea[at + 5]
        down += under
        s[WATER_RATE] -= omega * under * sea[at + 4]
        s[WATER_RATE + 1] -= omega * under * sea[at + 5]
        s[WATER_RATE + 2] += omega * along
        s[WATER_GROWTH] += growth * along * sea[at + 4]
        s[WATER_GROWTH + 1] += growth * along * sea[at + 5]
        s[WATER_GROWTH + 2] += growth * under
    return north, east, down


@kernel
def swung(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench M_A [R^T v_w_dot; 0] and rho V R^T a_w at the centre of buoyancy, of water in orbital motion.

    v_w is the water's velocity in a sea drawn from a JONSWAP spectrum.  v_w_dot is its rate at the moving
    vehicle, a_w its rate at a moving water particle, and rho V = B/g.  The added mass responds to the first,
    and the hull, by the water's pressure, to the second (Morison et al. 1950).  So a neutral vehicle that
    moves with the water stays with it; drag depends on nu_r.  In every prediction the sea is calm and this
    wrench is zero.  Changes of the water's motion along the wave are neglected: over the hull, and in
    second-order pressure.

    Adds to `tau`, the wrench on the vehicle about CO, (6,) [N, N m].  `p` are the effect's parameters, `c`
    constants of the vehicle, `s` its state of motion, `x` and `dx` internal states and their rates;
    arguments as in `layout`.
    """
    mass, at = c[BUOYANCY] / c[GRAVITY], CENTER_OF_BUOYANCY
    sinking = through = 0.0
    for i in range(3):
        sinking += s[ROTATION + 6 + i] * s[VELOCITY + i]
        through += s[ROTATION + 6 + i] * s[RELATIVE_VELOCITY + i]
    rate, growth = WATER_RATE, WATER_GROWTH
    quickened(
        s[rate] + sinking * s[growth],
        s[rate + 1] + sinking * s[growth + 1],
        s[rate + 2] + sinking * s[growth + 2],
        c,
        s,
        tau,
    )
    own = sinking - through  # rate of a water particle
    a, b, d = (
        s[rate] + own * s[growth],
        s[rate + 1] + own * s[growth + 1],
        s[rate + 2] + own * s[growth + 2],
    )
    fx = s[ROTATION] * a + s[ROTATION + 3] * b + s[ROTATION + 6] * d
    fy = s[ROTATION + 1] * a + s[ROTATION + 4] * b + s[ROTATION + 7] * d
    fz = s[ROTATION + 2] * a + s[ROTATION + 5] * b + s[ROTATION + 8] * d
    push_at(mass * fx, mass * fy, mass * fz, c[at], c[at + 1], c[at + 2], tau)


def waves_sentence(case: Case) -> str:
    """Return a sentence that states height, period and direction of the waves."""
    height, period, way = case.one("height"), case.one("period"), case.one("direction")
    if case.in_file:
        entries = [
            Entry("the significant wave height", "", height, "m"),
            Entry("the peak period", "", period, "s"),
        ]
        entries += [
            Entry("the direction of travel", "", way.times(180.0 / math.pi), "°"),
            Entry("the peak enhancement", "", case.one("peak"), "1"),
        ]
        return changed(case, "the sea", entries)
    if not height.clear:
        return undetermined(case, "the significant wave height", height.text("m"))
    heading = compass(math.cos(way.value), math.sin(way.value))
    sea = f"{height.text('m')} significant height and {period.text('s')} peak period"
    return f"Waves of {sea} travel toward {heading}."


WAVES = Effect(
    name="ocean_waves",
    repeatable=True,
    family="waves",
    kind="flow",
    definition="nu_r = nu - [R^T v_w; 0], and M_A [R^T v_w_dot; 0] + rho V R^T a_w, v_w drawn from JONSWAP",
    source="Hasselmann et al. (1973); Newman (1977), section 6.2; Morison et al. (1950)",
    excitation="minutes within a few wavelengths' depth, in which commands do not answer to the waves",
    lookalikes=("ocean_current", "tether", "surface_suction"),
    parameters=(
        Parameter(
            "height",
            ("m",),
            "significant wave height, four standard deviations of the elevation",
            low=0.0,
            required=True,
            scale=(0.3,),
            plausible=between(0.0, 15.0, "m", "the World Meteorological Organization's sea states"),
        ),
        Parameter(
            "period",
            ("s",),
            "period of the peak, as the vehicle meets the waves",
            low=0.5,
            required=True,
            scale=(1.0,),
            plausible=between(1.0, 25.0, "s", "from wind chop to long swell"),
        ),
        Parameter(
            "direction",
            ("rad",),
            "toward which they travel, from north through east",
            scale=(0.2,),
            plausible=between(-2.0 * math.pi, 2.0 * math.pi, "rad", "once round either way"),
        ),
        Parameter(
            "peak",
            ("1",),
            "peak enhancement of JONSWAP less 1: 0 of a sea fully raised, 2.3 on the mean, more of swell",
            low=0.0,
            scale=(1.0,),
            plausible=between(0.0, 20.0, "", "Hasselmann et al. (1973); swell is narrower"),
        ),
    ),
    flow=calm,
    kernel=swung,
    sentence=waves_sentence,
    harmonics=harmonics,
)

EFFECTS = (WAVES,)
