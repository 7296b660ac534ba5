"""Effects on the thruster chain and on the DVL."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from bench import BARE, DAMPED, equipped, neutral
from hypothesis import given
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from strategies import numbers, vectors

from hydro.core.effects import assemble, sensor, thruster_table, velocity_log
from hydro.core.effects.sensor import corrected, measured
from hydro.core.simulation.simulate import trajectory
from hydro.core.vehicle import thrusters
from hydro.core.vehicle.description import Buoyancy
from hydro.core.vehicle.thrusters import thrusts

ROWS = [[0, 200]]
T = np.arange(200) * 0.02


def held(command, *effects, nu_r=None):
    """Thrusts of the bench's two thrusters after four seconds of one command."""
    commands = np.tile(np.asarray(command, float), (200, 1))
    water = None if nu_r is None else np.tile(np.asarray(nu_r, float), (200, 1))
    return thrusts(thruster_table(equipped(*effects)), commands, T, ROWS, nu_r=water)


def test_without_effects_the_table_is_the_files():
    np.testing.assert_array_equal(thruster_table(BARE), thrusters.thruster_table(BARE))


def test_gain_scales_each_thruster():
    plain, scaled = held([0.5, -0.8]), held([0.5, -0.8], {"name": "thruster_gain", "g": [0.1, -0.4]})
    np.testing.assert_allclose(scaled, plain * [1.1, 0.6])


def test_asymmetry_takes_from_reverse_alone():
    plain, effect = held([-0.5, 0.8]), {"name": "thruster_asymmetry", "a": 0.2}
    np.testing.assert_allclose(held([-0.5, 0.8], effect), plain * [0.8, 1.0])


def test_lag_adds_to_the_time_constant():
    thrust = held([1.0, 0.0], {"name": "thruster_lag", "dT": 0.1})[:, 0]
    np.testing.assert_allclose(thrust, 80.0 * (1.0 - np.exp(-T / 0.3)), atol=1e-9)


def test_delay_shifts_the_response():
    plain, late = held([1.0, 0.7]), held([1.0, 0.7], {"name": "command_delay", "d": 0.06})
    np.testing.assert_allclose(late[3:], plain[:-3], atol=1e-9)
    assert not late[:4].any()


def test_dead_band_widens():
    assert held([0.0, 0.06])[-1, 1] > 0.0
    assert held([0.0, 0.06], {"name": "thruster_deadband", "d": 0.02})[-1, 1] == 0.0


@given(numbers(-1.0, 1.0), numbers(-0.5, 2.0))
def test_the_curve_is_of_another_power(command, added):
    """Of 80 N ahead and 60 N astern at full command, |u|^(1 + da); 1 is what the file calls quadratic."""
    thrust = held([command, 0.0], {"name": "thruster_curve", "da": added})[-1, 0]
    full = 80.0 if command > 0.0 else -60.0
    assert thrust == pytest.approx(full * abs(command) ** (1.0 + added), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("style", ["cut", "shift"])
def test_a_linear_curve_with_one_more_power_is_the_quadratic_one(style):
    def banded(curve, *effects):
        vehicle = equipped(*effects)
        changed = (
            msgspec.structs.replace(t, curve=curve, deadband=0.1, deadband_style=style)
            for t in vehicle.thruster
        )
        table = thruster_table(msgspec.structs.replace(vehicle, thruster=tuple(changed)))
        commands = np.linspace(-1.0, 1.0, 200)[:, None].repeat(2, axis=1)
        return thrusts(table, commands, T, ROWS)

    more, less = {"name": "thruster_curve", "da": 1.0}, {"name": "thruster_curve", "da": -1.0}
    np.testing.assert_array_equal(banded("linear", more), banded("quadratic"))
    np.testing.assert_array_equal(banded("quadratic", less), banded("linear"))


@given(numbers(-1.0, 1.0), vectors(6, 1.5))
def test_inflow_takes_thrust_with_the_speed_into_the_propeller(command, nu_r):
    """f - c sqrt(|f| f_max) u_a with u_a = d . (v_r + omega x r), of a thruster ahead at (-0.7, 0.1, 0)."""
    plain = held([command, 0.0])[-1, 0]
    actual = held([command, 0.0], {"name": "thruster_inflow", "c": 0.15}, nu_r=nu_r)[-1, 0]
    speed = nu_r[0] + (nu_r[4] * 0.0 - nu_r[5] * 0.1)
    assert actual == pytest.approx(plain - 0.15 * np.sqrt(abs(plain) * 80.0) * speed, abs=1e-9)


@given(vectors(2, 0.1), vectors(6, 1.5))
def test_a_reaction_torque_turns_about_the_thrust_s_axis_and_is_no_lever_arm(k, nu_r):
    """The wrench of a newton becomes [d; r x d + k d]; what flows into the propeller stays the same."""
    plain, torqued = (
        thruster_table(BARE),
        thruster_table(equipped({"name": "propeller_torque", "k": k.tolist()})),
    )
    for row, before, thruster, one in zip(torqued, plain, BARE.thruster, k, strict=True):
        moment = np.cross(thruster.position, thruster.direction) + one * np.array(thruster.direction)
        np.testing.assert_allclose(row[thrusters.UNIT_WRENCH], [*thruster.direction, *moment], atol=1e-15)
        speed = thrusters.inflow_speed(before, nu_r)
        assert thrusters.inflow_speed(row, nu_r) == pytest.approx(speed, abs=1e-12)
    assert thrusters.same_states(plain, torqued)


@pytest.mark.parametrize("k", [0.05, -0.03])
def test_a_propeller_s_torque_heels_the_vehicle_to_where_weight_and_buoyancy_balance_it(k):
    """Steady ahead at 40 N, weight W 0.1 m below buoyancy: W 0.1 sin(phi) = k 40."""
    vehicle = msgspec.structs.replace(
        neutral(),
        buoyancy=Buoyancy(50.0 * 9.81, (0.0, 0.0, -0.1)),
        effect=({"name": "propeller_torque", "k": [k]}, *DAMPED),
    )
    t = np.arange(4000) * 0.02
    end = trajectory(assemble(vehicle), np.full((4000, 1), 0.5), t)[-1]
    assert np.sin(end[3]) == pytest.approx(k * 40.0 / (50.0 * 9.81 * 0.1), rel=1e-6)
    np.testing.assert_allclose(end[7:], 0.0, atol=1e-6)


def motion(t):
    """A smooth motion on all six axes."""
    return np.stack([np.sin((0.5 + 0.1 * i) * t + i) for i in range(6)], axis=1)


def log_of(*effects):
    return velocity_log(equipped(*effects))


def test_a_perfect_log_writes_the_truth():
    np.testing.assert_array_equal(measured(log_of(), T, motion(T)), motion(T))


def test_scale_of_all_axes_or_of_each():
    nu = motion(T)
    np.testing.assert_allclose(
        measured(log_of({"name": "sensor_scale", "s": 0.02}), T, nu)[:, :3], 1.02 * nu[:, :3]
    )
    each = measured(log_of({"name": "sensor_scale", "axes": [0.02, 0.0, -0.1]}), T, nu)
    np.testing.assert_allclose(each[:, :3], nu[:, :3] * [1.02, 1.0, 0.9])
    np.testing.assert_array_equal(each[:, 3:], nu[:, 3:])


def test_misalignment_of_a_log_turned_to_starboard_sees_ahead_as_port():
    log = log_of({"name": "sensor_misalignment", "alpha": [0.0, 0.0, 0.1]})
    reading = measured(log, T, np.tile([1.0, 0, 0, 0, 0, 0], (200, 1)))[0]
    np.testing.assert_allclose(reading[:3], [np.cos(0.1), -np.sin(0.1), 0.0])


def test_lever_arm_reads_the_velocity_of_its_place():
    log = log_of({"name": "sensor_lever_arm", "r": [0.5, 0.0, 0.2]})
    reading = measured(log, T, np.tile([0.0, 0, 0, 0, 0, 2.0], (200, 1)))[0]
    np.testing.assert_allclose(reading[:3], [0.0, 1.0, 0.0])


@pytest.mark.parametrize("delay", [0.02, 0.05, 0.333])
def test_delay_reads_the_past(delay):
    reading = measured(log_of({"name": "sensor_delay", "d": delay}), T, motion(T))
    late = delay < T
    np.testing.assert_allclose(reading[late, :3], motion(T - delay)[late, :3], atol=1e-6)
    np.testing.assert_allclose(reading[delay >= T, :3], motion(T)[0, :3] * np.ones((np.sum(delay >= T), 1)))


@given(vectors(3, 0.3), vectors(3, 0.4), vectors(3, 0.5), vectors(3, 0.1), numbers(0.0, 0.2))
def test_all_together_in_the_designs_order_and_back(scale, angles, lever, bias, delay):
    log = log_of(
        {"name": "sensor_bias", "b": bias.tolist()},
        {"name": "sensor_scale", "axes": scale.tolist()},
        {"name": "sensor_lever_arm", "r": lever.tolist()},
        {"name": "sensor_delay", "d": delay},
        {"name": "sensor_misalignment", "alpha": angles.tolist()},
    )
    nu, then = motion(T), motion(T - delay)
    reading = measured(log, T, nu)
    turned = Rotation.from_euler("ZYX", angles[::-1]).inv()
    expected = (1.0 + scale) * turned.apply(then[:, :3] + np.cross(then[:, 3:], lever)) + bias
    inside = delay < T
    np.testing.assert_allclose(reading[inside, :3], expected[inside], atol=1e-6)
    np.testing.assert_array_equal(reading[:, 3:], nu[:, 3:])
    known = (T > 0.1) & (T + delay < T[-1] - 0.3) & (delay + 0.3 < T)
    np.testing.assert_allclose(corrected(log, T, reading)[known], nu[known], atol=2e-5)


@pytest.mark.parametrize("rows", [7, 100, 400])
def test_a_late_log_reads_a_cubic_spline_of_every_stretch_at_once(rows):
    rng, t, late = np.random.default_rng(rows), np.arange(rows) * 0.02, 0.033
    nu, log = rng.standard_normal((4, 3, rows, 6)), np.zeros(sensor.LOG)
    log[sensor.DELAY] = late
    read = sensor.measured(log, t, nu)
    spline = CubicSpline(t, nu[..., :3], axis=-2)
    np.testing.assert_allclose(read[..., :3], spline(np.maximum(t - late, 0.0)), atol=1e-12)
    np.testing.assert_array_equal(read[..., 3:], nu[..., 3:])


def test_one_gain_for_all_thrusters_is_the_same_gain_for_each():
    """The common form acts like equal gains, and not on a servo, which exerts no wrench of its own."""
    vehicle = neutral()
    count = len(vehicle.thruster)
    each, common = (
        equipped({"name": "thruster_gain", **form}, bare=vehicle)
        for form in ({"g": [-0.25] * count}, {"common": -0.25})
    )
    np.testing.assert_array_equal(thruster_table(each), thruster_table(common))
