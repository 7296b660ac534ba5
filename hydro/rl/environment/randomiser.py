"""The real vehicle is not the file: what each episode's vehicle, water and sensors are.

A draw depends on the seed, the vehicle's number and its episode's number alone, as a task's scene does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import changes, validate
from hydro.core.effects.catalogue import wholly_known
from hydro.core.errors import DataError, UsageError
from hydro.core.prediction.parameters import Free, free
from hydro.core.simulation.estimates import Estimates
from hydro.core.vehicle.description import Vehicle
from hydro.rl.world.config import Randomisation, Settings

APART = 1 << 33
"""Sets the stream of draws apart from those of scenes and noise."""
TRIES = 50
"""Draws until one is a vehicle that can be."""
HEAVINESS = 0.2
"""Share of its weight that a payload has in water."""
ON_BOARD = 0.5
"""Share of the hull's half-axes within which it lies."""


class Draw(NamedTuple):
    """What one episode is flown with.

    Attributes:
        vehicle: The vehicle, in its water; None where it is the file's.
        bias: Of each sensor, in multiples of its noise; one number for each of the observations.
        seen_late: Control steps by which sensors are late.
        obeyed_late: Control steps by which commands are late.
    """

    vehicle: Vehicle | None
    bias: Array
    seen_late: int
    obeyed_late: int


class Randomiser:
    """Draws what the episodes of a fleet are flown with."""

    def __init__(
        self, settings: Settings, vehicle: Vehicle, observations: int, estimates: Estimates | None = None
    ) -> None:
        """Take what is to be drawn from `settings.randomise`.

        Args:
            settings: All choices.
            vehicle: What is flown.
            observations: How many there are.
            estimates: Estimated numbers of the vehicle file with their covariance, to draw from.

        Raises:
            UsageError: The vehicle's numbers are to be drawn from their covariance, and there is none.
        """
        self.given, self._vehicle, self._estimates = settings.randomise, vehicle, estimates
        self._period, self._observations = settings.period, observations
        if self.given.posterior and (estimates is None or not estimates.entries):
            raise UsageError(
                f"{vehicle.name}: no covariance of its numbers to draw from: give a file that `hydro fit`, "
                "`hydro add` or `hydro explain` wrote, with its .covariance.parquet beside it"
            )
        self._box = _numbers(vehicle) if self.given.box else None

    @property
    def latest(self) -> tuple[int, int]:
        """Control steps by which sensors and commands are late at most."""
        return self._steps(self.given.delay), self._steps(self.given.late)

    def draw(self, seed: int, number: int, episode: int, current: Array) -> Draw:
        """What one episode is flown with.

        Args:
            seed: Seed of the fleet.
            number: Number of the vehicle in it.
            episode: Number of its episode.
            current: Velocity of the water that its task asks for (3,), NED [m/s].
        """
        given, rng = self.given, np.random.default_rng([seed, number, episode, APART])
        vehicle = self._in_water(self._possible(rng), current, rng)
        bias = given.bias * rng.standard_normal(self._observations)
        late = [self._steps(_share(given, rng) * most) for most in (given.delay, given.late)]
        return Draw(None if vehicle is self._vehicle else vehicle, bias, *late)

    def _possible(self, rng: np.random.Generator) -> Vehicle:
        """The file's vehicle, or one with other numbers that can be.

        Raises:
            DataError: None of many draws is one.
        """
        if not (self.given.posterior or self.given.box):
            return self._vehicle
        for _ in range(TRIES):
            drawn = self._drawn(rng)
            try:
                validate(drawn)
            except DataError:
                continue
            return drawn
        raise DataError(
            f"{self._vehicle.name}: none of {TRIES} vehicles drawn can be: its numbers are too uncertain, or "
            "the box too large"
        )

    def _drawn(self, rng: np.random.Generator) -> Vehicle:
        """The vehicle with numbers from their covariance, or else from a box."""
        if self.given.posterior and self._estimates is not None:
            return next(self._estimates.drawn(self._vehicle, 1, int(rng.integers(2**63))))
        assert self._box is not None
        values = self._box.starts[0]
        factors = 1.0 + self.given.box * rng.uniform(-1.0, 1.0, len(values))
        return self._box.at(self._box.within(values * factors))

    def _in_water(self, vehicle: Vehicle, current: Array, rng: np.random.Generator) -> Vehicle:
        """A vehicle in a current, with a payload and a weak thruster, where these are drawn."""
        given = self.given
        towards, speed = rng.uniform(-np.pi, np.pi), _share(given, rng) * given.current
        flow = current + speed * np.array([np.cos(towards), np.sin(towards), 0.0])
        if flow.any():
            vehicle = changes.in_current(vehicle, flow)
        place, load = rng.uniform(-ON_BOARD, ON_BOARD, 3), _share(given, rng) * given.load
        if given.load:
            hull, mass = vehicle.hull, load * vehicle.rigid_body.mass
            at = np.asarray(hull.center) + place * np.array([hull.length, hull.width, hull.height]) / 2.0
            weight = HEAVINESS * mass * vehicle.environment.gravity
            vehicle = changes.with_payload(vehicle, mass, weight, at.tolist())
        which, loss = rng.random(), _share(given, rng) * given.thruster
        if given.thruster:
            pushing = [i for i, thruster in enumerate(vehicle.thruster) if thruster.pushes]
            vehicle = changes.weakened(vehicle, pushing[int(which * len(pushing))], loss)
        return vehicle

    def _steps(self, seconds: float) -> int:
        """The nearest number of control steps."""
        return round(seconds / self._period)


def _share(given: Randomisation, rng: np.random.Generator) -> float:
    """Which share of its greatest value something has."""
    drawn = float(rng.random())
    return 1.0 if given.full else drawn


def _numbers(vehicle: Vehicle) -> Free:
    """The numbers of a vehicle's effects that its file does not hold as known.

    Raises:
        UsageError: It has none.
    """
    own = dict.fromkeys(str(effect["name"]) for effect in vehicle.effect)
    names = [name for name in own if not wholly_known(vehicle, name)]
    if not names:
        raise UsageError(f"{vehicle.name}: its file has no effects whose numbers could be drawn")
    return free(vehicle, names)
