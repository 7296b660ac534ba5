"""The picture of a recording: the rows that it draws, and panels for the sensors that there are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from matplotlib.image import imread

from hydro.report import figures
from hydro.report.overview import draw, overview


def recording(seconds: float = 20.0, **nothing: None) -> pl.DataFrame:
    """Two sessions of a circle at 10 Hz, the second with a gap; columns in `nothing` have no samples."""
    t = np.arange(0.0, seconds, 0.1)
    names = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r", "cmd_1")
    values = {name: np.sin(t + number) for number, name in enumerate(names)}
    one = pl.DataFrame({"session": "one", "t": t, **values}).with_columns(pl.col(names).cast(pl.Float32))
    two = one.with_columns(session=pl.lit("two")).filter((pl.col("t") < 5.0) | (pl.col("t") > 9.0))
    empty = {name: pl.lit(None, pl.Float32) for name in nothing}
    return pl.concat([one, two]).with_columns(**empty)


def test_sessions_are_drawn_in_sequence_with_gaps_left_open() -> None:
    raw = recording()
    rows = overview(raw)
    holes = rows["t"].is_null()
    assert holes.sum() == 3  # behind the first session, in the gap, and at the end
    assert rows.filter(~holes).height == raw.height
    clock = rows.filter(~holes)["clock"]
    assert (clock.diff().drop_nulls() > 0.0).all()
    assert clock[0] == 0.0
    assert clock[-1] == pytest.approx(19.9 + 0.1 + 19.9)
    assert rows.filter(holes)["x"].null_count() == 3


def test_a_long_recording_is_thinned_to_means() -> None:
    raw = recording(3000.0)
    rows = overview(raw).drop_nulls("t")
    assert rows.height < 1.01 * figures.POINTS_IN_PRINT
    assert rows.height > 0.9 * figures.POINTS_IN_PRINT
    first = raw.head(20)
    assert rows["x"][0] == pytest.approx(first["x"].mean(), abs=1e-6)
    assert rows["cmd_1"][0] == first["cmd_1"][0]


@pytest.mark.parametrize(
    ("missing", "titles"),
    [
        ((), ["Track (dot: start)", "Depth", "Velocity over ground, body axes", "Attitude"]),
        (("x", "y", "u", "v", "w"), ["Depth", "Attitude", "Angular velocity, body axes"]),
        (("x", "y", "z", "u", "v", "w", "phi", "theta", "psi"), ["Angular velocity, body axes"]),
    ],
)
def test_only_measured_channels_have_panels(
    missing: tuple[str, ...], titles: list[str], tmp_path: Path
) -> None:
    drawn = draw(overview(recording(**dict.fromkeys(missing))), "dive.bag")
    found = [panel.get_title(loc="left") for panel in drawn.axes]
    assert found[: len(titles)] == titles
    assert found[-1] == "Commands of the thrusters"
    figures.save(drawn, tmp_path / "recording.png")
    assert imread(tmp_path / "recording.png").shape[1] > 600


def test_depth_grows_downward() -> None:
    drawn = draw(overview(recording()), "dive.bag")
    depth = next(panel for panel in drawn.axes if panel.get_title(loc="left") == "Depth")
    bottom, top = depth.get_ylim()
    assert bottom > top
