"""A tank around a vehicle to look at and to cast rays in: floor, walls, surface and movable pillars.

Nothing in it touches anything: an episode ends where a hull would (`rl.environment.geometry`), so that
vehicles fly in the bare model, which is faster, and are shown in this one.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from hydro.core.columns import Array
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import HALF_TURN
from hydro.sim.bridge import mjcf, native
from hydro.sim.bridge.water import Water

PILLAR, GOAL = "pillar", "goal"
"""Names of the bodies that are moved; pillars are numbered from 0."""
SURFACE_GROUP = 2
"""Geom group of the surface and the goal, which no ray is to meet."""
_THICK = 0.05  # half thickness of floor and walls [m]
_AWAY = 1e3  # where unused pillars stand [m]


def tank(
    vehicle: Vehicle,
    size: tuple[float, float, float],
    *,
    pillars: int,
    radius: float,
    water: Water | None = None,
    folder: Path | None = None,
) -> mujoco.MjModel:
    """A vehicle in a tank, ready to step, render and cast rays in.

    Args:
        vehicle: The vehicle file.
        size: Length north, width east and depth of the water [m], from the corner at the world's origin.
        pillars: Number of pillars; `place` moves them.
        radius: Of a pillar [m].
        water: What of the water the vehicle feels; everything the file says by default.
        folder: Folder of the vehicle file, where a hull mesh is looked for.

    Raises:
        DataError: The vehicle cannot be simulated.
    """
    spec = mjcf.scene(vehicle, water, folder=folder)
    half = 0.5 * np.array(size)
    _enclose(spec, half)
    for number in range(pillars):
        body = spec.worldbody.add_body(name=f"{PILLAR}{number}", mocap=True, pos=[_AWAY, 0.0, -half[2]])
        kind, rgba = mujoco.mjtGeom.mjGEOM_CYLINDER, [0.75, 0.35, 0.2, 1.0]
        _add(body, kind, [radius, half[2], 0.0], [0.0, 0.0, 0.0], rgba)
    goal = spec.worldbody.add_body(name=GOAL, mocap=True, pos=[_AWAY, 0.0, -half[2]])
    kind, rgba = mujoco.mjtGeom.mjGEOM_SPHERE, [0.9, 0.1, 0.1, 1.0]
    _add(goal, kind, [0.15, 0.0, 0.0], [0.0, 0.0, 0.0], rgba, SURFACE_GROUP)
    return native.prepare(spec.compile())


def _enclose(spec: mujoco.MjSpec, half: Array) -> None:
    """Walls, a floor of sand and the surface around water of half a length, width and depth."""
    middle, box = HALF_TURN * half, mujoco.mjtGeom.mjGEOM_BOX
    for axis, side in ((0, -1), (0, 1), (1, -1), (1, 1), (2, -1)):
        center, extent = middle.copy(), half.copy()
        center[axis] += side * (half[axis] + _THICK)
        extent[axis] = _THICK
        _add(spec.worldbody, box, extent, center, [0.35, 0.5, 0.6, 0.15])
    floor = spec.worldbody.geoms[-1]
    floor.material, floor.rgba = _sand(spec), [1.0, 1.0, 1.0, 1.0]
    surface, extent = np.array([middle[0], middle[1], 0.0]), np.array([half[0], half[1], 0.001])
    _add(spec.worldbody, box, extent, surface, [0.5, 0.8, 1, 0.08], SURFACE_GROUP)


def _sand(spec: mujoco.MjSpec) -> str:
    """Name of a chequered material whose squares are a metre wide."""
    spec.add_texture(
        name="sand",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.55, 0.50, 0.38],
        rgb2=[0.48, 0.44, 0.34],
        width=256,
        height=256,
    )
    material = spec.add_material(name="sand", texrepeat=[1.0, 1.0], texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "sand"
    return "sand"


def _add(
    body: mujoco.MjsBody,
    kind: mujoco.mjtGeom,
    size: Array | list[float],
    at: Array | list[float],
    rgba: list[float],
    group: int = 0,
) -> None:
    """Add something that can be seen and not touched."""
    body.add_geom(type=kind, size=size, pos=at, rgba=rgba, group=group, contype=0, conaffinity=0)


def place(model: mujoco.MjModel, data: mujoco.MjData, pillars: Array, target: Array | None = None) -> None:
    """Stand the pillars at x y (P, 2), NED, out of sight where NaN; put the sphere at a target (3,), NED."""
    for number, (x, y) in enumerate(pillars):
        moved = data.mocap_pos[model.body(f"{PILLAR}{number}").mocapid[0]]
        moved[:2] = (x, -y) if np.isfinite(x) else (_AWAY, 0.0)
    if target is not None:
        data.mocap_pos[model.body(GOAL).mocapid[0]] = HALF_TURN * target
