"""Faults of the fins of the preset `remus100_fins`, diagnosed by `hydro diagnose` with a recording before.

A case is one vehicle with one fault of its rudder or its stern planes:

    stuck   The fins stay at a fixed angle of 2 to 6 degrees, whatever the command.
    half    The fins have half their area.
    trim    The fins are 2 to 4 degrees off at every command.
    none    Nothing has changed.

The earlier and the later recording are simulated under an autopilot with dither, with noise of ordinary
sensors.  A finding counts if it is confirmed and names the fin that has the fault.  The file knows the hull,
so that the cases show the test of the fins alone.

    python -m benchmarks.fin_faults --cases 20 --keep COMMIT
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
import polars as pl

from benchmarks.kept_tables import Row, keep, markdown, origin
from benchmarks.remus_steps import preset
from benchmarks.work import Results
from hydro.core.columns import MOTION, Array
from hydro.core.diagnosis.findings import Finding
from hydro.core.diagnosis.pipeline import diagnose
from hydro.core.simulation.live import Live
from hydro.core.vehicle.description import Vehicle

DT = 0.1
"""Interval of the rows [s]."""
SECONDS, SESSIONS = 60.0, 2
DEPTH = 20.0
"""Initial depth [m]."""
NOISE = dict(zip(MOTION, [0.02, 0.02, 0.01, *[0.005] * 3, *[0.01] * 3, *[0.003] * 3], strict=True))
"""Standard deviation of the sensors' white noise [m, rad, m/s, rad/s]."""
FINS = ("control_surface:rudder", "control_surface:stern_planes")
FAULTS = ("stuck", "half", "trim", "none")
FIRST_SEED = 61000
CONFIRMED = ("missing", "retune")
"""Verdicts that state one effect."""
SCHEMA = {
    "seed": pl.Int64,
    "fault": pl.String,
    "fin": pl.String,
    "found": pl.String,
    "verdict": pl.String,
    "confidence": pl.Float64,
    "right": pl.Boolean,
    "seconds": pl.Float64,
    "values": pl.String,
}
"""Columns of the results file, one row per case."""
LEGS = (6.0, 12.0)
"""Least and greatest time between new headings and pitch angles [s]."""
DITHER = (1.0, 3.0)
"""Least and greatest time between steps of the dither [s]."""


def flown(vehicle: Vehicle, seed: int) -> pl.DataFrame:
    """Return a raw table of a vehicle under an autopilot with dither."""
    rng = np.random.default_rng(seed)
    parts = [_session(vehicle, f"s{number}", rng) for number in range(SESSIONS)]
    return pl.concat(parts)


def _session(vehicle: Vehicle, name: str, rng: np.random.Generator) -> pl.DataFrame:
    """Return the raw table of one session."""
    rows = round(SECONDS / DT)
    heading = held(rng, rows, LEGS, -1.5, 1.5)
    pitch, speed = held(rng, rows, LEGS, -0.25, 0.25), held(rng, rows, LEGS, 0.7, 1.0)
    dither = np.stack([held(rng, rows, DITHER, -0.4, 0.4) for _ in range(2)])
    live, motion, commands = Live(vehicle), np.zeros((rows, 12)), np.zeros((rows, 3))
    live.reset([0.0, 0.0, DEPTH, 0.0, 0.0, 0.0])
    for row in range(rows):
        now = live.read()
        motion[row] = [*now.eta, *now.nu]
        off = math.remainder(heading[row] - now.eta[5], 2.0 * math.pi)
        rudder = -2.0 * off + 1.5 * now.nu[5] + dither[0, row]
        planes = -0.4 - 4.0 * (pitch[row] - now.eta[4]) + 3.0 * now.nu[4] + dither[1, row]
        commands[row] = speed[row], *np.clip([rudder, planes], -1.0, 1.0)
        live.step(commands[row], DT)
    measured = motion + rng.normal(size=motion.shape) * list(NOISE.values())
    columns = dict(zip(MOTION, measured.T, strict=True))
    commanded = {f"cmd_{number + 1}": column for number, column in enumerate(commands.T)}
    return pl.DataFrame({"session": [name] * rows, "t": np.arange(rows) * DT} | columns | commanded)


def held(rng: np.random.Generator, rows: int, seconds: tuple[float, float], low: float, high: float) -> Array:
    """Draw values (rows,) between `low` and `high`, each held for a random time.

    Args:
        rng: Random generator.
        rows: Number of rows.
        seconds: Least and greatest time for which a value is held [s].
        low: Least value.
        high: Greatest value.
    """
    values = np.zeros(rows)
    at = 0
    while at < rows:
        length = max(1, round(rng.uniform(*seconds) / DT))
        values[at : at + length] = rng.uniform(low, high)
        at += length
    return values


def with_fault(vehicle: Vehicle, fault: str, seed: int) -> tuple[Vehicle, str]:
    """Return the vehicle with a fault, and the name of the fin; empty without a fault."""
    rng = np.random.default_rng([seed, 1])
    if fault == "none":
        return vehicle, ""
    fin = FINS[int(rng.integers(2))]
    angle = math.radians(rng.uniform(2.0, 6.0 if fault == "stuck" else 4.0)) * rng.choice([-1.0, 1.0])
    (table,) = vehicle.effects(fin)
    changes: Mapping[str, object] = {
        "stuck": {"turn": [0.0], "deflection": float(angle)},
        "half": {"area": 0.5 * table["area"]},
        "trim": {"deflection": float(angle)},
    }[fault]
    effects = tuple({**one, **changes} if one["name"] == fin else one for one in vehicle.effect)
    return msgspec.structs.replace(vehicle, effect=effects), fin


def case(fault: str, seed: int) -> Row:
    """Return the row of one case, with its diagnosis."""
    vehicle = preset()
    changed, fin = with_fault(vehicle, fault, seed)
    before, after = flown(vehicle, seed), flown(changed, seed + 500)
    begun = time.process_time()
    found = diagnose(vehicle, after, before=before).findings[0]
    return {
        "seed": seed, "fault": fault, "fin": fin or "-", "found": found.effect, "verdict": found.verdict,
        "confidence": found.confidence, "right": right(found, fin),
        "seconds": time.process_time() - begun,
        "values": msgspec.json.encode(found.parameters).decode(),
    }  # fmt: skip


def right(found: Finding, fin: str) -> bool:
    """Return whether the first finding is confirmed and names the fin; without a fault, whether none is."""
    is_stated = found.verdict in CONFIRMED
    return is_stated and found.effect == fin if fin else not is_stated


def report(cases: list[Row]) -> list[Row]:
    """Return one row per fault."""
    rows = []
    for fault in FAULTS:
        those = [one for one in cases if one["fault"] == fault]
        if not those:
            continue
        named = sum(one["found"] == one["fin"] for one in those)
        wrong = sum(one["verdict"] in CONFIRMED and not one["right"] for one in those)
        rows.append(
            {
                "fault": fault,
                "cases": len(those),
                "fin named first": f"{named} of {len(those)}" if fault != "none" else "",
                "stated and right": f"{sum(one['right'] for one in those)} of {len(those)}",
                "stated and wrong": f"{wrong} of {len(those)}",
                "processor seconds per case": f"{np.mean([one['seconds'] for one in those]):.0f}",
            }
        )
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Run the cases, print the table, and keep it with `--keep`."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=20, help="cases of each fault")
    parser.add_argument(
        "--output", type=Path, default=Path("fin_faults.parquet"), help="file of cases, continued"
    )
    parser.add_argument("--report", action="store_true", help="run no case, report those of the file")
    parser.add_argument("--keep", metavar="COMMIT", help="keep the table as measured with this commit")
    given = parser.parse_args(arguments)
    results = Results(given.output, SCHEMA)
    known = set(results.table.select("seed", "fault").iter_rows())
    wanted = [(FIRST_SEED + number, fault) for number in range(given.cases) for fault in FAULTS]
    for seed, fault in wanted * (not given.report):
        if (seed, fault) not in known:
            found = case(fault, seed)
            print(found, flush=True)
            results.add(found)
    table = report(results.table.to_dicts())
    print(markdown(table))
    if given.keep:
        command = f"python -m benchmarks.fin_faults --cases {given.cases}"
        source = origin(results.table, command, given.keep)
        keep("fin_faults", [row | source for row in table])


if __name__ == "__main__":
    main()
