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


def test_both_quaternions_of_an_attitude_are_one_to_the_controller(craft):
    """The plant gives the one with w >= 0: at a heading of half a turn it changes from row to row."""
    control = Predictive.of(without_dead_bands(craft))
    pose = np.array([*place(0.0), np.cos(0.7), 0.0, 0.0, np.sin(0.7)])
    turned = pose * [1, 1, 1, -1, -1, -1, -1]
    still = np.zeros(6), np.zeros(8)
    control(0.0, pose, *still)
    before = control.plan, control.commands
    wanted = control(0.1, pose, *still)
    control.plan, control.commands = before
    np.testing.assert_allclose(control(0.1, turned, *still), wanted, atol=1e-9)
    assert control.solver.stats()["iter_count"] < 10
    assert control.unsolved == 0


def test_a_solution_that_does_not_converge_is_not_flown(craft):
    control = Predictive.of(without_dead_bands(craft))
    pose, still = np.array([*place(0.0), 1.0, 0.0, 0.0, 0.0]), (np.zeros(6), np.zeros(8))
    control(0.0, pose, *still)
    planned = control.plan[control.plan.size - 80 :].reshape(10, 8)
    solve = control.solver

    class Failing:
        def __call__(self, **given):
            return {"x": np.full(solve(**given)["x"].shape, 7.0)}

        def stats(self):
            return {"success": False}

    control.solver = Failing()
    np.testing.assert_array_equal(control(0.6, pose, *still), planned[2].clip(-1.0, 1.0))
    assert control.unsolved == 1


def test_a_row_leaves_out_the_beginning():
    t = 0.1 * np.arange(1, 201)
    late, errors = place(t - 1.0), np.where(t < 9.0, 1.0, 0.02)
    row = measured("late", late, errors)
    assert row["cross-track error, r.m.s. [m]"] == row["greatest [m]"] == "0.020"
    assert float(row["behind the moving point, r.m.s. [m]"]) == pytest.approx(SPEED, rel=0.05)
    assert row["not solved"] == "-"
