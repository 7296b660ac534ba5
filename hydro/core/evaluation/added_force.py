"""Force by which two vehicle files differ along a recorded motion."""

from __future__ import annotations

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.layout import MASS_MATRIX
from hydro.core.effects.program import constants_of
from hydro.core.prediction.candidate import accelerations, candidate
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle


def added_force(vehicle: Vehicle, without: Vehicle, record: Recording, eta: Array, nu: Array) -> Array:
    """Return the wrench on the vehicle that an effect adds along a recorded motion, (N, 6) [N, N m].

    The result is M (a - a_0) with the acceleration a with the effect, a_0 without the effect, and the mass
    matrix M of `vehicle`, added mass included.  For an effect that changes the inertia, the result is the
    wrench that would cause the same change of acceleration.

    Args:
        vehicle: Vehicle file with the effect.
        without: The same vehicle file without the effect.
        record: Recording of N rows.
        eta: Smoothed pose of the recording, NED, (N, 6) [m, rad].
        nu: Smoothed velocity of CO, body axes, (N, 6) [m/s, rad/s].

    Raises:
        DataError: An effect of a vehicle file is unknown or has invalid values.
    """
    model = candidate(vehicle)
    with_it = accelerations(model, record, eta, nu)
    difference = with_it - accelerations(candidate(without), record, eta, nu)
    mass = constants_of(model.program.flat)[MASS_MATRIX : MASS_MATRIX + 36].reshape(6, 6)
    force: Array = np.asarray(difference @ mass.T)
    return force
