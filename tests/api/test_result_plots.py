"""Plots of results: axes with labels and units, of the numbers in the table, in the user's own axes too."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import made_results as made
import matplotlib as mpl
import numpy as np
import polars as pl
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import hydro
from hydro.core.errors import UsageError

COUNTS = {"diagnosis": 2, "comparison": 2, "fit": 2, "study": 1}


@pytest.fixture(autouse=True)
def no_window() -> Iterator[None]:
    before = mpl.get_backend()
    mpl.use("Agg")
    yield
    pyplot.close("all")
    mpl.use(before)


@pytest.fixture(params=COUNTS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def values(axes: Axes) -> set[float]:
    """Numbers of all lines of a panel, across and up."""
    return {float(one) for line in axes.get_lines() for one in np.ravel(line.get_data())}


def test_axes_have_labels_with_units(kind: str) -> None:
    axes = made.every()[kind].plot()
    assert axes.shape == (COUNTS[kind],)
    for one in axes:
        assert isinstance(one, Axes)
        assert one.get_xlabel()
        assert "[" in one.get_xlabel() + one.get_ylabel()
        ticks = one.get_xticklabels() + one.get_yticklabels()
        assert all(label.get_text() for label in ticks)
        assert one.figure is axes[0].figure
    axes[0].figure.canvas.draw()


def test_it_draws_into_the_users_axes_and_makes_no_figure(kind: str) -> None:
    own = Figure().subplots(1, COUNTS[kind], squeeze=False)[0]
    given: Any = own[0] if COUNTS[kind] == 1 else list(own)
    found = made.every()[kind].plot(given)
    assert list(found) == list(own)
    assert all(one.has_data() for one in own)
    assert pyplot.get_fignums() == []
    own[0].figure.canvas.draw()


def test_too_few_or_too_many_axes_are_refused(kind: str) -> None:
    own = Figure().subplots(1, COUNTS[kind] + 1, squeeze=False)[0]
    with pytest.raises(UsageError, match=f"{COUNTS[kind]} axes, but {COUNTS[kind] + 1}"):
        made.every()[kind].plot(own)


def test_what_is_drawn_stands_in_the_table() -> None:
    translation, rotation = made.comparison().plot()
    assert [one.get_text() for one in translation.get_xticklabels()] == ["u", "v", "w", "all"]
    assert [one.get_text() for one in rotation.get_xticklabels()] == ["p", "q", "r"]
    assert {0.01, 2.0, 4.0, 6.0} <= values(translation)
    assert translation.get_ylabel() == "error, 5 s ahead [m/s]"
    assert rotation.get_ylabel() == "error, 5 s ahead [rad/s]"
    assert {one.get_text() for one in translation.figure.legends[0].get_texts()} == {
        "model",
        "noise floor",
        "least squares",
        "zero velocity",
    }
    (ladder,) = made.study().plot()
    assert {0.2, 0.3, 1.8, 2.0, 0.02} <= values(ladder)
    assert [one.get_text() for one in ladder.get_xticklabels()] == ["0: as given", "1: ocean current"]
    errors, shares = made.diagnosis().plot()
    assert [bar.get_width() for bar in errors.patches] == [0.121, 0.05]
    assert {41.0, 20.0} <= values(shares)
    assert shares.get_yticklabels()[0].get_text() == "new effect:\nocean current"
    force, moment = made.fit().plot()
    assert force.get_xlabel() == "value [N s/m], 95 % interval"
    assert moment.get_xlabel() == "value [N m s], 95 % interval"
    assert set(made.fit().values) <= values(force) | values(moment)
    assert [one.get_text() for one in moment.get_legend().get_texts()] == ["not determined"]


def test_a_diagnosis_without_predictions_has_one_panel() -> None:
    (shares,) = made.diagnosis(prediction=None).plot()
    assert "[%]" in shares.get_xlabel()


def test_where_nothing_is_missing_the_panel_says_so() -> None:
    unchanged = replace(made.PREDICTION, added=made.PREDICTION.given, floor=None)
    errors, shares = made.diagnosis((made.NOTHING,), unchanged).plot()
    assert [bar.get_width() for bar in errors.patches] == [0.121]
    assert "no finding explains" in shares.texts[0].get_text()
    shares.figure.canvas.draw()


def test_a_recording_without_velocities_is_drawn_by_its_pose() -> None:
    table = made.comparison().table
    rows = table.filter(axis="pose")
    angles = [rows.with_columns(axis=pl.lit(name), unit=pl.lit("rad")) for name in ("phi", "theta", "psi")]
    places = [rows.with_columns(axis=pl.lit(name)) for name in "xyz"]
    apart, turned = hydro.Comparison(pl.concat([*places, *angles, rows])).plot()
    assert [one.get_text() for one in apart.get_xticklabels()] == ["x", "y", "z", "pose"]
    assert [one.get_text() for one in turned.get_xticklabels()] == ["phi", "theta", "psi"]
    assert turned.get_ylabel().endswith("[rad]")


def test_wide_errors_are_drawn_on_a_logarithmic_axis() -> None:
    table = made.comparison().table
    assert made.comparison().plot()[0].get_yscale() == "log"
    near = hydro.Comparison(table.with_columns(noise_floor=0.9 * pl.col("rmse")))
    assert near.plot()[0].get_yscale() == "linear"
    assert near.plot()[0].get_ylim()[0] == 0.0
