"""Share of the force on a hull of panels that drag laws of the catalogue do not describe.

    python -m benchmarks.imperfect_base.described

The four vehicles fly four sessions each.  Least squares fits the laws to the force of the panels, in units of
the acceleration that the force gives the dry vehicle.  A rotation counts by the acceleration at a quarter of
the hull's length.  The centre of the ellipsoid is searched for, because its force is not linear in it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from benchmarks.hidden_effects import flights, vehicles
from benchmarks.hidden_effects.plant import Array
from benchmarks.imperfect_base.base import DEPTH, SESSIONS, TAPER, hull
from benchmarks.kept_tables import markdown
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
"""Maximum number of evaluations in the search for a centre."""
Laws = Callable[[Array], Array]
"""Function from velocities (N, 6) to the force of each law at a coefficient of 1, (N, 6, laws)."""


def per_axis(nu: Array) -> Array:
    """Return the columns of linear and quadratic damping of each axis at velocities nu (N, 6), (N, 6, 12)."""
    return np.concatenate([nu[:, :, None] * np.eye(6), (np.abs(nu) * nu)[:, :, None] * np.eye(6)], axis=2)


def cross_axis(nu: Array) -> Array:
    """Return the columns of drag of each axis by the speeds along other axes, (N, 6, 15)."""
    pairs = [(i, j) for i in range(6) for j in range(3) if i != j]
    found = np.zeros((len(nu), 6, len(pairs)))
    for column, (i, j) in enumerate(pairs):
        found[:, i, column] = np.abs(nu[:, j]) * nu[:, i]
    return found


def ellipsoid(vehicle: Vehicle, center: Array) -> Laws:
    """Return the columns of the three drags of `ellipsoid_drag` about a point (3,) [m]."""
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


def flown(vehicle: Vehicle) -> tuple[Array, Array]:
    """Fly a vehicle, and return its velocities and the forces on its panels, (N, 6)."""
    shape = hull(vehicle, float(np.mean(TAPER)))
    rows = [round(SECONDS / flights.DT)] * SESSIONS
    tables = flights.by_teacher(vehicle, (), rows=rows, depth=DEPTH, noise=0.0, seed=SEED, mesh=shape)
    facets = loaded_facets(panels(*shape), vehicle.environment.water_density)
    motion = np.concatenate([table.select(VELOCITY).to_numpy().astype(float)[::EVERY] for table in tables])
    force = np.zeros_like(motion)
    for nu, wrench in zip(motion, force, strict=True):
        panel_wrench_kernel(nu, facets, wrench)
    return motion, force


def accelerations(vehicle: Vehicle) -> Array:
    """Return the acceleration by a unit force or moment on each axis, (6,) [m/s^2]."""
    body, lever = vehicle.rigid_body, 0.25 * vehicle.hull.length
    turning = lever / np.diag(np.array(body.inertia, float))
    return np.concatenate([np.full(3, 1.0 / body.mass), turning])


def together(*parts: Laws) -> Laws:
    """Return a function with the columns of several laws."""
    return lambda nu: np.concatenate([part(nu) for part in parts], axis=2)


def left(preset: str) -> dict[str, float]:
    """Return the share of the force on a hull that each set of laws leaves, as root mean squares by name."""
    vehicle = vehicles.preset(preset)
    motion, force = flown(vehicle)
    unit = accelerations(vehicle)
    wanted = (force * unit).ravel()

    def part(laws: Laws) -> float:
        columns = (laws(motion) * unit[:, None]).reshape(len(wanted), -1)
        amounts = np.linalg.lstsq(columns, wanted, rcond=None)[0]
        return float(np.linalg.norm(wanted - columns @ amounts) / np.linalg.norm(wanted))

    def centred(*others: Laws) -> Laws:
        """Return laws with the ellipsoid about the centre with which they leave least."""
        found = minimize(
            lambda center: part(together(*others, ellipsoid(vehicle, center))),
            np.array(vehicle.hull.center, float),
            method="Nelder-Mead",
            options={"maxfev": STEPS},
        )
        return together(*others, ellipsoid(vehicle, found.x))

    return {
        "linear and quadratic damping": part(per_axis),
        "the same with `cross_axis_drag`": part(together(per_axis, cross_axis)),
        "`ellipsoid_drag` alone": part(centred()),
        "linear and quadratic damping with `ellipsoid_drag`": part(centred(per_axis)),
        "all of these": part(centred(per_axis, cross_axis)),
    }


def main() -> None:
    parts = [(preset, left(preset)) for preset in vehicles.PRESETS]
    rows = [
        {"hull": preset} | {name: f"{100.0 * part:.0f} %" for name, part in one.items()}
        for preset, one in parts
    ]
    print(markdown(rows))


if __name__ == "__main__":
    main()
