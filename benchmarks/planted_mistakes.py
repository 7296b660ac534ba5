"""Detection of planted mistakes in maps, mountings and clocks by `hydro import`.

Thirteen mistakes are planted one at a time in logs of three bundled vehicles in the reference simulator
with the noise of an ordinary navigation suite.  A mistake counts as named if a line of the import, or its
error, states the correction.  `clean` counts the warnings without a mistake.

    python -m benchmarks.planted_mistakes
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import polars as pl

from benchmarks import kept_tables
from hydro.core.columns import MOTION
from hydro.core.errors import DataError
from hydro.core.simulation.sensor_noise import PROFILES
from hydro.core.vehicle.description import Vehicle
from hydro.io import log_import, logmap
from hydro.io import vehicle as vehicle_io
from hydro.io.files import bundled
from hydro.io.log import Log
from hydro.sim.teacher import collect, teacher

VEHICLES = ("bluerov2_heavy", "remus100", "auv151")
ROWS, SEED = 15_000, 5
"""Rows at 50 Hz, and the seed of demands and noise."""
LATE = 0.4
"""Delay of the late time stamps [s]."""
CLEAN = "none"
Spec = dict[str, dict[str, object]]
Change = Callable[[pl.DataFrame, Spec], tuple[pl.DataFrame, Spec]]


@dataclass(frozen=True)
class Mistake:
    """Mistake in a log or its map.

    Attributes:
        change: Function that plants the mistake.
        named: Parts of the messages that identify the mistake.
    """

    change: Change
    named: tuple[str, ...]


def declared(table: str, **settings: object) -> Change:
    """Return a change of the settings of one block of the map."""
    return lambda log, spec: (log, {**spec, table: {**spec[table], **settings}})


def written(*columns: pl.Expr) -> Change:
    """Return a change of columns of the log."""
    return lambda log, spec: (log.with_columns(*columns), spec)


def late(*names: str) -> Change:
    """Return a change that gives columns late time stamps."""
    rows = round(LATE * 50.0)
    return written(*(pl.col(name).shift(rows).over("session") for name in names))


def _commands(spec: Spec) -> list[str]:
    """Return the command columns of a map."""
    return list(spec["commands"]["columns"])  # type: ignore[call-overload]


MISTAKES: dict[str, Mistake] = {
    "position is ENU": Mistake(
        written(pl.col("y").alias("x"), pl.col("x").alias("y"), -pl.col("z")), ('position.world = "ENU"',)
    ),
    "velocity is FLU": Mistake(written(-pl.col("v"), -pl.col("w")), ('velocity.frame = "FLU"',)),
    "attitude is in degrees": Mistake(
        written(pl.col("phi", "theta", "psi").degrees()), ('attitude.unit = "deg"',)
    ),
    "rates are in degrees": Mistake(written(pl.col("p", "q", "r").degrees()), ('rates.unit = "deg/s"',)),
    "velocity is in knots": Mistake(written(pl.col("u", "v", "w") * 3600 / 1852), ('velocity.unit = "kn"',)),
    "heave is up": Mistake(written(-pl.col("w")), ('column = "w", scale = -1',)),
    "u and v exchanged": Mistake(
        declared("velocity", columns=["v", "u", "w"]), ("write u in the place of v",)
    ),
    "yaw rate reversed": Mistake(written(-pl.col("r")), ('column = "r", scale = -1',)),
    "clock in milliseconds": Mistake(written(pl.col("t") * 1000.0), ('time.unit = "ms"',)),
    "velocity stamped late": Mistake(
        late("u", "v", "w"), ("velocity is stamped 0.4", "velocity is stamped 0.3")
    ),
    "commands stamped late": Mistake(
        lambda log, spec: late(*_commands(spec))(log, spec), ("before the commands that cause it",)
    ),
    "thrusters from the other end": Mistake(
        lambda log, spec: declared("commands", columns=_commands(spec)[::-1])(log, spec),
        ("drives thruster",),
    ),
    "thruster 2 reversed": Mistake(written(-pl.col("cmd_2")), ("thruster 2 pushes opposite to the file",)),
}


def log_of(raw: pl.DataFrame) -> tuple[pl.DataFrame, Spec]:
    """Return a raw table as a log, and its map."""
    commands = [name for name in raw.columns if name.startswith("cmd_")]
    spec: Spec = {
        "time": {"column": "t"},
        "session": {"column": "session"},
        "position": {"columns": ["x", "y", "z"]},
        "attitude": {"columns": ["phi", "theta", "psi"]},
        "velocity": {"columns": ["u", "v", "w"]},
        "rates": {"columns": ["p", "q", "r"]},
        "commands": {"columns": commands},
    }
    return raw.select("session", "t", *(pl.col(name).cast(pl.Float64) for name in (*MOTION, *commands))), spec


def flown(name: str, rows: int = ROWS) -> tuple[Vehicle, pl.DataFrame]:
    """Return a bundled vehicle and a recording of it."""
    vehicle = vehicle_io.read(bundled(f"vehicles/{name}.toml"))[0]
    return vehicle, collect(teacher(vehicle), rows, SEED, noise=PROFILES["ordinary"], threads=1)


def said(vehicle: Vehicle, log: pl.DataFrame, spec: Spec) -> list[str]:
    """Return the warnings of an import and of its thruster audit, or its error."""
    source = Log("log", log, "sha256:0")
    try:
        report = log_import.import_log(source, logmap.parse(_toml(spec)))
    except DataError as error:
        return [f"error: {error}"]
    lines = [*report.lines(), *log_import.audited(report, vehicle, "vehicle.toml")]
    return [line for line in lines if line.startswith("warning")]


def outcomes(
    vehicle: Vehicle, raw: pl.DataFrame, names: Sequence[str]
) -> Iterator[tuple[str, bool, list[str]]]:
    """Yield for each mistake its name, whether it is named, and all messages."""
    log, spec = log_of(raw)
    for name in names:
        one = MISTAKES[name]
        lines = said(vehicle, *one.change(log, spec))
        yield name, any(part in line for line in lines for part in one.named), lines


def _toml(spec: Spec) -> str:
    import tomlkit

    return tomlkit.dumps(spec)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", nargs="*", default=VEHICLES)
    parser.add_argument("--rows", type=int, default=ROWS)
    parser.add_argument("--lines", action="store_true", help="print all messages")
    parser.add_argument(
        "--keep", metavar="COMMIT", help="write benchmarks/results for this commit of the code"
    )
    given = parser.parse_args()
    cells: dict[str, dict[str, str]] = {name: {} for name in (*MISTAKES, CLEAN)}
    for name in given.vehicles:
        vehicle, raw = flown(name, given.rows)
        clean = said(vehicle, *log_of(raw))
        cells[CLEAN][name] = f"{len(clean)} warnings"
        print(f"{name}: {raw.height:,} rows; clean: {len(clean)} warnings", *clean, sep="\n  ")
        for mistake, named, lines in outcomes(vehicle, raw, tuple(MISTAKES)):
            cells[mistake][name] = "named" if named else "missed"
            print(f"  {'named ' if named else 'MISSED'} {mistake} ({len(lines)} lines)", flush=True)
            if given.lines or not named:
                print(*lines, sep="\n      ")
    total = [cell == "named" for mistake in MISTAKES for cell in cells[mistake].values()]
    print(f"{sum(total)} of {len(total)} named")
    if given.keep is not None:
        command = f"python -m benchmarks.planted_mistakes --rows {given.rows}"
        origin = kept_tables.origin(pl.DataFrame({"seed": [SEED]}), command, given.keep)
        origin["seeds"] = str(SEED)
        kept_tables.keep("planted_mistakes", [{"mistake": name, **cells[name], **origin} for name in cells])


if __name__ == "__main__":
    main()
