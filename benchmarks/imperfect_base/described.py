"""Part of the force on a hull of panels that drag laws of the catalogue leave.

    python -m benchmarks.imperfect_base.described --keep COMMIT

The four vehicles fly four sessions each.  Least squares fits the laws to the force of the panels in three
sessions; the fourth shows the part that they leave.  Each axis counts in units of its root mean square force.
The centre of the ellipsoid is searched for, because its force is not linear in it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
import polars as pl
from scipy.optimize import minimize

from benchmarks.hidden_effects import flights, vehicles
from benchmarks.hidden_effects.plant import Array
from benchmarks.imperfect_base.base import DEPTH, SESSIONS, TAPER, hull
from benchmarks.kept_tables import Row, keep, markdown, origin
from hydro.core.columns import VELOCITY
from hydro.core.effects import CATALOGUE
from hydro.core.effects.layout import DENSITY, HULL, MOTION, RELATIVE_VELOCITY
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.panels import loaded_facets, panel_wrench_kernel, panels

SECONDS = 40.0
"""Length of a session [s]."""
EVERY = 10
"""Step between the rows that are used: velocities hardly change in 0.2 s."""
SEED = 190_000
STEPS = 60
"""Maximum number of steps of the search for a centre: the remaining part then changes by less than 0.5 %."""
Laws = Callable[[Array], Array]
"""Function from velocities (N, 6) to the force of each law at a coefficient of 1, (N, 6, laws)."""


def per_axis(nu: Array) -> Array:
    """Return linear and quadratic damping of each axis, (N, 6, 12)."""
    return np.concatenate([nu[:, :, None] * np.eye(6), (np.abs(nu) * nu)[:, :, None] * np.eye(6)], axis=2)


def cross_axis(nu: Array) -> Array:
    """Return drag of each axis in proportion to the speeds along the other axes, (N, 6, 15)."""
    pairs = [(i, j) for i in range(6) for j in range(3) if i != j]
    found = np.zeros((len(nu), 6, len(pairs)))
    for column, (i, j) in enumerate(pairs):
        found[:, i, column] = np.abs(nu[:, j]) * nu[:, i]
    return found


def ellipsoid(vehicle: Vehicle, center: Array) -> Laws:
    """Return the three drags of `ellipsoid_drag` about a point [m]."""
    kernel, constants = CATALOGUE["ellipsoid_drag"].kernel, np.zeros(HULL + 3)
    constants[DENSITY] = vehicle.environment.water_density
    constants[HULL:] = vehicle.hull.length, vehicle.hull.width, vehicle.hull.height
    assert kernel is not None

    def laws(nu: Array) -> Array:
        found, motion = np.zeros((3, len(nu), 6)), np.zeros(MOTION)
        for column, packed in enumerate(np.hstack([np.eye(3), np.tile(center, (3, 1))])):
            for row, velocity in enumerate(nu):
                motion[RELATIVE_VELOCITY : RELATIVE_VELOCITY + 6] = velocity
                kernel(packed, constants, motion, np.zeros(0), np.zeros(0), found[column, row])
        return found.transpose(1, 2, 0)

    return laws


def flown(preset: str) -> tuple[Vehicle, list[Array], list[Array]]:
    """Fly a vehicle, and return it with the velocities and the panel forces of each session, (N, 6)."""
    vehicle = vehicles.preset(preset)
    shape = hull(vehicle, float(np.mean(TAPER)))
    rows = [round(SECONDS / flights.DT)] * SESSIONS
    tables = flights.by_teacher(vehicle, (), rows=rows, depth=DEPTH, noise=0.0, seed=SEED, mesh=shape)
    facets = loaded_facets(panels(*shape), vehicle.environment.water_density)
    motions = [table.select(VELOCITY).to_numpy().astype(float)[::EVERY] for table in tables]
    forces = [np.zeros_like(nu) for nu in motions]
    for nu, force in zip(motions, forces, strict=True):
        for row, velocity in enumerate(nu):
            panel_wrench_kernel(velocity, facets, force[row])
    return vehicle, motions, forces


def left(laws: Laws, motions: list[Array], forces: list[Array]) -> float:
    """Return the part of the last session's force that laws leave which are fitted to the others."""
    size = np.sqrt((np.concatenate(forces) ** 2).mean(axis=0))
    columns = [(laws(nu) / size[:, None]).reshape(6 * len(nu), -1) for nu in motions]
    wanted = [(force / size).ravel() for force in forces]
    amounts = np.linalg.lstsq(np.concatenate(columns[:-1]), np.concatenate(wanted[:-1]), rcond=None)[0]
    return float(np.sqrt(((wanted[-1] - columns[-1] @ amounts) ** 2).mean() / (wanted[-1] ** 2).mean()))


def together(*parts: Laws) -> Laws:
    """Return several laws as one."""
    return lambda nu: np.concatenate([part(nu) for part in parts], axis=2)


def row(preset: str) -> Row:
    """Return the row of a vehicle: the part that each set of laws leaves."""
    vehicle, motions, forces = flown(preset)
    begun = np.array(vehicle.hull.center, float)
    known = motions[:-1], forces[:-1]
    found = minimize(
        lambda center: left(together(per_axis, ellipsoid(vehicle, center)), *known),
        begun,
        method="Nelder-Mead",
        options={"maxfev": STEPS},
    ).x
    best = ellipsoid(vehicle, found)
    sets = {
        "linear and quadratic damping": per_axis,
        "the same with `cross_axis_drag`": together(per_axis, cross_axis),
        "`ellipsoid_drag` alone": best,
        "linear and quadratic damping with `ellipsoid_drag`": together(per_axis, best),
    }
    return {"hull of panels": preset} | {
        name: f"{left(laws, motions, forces):.0%}".replace("%", " %") for name, laws in sets.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--keep", metavar="COMMIT", help="keep the table as that of this commit")
    chosen = parser.parse_args()
    rows = [row(preset) for preset in vehicles.PRESETS]
    print(markdown(rows))
    if chosen.keep:
        command = f"python -m benchmarks.imperfect_base.described --keep {chosen.keep}"
        whence = origin(pl.DataFrame({"seed": [SEED]}), command, chosen.keep)
        keep("panel_force", [one | whence for one in rows])


if __name__ == "__main__":
    main()
