"""A vehicle with known hydrodynamics, simulated by scipy from Fossen's equations: an oracle apart from hydro.

Nothing of hydro computes anything here but the records of the vehicle file.  Fossen (2011): (7.190)
M nu_dot + C(nu) nu + D(nu) nu + g(eta) = tau, (2.18) R, (2.28) Euler rates, (3.46) C from M, (4.6) g.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import polars as pl
from scipy.integrate import solve_ivp

from hydro.core.vehicle.description import Buoyancy, Environment, Hull, RigidBody, Thruster, Vehicle

MASS, WEIGHT_ARM, BUOYANCY, BUOYANCY_ARM = 151.0, (0.01, -0.005, 0.03), 1484.0, (0.0, 0.0, -0.05)
INERTIA = ((6.0, 0.1, -0.2), (0.1, 16.0, 0.3), (-0.2, 0.3, 18.0))
ADDED = (35.0, 120.0, 160.0, 3.0, 12.0, 10.0)
LINEAR = np.array([15.0, 40.0, 60.0, 5.0, 10.0, 8.0])
QUADRATIC = np.array([95.0, 260.0, 380.0, 10.0, 40.0, 30.0])
LAG, MAX_THRUST, GRAVITY = 0.15, 155.0, 9.81
FRONT, SIDE, SLANT = 0.45, 0.3, float(np.sqrt(0.5))
PLACES = (  # position and direction of four horizontal and four vertical thrusters
    ((FRONT, SIDE, 0.0), (SLANT, -SLANT, 0.0)),
    ((FRONT, -SIDE, 0.0), (SLANT, SLANT, 0.0)),
    ((-FRONT, SIDE, 0.0), (SLANT, SLANT, 0.0)),
    ((-FRONT, -SIDE, 0.0), (SLANT, -SLANT, 0.0)),
    *(((x, y, 0.0), (0.0, 0.0, 1.0)) for x in (0.3, -0.3) for y in (0.3, -0.3)),
)


def vehicle() -> Vehicle:
    """The vehicle file of the simulated vehicle; its damping is not in it."""
    return Vehicle(
        name="synthetic",
        environment=Environment(gravity=GRAVITY),
        rigid_body=RigidBody(mass=MASS, center_of_gravity=WEIGHT_ARM, inertia=INERTIA),
        buoyancy=Buoyancy(force=BUOYANCY, center=BUOYANCY_ARM),
        hull=Hull(length=1.4, width=0.7, height=0.5),
        thruster=tuple(
            Thruster(
                name=f"T{i + 1}",
                position=position,
                direction=direction,
                max_thrust=MAX_THRUST,
                max_reverse_thrust=MAX_THRUST,
                time_constant=LAG,
            )
            for i, (position, direction) in enumerate(PLACES)
        ),
        effect=({"name": "added_mass", "diagonal": list(ADDED)},),
    )


def cross(a: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def inertia() -> np.ndarray:
    """M = M_RB + M_A about CO, (6, 6)."""
    lever = cross(np.array(WEIGHT_ARM))
    body = np.block(
        [
            [MASS * np.eye(3), -MASS * lever],
            [MASS * lever, np.array(INERTIA) - MASS * lever @ lever],
        ]
    )
    return body + np.diag(ADDED)


def coriolis_and_damping(nu: np.ndarray) -> np.ndarray:
    """C(nu) nu + D(nu) nu, (6,): what the labels of this vehicle must be."""
    M = inertia()
    linear, angular = M[:3] @ nu, M[3:] @ nu
    C = np.block([[np.zeros((3, 3)), -cross(linear)], [-cross(linear), -cross(angular)]])
    return C @ nu + (LINEAR + QUADRATIC * np.abs(nu)) * nu


def weight_and_buoyancy(phi: float, theta: float) -> np.ndarray:
    """Wrench on the vehicle, -g(eta)."""
    down = np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    weight, lift = MASS * GRAVITY * down, -BUOYANCY * down
    return np.concatenate([weight + lift, np.cross(WEIGHT_ARM, weight) + np.cross(BUOYANCY_ARM, lift)])


def rates(eta: np.ndarray, nu: np.ndarray) -> np.ndarray:
    (phi, theta, psi), (v, omega) = eta[3:], (nu[:3], nu[3:])
    Rx = np.array([[1, 0, 0], [0, np.cos(phi), -np.sin(phi)], [0, np.sin(phi), np.cos(phi)]])
    Ry = np.array([[np.cos(theta), 0, np.sin(theta)], [0, 1, 0], [-np.sin(theta), 0, np.cos(theta)]])
    Rz = np.array([[np.cos(psi), -np.sin(psi), 0], [np.sin(psi), np.cos(psi), 0], [0, 0, 1]])
    T = np.array(
        [
            [1, np.sin(phi) * np.tan(theta), np.cos(phi) * np.tan(theta)],
            [0, np.cos(phi), -np.sin(phi)],
            [0, np.sin(phi) / np.cos(theta), np.cos(phi) / np.cos(theta)],
        ]
    )
    return np.concatenate([Rz @ Ry @ Rx @ v, T @ omega])


@cache
def recording(seconds: float = 10.0, seed: int = 0, dt: float = 0.02) -> pl.DataFrame:
    """A raw table (float64) of one session `synthetic-SEED`: smooth commands, each held for one row."""
    rng = np.random.default_rng(seed)
    rows = round(seconds / dt)
    t = np.arange(rows) * dt
    frequency, phase = rng.uniform(0.1, 0.4, (8, 1)), rng.uniform(0, 2 * np.pi, (8, 1))
    commands = 0.35 * np.sin(2 * np.pi * frequency * t + phase) * (1 - np.exp(-t))
    wrench = np.array([[*direction, *np.cross(position, direction)] for position, direction in PLACES]).T
    solver = np.linalg.inv(inertia())

    def motion(_: float, state: np.ndarray, target: np.ndarray) -> np.ndarray:
        eta, nu, thrust = state[:6], state[6:12], state[12:]
        force = wrench @ thrust + weight_and_buoyancy(eta[3], eta[4]) - coriolis_and_damping(nu)
        return np.concatenate([rates(eta, nu), solver @ force, (target - thrust) / LAG])

    state = np.zeros(20)
    state[2] = 10.0
    states = np.empty((rows, 20))
    for k in range(rows):
        states[k] = state
        target = (MAX_THRUST * commands[:, k],)
        state = solve_ivp(motion, (0, dt), state, "RK45", args=target, rtol=1e-8, atol=1e-9, first_step=dt).y[
            :, -1
        ]
    names = ("x", "y", "z", "phi", "theta", "psi", "u", "v", "w", "p", "q", "r")
    return pl.DataFrame(
        {"session": [f"synthetic-{seed}"] * rows, "t": t}
        | {name: states[:, i] for i, name in enumerate(names)}
        | {f"cmd_{i + 1}": commands[i] for i in range(8)}
    )
