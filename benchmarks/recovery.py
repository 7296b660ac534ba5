"""Test of `hydro fit`: seeded trials for every effect of the catalogue, in every form.

Each trial simulates a vehicle of `datasets/vehicles` with one effect of random size that its file lacks, and
adds ordinary sensor noise.  The file's damping has an error of up to 25 %.  The effect is fitted together
with the damping.  A trial succeeds if every number of the effect lies within three standard errors of the
truth.

    python -m benchmarks.recovery --trials 20 --out recovery.parquet

The file grows by one row per trial; the same command continues an earlier run.  Seeds alternate between
vehicles.
"""

from __future__ import annotations

import argparse
import time
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks import shares
from benchmarks.hidden_effects.vehicles import PRESETS, damping_of, joined, misjudged, preset
from benchmarks.work import add_workers, done
from hydro.core.columns import POSE, VELOCITY, Array
from hydro.core.diagnosis.baseline import allowing_for_waves, refit, stable_start
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.effects import CATALOGUE, damping, validate
from hydro.core.errors import DataError
from hydro.core.identification.fit import fit
from hydro.core.prediction.parameters import Free
from hydro.core.simulation.excitation import Session, demands
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import configuration_matrix

DT = 0.02
SESSIONS = ("walk", "coupled", "walk")
ATTEMPTS = 200
DEPTH, SHALLOW = 5.0, {"surface_suction": 1.5, "ocean_waves": 3.0}
"""Initial depth of sessions, and that for some effects [m]."""
MIDDLE = 20.0
Draw = Callable[[np.random.Generator, Vehicle], dict[str, Any]]


def within(low: float, high: float, *, signs: bool = True) -> Callable[[np.random.Generator], float]:
    """Return a function that draws a size between two bounds, of either sign if `signs` is true."""
    return lambda rng: float(rng.uniform(low, high) * (rng.choice([-1.0, 1.0]) if signs else 1.0))


def mass(vehicle: Vehicle) -> float:
    """Return the mass of a vehicle [kg]."""
    return vehicle.rigid_body.mass


def moment(vehicle: Vehicle) -> float:
    """Return the mean moment of inertia of a vehicle [kg m^2]."""
    return float(np.trace(np.array(vehicle.rigid_body.inertia)) / 3)


def axes(vehicle: Vehicle, share: float, rng: np.random.Generator) -> list[float]:
    """Draw six positive numbers, about `share` times the mass and the moment of inertia."""
    sizes = np.repeat([mass(vehicle), moment(vehicle)], 3) * share
    return [float(x) for x in sizes * rng.uniform(0.3, 1.0, 6)]


def several(names: tuple[str, ...], sizes: list[float], rng: np.random.Generator) -> dict[str, Any]:
    return {name: float(size * rng.uniform(-1.0, 1.0)) for name, size in zip(names, sizes, strict=True)}


def vector(rng: np.random.Generator, size: float, count: int = 3) -> list[float]:
    return [float(x) for x in rng.uniform(-size, size, count)]


def odd_power(rng: np.random.Generator) -> float:
    """Return an exponent of the speed away from 1 and 2, which belong to the fitted damping."""
    return float(rng.uniform(1.3, 1.7) if rng.random() < 0.5 else rng.uniform(2.4, 3.2))


def aside(rng: np.random.Generator, vehicle: Vehicle, shares: tuple[float, float, float]) -> list[float]:
    """Draw a point of the body away from CO on all axes [m], up to shares of the hull's lengths."""
    reach = np.multiply(shares, [vehicle.hull.length, vehicle.hull.width, vehicle.hull.height])
    return [float(x) for x in reach * rng.uniform(0.4, 1.0, 3) * rng.choice([-1.0, 1.0], 3)]


def cross(vehicle: Vehicle) -> float:
    return float(np.sqrt(mass(vehicle) * moment(vehicle)))


def semidefinite(vehicle: Vehicle, share: float, rng: np.random.Generator) -> Array:
    """Draw a symmetric matrix (6, 6) with `axes` on its diagonal and correlations of about 0.3."""
    rows = rng.normal(size=(6, 12))
    rows *= np.sqrt(axes(vehicle, share, rng))[:, None] / np.linalg.norm(rows, axis=1, keepdims=True)
    return rows @ rows.T


def lopsided(vehicle: Vehicle, share: float, rng: np.random.Generator) -> Array:
    """Draw such a symmetric matrix and add an antisymmetric part, which does no work."""
    matrix = semidefinite(vehicle, share, rng)
    sizes = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    turned = np.triu(0.3 * sizes * rng.uniform(-1.0, 1.0, (6, 6)), 1)
    return matrix + turned - turned.T


def _sides(vehicle: Vehicle) -> Array:
    """Return length, width and height of the hull [m]."""
    return np.array([vehicle.hull.length, vehicle.hull.width, vehicle.hull.height])


TRUTHS: dict[str, Draw] = {
    "added_mass": lambda rng, v: {"diagonal": axes(v, 0.3, rng)},
    "added_mass_coupling": lambda rng, v: several(
        ("M15", "M24", "M04", "M13", "M02"),
        [0.1 * cross(v)] * 2 + [0.05 * cross(v)] * 2 + [0.1 * mass(v)],
        rng,
    ),
    "added_mass_coriolis": lambda rng, v: {"kappa": within(0.1, 0.5)(rng)},
    "linear_damping": lambda rng, v: {"diagonal": axes(v, 0.3, rng)},
    "quadratic_damping": lambda rng, v: {"diagonal": axes(v, 0.5, rng)},
    "coupled_damping": lambda rng, v: several(
        ("D15", "D51", "D24", "D42", "D13", "D31"), [0.1 * cross(v)] * 6, rng
    ),
    "crossflow_drag": lambda rng, v: {"Cd_y": within(0.3, 1.0, signs=False)(rng), "Cd_z": 0.5},
    "cross_axis_drag": lambda rng, v: {
        f"D{i}{j}": float((mass(v) if i < 3 else moment(v)) * rng.uniform(0.3, 1.5))
        for i, j in damping.ACROSS
    },
    "power_drag": lambda rng, v: {"diagonal": axes(v, 0.5, rng), "n": odd_power(rng)},
    "offset_drag": lambda rng, v: {
        "drag": [float(x) for x in 0.5 * mass(v) * rng.uniform(0.3, 1.0, 3)],
        "position": aside(rng, v, (0.4, 0.6, 0.6)),
    },
    "ellipsoid_drag": lambda rng, v: {
        "C": [float(x) for x in rng.uniform(0.2, 0.8, 3)],
        "position": [float(0.1 * x) for x in rng.uniform(-1.0, 1.0, 3) * _sides(v)],
    },
    "control_surface": lambda rng, v: {
        "area": 2e-4 * mass(v) * within(0.5, 1.5, signs=False)(rng),
        "position": [-0.4 * v.hull.length, *aside(rng, v, (0.0, 0.5, 0.5))[1:]],
        "roll": float(rng.choice([0.0, 0.5 * np.pi]) + rng.uniform(-0.1, 0.1)),
        "deflection": within(0.05, 0.2)(rng),
        "stall": within(0.25, 0.5, signs=False)(rng),
    },
    "body_lift": lambda rng, v: several(
        ("L11", "L15", "L51", "L55", "L22", "L24", "L42", "L44"),
        [0.3 * mass(v), 0.1 * cross(v), 0.1 * cross(v), 0.1 * moment(v)] * 2,
        rng,
    ),
    "net_buoyancy": lambda rng, v: {"dB": 0.004 * 9.81 * mass(v) * within(0.3, 1.0)(rng)},
    "buoyancy_offset": lambda rng, v: several(("dx", "dy", "dz"), [0.01] * 3, rng),
    "payload": lambda rng, v: {
        "w": 0.006 * 9.81 * mass(v) * within(0.5, 1.0)(rng),
        "mass": 0.05 * mass(v),
        **several(("x", "y", "z"), [0.3 * v.hull.length, 0.3 * v.hull.width, 0.3 * v.hull.height], rng),
    },
    "ocean_current": lambda rng, v: several(("v_N", "v_E", "v_D"), [0.4, 0.4, 0.05], rng),
    "tether": lambda rng, v: {
        "k": 0.01 * mass(v) * within(0.5, 1.5, signs=False)(rng),
        "slack": within(1.0, 3.0, signs=False)(rng),
        "attachment": vector(rng, 0.2),
        "anchor": [float(x) for x in rng.uniform(-3, 3, 2)] + [4.0],
    },
    "surface_suction": lambda rng, v: {
        "A": 0.01 * 9.81 * mass(v) * within(0.5, 1.5)(rng),
        "decay": within(0.7, 2.0, signs=False)(rng),
    },
    "fluid_memory": lambda rng, v: {"K": [axes(v, 0.3, rng)], "rates": [float(rng.uniform(0.5, 3.0))]},
    "current_shear": lambda rng, v: several(("g_N", "g_E"), [0.08, 0.08], rng) | {"z_0": DEPTH},
    "current_trend": lambda rng, v: several(("a_N", "a_E"), [4e-3, 4e-3], rng) | {"t_0": MIDDLE},
    "ocean_waves": lambda rng, v: {
        "height": within(0.3, 1.2, signs=False)(rng),
        "period": within(5.0, 9.0, signs=False)(rng),
        "direction": float(rng.uniform(0.0, 2.0 * np.pi)),
        "peak": within(0.0, 5.0, signs=False)(rng),
    },
    "drifting_ballast": lambda rng, v: {
        "S": [float(0.01 * mass(v) * rng.uniform(0.5, 1.5)) for _ in range(2)],
        "tilt": within(0.1, 0.4, signs=False)(rng),
        "T": within(0.5, 5.0, signs=False)(rng),
    },
    "thruster_gain": lambda rng, v: {"g": vector(rng, 0.3, len(v.thruster))},
    "thruster_asymmetry": lambda rng, v: {"a": within(0.05, 0.3)(rng)},
    "thruster_lag": lambda rng, v: {"dT": within(0.03, 0.15, signs=False)(rng)},
    "command_delay": lambda rng, v: {"d": within(0.03, 0.2, signs=False)(rng)},
    "thruster_deadband": lambda rng, v: {"d": within(0.02, 0.08, signs=False)(rng)},
    "thruster_inflow": lambda rng, v: {"c": within(0.03, 0.15, signs=False)(rng)},
    "propeller_torque": lambda rng, v: {"k": vector(rng, 0.04, len(v.thruster))},
    "thruster_curve": lambda rng, v: {"da": within(0.2, 0.9, signs=False)(rng)},
    "sensor_scale": lambda rng, v: {"axes": vector(rng, 0.05)},
    "sensor_misalignment": lambda rng, v: {"alpha": vector(rng, 0.05)},
    "sensor_delay": lambda rng, v: {"d": within(0.05, 0.3, signs=False)(rng)},
    "sensor_lever_arm": lambda rng, v: {"r": vector(rng, 0.3)},
    "reference_point": lambda rng, v: {"r": vector(rng, 0.3)},
    "sensor_bias": lambda rng, v: {"b": vector(rng, 0.05)},
}
FORMS: dict[str, Draw] = {
    "added_mass.matrix": lambda rng, v: {"matrix": semidefinite(v, 0.3, rng).tolist()},
    "linear_damping.matrix": lambda rng, v: {"matrix": lopsided(v, 0.3, rng).tolist()},
    "sensor_scale.s": lambda rng, v: {"s": within(0.01, 0.05)(rng)},
}
"""Effects with forms that TRUTHS does not contain."""
WRITTEN: dict[str, Draw] = {
    "formula": lambda rng, v: {
        "forces": ["Z |u|^n", "X v r", "Y c1"],
        "force": [size * mass(v) * within(0.5, 1.5)(rng) for size in (0.3, 0.4, 0.3)],
        "moments": ["N |v|^n sgn(v)"],
        "moment": [-cross(v) * within(0.3, 1.0, signs=False)(rng)],
        "exponents": [odd_power(rng), odd_power(rng)],
    },
}
"""Effects that the file must already have to be fitted: their terms are written in it."""
BESIDE = {"current_shear": ("ocean_current",), "current_trend": ("ocean_current",)}
"""Effects fitted in addition: a fit uses another reference depth or time than the truth."""


def commands(vehicle: Vehicle, seconds: float, seed: int, depth: float) -> pl.DataFrame:
    """Return three sessions of random walks and coupled manoeuvres without feedback.

    Args:
        vehicle: The vehicle.
        seconds: Length of each session [s].
        seed: Seed of the commands.
        depth: Depth of the start [m].
    """
    rng = np.random.default_rng([seed, 7])
    share = np.linalg.pinv(configuration_matrix(vehicle))
    limits = np.array([thruster.max_thrust for thruster in vehicle.thruster])
    authority = np.abs(configuration_matrix(vehicle)) @ limits
    quadratic = np.array([thruster.curve == "quadratic" for thruster in vehicle.thruster])
    sessions = []
    for number, kind in enumerate(SESSIONS):
        rows = round(seconds / DT / len(SESSIONS))
        demand = 0.5 * demands(Session(str(number), kind, rows, number), seed, DT) * authority
        level = np.clip(demand @ share.T / limits, -1.0, 1.0)
        level = np.where(quadratic, np.sign(level) * np.sqrt(np.abs(level)), level)
        columns: dict[str, Any] = {"session": [f"s{number}"] * rows, "t": np.arange(rows) * DT}
        columns |= {name: np.zeros(rows) for name in (*POSE, *VELOCITY)}
        columns |= {"z": np.full(rows, depth), "psi": np.full(rows, rng.uniform(-np.pi, np.pi))}
        sessions.append(pl.DataFrame(columns | {f"cmd_{i + 1}": c for i, c in enumerate(level.T)}))
    return pl.concat(sessions)


def hide(name: str, vehicle: Vehicle, rng: np.random.Generator) -> tuple[Vehicle, Vehicle]:
    """Return the vehicle file and the true vehicle, with the effect in a size that the vehicle can have.

    Raises:
        DataError: The vehicle can have no such effect.
    """
    effect, _, _ = name.partition(".")
    if effect == "coupled_damping":  # no coupling with an axis of zero damping is passive
        vehicle = joined(vehicle, [{"name": "linear_damping"} | TRUTHS["linear_damping"](rng, vehicle)])
    for attempt in range(ATTEMPTS):
        truth = joined(vehicle, [{"name": effect} | (TRUTHS | FORMS | WRITTEN)[name](rng, vehicle)])
        try:
            validate(truth)
        except DataError:
            if attempt == ATTEMPTS - 1:
                raise
        else:
            break
    if effect in WRITTEN:
        vehicle = joined(vehicle, [guessed(next(iter(truth.effects(effect))))])
    return vehicle, truth


def guessed(formula: Mapping[str, Any]) -> dict[str, Any]:
    """Return a formula as a user might write it: coefficients half as large, squares as powers."""
    halves = {key: [0.5 * value for value in formula[key]] for key in ("force", "moment")}
    return {**formula, **halves, "exponents": [2.0] * len(formula["exponents"])}


def trial(name: str, seed: int, vehicle_name: str, seconds: float) -> dict[str, Any]:
    """Return the row of one trial: simulate, disturb, fit and compare."""
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    row = {"effect": name, "vehicle": vehicle_name, "seed": seed}
    clock = time.perf_counter()
    try:
        found = recovered(name, seed, preset(vehicle_name), seconds, rng)
    except DataError as error:
        found = {"entries": 1, "within": 0, "determined": 0, "worst": np.inf, "z": [], "chi2": np.inf}
        found["failure"] = str(error)
    return row | found | {"seconds": time.perf_counter() - clock}


def recovered(
    name: str, seed: int, vehicle: Vehicle, seconds: float, rng: np.random.Generator
) -> dict[str, Any]:
    """Return the estimates of an effect, as differences from the truth in standard errors."""
    known, truth = hide(name, vehicle, rng)
    effect, _, _ = name.partition(".")
    hidden = next(iter(truth.effects(effect)))
    form = next((f".{key}" for key in CATALOGUE[effect].one_of if key in hidden), "")
    depth = SHALLOW.get(name, DEPTH)
    motion = simulate(truth, commands(vehicle, seconds, seed, depth), sea=seed)
    logged = disturb(motion.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    raw = motion.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))
    if CATALOGUE[effect].is_random:
        return recovered_sea(misjudged(known, rng), hidden, raw)
    others = [other for other in damping_of(known) if other != effect]
    found = fit(misjudged(known, rng), raw, [effect + form, *BESIDE.get(effect, ()), *others])
    mine = np.array([entry.effect == effect for entry in found.free.entries])
    z = ((found.values - true_values(truth, found.free)) / found.standard_errors)[mine]
    return {
        "entries": len(z),
        "within": int((np.abs(z) <= 3.0).sum()),
        "determined": int(found.determined[mine].sum()),
        "worst": float(np.abs(z).max()),
        "z": z.tolist(),
        "chi2": found.chi2,
        "failure": "",
    }


def recovered_sea(file: Vehicle, hidden: Mapping[str, Any], raw: pl.DataFrame) -> dict[str, Any]:
    """Return the estimates of waves from a diagnosis, with damping fitted too; no fit estimates waves."""
    log = preprocess(file, raw)
    start, problem = stable_start(file, log)
    baseline = allowing_for_waves(refit(file, log, problem, start))
    sea = baseline.sea
    if sea is None:
        raise DataError("no waves are seen")
    off = sea.values - [hidden[parameter.name] for parameter in CATALOGUE[hidden["name"]].parameters]
    off[2] = (off[2] + np.pi) % (2.0 * np.pi) - np.pi  # the direction
    z = off / np.sqrt(np.diag(sea.spread))
    return {
        "entries": len(z),
        "within": int((np.abs(z) <= 3.0).sum()),
        "determined": len(z),
        "worst": float(np.abs(z).max()),
        "z": z.tolist(),
        "chi2": baseline.refitted.normal.chi2,
        "failure": "",
    }


def true_values(truth: Vehicle, free: Free) -> Array:
    """Return the true values of the free entries (P,); missing ones are 0."""
    tables: dict[str, Mapping[str, Any]] = {table["name"]: table for table in truth.effect}
    found = [np.asarray(tables.get(e.effect, {}).get(e.parameter, 0.0), float) for e in free.entries]
    return np.array([v[e.index] if v.ndim else v for v, e in zip(found, free.entries, strict=True)], float)


def interval(hits: int, count: int) -> str:
    """Return a share with its 95 % interval as text of fixed width."""
    low, high = shares.interval(hits, count)
    return f"{100 * hits / count:5.1f} % [{100 * low:5.1f}, {100 * high:5.1f}]"


def summary(rows: pl.DataFrame) -> None:
    """Print the table: trials with all numbers, and numbers of all trials, within three standard errors."""
    print(f"{'effect':22} trials  all within 3 s.e.          numbers within 3 s.e.      determined  s/trial")
    for (name,), group in rows.sort("effect").group_by("effect", maintain_order=True):
        count, hits = group.height, int((group["within"] == group["entries"]).sum())
        numbers, inside = int(group["entries"].sum()), int(group["within"].sum())
        print(
            f"{name:22} {count:6d}  {interval(hits, count)}  {interval(inside, max(numbers, 1))}  "
            f"{100 * group['determined'].sum() / max(numbers, 1):8.1f} %  {group['seconds'].mean():6.1f}"
        )
    hits = int((rows["within"] == rows["entries"]).sum())
    print(f"{'all':22} {rows.height:6d}  {interval(hits, rows.height)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=20, help="trials per effect")
    parser.add_argument("--first-seed", type=int, default=0, help="seeds from here on; hold some back")
    parser.add_argument("--seconds", type=float, default=180.0, help="length of a recording")
    parser.add_argument("--vehicle", action="append", help="preset; repeat for several")
    parser.add_argument("--effect", action="append", help="only these effects, or forms of one")
    add_workers(parser)
    parser.add_argument("--out", type=Path, default=Path("recovery.parquet"))
    chosen = parser.parse_args()
    presets = chosen.vehicle or PRESETS
    rows = pl.read_parquet(chosen.out).to_dicts() if chosen.out.exists() else []
    finished = {(row["effect"], row["seed"]) for row in rows}
    jobs = [
        (name, seed, presets[seed % len(presets)], chosen.seconds)
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.trials)
        for name in chosen.effect or (*TRUTHS, *FORMS, *WRITTEN)
        if (name, seed) not in finished
    ]
    for row in done(trial, jobs, chosen):
        rows.append(row)
        pl.DataFrame(rows, infer_schema_length=None).write_parquet(chosen.out)
    summary(pl.DataFrame(rows, infer_schema_length=None))


if __name__ == "__main__":
    main()
