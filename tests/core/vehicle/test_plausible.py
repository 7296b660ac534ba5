"""Plausible ranges against closed forms, every bundled vehicle file, and what was seen to be absurd."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from scipy.integrate import quad

from hydro.core.effects import CATALOGUE, describe
from hydro.core.effects.catalogue import implausible
from hydro.core.vehicle.plausible import BOOMS, MOST_DRAG, displaced_mass, most_added, most_drag
from hydro.io import vehicle as files
from hydro.io.files import bundled

PRESETS = sorted((bundled("vehicles")).glob("*.toml"))
EVERY = [(name, parameter) for name, effect in CATALOGUE.items() for parameter in effect.parameters]


def preset(name: str = "bluerov2_heavy"):
    return files.read(bundled("vehicles") / f"{name}.toml")[0]


def with_effect(**table):
    """A BlueROV2 with one effect alone."""
    return msgspec.structs.replace(preset(), effect=(table,))


def faults_of_range(name, parameter, vehicle):
    """Yield what is wrong with the plausible range of a parameter."""
    believed = parameter.plausible
    if believed is None or not believed.words or not believed.source:
        yield "has no range with words and a source"
        return
    neutral = tomllib.loads(describe.toml(CATALOGUE[name], 8))["effect"][0]
    for index in np.ndindex(*(n if isinstance(n, int) else 1 for n in parameter.shape)):
        low, high = believed.at(index, vehicle)
        if not (low < high and math.isfinite(high - low)):
            yield f"{index}: {low} to {high} is no finite range"
        if not (high > parameter.low and low < parameter.high):
            yield f"{index}: {low} to {high} lies outside the admissible values"
        value = np.asarray(neutral[parameter.name], float)[index] if parameter.name in neutral else low
        if not low <= value <= high:
            yield f"{index}: {low} to {high} leaves out {value}, where the effect is absent"


def test_every_parameter_has_a_range_with_a_source_and_absence_lies_within():
    vehicle = preset("auv151")
    assert len(EVERY) > 60
    assert [
        f"{name}.{parameter.name} {fault}"
        for name, parameter in EVERY
        for fault in faults_of_range(name, parameter, vehicle)
    ] == []


@pytest.mark.parametrize(
    ("low", "high", "fault"), [(1.0, -1.0, "finite"), (0.5, 9.0, "absent"), (-9.0, -2.0, "outside")]
)
def test_a_range_that_is_wrong_is_seen(low, high, fault):
    parameter = CATALOGUE["cross_axis_drag"].parameter("D01")
    wrong = replace(parameter, plausible=replace(parameter.plausible, at=lambda *_: (low, high)))
    faults = list(faults_of_range("cross_axis_drag", wrong, preset()))
    assert any(fault in one for one in faults)


@pytest.mark.parametrize("path", PRESETS, ids=lambda path: path.stem)
def test_bundled_vehicles_are_plausible(path):
    assert implausible(files.read(path)[0]) == []


def test_drag_is_that_of_the_box():
    """In surge 1/2 rho C_d W H; about z two faces turn, each station at its own speed."""
    vehicle, rho = preset(), 1000.0
    length, width, height = vehicle.hull.length, vehicle.hull.width, vehicle.hull.height
    assert most_drag(vehicle)[0] == pytest.approx(0.5 * rho * MOST_DRAG * width * height)
    turned = sum(
        quad(lambda x: abs(x) ** 3, -side / 2, side / 2, points=[0.0])[0] for side in (length, width)
    )
    assert most_drag(vehicle)[5] == pytest.approx(0.5 * rho * MOST_DRAG * height * turned * BOOMS**3)


def test_a_sphere_and_a_cylinder_have_plausible_added_mass():
    """A half of the displaced mass, and all of it; a range that knew less would refuse them."""
    vehicle = preset()
    assert displaced_mass(vehicle) == pytest.approx(13.4, rel=1e-3)
    assert (most_added(vehicle)[:3] == 3.0 * displaced_mass(vehicle)).all()
    ends = CATALOGUE["added_mass"].parameter("diagonal").plausible.at
    assert ends((1,), vehicle) == (0.0, pytest.approx(3.0 * displaced_mass(vehicle)))


@pytest.mark.parametrize(
    "table",
    [
        {"name": "linear_damping", "diagonal": [0.0, 0.0, 0.0, 1035.0, 0.0, 0.0]},
        {"name": "added_mass", "diagonal": [6.0, 7.0, 18.0, 200 * 0.26, 200 * 0.23, 200 * 0.37]},
        {"name": "payload", "w": 1.0, "mass": 40 * 13.5},
        {"name": "thruster_gain", "g": [0.9] + [0.0] * 7},
        {"name": "added_mass_coriolis", "kappa": 12.0},
        {"name": "ocean_current", "v_N": -4.0},
        {"name": "command_delay", "d": 2.4},
    ],
    ids=lambda table: table["name"],
)
def test_what_was_believed_once_is_told(table):
    (words,) = implausible(with_effect(**table))
    assert words.startswith(table["name"])
    assert "is implausible" in words


def test_a_value_is_implausible_beyond_three_of_its_standard_errors():
    vehicle, most = with_effect(name="ocean_current", v_N=-4.0, v_E=0.1), 3.0
    assert implausible(vehicle, ["ocean_current"], {"v_N": 0.2, "v_E": 5.0})
    assert not implausible(vehicle, ["ocean_current"], {"v_N": (4.0 - most) / 3.0 + 0.5, "v_E": 0.0})
    assert not implausible(vehicle, ["ocean_current"], {"v_N": np.nan})


def test_only_effects_asked_for_are_looked_at_and_the_farthest_entry_is_told():
    vehicle = with_effect(name="quadratic_damping", diagonal=[300.0, 0.0, 9999.0, 0.0, 0.0, 0.0])
    assert implausible(vehicle, ["linear_damping"]) == []
    (words,) = implausible(vehicle)
    assert "quadratic_damping.diagonal[2] = 1e+04 N s^2/m^2" in words


def test_coefficients_of_a_formula_are_plausible_up_to_drag_or_weight():
    """On moments the weight acts at an arm of the hull's length."""
    formula = CATALOGUE["formula"].parameter
    for name in ("auv151", "bluerov2_heavy"):
        vehicle = preset(name)
        weight = vehicle.rigid_body.mass * vehicle.environment.gravity
        force = max(most_drag(vehicle)[:3].max(), weight)
        moment = max(most_drag(vehicle)[3:].max(), weight * vehicle.hull.length)
        assert force != pytest.approx(moment, rel=0.01)
        assert formula("force").plausible.at((0,), vehicle) == pytest.approx((-force, force))
        assert formula("moment").plausible.at((0,), vehicle) == pytest.approx((-moment, moment))


def test_a_tether_is_plausibly_slack_or_lifts_the_vehicle_over_a_metre():
    vehicle = preset()
    weight = vehicle.rigid_body.mass * vehicle.environment.gravity
    assert CATALOGUE["tether"].parameter("k").plausible.at((), vehicle) == (0.0, pytest.approx(weight))


def test_a_lag_is_plausible_in_sum_with_the_file():
    at = CATALOGUE["thruster_lag"].parameter("dT").plausible.at
    assert at((), preset("auv151")) == (-0.15, 1.85)
