"""Gazebo worlds: independently integrated documented equations give the motion of `simulate`."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import msgspec
import numpy as np
import pytest
from export.flown import DT, GENTLE, VEHICLES, apart, commanded, given, vehicle
from export.gazebo_world import World
from sim.effects import EFFECTS, with_effect

from hydro.core.columns import MOTION
from hydro.core.errors import DataError
from hydro.core.simulation.simulate import simulate
from hydro.core.thrust_curves.curve import curve_table
from hydro.core.vehicle.description import Thruster
from hydro.export.gazebo import lacks, to_sdf, warnings
from hydro.export.targets import all_left_out

HELD = {
    *("added_mass", "added_mass_coupling", "added_mass_coriolis", "linear_damping", "quadratic_damping"),
    *("coupled_damping", "cross_axis_drag", "body_lift", "net_buoyancy", "buoyancy_offset", "payload"),
    *("ocean_current", "thruster_gain", "thruster_asymmetry", "thruster_curve", "thruster_deadband"),
}
"""Of the catalogue; what a thruster makes of commands is felt before newtons are sent."""


def newtons(craft, commands):
    """Return the published thrusts of commands [N]; dead bands of the style `cut` are left to Gazebo."""
    columns = []
    for thruster, u in zip(craft.thruster, np.clip(commands, -1.0, 1.0).T, strict=True):
        table = curve_table(thruster.curve)
        if table is not None:
            columns.append(table.at(u, craft.battery.voltage))
            continue
        size, power = np.abs(u), 2.0 if thruster.curve == "quadratic" else 1.0
        share, band = size**power, thruster.deadband**power
        if thruster.deadband_style == "shift":
            share = np.maximum(share - band, 0.0) / (1.0 - band)
        columns.append(
            np.where(u > 0, share * (thruster.max_thrust or 0), -share * (thruster.max_reverse_thrust or 0))
        )
    return np.array(columns).T


def both(craft, share=1.0, seconds=60.0, **options):
    """Return the motions by Gazebo's equations, and by `simulate` without the unsupported parts."""
    table = commanded(len(craft.thruster), share, seconds)
    left = all_left_out(craft, lacks(craft))
    flight = World(to_sdf(craft)).fly(newtons(craft, given(table)), DT, **options)
    return flight, simulate(left, table).select(MOTION).to_numpy()


@pytest.mark.parametrize("name", VEHICLES)
def test_sixty_seconds_are_those_of_simulate_without_what_it_cannot_hold(datasets, name):
    flight, motion = both(vehicle(datasets, name), GENTLE.get(name, 1.0))
    assert np.abs(motion[:, 6:]).max() > 0.3
    assert apart(flight, motion) < 1e-3


@pytest.mark.parametrize("effect", sorted(one for one in HELD - {"ocean_current"} if "thruster" not in one))
def test_effects_that_it_holds_are_held(datasets, effect):
    craft = with_effect(vehicle(datasets, "auv151"), effect)
    assert [one.what for one in lacks(craft)] == ["thruster lag"]
    flight, motion = both(craft, seconds=5.0)
    assert apart(flight, motion) < 1e-5


def test_limits_of_thrust_have_gain_and_asymmetry(datasets):
    craft = with_effect(with_effect(vehicle(datasets, "auv151"), "thruster_gain"), "thruster_asymmetry")
    limits = [limit for _, _, limit, _ in World(to_sdf(craft)).thrusters]
    gain = np.array(EFFECTS["thruster_gain"]["g"])
    np.testing.assert_allclose(np.array(limits)[:, 1], 155.0 * (1.0 + gain))
    np.testing.assert_allclose(np.array(limits)[:, 0], -155.0 * (1.0 + gain) * 0.75)


def test_in_a_current_the_rate_of_the_water_in_the_body_is_all_that_is_missing(datasets):
    craft = with_effect(vehicle(datasets, "auv151"), "ocean_current")
    flight, motion = both(craft, seconds=20.0)
    whole, _ = both(craft, seconds=20.0, whole_rate=True)
    assert apart(whole, motion) < 1e-5 < 1e-3 < apart(flight, motion)
    assert any("omega x R^T v_c" in line for line in warnings(craft))


@pytest.mark.parametrize("effect", EFFECTS)
def test_what_it_cannot_hold_is_listed_under_its_name(datasets, effect):
    craft = with_effect(vehicle(datasets, "auv151"), effect)
    names = {one.what for one in lacks(craft)} - {"thruster lag"}
    told = {
        "command_delay": {"command delay"},
        "thruster_inflow": {"thruster inflow"},
        "propeller_torque": {"propeller torque"},
        "thruster_lag": set(),
    }
    assert names == told.get(effect, set() if effect in HELD else {effect})
    without = all_left_out(craft, lacks(craft))
    assert not (set(EFFECTS) - HELD) & {one["name"] for one in without.effect}


def test_axis_demands_are_left_out(datasets):
    craft = vehicle(datasets, "auv151")
    surge = Thruster(name="X", wrench=(1.0, 0, 0, 0, 0, 0), max_thrust=10.0, max_reverse_thrust=10.0)
    demanded = msgspec.structs.replace(craft, thruster=(*craft.thruster, surge))
    found = {one.what: one for one in lacks(demanded)}
    assert list(found) == ["thruster lag", "thruster X"]
    assert len(found["thruster X"].without.thruster) == 9
    assert len(World(to_sdf(demanded)).thrusters) == 8


def test_added_mass_above_the_mass_is_warned_of(datasets):
    lines = warnings(vehicle(datasets, "remus100"))
    assert any("V, W, Q, R: use the engine DART" in line for line in lines)
    light = vehicle(datasets, "auv151").without("added_mass")
    assert not any("DART" in line for line in warnings(light))


def test_a_vehicle_that_nothing_lifts_is_refused(datasets):
    craft = with_effect(vehicle(datasets, "auv151"), "net_buoyancy")
    sunk = msgspec.structs.replace(craft, buoyancy=msgspec.structs.replace(craft.buoyancy, force=5.0))
    with pytest.raises(DataError, match="no buoyancy"):
        to_sdf(sunk)


def test_the_file_is_plain_xml_without_negative_zeros(datasets):
    text = to_sdf(vehicle(datasets, "bluerov2_heavy"))
    assert text.startswith(b'<?xml version="1.0"?>')
    words = [word for element in ET.fromstring(text).iter() for word in (element.text or "").split()]
    assert "-0" not in words
    assert not any("nan" in word or "inf" in word for word in words)
