"""Difference between recordings made by Stonefish and repeated runs in Stonefish with their commands.

The bundled replay of 90 s is repeated with the bundled vehicle, and with one whose rotors have an exact lag
in place of Stonefish's Euler steps.  RECORDINGS is the folder of the same replay in a current and with a weak
thruster, which are repeated with the hidden change; by default that of the installed distribution
deep-hydro-sim-data, if there is one.  The program is found as by `hydro collect --teacher stonefish`.

    python -m benchmarks.stonefish_again [RECORDINGS] --keep COMMIT
"""

from __future__ import annotations

import argparse
from pathlib import Path

import msgspec
import numpy as np
import polars as pl

from benchmarks.full_recordings import installed
from benchmarks.kept_tables import Row, keep, markdown, origin
from hydro.core.columns import MOTION, Array, command_columns
from hydro.core.effects.record import Table
from hydro.core.vehicle.description import Vehicle
from hydro.io import mesh
from hydro.io import vehicle as files
from hydro.io.files import bundled
from hydro.sim.stonefish.recorder import fly, stonefish_teacher

CURRENT: Table = {
    "name": "ocean_current",
    "v_N": float(0.35 * np.cos(np.radians(40.0))),
    "v_E": float(0.35 * np.sin(np.radians(40.0))),
}
WEAK: Table = {"name": "thruster_gain", "g": [0.0, 0.0, -0.4, 0.0, 0.0, 0.0, 0.0, 0.0]}
ELSEWHERE = {
    "a current of 0.35 m/s toward 40 degrees": ("v1_current_replay90", [CURRENT]),
    "thruster 3 at 60 %": ("v3_thruster3_replay90", [WEAK]),
}


def apart(vehicle: Vehicle, recording: Path, hidden: list[Table]) -> tuple[Array, str]:
    """Return the greatest differences (12,) of a repeated motion from a recording, and the version used."""
    surface = mesh.read_obj(bundled("stonefish") / "hull.obj")
    subject = stonefish_teacher(vehicle, mesh=surface, hidden=hidden)
    frame = pl.read_parquet(recording)
    wanted = frame.select(MOTION).to_numpy().astype(float)
    held = frame.select(command_columns(len(vehicle.thruster))).to_numpy().astype(float)
    motion, _ = fly(subject.scenario, lambda k, _: held[k], len(held), eta=wanted[0, :6], nu=wanted[0, 6:])
    return np.abs(motion - wanted).max(axis=0), subject.version()


def row(what: str, found: tuple[Array, str]) -> Row:
    """Return a row of the table."""
    furthest, version = found
    linear, turning = (
        ", ".join(f"{one:.1e}" for one in furthest[part]) for part in (slice(6, 9), slice(9, 12))
    )
    return {
        "90 s repeated": what,
        "Stonefish": version,
        "u, v, w differ by at most [m/s]": linear,
        "p, q, r [rad/s]": turning,
        "place [m]": f"{furthest[:3].max():.1e}",
    }


def study(recordings: Path | None) -> list[Row]:
    """Return all rows of the table."""
    folder = bundled("stonefish")
    vehicle = files.read(folder / "vehicle.toml")[0]
    exact = msgspec.structs.replace(
        vehicle, thruster=tuple(msgspec.structs.replace(one, lag_step=None) for one in vehicle.thruster)
    )
    replay = folder / "replay90.parquet"
    rows = [
        row("the bundled replay", apart(vehicle, replay, [])),
        row("the same, lags exact (no `lag_step`)", apart(exact, replay, [])),
    ]
    if recordings is not None:
        for what, (name, hidden) in ELSEWHERE.items():
            rows.append(row(what, apart(vehicle, recordings / f"{name}.parquet", hidden)))
    return rows


def main() -> None:
    """Repeat all recordings, print the table, and write it with --keep."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "recordings", nargs="?", type=Path, help="folder of the recordings that are not bundled"
    )
    parser.add_argument("--keep", metavar="COMMIT", help="keep the table, of the code of a commit")
    given = parser.parse_args()
    rows = study(given.recordings or installed())
    print(markdown(rows))
    if given.keep:
        command = "python -m benchmarks.stonefish_again $RECORDINGS"
        source = origin(pl.DataFrame({"seed": [0]}), command, given.keep) | {"seeds": "not used"}
        keep("stonefish_again", [one | source for one in rows])


if __name__ == "__main__":
    main()
