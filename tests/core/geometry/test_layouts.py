"""Layouts of makers: ArduSub's numbers and directions, and their drawings."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

from hydro.core.geometry.layouts import laid_out
from hydro.core.logs.mixer import AXES, PRESETS

DOCS = Path(__file__).resolve().parents[3] / "docs"
FACTORS = {
    "bluerov2": [
        (0, 0, 1, 0, -1, 1),
        (0, 0, -1, 0, -1, -1),
        (0, 0, -1, 0, 1, 1),
        (0, 0, 1, 0, 1, -1),
        (1, 0, 0, -1, 0, 0),
        (-1, 0, 0, -1, 0, 0),
    ],
    "bluerov2_heavy": [
        (0, 0, 1, 0, -1, 1),
        (0, 0, -1, 0, -1, -1),
        (0, 0, -1, 0, 1, 1),
        (0, 0, 1, 0, 1, -1),
        (1, -1, 0, -1, 0, 0),
        (-1, -1, 0, -1, 0, 0),
        (1, 1, 0, -1, 0, 0),
        (-1, 1, 0, -1, 0, 0),
    ],
}
"""Signs of the motor factors roll, pitch, yaw, throttle, forward, lateral: ArduSub,
AP_Motors6DOF::setup_motors, frames VECTORED and VECTORED_6DOF. Throttle is up."""


def wrenches(layout: str) -> np.ndarray:
    """Signs of the wrench of a positive command, X Y Z K M N, of each thruster; what is small is 0."""
    rows = [
        [*one.direction, *np.cross(one.position, one.direction)]
        for one in laid_out(layout, 40.0, (0.46, 0.34, 0.25))
    ]
    return np.sign(np.where(np.abs(rows) < 1e-9, 0.0, rows))


@pytest.mark.parametrize("layout", FACTORS)
def test_a_thruster_pushes_where_ardusub_uses_it(layout):
    """A demand drives each motor by its factor; the sum of its thrusts must be along the demand."""
    roll, pitch, yaw, throttle, forward, lateral = np.array(FACTORS[layout], float).T
    expected = np.column_stack([forward, lateral, -throttle, roll, pitch, yaw])
    np.testing.assert_array_equal(wrenches(layout), expected)


@pytest.mark.parametrize(
    ("layout", "preset"), [("bluerov2", "ardusub_vectored"), ("bluerov2_heavy", "ardusub_vectored_6dof")]
)
def test_a_demand_through_the_mixer_of_the_map_moves_along_its_axis(layout, preset):
    made = wrenches(layout).T @ PRESETS[preset]
    order = [AXES.index(name) for name in ("surge", "sway", "heave", "roll", "pitch", "yaw")]
    made = made[:, order]
    np.testing.assert_array_equal(made, np.diag(np.diagonal(made)))
    demanded = np.abs(PRESETS[preset]).sum(axis=0)[order] > 0.0
    assert (np.diagonal(made)[demanded] > 0.0).all()


@pytest.mark.parametrize("layout", FACTORS)
def test_the_drawing_is_that_of_the_code(layout):
    made = runpy.run_path(str(DOCS / "draw_layouts.py"))["drawing"](layout)
    assert (DOCS / "images" / f"layout-{layout}.svg").read_text() == made, "run `make docs`"
