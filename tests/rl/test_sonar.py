"""The sonar and the hull's collisions, against MuJoCo's rays and distances."""

import mujoco
import numpy as np
import pytest
from fleets import vehicle
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.optimize import minimize

from hydro.core.frames import quaternion_from_euler, rotation
from hydro.rl import geometry
from hydro.rl.config import Sonar, World
from hydro.rl.sonar import BEAMS, beams, sonar_kernel
from hydro.sim import scene
from hydro.sim.states import coordinates

WORLD, SONAR = World(), Sonar()
TANK = geometry.tank(WORLD)
BOW = np.array([0.7, 0.0, 0.0])
SEEN = np.array([1, 1, 0, 1, 1, 1], dtype=np.uint8)  # all but the surface

angle = st.floats(-np.pi, np.pi)
places = st.tuples(st.floats(1.0, 23.0), st.floats(1.0, 11.0), st.floats(1.0, 7.0))
axes = st.lists(st.tuples(st.floats(0.5, 23.5), st.floats(0.5, 11.5)), max_size=8)
attitudes = st.tuples(angle, st.floats(-1.5, 1.5), angle)


@pytest.fixture(scope="module")
def model():
    return scene.tank(vehicle(), (WORLD.length, WORLD.width, WORLD.depth), pillars=8)


def standing(pillars):
    padded = np.full((8, 2), np.nan)
    padded[: len(pillars)] = np.reshape(pillars, (-1, 2))
    return padded


def posed(model, pillars, at, attitude):
    data = mujoco.MjData(model)
    scene.place(model, data, pillars)
    pose = np.concatenate([at, quaternion_from_euler(*attitude)])
    data.qpos[:], data.qvel[:] = coordinates(pose, np.zeros(6))
    mujoco.mj_kinematics(model, data)
    return data


@given(at=places, attitude=attitudes, pillars=axes)
@example(at=(12.0, 6.0, 4.0), attitude=(0.0, 0.0, 0.0), pillars=[(14.0, 6.3)])
def test_ranges_are_those_of_mujocos_rays(model, at, attitude, pillars):
    R = rotation(*attitude)
    origin = at + R @ BOW
    assume((origin > 0.05).all() and (origin < [23.95, 11.95, 7.95]).all())
    gaps = np.hypot(*(np.reshape(pillars, (-1, 2)) - origin[:2]).T)
    assume((gaps > WORLD.pillar_radius + 0.01).all())
    ranges, stand = np.empty(BEAMS), standing(pillars)
    least = sonar_kernel(BOW, beams(SONAR), SONAR.reach, TANK, np.array(at), R.ravel(), stand, ranges)
    data = posed(model, stand, at, attitude)
    hull, found = model.body("auv151").id, []
    for forward, starboard in beams(SONAR):
        ray = R @ [forward, starboard, 0.0]
        flip = np.array([1.0, -1.0, -1.0])
        met = mujoco.mj_ray(model, data, flip * origin, flip * ray, SEEN, 1, hull, np.zeros(1, np.int32))
        above = (-origin[2] / ray[2]) if ray[2] < 0.0 else np.inf  # the walls end at the surface
        found.append(np.nan if met < 0 or met > above else min(met, SONAR.reach))
    found = np.array(found)
    seen = np.isfinite(found)
    np.testing.assert_allclose(ranges[seen], found[seen], atol=1e-6)
    assert least == ranges.min()


def test_beams_go_from_port_to_starboard_of_the_bow():
    fan = beams(SONAR)
    assert fan.shape == (BEAMS, 2)
    np.testing.assert_allclose(fan[7], [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.degrees(np.arctan2(fan[:, 1], fan[:, 0])), np.linspace(-90, 90, 15))


def test_from_within_a_pillar_and_outside_the_tank_ranges_are_zero():
    ranges, level = np.empty(BEAMS), np.eye(3).ravel()
    for at, stand in (((5.0, 6.0, 4.0), standing([(5.7, 6.0)])), ((23.6, 6.0, 4.0), standing([]))):
        assert sonar_kernel(BOW, beams(SONAR), 10.0, TANK, np.array(at), level, stand, ranges) == 0.0


@given(at=places, attitude=attitudes, pillars=axes)
def test_a_hull_collides_where_mujoco_finds_it_touching(model, at, attitude, pillars):
    stand = standing(pillars)
    touched = geometry.collision_kernel(
        geometry.hull_numbers(vehicle().hull), TANK, np.array(at), rotation(*attitude).ravel(), stand
    )
    data = posed(model, stand, at, attitude)
    hull = model.geom("auv151/hull").id
    solid = [geom for geom in range(model.ngeom) if geom != hull and model.geom_group[geom] == 0]
    gap = min(mujoco.mj_geomDistance(model, data, hull, geom, 1.0, None) for geom in solid)
    lowest = np.sqrt((rotation(*attitude)[2] ** 2) @ (np.array([1.4, 0.7, 0.5]) / 2) ** 2)
    gap = min(gap, at[2] - lowest)  # the surface
    assume(abs(gap) > 1e-3)
    assert touched == (gap < 0.0)


@given(attitude=attitudes, x=st.floats(-2.0, 2.0), y=st.floats(-2.0, 2.0))
def test_the_distance_to_a_pillar_is_the_least_of_all_points_of_the_hull(attitude, x, y):
    hull, R = geometry.hull_numbers(vehicle().hull), rotation(*attitude)
    got = geometry.shadow_distance(hull, R.ravel(), x, y)

    def gap(angles):
        a, b = angles
        point = R @ (hull[3:] * [np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)])
        return np.hypot(point[0] - x, point[1] - y)

    starts = [(a, b) for a in np.linspace(-np.pi, np.pi, 9) for b in (-0.8, 0.0, 0.8)]
    best = min(starts, key=gap)
    for _ in range(3):  # a simplex that has shrunk too soon grows anew
        best = minimize(gap, best, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-12}).x
    found = gap(best)
    if got == 0.0:
        assert found < 0.36
    else:
        np.testing.assert_allclose(got, found, atol=1e-5)
