"""Accuracy of `hydro vehicle new` for vehicles with known values.

Each vehicle of `datasets/vehicles` is estimated from its mass, box and thrusters alone.  Added mass, and drag
at 0.5 m/s and 0.5 rad/s, are compared with those of its file.  Linear, quadratic and cross-flow drag are
added, since files divide it differently.

    python -m benchmarks.new_vehicle            prints the table
    python -m benchmarks.new_vehicle --page     and writes it into docs/new-vehicle.md
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.catalogue import added_mass_matrix
from hydro.core.geometry.estimate import Estimate, Known, estimate
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle
from hydro.io.files import bundled

PRESETS = ("bluerov2_heavy", "remus100", "auv151", "stonefish")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "new-vehicle.md"
START, END = "<!-- table -->", "<!-- end -->"
SPEED = 0.5
"""Speed at which drag is compared [m/s, rad/s]."""
FACTOR, ERRORS = 2.0, 2.0
"""Limits of an accurate estimate: a factor, and standard errors."""


@dataclass(frozen=True)
class Comparison:
    """Comparison of an estimate with the vehicle file, for one quantity of one vehicle.

    Attributes:
        vehicle: Name of the vehicle.
        shape: Shape of the hull.
        quantity: Name of the quantity.
        values: Estimate of each axis (6,).
        errors: Standard errors of the estimate (6,).
        file: Values of the file (6,).
    """

    vehicle: str
    shape: str
    quantity: str
    values: Array
    errors: Array
    file: Array

    @property
    def near(self) -> Array:
        return (self.values <= FACTOR * self.file) & (self.file <= FACTOR * self.values)

    @property
    def covered(self) -> Array:
        return np.abs(self.values - self.file) <= ERRORS * self.errors


def comparisons() -> Iterator[Comparison]:
    """Yield added mass of all presets, and drag of the presets whose file has damping."""
    for name in PRESETS:
        file, _ = vehicle.read(bundled(f"vehicles/{name}.toml"))
        found = estimated(file)
        table = found.vehicle.effects("added_mass")[0]
        values, errors = (np.array(each["diagonal"]) for each in (table, table["standard_error"]))
        own = np.diag(added_mass_matrix(file))
        yield Comparison(name, found.form.shape, "added mass [kg, kg m²]", values, errors, own)
        values, errors = drag(found.vehicle)
        own, _ = drag(file)
        if own.any():
            yield Comparison(name, found.form.shape, "drag at 0.5 [N, N m]", values, errors, own)


def estimated(file: Vehicle) -> Estimate:
    """Return the estimate of `hydro vehicle new` for a vehicle's mass, box, thrusters and water."""
    sides = (file.hull.length, file.hull.width, file.hull.height)
    density = file.environment.water_density
    return estimate(Known(file.name, file.rigid_body.mass, sides, file.thruster, density=density))


def drag(file: Vehicle) -> tuple[Array, Array]:
    """Return the drag against motion along or about each axis alone (6,) [N, N m], and its standard error."""
    total, variance = np.zeros(6), np.zeros(6)
    for name, power in (("linear_damping", 1), ("quadratic_damping", 2)):
        for table in file.effects(name):
            total += SPEED**power * np.array(table["diagonal"])
            error = np.array(table.get("standard_error", {}).get("diagonal", np.zeros(6)))
            variance += (SPEED**power * error) ** 2
    hull, pressure = file.hull, 0.5 * file.environment.water_density * SPEED**2
    for table in file.effects("crossflow_drag"):
        side, bottom = (
            pressure * table[key] * width for key, width in (("Cd_y", hull.height), ("Cd_z", hull.width))
        )
        arm3 = hull.length**4 / 32.0
        across = [side * hull.length, bottom * hull.length]
        total += np.array([0.0, *across, 0.0, bottom * arm3, side * arm3])
    return total, np.sqrt(variance)


def markdown() -> str:
    """Return the table, with inaccurate values marked and counted."""
    rows = list(comparisons())
    lines = ["| vehicle | quantity | X | Y | Z | K | M | N |", "|---|---|---|---|---|---|---|---|"]
    lines += [f"| {row.vehicle} ({row.shape}) | {row.quantity} | {' | '.join(_cells(row))} |" for row in rows]
    count = sum(row.near.size for row in rows)
    near, covered = (sum(int(getattr(row, name).sum()) for row in rows) for name in ("near", "covered"))
    said = f"{near} of {count} numbers lie within a factor of two, {covered} within two standard errors."
    return "\n".join([*lines, "", said])


def _cells(row: Comparison) -> Iterator[str]:
    for value, error, file, near, covered in zip(
        row.values, row.errors, row.file, row.near, row.covered, strict=True
    ):
        mark = ("" if near else " ×") + ("" if covered else " †")
        shown = (f"{float(f'{number:.2g}'):g}" for number in (value, error, file))
        yield "{} ± {}; {}".format(*shown) + mark


def write_page() -> None:
    """Write the table between the marks of its documentation page."""
    head, _, rest = PAGE.read_text().partition(START)
    PAGE.write_text(f"{head}{START}\n\n{markdown()}\n\n{END}{rest.partition(END)[2]}")


if __name__ == "__main__":
    print(markdown())
    if "--page" in sys.argv:
        write_page()
