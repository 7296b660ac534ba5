"""Waves: water that swings about its place as an irregular, long-crested sea passes over it.

Nobody knows the phases of a sea beforehand.  So waves are no law that predicts a motion: their mean is none,
and wherever a recording is held against a vehicle file the water is as still as without them.  Where a motion
is made (a simulation, the teacher, MuJoCo), a sea of the stated spectrum is drawn from a seed.

A wave of frequency omega and elevation a cos(omega t) moves the water at depth z on circles (Airy; Newman
1977, section 6.2), toward where it travels and a quarter of a period later down,

    v = a omega exp(-k z) [cos(omega t) along, sin(omega t) down],  k = omega^2/g in deep water.

The hull is taken to be small beside the wavelength, and time to pass as the vehicle meets the waves: theirs
is the encounter frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

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
"""Harmonics of a sea that is drawn."""
COMPONENT = 6  # omega, k, amplitudes of cosine and sine along, north, east
COSINE, SINE = 2, 3
BAND = (0.5, 4.0)
"""Frequencies of a sea, times that of its peak: slower and faster waves hold less than 1 % of its energy."""
NARROW, WIDE = 0.07, 0.09  # of the peak of JONSWAP below and above its frequency
FINE = 4000  # frequencies over which a spectrum is integrated


def elevation_spectrum(omega: ArrayLike, height: float, period: float, peak: float) -> Array:
    """Spectrum of the elevation S(omega), one-sided, [m^2 s], of the energy (height/4)^2 over BAND.

    That of JONSWAP (Hasselmann et al. 1973) with the peak enhancement 1 + peak: of Pierson and Moskowitz,
    a sea that the wind has fully raised, for a peak of 0, and of swell for a large one.

    Args:
        omega: Frequencies [rad/s], above 0, any shape.
        height: Significant wave height [m].
        period: Of the peak [s].
        peak: Peak enhancement less 1.
    """
    top = 2.0 * math.pi / period
    energy = _energy(float(peak))
    x = np.asarray(omega, float) / top
    inside = (x >= BAND[0]) & (x <= BAND[1])
    return np.asarray(np.where(inside, _shape(x, peak) * (height / 4.0) ** 2 / (energy * top), 0.0))


@lru_cache(maxsize=64)
def _energy(peak: float) -> float:
    """Integral of the form of the spectrum over BAND."""
    edges = np.linspace(*BAND, FINE)
    return float(np.trapezoid(_shape(edges, peak), edges))


def _shape(x: Array, peak: float) -> Array:
    """Form of the spectrum at frequencies in that of the peak."""
    width = np.where(x <= 1.0, NARROW, WIDE)
    raised = np.log1p(peak) * np.exp(-0.5 * ((x - 1.0) / width) ** 2)
    return np.asarray(x**-5.0 * np.exp(-1.25 * x**-4.0 + raised))


def harmonics(p: Array, gravity: float, places: Array) -> Array:
    """Harmonics of a sea, one for each of H bands of equal ratio of its frequencies, (H, COMPONENT).

    Both amplitudes are the standard deviation that the energy of the band gives them.

    Args:
        p: Parameters of the effect.
        gravity: [m/s^2].
        places: Where in its band each lies, as a share of the band's logarithm, (H,), in [0, 1].
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
    """A sea of COMPONENTS harmonics of random frequency and Gaussian amplitudes, (COMPONENTS, COMPONENT).

    So waves come in groups as at sea (Tucker, Challenor and Carter 1984), and repeat at no time.

    Args:
        rows: Harmonics at some places of their bands.
        rng: What draws it.
    """
    sea = rows(rng.random(COMPONENTS))
    sea[:, 2:4] *= rng.standard_normal((COMPONENTS, 2))
    return sea


def calm(p: Array, flow: Array) -> None:
    """Nothing: the water's mean motion in waves."""


@kernel
def orbits(sea: Array, s: Array) -> tuple[float, float, float]:
    """Velocity of the water [m/s], NED, at the depth and time in `s`; its growths are written there.

    WATER_RATE is the rate at a place that is fixed, WATER_GROWTH the growth with depth.
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
    """Wrench M_A [R^T v_w_dot; 0] and rho V R^T a_w at the centre of buoyancy, of water that swings.

    v_w is the water's velocity in a sea drawn from a spectrum of JONSWAP, v_w_dot its rate as the vehicle
    meets it and a_w as the water itself does, rising and sinking, and rho V = B/g.  The added mass feels the
    one and, by the water's pressure, the hull the other (Morison et al. 1950), so that a neutral vehicle that
    moves with the water stays with it; drag goes with nu_r.  In every prediction the sea is calm and this is
    nothing.  Left out is how the water's motion changes along the wave: over the hull, and in what pressure
    of second order there is.
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
    own = sinking - through  # of the water
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
    """State height, period and direction of the waves."""
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
        return changed("the sea", entries)
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
