"""Sonar and hull collisions, compared with MuJoCo's rays and distances."""

import mujoco
import numpy as np
import pytest
from fleets import vehicle
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.optimize import minimize

from hydro.core.errors import UsageError
from hydro.core.vehicle.frames import quaternion_from_euler, rotation
from hydro.rl.environment import geometry
from hydro.rl.environment.sonar import BEAMS, beams, sonar_kernel
from hydro.rl.world.config import Sonar, World
from hydro.sim import scene
from hydro.sim.bridge.states import coordinates

WORLD, SONAR = World(), Sonar()
TANK = geometry.tank(WORLD)
HULL = vehicle().hull
FAN = beams(SONAR, HULL)
SEEN = np.array([1, 1, 0, 1, 1, 1], dtype=np.uint8)  # all but the surface

angle = st.floats(-np.pi, np.pi)
places = st.tuples(st.floats(1.0, 23.0), st.floats(1.0, 11.0), st.floats(1.0, 7.0))
axes = st.lists(st.tuples(st.floats(0.5, 23.5), st.floats(0.5, 11.5)), max_size=8)
attitudes = st.tuples(angle, st.floats(-1.5, 1.5), angle)


@pytest.fixture(scope="module")
def model():
    size = WORLD.length, WORLD.width, WORLD.depth
    return scene.tank(vehicle(), size, pillars=8, radius=WORLD.pillar_radius)


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


def seen_from(at, R, stand):
    """Return the ranges of all beams."""
    where = np.array(at), R.ravel(), stand
    return np.array([sonar_kernel(beam, SONAR.reach, TANK, *where) for beam in FAN])


@given(at=places, attitude=attitudes, pillars=axes)
@example(at=(12.0, 6.0, 4.0), attitude=(0.0, 0.0, 0.0), pillars=[(14.0, 6.3)])
def test_ranges_are_those_of_mujocos_rays(model, at, attitude, pillars):
    R, stand = rotation(*attitude), standing(pillars)
    origins = at + FAN[:, :3] @ R.T
    assume((origins > 0.05).all() and (origins < [23.95, 11.95, 7.95]).all())
    gaps = np.hypot(*np.moveaxis(np.reshape(pillars, (-1, 1, 2)) - origins[:, :2], -1, 0))
    assume((gaps > WORLD.pillar_radius + 0.01).all())
    ranges = seen_from(at, R, stand)
    data = posed(model, stand, at, attitude)
    hull, found = model.body("auv151").id, []
    for origin, ray in zip(origins, FAN[:, 3:] @ R.T, strict=True):
        flip = np.array([1.0, -1.0, -1.0])
        met = mujoco.mj_ray(model, data, flip * origin, flip * ray, SEEN, 1, hull, np.zeros(1, np.int32))
        above = (-origin[2] / ray[2]) if ray[2] < 0.0 else np.inf  # the walls end at the surface
        found.append(np.nan if met < 0 or met > above else min(met, SONAR.reach))
    found = np.array(found)
    seen = np.isfinite(found)
    np.testing.assert_allclose(ranges[seen], found[seen], atol=1e-6)


def test_beams_begin_at_the_skin_as_mujoco_finds_it(model):
    data = posed(model, standing([]), (12.0, 6.0, 4.0), (0.0, 0.0, 0.0))
    hull, flip = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8), np.array([1.0, -1.0, -1.0])
    for place, way in zip(FAN[:, :3], FAN[:, 3:], strict=True):
        outside = place + 3.0 * way
        origin, ray = [12.0, -6.0, -4.0] + flip * outside, -flip * way
        met = mujoco.mj_ray(model, data, origin, ray, hull, 0, -1, geom := np.zeros(1, np.int32))
        assert met == pytest.approx(3.0, abs=1e-6)
        assert model.geom(geom[0]).name == "auv151/hull"


def test_beams_go_from_port_to_starboard_closest_ahead():
    assert FAN.shape == (BEAMS, 6)
    np.testing.assert_allclose(FAN[7], [0.7, 0.0, 0.0, 1.0, 0.0, 0.0], atol=1e-12)
    azimuth = np.degrees(np.arctan2(FAN[:, 4], FAN[:, 3]))
    np.testing.assert_allclose(azimuth[[0, 14]], [-150.0, 150.0])
    gaps = np.diff(azimuth)
    np.testing.assert_allclose(gaps, gaps[::-1])
    assert (np.diff(gaps[7:]) > 0.0).all()
    even = beams(Sonar(fan=np.pi, crowding=1.0), HULL)
    np.testing.assert_allclose(np.degrees(np.arctan2(even[:, 4], even[:, 3])), np.linspace(-90, 90, 15))


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("along", np.linspace(-0.4, 2.0, 7))
def test_no_pillar_beside_the_hull_is_out_of_sight(along, side):
    """A pillar at a distance of 0.3 m stays visible until the hull has passed it."""
    away = 0.35 + 0.3 + WORLD.pillar_radius
    stand = standing([(12.0 + along, 6.0 + side * away)])
    assert seen_from((12.0, 6.0, 4.0), np.eye(3), stand).min() < 2.0


@pytest.mark.parametrize(
    ("choices", "word"),
    [({"fan": 7.0}, "sonar.fan"), ({"fan": 0.0}, "sonar.fan"), ({"crowding": 0.0}, "crowding")],
)
def test_what_is_no_fan_is_refused(choices, word):
    with pytest.raises(UsageError, match=word):
        Sonar(**choices)


def test_from_within_a_pillar_and_outside_the_tank_ranges_are_zero():
    for at, stand in (((5.0, 6.0, 4.0), standing([(5.7, 6.0)])), ((23.6, 6.0, 4.0), standing([]))):
        assert seen_from(at, np.eye(3), stand).min() == 0.0


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
    got = geometry.line_distance(hull, R.ravel(), x, y)

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
