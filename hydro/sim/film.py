"""Videos of a flight, rendered off-screen by MuJoCo."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from hydro.core.columns import Array
from hydro.core.errors import UsageError
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import wrapped
from hydro.sim import scene
from hydro.sim.bridge import states

SIZE = (640, 360)
"""Width and height of a frame [pixels]; video codecs need multiples of 8."""
DISTANCE, ELEVATION = 4.0, -25.0
"""Distance [m] and elevation [deg] of the camera behind and above the vehicle."""
TURN_SHARE = 0.05
"""Share of the remaining turn by which the camera follows in one frame."""


@dataclass(frozen=True)
class Flown:
    """Flight to be shown.

    Attributes:
        pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED, (K, 7).
        targets: Targets of the vehicle, shown as a red sphere, (K, 3), NED [m].
        pillars: Axes of the pillars, (P, 2), NED [m].
        period: Time between poses [s].
    """

    pose: Array
    targets: Array
    pillars: Array
    period: float


class Room(NamedTuple):
    """Tank of a video.

    Attributes:
        size: Length, width and depth [m].
        pillars: Maximum number of pillars.
        radius: Radius of the pillars [m].
    """

    size: tuple[float, float, float]
    pillars: int
    radius: float


def film(
    vehicle: Vehicle,
    flown: Flown,
    size: tuple[float, float, float],
    *,
    radius: float,
    output: Path,
    folder: Path | None = None,
) -> None:
    """Render a flight into a video file.

    Args:
        vehicle: Vehicle file.
        flown: The flight.
        size: Length, width and depth of the tank [m].
        radius: Radius of the pillars [m].
        output: Video file; its suffix sets the format.
        folder: Folder of the vehicle file, which has its hull mesh.

    Raises:
        UsageError: The extra `video` is not installed, or no renderer is available.
    """
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401 - the backend that imageio writes videos with
    except ImportError as error:
        raise UsageError(
            "films need the extra `video`: pip install 'deep-hydro-sim[video]', or name a .png"
        ) from error
    films: Any = imageio
    room = Room(size, len(flown.pillars), radius)
    with (
        closing(Camera(vehicle, room, folder=folder)) as camera,
        films.get_writer(output, fps=round(1.0 / flown.period), macro_block_size=8) as writer,
    ):
        for pose, target in zip(flown.pose, flown.targets, strict=True):
            writer.append_data(camera.picture(pose, flown.pillars, target))


class Camera:
    """Camera that follows a vehicle in a tank, from behind and above."""

    def __init__(self, vehicle: Vehicle, room: Room, *, folder: Path | None = None) -> None:
        """Build the tank and its renderer.

        Args:
            vehicle: Vehicle file.
            room: The tank and its pillars.
            folder: Folder of the vehicle file, which has its hull mesh.

        Raises:
            UsageError: No renderer is available.
        """
        model = scene.tank(vehicle, room.size, pillars=room.pillars, radius=room.radius, folder=folder)
        model.vis.global_.offwidth, model.vis.global_.offheight = SIZE
        model.stat.extent = max(room.size)  # unused pillars are far away; they would clip near objects
        model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.4, 0.6
        try:
            self._renderer: Any = mujoco.Renderer(model, height=SIZE[1], width=SIZE[0])
        except Exception as error:  # any error of the platform's OpenGL
            raise UsageError(
                "MuJoCo finds no OpenGL to render with: set MUJOCO_GL=egl or osmesa, or name a .png"
            ) from error
        self._model, self._data, self._view = model, mujoco.MjData(model), mujoco.MjvCamera()
        self._view.distance, self._view.elevation = DISTANCE, ELEVATION
        self._follows = False

    def picture(self, pose: Array, pillars: Array, target: Array) -> NDArray[np.uint8]:
        """Return the picture of the current scene, (height, width, 3).

        Args:
            pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED, (7,).
            pillars: Axes of the pillars, (P, 2), NED [m], at most as many as in the room.
            target: Target of the vehicle, (3,), NED [m].
        """
        data, view = self._data, self._view
        data.qpos[:], data.qvel[:] = states.coordinates(pose, np.zeros(6))
        scene.place(self._model, data, pillars, target)
        mujoco.mj_forward(self._model, data)
        view.lookat[:] = data.qpos[:3]
        swing = TURN_SHARE if self._follows else 1.0
        view.azimuth += swing * np.degrees(wrapped(np.radians(bow(pose) - view.azimuth)))
        self._follows = True
        self._renderer.update_scene(data, view)
        return np.asarray(self._renderer.render(), dtype=np.uint8)

    def close(self) -> None:
        """Close the renderer."""
        self._renderer.close()


def bow(pose: Array) -> float:
    """Return the direction of the bow in MuJoCo's world, from north to west: minus yaw [deg]."""
    w, x, y, z = pose[3:7]
    return -float(np.degrees(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))))
