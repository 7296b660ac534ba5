"""Domain randomisation: vehicle, water and sensors of each episode.

A draw depends only on the seed, the index of the vehicle and the number of its episode, as a scene does.
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

STREAM = 1 << 33
"""Key that separates the random stream of these draws from those of scenes and noise."""
TRIES = 50
"""Greatest number of draws until one is a physically possible vehicle."""
NET_WEIGHT = 0.2
"""Net weight of a payload in water, as a share of its weight in air."""
PAYLOAD_OFFSET = 0.5
"""Greatest offset of a payload from the hull's centre, as a share of the hull's half-axes."""


class Draw(NamedTuple):
    """Random differences of one episode: vehicle, biases and delays.

    Attributes:
        vehicle: The vehicle with the water's current; None if nothing differs from the vehicle file.
        bias: Bias of each observation, in multiples of the standard deviation of its noise.
        seen_late: Delay of the sensors [control steps].
        obeyed_late: Delay of the commands [control steps].
    """

    vehicle: Vehicle | None
    bias: Array
    seen_late: int
    obeyed_late: int


class Randomiser:
    """Generator of random vehicles, sensor biases and delays for a fleet's episodes."""

    def __init__(
        self, settings: Settings, vehicle: Vehicle, observations: int, estimates: Estimates | None = None
    ) -> None:
        """Prepare the draws of `settings.randomise`.

        Args:
            settings: All choices.
            vehicle: Vehicle of the plant.
            observations: Number of observations.
            estimates: Estimated parameters of the vehicle file with their covariance.

        Raises:
            UsageError: Parameters are to be drawn from their covariance, and there is none.
        """
        self.given, self._vehicle, self._estimates = settings.randomise, vehicle, estimates
        self._period, self._observations = settings.period, observations
        if self.given.posterior and (estimates is None or not estimates.entries):
            raise UsageError(
                f"{vehicle.name}: no covariance of its numbers to draw from: give a file that `hydro fit`, "
                "`hydro add` or `hydro explain` wrote, together with its .covariance.parquet"
            )
        self._box = _numbers(vehicle) if self.given.box else None

    @property
    def latest(self) -> tuple[int, int]:
        """Greatest delays that can be drawn, of sensors and of commands [control steps]."""
        return self._steps(self.given.delay), self._steps(self.given.late)

    def draw(self, seed: int, number: int, episode: int, current: Array) -> Draw:
        """Return random vehicle, biases and delays for one episode.

        Args:
            seed: Seed of the fleet.
            number: Index of the vehicle in the fleet.
            episode: Number of its episode.
            current: Velocity of the water in its task (3,), NED [m/s].
        """
        given, rng = self.given, np.random.default_rng([seed, number, episode, STREAM])
        vehicle = self._with_conditions(self._draw_possible(rng), current, rng)
        bias = given.bias * rng.standard_normal(self._observations)
        late = [self._steps(_share(given, rng) * most) for most in (given.delay, given.late)]
        return Draw(None if vehicle is self._vehicle else vehicle, bias, *late)

    def _draw_possible(self, rng: np.random.Generator) -> Vehicle:
        """Return the vehicle of the file, or a physically possible one with drawn parameters.

        Raises:
            DataError: No draw is physically possible.
        """
        if not (self.given.posterior or self.given.box):
            return self._vehicle
        for _ in range(TRIES):
            drawn = self._draw_parameters(rng)
            try:
                validate(drawn)
            except DataError:
                continue
            return drawn
        raise DataError(
            f"{self._vehicle.name}: none of {TRIES} drawn vehicles is physically possible: its numbers are "
            "too uncertain, or the box is too large"
        )

    def _draw_parameters(self, rng: np.random.Generator) -> Vehicle:
        """Return the vehicle with parameters drawn from their covariance, or uniformly about their values."""
        if self.given.posterior and self._estimates is not None:
            return next(self._estimates.drawn(self._vehicle, 1, int(rng.integers(2**63))))
        assert self._box is not None
        values = self._box.starts[0]
        factors = 1.0 + self.given.box * rng.uniform(-1.0, 1.0, len(values))
        return self._box.at(self._box.within(values * factors))

    def _with_conditions(self, vehicle: Vehicle, current: Array, rng: np.random.Generator) -> Vehicle:
        """Add the drawn current, payload and thruster fault to a vehicle."""
        given = self.given
        towards, speed = rng.uniform(-np.pi, np.pi), _share(given, rng) * given.current
        flow = current + speed * np.array([np.cos(towards), np.sin(towards), 0.0])
        if flow.any():
            vehicle = changes.in_current(vehicle, flow)
        place, load = rng.uniform(-PAYLOAD_OFFSET, PAYLOAD_OFFSET, 3), _share(given, rng) * given.load
        if given.load:
            hull, mass = vehicle.hull, load * vehicle.rigid_body.mass
            at = np.asarray(hull.center) + place * np.array([hull.length, hull.width, hull.height]) / 2.0
            weight = NET_WEIGHT * mass * vehicle.environment.gravity
            vehicle = changes.with_payload(vehicle, mass, weight, at.tolist())
        which, loss = rng.random(), _share(given, rng) * given.thruster
        if given.thruster:
            pushing = [i for i, thruster in enumerate(vehicle.thruster) if thruster.pushes]
            vehicle = changes.weakened(vehicle, pushing[int(which * len(pushing))], loss)
        return vehicle

    def _steps(self, seconds: float) -> int:
        """Return the number of control steps nearest to a time [s]."""
        return round(seconds / self._period)


def _share(given: Randomisation, rng: np.random.Generator) -> float:
    """Draw a fraction, uniform from 0 to 1; return 1 if `given.full` asks for the greatest values."""
    drawn = float(rng.random())
    return 1.0 if given.full else drawn


def _numbers(vehicle: Vehicle) -> Free:
    """Return the parameters of a vehicle's effects that its file does not mark as known.

    Raises:
        UsageError: The file has no such parameters.
    """
    own = dict.fromkeys(str(effect["name"]) for effect in vehicle.effect)
    names = [name for name in own if not wholly_known(vehicle, name)]
    if not names:
        raise UsageError(f"{vehicle.name}: its file has no effects whose numbers could be drawn")
    return free(vehicle, names)
