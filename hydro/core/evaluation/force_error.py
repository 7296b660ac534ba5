"""Force that a model lacks in a recording, and the part of this force that is due to noise alone.

The model's acceleration is integrated along the smoothed motion and subtracted from the measured velocity.
The difference changes only where the model's forces are wrong.  Its smoothed derivative times the mass matrix
M is the missing wrench.  So the smoother never blurs a force that the model has, such as a jump of thrust,
and a true model leaves noise alone.  Changes faster than FASTEST are nearly all noise in any log: they count
in the frequency bands only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import scipy

from hydro.core.columns import WRENCH, WRENCH_UNITS, Array
from hydro.core.effects.layout import MASS_MATRIX
from hydro.core.effects.program import constants_of
from hydro.core.evaluation.misfit import Misfit, counted
from hydro.core.evaluation.regimes import Family, Pieces
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.evaluation.weights import Weights
from hydro.core.prediction.candidate import Candidate, accelerations, true_velocity
from hydro.core.recording import smoothing
from hydro.core.recording.arrays import Recording
from hydro.core.recording.shots import CHANNELS

FASTEST = 2.0
"""Highest frequency of changes of force that count [Hz]."""
BANDS = (
    ("in motions slower than 10 s", 0.0, 0.1),
    ("in motions of 2 to 10 s", 0.1, 0.5),
    ("in motions of 0.5 to 2 s", 0.5, FASTEST),
    ("in motions faster than 0.5 s", FASTEST, np.inf),
)
"""Frequency bands [Hz], named by the period of the motion."""
SLOW_BAND = ("", 0.0, FASTEST)
"""Frequency band that counts in the force error: name (unused) and limits [Hz]."""


def force(
    model: Candidate,
    record: Recording,
    motion: Motion,
    pieces: Pieces,
    seed: int,
    weights: Weights | None = None,
) -> tuple[Misfit, Misfit, Family]:
    """Return the squared wrench that a model lacks in a recording, summed over pieces of time.

    Args:
        model: Compiled vehicle.
        record: Recording.
        motion: Smoothed motion of the recording.
        pieces: Pieces of time over which squares are summed.
        seed: Seed of the noise from which the error due to noise alone is computed.
        weights: Weights of the axes; by default from the model's inertia.

    Returns:
        Three objects.  Sums of squares of the wrench below the frequency FASTEST [N^2, N^2 m^2], for P
        pieces.
        The same for each of the frequency BANDS: P pieces of the first band, then P of the next.  The family
            of
        conditions that names the band of each of these pieces.
    """
    rng = np.random.default_rng(seed)
    found = missing_wrench(model, record, motion.eta, motion.nu, motion.velocity)
    # The smoothers are linear: smoothed noise is added to the smoothed recording.
    extra = drawn_between(rng.standard_normal((record.rows, CHANNELS)) * motion.sigma, record)
    pose = motion.eta + smoothing.smooth(extra[:, :6], record.segments, motion.pose)[:, :, 0]
    nu = motion.nu + smoothing.smooth(extra[:, 6:], record.segments, motion.velocity)[:, :, 0]
    noisy = replace(record, nu=record.nu + extra[:, 6:])
    floor = missing_wrench(model, noisy, pose, np.ascontiguousarray(nu), motion.velocity) - found
    rows = pieces.total(np.ones(record.rows))
    shown = None if record.seen is None else record.seen[:, 6:]
    whole = Misfit(
        "force",
        None,
        (*WRENCH, "all"),
        WRENCH_UNITS,
        (weights or Weights.of(model)).force,
        rows,
        pieces.total(counted(next(_bands(found, record, [SLOW_BAND])) ** 2, shown)),
        pieces.total(counted(next(_bands(floor, record, [SLOW_BAND])) ** 2, shown)),
        pieces.block,
        counts=None if shown is None else pieces.total(shown.astype(float)),
    )
    count = len(BANDS)
    banded = replace(
        whole,
        rows=np.tile(rows, count),
        squares=np.concatenate([pieces.total(counted(b**2, shown)) for b in _bands(found, record, BANDS)]),
        noise=np.concatenate([pieces.total(counted(b**2, shown)) for b in _bands(floor, record, BANDS)]),
        block=np.tile(pieces.block, count),
        counts=None if whole.counts is None else np.tile(whole.counts, (count, 1)),
    )
    code = np.repeat(np.arange(count), len(rows))
    return whole, banded, Family("frequency", tuple(words for words, _, _ in BANDS), code, doing=False)


def missing_wrench(
    model: Candidate, record: Recording, eta: Array, nu: Array, design: smoothing.Design
) -> Array:
    """Return the wrench on the vehicle about CO, body axes, that a model lacks, (N, 6) [N, N m].

    The wrench is M times the smoothed derivative of the measured minus the modelled velocity; M is the mass
    matrix with added mass.  The model accounts for thrusters, weight, buoyancy, effects and C(nu) nu of M.

    Args:
        model: Model.
        record: Recording of N rows.
        eta: Smoothed pose, (N, 6).
        nu: Smoothed velocity as logged, (N, 6).
        design: Smoother of the velocity difference.
    """
    known = accelerations(model, record, eta, true_velocity(model, record, nu))
    left = true_velocity(model, record, record.nu).copy()
    for start, stop in record.segments:
        within = known[start:stop]
        left[start + 1 : stop] -= np.cumsum(0.5 * record.dt * (within[1:] + within[:-1]), axis=0)
    missing = smoothing.smooth(left, record.segments, design)[:, :, 1]
    mass = constants_of(model.program.flat)[MASS_MATRIX : MASS_MATRIX + 36].reshape(6, 6)
    wrench: Array = missing @ mass.T
    return wrench


def _bands(wrench: Array, record: Recording, bands: Sequence[tuple[str, float, float]]) -> Iterator[Array]:
    """Yield the parts of a wrench (N, 6) in each frequency band, (N, 6).

    Segments are extended by their mirror images, so that their ends cause no jump.
    """
    spectra = [scipy.fft.dct(wrench[a:b], axis=0, norm="ortho") for a, b in record.segments]
    for _, low, high in bands:
        out = np.empty_like(wrench)
        for (a, b), spectrum in zip(record.segments, spectra, strict=True):
            frequency = np.arange(b - a) / (2.0 * (b - a) * record.dt)
            inside = (frequency >= low) & (frequency < high)
            out[a:b] = scipy.fft.idct(spectrum * inside[:, None], axis=0, norm="ortho")
        yield out


def drawn_between(noise: Array, record: Recording) -> Array:
    """Return noise as it appears in a recording whose slow sensors are interpolated between samples.

    Args:
        noise: White noise of 12 channels in N rows, (N, 12); it is not changed.
        record: Recording, for the rows with a sample of each channel.

    Returns:
        Noise, (N, 12): `noise` in rows with a sample, interpolated between them; 0 for a channel without a
        sample in its segment.
    """
    if record.seen is None:
        return noise
    out = np.zeros_like(noise)
    for start, stop in record.segments:
        rows = np.arange(start, stop)
        for i, seen in enumerate(record.seen[start:stop].T):
            if seen.any():
                out[start:stop, i] = np.interp(rows, rows[seen], noise[start:stop, i][seen])
    return out
