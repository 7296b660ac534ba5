"""The scenario says of a vehicle what its file says, and refuses what Stonefish has not."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from stonefish_cases import craft, recorded_vehicle

from hydro.core.errors import DataError
from hydro.sim.stonefish.recorder import stonefish_teacher


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
    """T = 155 sgn(n) (n^2 - 0.05^2) / (1 - 0.05^2), rotor 0.15 s in Euler steps."""
    root = ET.fromstring(recorded_vehicle().text)
    coefficient = root.find(".//thrust_coeff")
    assert float(coefficient.get("forward")) == pytest.approx(155.0 / (1.0 - 0.05**2), rel=1e-5)
    assert float(root.find(".//deadband").get("upper")) == pytest.approx(0.05**2)


def test_what_stonefish_has_not_is_refused():
    hidden = [{"name": "ocean_waves", "height": 1.0, "period": 6.0, "direction": 0.0}]
    with pytest.raises(DataError):
        stonefish_teacher(craft(), hidden=hidden)
