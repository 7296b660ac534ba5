"""Correction of the delay of a DVL: velocities are moved to the times at which they were measured.

Thrusters act on accelerations.  The accelerations of a late DVL lag behind the commands, and behind the rates
of turn, which another sensor measures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from hydro.core.effects.sensor import SENSOR_DELAY
from hydro.core.errors import DataError
from hydro.core.preprocessing.sensor_tests import KinematicTest, kinematic_tests, shown
from hydro.core.recording.arrays import Recording


def lateness(tests: Callable[[], Mapping[str, KinematicTest]]) -> float:
    """Return the delay of the DVL [s] that a kinematic test shows; 0 if the test shows no delay.

    Args:
        tests: Function that returns the kinematic tests by effect; may raise a DataError for a short
            recording, which then counts as no delay.
    """
    try:
        test = tests().get(SENSOR_DELAY.name)
    except DataError:
        return 0.0
    return float(test.estimate[0]) if test is not None and shown(test) else 0.0


def on_time(record: Recording, late: float | None = None) -> Recording:
    """Return a recording with its linear velocities moved to the times at which they were measured.

    Args:
        record: The recording.
        late: Delay of the velocities [s]; by default that which the kinematic tests show.

    Returns:
        A copy whose u, v, w are interpolated at t + late; the recording itself without a delay.
    """
    late = lateness(lambda: kinematic_tests(record)) if late is None else late
    if not late:
        return record
    nu = record.nu.copy()
    for start, stop in record.segments:
        t = record.t[start:stop]
        for axis in range(3):
            nu[start:stop, axis] = np.interp(t + late, t, record.nu[start:stop, axis])
    return replace(record, nu=nu)
