"""Detection and correction of impossible readings: jumps, frozen values, and values for "no reading".

No force moves a vehicle for one sample and back, and a noisy sensor never repeats a reading, even less for a
second.  Such readings are detected from the log alone, channel by channel.  They are reported and excluded
from every fit.  Short ones are interpolated in their channel, and rows with long ones are dropped.  A slow
sensor whose readings are held or interpolated is tested at its samples, and so is a quantised one.  Jumps of
noise with heavy tails are not faults: such channels hold pseudo-observations afterwards
(`recording.heavy_tails`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from hydro.core.columns import POSE, VELOCITY, Array, Mask, Rows
from hydro.core.recording.arrays import Recording, channels, evenly_spaced, recording, samples
from hydro.core.recording.dead_reckoning import pose_error, rate_bias
from hydro.core.recording.filter_corrections import filter_corrections, without_predictions
from hydro.core.recording.heavy_tails import Tail, heavy_tails, pseudo_observed
from hydro.core.recording.jumps import jumping
from hydro.core.recording.repeated_rows import repeated_rows, without_repeats
from hydro.core.vehicle.description import Vehicle

CHANNELS, RATES = (*POSE, *VELOCITY), VELOCITY[3:]
LEAST_SAMPLES = 8
BURSTS = (1, 2, 4)  # numbers of samples that may jump together
STANDS, LONGEST_CHANCE = 10, 5.0
"""Minimum rows of a frozen value, and minimum ratio to the 99 % quantile of the lengths of such runs."""
LEAST_STILL = 0.2  # s, minimum length of a frozen value
FINE = 0.9  # share of distinct values among the runs above which a channel is not quantised
WHITE = 3.0
"""Ratio of fourth to second differences above which a channel has noise: 3.4 for white noise, less for
motion."""
DRAWN_SHARE, EXACT = 0.4, 1e-6  # minimum share of moving rows on straight lines, and their tolerance
MARKS = 10  # minimum runs of one value in a channel that is not quantised for a fill value
BRIDGED = 0.4  # s, longest run of readings that is interpolated
CONTRADICTED = 2.0  # ratio to the usual difference of pose and velocity
LEAST_GROWN = 0.01  # m, rad
LEVEL = 0.5  # cosine of the pitch below which noise dominates roll and heading


@dataclass(frozen=True)
class Fault:
    """One kind of fault of a log, such as frozen values.

    Attributes:
        columns: Columns of the raw table with the fault.
        message: Sentence that names the fault, its frequency, its first place and the correction.
    """

    columns: tuple[str, ...]
    message: str


@dataclass(frozen=True)
class Corrected:
    """Recording with corrected sensor faults.

    Attributes:
        raw: Corrected raw table.
        record: The table as arrays; channels with heavy-tailed noise hold pseudo-observations, samples with
            Gaussian noise of the same information.
        faults: The faults that were found, one of each kind.
        tails: Noise of the channels with heavy tails.
    """

    raw: pl.DataFrame
    record: Recording
    faults: tuple[Fault, ...]
    tails: tuple[Tail, ...] = ()


@dataclass(frozen=True)
class Faults:
    """Masks of impossible readings of a recording, (N, 12) each, pose then velocity.

    Attributes:
        jumps: Readings that jump away for some samples and back.
        marks: Values that stand for a missing reading and recur, such as 0.
        stills: Frozen values: they repeat although the sensor has noise, or although the pose changes.
    """

    jumps: Mask
    marks: Mask
    stills: Mask

    @property
    def all(self) -> Mask:
        """Mask of every faulty reading, (N, 12)."""
        return self.jumps | self.marks | self.stills


def faults(record: Recording) -> Faults:
    """Return masks of the impossible readings of a recording, such as jumps and frozen values."""
    found = Faults(*(np.zeros((record.rows, len(CHANNELS)), bool) for _ in range(3)))
    errors = pose_error(record, record.nu)
    for i, (places, parts) in enumerate(_sampled(record)):
        if not parts:
            continue
        runs = [_runs(part) for part in parts]
        lengths = np.concatenate([np.diff(edges) for edges in runs])
        readings = [part[edges[:-1]] for part, edges in zip(parts, runs, strict=True)]
        step = record.dt * max(
            (float(np.median(np.diff(rows))) for rows in places if len(rows) > 1), default=1
        )
        least = max(STANDS, LEAST_STILL / step, LONGEST_CHANCE * float(np.quantile(lengths, 0.99)))
        values, count = np.unique(np.concatenate(readings), return_counts=True)
        fine = len(values) >= FINE * len(lengths)
        noisy = fine and _whiteness(readings) > WHITE
        for rows, part, edges in zip(places, parts, runs, strict=True):
            long = np.repeat(np.diff(edges) >= least, np.diff(edges))
            if long.any() and not noisy:
                long = _contradicted(errors[i // 3 % 2][rows], long)
            found.stills[rows, i] = long
            found.marks[rows, i] = noisy & np.isin(part, values[count >= MARKS]) & ~long
        found.jumps[:, i] = _jumps(places, parts, found.all[:, i], record.dt)
    found.jumps[:, 3:6] &= (np.cos(record.eta[:, 4]) > LEVEL)[:, None]
    return found


def _sampled(record: Recording) -> Iterator[tuple[list[Rows], list[Array]]]:
    """Yield rows and values of the samples of each channel, in evenly spaced runs; empty without samples."""
    every = [np.arange(start, stop) for start, stop in record.segments]
    for i, parts in enumerate(samples(record)):
        rows = every if record.seen is None else [those[record.seen[those, i]] for those in every]
        places, readings = (evenly_spaced(each, record, i) for each in (rows, parts))
        yield [those for those in places if len(those)], [part for part in readings if len(part)]


def without_faults(vehicle: Vehicle, raw: pl.DataFrame) -> Corrected:
    """Return a recording whose sensor faults are corrected: bad readings, gyro bias and heavy-tailed noise.

    Args:
        vehicle: The vehicle.
        raw: Raw table; it is not changed.

    Raises:
        DataError: The recording does not fit the vehicle.
    """
    return without_outliers(vehicle, without_bias(vehicle, without_bad_readings(vehicle, raw)))


def without_bad_readings(vehicle: Vehicle, raw: pl.DataFrame) -> Corrected:
    """Return a recording without repeated rows, jumps, frozen values and values for "no reading".

    The bias of a gyro and the noise stay.

    Args:
        vehicle: The vehicle.
        raw: Raw table; it is not changed.

    Raises:
        DataError: The recording does not fit the vehicle.
    """
    record, kinds = recording(vehicle, raw), list[Fault]()
    repeated = repeated_rows(record)
    if repeated.any():
        words = "repeat the row before, all at once, as a logger writes that got nothing new"
        kinds.append(_fault(raw, record, np.tile(repeated[:, None], len(CHANNELS)), words))
        raw = without_repeats(raw, record, repeated)
        record = recording(vehicle, raw)
    if corrected := filter_corrections(record):
        kinds.append(_predicted(record, corrected))
        raw = without_predictions(raw, corrected)
        record = recording(vehicle, raw)
    found = _implausible(vehicle, raw, record, faults(record))
    if others := list(described(raw, record, found)):
        raw = mended(raw, record, found)
        record = recording(vehicle, raw)
    return Corrected(raw, record, (*kinds, *others))


def without_bias(vehicle: Vehicle, log: Corrected) -> Corrected:
    """Return a recording with the constant bias of the gyros subtracted, and that bias added to its faults.

    Args:
        vehicle: The vehicle.
        log: Recording with corrected readings; it is returned itself if no bias is significant.
    """
    rates = rate_bias(log.record)
    bias = {name: float(value) for name, value in zip(RATES, rates, strict=True) if value}
    if not bias:
        return log
    raw = log.raw.with_columns(pl.col(name) - value for name, value in bias.items())
    return Corrected(raw, recording(vehicle, raw), (*log.faults, _biased(bias)))


def without_outliers(vehicle: Vehicle, log: Corrected) -> Corrected:
    """Return a recording whose arrays hold pseudo-observations in channels with heavy-tailed noise.

    A pseudo-observation has Gaussian noise with as much information as the sample.  The raw table stays as it
    is.

    Args:
        vehicle: The vehicle.
        log: Recording with corrected readings; it is returned itself if no channel has heavy tails.
    """
    tails = heavy_tails(log.record)
    if not tails:
        return log
    observed, sigma = pseudo_observed(log.raw, log.record, tails)
    record = replace(recording(vehicle, observed), sigma=sigma)
    return replace(log, record=record, tails=tuple(tails.values()))


def mended(raw: pl.DataFrame, record: Recording, found: Faults) -> pl.DataFrame:
    """Return a copy of a raw table without faulty readings.

    Short runs of faulty readings are interpolated, and rows with long runs are dropped.  In a table with
    nulls, faulty readings become null instead.

    Args:
        raw: Raw table of N rows.
        record: The table as arrays.
        found: Masks of the faulty readings.
    """
    bad, most = found.all, max(int(BRIDGED / record.dt), 1)
    if not bad.any():
        return raw
    if record.seen is not None:
        sound = {name: pl.Series(~bad[:, i]) for i, name in enumerate(CHANNELS)}
        return raw.with_columns(pl.when(kept).then(pl.col(name)).alias(name) for name, kept in sound.items())
    left_out, columns = np.zeros(record.rows, bool), {}
    parts = list(channels(record))
    for i in np.flatnonzero(bad.any(axis=0)):
        column = raw[CHANNELS[i]].to_numpy().copy()
        for (start, stop), part in zip(record.segments, parts[i], strict=True):
            lost, rows = bad[start:stop, i], np.arange(stop - start)
            edges = np.flatnonzero(np.diff(lost, prepend=False, append=False))
            for begin, end in edges.reshape(-1, 2):
                inside = begin > 0 and end < stop - start
                if not inside or end - begin > most:
                    left_out[start + begin : start + end] = True
            filled = np.interp(rows[lost], rows[~lost], part[~lost]) if (~lost).any() else part[lost]
            column[start:stop][lost] = np.angle(np.exp(1j * filled)) if CHANNELS[i] in POSE[3:] else filled
        columns[CHANNELS[i]] = column
    table = raw.with_columns(pl.Series(name, values) for name, values in columns.items())
    return table.filter(pl.Series(~left_out))


def _implausible(vehicle: Vehicle, raw: pl.DataFrame, record: Recording, found: Faults) -> Faults:
    """Remove jumps that noise with heavy tails explains, if the other samples show such noise."""
    others = heavy_tails(recording(vehicle, mended(raw, record, found))) if found.jumps.any() else {}
    if not others:
        return found
    kept = replace(found, jumps=np.zeros_like(found.jumps))
    whole = heavy_tails(recording(vehicle, mended(raw, record, kept)))
    jumps, parts, every = found.jumps.copy(), list(channels(record)), found.all
    for i in others.keys() & whole.keys():
        for (start, stop), part in zip(record.segments, parts[i], strict=True):
            bad, rows = every[start:stop, i], np.arange(stop - start)
            if not bad.all():
                off = part - np.interp(rows, rows[~bad], part[~bad])
                jumps[start:stop, i] &= ~whole[i].plausible(off, record.rows)
    return replace(found, jumps=jumps)


def described(raw: pl.DataFrame, record: Recording, found: Faults) -> Iterator[Fault]:
    """Yield one `Fault` for each kind of faulty reading: columns, and a sentence that describes it.

    Args:
        raw: Raw table.
        record: The table as arrays.
        found: Masks of the faulty readings.
    """
    kinds = (
        (found.jumps, "jump away and back within a few samples, which no force does"),
        (found.marks, "hold a value that keeps coming back, as a sensor writes where it has no reading"),
        (found.stills, "stand still, row after row, though the sensor has noise or the vehicle moves"),
    )
    for bad, words in kinds:
        if bad.any():
            yield _fault(raw, record, bad, words)


def _fault(raw: pl.DataFrame, record: Recording, bad: Mask, words: str) -> Fault:
    """Describe faulty readings (N, 12): kind, number, and place of the first."""
    rows = np.flatnonzero(bad.any(axis=1))
    columns = tuple(CHANNELS[i] for i in np.flatnonzero(bad.any(axis=0)))
    stretches = 1 + int(np.count_nonzero(np.diff(rows) > 1))
    session, t = raw["session"][int(rows[0])], float(record.t[rows[0]])
    return Fault(
        columns,
        f"readings of {', '.join(columns)} {words}: {rows.size} {'row' if rows.size == 1 else 'rows'} "
        f"({100.0 * rows.size / record.rows:.2g} % of the log) in "
        f"{stretches} {'stretch' if stretches == 1 else 'stretches'}, the first in session {session} at "
        f"{t:.2f} s; they are left out here; remove them from the log",
    )


def _predicted(record: Recording, corrected: Mapping[str, Mask]) -> Fault:
    """Describe channels that are a filter's estimates, except right after its corrections."""
    rows = max(int(after.sum()) for after in corrected.values())
    rate = rows / (record.rows * record.dt)
    move = "moves" if len(corrected) == 1 else "move"
    message = (
        f"{', '.join(corrected)} {move} in steps, {rate:.3g} times a second, as a filter's estimate does at "
        f"each sample of its sensor; only the {rows} rows right after a step are kept as samples; "
        "log the sensor itself"
    )
    return Fault(tuple(corrected), message)


def _biased(bias: Mapping[str, float]) -> Fault:
    """Describe the biases of gyros [rad/s]."""
    message = (
        f"{', '.join(f'{name} reads {value:+.3g} rad/s' for name, value in bias.items())} too much "
        "throughout, against the attitude: a gyro's bias; it is subtracted here, subtract it in the log"
    )
    return Fault(tuple(bias), message)


def _runs(part: Array) -> Rows:
    """Return the edges of the runs of equal readings, (runs + 1,)."""
    changes = np.flatnonzero(np.diff(part) != 0.0) + 1
    return np.concatenate([[0], changes, [len(part)]])


def _whiteness(samples: Sequence[Array]) -> float:
    """Return the ratio of fourth to second differences; see WHITE."""
    if max(len(part) for part in samples) < LEAST_SAMPLES:
        return 0.0
    size = [np.median(np.abs(np.concatenate([np.diff(part, n) for part in samples]))) for n in (4, 2)]
    return float(size[0] / max(size[1], 1e-300))


def _contradicted(error: Array, still: Mask) -> Mask:
    """Return the runs of a segment in which pose and velocities differ far more than elsewhere."""
    edges, out = np.flatnonzero(np.diff(still, prepend=False, append=False)).reshape(-1, 2), still.copy()
    for begin, end in edges:
        long = min(int(end), len(error) - 1) - int(begin)
        grown = np.linalg.norm(error[long:] - error[: len(error) - long], axis=1)
        touched = np.convolve(still, np.ones(long + 1), "valid") > 0.0
        usual = float(np.quantile(grown[~touched], 0.95)) if (~touched).any() else np.inf
        out[begin:end] = grown[begin] > max(CONTRADICTED * usual, LEAST_GROWN)
    return out


def _jumps(places: Sequence[Rows], parts: Sequence[Array], known: Mask, dt: float) -> Mask:
    """Return which readings of a channel jump away and back, (N,), apart from those `known` as faulty."""
    out, apart = np.zeros(len(known), bool), _apart(parts)
    series = [
        (rows, *taken)
        for rows, part in zip(places, parts, strict=True)
        for taken in _samples(part, known[rows], apart)
    ]
    steps = [np.diff(rows[first]) for rows, first, _, _ in series if len(first) > 1]
    spacing = dt * float(np.median(np.concatenate(steps))) if steps else dt
    found = jumping([values for *_, values in series], BURSTS if apart == 1 else BURSTS[:1], spacing)
    for (rows, first, last, _), odd in zip(series, found, strict=True):
        for begin, end in zip(first[odd], last[odd], strict=True):
            out[rows[begin:end]] = True
    return out


def _apart(parts: Sequence[Array]) -> int:
    """Return the rows between samples of an interpolated channel; 1 for any other."""
    if max(len(part) for part in parts) < LEAST_SAMPLES:
        return 1
    slope, bend = (np.concatenate([np.diff(part, n)[2 - n :] for part in parts]) for n in (1, 2))
    straight = (np.abs(bend) < EXACT * np.abs(slope)) & (slope != 0.0)
    if straight.sum() <= DRAWN_SHARE * np.count_nonzero(slope):
        return 1
    edges = np.flatnonzero(np.diff(straight, prepend=False, append=False)).reshape(-1, 2)
    return int(np.median(np.diff(edges))) + 1


def _samples(part: Array, known: Mask, apart: int) -> Iterator[tuple[Rows, Rows, Array]]:
    """Yield first row, row after the last, and value of each sample of a channel, in one or several series.

    Equal rows are one sample.  An interpolated channel gives one series for each phase of its samples, since
    a jump also bends the lines to the neighbouring samples.
    """
    if apart == 1:
        edges = _runs(part)
        kept = ~known[edges[:-1]]
        yield edges[:-1][kept], edges[1:][kept], part[edges[:-1]][kept]
        return
    for phase in range(apart):
        rows = np.arange(phase, len(part), apart)
        rows = rows[~known[rows]]
        yield np.maximum(rows - apart + 1, 0), np.minimum(rows + apart, len(part)), part[rows]
