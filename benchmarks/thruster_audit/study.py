"""Study of a planted thruster fault: the audit of the thrusters, compared with the truth."""

from __future__ import annotations

import time
from typing import Any

import msgspec
import numpy as np
import polars as pl

from benchmarks.hidden_effects import flights, vehicles
from benchmarks.imperfect_base.base import hull
from benchmarks.imperfect_logs import closed_loop
from hydro.core.audit.thrusters import ThrusterAudit, audit
from hydro.core.audit.wiring import Wiring
from hydro.core.geometry.estimate import Known, estimate
from hydro.core.geometry.layouts import laid_out
from hydro.core.recording.arrays import recording
from hydro.core.vehicle.description import Thruster, Vehicle
from hydro.sim import teacher

SECONDS, SESSIONS = 120.0, 2
"""Total length of the flights of a study [s], and number of sessions."""
VEHICLES = ("bluerov2", "bluerov2_heavy", "panels, six", "panels, eight")
FAULTS = ("reversed", "swapped", "scale")
DISTURBANCES = ("current", "ballast", "delay", "damping", "controller")
DAMPING = 0.3
"""Largest relative error of each number of the file's damping."""
SCALE = (0.6, 1.4)
"""Range of a common scale."""
DELAY = (0.05, 0.3)
"""Range of a delay of the commands [s]."""
BALLAST = 0.03
"""Largest error of the buoyancy, as a share of the weight, and of the centre of gravity, of the length."""
DEPTH = 10.0
LAG = 0.1
"""Estimated thruster time constant of `hydro vehicle new` [s]."""
SCHEMA: dict[str, Any] = {
    "kind": pl.String,
    "seed": pl.Int64,
    "vehicle": pl.String,
    "fault": pl.String,
    "disturbance": pl.String,
    "truth": pl.String,
    "said": pl.List(pl.String),
    "right": pl.Boolean,
    "probability": pl.Float64,
    "scale": pl.Float64,
    "seconds": pl.Float64,
    "failure": pl.String,
}


def six() -> Vehicle:
    """Return the BlueROV2 with six thrusters in the maker's order, with plain thrust curves."""
    eight = vehicles.preset("bluerov2_heavy")
    sides = (eight.hull.length, eight.hull.width, eight.hull.height)
    placed = laid_out("bluerov2", 30.4, sides)
    lagged = tuple(msgspec.structs.replace(one, time_constant=0.029) for one in placed)
    return msgspec.structs.replace(eight, name="bluerov2", thruster=lagged)


def first_day(actual: Vehicle) -> Vehicle:
    """Return the file that `hydro vehicle new` estimates from mass, box and thrusters."""
    sides = (actual.hull.length, actual.hull.width, actual.hull.height)
    guessed = tuple(
        Thruster(
            name=one.name,
            position=one.position,
            direction=one.direction,
            max_thrust=one.max_thrust,
            max_reverse_thrust=one.max_reverse_thrust,
            curve=one.curve,
            time_constant=LAG,
        )
        for one in actual.thruster
    )
    water = actual.environment
    known = Known(
        actual.name,
        actual.rigid_body.mass,
        sides,
        guessed,
        density=water.water_density,
        gravity=water.gravity,
    )
    return estimate(known).vehicle


def disturbed(name: str, actual: Vehicle, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Return the effects of one disturbance, which act but are not in the file."""
    match name:
        case "current":
            speed, way = rng.uniform(0.1, 0.4), rng.uniform(-np.pi, np.pi)
            return [{"name": "ocean_current", "v_N": speed * np.cos(way), "v_E": speed * np.sin(way)}]
        case "ballast":
            weight = actual.rigid_body.mass * actual.environment.gravity
            force, arm = rng.uniform(-1.0, 1.0, 2) * BALLAST
            return [
                {"name": "net_buoyancy", "dB": force * weight},
                {"name": "buoyancy_offset", "dx": arm * actual.hull.length, "dy": 0.0, "dz": 0.0},
            ]
        case "delay":
            return [{"name": "command_delay", "d": rng.uniform(*DELAY)}]
    return []


def by_panels(actual: Vehicle, hidden: list[dict[str, Any]], held: bool, seed: int) -> pl.DataFrame:
    """Fly a tapered hull of panels in the embedded simulator.

    With `held`, demands are small and the heading is held, so that the controller makes most of the commands.
    """
    rng = np.random.default_rng([seed, 31])
    shape = hull(actual, float(rng.uniform(0.3, 0.7)))
    rows = [round(SECONDS / SESSIONS / flights.DT)] * SESSIONS
    if not held:
        flown = flights.by_teacher(actual, hidden, rows=rows, depth=DEPTH, noise=0.5, seed=seed, mesh=shape)
        return pl.concat(flown)
    subject, tables = teacher.teacher(actual, mesh=shape, hidden=hidden), []
    for number, count in enumerate(rows):
        demand = 0.4 * flights.excited("steps", count, rng)
        motion, commands = teacher.fly(
            subject, demand, depth=DEPTH, heading=float(rng.uniform(-np.pi, np.pi)), hold_heading=True
        )
        tables.append(flights.table(f"s{number}", motion, commands, 0.5, rng))
    return pl.concat(tables)


def in_plant(
    given: Vehicle, actual: Vehicle, hidden: list[dict[str, Any]], held: bool, seed: int
) -> pl.DataFrame:
    """Fly a vehicle in the benchmark's own simulator."""
    rows = [round(SECONDS / SESSIONS / flights.DT)] * SESSIONS
    if held:
        task = (closed_loop.STATION, closed_loop.WAY_POINTS)[seed % 2]
        every = closed_loop.sessions(
            given, actual, hidden, task, rows=rows, depth=DEPTH, noise=1.0, seed=seed
        )
        return pl.concat(every)
    flown = flights.independent(given, actual, hidden, {}, rows=rows, depth=DEPTH, noise=1.0, seed=seed)
    return pl.concat(flown)


def flown(name: str, disturbance: str, seed: int) -> tuple[Vehicle, pl.DataFrame]:
    """Return a vehicle file without a fault of its thrusters, and a recording."""
    rng = np.random.default_rng([seed, 37])
    held = disturbance == "controller"
    actual = six() if "six" in name or name == "bluerov2" else vehicles.preset("bluerov2_heavy")
    if name == "panels, eight":
        actual = vehicles.preset("stonefish")
    hidden = disturbed(disturbance, actual, rng)
    if name.startswith("panels"):
        return first_day(actual), by_panels(actual, hidden, held, seed)
    given = vehicles.misjudged(actual, rng, DAMPING)
    return given, in_plant(given, actual, hidden, held, seed)


def planted(
    fault: str, given: Vehicle, raw: pl.DataFrame, rng: np.random.Generator
) -> tuple[Vehicle, pl.DataFrame, Wiring, float]:
    """Plant a fault in the vehicle file or in the log.

    Returns:
        The file, the log, the true wiring of the thrusters, and the true scale of their thrust.
    """
    count = len(given.thruster)
    plain = Wiring.plain(count)
    match fault:
        case "reversed":
            chosen = rng.permutation(count)[: rng.integers(1, count + 1)]
            truth = Wiring(plain.column, tuple(-1 if i in chosen else 1 for i in range(count)))
            if rng.random() < 0.5:
                names = [f"cmd_{i + 1}" for i in chosen]
                return given, raw.with_columns(-pl.col(names)), truth, 1.0
            turned = tuple(
                msgspec.structs.replace(one, direction=tuple(-x for x in one.direction or ()))
                if i in chosen
                else one
                for i, one in enumerate(given.thruster)
            )
            return msgspec.structs.replace(given, thruster=turned), raw, truth, 1.0
        case "swapped":
            i, k = (int(x) for x in rng.choice(count, 2, replace=False))
            columns = list(range(count))
            columns[i], columns[k] = k, i
            one, other = f"cmd_{i + 1}", f"cmd_{k + 1}"
            swapped = raw.with_columns(pl.col(one).alias(other), pl.col(other).alias(one))
            return given, swapped, Wiring(tuple(columns), plain.sign), 1.0
        case "scale":
            scale = float(rng.uniform(*SCALE))
            weaker = tuple(
                msgspec.structs.replace(
                    one,
                    max_thrust=(one.max_thrust or 0.0) / scale,
                    max_reverse_thrust=(one.max_reverse_thrust or 0.0) / scale,
                )
                for one in given.thruster
            )
            return msgspec.structs.replace(given, thruster=weaker), raw, plain, scale
    return given, raw, plain, 1.0


def is_right(fault: str, found: ThrusterAudit, truth: Wiring, scale: float) -> bool:
    """Return whether the audit states exactly the truth."""
    if fault == "scale":
        return not found.wrong and found.scale[1] <= scale <= found.scale[2]
    if fault == "none":
        return not any(found.statements())
    return found.wiring == truth and not found.alternatives


def study(kind: str, seed: int) -> dict[str, Any]:
    """Run one study; errors are in `failure`."""
    name = VEHICLES[seed % len(VEHICLES)]
    disturbance = DISTURBANCES[seed // len(VEHICLES) % len(DISTURBANCES)]
    rng = np.random.default_rng([seed, 41])
    fault = "none" if kind == "correct" else FAULTS[int(rng.integers(len(FAULTS)))]
    row: dict[str, Any] = dict.fromkeys(SCHEMA) | {
        **{"kind": kind, "seed": seed, "vehicle": name, "fault": fault, "disturbance": disturbance},
        **{"failure": "", "right": False},
    }
    try:
        given, raw = flown(name, disturbance, seed)
        given, raw, truth, scale = planted(fault, given, raw, rng)
        row["truth"] = truth.words() or f"scale {scale:.2f}"
        record = recording(given, raw)
        begun = time.process_time()
        found = audit(given, record)
        row["seconds"] = time.process_time() - begun
        if found is None:
            row["failure"] = "no audit"
            return row
        row |= {
            "said": list(found.lines()),
            "right": is_right(fault, found, truth, scale),
            "probability": found.probability,
            "scale": found.scale[0],
        }
    except Exception as error:  # a failed study is a result; the others continue
        row["failure"] = f"{type(error).__name__}: {error}"
    return row
