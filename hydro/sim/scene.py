"""Tank around a vehicle, for pictures and ray casts: floor, walls, surface and movable pillars.

Nothing in the scene has contacts: an episode ends where a hull would collide (`rl.environment.geometry`).
Vehicles are simulated in a model without the tank, which is faster, and shown in this one.
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
"""Names of the movable bodies; pillars are numbered from 0."""
SURFACE_GROUP = 2
"""Geom group of the surface and the goal, which rays ignore."""
_THICK = 0.05  # half thickness of floor and walls [m]
_AWAY = 1e3  # position of unused pillars [m]


def tank(
    vehicle: Vehicle,
    size: tuple[float, float, float],
    *,
    pillars: int,
    radius: float,
    water: Water | None = None,
    folder: Path | None = None,
) -> mujoco.MjModel:
    """Return a MuJoCo model of a vehicle in a tank, ready for stepping, rendering and ray casts.

    Args:
        vehicle: Vehicle file.
        size: Length north, width east and depth of the water [m], from the corner at the world's origin.
        pillars: Number of pillars; `place` moves them.
        radius: Radius of a pillar [m].
        water: Water forces on the vehicle; by default all of the file.
        folder: Folder of the vehicle file, which has its hull mesh.

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
    """Add walls, a sandy floor and the surface around water; `half` (3,) [m] is half of its size."""
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
    """Add a chequered material with squares of 1 m; return its name."""
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
    """Add a visible geom without contacts."""
    body.add_geom(type=kind, size=size, pos=at, rgba=rgba, group=group, contype=0, conaffinity=0)


def place(model: mujoco.MjModel, data: mujoco.MjData, pillars: Array, target: Array | None = None) -> None:
    """Move the pillars of a tank, and the sphere that marks the target, by writing to `data`.

    Args:
        model: Model from `tank`.
        data: Data of the model, written.
        pillars: x y of the pillars' axes (P, 2), NED [m]; NaN moves a pillar out of sight.
        target: Position of the sphere (3,), NED [m]; None leaves the sphere where it is.
    """
    for number, (x, y) in enumerate(pillars):
        moved = data.mocap_pos[model.body(f"{PILLAR}{number}").mocapid[0]]
        moved[:2] = (x, -y) if np.isfinite(x) else (_AWAY, 0.0)
    if target is not None:
        data.mocap_pos[model.body(GOAL).mocapid[0]] = HALF_TURN * target
