"""Symbolic tracing of scalar code: equal to the numeric result on both sides of every branch."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from hydro.core.errors import HydroError
from hydro.core.vehicle import thrusters
from hydro.export import equations
from hydro.export.casadi_function import Symbols
from hydro.export.tracing import Tracer

ca = pytest.importorskip("casadi", reason="the extra casadi is not installed")


def branches(x, y, out):
    """Nested branches, an early return, `or`, a modified list, and several return values."""
    size, sign = abs(x), 1.0
    if x < 0.0:
        sign = -1.0
        if y > 1.0 or x < -2.0:
            out[0] += 10.0
        else:
            out[1] = x
    if size == 0.0 or not y < 3.0:
        return -1.0, sign
    for i in range(3):
        if i == 2:
            break
        out[i] += sign * y if y > 0.0 and x > 1.0 else i
    return math.sqrt(size) / size, sign


def forever(x):
    """Loop whose length is a symbol."""
    for i in range(3):
        if x > i:
            break
    return i


def unknown(x):
    """Function that is not scalar code."""
    with open(x) as file:
        return file


@pytest.fixture
def tracer(monkeypatch):
    monkeypatch.setattr("hydro.export.tracing.is_ours", lambda value: callable(value) and value in OURS)
    return Tracer(Symbols())


OURS = (branches, forever, unknown, thrusters.static_thrust, thrusters.raised)


def test_every_branch_is_the_one_that_python_takes(tracer):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    out = [1.0, 2.0, 3.0]
    value, sign = tracer.call(branches, x, y, out)
    traced = ca.Function("traced", [x, y], [ca.vertcat(value, sign, *out)])
    for a, b in itertools.product((-3.0, -1.0, 0.0, 0.5, 2.0), (-1.0, 0.5, 2.0, 3.0)):
        expected = [1.0, 2.0, 3.0]
        first = branches(a, b, expected)
        np.testing.assert_allclose(np.array(traced(a, b)).ravel(), [*first, *expected], err_msg=f"{a} {b}")


def test_known_values_stay_known(tracer):
    out = [1.0, 2.0, 3.0]
    assert tracer.call(branches, 2.0, 1.0, out) == branches(2.0, 1.0, [1.0, 2.0, 3.0])
    assert out == [2.0, 3.0, 3.0]


@pytest.mark.parametrize("style", [0.0, 1.0])
def test_a_dead_band_is_one_on_symbols(tracer, style):
    row = [0.0] * thrusters.COLUMNS
    row[thrusters.MAX_THRUST], row[thrusters.MAX_REVERSE], row[thrusters.POWER] = 80.0, 60.0, 1.5
    row[thrusters.DEADBAND], row[thrusters.SHIFT] = 0.1, style
    n = ca.SX.sym("n")
    traced = ca.Function("traced", [n], [tracer.call(thrusters.static_thrust, row, n)])
    for value in (-1.0, -0.3, -0.1, 0.0, 0.05, 0.1, 0.11, 1.0):
        expected = thrusters.static_thrust(np.array(row), value)
        assert float(traced(value)) == pytest.approx(expected, abs=1e-12)


def test_a_table_is_one_on_symbols():
    points, values = [-1.0, -0.2, 0.0, 0.5, 1.0], [-40.0, -1.0, 0.0, 10.0, 50.0]
    x = ca.SX.sym("x")
    traced = ca.Function("traced", [x], [Tracer(Symbols()).call(equations.interpolated, x, points, values)])
    for at in (-2.0, -1.0, -0.7, -0.2, 0.0, 0.3, 1.0, 1.5):
        assert float(traced(at)) == pytest.approx(np.interp(at, points, values), abs=1e-12)


def test_what_is_no_scalar_code_is_refused(tracer):
    with pytest.raises(HydroError, match="a loop that ends on a symbolic condition"):
        tracer.call(forever, ca.SX.sym("x"))
    with pytest.raises(HydroError, match="cannot be run on symbols"):
        tracer.call(unknown, ca.SX.sym("x"))
