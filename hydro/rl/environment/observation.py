"""Observation of a policy: 36 numbers (paper eq. 7), in SI units and body axes FRD unless stated otherwise.

0-2    R^T (p_g - p), vector to the target [m]
3-5    velocity of CO over ground, as a DVL measures it [m/s]
6-8    angular velocity, as a gyroscope measures it [rad/s]
9-12   quaternion (w, x, y, z) from FRD to NED, w >= 0
13-15  gravity R^T (0, 0, g) [m/s^2]
16     depth of CO below the surface [m]
17-31  15 ranges of the sonar, from port to starboard [m]
32     altitude of CO above the floor, straight down in the world [m]
33-35  specific force at CO, as an accelerometer measures it [m/s^2]
"""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array, Array32
from hydro.core.compiled import kernel
from hydro.core.vehicle.description import Vehicle
from hydro.rl.environment.blocks import Motion, Scenes, Senses
from hydro.rl.environment.encoding import Encoding
from hydro.rl.environment.geometry import FLOOR, tank
from hydro.rl.environment.sonar import BEAMS, beams, sonar_kernel
from hydro.rl.world.config import Noise, Settings

TARGET, VELOCITY, RATE, QUATERNION, GRAVITY, DEPTH, SONAR = 0, 3, 6, 9, 13, 16, 17
ALTITUDE = SONAR + BEAMS
SPECIFIC_FORCE = ALTITUDE + 1
OBSERVATIONS = SPECIFIC_FORCE + 3
"""First index of each group of observations; their number."""

NAMES = (
    *("target_x", "target_y", "target_z", "u", "v", "w", "p", "q", "r", "q_w", "q_x", "q_y", "q_z"),
    *("g_x", "g_y", "g_z", "depth", *(f"sonar_{beam + 1}" for beam in range(BEAMS)), "altitude"),
    *("a_x", "a_y", "a_z"),
)
"""Names of the observations, in order."""

ENCODING = Encoding(
    scale=np.array(
        [5.0] * 3 + [1.0] * 10 + [10.0] * 3 + [5.0] + [2.0] * BEAMS + [5.0] + [10.0] * 3,
        dtype=np.float32,
    ),
    fades=np.array([name.startswith("sonar_") for name in NAMES]),
)
"""Encoding of one observation for a policy."""


def encoding(settings: Settings) -> Encoding:
    """Return the encoding that scales stacked observations (O,) to network input.

    O is 36 `Settings.history`.
    """
    times = settings.history
    return Encoding(np.tile(ENCODING.scale, times), np.tile(ENCODING.fades, times))


def sigmas(noise: Noise) -> Array:
    """Return the standard deviation of each observation's noise (36,), in the unit of the observation."""
    sigma = np.zeros(OBSERVATIONS)
    sigma[VELOCITY : VELOCITY + 3] = noise.velocity
    sigma[RATE : RATE + 3] = noise.rate
    sigma[DEPTH] = noise.depth
    sigma[SONAR : SONAR + BEAMS] = noise.range
    return sigma


def bounds(settings: Settings) -> tuple[Array32, Array32]:
    """Return the least and the greatest values of the stacked observations, (O,) each.

    They are the limits of the sensors.
    """
    low, high = _limits(settings)
    return np.tile(low, settings.history), np.tile(high, settings.history)


def _limits(settings: Settings) -> tuple[Array32, Array32]:
    """Return the least and greatest values (36,) of one observation."""
    high = np.full(OBSERVATIONS, 100.0)
    world = settings.world
    high[TARGET : TARGET + 3] = np.linalg.norm([world.length, world.width, world.depth])
    high[QUATERNION : QUATERNION + 4] = 1.0
    high[GRAVITY : GRAVITY + 3] = 12.0
    high[DEPTH] = high[ALTITUDE] = 2.0 * world.depth
    high[SONAR : SONAR + BEAMS] = settings.sonar.reach
    low = -high
    low[QUATERNION] = 0.0
    low[SONAR : SONAR + BEAMS] = 0.0
    return low.astype(np.float32), high.astype(np.float32)


def senses(settings: Settings, vehicle: Vehicle) -> Senses:
    """Return the sensors of a vehicle under the settings, as arrays for the kernels."""
    return Senses(
        np.stack(_limits(settings)),
        beams(settings.sonar, vehicle.hull),
        settings.sonar.reach,
        tank(settings.world),
        vehicle.environment.gravity,
        sigmas(settings.noise),
    )


@kernel
def observe_kernel(
    senses: Senses, motion: Motion, scenes: Scenes, k: int, noise: Array, out: Array32
) -> float:
    """Write the observation of vehicle `k` to `out`; return its shortest sonar range without noise [m].

    Args:
        senses: Sensors.
        motion: Motion of all vehicles; the rotation must match the pose.
        scenes: Targets and pillars.
        k: Index of the vehicle.
        noise: Noise added to each observation (36,); overwritten by the noisy observation before clipping.
        out: Observation (36,), written.
    """
    pose, velocity, R, target = motion.pose[k], motion.velocity[k], motion.rotation[k], scenes.targets[k]
    o = noise
    for i in range(3):
        for j in range(3):
            o[TARGET + i] += R[3 * j + i] * (target[j] - pose[j])
        o[VELOCITY + i] += velocity[i]
        o[RATE + i] += velocity[3 + i]
        o[GRAVITY + i] += senses.gravity * R[6 + i]
        o[SPECIFIC_FORCE + i] += motion.specific_force[k, i]
    for i in range(4):
        o[QUATERNION + i] += pose[3 + i]
    o[DEPTH] += pose[2]
    o[ALTITUDE] += senses.tank[FLOOR] - pose[2]
    least = senses.reach
    for beam in range(BEAMS):
        far = sonar_kernel(senses.fan[beam], senses.reach, senses.tank, pose[:3], R, scenes.pillars[k])
        least = min(least, far)
        o[SONAR + beam] += far
    for i in range(OBSERVATIONS):
        out[i] = min(max(np.float32(o[i]), senses.limits[0, i]), senses.limits[1, i])
    return least
