"""Vehicles and exact solutions shared by the tests of MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from hydro.core.effects import assemble
from hydro.core.vehicle.description import Buoyancy, Environment, Hull, RigidBody, Thruster, Vehicle
from hydro.core.vehicle.frames import quaternion_from_euler, rotation_from_quaternion
from hydro.core.vehicle.rigid_body import coriolis_matrix, mass_matrix
from hydro.sim.bridge import mjcf, native
from hydro.sim.bridge.water import Water

MASS = 40.0
GRAVITY = 9.81


def vehicle(
    *,
    center_of_gravity=(0.0, 0.0, 0.0),
    buoyancy=MASS * GRAVITY,
    center_of_buoyancy=(0.0, 0.0, 0.0),
    thrusters=(),
    **more,
) -> Vehicle:
    return Vehicle(
        name="probe",
        environment=Environment(gravity=GRAVITY),
        rigid_body=RigidBody(
            mass=MASS,
            center_of_gravity=center_of_gravity,
            inertia=((2.0, 0.1, -0.2), (0.1, 3.5, 0.3), (-0.2, 0.3, 4.0)),
        ),
        buoyancy=Buoyancy(force=buoyancy, center=center_of_buoyancy),
        hull=Hull(length=1.0, width=0.5, height=0.4),
        thruster=thrusters,
        **more,
    )


def thruster(name="T", position=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0)) -> Thruster:
    return Thruster(
        name=name, position=position, direction=direction, max_thrust=100.0, max_reverse_thrust=80.0
    )


def model(
    craft: Vehicle, *, inertia=None, coriolis=None, cancelled=None, held=False, **options
) -> mujoco.MjModel:
    """Return the vehicle with its thrusters and the given matrices."""
    water = Water(assemble(craft), inertia=inertia, coriolis=coriolis, cancelled=cancelled, held=held)
    return native.prepare(mjcf.scene(craft, water, **options).compile())


def exact(craft: Vehicle, eta, nu, seconds, *, inertia=None, coriolis=None, wrench=None):
    """Return position (NED), quaternion (FRD to NED) and nu after `seconds`, integrated by scipy.

    (M_RB + M_A) nu_dot + C_RB nu + C(coriolis) nu = restoring + wrench, written here independently.
    """
    rigid = mass_matrix(craft)
    total = np.linalg.inv(rigid + (0 if inertia is None else inertia))
    weight = craft.rigid_body.mass * craft.environment.gravity
    levers = np.array(craft.rigid_body.center_of_gravity), np.array(craft.buoyancy.center)

    def motion(_t, state):
        quaternion, nu = state[3:7] / np.linalg.norm(state[3:7]), state[7:]
        R = rotation_from_quaternion(quaternion)
        down = R.T @ [0.0, 0.0, 1.0]
        tau = np.zeros(6)
        for force, lever in ((weight, levers[0]), (-craft.buoyancy.force, levers[1])):
            tau += np.concatenate([force * down, np.cross(lever, force * down)])
        tau -= coriolis_matrix(rigid, nu) @ nu
        if coriolis is not None:
            tau -= coriolis_matrix(coriolis, nu) @ nu
        if wrench is not None:
            tau += wrench
        w, x, y, z = quaternion
        p, q, r = nu[3:]
        turn = 0.5 * np.array(
            [-x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p]
        )
        return np.concatenate([R @ nu[:3], turn, total @ tau])

    start = np.concatenate([eta[:3], quaternion_from_euler(*eta[3:]), nu])
    return solve_ivp(motion, (0, seconds), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
