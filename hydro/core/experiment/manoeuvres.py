"""Which manoeuvre to fly next, by prediction.

Rivals are vehicles that explain a recording about as well, by different effects.  Each short manoeuvre of a
library is simulated; the one in which the rivals would differ most, in units of the sensors' noise, is the
one to fly.  They are compared as a diagnosis would compare them: over shots of two seconds whose beginnings
are free (`prediction.multiple_shooting`), so that what a little other beginning could imitate does not
count.
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
"""Depth at which a manoeuvre begins where nothing else is said [m]."""


@dataclass(frozen=True)
class Flight:
    """A manoeuvre and what it would show.

    Attributes:
        manoeuvre: What to fly.
        difference: Predicted difference between the two rivals hardest to part, in standard deviations of
            the noise: the root of the sum of squares over all that is logged.
    """

    manoeuvre: Manoeuvre
    difference: float


def best(rivals: Sequence[Vehicle], noise: ArrayLike, *, start: ArrayLike | None = None) -> Flight:
    """The manoeuvre that tells rivals apart.

    Args:
        rivals: Two vehicles or more with the same thrusters; the manoeuvres are those of the first.
        noise: Standard deviations of position, attitude, velocity and rates, (12,) [m, rad, m/s, rad/s].
        start: Pose at which it begins, at rest, (6,); by default level, heading north, 5 m deep.

    Raises:
        DataError: Fewer than two rivals, or no manoeuvre that their thrusters can fly and that stays finite.
    """
    if len(rivals) < 2:
        raise DataError("give at least two vehicles to tell apart")
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
    """The manoeuvre in which each change of a vehicle would show most.

    Args:
        vehicle: The vehicle.
        changed: The vehicle with an effect of `plain` size, by the effect's name.
        noise: As for `best`.
        start: As for `best`.

    Raises:
        DataError: No manoeuvre that the vehicle's thrusters can fly and that stays finite.
    """
    found: dict[str, Flight] = {}
    for manoeuvre, gram in _grams(vehicle, list(changed.values()), noise, start):
        for name, size in zip(changed, np.sqrt(np.maximum(np.diag(gram), 0.0)), strict=True):
            if name not in found or size > found[name].difference:
                found[name] = Flight(manoeuvre, float(size))
    return found


def plain(vehicle: Vehicle, effect: str, entries: Sequence[int] | None = None) -> Vehicle:
    """The vehicle with more of an effect, by as much as would be plain to see.

    Args:
        vehicle: The vehicle.
        effect: Name in the catalogue.
        entries: Which of its free entries, in the order of `parameters.free`; by default all.

    Raises:
        DataError: The name is not in the catalogue, or the file has several of the effect.
    """
    unknown = free(vehicle, [effect])
    chosen = range(len(unknown.entries)) if entries is None else entries
    values = unknown.starts[0].copy()
    values[list(chosen)] += unknown.scales[list(chosen)]
    return unknown.at(unknown.within(values))


def _grams(
    reference: Vehicle, others: Sequence[Vehicle], noise: ArrayLike, start: ArrayLike | None
) -> list[tuple[Manoeuvre, Array]]:
    """Each manoeuvre, with the products (R, R) of how the others would differ from the reference in it."""
    sigma = np.asarray(noise, float)
    pose = np.array([0.0, 0.0, DEPTH, 0.0, 0.0, 0.0]) if start is None else np.asarray(start, float)
    models = [candidate(vehicle) for vehicle in (reference, *others)]
    lead = LONGEST_SENSOR_DELAY if any(model.log[DELAY] for model in models) else 0.0

    def flown(manoeuvre: Manoeuvre) -> tuple[Manoeuvre, Array] | None:
        """A manoeuvre with its products; None of one that diverges, which is none to propose."""
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
    """Shots of a predicted motion (N, 12), begun where it is, with what a vehicle would log as measured."""
    shots = make_shots(_record(manoeuvre, motion), lead=lead, sigma=sigma)
    shots = replace(shots, first=body_states(motion[:, :6], motion[:, 6:])[shots.starts])
    return replace(shots, measured=multiple_shooting.predict(multiple_shooting.prepare(model, shots), shots))


def _record(manoeuvre: Manoeuvre, motion: Array) -> Recording:
    """A predicted motion (N, 12) as a recording of one session."""
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
