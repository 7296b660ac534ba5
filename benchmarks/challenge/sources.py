"""Vehicles, logs and truths of the cases, from three simulators.

`panel` flies hulls of panels in the reference simulator, `apart` the simulator that shares no code with
hydro, and `stonefish` cuts the recordings of deep-hydro-sim-data.  Number and key draw a case.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import polars as pl
import tomlkit

from benchmarks.challenge import seal
from benchmarks.full_recordings import folder_of
from benchmarks.hidden_effects import vehicles
from benchmarks.imperfect_base import base, changes
from benchmarks.imperfect_base.study import changed, standing_out
from hydro.core.columns import MOTION
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.vehicle.description import Vehicle, as_written
from hydro.core.vehicle.frames import wrapped
from hydro.io.files import bundled

UNCHANGED = 4
"""Of the cases of a simulator, every fourth has no change, from the second on."""
WITHOUT_BEFORE = 4
"""Of the cases of a simulator, every fourth has no earlier log, from the fourth on."""
PANEL_SECONDS, PANEL_BEFORE = 120.0, 240.0
"""Lengths of a panel vehicle's log and of its earlier log [s]."""
APART_SESSIONS, APART_BEFORE = 2, 4
"""Sessions of some 70 s in a log of `apart`, and in its earlier log."""
STONEFISH_ROWS, STONEFISH_SESSIONS, STONEFISH_BEFORE = 1000, 5, 8
"""Rows from the start of a session of Stonefish, and numbers of sessions."""
PORT = {"cmd_1": "cmd_2", "cmd_3": "cmd_4", "cmd_5": "cmd_6", "cmd_7": "cmd_8"}
"""Columns of the thrusters that a mirror exchanges, starboard and port."""
MIRRORED = ("y", "phi", "psi", "v", "p", "r")
"""Columns that change sign in a mirror through the vertical plane of symmetry."""
CURRENT = (0.35, np.radians(40.0))
"""Speed [m/s] and direction [rad] of the current in v1_current."""
WEAK = (2, -0.4)
"""Place and loss of the weak thruster in v3_thruster3."""


@dataclass(frozen=True)
class Source:
    """Material of a case.

    Attributes:
        vehicle: Text of the vehicle file.
        log: Raw table.
        before: Raw table of the unchanged vehicle; None without one.
        held_out: Raw table for the windows.
        called: Effects of which each is a right name; empty if nothing has changed.
        alias: Effects that count as neither right nor wrong.
        values: True tables of hidden effects, where the catalogue has them.
        title: The change in words.
    """

    vehicle: str
    log: pl.DataFrame
    before: pl.DataFrame | None
    held_out: pl.DataFrame
    called: tuple[str, ...]
    alias: tuple[str, ...] = ()
    values: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    title: str = ""


@dataclass(frozen=True)
class Number:
    """Case before it is drawn.

    Attributes:
        place: Number of the case in the challenge.
        key: Key of the edition.
        folder: Folder for files that cases share.
    """

    place: int
    key: bytes
    folder: Path

    @property
    def simulator(self) -> str:
        """Return the simulator of the case; successive cases use the simulators in turn."""
        return tuple(SIMULATORS)[self.place % len(SIMULATORS)]

    @property
    def turn(self) -> int:
        """Return the number of the case among the cases of its simulator, from 0."""
        return self.place // len(SIMULATORS)

    @property
    def changed(self) -> bool:
        """Return whether a change is hidden in the case."""
        return self.turn % UNCHANGED != 1

    @property
    def with_before(self) -> bool:
        """Return whether the case has an earlier log."""
        return self.turn % WITHOUT_BEFORE != 3

    @property
    def rng(self) -> np.random.Generator:
        """Return the random generator of the case."""
        return np.random.default_rng(seal.seed(self.key, f"case {self.place}"))

    def shuffled(self, label: str, count: int) -> int:
        """Return a number from 0 to `count` - 1, each once in `count` turns, in an order set by the key."""
        rng = np.random.default_rng(seal.seed(self.key, label))
        rounds = [rng.permutation(count) for _ in range(self.turn // count + 1)]
        return int(rounds[-1][self.turn % count])


def panel(number: Number) -> Source:
    """Fly a hull of panels; cases share their hulls, one per kind of vehicle."""
    group = seal.seed(number.key, "panel") // base.GROUP * base.GROUP
    seed = group + number.shuffled("panel order", base.GROUP)
    case = changes.draw("changed" if number.changed else "nothing", seed)
    known = base.of(case.preset, seed, PANEL_BEFORE, number.folder / "bases")
    case = standing_out(case, known, PANEL_SECONDS)[0]
    case, flown, _ = changed(case, known, PANEL_SECONDS)
    truth = vehicles.joined(known.vehicle, case.hidden)
    return Source(
        written(flown.given),
        flown.measured,
        pl.read_parquet(known.unchanged) if number.with_before else None,
        flown.held_out,
        tuple(case.called),
        values={name: dict(truth.effects(name)[0]) for name in case.called},
        title=f"{case.preset}: {case.title or 'nothing'}",
    )


def apart(number: Number) -> Source:
    """Fly a vehicle of the simulator that shares no code with hydro."""
    from benchmarks.apart.cases import CASES
    from benchmarks.apart.cases import UNCHANGED as SAME
    from benchmarks.apart.judgement import NAMES
    from benchmarks.apart.make import make

    those = [case for case in CASES if (case.kind != SAME) == number.changed]
    case = those[number.shuffled("apart order", len(those))]
    edition = seal.seed(number.key, "apart")
    there = number.folder / "apart" / case.name
    make(edition, there.parent, [case.name])
    after, before = (pl.read_parquet(there / f"{name}.parquet") for name in ("after", "before"))
    names = after["session"].unique(maintain_order=True)
    right = NAMES[case.kind]
    return Source(
        (there / "vehicle.toml").read_text(),
        after.filter(pl.col("session").is_in(names[:APART_SESSIONS].implode())),
        first(before, APART_BEFORE) if number.with_before else None,
        after.filter(session=names[-1]),
        right.right if number.changed else (),
        right.alias,
        title=case.name,
    )


def stonefish(number: Number) -> Source:
    """Cut a recording of Stonefish, turn it to another heading, mirror it, and add noise of sensors."""
    rng = number.rng
    recordings = folder_of(None)
    kind = ("v1_current", "v3_thruster3")[number.shuffled("stonefish order", 2)] if number.changed else ""
    angle, mirror = float(rng.uniform(-np.pi, np.pi)), bool(rng.uniform() < 0.5)

    def cut(name: str, count: int, skip: int = 0) -> pl.DataFrame:
        raw = pl.read_parquet(recordings / f"{name}.parquet")
        sessions = raw["session"].unique(maintain_order=True).to_list()
        chosen = np.random.default_rng([int(rng.integers(2**32))]).permutation(len(sessions))
        order = np.roll(chosen, -skip)[:count]
        return pl.concat([raw.filter(session=sessions[int(i)]).head(STONEFISH_ROWS) for i in order])

    def seen(raw: pl.DataFrame) -> pl.DataFrame:
        out = turned(mirrored(raw) if mirror else raw, angle)
        noisy = disturb(out.select(MOTION).to_numpy().astype(float), PROFILES["ordinary"], rng)
        return out.with_columns(pl.DataFrame(noisy, schema=list(MOTION)))

    whole = cut(kind or "nominal_test", STONEFISH_SESSIONS + 2)
    log = first(whole, STONEFISH_SESSIONS)
    held_out = whole.filter(~pl.col("session").is_in(log["session"].unique().implode()))
    values: dict[str, dict[str, Any]] = {}
    if kind == "v1_current":
        speed, direction = CURRENT
        direction = (-direction if mirror else direction) + angle
        values["ocean_current"] = {
            "v_N": float(speed * np.cos(direction)),
            "v_E": float(speed * np.sin(direction)),
            "v_D": 0.0,
        }
    elif kind:
        place, loss = WEAK
        values["thruster_gain"] = {"g": [loss * (i == place + mirror) for i in range(8)]}
    return Source(
        (bundled("changed") / "vehicle.toml").read_text(),
        seen(log),
        seen(cut("nominal", STONEFISH_BEFORE)) if number.with_before else None,
        seen(held_out),
        tuple(values),
        values=values,
        title=kind or "unchanged",
    )


SIMULATORS: Mapping[str, Callable[[Number], Source]] = {
    "panel": panel,
    "apart": apart,
    "stonefish": stonefish,
}
"""Simulators by name, in the order of their turns."""


def first(raw: pl.DataFrame, count: int) -> pl.DataFrame:
    """Return the first sessions of a raw table."""
    names = raw["session"].unique(maintain_order=True)[:count]
    return raw.filter(pl.col("session").is_in(names.implode()))


def mirrored(raw: pl.DataFrame) -> pl.DataFrame:
    """Return a recording as seen in a mirror through the vehicle's vertical plane of symmetry."""
    swapped = {**PORT, **{port: starboard for starboard, port in PORT.items()}}
    return raw.with_columns(
        *(-pl.col(name) for name in MIRRORED),
        *(pl.col(other).alias(name) for name, other in swapped.items()),
    )


def turned(raw: pl.DataFrame, angle: float) -> pl.DataFrame:
    """Return a recording turned about the vertical by an angle [rad]: water and vehicle look the same."""
    north, east, psi = (raw[name].to_numpy().astype(float) for name in ("x", "y", "psi"))
    c, s = np.cos(angle), np.sin(angle)
    return raw.with_columns(
        x=pl.Series(c * north - s * east),
        y=pl.Series(s * north + c * east),
        psi=pl.Series(wrapped(psi + angle)),
    )


def written(vehicle: Vehicle) -> str:
    """Return a vehicle as the text of a vehicle file."""
    return tomlkit.dumps({"format": vehicle.format, **msgspec.to_builtins(as_written(vehicle))})


def given_values(text: str, effect: str) -> dict[str, Any]:
    """Return the table of an effect in the text of a vehicle file; empty if it has none."""
    for table in tomllib.loads(text).get("effect", []):
        if table["name"] == effect:
            return dict(table)
    return {}
