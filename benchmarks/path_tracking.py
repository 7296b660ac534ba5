"""Model predictive control on exported equations compared with a hand-tuned pilot, on a 3-D path.

A vehicle follows a figure of eight that rises and falls, with a target point of constant speed.  The plant is
the reference simulator, whose hull consists of panels.  A controller knows only a vehicle file, without its
dead bands, through the CasADi functions of `hydro export --to casadi`.

    pilot               The proportional law of `rl.environment.helmsman`, to a point ahead on the path.  The
                        best of several look-ahead times counts.
    MPC, file as given  The vehicle file with its plausible numbers.
    MPC, fitted         The file after a fit of drag and added mass to five minutes of that simulator.

All controllers know the true state and give a command every 0.1 s.  The cross-track error is the distance to
the nearest point of the path.  The first ten seconds do not count.

    python -m benchmarks.path_tracking --keep COMMIT
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import msgspec
import numpy as np
import polars as pl
from numpy.typing import ArrayLike

import hydro
from benchmarks.kept_tables import Row, keep, markdown, origin
from hydro.core.columns import Array
from hydro.core.effects import inertia_matrix
from hydro.core.vehicle.control_allocation import mixing, mixing_kernel
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.frames import rotation_from_quaternion
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.export.casadi_function import BODY_STATES, Functions, functions
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.rl.environment.helmsman import helmsman
from hydro.rl.environment.observation import GRAVITY, OBSERVATIONS, RATE, TARGET, VELOCITY
from hydro.sim import teacher as sim
from hydro.sim.teacher_plant import TeacherPlant

PERIOD = 0.1
"""Control period [s]."""
SECONDS, SETTLING = 90.0, 10.0
SPEED = 0.6
"""Speed of the target point [m/s]."""
SIZE, DEPTH, DIVE = 8.0, 10.0, 2.0
"""Half the length of the figure of eight, its mean depth, and its depth amplitude [m]."""
INTERVAL, AHEAD, SUBSTEPS = 0.25, 10, 2
"""Length of a prediction step of the controller [s], number of steps, Runge-Kutta substeps of each."""
LITTLE = 0.05
"""Initial commands of the first solution: at zero thrust, derivatives vanish."""
WEIGHTS = {"place": 20.0, "heading": 4.0, "level": 4.0, "effort": 0.05, "change": 0.2}
LOOK_AHEADS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Look-ahead times of the pilot's target point [s]."""
FITTED = ("linear_damping", "quadratic_damping", "added_mass")
DATA_ROWS, DATA_SEED = 15_000, 7
Controller = Callable[[float, Array, Array, Array], Array]
"""Function from time [s], pose (7,), velocity (6,) and thrusts (n,) to commands (n,)."""


def eight() -> tuple[Array, Array]:
    """Return the points of the path (N, 3), NED, and their distances along it (N,) [m]."""
    turn = np.linspace(0.0, 2.0 * np.pi, 20_001)
    points = np.column_stack(
        [SIZE * np.sin(turn), 0.5 * SIZE * np.sin(2.0 * turn), DEPTH - DIVE * np.sin(turn + 0.5)]
    )
    return points, np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]


PATH, ALONG = eight()


def place(t: ArrayLike) -> Array:
    """Return the target position (..., 3), NED [m], at the times t [s]."""
    way = np.mod(SPEED * np.asarray(t, float), ALONG[-1])
    return np.stack([np.interp(way, ALONG, PATH[:, i]) for i in range(3)], axis=-1)


def heading(t: ArrayLike) -> Array:
    """Return the horizontal direction of the path (..., 2), a unit vector, at the times t [s]."""
    ahead = (place(np.asarray(t, float) + 0.05) - place(t))[..., :2]
    return np.asarray(ahead / np.linalg.norm(ahead, axis=-1, keepdims=True))


def pilot(vehicle: Vehicle, look_ahead: float) -> Controller:
    """Return the hand-tuned pilot, which steers to the point `look_ahead` [s] ahead on the path."""
    mixed = mixing(vehicle, mass_matrix(vehicle) + inertia_matrix(vehicle))

    def steer(t: float, pose: Array, nu: Array, thrust: Array) -> Array:
        turned = rotation_from_quaternion(pose[3:])
        seen = np.zeros((1, OBSERVATIONS), np.float32)
        seen[0, TARGET : TARGET + 3] = turned.T @ (place(t + look_ahead) - pose[:3])
        seen[0, VELOCITY : VELOCITY + 3], seen[0, RATE : RATE + 3] = nu[:3], nu[3:]
        seen[0, GRAVITY : GRAVITY + 3] = turned[2]
        demand = np.clip(helmsman(seen)[0].astype(float), -1.0, 1.0)
        commands = np.zeros(len(vehicle.thruster))
        mixing_kernel(mixed.allocation, mixed.table, demand * mixed.authority, commands)
        return commands

    return steer


@dataclass
class Predictive:
    """Model predictive control by multiple shooting, warm-started with its last plan that converged.

    If the solver does not converge in time, the last plan is continued, since the unconverged one is not
    usable.

    Attributes:
        made: CasADi functions of the vehicle.
        solver: Solver of the optimisation.
        plan: States and commands of the last plan that converged.
        commands: Last commands given.
        bounds: Least and greatest values of the variables of the optimisation.
        seconds: Processor time of each solution [s].
        planned: Time at which the last plan begins [s].
        unsolved: Number of solutions that did not converge.
    """

    made: Functions
    solver: object
    plan: Array
    commands: Array
    bounds: tuple[Array, Array]
    seconds: list[float]
    planned: float = 0.0
    unsolved: int = 0

    @classmethod
    def of(cls, vehicle: Vehicle) -> Predictive:
        """Return the controller for a vehicle file."""
        made = functions(without_dead_bands(vehicle), INTERVAL, SUBSTEPS)
        n, m = len(made.states), len(made.commands)
        x, u = ca.MX.sym("x", n, AHEAD + 1), ca.MX.sym("u", m, AHEAD)
        first, before, goal = ca.MX.sym("first", n), ca.MX.sym("before", m), ca.MX.sym("goal", 5, AHEAD + 1)
        w, q = WEIGHTS, x[3:7, :]
        bow = 1.0 - 2.0 * (q[2, :] ** 2 + q[3, :] ** 2), 2.0 * (q[1, :] * q[2, :] + q[0, :] * q[3, :])
        across = bow[0] * goal[4, :] - bow[1] * goal[3, :]
        tilts = 2.0 * (q[1, :] * q[3, :] - q[0, :] * q[2, :]), 2.0 * (q[2, :] * q[3, :] + q[0, :] * q[1, :])
        cost = (
            w["place"] * ca.sumsqr(x[:3, :] - goal[:3, :])
            + w["heading"] * ca.sumsqr(across)
            + w["level"] * (ca.sumsqr(tilts[0]) + ca.sumsqr(tilts[1]))
            + w["effort"] * ca.sumsqr(u)
            + w["change"] * ca.sumsqr(u - ca.horzcat(before, u[:, :-1]))
        )
        moved = made.step.expand().map(AHEAD)(x[:, :-1], u)
        problem = {
            "x": ca.veccat(x, u),
            "p": ca.veccat(first, before, goal),
            "f": cost,
            "g": ca.veccat(x[:, 0] - first, x[:, 1:] - moved),
        }
        quiet = {
            "print_level": 0,
            "max_iter": 30,
            "tol": 1e-4,
            "mu_init": 1e-3,
            "warm_start_init_point": "yes",
        }
        solver = ca.nlpsol("control", "ipopt", problem, {"print_time": False, "ipopt": quiet | {"sb": "yes"}})
        free = np.full(n * (AHEAD + 1), np.inf)
        bounds = np.r_[-free, np.full(m * AHEAD, -1.0)], np.r_[free, np.full(m * AHEAD, 1.0)]
        return cls(made, solver, np.zeros(0), np.zeros(m), bounds, [])

    def __call__(self, t: float, pose: Array, nu: Array, thrust: Array) -> Array:
        """Solve for the next commands."""
        n, m = len(self.made.states), len(self.made.commands)
        times = t + INTERVAL * np.arange(AHEAD + 1)
        first = np.concatenate([pose, nu, thrust])
        if self.plan.size and self.plan[3:7] @ pose[3:] < 0.0:
            first[3:7] *= -1.0  # the same attitude: a plan with the opposite sign is not a warm start
        if not self.plan.size:
            self.plan = np.r_[np.tile(first, AHEAD + 1), np.full(m * AHEAD, LITTLE)]
        goal = np.hstack([place(times), heading(times)])
        begun = time.process_time()
        found = self.solver(  # type: ignore[operator]
            x0=self.plan,
            p=np.concatenate([first, self.commands, goal.ravel()]),
            lbx=self.bounds[0],
            ubx=self.bounds[1],
            lbg=0.0,
            ubg=0.0,
        )
        self.seconds.append(time.process_time() - begun)
        if self.solver.stats()["success"]:  # type: ignore[attr-defined]
            self.plan, self.planned = np.array(found["x"]).ravel(), t
        else:
            self.unsolved += 1
        past = min(int((t - self.planned) / INTERVAL + 1e-9), AHEAD - 1)
        told = self.plan[n * (AHEAD + 1) :].reshape(AHEAD, m)
        self.commands = told[past].clip(-1.0, 1.0)
        return self.commands


def without_dead_bands(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle as known by a controller: without dead bands, in which derivatives vanish."""
    return msgspec.structs.replace(
        vehicle, thruster=tuple(msgspec.structs.replace(one, deadband=0.0) for one in vehicle.thruster)
    )


def track(vehicle: Vehicle, steer: Controller, seconds: float = SECONDS) -> tuple[Array, Array]:
    """Fly in the reference simulator; return positions (N, 3) and distances to the path (N,)."""
    plant = TeacherPlant(vehicle, period=PERIOD)
    toward = heading(0.0)
    yaw = float(np.arctan2(toward[1], toward[0]))
    pose = np.r_[place(0.0), np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
    plant.reset(np.ones(1, bool), pose[None], np.zeros((1, 6)))
    flown = []
    for k in range(round(seconds / PERIOD)):
        commands = steer(k * PERIOD, plant.pose[0].copy(), plant.velocity[0].copy(), plant.thrust[0].copy())
        plant.step(np.asarray(commands)[None])
        flown.append(plant.pose[0, :3].copy())
    positions = np.array(flown)
    return positions, np.array([np.linalg.norm(PATH - one, axis=1).min() for one in positions])


def fitted(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle file after a fit to the reference simulator."""
    raw = sim.collect(sim.teacher(vehicle), DATA_ROWS, DATA_SEED)
    return hydro.add(vehicle, hydro.fit(vehicle, raw, FITTED))


def measured(name: str, positions: Array, errors: Array, control: Predictive | None = None) -> Row:
    """Return the row of a controller.

    Args:
        name: Name of the controller.
        positions: Flown positions (N, 3), NED [m].
        errors: Distances to the path (N,) [m].
        control: The controller, for its processor times; None for the pilot.
    """
    after = slice(round(SETTLING / PERIOD), None)
    behind = np.linalg.norm(positions - place((np.arange(len(positions)) + 1) * PERIOD), axis=1)[after]
    cross = errors[after]
    seconds = np.array([np.nan] if control is None else control.seconds)
    solved = f"{1e3 * np.median(seconds):.0f} ({1e3 * np.quantile(seconds, 0.95):.0f})"
    return {
        "controller": name,
        "cross-track error, r.m.s. [m]": f"{np.sqrt((cross**2).mean()):.3f}",
        "greatest [m]": f"{cross.max():.3f}",
        "behind the moving point, r.m.s. [m]": f"{np.sqrt((behind**2).mean()):.2f}",
        "processor time of a command, median (95 %) [ms]": "-" if control is None else solved,
        "not solved": "-" if control is None else f"{control.unsolved} of {len(seconds)}",
    }


def study(seconds: float = SECONDS) -> list[Row]:
    """Fly all controllers on the same path; return the rows of the table."""
    vehicle = files.read(bundled("vehicles") / "auv151.toml")[0]
    flights = {ahead: track(vehicle, pilot(vehicle, ahead), seconds) for ahead in LOOK_AHEADS}
    after = slice(round(SETTLING / PERIOD), None)
    best = min(flights, key=lambda ahead: float((flights[ahead][1][after] ** 2).mean()))
    rows = [measured(f"pilot by hand, {best:g} s ahead", *flights[best])]
    for name, known in (("MPC, file as given", vehicle), ("MPC, fitted file", fitted(vehicle))):
        control = Predictive.of(known)
        rows.append(measured(name, *track(vehicle, control, seconds), control))
    return rows


def main() -> None:
    """Fly all controllers, print the table, and write it with --keep."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=SECONDS, help="length of each flight [s]")
    parser.add_argument(
        "--keep", metavar="COMMIT", help="write benchmarks/results for this commit of the code"
    )
    given = parser.parse_args()
    assert BODY_STATES[:3] == ("x", "y", "z")
    rows = study(given.seconds)
    print(markdown(rows))
    if given.keep:
        source = origin(pl.DataFrame({"seed": [DATA_SEED]}), "python -m benchmarks.path_tracking", given.keep)
        keep("path_tracking", [row | source for row in rows])


if __name__ == "__main__":
    main()
