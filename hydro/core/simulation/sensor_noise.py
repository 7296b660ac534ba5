"""Sensor noise of a simulated recording: white and Gaussian, with a size for each kind of measurement."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError
from hydro.core.vehicle.frames import wrapped


@dataclass(frozen=True)
class Noise:
    """Standard deviations (1 sigma) of the noise of logged quantities.

    Attributes:
        velocity: Standard deviation of u, v, w [m/s].
        rate: Standard deviation of p, q, r [rad/s].
        position: Standard deviation of x, y, z [m].
        attitude: Standard deviation of phi, theta, psi [rad].

    Raises:
        DataError: A standard deviation is negative or not finite.
    """

    velocity: float = 0.0
    rate: float = 0.0
    position: float = 0.0
    attitude: float = 0.0

    def __post_init__(self) -> None:
        """Refuse invalid standard deviations."""
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < np.inf:
                raise DataError(f"noise: {field.name} must be a finite number of at least 0, not {value!r}")

    @property
    def deviations(self) -> Array:
        """Standard deviations of x y z, phi theta psi, u v w, p q r, (12,) [m, rad, m/s, rad/s]."""
        return np.repeat([self.position, self.attitude, self.velocity, self.rate], 3)


PROFILES = {
    "none": Noise(),
    "ordinary": Noise(velocity=0.01, rate=0.002, position=0.02, attitude=0.001),
    "dvl": Noise(velocity=0.05, rate=0.01, position=0.02, attitude=0.002),
}
"""Noise profiles by name: none, an ordinary navigation suite, and the DVL of Deep Hydro-Sim (III-D)."""


def disturb(motion: Array, noise: Noise, rng: np.random.Generator) -> Array:
    """Return a copy of a logged motion with random noise added.

    Args:
        motion: x y z [m], phi theta psi [rad], u v w [m/s], p q r [rad/s] in N rows, (N, 12).
        noise: Standard deviations.
        rng: Generator of the random numbers.

    Returns:
        (N, 12); phi and psi wrapped to (-pi, pi], theta clipped to [-pi/2, pi/2].
    """
    noisy: Array = motion + rng.standard_normal(motion.shape) * noise.deviations
    noisy[:, [3, 5]] = wrapped(noisy[:, [3, 5]])
    noisy[:, 4] = np.clip(noisy[:, 4], -0.5 * np.pi, 0.5 * np.pi)
    return noisy
