"""The benchmark of path tracking: its path, its controllers, and that they follow it."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("casadi", reason="the extra casadi is not installed")

from benchmarks.path_tracking import (
    ALONG,
    PATH,
    SPEED,
    Predictive,
    heading,
    measured,
    pilot,
    place,
    track,
    without_dead_bands,
)
from hydro.io import vehicle as files


@pytest.fixture(scope="module")
def craft(datasets):
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


def test_the_point_to_be_at_goes_along_a_closed_path_at_its_speed():
    t = np.linspace(0.0, 100.0, 2001)
    steps = np.linalg.norm(np.diff(place(t), axis=0), axis=1) / 0.05
    np.testing.assert_allclose(steps, SPEED, rtol=2e-3)
    np.testing.assert_allclose(place(ALONG[-1] / SPEED), PATH[0], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(heading(t), axis=1), 1.0)


def test_a_controller_is_where_it_is_to_be_and_the_pilot_behind(craft):
    control = Predictive.of(without_dead_bands(craft))
    positions, _ = track(craft, control, 4.0)
    by_hand, _ = track(craft, pilot(craft, 2.0), 4.0)
    away, behind = (np.linalg.norm(flown[-1] - place(4.0)) for flown in (positions, by_hand))
    assert away < 0.05 < 0.2 < behind
    assert control.unsolved == 0


def test_a_row_leaves_out_the_beginning():
    t = 0.1 * np.arange(1, 201)
    late, errors = place(t - 1.0), np.where(t < 9.0, 1.0, 0.02)
    row = measured("late", late, errors)
    assert row["cross-track error, r.m.s. [m]"] == row["greatest [m]"] == "0.020"
    assert float(row["behind the moving point, r.m.s. [m]"]) == pytest.approx(SPEED, rel=0.05)
    assert row["not solved"] == "-"
