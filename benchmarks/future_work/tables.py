"""Kept tables: errors of all methods, with intervals over blocks of time and ranges over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from benchmarks.future_work.recordings import OWN, WITH_DRAG, WITH_MEMORY, WITHOUT
from benchmarks.future_work.study import (
    AHEAD,
    AS_GIVEN,
    BARE,
    EXPLAINED,
    GIVEN,
    LEAST_SQUARES,
    NETWORKS,
    SEQUENCE,
    WRENCHES,
    ZERO,
)
from benchmarks.kept_tables import Row, keep, origin
from hydro.core.columns import VELOCITY, WRENCH, Array
from hydro.core.evaluation.block_resampling import draws, interval

COMMAND = "python -m benchmarks.future_work run"
REFERENCE = "mlp"
"""Method that others are compared with in the table of fluid memory; `temporal` is this with a past."""
STRAIGHT, TURNING = VELOCITY[:3], VELOCITY[3:]
RUNAWAY = 1.0
"""Root mean square error above which a prediction has run away [m/s]: three times the fastest real motion."""
JUDGED = ("u", "v", "w", "r")
"""Axes of the real vehicle that its controller drives."""


ORDER = (
    *(ZERO, LEAST_SQUARES, BARE, GIVEN, OWN, WITH_DRAG, WITH_MEMORY, EXPLAINED),
    *(f"{name}{kind}" for kind in ("", AS_GIVEN) for name in NETWORKS),
)
"""Order of the methods in the tables: baselines, fitted effects, networks."""


class Errors:
    """Errors of one case by measure and method.

    Attributes:
        methods: Names of the methods, in ORDER.
    """

    def __init__(self, rows: pl.DataFrame) -> None:
        self.rows = rows
        self.methods = sorted(rows["method"].unique().to_list(), key=ORDER.index)

    def seeds(self, method: str) -> list[int]:
        """Return the seeds of a method: -1 alone for one without seeds."""
        return sorted(self.rows.filter(method=method)["seed"].unique().to_list())

    def sums(self, method: str, measure: str, axes: Sequence[str], seed: int | None = None) -> Array | None:
        """Return squared errors, absolute errors and compared values of each block, (B, 3), over some axes.

        With several seeds, and none given, they are added up, so that errors are means over the seeds.  None
        where the method has no such measure.
        """
        chosen = self.rows.filter(
            pl.col("axis").is_in(list(axes)),
            method=method,
            measure=measure,
            **({} if seed is None else {"seed": seed}),
        )
        if chosen.is_empty():
            return None
        blocks = chosen.group_by("block").agg(pl.col("squares", "absolute", "number").sum()).sort("block")
        return blocks.select("squares", "absolute", "number").to_numpy().astype(float)

    def error(self, method: str, measure: str, axes: Sequence[str], digits: int = 3) -> str:
        """Return the root mean square error with its 95 % interval over blocks of time."""
        if (sums := self.sums(method, measure, axes)) is None:
            return ""
        middle, low, high = (
            f"{number:.{digits}g}" for number in (root(sums.sum(axis=0)), *interval(root(drawn(sums))))
        )
        return f"{middle} [{low} to {high}]" if len(sums) > 1 else middle

    def range(self, method: str, measure: str, axes: Sequence[str], digits: int = 3) -> str:
        """Return the root mean square error over all seeds, with the range of single ones."""
        if (sums := self.sums(method, measure, axes)) is None:
            return ""
        whole = rounded(root(sums.sum(axis=0)), digits)
        if len(seeds := self.seeds(method)) < 2:
            return whole
        single = [root(self.sums(method, measure, axes, seed).sum(axis=0)) for seed in seeds]
        return f"{whole} ({rounded(min(single), digits)} to {rounded(max(single), digits)})"

    def runaways(self, method: str) -> str:
        """Return how many predictions of all seeds have an error above RUNAWAY in surge, sway or heave."""
        rows = self.rows.filter(pl.col("axis").is_in(STRAIGHT), method=method, measure=AHEAD)
        each = rows.group_by("seed", "block").agg((pl.col("squares") / pl.col("number")).max())
        return f"{(each['squares'].sqrt() > RUNAWAY).sum()} of {each.height}"

    def mean_absolute(self, method: str) -> str:
        """Return the mean absolute error of the wrench over all axes."""
        if (sums := self.sums(method, WRENCHES, WRENCH)) is None:
            return ""
        return f"{sums[:, 1].sum() / sums[:, 2].sum():.3g}"

    def ratio(self, method: str, to: str, measure: str, axes: Sequence[str]) -> str:
        """Return the ratio of two methods' errors on the same blocks, with its 95 % interval."""
        ours, theirs = (self.sums(one, measure, axes) for one in (method, to))
        if ours is None or theirs is None or method == to:
            return ""
        times = root(drawn(ours)) / root(drawn(theirs))
        low, high = interval(times)
        return f"{root(ours.sum(axis=0)) / root(theirs.sum(axis=0)):.2f} [{low:.2f} to {high:.2f}]"


def rounded(number: Any, digits: int) -> str:
    """Return a number with some significant digits, without an exponent."""
    return f"{float(f'{number:.{digits}g}'):g}"


def drawn(sums: Array) -> Array:
    """Return the sums (S, 3) of resamples of the blocks, drawn alike for equal numbers of blocks."""
    return draws(len(sums), 0) @ sums


def root(sums: Array) -> Array:
    """Return the root mean square error from squares and numbers in the first and the last column."""
    return np.asarray(np.sqrt(sums[..., 0] / sums[..., 2]))


def of_cases(results: pl.DataFrame, part: str) -> list[tuple[str, Errors]]:
    """Return name and errors of the cases of a part, in the order of the study."""
    rows = results.filter(part=part)
    names = rows["case"].unique(maintain_order=True).to_list()
    return [(name, Errors(rows.filter(case=name))) for name in names]


def memory(results: pl.DataFrame) -> list[Row]:
    """Return the table of fluid memory; the vehicle without it is a case of part `vehicles`."""
    without = results.filter(part="vehicles", case=WITHOUT)
    cases = [("no memory", Errors(without)), *of_cases(results, "memory")]
    return [
        {
            "water": case,
            "model": method,
            "wrench, N and N m": errors.error(method, WRENCHES, WRENCH),
            "5 s, m/s": errors.error(method, AHEAD, STRAIGHT),
            "5 s, rad/s": errors.error(method, AHEAD, TURNING),
            f"wrench relative to {REFERENCE}": errors.ratio(method, REFERENCE, WRENCHES, WRENCH),
            f"5 s, m/s, relative to {REFERENCE}": errors.ratio(method, REFERENCE, AHEAD, STRAIGHT),
            "90 s, m/s (seeds)": errors.range(method, SEQUENCE, STRAIGHT),
        }
        for case, errors in cases
        for method in errors.methods
    ]


def wrenches(results: pl.DataFrame) -> list[Row]:
    """Return Table II for every vehicle: wrench errors by axis, and the single figures of the paper."""
    return [
        {
            "vehicle": case,
            "model": method,
            **{axis: errors.range(method, WRENCHES, [axis], 2) for axis in WRENCH},
            "all six": errors.error(method, WRENCHES, WRENCH),
            "MAE": errors.mean_absolute(method),
        }
        for case, errors in of_cases(results, "vehicles")
        for method in errors.methods
        if errors.sums(method, WRENCHES, WRENCH) is not None
    ]


def replays(results: pl.DataFrame) -> list[Row]:
    """Return Table III for every vehicle: velocity errors of a replay of 90 s, and those 5 s ahead."""
    return [
        {
            "vehicle": case,
            "model": method,
            **{axis: errors.range(method, SEQUENCE, [axis], 2) for axis in VELOCITY},
            "5 s, m/s": errors.error(method, AHEAD, STRAIGHT),
            "5 s, rad/s": errors.error(method, AHEAD, TURNING),
        }
        for case, errors in of_cases(results, "vehicles")
        for method in errors.methods
    ]


def recorded(results: pl.DataFrame) -> list[Row]:
    """Return the table of the real recording: errors 5 s ahead by axis, and relative to least squares."""
    return [
        {
            "model": method,
            **{axis: errors.error(method, AHEAD, [axis]) for axis in JUDGED},
            "ran away": errors.runaways(method),
            "u, v, w relative to least squares": errors.ratio(method, LEAST_SQUARES, AHEAD, STRAIGHT),
            "r relative to least squares": errors.ratio(method, LEAST_SQUARES, AHEAD, ["r"]),
        }
        for _, errors in of_cases(results, "recorded")
        for method in errors.methods
    ]


TABLES = {
    "future_memory": ("memory", memory),
    "future_wrench": ("vehicles", wrenches),
    "future_replay": ("vehicles", replays),
    "future_recorded": ("recorded", recorded),
}
"""Part and rows of each kept table."""


def keeps(results: pl.DataFrame, commit: str) -> None:
    """Keep the tables of the parts that have results."""
    for name, (part, rows) in TABLES.items():
        seeds = results.filter(pl.col("seed") >= 0, part=part).select("seed")
        if not seeds.is_empty():
            logs = " --logs FOLDER" if part == "recorded" else ""
            count = seeds["seed"].n_unique()
            where = origin(seeds, f"{COMMAND} {part}{logs} --seeds {count} -o future", commit)
            keep(name, [row | where for row in rows(results)])
