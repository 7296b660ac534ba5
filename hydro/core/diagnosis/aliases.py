"""Effects that do exactly what effects of the model do together: no recording tells them apart.

A payload without mass is a net buoyancy and a shifted centre of buoyancy.  Whether an effect is such an alias
its forces say, not a recording: at many states drawn at random, of every attitude, velocity and command, they
are an exact sum of the others' or they are not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hydro.core.columns import Array
from hydro.core.diagnosis.model import Model
from hydro.core.effects import inertia_matrix
from hydro.core.identification.candidate import accelerations, candidate
from hydro.core.identification.levenberg_marquardt import moved
from hydro.core.identification.suspects import suspects
from hydro.core.recording.arrays import Recording
from hydro.core.vehicle.description import Vehicle

EXACT = 1e-6
"""Part of a column that may be left over of it, for rounding alone."""
STATES = 200
MIDDLE = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
REACH = np.array([10.0, 10.0, 4.0, 0.6, 1.2, np.pi])  # m and rad, about it
SPEED = np.array([1.5, 1.5, 1.5, 1.0, 1.0, 1.0])  # m/s and rad/s


def aliases(model: Model, known: Sequence[str], reach: Array | None = None) -> dict[str, tuple[str, ...]]:
    """Effects whose forces the model's own effects have already.

    Inertia that an effect has besides does not count: it shows in accelerations, and is another matter.

    Args:
        model: The vehicle and its free entries.
        known: Names of the effects that are in it, which are not asked about.
        reach: Positions of the recording, (N, 3), among which an anchor is looked for.

    Returns:
        The effects of the model that each alias is made of, by the alias' name.
    """
    if not model.unknown.entries:
        return {}
    states = _states(len(model.vehicle.thruster))
    still, inertia = _forces(model.vehicle, states), inertia_matrix(model.vehicle)

    def unit(vehicle: Vehicle) -> Array:
        column = _forces(vehicle, states) - still
        size = float(np.linalg.norm(column))
        return column / size if size > EXACT * EXACT * float(np.linalg.norm(still)) else 0.0 * column

    own = np.stack([unit(vehicle) for vehicle in moved(model.unknown, model.values)[0]], axis=1)
    found: dict[str, tuple[str, ...]] = {}
    for suspect in suspects(model.vehicle, without=known, reach=reach):
        forces = [one for one in suspect.changed if np.array_equal(inertia_matrix(one), inertia)]
        columns = np.stack([unit(one) for one in forces], axis=1) if forces else np.zeros((len(own), 1))
        if not columns.any(axis=0).all():
            continue
        amounts = np.linalg.lstsq(own, columns, rcond=None)[0]
        if np.linalg.norm(columns - own @ amounts, axis=0).max() <= EXACT:
            used = np.abs(amounts).max(axis=1) > EXACT
            pairs = zip(model.unknown.entries, used, strict=True)
            found[suspect.effect] = tuple(dict.fromkeys(entry.effect for entry, one in pairs if one))
    return found


def _forces(vehicle: Vehicle, states: Recording) -> Array:
    """What a vehicle's forces make of some states, (6 N,): its accelerations."""
    return accelerations(candidate(vehicle), states, states.eta, states.nu).ravel()


def _states(thrusters: int) -> Recording:
    """States that no two effects share by chance: each row on its own."""
    rng = np.random.default_rng(0)
    return Recording(
        t=np.linspace(0.0, 0.02 * (STATES - 1), STATES),
        eta=MIDDLE + rng.uniform(-REACH, REACH, (STATES, 6)),
        nu=rng.uniform(-SPEED, SPEED, (STATES, 6)),
        commands=rng.uniform(-1.0, 1.0, (STATES, thrusters)),
        segments=np.array([[0, STATES]], np.int64),
        after_gap=np.zeros(1, bool),
        session=np.zeros(1, np.int64),
        dt=0.02,
    )
