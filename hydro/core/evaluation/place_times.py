"""Rows of a recording in which the conditions are met under which a model fails."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from hydro.core.columns import Mask, Rows
from hydro.core.evaluation import failure_regimes
from hydro.core.evaluation.regimes import Pieces, families
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle


def place_times(
    comparison: pl.DataFrame, vehicle: Vehicle, record: Recording, sessions: Sequence[str]
) -> dict[str, Rows]:
    """Return the stretches of a recording in which each ranked condition of a comparison is met.

    Args:
        comparison: Comparison table, see `evaluation.compare`.
        vehicle: Vehicle that was compared, for the positions and names of its thrusters.
        record: The recording that was compared.
        sessions: Name of each segment's session.

    Returns:
        By the words of each condition, such as "while turning left", its K stretches, the longest first, (K,
        2): first row, and row after the last.  "In all other motion", which is no condition, is left out.
    """
    wanted = set(comparison.filter(pl.col("rank").is_not_null())["place"].unique().to_list())
    motion, pieces = Motion.of(record), Pieces.of(record)
    found = families(record, vehicle, pieces, motion.eta, motion.nu, motion.nu_dot, list(sessions))
    masks = failure_regimes.find(wanted, found)
    return {words: _stretches(met, pieces, record.rows) for words, met in masks.items()}


def _stretches(met: Mask, pieces: Pieces, rows: int) -> Rows:
    """Return runs of consecutive pieces that meet a condition, as rows, (K, 2), the longest first.

    Args:
        met: Mask of the pieces that meet the condition, (P,).
        pieces: Pieces of the recording.
        rows: Number of rows of the recording.
    """
    ends = np.append(pieces.starts[1:], rows)
    taken = np.flatnonzero(met)
    if not taken.size:
        return np.zeros((0, 2), np.int64)
    cut = np.flatnonzero((np.diff(taken) > 1) | (np.diff(pieces.segment[taken]) != 0)) + 1
    runs = np.array([(pieces.starts[run[0]], ends[run[-1]]) for run in np.split(taken, cut)], np.int64)
    order = np.argsort(runs[:, 0] - runs[:, 1], kind="stable")
    return np.asarray(runs[order])
