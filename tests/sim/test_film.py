"""Camera of the film, and visibility of the vehicle in it (with OpenGL only)."""

import importlib.util
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.vehicle.frames import quaternion_from_euler
from hydro.io import vehicle as vehicles
from hydro.sim.film import Flown, bow, film


@given(st.floats(-3.1, 3.1), st.floats(-1.2, 1.2), st.floats(-3.1, 3.1))
def test_the_camera_looks_where_the_bow_points(phi, theta, psi):
    """MuJoCo's azimuth rotates from its x, north, to its y, west; yaw rotates from north to east."""
    pose = np.concatenate([np.zeros(3), quaternion_from_euler(phi, theta, psi)])
    assert bow(pose) == pytest.approx(-np.degrees(psi), abs=1e-6)


@pytest.mark.skipif(
    "MUJOCO_GL" not in os.environ or importlib.util.find_spec("imageio_ffmpeg") is None,
    reason="films need MUJOCO_GL and imageio-ffmpeg",
)
def test_a_film_shows_the_vehicle_before_its_target(tmp_path, datasets):
    import imageio.v2 as imageio

    vehicle, _ = vehicles.read(datasets / "vehicles" / "auv151.toml")
    pose = np.tile([12.0, 6.0, 4.0, 1.0, 0.0, 0.0, 0.0], (3, 1))
    target = np.tile([15.0, 6.0, 4.0], (3, 1))
    path = tmp_path / "film.mp4"
    flown = Flown(pose, target, np.empty((0, 2)), 0.04)
    film(vehicle, flown, (24, 12, 8), radius=0.1, output=path)
    red, green, blue = imageio.get_reader(path).get_data(1)[180, 320].astype(int)
    assert min(red, green) > 2 * blue, "the middle of the picture is the yellow hull"
