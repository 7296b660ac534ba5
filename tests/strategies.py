"""Hypothesis strategies for physically valid vehicles, states and commands, shared by all tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hydro.core.columns import Array
from hydro.core.vehicle.description import Buoyancy, Environment, Hull, RigidBody, Thruster, Vehicle


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Ordinary finite floats in [low, high]; no subnormals, which only measure rounding."""
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


def vectors(size: int, bound: float = 1.0) -> st.SearchStrategy[Array]:
    """Float vectors with components in [-bound, bound]."""
    return arrays(np.float64, size, elements=numbers(-bound, bound))


def angles(bound: float = np.pi) -> st.SearchStrategy[float]:
    """Angles [rad], the tricky ones (0, quarter and half turns) among the simple."""
    special = [a for a in (0.0, np.pi / 2, -np.pi / 2, np.pi, -np.pi, 1e-9, -1e-9) if abs(a) <= bound]
    return st.one_of(numbers(-bound, bound), st.sampled_from(special))


def attitudes() -> st.SearchStrategy[Array]:
    """(phi, theta, psi) [rad] with theta within 89 degrees, where Euler angles are regular."""
    return st.tuples(angles(), numbers(-1.55, 1.55), angles()).map(np.array)


def velocities() -> st.SearchStrategy[Array]:
    """nu = (u, v, w, p, q, r) of an underwater vehicle: up to 3 m/s and 2 rad/s."""
    scale = np.array([3.0, 3.0, 3.0, 2.0, 2.0, 2.0])
    return vectors(6).map(lambda x: scale * x)


@st.composite
def states(draw: st.DrawFn) -> tuple[Array, Array]:
    """(eta, nu): position below the surface, attitude away from the Euler singularity, and velocity."""
    position = draw(vectors(3, 50.0)) + np.array([0.0, 0.0, 60.0])
    return np.concatenate([position, draw(attitudes())]), draw(velocities())


@st.composite
def rotations(draw: st.DrawFn) -> Array:
    """Rotation matrices, from unit quaternions."""
    q = draw(vectors(4).filter(lambda x: np.linalg.norm(x) > 0.1))
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@st.composite
def inertias(draw: st.DrawFn, mass: float = 1.0, size: float = 1.0) -> Array:
    """Inertia matrices of real bodies: made of second moments of mass, so the triangle inequality holds.

    Radii of gyration per axis are between 5 % and 50 % of `size`; the principal axes point anywhere.
    """
    radii = draw(arrays(np.float64, 3, elements=numbers(0.05 * size, 0.5 * size)))
    axes = draw(rotations())
    moments = mass * axes @ np.diag(radii**2) @ axes.T
    inertia = np.trace(moments) * np.eye(3) - moments
    return 0.5 * (inertia + inertia.T)


@st.composite
def spd_matrices(draw: st.DrawFn, size: int = 6, scale: float = 100.0) -> Array:
    """Symmetric positive definite matrices with full couplings and eigenvalues of 1 % of `scale` and more."""
    factor = draw(arrays(np.float64, (size, size), elements=numbers(-1.0, 1.0)))
    return scale * (factor @ factor.T + 0.01 * np.eye(size))


@st.composite
def thrusters(draw: st.DrawFn, name: str = "T1", **fixed: Any) -> Thruster:
    """Thrusters of every curve, lag and dead-band style, anywhere; `fixed` fields stay as given."""
    direction = draw(vectors(3).filter(lambda x: np.linalg.norm(x) > 0.1))
    constant = draw(st.one_of(st.just(0.0), numbers(0.02, 0.5)))
    euler = constant > 0.0 and draw(st.booleans())
    fields: dict[str, Any] = {
        "name": name,
        "position": _floats(draw(vectors(3))),
        "direction": _floats(direction / np.linalg.norm(direction)),
        "max_thrust": draw(numbers(5.0, 300.0)),
        "max_reverse_thrust": draw(numbers(5.0, 300.0)),
        "curve": draw(st.sampled_from(["linear", "quadratic"])),
        "lag": draw(st.sampled_from(["thrust", "speed"])),
        "time_constant": constant,
        "lag_step": draw(numbers(0.05, 0.5)) * constant if euler else None,
        "deadband": draw(st.one_of(st.just(0.0), numbers(0.0, 0.3))),
        "deadband_style": draw(st.sampled_from(["cut", "shift"])),
        "delay": draw(st.one_of(st.just(0.0), numbers(0.0, 0.1))),
    }
    return Thruster(**(fields | fixed))


def commands(rows: int, thrusters: int, bound: float = 1.0) -> st.SearchStrategy[Array]:
    """Commands, shape (rows, thrusters), in [-bound, bound]; beyond 1 they must be clipped."""
    return arrays(np.float64, (rows, thrusters), elements=numbers(-bound, bound))


@st.composite
def vehicles(draw: st.DrawFn, max_thrusters: int = 8, **fixed: Any) -> Vehicle:
    """Vehicles that could be built: real inertia, centres off the origin, any thrusters; `fixed` as given."""
    mass = draw(numbers(5.0, 500.0))
    environment = Environment(draw(numbers(990.0, 1030.0)), draw(numbers(9.77, 9.84)))
    inertia = draw(inertias(mass))
    count = draw(st.integers(0, max_thrusters))
    fields: dict[str, Any] = {
        "name": "random",
        "rigid_body": RigidBody(mass, _floats(draw(vectors(3, 0.3))), tuple(map(_floats, inertia))),
        "buoyancy": Buoyancy(
            mass * environment.gravity * draw(numbers(0.9, 1.1)), _floats(draw(vectors(3, 0.3)))
        ),
        "hull": Hull(*(draw(numbers(0.3, 3.0)) for _ in range(3))),
        "environment": environment,
        "thruster": tuple(draw(thrusters(f"T{i + 1}")) for i in range(count)),
    }
    return Vehicle(**(fields | fixed))


def _floats(values: Array) -> tuple[float, ...]:
    """Plain floats, as a vehicle file gives them."""
    return tuple(values.tolist())
