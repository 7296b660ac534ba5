"""A figure is first a table, which is tested here; the drawing must then come out as a picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from matplotlib.image import imread

from hydro.report import figures


def replay_table(rows: int = 400) -> pl.DataFrame:
    """A measured motion and two variants, one of which runs away, over two sessions."""
    t = np.arange(rows) / 50.0
    blocks = []
    for session in ("first", "second"):
        for variant, gain in (("MJ0", 40.0), ("MJ4", 1.0), ("measured", 1.0)):
            velocities = {name: gain * np.sin(t + k) for k, name in enumerate("uvwpqr")}
            blocks.append(pl.DataFrame({"session": session, "t": t + 7.0, "variant": variant, **velocities}))
    return pl.concat(blocks)


ERRORS = pl.DataFrame(
    {"variant": ["MJ0", "MJ4"], **{axis: [1.0 + k, 0.01 + k / 100] for k, axis in enumerate("uvwpqr")}}
)


def test_overlay_draws_the_first_session_from_time_zero() -> None:
    table = figures.overlay_table(replay_table(), axes=("u", "w"))
    assert table.columns == ["axis", "variant", "t", "value", "lost", "bottom", "top"]
    assert table.filter(pl.col("variant") != "MJ0").height == 2 * 2 * 400
    assert table["t"].min() == 0.0
    heave = table.filter(pl.col("axis") == "w", pl.col("variant") == "measured")
    assert np.allclose(heave["value"], np.sin(heave["t"].to_numpy() + 2))


def test_axis_limits_follow_the_measured_motion() -> None:
    surge = figures.overlay_table(replay_table(), axes=("u",))
    measured = surge.filter(pl.col("variant") == "measured")["value"]
    low, high = measured.min(), measured.max()
    assert isinstance(low, float)
    assert isinstance(high, float)
    margin = figures.HEADROOM * (high - low)
    assert surge["bottom"].unique().to_list() == pytest.approx([low - margin])
    assert surge["top"].unique().to_list() == pytest.approx([high + margin])


def test_a_curve_ends_where_its_error_first_exceeds_the_measured_range() -> None:
    surge = figures.overlay_table(replay_table(), axes=("u",))
    t = surge.filter(pl.col("variant") == "measured")["t"].to_numpy()
    measured = np.sin(t)
    error = 39.0 * np.abs(measured)
    first = int(np.argmax(error > measured.max() - measured.min()))
    lost = surge.filter(pl.col("variant") == "MJ0")
    assert lost.height == first + 1
    assert lost["lost"].to_list() == [False] * first + [True]
    assert not surge.filter(pl.col("variant") != "MJ0")["lost"].any()


def test_long_series_are_thinned_evenly() -> None:
    table = figures.overlay_table(replay_table(rows=3 * figures.POINTS_IN_PRINT), axes=("u",))
    counts = dict(table.group_by("variant").len().rows())
    assert counts["measured"] == counts["MJ4"] == figures.POINTS_IN_PRINT
    steps = np.diff(table.filter(pl.col("variant") == "MJ4")["t"].to_numpy())
    assert np.allclose(steps, 3 / 50)


def test_pictures_have_the_same_bytes_every_time(tmp_path: Path) -> None:
    overlay = figures.overlay_table(replay_table())
    for name, draw in {
        "a": lambda: figures.draw_overlay(overlay),
        "b": lambda: figures.draw_errors(ERRORS),
    }.items():
        figures.save(draw(), tmp_path / f"{name}.png")
        figures.save(draw(), tmp_path / f"{name}-again.png")
        picture = imread(tmp_path / f"{name}.png")
        assert picture.shape[1] > 600
        assert picture[..., :3].std() > 0.05, "nothing was drawn"
        assert (tmp_path / f"{name}.png").read_bytes() == (tmp_path / f"{name}-again.png").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "a-again.png",
        "a.png",
        "b-again.png",
        "b.png",
    ]


def test_errors_that_are_not_numbers_are_drawn_as_a_dash() -> None:
    table = pl.DataFrame({"variant": ["MJ0", "MJ4"], "u": [float("nan"), 0.25], "p": [1.5e6, 0.0]})
    figure = figures.draw_errors(table)
    texts = [text.get_text() for panel in figure.axes for text in panel.texts]
    assert texts == ["–", "0.250", "1.5e+06", "0.00"]
