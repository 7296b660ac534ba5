"""Conversion of actions to thruster commands: the wrench has the demanded direction."""

import msgspec
import numpy as np
import pytest
from fleets import vehicle
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.effects import inertia_matrix
from hydro.core.effects.steering import servo_wrenches
from hydro.core.vehicle.control_allocation import mixing
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.core.vehicle.thrusters import configuration_matrix, static_thrust
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.rl.environment.action import command_kernel, crew_of, steered_by_fins

DEMANDS = st.lists(st.floats(-1.0, 1.0, allow_subnormal=False), min_size=6, max_size=6)


def mixed(craft, actions):
    crew = mixing(craft, mass_matrix(craft))
    actions = np.atleast_2d(np.array(actions, dtype=float))
    commands = np.empty((len(actions), len(craft.thruster)))
    fine = command_kernel(crew.allocation, crew.table, crew.authority, actions, np.empty(6), commands)
    return crew, commands, fine


def clean(curve):
    """Return the vehicle with another thrust curve, without dead band and with weaker reverse thrust."""
    known = vehicle()
    thrusters = [
        msgspec.structs.replace(one, curve=curve, deadband=0.0, max_reverse_thrust=90.0)
        for one in known.thruster
    ]
    return msgspec.structs.replace(known, thruster=tuple(thrusters))


@pytest.mark.parametrize("curve", ["linear", "quadratic"])
@given(demand=DEMANDS)
def test_the_wrench_keeps_the_demanded_direction_however_much_is_asked_for(curve, demand):
    craft = clean(curve)
    crew, commands, fine = mixed(craft, demand)
    assert fine
    assert np.abs(commands).max() <= 1.0
    thrusts = [static_thrust(row, n) for row, n in zip(crew.table, commands[0], strict=True)]
    got, wanted = configuration_matrix(craft) @ thrusts, crew.authority * demand
    largest = max(1.0, np.abs(np.divide(crew.allocation @ wanted, 155.0)).max() * 155.0 / 90.0)
    scale = got @ wanted / max(wanted @ wanted, 1e-9)
    np.testing.assert_allclose(got, scale * wanted, atol=1e-4 * 155.0)
    assert 1.0 / largest - 1e-3 <= scale <= 1.0 + 1e-3 or np.abs(wanted).max() < 1.0


def test_each_axis_alone_reaches_its_authority():
    craft = clean("linear")
    for axis in range(6):
        crew, commands, _ = mixed(craft, np.eye(6)[axis])
        thrusts = [static_thrust(row, n) for row, n in zip(crew.table, commands[0], strict=True)]
        np.testing.assert_allclose(
            configuration_matrix(craft) @ thrusts, crew.authority * np.eye(6)[axis], atol=1e-3
        )


def test_actions_beyond_the_box_are_clipped():
    craft = vehicle()
    _, inside, _ = mixed(craft, [1, -1, 0, 0, 0, 0.5])
    _, beyond, _ = mixed(craft, [7, -3, 0, 0, 0, 0.5])
    np.testing.assert_array_equal(inside, beyond)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_number_is_told(bad):
    assert not mixed(vehicle(), [0, 0, bad, 0, 0, 0])[2]


def test_fins_turn_a_vehicle_where_no_thruster_does():
    """Yaw drives the rudder and pitch the stern planes, with the sign of the moment; sway has none."""
    craft = files.read(bundled("vehicles") / "remus100_fins.toml")[0]
    crew = crew_of(craft)
    assert steered_by_fins(craft)
    assert not steered_by_fins(vehicle())
    assert (crew.authority > 0.0).tolist() == [True, False, False, False, True, True]
    demand, commands = np.array([[0.0, 1.0, 1.0, 0.0, 0.5, -1.0]]), np.empty((1, 3))
    assert command_kernel(crew.allocation, crew.table, crew.authority, demand, np.empty(6), commands)
    np.testing.assert_allclose(commands, [[0.0, 1.0, -0.5]], atol=1e-6)
    moment = servo_wrenches(craft) @ commands[0]
    assert moment[4] > 0.0 > moment[5]


def test_thrusters_alone_are_allocated_as_before():
    alone, crew = mixing(vehicle(), mass_matrix(vehicle()) + inertia_matrix(vehicle())), crew_of(vehicle())
    np.testing.assert_array_equal(crew.allocation, alone.allocation)
    np.testing.assert_array_equal(crew.authority, alone.authority)
