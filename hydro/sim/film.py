"""Videos of a flight, rendered off-screen by MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
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
RATE = 12.5
"""Pictures per second; without a graphics processor each takes 60 ms of processor time."""
HOLD = 1.0
"""Time for which the last picture of a flight stays, so that its ending can be read [s]."""
CAPTION, MARGIN, INK = 20, 12, (235, 235, 235)
"""Height of a caption's letters and its distance from the corner [pixels], and its colour."""


@dataclass(frozen=True)
class Flown:
    """Recorded flight for a video.

    Attributes:
        pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED, at K times (K, 7).
        targets: Targets of the vehicle, shown as a red sphere, (K, 3), NED [m].
        pillars: North and east of the axes of the P pillars, (P, 2) [m].
        period: Time between poses [s].
        ending: Outcome, written below the title when the flight has ended.
    """

    pose: Array
    targets: Array
    pillars: Array
    period: float
    ending: str = ""


@dataclass(frozen=True)
class Panel:
    """Part of a video: the flights of one policy or pilot, shown one after another.

    Attributes:
        vehicle: Vehicle file.
        flights: The flights.
        title: Caption.
        folder: Folder of the vehicle file, which has its hull mesh.
    """

    vehicle: Vehicle
    flights: Sequence[Flown]
    title: str = ""
    folder: Path | None = None


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


def film(panels: Sequence[Panel], size: tuple[float, float, float], *, radius: float, output: Path) -> None:
    """Write a video file of flights, with a panel for each policy, side by side.

    Args:
        panels: Panels with as many flights each; the k-th flights are shown together.
        size: Length, width and depth of the tank [m].
        radius: Radius of the pillars [m].
        output: Video file; its suffix sets the format.

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
    period = panels[0].flights[0].period
    with ExitStack() as opened:
        cameras = [opened.enter_context(closing(_camera(panel, size, radius))) for panel in panels]
        writer = opened.enter_context(
            films.get_writer(output, fps=1.0 / (period * _stride(period)), macro_block_size=8)
        )
        titles = [panel.title for panel in panels]
        for together in zip(*(panel.flights for panel in panels), strict=True):
            for picture in frames(together, titles, cameras):
                writer.append_data(picture)


def _camera(panel: Panel, size: tuple[float, float, float], radius: float) -> Camera:
    """Return a camera in a tank with room for the pillars of every flight of a panel."""
    pillars = max(len(flight.pillars) for flight in panel.flights)
    return Camera(panel.vehicle, Room(size, pillars, radius), folder=panel.folder)


def _stride(period: float) -> int:
    """Return the number of poses per picture, for poses `period` [s] apart."""
    return max(1, round(1.0 / (RATE * period)))


def frames(
    flights: Sequence[Flown], titles: Sequence[str], cameras: Sequence[Camera]
) -> Iterator[NDArray[np.uint8]]:
    """Yield the pictures of simultaneous flights until the last flight has ended; ended flights stay still.

    Args:
        flights: The flights, one per panel, with the same period.
        titles: Caption of each panel.
        cameras: Camera of each panel.

    Yields:
        Picture (height, width, 3), RGB, with the panels side by side.
    """
    period, ends = flights[0].period, [len(flight.pose) - 1 for flight in flights]
    stride = _stride(period)
    panels = [np.empty(0, dtype=np.uint8)] * len(flights)
    for camera in cameras:
        camera.cut()
    for k in range(0, max(ends) + stride + round(HOLD / period), stride):
        for i, (flight, camera) in enumerate(zip(flights, cameras, strict=True)):
            if k < ends[i] + stride:
                at = min(k, ends[i])
                seen = camera.picture(flight.pose[at], flight.pillars, flight.targets[at])
                ending = flight.ending if at == ends[i] else f"{at * period:.0f} s"
                panels[i] = captioned(seen, f"{titles[i]}\n{ending}".strip())
        yield np.hstack(panels)


def captioned(picture: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    """Return a copy of a picture (height, width, 3), RGB, with a text in its upper left corner."""
    from PIL import Image, ImageDraw, ImageFont

    drawn = Image.fromarray(picture)
    font = ImageFont.load_default(CAPTION)
    ImageDraw.Draw(drawn).text((MARGIN, MARGIN), text, fill=INK, font=font)
    return np.asarray(drawn, dtype=np.uint8)


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
        self._pillars = room.pillars
        self.cut()

    def cut(self) -> None:
        """Begin another flight: the next picture looks in the direction of the bow, without a pan."""
        self._follows = False

    def picture(self, pose: Array, pillars: Array, target: Array) -> NDArray[np.uint8]:
        """Return the picture of the vehicle, the pillars and the target, (height, width, 3), RGB.

        Args:
            pose: x y z, NED [m], and the quaternion (w, x, y, z) from FRD to NED, (7,).
            pillars: North and east of the axes of the pillars, (P, 2) [m]; P is at most the number of pillars
                with which the camera's scene was built, `Room.pillars`.  Unused ones are out of sight.
            target: Target of the vehicle, (3,), NED [m].

        Raises:
            ValueError: There are more pillars than the scene has.
        """
        data, view = self._data, self._view
        data.qpos[:], data.qvel[:] = states.coordinates(pose, np.zeros(6))
        absent = np.full((self._pillars - len(pillars), 2), np.nan)
        scene.place(self._model, data, np.vstack([pillars, absent]), target)
        mujoco.mj_forward(self._model, data)
        view.lookat[:] = data.qpos[:3]
        swing = TURN_SHARE if self._follows else 1.0
        view.azimuth += swing * np.degrees(wrapped(np.radians(bow(pose) - view.azimuth)))
        self._follows = True
        self._renderer.update_scene(data, view)
        return np.asarray(self._renderer.render(), dtype=np.uint8)

    def close(self) -> None:
        """Close the renderer of the camera."""
        self._renderer.close()


def bow(pose: Array) -> float:
    """Return the direction of the bow in MuJoCo's world, from north to west: minus yaw [deg]."""
    w, x, y, z = pose[3:7]
    return -float(np.degrees(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))))
