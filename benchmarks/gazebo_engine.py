"""Difference between `hydro simulate` and DART, the physics engine of Gazebo, on exported worlds.

Gazebo's Physics system gives DART the link's inertia with `<fluid_added_mass>` in its spatial tensor.  It
turns gravity off and adds it as a force.  The systems Hydrodynamics, Thruster and Buoyancy add forces at the
link's origin, computed from its pose and velocity before every step.  In a current, Hydrodynamics of gz-sim
since April 2026 (after 8.11, 9.5, 10.1) also adds the difference that the current makes to the Coriolis force
of added mass.  Here the same is given to DART itself, read from the file as the tests read it
(`tests/export/gazebo_world.py`); propellers are welded to the hull.  Four vehicles get 60 s of commands, as
thrusts in newtons.  Their motion is compared with `simulate` without effects that the target does not
support.

    pip install dartpy
    PYTHONPATH=tests python -m benchmarks.gazebo_engine --keep COMMIT
"""

from __future__ import annotations

import argparse
from importlib.metadata import version
from typing import Any

import dartpy
import msgspec
import numpy as np
import polars as pl
from export.flown import DT, GENTLE, VEHICLES, apart, commanded, given, vehicle
from export.gazebo_world import World, coriolis, in_ned
from export.test_gazebo import newtons

from benchmarks.kept_tables import Row, keep, markdown, origin
from hydro.core.columns import MOTION, Array
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.export.gazebo import lacks, to_sdf
from hydro.export.targets import all_left_out
from hydro.io.files import bundled

CURRENT = {"name": "ocean_current", "v_N": 0.3, "v_E": -0.2}
STEPS = {"1 ms, Gazebo's own": 1e-3, "0.25 ms": 2.5e-4}


def body_of(world: World) -> tuple[Any, Any]:
    """Return DART's world and the vehicle's body in it, built as gz-physics builds them."""
    simulation = dartpy.simulation.World()
    simulation.setGravity([0.0, 0.0, 0.0])
    skeleton = dartpy.dynamics.Skeleton("vehicle")
    _, body = skeleton.createFreeJointAndBodyNodePair()
    center = world.moment / world.mass
    S = np.array([[0, -center[2], center[1]], [center[2], 0, -center[0]], [-center[1], center[0], 0]])
    inertia = dartpy.dynamics.Inertia(world.mass, center, world.body[3:, 3:] + world.mass * S @ S)
    order = [3, 4, 5, 0, 1, 2]
    inertia.setSpatialTensor(inertia.getSpatialTensor() + world.added[np.ix_(order, order)])
    body.setInertia(inertia)
    simulation.addSkeleton(skeleton)
    return simulation, body


def fly(world: World, thrusts: Array, step: float, *, corrected: bool = True) -> Array:
    """Return the motion (N, 12), NED and FRD, from rest under thrusts that are held for a row each.

    Args:
        world: The exported world.
        thrusts: Thrust of each thruster (N, n) [N].
        step: Time step [s].
        corrected: Compute the Coriolis force in a current as gz-sim does since April 2026.
    """
    simulation, body = body_of(world)
    simulation.setTimeStep(step)
    rows, center = [in_ned(state_of(body))], world.moment / world.mass
    for row in thrusts[:-1]:
        thrust = world.wrench(row)
        for _ in range(round(DT / step)):
            R = body.getWorldTransform().rotation()
            nu = np.r_[R.T @ body.getLinearVelocity(), R.T @ body.getAngularVelocity()]
            through = nu - np.r_[R.T @ world.current, np.zeros(3)]
            D = world.linear + world.sized @ np.abs(through) + world.plain @ through
            tau = thrust + D @ through
            if corrected:
                tau = tau + coriolis(world.added, nu) - coriolis(world.added, through)
            up = R.T @ np.array([0.0, 0.0, world.lift])
            tau = tau + np.r_[up, np.cross(world.center, up)]
            body.addExtForce(tau[:3], np.zeros(3), True, True)
            body.addExtTorque(tau[3:], True)
            body.addExtForce(world.mass * world.gravity, center, False, True)
            simulation.step()
        rows.append(in_ned(state_of(body)))
    return np.array(rows)


def state_of(body: Any) -> Array:
    """Return position, quaternion (w, x, y, z) and body velocity (13,) of the link's origin."""
    pose = body.getWorldTransform()
    R = pose.rotation()
    q = pose.quaternion()
    return np.r_[
        pose.translation(),
        q.w(),
        q.x(),
        q.y(),
        q.z(),
        R.T @ body.getLinearVelocity(),
        R.T @ body.getAngularVelocity(),
    ]


def row(what: str, craft: Vehicle, name: str, step: str, seconds: float, **options: bool) -> Row:
    """Return a row of the table: the difference of one vehicle's motion from `simulate`."""
    table = commanded(len(craft.thruster), GENTLE.get(name, 1.0), seconds)
    moved = simulate(all_left_out(craft, lacks(craft)), table).select(MOTION).to_numpy()
    flown = fly(World(to_sdf(craft)), newtons(craft, given(table)), STEPS[step], **options)
    way = np.linalg.norm(np.diff(moved[:, :3], axis=0), axis=1).sum()
    place = np.linalg.norm(flown[:, :3] - moved[:, :3], axis=1).max()
    return {
        "vehicle": what,
        "DART's step": step,
        "way [m]": f"{way:.0f}",
        "place differs by at most [m]": f"{place:.2g}",
        "angles [rad]": f"{_angles(flown, moved):.2g}",
        "u, v, w [m/s]": f"{np.abs(flown[:, 6:9] - moved[:, 6:9]).max():.2g}",
        "p, q, r [rad/s]": f"{np.abs(flown[:, 9:] - moved[:, 9:]).max():.2g}",
    }


def study(seconds: float) -> list[Row]:
    """Return the rows of four vehicles in still water, and of one in a current."""
    found = {name: vehicle(bundled("vehicles").parent, name) for name in VEHICLES}
    rows = [row(name, craft, name, step, seconds) for name, craft in found.items() for step in STEPS]
    adrift = msgspec.structs.replace(found["auv151"], effect=(*found["auv151"].effect, CURRENT))
    finest = list(STEPS)[-1]
    for since, corrected in (("since April 2026", True), ("before", False)):
        what = f"auv151 in a current of 0.36 m/s, gz-sim {since}"
        rows.append(row(what, adrift, "auv151", finest, seconds, corrected=corrected))
    return rows


def _angles(flown: Array, moved: Array) -> float:
    return apart(*(np.hstack([0.0 * one[:, :3], one[:, 3:6], 0.0 * one[:, 6:]]) for one in (flown, moved)))


def main() -> None:
    """Fly all vehicles, print the table, and write it with --keep."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="length of each flight [s]")
    parser.add_argument("--keep", metavar="COMMIT", help="keep the table, of the code of a commit")
    asked = parser.parse_args()
    rows = study(asked.seconds)
    print(f"dartpy {version('dartpy')}\n{markdown(rows)}")
    if asked.keep:
        command = "PYTHONPATH=tests python -m benchmarks.gazebo_engine"
        source = origin(pl.DataFrame({"seed": [1]}), command, asked.keep)
        keep("gazebo_engine", [one | {"dartpy": version("dartpy")} | source for one in rows])


if __name__ == "__main__":
    main()
