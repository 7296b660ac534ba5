"""Films of a flight, rendered by MuJoCo off-screen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
"""Width and height of a frame; multiples of 8, which codecs like."""
DISTANCE, ELEVATION = 4.0, -25.0
"""Of the camera behind and above the vehicle [m], [deg]."""
SWING = 0.05
"""Share of a turn that the camera follows in a frame."""


@dataclass(frozen=True)
class Flown:
    """A flight to be shown.

    Attributes:
        pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED, (K, 7).
        targets: What the vehicle swims to, a red sphere, (K, 3), NED [m].
        pillars: Axes (P, 2), NED [m].
        period: Time between poses [s].
    """

    pose: Array
    targets: Array
    pillars: Array
    period: float


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
        vehicle: The vehicle file.
        flown: The flight.
        size: Length, width and depth of the tank [m].
        radius: Of the pillars [m].
        output: The file; its suffix says the format.
        folder: Folder of the vehicle file, where a hull mesh is looked for.

    Raises:
        UsageError: The extra `video` is not installed, or there is nothing to render with.
    """
    try:
        import imageio.v2 as imageio
        import imageio_ffmpeg  # noqa: F401 - what imageio writes films with
    except ImportError as error:
        raise UsageError(
            "films need the extra `video`: pip install 'deep-hydro-sim[video]', or name a .png"
        ) from error
    model = scene.tank(vehicle, size, pillars=len(flown.pillars), radius=radius, folder=folder)
    model.vis.global_.offwidth, model.vis.global_.offheight = SIZE
    model.stat.extent = max(size)  # pillars that are put away are far; what is near would be clipped
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.4, 0.6
    try:
        renderer = mujoco.Renderer(model, height=SIZE[1], width=SIZE[0])
    except Exception as error:  # whatever the platform's OpenGL raises
        raise UsageError(
            "MuJoCo finds no OpenGL to render with: set MUJOCO_GL=egl or osmesa, or name a .png"
        ) from error
    films: Any = imageio
    with renderer, films.get_writer(output, fps=round(1.0 / flown.period), macro_block_size=8) as writer:
        for frame in _frames(model, renderer, flown):
            writer.append_data(frame)


def _frames(model: mujoco.MjModel, renderer: Any, flown: Flown) -> Iterator[NDArray[np.uint8]]:
    """One picture per pose, from a camera that follows."""
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.distance, camera.elevation = DISTANCE, ELEVATION
    camera.azimuth = bow(flown.pose[0])
    for now, target in zip(flown.pose, flown.targets, strict=True):
        data.qpos[:], data.qvel[:] = states.coordinates(now, np.zeros(6))
        scene.place(model, data, flown.pillars, target)
        mujoco.mj_forward(model, data)
        camera.lookat[:] = data.qpos[:3]
        camera.azimuth += SWING * np.degrees(wrapped(np.radians(bow(now) - camera.azimuth)))
        renderer.update_scene(data, camera)
        yield renderer.render()


def bow(pose: Array) -> float:
    """Where the bow points in MuJoCo's world [deg], from north to west: minus yaw."""
    w, x, y, z = pose[3:7]
    return -float(np.degrees(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))))
