"""Conversion of effects to polynomials of velocity or constant vertical forces, by numerical trial.

Gazebo supports drag with coefficients of nu_j, |nu_k| nu_j and nu_k nu_j.  The wrench of an effect's kernel
is evaluated in many states of motion and fitted by such a polynomial.  The effect has this form if no
residual remains for any pose, time and commands.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects import layout
from hydro.core.effects.catalogue import Entry
from hydro.core.vehicle.frames import rotation, skew

SAMPLES = 300  # number of trial states, several times the 66 coefficients of a law
FASTEST = 1.5
"""Maximum velocities of the trial states, in both directions [m/s, rad/s]."""
CLOSE = 1e-9
"""Tolerance of rounding errors relative to the largest force."""
PAIRS = tuple(itertools.product(range(6), repeat=2))
PRODUCTS = tuple((j, k) for j, k in PAIRS if j <= k)


@dataclass(frozen=True)
class Law:
    """Wrench on a vehicle as a polynomial of its velocity nu through the water, body axes (FRD) about CO.

    Indices i, j, k are 0 to 5 for X Y Z K M N and u v w p q r.

    Attributes:
        linear: (6, 6): tau_i += linear[i, j] nu_j.
        sized: (6, 6, 6): tau_i += sized[i, j, k] |nu_k| nu_j.
        plain: (6, 6, 6): tau_i += plain[i, j, k] nu_k nu_j.
        force: Constant force downward in the world [N].
        moment: (3,) [N m]: (K, M, N) += moment x d, the cross product with the world's down direction d in
            body axes.
    """

    linear: Array
    sized: Array
    plain: Array
    force: float
    moment: Array

    @classmethod
    def none(cls) -> Law:
        """Return a law without force."""
        return cls(np.zeros((6, 6)), np.zeros((6, 6, 6)), np.zeros((6, 6, 6)), 0.0, np.zeros(3))

    def __add__(self, other: Law) -> Law:
        return Law(
            self.linear + other.linear,
            self.sized + other.sized,
            self.plain + other.plain,
            self.force + other.force,
            self.moment + other.moment,
        )


def law(entry: Entry, constants: Array) -> Law | None:
    """Return an effect as a polynomial of velocity plus a constant vertical force, if it has that form.

    Args:
        entry: Effect with its parameters.
        constants: Constants of the vehicle (`core.effects.layout`).

    Returns:
        The polynomial; None if the effect has another form, such as one that depends on position or commands.
    """
    effect, parameters, _ = entry
    if effect.states is not None or effect.kernel is None:
        return None
    motions, nu, down = _motions()
    wrenches = np.zeros((SAMPLES, 6))
    nothing = np.zeros(0)
    for s, tau in zip(motions, wrenches, strict=True):
        effect.kernel(parameters, constants, s, nothing, nothing, tau)
    if not np.isfinite(wrenches).all():
        return None
    columns = _columns(nu, down)
    found: Array = np.asarray(np.linalg.lstsq(columns, wrenches, rcond=None)[0], np.float64)
    size = float(np.abs(wrenches).max())
    if np.abs(wrenches - columns @ found).max() > CLOSE * size:
        return None
    found[np.abs(found) < CLOSE * size] = 0.0
    return _law(found, CLOSE * size)


def _motions() -> tuple[Array, Array, Array]:
    """Return random states of motion (N, MOTION), with their velocities (N, 6) and down directions (N, 3)."""
    rng = np.random.default_rng(0)
    nu = rng.uniform(-FASTEST, FASTEST, (SAMPLES, 6))
    turned = rotation(*rng.uniform(-1.2, 1.2, (3, SAMPLES)))
    motions = np.zeros((SAMPLES, layout.MOTION))
    motions[:, layout.RELATIVE_VELOCITY : layout.RELATIVE_VELOCITY + 6] = nu
    motions[:, layout.VELOCITY : layout.VELOCITY + 6] = nu
    motions[:, layout.ROTATION : layout.ROTATION + 9] = turned.reshape(-1, 9)
    motions[:, layout.POSITION : layout.POSITION + 3] = rng.uniform(0.0, 20.0, (SAMPLES, 3))
    motions[:, layout.TIME] = rng.uniform(0.0, 100.0, SAMPLES)
    motions[:, layout.COMMANDS :] = rng.uniform(-1.0, 1.0, (SAMPLES, layout.MOST_COMMANDS))
    return motions, nu, turned[:, 2]


def _columns(nu: Array, down: Array) -> Array:
    """Return the regressors of the polynomial and the vertical force, (N, 6 + 36 + 21 + 3)."""
    sized = np.stack([np.abs(nu[:, k]) * nu[:, j] for j, k in PAIRS], axis=1)
    plain = np.stack([nu[:, k] * nu[:, j] for j, k in PRODUCTS], axis=1)
    return np.hstack([nu, sized, plain, down])


def _law(found: Array, close: float) -> Law | None:
    """Return fitted coefficients (66, 6) as a `Law`; None if the constant part is not a vertical force."""
    linear, sized, plain, still = np.split(found, np.cumsum([6, len(PAIRS), len(PRODUCTS)]))
    force, turning = still.T[:3], still.T[3:]
    moment = np.array([turning[2, 1], turning[0, 2], turning[1, 0]])
    if max(np.abs(force - force[0, 0] * np.eye(3)).max(), np.abs(turning - skew(moment)).max()) > close:
        return None
    by_size, by_product = np.zeros((6, 6, 6)), np.zeros((6, 6, 6))
    for (j, k), values in zip(PAIRS, sized, strict=True):
        by_size[:, j, k] = values
    for (j, k), values in zip(PRODUCTS, plain, strict=True):
        by_product[:, j, k] = values
    return Law(linear.T, by_size, by_product, float(force[0, 0]), moment)
