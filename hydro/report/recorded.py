"""What was recorded: sessions with their minutes and rates, and the noise of every channel."""

from __future__ import annotations

from typing import Any

import polars as pl

from hydro.core.recording.arrays import LEAST_NOISE
from hydro.report import words
from hydro.report.sources import Sources


def section(sources: Sources) -> dict[str, Any] | None:
    """Sessions and noise of the recording that the first comparison is with; None where nothing says."""
    if not sources.comparisons:
        return None
    frame = sources.comparisons[0].frame.filter(level="recording")
    if frame.is_empty():
        return None
    sessions = [
        (row["place"], words.figure(row["rows"] * row["rmse"] / 60.0), words.figure(1.0 / row["rmse"]))
        for row in frame.filter(by="session").iter_rows(named=True)
    ]
    minutes = frame.filter(by="session").select((pl.col("rows") * pl.col("rmse")).sum() / 60.0).item()
    channels = frame.filter(by="all")
    noise = [
        (
            row["axis"],
            words.figure(row["rmse"], 2) if row["rmse"] > LEAST_NOISE else "none found",
            row["unit"],
        )
        for row in channels.iter_rows(named=True)
    ]
    return {"sessions": sessions, "minutes": words.figure(minutes), "noise": noise}
