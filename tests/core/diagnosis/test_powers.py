"""Drag of a free power is named where it is one, and plain damping where that is what is missing."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
import synthetic
from recordings import DAMPING, moved, noisy

from hydro.core.diagnosis.pipeline import diagnose

ROWS, LONG = 1400, 2000  # 28 and 40 s at 50 Hz; only the longer one tells a free power from 2
STRONG = {"name": "power_drag", "diagonal": synthetic.QUADRATIC.tolist()}


def vehicle(*effects):
    bare = synthetic.vehicle()
    return msgspec.structs.replace(bare, effect=(*bare.effect, *effects))


def first(given, true, seed=0, rows=ROWS):
    """The first finding of a diagnosis of a vehicle file from a recording of the true vehicle."""
    return diagnose(given, noisy(moved(true, rows=rows, seed=seed), seed)).findings[0]


@pytest.mark.parametrize("hidden", DAMPING, ids=[effect["name"] for effect in DAMPING])
def test_linear_and_quadratic_damping_are_not_named_as_power_drag(hidden):
    """One of linear and quadratic damping is in the file, the other hidden."""
    found = first(vehicle(*(one for one in DAMPING if one is not hidden)), vehicle(*DAMPING))
    assert (found.verdict, found.effect) == ("missing", hidden["name"])


@pytest.mark.parametrize("seed", [0, 1])
def test_quadratic_damping_is_named_instead_of_power_drag_with_power_2(seed):
    found = first(vehicle(), vehicle(DAMPING[1]), seed, LONG)
    assert (found.verdict, found.members) == ("missing", ("quadratic_damping",))


@pytest.mark.parametrize("n", [1.5, 3.0])
def test_drag_of_another_power_is_named_with_its_power(n):
    """Beside the linear damping that the file has."""
    found = first(vehicle(DAMPING[0]), vehicle(DAMPING[0], {**STRONG, "n": n}))
    assert (found.verdict, found.effect) == ("missing", "power_drag")
    assert abs(found.parameters["n"] - n) <= 3.0 * found.standard_errors["n"]
    assert found.standard_errors["n"] < 0.2
    sizes, errors = (np.array(table["diagonal"]) for table in (found.parameters, found.standard_errors))
    assert (np.abs(sizes - synthetic.QUADRATIC) <= 4.0 * errors).all()
