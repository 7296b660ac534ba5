"""Stonefish scenario of a vehicle file: conversion, and refusal of unsupported features."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import msgspec
import numpy as np
import pytest
from stonefish_cases import craft, recorded_vehicle

from hydro.core.errors import DataError
from hydro.core.vehicle.thrusters import COLUMNS, DELAY
from hydro.sim.stonefish.recorder import stonefish_teacher
from hydro.sim.stonefish.scenario import Delays


def numbers(text):
    return np.array(text.split(), dtype=float)


def test_mass_buoyancy_and_thrusters_are_those_of_the_file():
    known, root = craft(), ET.fromstring(stonefish_teacher(craft()).scenario.text)
    assert float(root.find(".//mass").get("value")) == known.rigid_body.mass
    np.testing.assert_allclose(numbers(root.find(".//cg").get("xyz")), known.rigid_body.center_of_gravity)
    buoyancy = root.find("hydro/buoyancy")
    assert float(buoyancy.get("force")) == pytest.approx(known.buoyancy.force)
    moment = known.buoyancy.force * np.array(known.buoyancy.center)
    np.testing.assert_allclose(numbers(buoyancy.get("moment")), moment, atol=1e-9)
    for actuator, thruster in zip(root.iter("actuator"), known.thruster, strict=True):
        np.testing.assert_allclose(numbers(actuator.find("origin").get("xyz")), thruster.position)


def test_a_hidden_current_is_the_oceans():
    hidden = [{"name": "ocean_current", "v_N": 0.3, "v_E": -0.1}]
    root = ET.fromstring(stonefish_teacher(craft(), hidden=hidden).scenario.text)
    velocity = numbers(root.find(".//current/velocity").get("xyz"))
    np.testing.assert_allclose(velocity, [0.3, -0.1, 0.0])


def test_thrust_of_the_recorded_vehicle_is_the_readmes():
    """T = 155 sgn(n) (n^2 - 0.05^2) / (1 - 0.05^2), with a rotor lag of 0.15 s in Euler steps."""
    root = ET.fromstring(recorded_vehicle().text)
    coefficient = root.find(".//thrust_coeff")
    assert float(coefficient.get("forward")) == pytest.approx(155.0 / (1.0 - 0.05**2), rel=1e-5)
    assert float(root.find(".//deadband").get("upper")) == pytest.approx(0.05**2)


def test_what_stonefish_has_not_is_refused():
    hidden = [{"name": "ocean_waves", "height": 1.0, "period": 6.0, "direction": 0.0}]
    with pytest.raises(DataError):
        stonefish_teacher(craft(), hidden=hidden)


def test_a_payload_adds_its_mass_and_nothing_but_its_weight_in_water():
    hidden = [{"name": "payload", "w": 12.0, "x": 0.3, "y": -0.1, "z": 0.2, "mass": 9.0}]
    plain, loaded = (
        ET.fromstring(stonefish_teacher(craft(), hidden=more).scenario.text) for more in ([], hidden)
    )
    body, gravity, at = craft().rigid_body, craft().environment.gravity, np.array([0.3, -0.1, 0.2])
    center = (body.mass * np.array(body.center_of_gravity) + 9.0 * at) / (body.mass + 9.0)
    assert float(loaded.find(".//mass").get("value")) == pytest.approx(body.mass + 9.0)
    np.testing.assert_allclose(numbers(loaded.find(".//cg").get("xyz")), center)
    lift, less = (float(one.find("hydro/buoyancy").get("force")) for one in (loaded, plain))
    assert lift - less == pytest.approx(9.0 * gravity - 12.0)
    moment, before = (numbers(one.find("hydro/buoyancy").get("moment")) for one in (loaded, plain))
    np.testing.assert_allclose(moment - before, (9.0 * gravity - 12.0) * at, atol=1e-9)
    principal = np.sort(np.linalg.eigvalsh(inertia_about(center, body, at, 9.0)))
    np.testing.assert_allclose(np.sort(numbers(loaded.find(".//inertia").get("xyz"))), principal)


def inertia_about(center, body, at, mass):
    """Return the inertia of a body and a point mass about their common centre, by Huygens' theorem."""
    total = np.array(body.inertia)
    for heavy, place in ((body.mass, np.array(body.center_of_gravity)), (mass, at)):
        arm = place - center
        total = total + heavy * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return total


@pytest.mark.parametrize(
    ("changes", "command"),
    [
        ({"curve": "linear", "lag": "thrust", "deadband": 0.1}, 0.4),
        ({"curve": "linear", "lag": "speed", "deadband": 0.1}, -0.4),
        ({"curve": "quadratic", "lag": "speed", "deadband": 0.1}, 0.6),
        ({"curve": "quadratic", "lag": "speed", "deadband": 0.1, "deadband_style": "shift"}, -0.6),
        ({"curve": "quadratic", "lag": "thrust", "time_constant": 0.0, "max_reverse_thrust": 90.0}, -1.0),
    ],
)
def test_a_thruster_settles_on_the_thrust_of_its_file(changes, command):
    """Use the documented models of Stonefish: straight lines, or k (s - d) beyond a dead band."""
    thrusters = tuple(msgspec.structs.replace(one, **changes) for one in craft().thruster)
    known = msgspec.structs.replace(craft(), thruster=thrusters)
    given = stonefish_teacher(known).scenario
    model = ET.fromstring(given.text).find(".//thrust_model")
    first, power = thrusters[0], 2 if changes["curve"] == "quadratic" else 1
    share = abs(command) ** power
    if first.deadband_style == "shift":
        share = (share - first.deadband**power) / (1.0 - first.deadband**power)
    limit = first.max_thrust if command > 0.0 else -first.max_reverse_thrust
    assert thrust_by(model, given.setpoints(np.full(8, command))[0]) == pytest.approx(share * limit, rel=1e-4)
    within = np.copysign(0.99 * first.deadband, command)
    assert thrust_by(model, given.setpoints(np.full(8, within))[0]) == 0.0


def thrust_by(model, setpoint):
    """Return the thrust [N] of a settled rotor."""
    if model.get("type") == "linear_interpolation":
        return np.interp(setpoint, *(numbers(model.find(end).get("value")) for end in ("input", "output")))
    square = setpoint * abs(setpoint)
    way, edge = ("forward", "upper") if setpoint > 0.0 else ("reverse", "lower")
    slope, bound = float(model.find("thrust_coeff").get(way)), float(model.find("deadband").get(edge))
    return slope * (square - bound) if abs(square) > abs(bound) else 0.0


def test_late_commands_are_felt_late_thruster_by_thruster():
    """Delays of 0, 6 and 26 ms in steps of 10 ticks of 2 ms, compared with the past command at each tick."""
    table = np.zeros((3, COLUMNS))
    table[:, DELAY] = [0.0, 0.006, 0.026]
    late, given = Delays(table, 10), np.random.default_rng(0).uniform(-1.0, 1.0, (6, 3))
    ticks = [row for step in given for count, row in late.felt(step) for _ in range(count)]
    held = np.repeat(given, 10, axis=0)
    for i, behind in enumerate((0, 3, 13)):
        wanted = np.concatenate([np.zeros(behind), held[: 60 - behind, i]])
        np.testing.assert_array_equal(np.array(ticks)[:, i], wanted)


@pytest.mark.parametrize(
    ("hidden", "told"),
    [
        ({"name": "tether", "anchor": [0.0, 0.0, 0.0], "k": 5.0}, "Stonefish has no tether"),
        ({"name": "thruster_inflow", "c": 0.05}, "ignores the flow"),
        ({"name": "propeller_torque", "k": [0.05] * 8}, "torque"),
        ({"name": "current_shear", "g_N": 0.01}, "uniform"),
    ],
)
def test_what_has_no_place_is_refused_by_name(hidden, told):
    with pytest.raises(DataError, match=told):
        stonefish_teacher(craft(), hidden=[hidden])
