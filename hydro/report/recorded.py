"""Recordings of a report: sessions with their minutes and rates, and the noise of every channel."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import polars as pl

from hydro.core.recording.arrays import LEAST_NOISE
from hydro.report import words
from hydro.report.sources import Sources


def section(sources: Sources) -> dict[str, Any] | None:
    """Return the section of the page on the recordings, as values for the page's template.

    Returns:
        A dict with `groups` (recordings, with minutes and number of sessions), `sessions` (with minutes and
        rate), and `noise` of the sensors of the recording that was fitted; None without any of them.
    """
    listed, noise = _listed(sources), list(_noise(sources))
    if listed.is_empty() and not noise:
        return None
    minutes = pl.col("rows") * pl.col("sample_time") / 60.0
    groups = [
        {
            "name": words.DATASETS[str(name)],
            "minutes": words.figure(float(one["minutes"].sum())),
            "count": one.height,
        }
        for (name,), one in listed.with_columns(minutes=minutes).group_by("dataset", maintain_order=True)
    ]
    sessions = [
        {
            "on": words.DATASETS[row["dataset"]],
            "name": row["session"],
            "minutes": words.figure(row["rows"] * row["sample_time"] / 60.0),
            "rate": words.figure(1.0 / row["sample_time"]),
        }
        for row in listed.iter_rows(named=True)
    ]
    return {"groups": groups, "sessions": sessions, "noise": noise}


def sample_time(sources: Sources) -> float:
    """Return the sample time of the report's recording [s]; NaN if it is not known."""
    listed = _listed(sources)
    return math.nan if listed.is_empty() else float(listed["sample_time"][0])


def _of_recording(sources: Sources) -> pl.DataFrame:
    """Return the rows of the first comparison that describe the recording itself."""
    if not sources.comparisons:
        return pl.DataFrame(schema={"by": pl.String})
    return sources.comparisons[0].frame.filter(level="recording")


def _listed(sources: Sources) -> pl.DataFrame:
    """Return the sessions of all recordings: `dataset`, `rows` and `sample_time` [s] of each."""
    if sources.sessions is not None:
        return sources.sessions.frame
    rows = _of_recording(sources).filter(by="session")
    if rows.is_empty():
        return rows
    return rows.select(
        pl.lit("fit").alias("dataset"), pl.col("place").alias("session"), "rows", sample_time="rmse"
    )


def _noise(sources: Sources) -> Iterator[tuple[str, str, str]]:
    """Yield each channel, its noise and its unit."""
    for row in _of_recording(sources).filter(by="all").iter_rows(named=True):
        size = words.figure(row["rmse"], 2) if row["rmse"] > LEAST_NOISE else f"< {LEAST_NOISE:g}"
        yield row["axis"], size, row["unit"]
