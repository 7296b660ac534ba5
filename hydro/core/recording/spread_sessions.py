"""Part of a long recording: whole sessions, evenly spread."""

from __future__ import annotations

import numpy as np
import polars as pl

from hydro.core.recording.segments import sessions


def spread_sessions(frame: pl.DataFrame, seconds: float) -> pl.DataFrame:
    """Return whole sessions of a recording, evenly spread over it, of at most `seconds` in total.

    They are as many as fit.  Where not even one fits, it is the first part of one, with rotors at rest in its
    first row.  A recording that is not longer than `seconds` is returned unchanged.

    Args:
        frame: A table with `session` and `t` [s].
        seconds: Maximum total length [s].

    Raises:
        DataError: The clock of the table has errors, see `segments.sessions`.
    """
    listed = sessions(frame)
    rows, most = listed["rows"].to_numpy(), int(seconds / listed["sample_time"][0])
    if rows.sum() <= most:
        return frame
    spread = (((np.arange(n) + 0.5) * len(rows) / n).astype(int) for n in range(len(rows), 0, -1))
    places = next((some for some in spread if rows[some].sum() <= most), np.array([len(rows) // 2]))
    chosen = listed["session"].gather(places)
    return frame.filter(pl.col("session").is_in(chosen.implode())).head(most)
