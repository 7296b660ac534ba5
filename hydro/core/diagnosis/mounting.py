"""Attitude sensor that is mounted at an angle to the vehicle.

Pose and velocity show only the angle between attitude sensor and DVL.  Thrust and weight show which of the
two is turned against the vehicle.  So the vehicle is fitted twice: to the log with attitude and rates turned
back, and with the DVL turned.  If the first fit has the smaller residual, the diagnosis continues with that
log.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import polars as pl

from hydro.core.columns import POSE, VELOCITY, Array
from hydro.core.diagnosis.findings import Finding, extended
from hydro.core.diagnosis.log_faults import Preprocessed, preprocess
from hydro.core.effects import CATALOGUE
from hydro.core.effects.sensor import ANGLES
from hydro.core.preprocessing.sensor_tests import KinematicTest
from hydro.core.residual.hull import Hull
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import euler_from_rotation, rotation

ATTITUDE, RATES = POSE[3:], VELOCITY[3:]


def with_mounting(
    vehicle: Vehicle,
    log: Preprocessed,
    errors: Iterable[KinematicTest],
    misfit: Callable[[Vehicle, Preprocessed], float],
    hull: Hull | None = None,
) -> Preprocessed:
    """Return the recording, with attitude and rates turned back if their sensor is mounted at an angle.

    `errors` are kinematic tests that show errors; `misfit` is the mean squared residual of a vehicle in a
    recording.
    """
    test = next((one for one in errors if _turns(one)), None)
    if test is None or vehicle.effects(test.effect):
        return log
    back = preprocess(vehicle, turned_back(log.raw, test.estimate), hull)
    if misfit(vehicle, back) >= misfit(extended(vehicle, [test.table]), log):
        return log
    return replace(back, faults=(_fault(test), *log.faults))


def _turns(test: KinematicTest) -> bool:
    """Return whether a test is that of angles between the DVL and the attitude sensor."""
    kinematics = CATALOGUE[test.effect].kinematics
    return kinematics is not None and kinematics.place == ANGLES


def turned_back(raw: pl.DataFrame, angles: Array) -> pl.DataFrame:
    """Return a raw table whose attitude and rates are those of the DVL's axes.

    Args:
        raw: Raw table.
        angles: Roll, pitch and yaw of the DVL against the axes of the attitude, (3,) [rad].
    """
    turn = rotation(*angles)
    attitude, rates = (raw.select(names).cast(pl.Float64).to_numpy() for names in (ATTITUDE, RATES))
    euler = euler_from_rotation(rotation(*attitude.T) @ turn)
    columns = zip((*ATTITUDE, *RATES), np.hstack([euler, rates @ turn]).T, strict=True)
    return raw.with_columns(pl.Series(name, values, nan_to_null=True) for name, values in columns)


def _fault(test: KinematicTest) -> Finding:
    """Return the finding that the attitude sensor is turned, with its mounting for the map of the log."""
    mount = np.degrees(euler_from_rotation(rotation(*test.estimate).T))
    errors = np.degrees(test.standard_error)
    told = ", ".join(
        f"{name} {angle:.3g} ± {error:.2g}°"
        for name, angle, error in zip(("roll", "pitch", "yaw"), mount, errors, strict=True)
    )
    line = ", ".join(
        f"{name} = {angle:.2f}" for name, angle in zip(("roll", "pitch", "yaw"), mount, strict=True)
    )
    words = (
        f"the sensor of attitude and rates is turned against DVL and thrusters ({told}); the diagnosis "
        f"turned it back. Write mount = {{{line}}} in [attitude] and [rates] of the map"
    )
    return Finding("log_fault", members=(*ATTITUDE, *RATES), confidence=1.0 - test.p_value, advice=words)
