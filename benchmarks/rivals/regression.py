"""Equation error: the residual wrench regressed on the catalogue's columns, effects chosen by BIC.

The residual wrench of the file comes from the smoothed and differentiated motion (`labels`).  The column of a
parameter comes from a small change of it.  Effects join as groups while the Bayesian information criterion
falls (Schwarz 1978); the first one is named.  Sensor errors do not appear in forces, and cannot be named.  A
regression may diverge.  Among the files with one more group each, the model is therefore the one that
predicts the log best 5 s ahead.

    python -m benchmarks.rivals.regression --studies 30 -o rivals.parquet
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import polars as pl

from benchmarks.hidden_effects import vehicles
from benchmarks.hidden_effects.build import PAIRS
from benchmarks.hidden_effects.plant import Array
from benchmarks.rivals.contest import Answer, by_vehicle, main
from hydro.core.distillation.labels import labels
from hydro.core.errors import DataError
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.vehicle.description import Vehicle

WRENCH = tuple(f"{axis}_res" for axis in "XYZKMN")
EVERY = 10  # step between used rows: neighbours are correlated
EDGE = 25  # rows at each end of a session, where the smoother is one-sided
MOST = 6  # maximum number of groups
LITTLE = 1e-2
HELD = ("rates",)  # parameters that are not amounts


def groups(vehicle: Vehicle) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield effects, each as tables with a small amount of one parameter."""
    mass, moment = vehicle.rigid_body.mass, float(np.trace(np.array(vehicle.rigid_body.inertia)) / 3)
    sizes = LITTLE * np.repeat([mass, moment], 3)
    cross, n = LITTLE * float(np.sqrt(mass * moment)), len(vehicle.thruster)
    for name in ("added_mass", "linear_damping", "quadratic_damping"):
        yield (
            name,
            [{"diagonal": (size * unit).tolist()} for size, unit in zip(sizes, np.eye(6), strict=True)],
        )
    yield "added_mass_coupling", [{key: cross} for key in PAIRS["added_mass_coupling"]]
    yield "added_mass_coriolis", [{"kappa": LITTLE}]
    yield "coupled_damping", [{key: cross} for key in PAIRS["coupled_damping"]]
    yield "crossflow_drag", [{"Cd_y": LITTLE}, {"Cd_z": LITTLE}]
    yield "body_lift", [{key: cross} for key in ("L11", "L15", "L51", "L55", "L22", "L24", "L42", "L44")]
    yield "net_buoyancy", [{"dB": LITTLE * mass}]
    yield "buoyancy_offset", [{axis: 1e-3} for axis in ("dx", "dy", "dz")]
    yield "ocean_current", [{axis: LITTLE} for axis in ("v_N", "v_E", "v_D")]
    yield (
        "fluid_memory",
        [
            {"K": [(size * unit).tolist()], "rates": [1.0]}
            for size, unit in zip(sizes, np.eye(6), strict=True)
        ],
    )
    yield "thruster_gain", [{"g": (LITTLE * unit).tolist()} for unit in np.eye(n)]
    yield "thruster_asymmetry", [{"a": LITTLE}]
    yield "thruster_lag", [{"dT": LITTLE}]
    yield "command_delay", [{"d": 0.02}]
    yield "thruster_deadband", [{"d": LITTLE}]
    yield "thruster_inflow", [{"c": LITTLE}]


def left(vehicle: Vehicle, raw: pl.DataFrame) -> Array:
    """Return the residual wrench of a vehicle in K evenly chosen rows, (K, 6) [N, N m]."""
    found = labels(vehicle, raw, subtract="effects").select("session", *WRENCH)
    parts = found.partition_by("session", maintain_order=True)
    return np.vstack([part.select(WRENCH).to_numpy()[EDGE:-EDGE:EVERY] for part in parts]).astype(float)


def answer(given: Vehicle, measured: pl.DataFrame) -> Answer:
    """Regress the residual wrench of the file on the catalogue."""
    here = left(given, measured)
    scale = here.std(axis=0) + 1e-9
    columns: dict[str, Array] = {}
    tables: dict[str, list[dict[str, Any]]] = {}
    for name, little in groups(given):
        try:
            moved = [left(vehicles.joined(given, [{"name": name, **table}]), measured) for table in little]
        except DataError:
            continue  # invalid on this vehicle
        columns[name] = np.stack([((here - one) / scale).ravel() for one in moved], axis=1)
        tables[name] = little
    target, chosen = (here / scale).ravel(), list[str]()

    def bic(names: list[str]) -> float:
        X = np.hstack([columns[name] for name in names]) if names else np.zeros((target.size, 0))
        rest = target - X @ np.linalg.lstsq(X, target, rcond=None)[0] if names else target
        return target.size * np.log(np.mean(rest**2)) + X.shape[1] * np.log(target.size)

    best = bic([])
    while len(chosen) < MOST:
        tried = {name: bic([*chosen, name]) for name in columns if name not in chosen}
        name = min(tried, key=lambda one: tried[one])
        if tried[name] >= best:
            break
        best = tried[name]
        chosen.append(name)
    flown = Ahead(measured, given)
    model = min(_models(given, chosen, columns, tables, target), key=lambda one: _error(flown, one))
    return Answer(
        chosen[0] if chosen else "",
        lambda errors, _: _error(errors, model),
        lambda held: by_vehicle(model, held),
    )


def _models(
    given: Vehicle,
    chosen: list[str],
    columns: dict[str, Array],
    tables: dict[str, list[dict[str, Any]]],
    target: Array,
) -> Iterator[Vehicle]:
    """Yield the vehicle file, then the file with the first one, two, three and more selected groups added."""
    yield given
    for count in range(1, len(chosen) + 1):
        names = chosen[:count]
        amounts = iter(np.linalg.lstsq(np.hstack([columns[n] for n in names]), target, rcond=None)[0])
        little = [(name, table) for name in names for table in tables[name]]
        added = [
            {"name": name}
            | {k: v if k in HELD else (amount * np.asarray(v)).tolist() for k, v in table.items()}
            for (name, table), amount in zip(little, amounts, strict=True)
        ]
        yield vehicles.joined(given, _merged(added))


def _error(errors: Ahead, model: Vehicle) -> float:
    """Return the velocity error 5 s ahead [m/s]; infinite if the regressed model is physically invalid."""
    try:
        return errors.of(model)
    except DataError:
        return np.inf


def _merged(added: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Merge the tables of one effect."""
    out: dict[str, dict[str, Any]] = {}
    for table in added:
        one = out.setdefault(table["name"], {"name": table["name"]})
        for key, value in table.items():
            if key in HELD:
                one[key] = value
            elif key != "name":
                one[key] = (np.asarray(one.get(key, 0.0)) + np.asarray(value)).tolist()
    return list(out.values())


if __name__ == "__main__":
    main("regression with BIC", answer, __doc__ or "")
