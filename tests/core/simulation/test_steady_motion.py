"""Limits of excitation: where the water overturns a vehicle."""

from __future__ import annotations

import numpy as np
import pytest

from hydro.core.effects import assemble
from hydro.core.simulation.dynamics import NO_HULL
from hydro.core.simulation.steady_motion import MARGIN, MOST_TILT, TURN_RATE, fluid_wrench, wrench_limits
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Vehicle
from hydro.core.vehicle.ellipsoid import added_mass_matrix
from hydro.core.vehicle.panels import loaded_facets, panels, superellipsoid

DRAG = (50.0, 90.0, 150.0, 4.0, 20.0, 10.0)


def craft(*effects):
    return Vehicle(
        name="test",
        rigid_body=RigidBody(100.0, (0, 0, 0.05), ((5.0, 0, 0), (0, 10.0, 0), (0, 0, 12.0))),
        buoyancy=Buoyancy(981.0, (0.0, 0.0, 0.0)),
        hull=Hull(1.5, 0.5, 0.4),
        effect=effects,
    )


def test_limits_are_the_drag_at_the_munk_moments_critical_speed():
    """Pitch ahead: (M_33 - M_11) u^2 = K; roll in sway: (M_33 - M_22) v^2 = K; heave is stable."""
    M_A = np.diag([20.0, 80.0, 140.0, 1.0, 9.0, 8.0])
    program = assemble(
        craft(
            {"name": "added_mass", "matrix": M_A.tolist()},
            {"name": "quadratic_damping", "diagonal": list(DRAG)},
            {"name": "net_buoyancy", "dB": 25.0},
        )
    )
    roll, pitch = 70.0, 110.0
    limits = wrench_limits(program, NO_HULL, np.array([roll, pitch]))
    ahead, sideways = pitch / (140.0 - 20.0), roll / (140.0 - 80.0)
    expected = [DRAG[0] * MARGIN**2 * ahead, DRAG[1] * MARGIN**2 * sideways, np.inf]
    np.testing.assert_allclose(limits[:3], expected, rtol=1e-4)
    np.testing.assert_allclose(limits[3:], [MOST_TILT * roll, MOST_TILT * pitch, DRAG[5] * TURN_RATE**2])


def test_a_neutral_body_has_no_critical_speed():
    limits = wrench_limits(assemble(craft()), NO_HULL, np.array([10.0, 10.0]))
    assert np.isinf(limits[:3]).all()


def test_without_righting_moment_there_is_nothing_to_lose():
    M_A = added_mass_matrix((0.75, 0.25, 0.2), 1025.0, (0, 0, 0))
    program = assemble(craft({"name": "added_mass", "matrix": M_A.tolist()}))
    assert np.isinf(wrench_limits(program, NO_HULL, np.zeros(2))[:5]).all()


def test_fluid_wrench_is_panels_effects_and_the_munk_moment():
    M_A = added_mass_matrix((0.75, 0.25, 0.2), 1025.0, (0, 0, 0))
    facets = loaded_facets(panels(*superellipsoid(1.5, 0.5, 0.4)), 1025.0)
    program = assemble(craft({"name": "added_mass", "matrix": M_A.tolist()}))
    nu = np.array([1.0, 0.5, 0, 0, 0, 0])
    munk = (M_A[0, 0] - M_A[1, 1]) * nu[0] * nu[1]
    without_hull = fluid_wrench(program, NO_HULL, nu)
    assert without_hull == pytest.approx([0, 0, 0, 0, 0, munk])
    assert fluid_wrench(program, facets, nu)[0] < 0
