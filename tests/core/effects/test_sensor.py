"""A DVL off the origin, and delays of one that are tried."""

from __future__ import annotations

import numpy as np
import polars as pl
from bench import BARE, DAMPED, equipped
from scipy.spatial.transform import Rotation

from hydro.core.columns import POSE, VELOCITY
from hydro.core.effects import velocity_log
from hydro.core.effects.sensor import (
    LONGEST_DELAY,
    SENSOR_DELAY,
    corrected,
    logged_pose,
    logged_position,
    logged_shift,
    measured,
    true_pose,
    true_position,
)
from hydro.core.simulation.simulate import simulate


def test_fine_delays_refine_the_coarse_ones_as_far_as_a_log_is_late():
    """Where a coarse delay tells of the effect, a fit may begin there or closer to what is true."""
    known = SENSOR_DELAY.identification
    coarse, fine = (
        [shape.tables[0]["d"] for shape in made(BARE, None)] for made in (known.coarse, known.fine) if made
    )
    assert set(coarse) < set(fine)
    tried = np.log([*fine, LONGEST_DELAY])
    assert np.diff(tried).max() < np.diff(np.log([*coarse, LONGEST_DELAY])).max()
    assert (np.diff(tried) > 0.0).all()


def test_a_velocity_log_off_the_origin_reads_the_velocity_of_its_place():
    arm, turning = np.array([0.5, -0.2, 0.3]), np.array([0.1, 0.2, -0.3])
    log = velocity_log(equipped({"name": "sensor_lever_arm", "r": arm.tolist()}))
    read = measured(log, np.zeros(1), np.r_[np.zeros(3), turning][None])
    np.testing.assert_allclose(read[0], [*np.cross(turning, arm), *turning], atol=1e-12)


POINT = np.array([-0.2, 0.1, 0.15])


def point_log():
    return velocity_log(equipped({"name": "reference_point", "r": POINT.tolist()}))


def test_a_reference_point_reads_position_and_velocity_of_its_place():
    eta = np.array([[1.0, -2.0, 3.0, 0.3, -0.2, 1.1]])
    nu = np.array([[0.4, 0.1, -0.2, 0.1, 0.2, -0.3]])
    turned = Rotation.from_euler("ZYX", eta[0, :2:-1])
    expected = eta[0, :3] + turned.apply(POINT)
    np.testing.assert_allclose(logged_pose(point_log(), eta)[0], [*expected, *eta[0, 3:]], atol=1e-12)
    read = measured(point_log(), np.zeros(1), nu)
    np.testing.assert_allclose(read[0, :3], nu[0, :3] + np.cross(nu[0, 3:], POINT), atol=1e-12)
    state = np.array([[*eta[0, :3], *turned.as_quat(scalar_first=True), *nu[0]]])
    np.testing.assert_allclose(logged_position(point_log(), state)[0, :3], expected, atol=1e-12)
    np.testing.assert_allclose(true_position(point_log(), logged_position(point_log(), state)), state)
    np.testing.assert_allclose(true_pose(point_log(), logged_pose(point_log(), eta)), eta)
    np.testing.assert_allclose(corrected(point_log(), np.zeros(1), read), nu, atol=1e-12)


def test_a_small_change_of_the_motion_changes_the_logged_position_as_its_derivative():
    attitude, small = Rotation.from_euler("ZYX", [1.1, -0.2, 0.3]), 1e-6
    change = np.array([0.3, -0.2, 0.1, 0.5, -0.4, 0.2])
    moved = attitude * Rotation.from_rotvec(small * change[3:])
    expected = change[:3] + (moved.apply(POINT) - attitude.apply(POINT)) / small
    found = logged_shift(point_log(), attitude.as_quat(scalar_first=True)[None], change[None, :, None])
    np.testing.assert_allclose(found[0, :, 0], expected, atol=1e-5)


def test_a_flight_is_logged_at_the_reference_point_from_start_to_end():
    """The logged velocity of the point is the derivative of its logged position."""
    t = np.arange(300) * 0.02
    start = dict.fromkeys((*POSE, *VELOCITY), 0.0) | {"z": 5.0, "psi": 0.4, "r": 0.5}
    columns = {"session": ["a"] * 300, "t": t, "cmd_1": 0.4 + 0.0 * t, "cmd_2": np.sin(t)}
    commands = pl.DataFrame(columns).with_columns(pl.lit(value).alias(name) for name, value in start.items())
    flown = simulate(equipped(*DAMPED, {"name": "reference_point", "r": POINT.tolist()}), commands)
    eta, nu = flown.select(POSE).to_numpy(), flown.select(VELOCITY).to_numpy()
    np.testing.assert_allclose(eta[0], list(start.values())[:6], atol=1e-9)
    turned = Rotation.from_euler("ZYX", eta[:, :2:-1])
    along = turned.apply(nu[:, :3])
    np.testing.assert_allclose(np.gradient(eta[:, :3], t, axis=0)[2:-2], along[2:-2], atol=2e-3)
    assert (
        np.abs(np.gradient(eta[:, :3], t, axis=0) - turned.apply(corrected(point_log(), t, nu)[:, :3])).max()
        > 0.03
    )
