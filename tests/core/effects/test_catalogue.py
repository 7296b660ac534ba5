"""The records, how a vehicle file's tables are read, and what is refused."""

from __future__ import annotations

import tomllib

import msgspec
import numpy as np
import pytest
from bench import ADDED, equipped
from hypothesis import given
from strategies import numbers, spd_matrices, vectors

from hydro.core.effects import CATALOGUE, added_mass_matrix, current, inertia_matrix, validate
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import skew

PHYSICS = [
    "added_mass",
    "added_mass_coupling",
    "added_mass_coriolis",
    "linear_damping",
    "quadratic_damping",
    "coupled_damping",
    "power_drag",
    "offset_drag",
    "crossflow_drag",
    "body_lift",
    "control_surface",
    "ellipsoid_drag",
    "net_buoyancy",
    "buoyancy_offset",
    "payload",
    "drifting_ballast",
    "ocean_current",
    "current_shear",
    "current_trend",
    "tether",
    "surface_suction",
    "fluid_memory",
    "thruster_gain",
    "thruster_asymmetry",
    "thruster_lag",
    "command_delay",
    "thruster_deadband",
    "thruster_curve",
    "thruster_inflow",
    "propeller_torque",
    "sensor_scale",
    "sensor_misalignment",
    "sensor_delay",
    "sensor_lever_arm",
    "reference_point",
    "sensor_bias",
]


def test_the_catalogue_has_the_design_s_table():
    assert set(CATALOGUE) >= set(PHYSICS)


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=CATALOGUE)
def test_every_record_is_whole(effect):
    assert effect.definition
    assert effect.source
    assert effect.excitation
    assert effect.description
    for called in filter(None, (effect.kernel, effect.inertia, effect.actuator, effect.sensor)):
        assert "arguments as in `layout`" in str(called.__doc__)
    assert "arguments as in" not in effect.description
    assert effect.name not in effect.lookalikes
    assert set(effect.lookalikes) <= set(CATALOGUE)
    assert set(effect.one_of) <= {p.name for p in effect.parameters}
    for parameter in effect.parameters:
        assert parameter.meaning
        assert len(parameter.unit) in (1, 2, 3)
        assert parameter.low <= 0.0 <= parameter.high or parameter.required
    by_kind = {
        "wrench": "kernel",
        "inertia": "inertia",
        "flow": "flow",
        "actuator": "actuator",
        "sensor": "sensor",
    }
    assert getattr(effect, by_kind[effect.kind]) is not None


@given(spd_matrices(), vectors(6, 50.0).map(np.abs), vectors(5, 2.0))
def test_inertia_is_the_symmetric_sum(matrix, diagonal, couplings):
    pairs = ((1, 5), (2, 4), (0, 4), (1, 3), (0, 2))
    expected = matrix + np.diag(diagonal)
    for value, (i, j) in zip(couplings, pairs, strict=True):
        expected[i, j] += value
        expected[j, i] += value
    vehicle = equipped(
        {"name": "added_mass", "matrix": matrix.tolist()},
        {"name": "added_mass", "diagonal": diagonal.tolist()},
        {
            "name": "added_mass_coupling",
            **{f"M{i}{j}": float(v) for v, (i, j) in zip(couplings, pairs, strict=True)},
        },
    )
    np.testing.assert_allclose(inertia_matrix(vehicle), expected, rtol=1e-14)
    np.testing.assert_array_equal(inertia_matrix(vehicle), inertia_matrix(vehicle).T)


@given(vectors(3), numbers(0.0, 30.0), vectors(6))
def test_payload_mass_has_the_kinetic_energy_of_a_point(place, mass, nu):
    vehicle = equipped({"name": "payload", "mass": mass, **dict(zip("xyz", place.tolist(), strict=True))})
    velocity = nu[:3] + skew(nu[3:]) @ place
    energy = 0.5 * nu @ inertia_matrix(vehicle) @ nu
    assert energy == pytest.approx(0.5 * mass * velocity @ velocity, abs=1e-9)
    assert not added_mass_matrix(vehicle).any()


def test_currents_add():
    vehicle = equipped(
        {"name": "ocean_current", "v_N": 0.3}, {"name": "ocean_current", "v_N": 0.1, "v_D": -0.2}
    )
    np.testing.assert_allclose(current(vehicle), [0.4, 0.0, -0.2, 0.0, 0.0, 0.0, 0.0])
    more = [
        {"name": "current_shear", "g_N": 0.1, "z_0": 4.0},
        {"name": "current_shear", "g_E": 0.2},
        {"name": "current_trend", "a_E": -0.01, "t_0": 30.0},
    ]
    expected = [0.0, 0.3, -0.2, 0.1, 0.2, 0.0, -0.01]
    np.testing.assert_allclose(current(equipped(*vehicle.effect, *more)), expected)


REFUSED = [
    ({"name": "added_mas"}, r"effect\[0\]\.name: 'added_mas' is not in the catalogue"),
    ({}, r"effect\[0\]\.name: None"),
    ({"name": "added_mass"}, r"effect\[0\]: added_mass needs exactly one of diagonal, matrix"),
    ({"name": "added_mass", "diagonal": [1.0] * 6, "matrix": np.eye(6).tolist()}, "exactly one"),
    ({"name": "added_mass", "diagonal": [1.0] * 5}, r"effect\[0\]\.diagonal: must be an array of 6 numbers"),
    ({"name": "added_mass", "diagonal": [1.0] * 5 + ["1"]}, "array of 6 numbers"),
    ({"name": "added_mass", "diagonal": [True] * 6}, "array of 6 numbers"),
    ({"name": "added_mass", "diagonal": 3.0}, "array of 6 numbers"),
    ({"name": "added_mass", "matrix": [[1.0] * 6] * 5 + [[1.0] * 5]}, "array of 6 x 6 numbers"),
    ({"name": "added_mass", "diagonal": [1.0] * 5 + [float("nan")]}, "must be finite"),
    ({"name": "added_mass", "diagonal": [1.0] * 5 + [-1.0]}, "positive semi-definite"),
    ({"name": "added_mass", "matrix": (np.eye(6) + np.eye(6, k=1)).tolist()}, r"symmetric: M_A\[0,1\]"),
    ({"name": "added_mass_coupling", "M15": 4.0}, "added mass in sum must be positive semi-definite"),
    (
        {"name": "added_mass_coupling", "M51": 4.0},
        r"effect\[0\]\.M51: added_mass_coupling has no such parameter",
    ),
    ({"name": "quadratic_damping"}, r"effect\[0\]\.diagonal: is missing"),
    ({"name": "linear_damping", "diagonal": [-1.0] * 6}, "linear damping .* positive semi-definite"),
    ({"name": "quadratic_damping", "diagonal": [-1.0] * 6}, "quadratic damping in sum must not be below 0"),
    ({"name": "coupled_damping", "D15": 1.0}, "positive semi-definite"),
    ({"name": "crossflow_drag", "Cd_y": -0.1}, "cross-flow drag in sum"),
    ({"name": "tether", "k": -1.0, "anchor": [0, 0, 0]}, r"\.k: must lie within \[0, inf\]"),
    ({"name": "tether", "k": 1.0}, r"\.anchor: is missing"),
    ({"name": "surface_suction", "A": 1.0, "decay": 0.0}, r"\.decay: must lie within"),
    (
        {"name": "fluid_memory", "K": [[1.0] * 6], "rates": [1.0, 2.0]},
        r"\.rates: must be an array of 1 numbers",
    ),
    ({"name": "fluid_memory", "K": [1.0] * 6, "rates": [1.0]}, r"\.K: must be an array of"),
    ({"name": "fluid_memory", "K": [[-1.0] * 6], "rates": [1.0]}, r"\.K: must lie within"),
    ({"name": "payload", "w": 1.0, "mass": -1.0}, r"\.mass: must lie within"),
    ({"name": "power_drag", "diagonal": [1.0] * 6}, r"\.n: is missing"),
    ({"name": "power_drag", "diagonal": [1.0] * 6, "n": 0.5}, r"\.n: must lie within \[1, 3.5\]"),
    ({"name": "power_drag", "diagonal": [-1.0] * 6, "n": 1.5}, r"\.diagonal: must lie within \[0, inf\]"),
    ({"name": "offset_drag", "drag": [-1.0, 0.0, 0.0]}, r"\.drag: must lie within \[0, inf\]"),
    ({"name": "control_surface", "area": 0.1}, r"\.stall: is missing"),
    ({"name": "control_surface", "area": -0.1, "stall": 0.3}, r"\.area: must lie within \[0, inf\]"),
    ({"name": "propeller_torque", "k": [0.1] * 3}, r"\.k: must be an array of 2 numbers"),
    ({"name": "thruster_gain", "g": [0.1] * 3}, r"\.g: must be an array of 2 numbers"),
    ({"name": "thruster_lag", "dT": -0.3}, "time constant in sum"),
    ({"name": "command_delay", "d": -0.1}, "delay in sum"),
    ({"name": "thruster_deadband", "d": -0.1}, "dead band in sum"),
    ({"name": "thruster_deadband", "d": 0.97}, "dead band in sum"),
    ({"name": "thruster_curve", "da": -2.0}, "power of the thrust curve in sum"),
    ({"name": "sensor_scale"}, "exactly one of s, axes"),
]


@pytest.mark.parametrize(("effect", "message"), REFUSED, ids=[str(i) for i in range(len(REFUSED))])
def test_what_is_refused(effect, message):
    with pytest.raises(DataError, match=message):
        validate(equipped(effect))


def test_increments_below_zero_are_fine_where_the_sum_is():
    validate(
        equipped(
            ADDED,
            {"name": "added_mass", "diagonal": [-9.0] + [0.0] * 5},
            {"name": "added_mass_coupling", "M15": -20.0},
            {"name": "linear_damping", "diagonal": [5.0, 10.0, 10.0, 2.0, 5.0, 5.0]},
            {"name": "linear_damping", "diagonal": [-5.0, -1.0, 0.0, 0.0, 0.0, 0.0]},
            {"name": "coupled_damping", "D15": 3.0, "D51": -40.0 + 37.5},
            {"name": "thruster_lag", "dT": 0.1},
            {"name": "thruster_deadband", "d": 0.02},
        )
    )


def test_what_a_fit_leaves_beside_the_values_is_no_parameter():
    fitted = {"name": "net_buoyancy", "dB": 2.0, "standard_error": {"dB": 0.1}, "fit": {"data": "sha256:0"}}
    validate(equipped(fitted))


def test_rounding_is_forgiven_and_no_more():
    for error, refused in ((1e-11, False), (1e-6, True)):
        matrix = np.diag([10.0, 60.0, 70.0, 1.0, 8.0, 9.0])
        matrix[0, 4] = 60.0 * error
        vehicle = equipped({"name": "added_mass", "matrix": matrix.tolist()})
        if refused:
            with pytest.raises(DataError, match="symmetric"):
                validate(vehicle)
        else:
            validate(vehicle)


def test_the_presets_are_valid(datasets):
    paths = sorted((datasets / "vehicles").glob("*.toml"))
    assert {path.stem for path in paths} >= {"auv151", "stonefish", "bluerov2_heavy", "remus100"}
    for path in paths:
        validate(msgspec.convert(tomllib.loads(path.read_text()), Vehicle))
