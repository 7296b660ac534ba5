"""Frames and signs of every part of the observation."""

import numpy as np
import pytest
from fleets import QUIET, fleet, neutral, put
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.vehicle.frames import rotation, rotation_from_quaternion
from hydro.rl.environment import observation as o
from hydro.rl.world.config import Settings

HALF = np.pi / 2


@pytest.fixture(scope="module")
def one():
    return fleet(craft=neutral())


def part(seen, at, length=3):
    return seen[at : at + length]


@pytest.mark.parametrize(
    ("attitude", "wanted"),
    [
        ((0, 0, 0), (3, 0, 0)),  # heading north, the goal north: ahead
        ((0, 0, HALF), (0, -3, 0)),  # heading east: to port
        ((0, 0, -HALF), (0, 3, 0)),  # heading west: to starboard
        ((0, HALF, 0), (0, 0, 3)),  # bow up: under the keel
        ((HALF, 0, HALF), (0, 0, 3)),  # heading east, rolled to starboard: port is up, its keel north
    ],
)
def test_the_way_to_the_target_is_in_body_axes(one, attitude, wanted):
    seen = put(one, attitude=attitude, goal=(15.0, 6.0, 4.0))
    turned = rotation(*attitude).T @ [3.0, 0.0, 0.0]
    np.testing.assert_allclose(part(seen, o.TARGET), turned, atol=1e-5)
    if attitude != (HALF, 0, HALF):
        np.testing.assert_allclose(turned, wanted, atol=1e-12)


def test_a_deeper_goal_is_below(one):
    np.testing.assert_allclose(part(put(one, goal=(12.0, 6.0, 6.0)), o.TARGET), [0, 0, 2], atol=1e-6)


@given(
    attitude=st.tuples(st.floats(-3, 3), st.floats(-1.4, 1.4), st.floats(-3, 3)),
    velocity=st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6),
)
def test_velocity_rates_and_gravity_are_of_the_body(one, attitude, velocity):
    seen = put(one, attitude=attitude, velocity=velocity)
    np.testing.assert_allclose(part(seen, o.VELOCITY), velocity[:3], atol=1e-5)
    np.testing.assert_allclose(part(seen, o.RATE), velocity[3:], atol=1e-5)
    np.testing.assert_allclose(part(seen, o.GRAVITY), 9.81 * rotation(*attitude)[2], atol=1e-5)
    quaternion = part(seen, o.QUATERNION, 4)
    assert quaternion[0] >= 0.0
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), rotation(*attitude), atol=1e-5)


def test_gravity_points_to_the_keel_and_comes_forward_as_the_bow_drops(one):
    np.testing.assert_allclose(part(put(one), o.GRAVITY), [0, 0, 9.81], atol=1e-5)
    assert put(one, attitude=(0, -0.3, 0))[o.GRAVITY] > 0.0  # bow down
    assert put(one, attitude=(0.3, 0, 0))[o.GRAVITY + 1] > 0.0  # starboard down


def test_depth_grows_downward_and_altitude_upward(one):
    seen = put(one, at=(12.0, 6.0, 2.5))
    assert seen[o.DEPTH] == pytest.approx(2.5)
    assert seen[o.ALTITUDE] == pytest.approx(5.5)


@pytest.mark.parametrize("beam", [12, 10, 4, 1])
def test_a_pillar_to_starboard_is_in_the_later_beams(one, beam):
    """The seventh beam points forward; its neighbours start at the surface of the hull of 1.4 m by 0.7 m."""
    bearing = np.sign(beam - 7) * np.radians(150.0) * (abs(beam - 7) / 7) ** 1.5
    skin = 1.0 / np.hypot(np.cos(bearing) / 0.7, np.sin(bearing) / 0.35)
    away = skin + 0.8 + Settings().world.pillar_radius
    stands = (12.0 + away * np.cos(bearing), 6.0 + away * np.sin(bearing))
    ranges = part(put(one, pillars=[stands]), o.SONAR, 15)
    assert ranges.argmin() == beam
    assert ranges[beam] == pytest.approx(0.8, abs=1e-4)


def test_an_accelerometer_at_rest_feels_the_water_bear_it(one):
    np.testing.assert_allclose(part(put(one), o.SPECIFIC_FORCE), [0, 0, -9.81], atol=1e-3)
    seen = put(one, attitude=(0.0, 0.5, 0.0))
    pulled = rotation(0.0, 0.5, 0.0).T @ [0.0, 0.0, -9.81]
    np.testing.assert_allclose(part(seen, o.SPECIFIC_FORCE), pulled, atol=0.25)  # righting turns it about CO


@pytest.mark.parametrize("axis", range(6))
def test_each_demand_moves_the_vehicle_its_way(one, axis):
    """Compare the accelerometer with the velocity change; check the sign of every axis and of the pose."""
    put(one, goal=(20.0, 6.0, 4.0))
    action = np.zeros((1, 6))
    action[0, axis] = 0.5
    seen = [one.step(action, renew=False).final_obs[0].astype(float) for _ in range(8)]
    velocity = np.array([np.concatenate([part(s, o.VELOCITY), part(s, o.RATE)]) for s in seen])
    assert velocity[-1, axis] > 0.01
    assert np.argmax(np.abs(velocity[-1])) == axis
    v, omega, down = velocity[:, :3], velocity[:, 3:], np.array([part(s, o.GRAVITY) for s in seen])
    change = (v[-1] - v[-3]) / (2 * QUIET.period)
    felt = change + np.cross(omega[-2], v[-2]) - down[-2]
    np.testing.assert_allclose(part(seen[-2], o.SPECIFIC_FORCE), felt, atol=0.03)
    if axis < 3:
        moved = one.plant.pose[0, axis] - (12.0, 6.0, 4.0)[axis]
        assert moved > 0.0
    else:
        assert one.plant.pose[0, 4 + axis - 3] > 0.0


def test_noise_is_that_of_the_settings_and_repeats_with_the_seed():
    settings = Settings()
    drawn = []
    for _ in range(2):
        flown = fleet(settings, count=400, craft=neutral(), seed=7)
        truth = fleet(QUIET, count=400, craft=neutral(), seed=7)
        drawn.append(flown.reset().astype(float) - truth.reset())
    np.testing.assert_array_equal(*drawn)
    spread = drawn[0].std(axis=0)
    wanted = o.sigmas(settings.noise)
    inside = [i for i in range(36) if not o.SONAR <= i < o.SONAR + 15]
    np.testing.assert_allclose(spread[inside], wanted[inside], rtol=0.12, atol=1e-6)
    assert (spread[o.SONAR : o.SONAR + 15] > 0.02).all()  # cut off at the sonar's reach
    assert (spread[o.SONAR : o.SONAR + 15] < 0.056).all()


def test_names_scales_and_bounds_are_of_36_numbers():
    low, high = o.bounds(Settings())
    assert len(o.NAMES) == len(o.ENCODING) == len(low) == len(high) == o.OBSERVATIONS == 36
    assert (low < high).all()
