"""Recordings of the three parts: training and held-out sessions of a vehicle, simulated or real."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

import hydro
from hydro.core.columns import POSE, VELOCITY, Array, Mask
from hydro.core.evaluation.smoothed_motion import Motion
from hydro.core.recording.arrays import recording
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as vehicles
from hydro.sim import teacher as simulator

ROOT = Path(__file__).resolve().parents[2]
OWN, WITH_DRAG = "fit: effects of the file", "fit: these and ellipsoid_drag"
WITH_MEMORY = "fit: these, ellipsoid_drag and fluid_memory"
"""Names of the fitted models."""
FILES = ("fit.csv", "hold.csv", "map.toml", "vehicle2.toml")
"""Files of the folder of a real recording; the last is its vehicle file."""
VEHICLES = ("auv151", "bluerov2_heavy", "remus100")
"""Vehicle files of part `vehicles`, in datasets/vehicles."""
WITHOUT = "auv151"
"""The one that part `memory` gives a fluid memory."""
ROWS = {"train": 60_000, "held out": 15_000}
"""Rows at 50 Hz of the simulated recordings: 20 and 5 minutes.  The paper's recording has 857,542 rows; the
processor time of this benchmark allows fewer."""
REPLAY_ROWS = 4_500
"""Rows of the sequence of commands of 90 s that Table III of the paper replays."""
SEEDS = {"train": 11, "held out": 12, "replay": 13}
"""Seeds of the simulated recordings."""
DELAYED = 0.5
"""Impulse of the memory's force, K/a, as a share of the hull's added mass.  Slow motion then meets 1.5 times
the added mass of fast motion.  No measured memory of a submerged vehicle is known to us.  The share is that
of the lift of a thin wing which builds up with the wake (Jones 1940, in Fung 1955, section 6.7: 0.165 +
0.335 of the final lift)."""
DECAY = {"memory of 0.25 s": 0.25, "memory of 1 s": 1.0}
"""Decay times 1/a of the memory [s].  The first lies within the 0.28 s that the temporal network sees, the
second does not.  A wake of a wing decays over b / (0.3 U) (Jones 1940): 0.8 s at a half length b of 0.25 m
and 1 m/s."""
REAL = ("net_buoyancy", "buoyancy_offset", "command_delay")
"""Effects that are fitted to the real recording in addition to those of its file: its commands are those of a
controller, and the trim of the vehicle is not in its file."""
RATE = 25.0
"""Rows per second of the real recording: the rate of the temporal network, which its sensors do not reach."""
Effects = tuple[str | dict[str, Any], ...]


@dataclass(frozen=True)
class Recordings:
    """Recordings of one case.

    Attributes:
        vehicle: Vehicle file that every model starts from.
        train: Raw table of the sessions that models are fitted to.
        held_out: Raw table of the held-out sessions, without nulls.
        truth: Logged velocity of the held-out sessions, (N, 6).
        seen: Which of these values were measured, (N, 6).
        replay: Raw table of one long sequence of commands from rest; None if there is none.
        labels: Raw tables that the wrench labels of both parts are computed from, without nulls.
    """

    vehicle: Vehicle
    train: pl.DataFrame
    held_out: pl.DataFrame
    truth: Array
    seen: Mask
    replay: pl.DataFrame | None
    labels: tuple[pl.DataFrame, pl.DataFrame]


@dataclass(frozen=True)
class Case:
    """A vehicle in some water, and the models that are compared on it.

    Attributes:
        part: `memory`, `vehicles` or `recorded`.
        name: Name of the case in the tables.
        load: Returns the recordings.
        fits: Effects of each fitted model, by its name.
        explained: Vehicle file that `hydro explain` wrote for the recording; None if there is none.
    """

    part: str
    name: str
    load: Callable[[], Recordings]
    fits: dict[str, Effects] = field(default_factory=dict)
    explained: Path | None = None


def memory(vehicle: Vehicle, decay: float) -> dict[str, Any]:
    """Return the fluid memory of a decay time [s], in proportion to the hull's added mass."""
    added = np.diag(simulator.teacher(vehicle).added_mass)
    return {"name": "fluid_memory", "K": [(DELAYED * added / decay).tolist()], "rates": [1.0 / decay]}


def start_of_memory(vehicle: Vehicle) -> dict[str, Any]:
    """Return the values from which the fit of a fluid memory starts: a tenth of the file's mass, at 2 1/s."""
    body = vehicle.rigid_body
    sizes = np.concatenate([np.repeat(body.mass, 3), np.diag(np.array(body.inertia))])
    return {"name": "fluid_memory", "K": [(0.1 * 2.0 * sizes).tolist()], "rates": [2.0]}


def simulated(name: str, decay: float | None) -> Recordings:
    """Record a vehicle of datasets/vehicles in the reference simulator, without noise.

    Args:
        name: Name of the vehicle file.
        decay: Decay time of the fluid memory [s]; None without one.
    """
    vehicle = known(name)
    subject = simulator.teacher(vehicle, hidden=[memory(vehicle, decay)] if decay else [])
    train, held_out = (simulator.collect(subject, ROWS[which], SEEDS[which], threads=1) for which in ROWS)
    sequence = simulator.Programme("replay90")
    replay = simulator.collect(subject, REPLAY_ROWS, SEEDS["replay"], programme=sequence, threads=1)
    truth = held_out.select(VELOCITY).to_numpy().astype(float)
    seen = np.ones(truth.shape, bool)
    return Recordings(vehicle, train, held_out, truth, seen, replay, (train, held_out))


def real(folder: Path) -> Recordings:
    """Read a real recording.

    Sensors slower than the rows leave nulls.  The held-out sessions get smoothed motion, at which predictions
    start.  Labels are of rows interpolated between samples: from samples alone, the noise of acceleration
    leaves no row a label.

    Args:
        folder: Folder with FILES.
    """
    *logs, known_map, file = (folder / name for name in FILES)
    vehicle = vehicles.read(file)[0]
    train, held_out = (hydro.import_log(log, known_map, rate=RATE)[0] for log in logs)
    whole, whole_held_out = (hydro.import_log(log, known_map, rate=RATE, fill=True)[0] for log in logs)
    record = recording(vehicle, held_out)
    motion = Motion.of(record)
    smoothed = pl.DataFrame(np.hstack([motion.eta, motion.nu]), schema=[*POSE, *VELOCITY])
    seen = np.ones(record.nu.shape, bool) if record.seen is None else record.seen[:, 6:]
    start = held_out.with_columns(smoothed)
    return Recordings(vehicle, train, start, record.nu, seen, None, (whole, whole_held_out))


def cases(part: str, logs: Path | None = None, explained: Path | None = None) -> list[Case]:
    """Return the cases of a part.

    Args:
        part: `memory`, `vehicles` or `recorded`.
        logs: Folder of the real recording, for `recorded`.
        explained: Vehicle file of `hydro explain` for it.
    """
    if part == "vehicles":
        return [Case(part, name, partial(simulated, name, None), fits_of(name)) for name in VEHICLES]
    if part == "memory":
        fits = fits_of(WITHOUT)
        fits[WITH_MEMORY] = (*fits[WITH_DRAG], start_of_memory(known(WITHOUT)))
        return [Case(part, name, partial(simulated, WITHOUT, decay), fits) for name, decay in DECAY.items()]
    if logs is None:
        raise SystemExit("future_work: part recorded needs the folder of a recording: --logs FOLDER")
    missing = [name for name in FILES if not (logs / name).is_file()]
    if missing:
        raise SystemExit(f"future_work: {logs} has no {missing[0]}: give a folder with {', '.join(FILES)}")
    vehicle = vehicles.read(logs / FILES[-1])[0]
    fits = {OWN: (*own(vehicle), *REAL)}
    return [Case(part, logs.name, partial(real, logs), fits, explained)]


def known(name: str) -> Vehicle:
    """Return a vehicle of datasets/vehicles."""
    return vehicles.read(ROOT / "datasets" / "vehicles" / f"{name}.toml")[0]


def own(vehicle: Vehicle) -> Effects:
    """Return the names of the effects of a vehicle file."""
    return tuple(str(table["name"]) for table in vehicle.effect)


def fits_of(name: str) -> dict[str, Effects]:
    """Return what is fitted to simulated recordings: the effects of the file.

    To the vehicle that gets a memory a further drag law is fitted.  It is close to the panels of the
    simulator, so that errors of the drag do not hide those of the memory.
    """
    effects = own(known(name))
    return {OWN: effects} | ({WITH_DRAG: (*effects, "ellipsoid_drag")} if name == WITHOUT else {})
