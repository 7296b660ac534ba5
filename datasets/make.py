"""Make the bundled recordings: python datasets/make.py [RECORDINGS].

`hidden/` always; `stonefish/` and `changed/` too where the folder of the full Stonefish recordings is named.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl
import tomlkit

from hydro import cli
from hydro.core.columns import POSE, VELOCITY
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import allocate, configuration_matrix
from hydro.io import table
from hydro.io import vehicle as vehicles

HERE = Path(__file__).parent
STONEFISH, HIDDEN, CHANGED = HERE / "stonefish", HERE / "hidden", HERE / "changed"
ROWS = 1033
"""First rows of every session that the sample takes: sessions begin at rest, and so do the rotors."""

EXCERPTS: dict[str, tuple[str, Sequence[int], int]] = {
    "before": ("nominal", [58 * i // 12 for i in range(12)], 800),
    "thruster": ("v3_thruster3", range(7), 800),
    "thruster-heldout": ("v3_thruster3", (7, 8), 1000),
    "current": ("v1_current", range(9), 800),
    "current-heldout": ("v1_current", (9, 10), 1000),
}
"""Excerpts in changed/: recording, numbers of its sessions, and rows from the start of each."""
FITTED = ("power_drag", "cross_axis_drag", "offset_drag")
"""Effects of changed/vehicle.toml, which `hydro explain` finds in the unchanged vehicle's recordings."""
WEAK = {"name": "thruster_gain", "g": [0.0, 0.0, -0.4, 0.0, 0.0, 0.0, 0.0, 0.0]}
"""Change of changed/thruster.parquet: thruster 3 gives 60 % of its thrust."""

SEED, RATE = 151, 50.0
EFFECTS: tuple[dict[str, Any], ...] = (
    {"name": "ocean_current", "v_N": 0.2, "v_E": -0.15, "v_D": 0.0},
    {"name": "thruster_gain", "g": [0.0, 0.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0]},
)
"""What hides in hidden/: 0.25 m/s of current, and thruster 5 at 70 %."""
MISJUDGED = (1.25, 0.75, 1.25, 0.75, 1.25, 0.75)
"""Quadratic damping of the vehicle file over the true one."""
SESSIONS = {"measured": (4, 60.0), "heldout": (2, 45.0)}
"""Sessions of each file, and their length [s]."""
STICKS = np.array([180.0, 150.0, 300.0, 20.0, 30.0, 25.0])
"""Wrench of a stick at its stop [N, N m]."""
DEPTH = 30.0  # m


def main(recordings: Path | None) -> None:
    """Write both folders, the vehicle files in the footers of their tables."""
    make_hidden()
    if recordings is not None:
        make_stonefish(recordings)
        make_changed(recordings)


def make_hidden() -> None:
    """Write hidden/: a vehicle file, what the true vehicle logged, and what the file does not know of it."""
    true, text = vehicles.read(HERE / "vehicles" / "auv151.toml")
    damping = next(iter(true.effects("quadratic_damping")))["diagonal"]
    wrong = [round(value * factor, 3) for value, factor in zip(damping, MISJUDGED, strict=True)]
    text = vehicles.set_effect(text, {"name": "quadratic_damping", "diagonal": wrong})
    text = text.replace(text.partition("format")[0], "# The vehicle as its owner knows it.\n")
    vehicles.write(text, HIDDEN / "vehicle.toml")
    true = msgspec.structs.replace(true, effect=(*true.effect, *EFFECTS))
    rng, number, contents = np.random.default_rng(SEED), 0, {}
    parameters = {"simulator": "hydro simulate, with more than the vehicle file has", "noise": "ordinary"}
    for name, (count, seconds) in SESSIONS.items():
        parts = [_flown(true, f"run-{number + i + 1}", seconds, rng) for i in range(count)]
        number += count
        artefact = table.make(
            "raw", pl.concat(parts), stage="simulate", parameters=parameters, vehicle_text=text
        )
        _write(artefact, HIDDEN / f"{name}.parquet")
        contents[name] = artefact.provenance.content
    truth = tomlkit.document()
    truth.add(
        tomlkit.comment(
            "What made the recordings beside this file and is not in vehicle.toml. No command reads it."
        )
    )
    truth.update({"format": "hydro-truth/1", "seed": SEED, "raw": contents})
    truth["effect"] = [*EFFECTS, {"name": "quadratic_damping", "diagonal": damping}]
    (HIDDEN / "truth.toml").write_text(tomlkit.dumps(truth))


def _flown(true: Vehicle, session: str, seconds: float, rng: np.random.Generator) -> pl.DataFrame:
    """One session by a pilot's sticks, each in one place for some seconds, from rest on some heading."""
    t = np.arange(round(seconds * RATE)) / RATE
    sticks = np.zeros((t.size, 6))
    for axis in np.flatnonzero(STICKS):
        turns = np.cumsum(rng.uniform(2.0, 6.0, round(seconds / 2.0)))
        places = rng.uniform(-1.0, 1.0, turns.size + 1) * (rng.uniform(size=turns.size + 1) < 0.75)
        sticks[:, axis] = places[np.searchsorted(turns, t, side="right")]
    limit = np.array([thruster.max_thrust for thruster in true.thruster])
    commands = np.clip(allocate(configuration_matrix(true), sticks * STICKS) / limit, -1.0, 1.0)
    begin = dict.fromkeys((*POSE, *VELOCITY), 0.0) | {"z": DEPTH, "psi": float(rng.uniform(-np.pi, np.pi))}
    flown = simulate(
        true,
        pl.DataFrame(
            {"session": session, "t": t, **begin}
            | {f"cmd_{i + 1}": column for i, column in enumerate(commands.T)}
        ),
    )
    logged = disturb(flown.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    numbers = flown.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))
    return numbers.with_columns(pl.col(pl.Float64).exclude("t").cast(pl.Float32))


def make_stonefish(recordings: Path) -> None:
    """Write stonefish/: the heads of nominal.parquet's sessions, and replay90.parquet."""
    vehicle = (STONEFISH / "vehicle.toml").read_text()
    nominal = pl.read_parquet(recordings / "nominal.parquet")
    heads = nominal.filter(pl.int_range(pl.len()).over("session") < ROWS)
    replay = pl.read_parquet(recordings / "replay90.parquet")
    for name, frame, source in (
        ("sample", heads, "nominal.parquet"),
        ("replay90", replay, "replay90.parquet"),
    ):
        parameters: dict[str, Any] = {"simulator": "Stonefish 1.6.0", "file": source}
        if name == "sample":
            parameters["rows_of_each_session"] = ROWS
        artefact = table.make("raw", frame, stage="import", parameters=parameters, vehicle_text=vehicle)
        _write(artefact, STONEFISH / f"{name}.parquet")


def make_changed(recordings: Path) -> None:
    """Write changed/: recordings before and after two changes, and a vehicle file fitted to the first."""
    text = (STONEFISH / "vehicle.toml").read_text()
    for name, (source, sessions, rows) in EXCERPTS.items():
        raw = pl.read_parquet(recordings / f"{source}.parquet")
        names = raw["session"].unique(maintain_order=True)
        frame = pl.concat([raw.filter(session=names[number]).head(rows) for number in sessions])
        parameters = {
            "simulator": "Stonefish 1.6.0",
            "file": f"{source}.parquet",
            "rows_of_each_session": rows,
        }
        artefact = table.make("raw", frame, stage="import", parameters=parameters, vehicle_text=text)
        _write(artefact, CHANGED / f"{name}.parquet")
    effects = [part for name in FITTED for part in ("--effect", name)]
    before = str(CHANGED / "before.parquet")
    cli.main(["fit", str(STONEFISH / "vehicle.toml"), before, *effects, "-o", str(CHANGED / "vehicle.toml")])
    write_truth()


def write_truth() -> None:
    """Write changed/thruster-true.toml: the fitted file with the true change of the weak thruster."""
    text = vehicles.set_effect((CHANGED / "vehicle.toml").read_text(), WEAK)
    vehicles.write(text, CHANGED / "thruster-true.toml")


def _write(artefact: table.Artefact, path: Path) -> None:
    table.write(artefact, path)
    print(f"{path.relative_to(HERE)}  {artefact.frame.height} rows  {artefact.provenance.content}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
