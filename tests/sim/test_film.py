"""Camera of the film, and visibility of the vehicle in it (with OpenGL only)."""

import importlib.util
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hydro.core.vehicle.frames import quaternion_from_euler
from hydro.io import vehicle as vehicles
from hydro.sim.film import HOLD, Flown, Panel, bow, captioned, film, frames


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
    film([Panel(vehicle, [flown])], (24, 12, 8), radius=0.1, output=path)
    red, green, blue = imageio.get_reader(path).get_data(1)[180, 320].astype(int)
    assert min(red, green) > 2 * blue, "the middle of the picture is the yellow hull"


class Drawn:
    """Camera with pictures as bright as the vehicle is far north; it counts its cuts."""

    def __init__(self) -> None:
        self.cuts = 0

    def cut(self) -> None:
        self.cuts += 1

    def picture(self, pose, pillars, target):
        return np.full((60, 80, 3), int(pose[0]), dtype=np.uint8)


def flight(length: int, first: int) -> Flown:
    pose = np.zeros((length, 7))
    pose[:, 0] = first + np.arange(length)
    return Flown(pose, np.zeros((length, 3)), np.empty((0, 2)), 0.25, "ended")


def test_the_flight_that_ends_first_waits_for_the_one_beside_it():
    cameras = [Drawn(), Drawn()]
    shown = list(frames([flight(3, 50), flight(5, 100)], ["", ""], cameras))
    assert len(shown) == 5 + HOLD / 0.25
    corners = np.array([(picture[-1, 0, 0], picture[-1, -1, 0]) for picture in shown])
    assert corners[:5].tolist() == [[50, 100], [51, 101], [52, 102], [52, 103], [52, 104]]
    assert (corners[5:] == [52, 104]).all()
    assert shown[0].shape == (60, 160, 3)
    assert [camera.cuts for camera in cameras] == [1, 1]


def test_a_caption_is_bright_in_its_corner_and_leaves_the_rest():
    picture = np.zeros((90, 160, 3), dtype=np.uint8)
    drawn = captioned(picture, "before")
    assert drawn[:45].max() > 200
    assert not drawn[45:].any()
    assert not picture.any(), "the given picture is not changed"
