"""Fleets, vehicles and poses shared by the tests of reinforcement learning."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np

from hydro.core.vehicle.frames import quaternion_from_euler
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.rl.environment import conditions
from hydro.rl.environment.fleet import Fleet
from hydro.rl.world.config import Noise, Settings
from hydro.sim.teacher_plant import TeacherPlant

SILENT = Noise(velocity=0.0, rate=0.0, depth=0.0, range=0.0)
QUIET = replace(Settings(), noise=SILENT)
"""The defaults without noise."""


def vehicle(**changes):
    return msgspec.structs.replace(files.read(bundled("vehicles") / "auv151.toml")[0], **changes)


def neutral():
    """Return the vehicle of the paper without weight in water, so that it stays at rest."""
    known = vehicle()
    weight = known.rigid_body.mass * known.environment.gravity
    return msgspec.structs.replace(known, buoyancy=msgspec.structs.replace(known.buoyancy, force=weight))


def fleet(settings=QUIET, count=1, condition="R_effects", craft=None, seed=0, **more):
    known = conditions.Condition(condition)
    return Fleet(settings, conditions.plant(known, craft or vehicle(), settings, count, **more), seed=seed)


def teachers(settings=QUIET, count=1, seed=0):
    return Fleet(settings, TeacherPlant(vehicle(), count=count, period=settings.period), seed=seed)


def put(
    flown: Fleet, at=(12.0, 6.0, 4.0), attitude=(0.0, 0.0, 0.0), velocity=(0.0,) * 6, goal=None, pillars=None
):
    """Place the only vehicle of a fleet with a goal and pillars; return its observation."""
    flown.reset()
    pose = np.concatenate([at, quaternion_from_euler(*attitude)])[None]
    flown.plant.reset(np.ones(1, dtype=bool), pose, np.array([velocity], dtype=float))
    if goal is not None:
        flown.goals[0] = flown.targets[0] = goal
    flown.pillars[:] = np.nan
    for number, axis in enumerate(pillars or ()):
        flown.pillars[0, number] = axis
    flown._distance[0] = np.linalg.norm(flown.goals[0] - at)
    flown._observe(np.ones(1, dtype=bool))
    return flown._now[0].astype(float)
