"""Choice of the next manoeuvre by prediction.

Rivals are vehicle models that explain a recording about equally well with different effects.  Each short
manoeuvre of the library is simulated.  The recommended manoeuvre has the largest predicted difference between
the rivals, in units of the sensor noise.  Predictions are compared in shots, as in a diagnosis: pieces of two
seconds with free initial values (`prediction.multiple_shooting`).  So a difference that other initial values
could imitate does not count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hydro.core.columns import Array
from hydro.core.effects.sensor import DELAY
from hydro.core.errors import DataError
from hydro.core.experiment.library import Manoeuvre, library
from hydro.core.prediction import multiple_shooting
from hydro.core.prediction.candidate import Candidate, candidate
from hydro.core.prediction.parameters import LONGEST_SENSOR_DELAY, free
from hydro.core.prediction.sensitivity import linearise
from hydro.core.recording.arrays import Recording
from hydro.core.recording.shots import Shots, make_shots
from hydro.core.simulation.excitation import LOG_RATE
from hydro.core.simulation.simulate import trajectory
from hydro.core.threads import spread
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import body_states

DEPTH = 5.0
"""Default start depth of a manoeuvre [m]."""


@dataclass(frozen=True)
class Flight:
    """Manoeuvre and the difference between vehicle models that it would show.

    Attributes:
        manoeuvre: The manoeuvre.
        difference: Predicted difference between two models, in standard deviations of the sensor noise: root
            of the sum of squares over all logged channels and samples.  `best` gives that of the two most
            similar models.
    """

    manoeuvre: Manoeuvre
    difference: float


def best(rivals: Sequence[Vehicle], noise: ArrayLike, *, start: ArrayLike | None = None) -> Flight:
    """Return the manoeuvre that best separates the two most similar of several vehicle models.

    Args:
        rivals: Two or more vehicles with the same thrusters; the manoeuvres are those of the first.
        noise: Standard deviations of position, attitude, velocity and rates, (12,) [m, rad, m/s, rad/s].
        start: Start pose, NED, (6,) [m, rad], at rest; by default level, heading north, 5 m deep.

    Returns:
        The manoeuvre, with the predicted difference of the two models.

    Raises:
        DataError: Fewer than two rivals, or every manoeuvre diverges.
    """
    if len(rivals) < 2:
        raise DataError("give at least two vehicles to compare")
    flights = []
    for manoeuvre, gram in _grams(rivals[0], rivals[1:], noise, start):
        size = np.diag(gram)
        apart = size[:, None] + size - 2.0 * gram
        pairs = [*size, *apart[np.triu_indices(len(size), 1)]]
        flights.append(Flight(manoeuvre, float(np.sqrt(max(min(pairs), 0.0)))))
    return max(flights, key=lambda flight: flight.difference)


def showing(
    vehicle: Vehicle, changed: Mapping[str, Vehicle], noise: ArrayLike, *, start: ArrayLike | None = None
) -> dict[str, Flight]:
    """Return, for each of several changes of a vehicle, the manoeuvre that shows the change best.

    Args:
        vehicle: The unchanged vehicle.
        changed: Vehicles with one changed effect each (from `plain`), by the effect's name.
        noise: Standard deviations of position, attitude, velocity and rates, (12,) [m, rad, m/s, rad/s].
        start: Start pose, NED, (6,) [m, rad], at rest; by default level, heading north, 5 m deep.

    Returns:
        Manoeuvre and predicted difference from the unchanged vehicle, by the effect's name.

    Raises:
        DataError: Every manoeuvre diverges.
    """
    found: dict[str, Flight] = {}
    for manoeuvre, gram in _grams(vehicle, list(changed.values()), noise, start):
        for name, size in zip(changed, np.sqrt(np.maximum(np.diag(gram), 0.0)), strict=True):
            if name not in found or size > found[name].difference:
                found[name] = Flight(manoeuvre, float(size))
    return found


def plain(vehicle: Vehicle, effect: str, entries: Sequence[int] | None = None) -> Vehicle:
    """Return a copy of a vehicle in which each component of an effect is larger by a significant amount.

    The amount is the component's scale.

    Args:
        vehicle: The vehicle.
        effect: Name in the catalogue.
        entries: Indices of the components to change, in the order of `parameters.free`; by default all.

    Raises:
        DataError: The name is not in the catalogue, or the file has several effects of this name.
    """
    unknown = free(vehicle, [effect])
    chosen = range(len(unknown.entries)) if entries is None else entries
    values = unknown.starts[0].copy()
    values[list(chosen)] += unknown.scales[list(chosen)]
    return unknown.at(unknown.within(values))


def _grams(
    reference: Vehicle, others: Sequence[Vehicle], noise: ArrayLike, start: ArrayLike | None
) -> list[tuple[Manoeuvre, Array]]:
    """Return, for each manoeuvre, the inner products of R vehicles' differences from a reference, (R, R).

    Differences are divided by the noise; those that other initial values of the shots can imitate are
    removed.
    """
    sigma = np.asarray(noise, float)
    pose = np.array([0.0, 0.0, DEPTH, 0.0, 0.0, 0.0]) if start is None else np.asarray(start, float)
    models = [candidate(vehicle) for vehicle in (reference, *others)]
    lead = LONGEST_SENSOR_DELAY if any(model.log[DELAY] for model in models) else 0.0

    def flown(manoeuvre: Manoeuvre) -> tuple[Manoeuvre, Array] | None:
        """Return a manoeuvre with its Gram matrix, or None if a model diverges in it."""
        try:
            motion = trajectory(models[0].program, manoeuvre.commands, manoeuvre.t, eta=pose, steps=1)
        except DataError:
            return None
        shots = predicted_shots(models[0], manoeuvre, motion, sigma, lead)
        own, *rest = (multiple_shooting.prepare(model, shots) for model in models)
        normal = linearise(own, rest, [1.0] * len(rest), shots, threads=1)
        return None if normal.lost.any() else (manoeuvre, normal.matrix.sum(axis=0))

    every = [one for one in spread(flown, library(reference)) if one is not None]
    if not every:
        raise DataError(f"every manoeuvre of vehicle {reference.name} diverges; check its damping")
    return every


def predicted_shots(
    model: Candidate, manoeuvre: Manoeuvre, motion: Array, sigma: Array, lead: float
) -> Shots:
    """Return shots of a predicted flight; their measurements are the model's predictions without noise.

    Args:
        model: Model that predicts the flight.
        manoeuvre: Commands of the flight.
        motion: True pose, NED, and body velocity in N rows, (N, 12) [m, rad, m/s, rad/s]; gives the initial
            states.
        sigma: Standard deviations of the sensors, (12,) [m, rad, m/s, rad/s].
        lead: Time at the start of each shot that is predicted but not compared, for late sensors [s].
    """
    shots = make_shots(_record(manoeuvre, motion), lead=lead, sigma=sigma)
    shots = replace(shots, first=body_states(motion[:, :6], motion[:, 6:])[shots.starts])
    return replace(shots, measured=multiple_shooting.predict(multiple_shooting.prepare(model, shots), shots))


def _record(manoeuvre: Manoeuvre, motion: Array) -> Recording:
    """Return a predicted motion (N, 12) as a recording of one session."""
    rows = len(motion)
    return Recording(
        t=manoeuvre.t,
        eta=motion[:, :6].copy(),
        nu=motion[:, 6:].copy(),
        commands=np.ascontiguousarray(manoeuvre.commands),
        segments=np.array([[0, rows]], np.int64),
        after_gap=np.zeros(1, bool),
        session=np.zeros(1, np.int64),
        dt=1.0 / LOG_RATE,
    )
