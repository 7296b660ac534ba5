"""Comparison of a model with a recording: errors, noise floor, and the conditions with the largest errors.

There are two levels (`evaluation.misfit`).  The force level is the wrench that the model lacks.  The replay
level is the error of predictions over 1, 5 and 20 s from restarts along the recording, and over the whole
run.  Shares of the unexplained error are of the sum of squares above the noise floor.  `all` and `pose`
combine axes with the weights of `evaluation.weights`.  Simple predictors give reference errors
(`evaluation.yardsticks`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from hydro.core.columns import POSE, POSE_UNITS, VELOCITY, VELOCITY_UNITS, Array, Rows
from hydro.core.errors import DataError
from hydro.core.evaluation import failure_regimes
from hydro.core.evaluation.block_resampling import SAMPLES, draws, interval
from hydro.core.evaluation.force_error import force
from hydro.core.evaluation.misfit import Misfit
from hydro.core.evaluation.regimes import Family, Pieces, families, phrase
from hydro.core.evaluation.replay_error import HORIZONS, replay
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.evaluation.weights import Weights
from hydro.core.evaluation.yardsticks import Yardstick
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.tracking import tracked
from hydro.core.progress import Progress, silent
from hydro.core.recording.arrays import Recording, recording
from hydro.core.vehicle.description import Vehicle

NOISE_KNOWN = 0.1
"""Relative uncertainty of the squared noise floor, the error that sensor noise alone causes."""
SURE_PART = 0.5
"""Percentile of the bootstrap at which errors on an axis must exceed the noise; low because of six axes."""

Line = dict[str, Any]

KEY = ("level", "horizon", "axis", "by", "place")
NEEDED_COLUMNS = (*KEY, "rmse", "rank", "weight")
"""Columns that an earlier comparison must have."""


def compare(
    vehicle: Vehicle,
    raw: pl.DataFrame,
    *,
    record: Recording | None = None,
    against: pl.DataFrame | None = None,
    yardstick: Yardstick | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> pl.DataFrame:
    """Return a table of a vehicle's errors on a recording, in force and in predictions.

    Args:
        vehicle: Vehicle file.
        raw: Raw table of the measured motion and commands.
        record: Cleaned recording as arrays; by default the table as it was logged.
        against: Earlier comparison with the same recording. Its conditions are evaluated again, its errors
            are listed with the new errors, and its weights of the axes are used.
        yardstick: Weights of the axes and simple reference predictors.  By default the weights come from
            `vehicle`, and the least-squares predictor of each session is fitted to the other sessions.
        seed: Seed of the bootstrap and of the noise from which the noise floor is computed.
        progress: Called with a short text and the share of the work done.

    Returns:
        The comparison table, one row per level (force or replay), horizon, axis and place, a condition such
        as "while turning left". `rmse` (over the horizon) has the 95 % interval `low` to `high` of a block
        bootstrap. `noise_floor` is the error due to noise alone, and `share` the share of the unexplained
        error. `rank` numbers the places with most unexplained error. `rows` counts samples; an axis without
        samples has no row. `at_horizon` is the error at the end of the predictions, and `weight` the weight
        of the axis. Rows of the level `yardstick` hold errors of the simple predictor named in `by`. Rows of
        the level `recording` hold the noise of each channel and the sample time of each session. With
        `against`, `before` is the earlier rmse.

    Raises:
        DataError: The recording or the vehicle is at fault, or `against` is not a comparison.
    """
    report = progress or silent
    if against is not None and (missing := [name for name in NEEDED_COLUMNS if name not in against.columns]):
        raise DataError(f"the earlier comparison has no column {missing[0]}; make it with `hydro compare`")
    record = tracked(vehicle, recording(vehicle, raw) if record is None else record)
    model = candidate(vehicle)
    report("smoothing", 0.0)
    motion, pieces = Motion.of(record), Pieces.of(record)
    yardstick = yardstick or Yardstick.crossed(vehicle, record)
    weights = yardstick.weights if against is None else Weights.read(against)
    names = [str(name) for name in raw["session"].gather(record.segments[:, 0])]
    found = families(record, vehicle, pieces, motion.eta, motion.nu, motion.nu_dot, names)
    sessions = [family for family in found if family.by == "session"]
    report("forces", 0.1)
    forces, banded, bands = force(model, record, motion, pieces, seed, weights)
    lines = [*_Lines(forces, seed).of([*found]), *_Lines(banded, seed).of([bands], whole=False)]
    for number, horizon in enumerate((*HORIZONS, None)):
        report("whole run" if horizon is None else f"{horizon:g} s ahead", 0.3 + 0.15 * number)
        if (both := replay(model, record, motion, pieces, horizon, seed, weights)) is not None:
            velocity, pose = both
            lines += _Lines(velocity, seed).of(sessions if horizon is None else found)
            lines += _Lines(pose, seed).of(sessions)
            if horizon is not None:
                for name, simple in yardstick.misfits(record, motion, pieces, horizon, velocity):
                    lines += [line | {"by": name, "share": 0.0} for line in _Lines(simple, seed).of([])]
    report("places", 0.9)
    lines += _ranked(_Lines(forces, seed), found, against)
    lines += _recorded(record, motion, names)
    table = pl.DataFrame(lines, infer_schema_length=None)
    table = table.with_columns(pl.col("horizon", "low", "high", "at_horizon", "weight").fill_nan(None))
    report("done", 1.0)
    return table if against is None else _beside(table, against)


@dataclass
class _Lines:
    """Rows of the comparison table for one kind of error, from its squares by piece of time."""

    misfit: Misfit
    seed: int

    def __post_init__(self) -> None:
        misfit = self.misfit
        # A sample of a slow sensor stands for the rows around it.
        number = misfit.numbers.sum(axis=0)
        self.weight = misfit.weight * np.where(number > 0.0, misfit.rows.sum() / np.maximum(number, 1.0), 0.0)
        excess = self.weight * (misfit.squares - misfit.noise)
        sums = excess.sum(axis=0)
        blocks = int(misfit.block.max()) + 1
        self.drawn = draws(blocks, self.seed) if blocks > 1 else None
        clear = self.weight * (misfit.squares - (1.0 + NOISE_KNOWN) * misfit.noise)
        sure = clear.sum(axis=0) > 0.0
        if self.drawn is not None:
            by_block = _by_block(clear, np.zeros(len(clear), np.int64), 1, misfit.block)[:, 0]
            sure &= np.percentile(self.drawn @ by_block, SURE_PART, axis=0) > 0.0
        # The error of an axis within the noise is not unexplained.
        self.axis_share = np.where(sure, sums, 0.0) / max(float(sums[sure].sum()), 1e-300)
        self.unexplained = excess * np.where(sure, self.axis_share / np.where(sure, sums, 1.0), 0.0)

    def of(self, found: Sequence[Family], *, whole: bool = True) -> Iterator[Line]:
        """Yield the rows of a comparison table, for all data and for every condition of the families.

        Args:
            found: Families of conditions, such as the directions of turns.
            whole: Whether to include the rows for all data together.
        """
        misfit = self.misfit
        if whole:
            everything = Family("all", ("all",), np.zeros(len(misfit.rows), np.int64), doing=False)
            ends = dict.fromkeys(misfit.axes, math.nan)
            if misfit.end is not None:
                together = _all_too(np.nan_to_num(misfit.end) ** 2, misfit.weight)
                ends = dict(zip(misfit.axes, np.sqrt(together).tolist(), strict=True))
            for line in self._family(everything):
                yield line | {"at_horizon": ends[line["axis"]]}
        for family in found:
            yield from self._family(family)

    def place(self, place: failure_regimes.Place, rank: int | None) -> Line:
        """Return the row of the comparison table for one condition on one axis.

        Args:
            place: Condition with its axis and its share of the unexplained error.
            rank: Rank of the condition; None without a rank.
        """
        family = Family("place", (place.words,), np.where(place.met, 0, -1), doing=False)
        line = next(line for line in self._family(family) if line["axis"] == self.misfit.axes[place.axis])
        return line | {"share": place.share, "rank": rank}

    def _family(self, family: Family) -> Iterator[Line]:
        """Yield the rows of every condition of a family, axis by axis and for all axes together."""
        misfit, count = self.misfit, len(family.words)
        rows, squares, noise = (
            _by_block(values, family.code, count, misfit.block)
            for values in (misfit.numbers, misfit.squares, misfit.noise)
        )
        low, high = self._interval(rows, squares)
        rmse, floor = (self._root(sums.sum(axis=0), rows.sum(axis=0)) for sums in (squares, noise))
        number = rows.sum(axis=0)
        number = np.hstack([number, number.max(axis=1, keepdims=True)])
        share = self._shares(family)
        axes = zip(misfit.axes, (*misfit.units, misfit.units[0]), (*misfit.weight, math.nan), strict=True)
        for i, (axis, unit, weight) in enumerate(axes):
            for code in np.flatnonzero(number[:, i]):
                yield {
                    "level": misfit.level,
                    "horizon": math.nan if misfit.horizon is None else misfit.horizon,
                    "axis": axis,
                    "by": family.by,
                    "place": phrase([(family.words[code], family.doing)]),
                    "rows": int(number[code, i]),
                    "rmse": float(rmse[code, i]),
                    "low": float(low[code, i]),
                    "high": float(high[code, i]),
                    "noise_floor": float(floor[code, i]),
                    "at_horizon": math.nan,
                    "share": float(share[code, i]),
                    "rank": None,
                    "weight": float(weight),
                    "unit": unit,
                }

    def _interval(self, rows: Array, squares: Array) -> tuple[Array, Array]:
        """Return the lower and upper ends of the bootstrap interval of the rmse, by condition and axis.

        Args:
            rows: Number of samples by block, condition and axis, (B, K, A).
            squares: Sums of squared errors, (B, K, A).

        Returns:
            (K, A + 1) each, with all axes together last; NaN for a condition within a single block.
        """
        blocks, count, axes = squares.shape
        nothing = np.full((count, axes + 1), np.nan)
        if self.drawn is None:
            return nothing, nothing
        number, sums = (
            (self.drawn @ values.reshape(blocks, -1)).reshape(SAMPLES, count, axes)
            for values in (rows, squares)
        )
        low, high = nothing, nothing.copy()
        for code in np.flatnonzero(((rows > 0.0).any(axis=2)).sum(axis=0) > 1):
            there = (number[:, code] > 0.0)[:, rows[:, code].any(axis=0)].all(axis=1)
            if there.any():
                low[code], high[code] = interval(self._root(sums[there, code], number[there, code]))
        return low, high

    def _root(self, sums: Array, number: Array) -> Array:
        """Return root mean squares by axis and of all axes together, (..., A + 1).

        Args:
            sums: Sums of squares, (..., A).
            number: Number of samples in these sums, (..., A).
        """
        return np.sqrt(_all_too(sums / np.maximum(number, 1.0), self.misfit.weight))

    def _shares(self, family: Family) -> Array:
        """Return the share of the unexplained error by condition, on every axis and on all, (K, A + 1).

        A condition whose sum noise makes negative counts as zero.  All other sums are parts of the share of
        the axis.
        """
        once = np.zeros(len(family.code), np.int64)
        positive = np.maximum(_by_block(self.unexplained, family.code, len(family.words), once)[0], 0.0)
        whole = np.maximum(positive.sum(axis=0), self.axis_share)
        shares = positive * self.axis_share / np.maximum(whole, 1e-300)
        with_all: Array = np.minimum(np.hstack([shares, shares.sum(axis=1, keepdims=True)]), 1.0)
        return with_all


def _ranked(lines: _Lines, found: Sequence[Family], against: pl.DataFrame | None) -> Iterator[Line]:
    """Yield the rows of the places where the model fails, and of other places of an earlier comparison."""
    listed = failure_regimes.rank(lines.unexplained, lines.misfit.rows, lines.misfit.block, found)
    for number, place in enumerate(listed):
        yield lines.place(place, number + 1)
    if against is None:
        return
    there = {(place.axis, place.words) for place in listed}
    earlier = against.filter(pl.col("rank").is_not_null()).select("axis", "place").rows()
    wanted = {(lines.misfit.axes.index(axis), words) for axis, words in earlier} - there
    masks = failure_regimes.find({words for _, words in wanted}, found)
    for axis, words in sorted(wanted):
        if (met := masks.get(words)) is not None:
            share = float(np.clip(lines.unexplained[met, axis].sum(), 0.0, 1.0))
            yield lines.place(failure_regimes.Place(words, axis, met, share), None)


def _recorded(record: Recording, motion: Motion, names: Sequence[str]) -> Iterator[Line]:
    """Yield rows with the noise of the recording's channels, and with the sample time of its sessions."""

    def line(axis: str, by: str, place: str, rows: int, size: float, unit: str) -> Line:
        key = {
            "level": "recording",
            "horizon": math.nan,
            "axis": axis,
            "by": by,
            "place": place,
            "rows": rows,
        }
        nothing = dict.fromkeys(("low", "high", "at_horizon", "weight"), math.nan)
        return key | nothing | {"rmse": size, "noise_floor": size, "share": 0.0, "rank": None, "unit": unit}

    units = (*POSE_UNITS, *VELOCITY_UNITS)
    samples = np.full(len(units), record.rows) if record.seen is None else record.seen.sum(axis=0)
    for i, (axis, unit, sigma) in enumerate(
        zip((*POSE, *VELOCITY), units, motion.sigma.tolist(), strict=True)
    ):
        if samples[i]:
            yield line(axis, "all", "all", int(samples[i]), sigma, unit)
    lengths = np.diff(record.segments)[:, 0]
    for name in dict.fromkeys(names):
        rows = sum(int(length) for length, one in zip(lengths, names, strict=True) if one == name)
        yield line("t", "session", name, rows, record.dt, "s")


def _beside(table: pl.DataFrame, against: pl.DataFrame) -> pl.DataFrame:
    """Return the table with the errors of an earlier comparison as the column `before`; null where none."""
    same = against.filter(
        pl.col("place") != failure_regimes.ELSEWHERE
    )  # whose extent depends on the other places
    earlier = same.select(*KEY, before="rmse").unique(KEY, keep="first")
    return table.join(earlier, on=KEY, how="left", nulls_equal=True, maintain_order="left")


def _by_block(values: Array, code: Rows, count: int, block: Rows) -> Array:
    """Return sums over pieces of time by block and condition, (B, count, A).

    Args:
        values: Values of P pieces on A axes, (P, A).
        code: Condition of each piece, (P,); pieces with -1 are left out.
        count: Number of conditions.
        block: Block of each piece, (P,).
    """
    blocks, of = int(block.max()) + 1, code >= 0
    place = block[of] * count + code[of]
    sums = [np.bincount(place, column[of], blocks * count) for column in values.T]
    stacked: Array = np.stack(sums, axis=-1, dtype=np.float64)
    return stacked.reshape(blocks, count, values.shape[1])


def _all_too(squares: Array, weight: Array) -> Array:
    """Return squares of the axes (..., A) followed by their weighted sum, (..., A + 1)."""
    return np.concatenate([squares, squares @ weight[:, None]], axis=-1)
